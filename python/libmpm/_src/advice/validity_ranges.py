"""Where a scene leaves the range in which the cases that fit it were measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from libmpm._src.advice.atlas import Row
from libmpm._src.advice.facts import Facts
from libmpm._src.advice.rules import FLOATING
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box

__all__ = ["leaves", "thin_loads"]

#: Structures up to so many cells thick were seen to take loads from what a transfer loses.
_THIN = 4.0

#: Transfers that lose something of a flow's shear in every step.
_LOSING = ("PIC", "APIC", "PIC-FLIP")

#: Part by which a number may be beyond the range before a word is said about it.
_SLACK = 1.01


def _outside(value: float, values: Iterable[float]) -> str:
    """Return "above" or "below" where a value is outside the range of others, or nothing."""
    known = sorted(values)
    if not known:
        return ""
    if value > known[-1] * _SLACK:
        return "above"
    return "below" if value * _SLACK < known[0] else ""


def _span(values: Iterable[float], how: str = ".3g") -> str:
    known = sorted(set(values))
    ends = [format(x, how) for x in (known[0], known[-1])]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def leaves(facts: Facts, rows: Sequence[Row]) -> list[str]:
    """Return warnings: the quantity, its value, the range of the rows, and what to do about it."""
    found = []
    for kind in ("water", "solid"):
        own = [r for r in rows if r.kind == kind and r.case != FLOATING]
        own += [r for r in rows if r.case == FLOATING and kind == "solid"]
        if own and (facts.water if kind == "water" else facts.solids):
            found += _resolution(facts, kind, own)
    water = [r for r in rows if r.compression is not None]
    if water and facts.water:
        found += _stiffness(facts, water)
    solid = [r for r in rows if r.kind == "solid"]
    if solid and facts.solids:
        speeds = {b.name: facts.mach(b) for b in facts.solids}
        name = max(speeds, key=lambda n: speeds[n])
        if _outside(speeds[name], [r.mach for r in solid]) == "above":
            found.append(
                f"body '{name}' starts at {speeds[name]:.3g} of its wave speed; measured up to "
                f"{max(r.mach for r in solid):.3g}"
            )
    dimensions = {r.dimension for r in rows}
    if rows and facts.scene.dimension not in dimensions:
        found.append(
            f"the scene has {facts.scene.dimension} dimensions; its cases were measured in "
            f"{_span(dimensions, 'd')}: errors carry over where the flow is plane, costs do not"
        )
    return found


def thin_loads(facts: Facts) -> list[str]:
    """Return a warning for each load cell on a box of few cells in water that flows, with APIC."""
    scene = facts.scene
    scheme = scene.method.transfer_choice.scheme
    if not facts.water or facts.at_rest or scheme not in _LOSING:
        return []
    shapes = {b.name: b.shape for b in scene.boundaries if isinstance(b.shape, Box)}
    found = []
    for name in {s.sensor.boundary: None for s in scene.sensors if isinstance(s.sensor, LoadCell)}:
        if name not in shapes:
            continue
        box = shapes[name]
        inside = [
            min(b, high) - max(a, low)
            for a, b, low, high in zip(box.lower, box.upper, scene.lower, scene.upper, strict=True)
        ]
        cells = min(inside) / scene.cell_size
        if 0 < cells <= _THIN * _SLACK:
            found.append(
                f"boundary '{name}' is {cells:.3g} cells thick and weighed: with {scheme}, which "
                "loses shear in every step, water that flows round 2 to 4 cells pressed 3 to 10 "
                "times too hard, the more the stiffer it is; transfer 'FLIP' (docs/bridges.md), or "
                "more cells"
            )
    return found


def _resolution(facts: Facts, kind: str, rows: Sequence[Row]) -> list[str]:
    found = []
    cells = facts.cells(kind)
    known = [r.cells for r in rows]
    what = "the water" if kind == "water" else "the thinnest solid"
    side = _outside(cells, known)
    if side:
        remedy = (
            "smaller cells" if side == "below"
            else "errors should be smaller, but losses per step add up over more steps"
        )  # fmt: skip
        found.append(f"{what} is {cells:.3g} cells across; measured with {_span(known)}: {remedy}")
    d = facts.scene.dimension
    per_axis = {r.per_axis for r in rows}
    bodies = facts.water if kind == "water" else facts.solids
    for body in bodies:
        own = round(body.particles_per_cell ** (1 / d))
        if body.lattice is None and _outside(own, per_axis):
            found.append(
                f"body '{body.name}' has {body.particles_per_cell} particles per cell, {own} an "
                f"axis; measured with {_span(per_axis, 'd')} an axis"
            )
            break
    return found


def _stiffness(facts: Facts, rows: Sequence[Row]) -> list[str]:
    found = []
    own = {b.name: (facts.compression(b), facts.mach(b)) for b in facts.water}
    name = max(own, key=lambda n: own[n][0])
    compression = own[name][0]
    known = [r.compression for r in rows if r.compression is not None]
    side = _outside(compression, known)
    if side == "above":
        found.append(
            f"body '{name}' loses ρgH/K = {compression:.3g} of its volume under its own depth; "
            f"measured up to {max(known):.3g}: a larger bulk_modulus"
        )
    elif side == "below" and compression > 0:
        found.append(
            f"body '{name}' is stiffer than what was measured, ρgH/K = {compression:.3g} against "
            f"{min(known):.3g}: more steps, in each of which the transfer takes its part; a "
            "smaller bulk_modulus"
        )
    name = max(own, key=lambda n: own[n][1])
    mach = own[name][1]
    fastest = max(r.mach for r in rows)
    if _outside(mach, [fastest]) == "above":
        found.append(
            f"body '{name}' may come to {facts.fastest:.3g} m/s, {mach:.3g} of its wave speed; "
            f"measured up to {fastest:.3g}: a larger bulk_modulus"
        )
    return found
