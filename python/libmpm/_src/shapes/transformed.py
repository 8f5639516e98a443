"""`Moved`, `Turned`, `Repeated`: solids moved, turned about a fulcrum, laid out in rows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.shapes.combined import EXAMPLE, check_length, least, shifted
from libmpm._src.shapes.oriented_boxes import Matrix, rotation
from libmpm._src.shapes.solid import Array, Bounds, Corner, Solid, dot

__all__ = ["Moved", "Repeated", "Turned"]


@value
class Moved(Solid):
    """A solid moved by (d,) m: `shape.moved(by)`. As exact as the solid. Raises `SceneError`.

    {fields}
    """

    label: ClassVar[str] = "shapes.Moved"

    shape: Solid = given("the solid")
    by: Sequence[float] = given("how far", unit="m", shape="(2|3,)")

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("shape", self.shape, (Solid,), EXAMPLE)
        by = check.given("by", self)
        check_length(check, "by", by, self.shape)
        return {"by": by}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.by)

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return self.shape.bounding

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the box around it, m."""
        return shifted(self.shape.bounds(), self.by)

    def volume(self) -> float | None:
        """Return the volume of the solid, where known."""
        return self.shape.volume()

    def _distance(self, p: Array) -> Array:
        return self.shape._distance(p - np.asarray(self.by))


@value
class Turned(Solid):
    """A solid turned about a fulcrum: `shape.turned(angle, axis, about)`.

    {fields}

    As exact as the solid. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Turned"

    shape: Solid = given("what is turned", range="a solid")
    angle: float = given("by the right-hand rule; from x to y in 2D", unit="degrees")
    axis: str | None = given(
        '"x", "y" or "z"; None = "z". Left out in 2D', default=None, range="a name"
    )
    about: Sequence[float] | None = given(
        "the fulcrum, which stays; None = the middle of its `bounds`",
        default=None,
        unit="m",
        shape="(2|3,)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        angle = check.given("angle", self)
        check.instance("shape", self.shape, (Solid,), EXAMPLE)
        if check.problems:
            return {}
        axis, about = self.axis, self.about
        if axis is not None and self.shape.dimension == 2:
            check.fail(
                f"axis is {shown(axis)} in 2D, where the angle is in the plane; leave it out"
            )
        elif self.shape.dimension == 3:
            axis = "z" if axis is None else check.choice("axis", axis, AXES)
        if about is None:
            ends = zip(*self.shape.bounds(), strict=True)
            about = tuple(0.5 * (a + b) for a, b in ends)
            if not all(map(math.isfinite, about)):
                check.fail(
                    f"about is left out of {shown(self.shape, 80)}, which has no end and so "
                    "no middle; "
                    "give about=(...) in m"
                )
        else:
            about = check.given("about", self, about)
            check_length(check, "about", about, self.shape)
        return {"angle": angle, "axis": axis, "about": about}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.shape.dimension

    @property
    def _fulcrum(self) -> Sequence[float]:
        assert self.about is not None  # checked
        return self.about

    @cached_property
    def _rows(self) -> Matrix:
        return rotation(self.dimension, self.angle, self.axis)

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return self.shape.bounding

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the box around the turned box of the solid, m."""
        ends = list(zip(*self.shape.bounds(), self._fulcrum, strict=True))
        low, high = [], []
        for row, centre in zip(self._rows, self._fulcrum, strict=True):
            # A row that does not look along an endless axis is not reached by it: no 0 × inf.
            terms = [(r * (a - c), r * (b - c))
                     for r, (a, b, c) in zip(row, ends, strict=True) if r]  # fmt: skip
            low.append(centre + sum(min(t) for t in terms))
            high.append(centre + sum(max(t) for t in terms))
        return tuple(low), tuple(high)

    def volume(self) -> float | None:
        """Return the volume of the solid, where known."""
        return self.shape.volume()

    def _distance(self, p: Array) -> Array:
        away = [x - c for x, c in zip(p.T, self._fulcrum, strict=True)]
        columns = [
            dot(away, own) + c
            for own, c in zip(zip(*self._rows, strict=True), self._fulcrum, strict=True)
        ]
        return self.shape._distance(np.stack(columns, axis=1))


#: Copies of solids that are laid out; a distance asks each, some microseconds a time.
_MOST_COPIES = 100_000


def _copies(item: Any) -> int:
    """Return how many copies of its parts a solid lays out."""
    if isinstance(item, tuple):
        return max(1, sum(_copies(x) for x in item if isinstance(x, Solid)))
    if not isinstance(item, Solid):
        return 1
    inner = max((_copies(x) for x in item.__getstate__().values()), default=1)
    return inner * math.prod(item.counts) if isinstance(item, Repeated) else inner


@value
class Repeated(Solid):
    """Copies of a solid in rows: `shape.repeated(counts, spacing)`.

    {fields}

    The distance is exact where copies do not overlap, as exact as the solid. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Repeated"

    shape: Solid = given("the first copy, with the smallest coordinates", range="a solid")
    counts: Sequence[int] = given("copies on each axis, ≥ 1", unit="1", shape="(d,)")
    spacing: Sequence[float] = given(
        "from one copy to the next on each axis, > 0", unit="m", shape="(2|3,)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("shape", self.shape, (Solid,), EXAMPLE)
        given = sequence(self.counts)
        if given is None or len(given) not in (2, 3):
            check.fail(f"counts is {shown(self.counts)}; expected 2 or 3 whole numbers ≥ 1")
            given = []
        counts = tuple(check.integer(f"counts[{a}]", n, lower=1) for a, n in enumerate(given))
        spacing = check.given("spacing", self)
        for a, x in enumerate(spacing):
            if x <= 0:
                check.fail(f"spacing[{a}] is {x:g}; expected > 0 m, from one copy to the next")
        check_length(check, "counts", counts, self.shape)
        check_length(check, "spacing", spacing, self.shape)
        copies = math.prod(counts) * _copies(self.shape)
        if copies > _MOST_COPIES:
            check.fail(
                f"counts is {counts}, {copies} copies of a solid in all; expected ≤ "
                f"{_MOST_COPIES}, as each is looked at; use fewer, or a "
                "shapes.SurfaceMesh of the whole"
            )
        return {"counts": counts, "spacing": spacing}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.counts)

    @cached_property
    def _offsets(self) -> list[Corner]:
        steps = [[i * s for i in range(n)]
                 for n, s in zip(self.counts, self.spacing, strict=True)]  # fmt: skip
        return list(itertools.product(*steps))

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return self.shape.bounding

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the box around all copies, m."""
        low, high = self.shape.bounds()
        return low, tuple(x + o for x, o in zip(high, self._offsets[-1], strict=True))

    def volume(self) -> float | None:
        """Return the copies' volumes together where the boxes around them are apart; else None."""
        one = self.shape.volume()
        low, high = self.shape.bounds()
        for a, (n, s) in enumerate(zip(self.counts, self.spacing, strict=True)):
            if n > 1 and s < high[a] - low[a]:
                return None
        return None if one is None else one * math.prod(self.counts)

    def _distance(self, p: Array) -> Array:
        box = self.shape.bounds()

        def copy(by: Corner) -> Callable[[Array], Array]:
            return lambda q: self.shape._distance(q - np.asarray(by))

        return least(p, [(copy(by), shifted(box, by)) for by in self._offsets])
