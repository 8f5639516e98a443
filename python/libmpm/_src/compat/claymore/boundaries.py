"""Boundaries of ClaymoreUW: walls, floors, structures and pumps; flumes are next door."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from libmpm._src.base.time_tables import constant
from libmpm._src.boundaries.responses import Prescribed
from libmpm._src.compat.claymore.contact import (
    Made,
    Setting,
    boxes,
    copies_of,
    gone,
    response_of,
    surfaces,
    wide,
    window_of,
)
from libmpm._src.compat.claymore.flumes import bed, gate, harbor, paddle
from libmpm._src.compat.claymore.geometry import Fit
from libmpm._src.compat.claymore.reader import Context
from libmpm._src.compat.claymore.records import BoundaryRecord
from libmpm._src.shapes.boxes import FACES, DomainWalls
from libmpm._src.shapes.primitives import Cylinder, HalfSpace, Sphere

__all__ = ["make_boundaries", "walls_of"]


def walls_of(context: Context, boundaries: Sequence[BoundaryRecord]) -> BoundaryRecord | None:
    """Return the walls of the domain, of which there may be one set."""
    walls = [b for b in boundaries if b.object == "walls"]
    for other in walls[1:]:
        if (other.lower, other.upper) != (walls[0].lower, walls[0].upper):
            context.fail(
                other.path,
                f"are walls besides those of {walls[0].path}, which is refused; keep one set, and "
                "make the others boxes",
            )
    return walls[0] if walls else None


def make_boundaries(
    context: Context, boundaries: Sequence[BoundaryRecord], setting: Setting
) -> list[Made]:
    """Return what to add to the scene for the boundaries of a file."""
    made: list[Made] = []
    names: set[str] = set()
    floor = [b for b in boundaries if b.object == "floor"]
    for one in boundaries:
        if one.object == "walls" and one is not walls_of(context, boundaries):
            continue
        if one.object == "walls":
            found = _walls(context, one, setting, floor)
        elif one.object == "floor" and _is_wall(one, setting.fit):
            if walls_of(context, boundaries) is None:
                found = _floor_wall(context, one, setting)
            else:
                continue
        else:
            found = _MAKERS[one.object](context, one, setting)
        for index, piece in enumerate(found):
            name = _named(one.name or piece.name, index, len(found), names)
            names.add(name)
            made.append(replace(piece, name=name))
    return made


def _named(name: str, index: int, count: int, taken: set[str]) -> str:
    """Return a name that no other boundary has: numbered where there are several."""
    wanted = name.replace("/", "-").strip() or "boundary"
    if count > 1:
        wanted = f"{wanted}-{index + 1}"
    numbers = itertools.count(2)
    result = wanted
    while result in taken:
        result = f"{wanted}-{next(numbers)}"
    return result


def _is_wall(one: BoundaryRecord, fit: Fit) -> bool:
    """Return whether a floor is the bottom of the domain, all of it."""
    assert one.lower is not None and one.upper is not None
    slack = 1e-6 * fit.cell_size
    level = one.lower[1] <= fit.lower[1] + slack
    return level and all(
        one.lower[a] <= fit.lower[a] + slack and one.upper[a] >= fit.stated[a] - slack
        for a in (0, 2)
    )


def _walls(
    context: Context, one: BoundaryRecord, setting: Setting, floors: Sequence[BoundaryRecord]
) -> list[Made]:
    response: Any = response_of(context, one)
    below = [f for f in floors if _is_wall(f, setting.fit)]
    if below:
        response = dict.fromkeys(FACES, response) | {"y-": response_of(context, below[0])}
        context.note(f"{below[0].path}: the floor is the lower wall of {one.path}")
    arguments = {"shape": DomainWalls(), "response": response} | window_of(one, setting)
    return [Made("walls", arguments)]


def _floor_wall(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    arguments = {"shape": DomainWalls(faces=("y-",)), "response": response_of(context, one)}
    return [Made("floor", arguments | window_of(one, setting))]


def _floor(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return a floor above the bottom: everything under its plane, as far as its domain goes."""
    assert one.lower is not None and one.upper is not None
    fit = setting.fit
    lower = (one.lower[0], fit.lower[1], one.lower[2])
    upper = (one.upper[0], one.lower[1], one.upper[2])
    if lower[1] >= upper[1]:
        lower = (lower[0], upper[1] - fit.cell_size, lower[2])
    return boxes(context, one, setting, "floor", [(lower, upper)])


def _box(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    return boxes(context, one, setting, "box", copies_of(one))


def _sphere(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    shapes = []
    for lower, upper in copies_of(one):
        sizes = [b - a for a, b in zip(lower, upper, strict=True)]
        radius = one.radius or 0.5 * min(sizes)
        if radius <= 0:
            context.fail(one.path, f"spans {list(lower)} to {list(upper)}; expected end > start, m")
            return []
        centre = [0.5 * (a + b) for a, b in zip(lower, upper, strict=True)]
        shapes.append(Sphere(centre=centre, radius=radius))
    return surfaces(context, one, setting, "sphere", shapes)


def _cylinder(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return cylinders inscribed in their boxes; the axis is the one whose two others are equal."""
    shapes = []
    for lower, upper in copies_of(one):
        sizes = [b - a for a, b in zip(lower, upper, strict=True)]
        if min(sizes) <= 0:
            context.fail(one.path, f"spans {list(lower)} to {list(upper)}; expected end > start, m")
            return []
        along = _axis_of(context, one, sizes)
        across = [s for a, s in enumerate(sizes) if a != along]
        centre = [0.5 * (a + b) for a, b in zip(lower, upper, strict=True)]
        fit = setting.fit
        start, end = list(centre), list(centre)
        start[along] = fit.beyond(along, lower[along], -1)
        end[along] = fit.beyond(along, upper[along], 1)
        radius = one.radius or 0.5 * min(across)
        shapes.append(Cylinder(start=start, end=end, radius=radius))
    return surfaces(context, one, setting, "cylinder", shapes)


def _axis_of(context: Context, one: BoundaryRecord, sizes: Sequence[float]) -> int:
    given = (one.axis or "").strip().lower()
    if given in ("x", "y", "z"):
        return "xyz".index(given)
    for a in (1, 2, 0):
        u, v = (s for b, s in enumerate(sizes) if b != a)
        if abs(u - v) <= 1e-6 * max(sizes) and abs(u - sizes[a]) > 1e-6 * max(sizes):
            return a
    context.note(f"{one.path}: its box does not determine the axis of the cylinder; y is used")
    return 1


def _plane(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return the half space below the lowest corner of a flat or upright box, or under its top."""
    assert one.lower is not None and one.upper is not None
    sizes = [b - a for a, b in zip(one.lower, one.upper, strict=True)]
    flat = [a for a, s in enumerate(sizes) if s <= 1e-9]
    axis = flat[0] if len(flat) == 1 else 1
    if len(flat) != 1:
        context.note(f"{one.path}: the plane is the horizontal one at its domain_start")
    normal = [0.0, 0.0, 0.0]
    middle = 0.5 * (setting.fit.lower[axis] + setting.fit.upper[axis])
    normal[axis] = 1.0 if one.lower[axis] <= middle else -1.0
    shape = HalfSpace(point=one.lower, normal=normal)
    return surfaces(context, one, setting, "plane", [shape])


def _velocity(context: Context, one: BoundaryRecord, setting: Setting) -> list[Made]:
    """Return a region with a given velocity, on the axes where it is not zero."""
    assert one.lower is not None and one.upper is not None
    velocity = one.velocity
    if velocity is None:
        context.note(f"{one.path}: it has no velocity and so no effect; left out")
        return []
    if one.object == "wasirf-pump":
        context.note(
            f"{one.path}: the pump gives its velocity; ClaymoreUW gives it to what is slower"
        )
    axes = tuple(a for a, v in zip("xyz", velocity, strict=True) if v or not any(velocity))
    found = []
    for lower, upper in copies_of(one):
        box = wide(setting.fit, lower, upper)
        arguments = {
            "response": Prescribed(components=axes),
            "motion": constant(velocity),
        }
        found.append(Made("region", {"shape": box} | arguments | window_of(one, setting)))
    return [] if gone(context, one, setting) else found


_MAKERS: Mapping[str, Callable[[Context, BoundaryRecord, Setting], list[Made]]] = {
    "floor": _floor,
    "box": _box,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "plane": _plane,
    "bathymetry": bed,
    "lwf-ramp": bed,
    "twb-ramp": bed,
    "usgs-ramp": bed,
    "lwf-paddle": paddle,
    "twb-paddle": paddle,
    "usgs-gate": gate,
    "wasirf-pump": _velocity,
    "velocity": _velocity,
    "harbor": harbor,
}
