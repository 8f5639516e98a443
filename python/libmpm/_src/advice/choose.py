"""The choice among measured settings: the cheapest that keeps the error, by rules one can follow.

1. A setting counts where every case that fits has a row of it, with whatever cells, so that nothing
   is put together that was not measured, but for water and solids: each takes F-bar and particles
   from rows of its own cases; transfer, kernel, precision and part of the stable step are shared.
2. Rows that lose much more energy than the baseline are left out: their errors cancel. So are
   steps at which an isolated particle is unstable.
3. Rows of more cells than the scene has ask for smaller cells, by a whole factor m; that costs
   m^(d+1). Coarser rows give way to finer ones of the same setting, up to the scene's cells.
4. Of the settings within the error the cheapest is taken. Costs within a quarter count as equal,
   since timings differ by as much: the scene's present setting stays then, else the most accurate
   is taken; of errors within a tenth the first in the atlas.
5. Where none is within the error, the cheapest of those within a tenth of the least error.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from libmpm._src.advice.atlas import BASELINE, Row
from libmpm._src.advice.facts import Facts
from libmpm._src.advice.rules import FLOATING, Match
from libmpm._src.boundaries.responses import DecayLayer

__all__ = ["Candidate", "candidates", "choose", "layer_of", "per_case", "present", "softest"]
__all__ += ["walls_of"]

#: Groups of rows that are settings of a scene; the others change the problem or cost no accuracy.
_GROUPS = (
    "baseline", "transfer", "kernel", "F-bar", "F-bar size", "solid", "boundary", "precision",
    "cells", "particles", "step", "together",
)  # fmt: skip
#: Parts of the stable step within this count as the same setting.
_STEPS = 1.4
#: Costs, and errors, within these parts count as equal.
_COSTS, _ERRORS = 1.25, 1.1

Table = Mapping[str, Mapping[str, Row]]


@dataclass(frozen=True)
class Candidate:
    """A setting for all cases that fit: a row each.

    `error` is the largest of their errors; `cost` counts in that of the baseline with the
    scene's own cells; `refine` is the whole number by which cells have to be smaller.
    """

    rows: tuple[Row, ...]
    error: float
    cost: float
    refine: int

    def of(self, kind: str) -> Row | None:
        """Return the row that says what bodies of a kind take; None where no case has any."""
        own = [row for row in self.rows if row.kind == kind]
        if kind == "solid":
            own += [row for row in self.rows if row.case == FLOATING]
        return next(iter(own), None)

    @property
    def worst(self) -> Row:
        """The row with the largest error."""
        return max(self.rows, key=lambda row: row.worst or 0.0)


def _usable(row: Row, facts: Facts) -> bool:
    """Return whether a row is a setting that this scene can take."""
    if row.group not in _GROUPS or row.worst is None or row.cost is None or row.dissipates:
        return False
    if "extent" in row.changes or "bulk_ratio" in row.changes or row.of_law:
        return False
    # A particle alone, as in spray, is stable up to 1/√d; the checks of a scene say it too.
    if row.choices["cfl"] > 1 / math.sqrt(facts.scene.dimension):
        return False
    if not facts.takes_walls(row.choices.get("walls")):
        return False
    return row.choices.get("layer") is None or bool(facts.surfaces)


def _settings_of(of_case: Mapping[str, Row], facts: Facts) -> dict[str, Row]:
    """Return the rows of a case that this scene can take, by option.

    Of rows that differ in cells alone those count that are next to the scene's, from either side.
    Walls that are mirrors or linear stay so, where the case has rows of them.
    """
    found = {name: row for name, row in of_case.items() if _usable(row, facts)}
    found = {k: row for k, row in found.items() if not _coarse(row, found.values(), facts)}
    kind = "mirror" if facts.mirrored else "linear" if facts.linear else None
    alike = {name: row for name, row in found.items() if row.choices.get("walls") == kind}
    return alike if kind is not None and alike else found


def _coarse(row: Row, others: Iterable[Row], facts: Facts) -> bool:
    """Return whether another row is the same with more cells, and the scene has as many."""
    have = facts.cells(_kind_of(row)) * (1 + 1e-6)
    return any(
        row.cells < other.cells <= have
        and other.choices == row.choices
        and other.per_axis == row.per_axis
        for other in others
    )


def _setting(row: Row, of_case: Mapping[str, Row], facts: Facts) -> str:
    """Return what a setting is, whatever the case and its cells, as a key."""
    own = {k: row.choices.get(k) for k in ("fbar", "solid_fbar")}
    return json.dumps([_common(row, of_case, facts), own, row.per_axis], sort_keys=True)


def walls_of(row: Row, facts: Facts) -> str | None:
    """Return the walls that a row asks for, None for those that the scene has."""
    walls = row.choices.get("walls")
    return None if facts.linear and walls == "linear" else walls


def _common(row: Row, of_case: Mapping[str, Row], facts: Facts) -> str:
    """Return what all bodies of a scene share, as a key."""
    shared = {k: row.choices.get(k) for k in ("transfer", "kernel", "precision", "layer")}
    # Cases whose walls make no difference have no rows of linear ones.
    shared["walls"] = walls_of(row, facts)
    step = row.choices["cfl"] / of_case[BASELINE].choices["cfl"]
    return json.dumps([shared, round(step, 6)], sort_keys=True)


def _factor(row: Row, of_case: Mapping[str, Row]) -> float:
    """Return what the method costs relative to the default one with as many cells."""
    assert row.cost is not None
    ratio = row.changes.get("cells_ratio", 1.0)
    for other in of_case.values():
        same = other.group == "cells" and other.changes.get("cells_ratio") == ratio
        if ratio != 1 and same and other.cost and "extent" not in other.changes:
            return row.cost / other.cost
    return row.cost


def _refine(rows: Iterable[Row], facts: Facts) -> int:
    """Return the whole number by which the scene's cells would have to be smaller."""
    need = max(row.cells / facts.cells(_kind_of(row)) for row in rows)
    return max(1, math.ceil(need - 1e-6))


def _kind_of(row: Row) -> str:
    # The block that floats is what its cells count across.
    return "solid" if row.case == FLOATING else row.kind


def _options(table: Table, cases: Sequence[str], facts: Facts) -> Iterator[tuple[Row, ...]]:
    """Return the rows of every setting that all of the cases have."""
    if not cases:
        yield ()
        return
    groups: list[dict[str, list[Row]]] = []
    for case in cases:
        groups.append({})
        for row in _settings_of(table[case], facts).values():
            groups[-1].setdefault(_setting(row, table[case], facts), []).append(row)
    for key in groups[0]:
        if all(key in group for group in groups):
            yield from itertools.product(*(group[key] for group in groups))


def candidates(table: Table, found: Sequence[Match], facts: Facts) -> list[Candidate]:
    """Return all settings that were measured on every one of the cases."""
    cases = {kind: [m.case for m in found if m.kind == kind] for kind in ("water", "solid")}
    made = []
    solid = list(_options(table, cases["solid"], facts))
    for water in _options(table, cases["water"], facts):
        for other in solid:
            rows = (*water, *other)
            if len({_common(row, table[row.case], facts) for row in rows}) != 1:
                continue
            refine = _refine(rows, facts)
            method = sum(_factor(row, table[row.case]) for row in rows) / len(rows)
            error = max(row.worst or 0.0 for row in rows)
            cost = method * float(refine) ** (facts.scene.dimension + 1)
            made.append(Candidate(rows, error, cost, refine))
    return made


def layer_of(row: Row) -> DecayLayer:
    """Return the decay layer of surfaces in a row."""
    given = row.choices.get("layer")
    return DecayLayer() if given is None else DecayLayer.from_dict({"type": "DecayLayer", **given})


def _is_present(row: Row, facts: Facts) -> bool:
    """Return whether a row is how the scene is set up."""
    method = facts.scene.method
    if (row.transfer, row.kernel) != (facts.scene.transfer, method.kernel_choice):
        return False
    given = row.choices
    step = method.cfl / given["cfl"]
    if given["precision"] != "single" or not 1 / _STEPS < step < _STEPS:
        return False
    if given.get("walls") not in (
        None,
        "mirror" if facts.mirrored else "",
        "linear" if facts.linear else "",
    ):
        return False
    layer = layer_of(row)
    if row.case == "slope-basin" and any(own != layer for own in facts.layers):
        return False
    size, d = facts.scene.cell_size, facts.scene.dimension
    for name, own, speed, count in facts.setups:
        if row.fbar(name, size, speed) != own or row.per_axis != round(count ** (1 / d)):
            return False
    return True


def present(found: Sequence[Candidate], facts: Facts) -> Candidate | None:
    """Return the scene's own setting, with as many cells as it has; None if it was not measured."""
    own = [c for c in found if c.refine == 1 and all(_is_present(r, facts) for r in c.rows)]
    # The finest of those that are no finer than the scene is nearest to it.
    return max(own, key=lambda c: min(row.cells for row in c.rows), default=None)


def choose(found: Sequence[Candidate], error: float, now: Candidate | None) -> Candidate:
    """Return the cheapest setting within the error; the most accurate one if there is none."""
    good = [c for c in found if c.error <= error]
    if not good:
        least = _ERRORS * min(c.error for c in found)
        return min((c for c in found if c.error <= least), key=lambda c: c.cost)
    limit = _COSTS * min(c.cost for c in good)
    equal = [c for c in good if c.cost <= limit]
    if now is not None and any(_same(now, c) for c in equal):
        return now
    least = _ERRORS * min(c.error for c in equal)
    return next(c for c in equal if c.error <= least)


def _same(one: Candidate, two: Candidate) -> bool:
    return one.rows == two.rows


def per_case(table: Table, case: str, facts: Facts) -> Row | None:
    """Return the most accurate row of a case; None where it has none."""
    rows = _settings_of(table[case], facts).values()
    return min(rows, key=lambda row: row.worst or 0.0, default=None)


@dataclass(frozen=True)
class Softest:
    """Least bulk modulus: the largest ρ g H/K and v/c that keep the error, and where from."""

    compression: float
    mach: float
    row: Row


def softest(table: Table, cases: Sequence[str], error: float) -> Softest | None:
    """Return the softest water that keeps within the error of the stiffest one, in all cases.

    Counted is what the bulk modulus adds to the largest error of a case, whatever that is.
    """
    limits: list[Softest] = []
    for case in cases:
        rows = [
            row
            for row in table[case].values()
            if row.option == BASELINE or row.group == "bulk modulus"
        ]
        rows = [r for r in rows if r.worst is not None and r.compression is not None]
        if len(rows) < 2:
            continue
        rows.sort(key=lambda r: r.compression or 0.0)
        stiffest = rows[0].worst or 0.0
        kept = rows[0]
        for row in rows[1:]:
            if (row.worst or 0.0) > stiffest + error:
                break
            kept = row
        limits.append(Softest(kept.compression or 0.0, kept.mach, kept))
    if not limits:
        return None
    # Where nothing moves, v/c says nothing about how soft the water may be.
    mach = min((s.mach for s in limits if s.mach > 0), default=0.0)
    least = min(limits, key=lambda s: s.compression)
    return Softest(least.compression, mach, least.row)
