"""Where a scene leaves the range in which the cases that fit it were measured."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from libmpm._src.advice.atlas import Row
from libmpm._src.advice.facts import Facts
from libmpm._src.advice.rules import FLOATING
from libmpm._src.scene.checks_loads import weighed

__all__ = ["WEIGHING", "leaves", "of_loads"]

#: Cases of the atlas whose error is that of a load on a structure in a flow.
WEIGHING = ("surge-load", "surge-debris-load")

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


def of_loads(facts: Facts, known: Sequence[str]) -> list[str]:
    """Return what the expected error says of loads on structures in a flow: nothing, and why.

    `known` are the cases that it comes from; those of `WEIGHING` have measured a load themselves.
    """
    names = [b.name for b in weighed(facts.scene)]
    if not names or not facts.water or facts.at_rest or set(known) & set(WEIGHING):
        return []
    shown = ", ".join(f"'{n}'" for n in names)
    return [
        f"the load on {shown}: none of the cases weighs a structure in a flow, so that the "
        "expected error is not that of the load and nothing measured covers it; forces of bores "
        "on a wall were within 8 % from 16 cells a depth on, of the box in the Large Wave Flume "
        "1.7 to 6.7 times the measured one (docs/boundaries.md)"
    ]


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
