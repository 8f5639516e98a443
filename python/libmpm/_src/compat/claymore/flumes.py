"""Boundaries of the facilities that ClaymoreUW knows by name: beds, quay, paddles, gate."""

from __future__ import annotations

import itertools

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import DecayLayer, Displacement, Travel
from libmpm._src.compat.claymore.contact import (
    Made,
    Setting,
    boxes,
    displacement,
    response_of,
    surfaces,
)
from libmpm._src.compat.claymore.facilities import BEDS, GATE, HARBOR, PUBLISHED_ENDS
from libmpm._src.compat.claymore.geometry import BEYOND, bed_solid
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BoundaryRecord
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.primitives import HalfSpace
from libmpm._src.shapes.prisms import Extrusion
from libmpm._src.shapes.solid import Solid

__all__ = ["bed", "bed_of", "gate", "harbor", "paddle"]


def bed_of(boundary: BoundaryRecord) -> str | None:
    """Return the facility whose bed a boundary is, "custom" for one of its own points."""
    if boundary.object == "bathymetry" or (boundary.bathymetry and "ramp" in boundary.object):
        return "custom"
    return boundary.object.removesuffix("-ramp") if boundary.object.endswith("-ramp") else None


def bed(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    kind = bed_of(one)
    known = BEDS.get(kind or "")
    profile = one.bathymetry or (known.profile if known else ())
    edge = profile[0][0] - setting.fit.lower[0], setting.fit.stated[0] - profile[-1][0]
    if one.bathymetry and max(edge) > setting.fit.cell_size:
        context.note(f"{one.path}: the bed continues level beyond its first and last point")
    if any(b[0] < a[0] for a, b in itertools.pairwise(profile)):
        context.fail(one.path, "has a bathymetry whose x falls; expected rising x")
        return []
    shape = bed_solid(profile, setting.fit)
    # A layer whose hold fades lets water seep into a gentle slope (design/walls.md section 6).
    layer = DecayLayer()
    faded = known.layer if known else "linear"
    context.note(
        f"{one.path}: the bed holds all nodes up to a cell off; the {faded} decay of ClaymoreUW "
        "lets water seep in"
    )
    name = "bathymetry" if kind == "custom" else f"{kind}-bed"
    if kind == "usgs" and known is not None:
        return _usgs(context, one, setting, shape, layer)
    return surfaces(context, one, setting, name, [shape], layer=layer)


def _usgs(
    context: Context, one: BoundaryRecord, setting: Setting, shape: Solid, layer: DecayLayer
) -> list[Made]:
    """Return the flume's bed in three parts: tiles in the middle, concrete before and behind."""
    fit = setting.fit
    first, last, friction = PUBLISHED_ENDS
    past = BEYOND * fit.cell_size
    low, high = [x - past for x in fit.lower], [x + past for x in fit.upper]
    ends = [low[0], *(x for x in (first, last) if low[0] < x < high[0]), high[0]]
    made = []
    for a, b in itertools.pairwise(ends):
        rough = one.friction if first <= 0.5 * (a + b) <= last else (friction, friction)
        within = Box(lower=(a, *low[1:]), upper=(b, *high[1:]))
        made += surfaces(
            context, one, setting, "usgs-bed", [shape],
            layer=layer, within=within, response=response_of(context, one, rough),
        )  # fmt: skip
    context.note(f"{one.path}: friction is {friction:g} before {first:g} m and behind {last:g} m, "
                 "as ClaymoreUW has it")  # fmt: skip
    return made


def harbor(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return the quay of the Waseda basin: a block up to the apron, as far as the rear wall."""
    fit = setting.fit
    lower = (HARBOR[0], fit.lower[1], fit.lower[2])
    upper = (fit.stated[0], HARBOR[1], fit.stated[2])
    block = boxes(context, one, setting, "harbor", [(lower, upper)], friction=(0.0, 0.0))
    static, dynamic = one.friction
    if max(static, dynamic) <= 0 or not block:
        return block
    # Friction holds debris, not water: a second boundary in the same place, for solid bodies.
    rough = dict(block[0].arguments) | {"response": response_of(context, one)}
    return [*block, Made("harbor-friction", rough, solids_only=True)]


def paddle(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return a piston: everything behind its face, which stands at domain_end and moves along x."""
    fit = setting.fit
    face = one.upper[0] if one.upper is not None else 0.0
    if one.file is None and one.velocity is None:
        context.fail(one.path, "is a paddle without a motion file; expected file, or velocity")
        return []
    way = 0.0
    motion: Displacement | Travel | None
    if one.file is not None:
        motion = displacement(context, one, setting)
        if motion is None:
            return []
        way = max(row[0] for row in motion.table.value)  # type: ignore[index]
    else:
        assert one.velocity is not None
        motion = Travel(one.velocity)
        way = max(0.0, one.velocity[0] * setting.until)
    past = BEYOND * fit.cell_size
    lower = (min(fit.lower[0], face) - way - past, *(x - past for x in fit.lower[1:]))
    upper = (face, *(x + past for x in fit.upper[1:]))
    box = Box(lower=lower, upper=upper)
    return surfaces(context, one, setting, "paddle", [box], motion=motion)


def gate(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return the two doors of the USGS flume, which slide apart and are gone after that."""
    fit, gate = setting.fit, GATE
    if setting.start >= gate.gone:
        return []
    middle = gate.middle
    if one.lower is not None and one.upper is not None and one.upper[2] > one.lower[2]:
        middle = 0.5 * (one.lower[2] + one.upper[2])
    thick = 3 * fit.cell_size
    high = fit.upper[1] + BEYOND * fit.cell_size
    lean = gate.lean[0] / gate.lean[1]
    ends = (-BEYOND * fit.cell_size, high)
    face = [(gate.foot + lean * y, y) for y in ends]
    profile = [*face, *((x + thick, y) for x, y in reversed(face))]
    # Of a mass that the gate cuts, what lies before it has already left.
    past = HalfSpace(point=(gate.foot, 0.0, 0.0), normal=(-gate.lean[1], gate.lean[0], 0.0))
    made = []
    opens, gone = (t - setting.start for t in (gate.opens, gate.gone))
    for side in (-1, 1):
        edges = sorted((middle, middle + side * gate.width))
        door = Extrusion(profile=profile, axis="z", lower=edges[0], upper=edges[1])
        way = (0.0, 0.0, side * gate.width)
        rows = [(opens, (0.0, 0.0, 0.0)), (gone, way)]
        table = TimeTable([t for t, _ in rows], [v for _, v in rows])
        arguments = {
            "shape": door, "response": response_of(context, one), "motion": Displacement(table),
            "time": (0.0, gone),
        }  # fmt: skip
        made.append(Made("gate", arguments, door, past))
    context.note(f"{one.path}: its doors part from the middle at {gate.opens:g} s and are gone at "
                 f"{gate.gone:g} s, as ClaymoreUW has it")  # fmt: skip
    return made
