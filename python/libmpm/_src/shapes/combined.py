"""Solids made of solids: either, both, one without another.

Of the least and the greatest of signed distances the sign is exact, and the magnitude never above
the true distance (Hart 1996, "Sphere tracing", section 3).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.shapes.solid import Array, Bounds, Corner, Solid, box_distance

__all__ = ["EXAMPLE", "Difference", "Intersection", "Union"]
__all__ += ["check_length", "least", "shifted"]

EXAMPLE = "a solid of libmpm.shapes, for instance shapes.Box(lower=..., upper=...)"


@value
class Union(Solid):
    """What is in any of several solids: `a | b`.

    {fields}

    The distance is exact outside; inside, where parts overlap, a lower bound. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Union"

    parts: Sequence[Solid] = given("the solids, one or more")

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"parts": _parts(check, self.parts, Union)}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.parts[0].dimension

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return all(part.bounding for part in self.parts)

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the smallest straight box around all parts, m."""
        low, high = _corners(self.parts)
        return tuple(map(min, *low)) if len(low) > 1 else low[0], (
            tuple(map(max, *high)) if len(high) > 1 else high[0]
        )

    def volume(self) -> float | None:
        """Return the sum of the parts' volumes where the boxes around them are apart."""
        boxes = [part.bounds() for part in self.parts]
        if any(not _apart(*pair) for pair in itertools.combinations(boxes, 2)):
            return None
        volumes = [part.volume() for part in self.parts]
        return None if None in volumes else math.fsum(v for v in volumes if v is not None)

    def _distance(self, p: Array) -> Array:
        return least(p, [(part._distance, part.bounds()) for part in self.parts])


@value
class Intersection(Solid):
    """What is in all of several solids: `a & b`.

    {fields}

    The distance is a lower bound of the true one. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Intersection"

    parts: Sequence[Solid] = given("the solids, one or more")

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"parts": _parts(check, self.parts, Intersection)}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.parts[0].dimension

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return all(part.bounding for part in self.parts)

    def bounds(self) -> Bounds:
        """Return the corners of what the boxes around the parts share, m; all 0 if nothing."""
        low, high = _corners(self.parts)
        first = tuple(map(max, *low)) if len(low) > 1 else low[0]
        last = tuple(map(min, *high)) if len(high) > 1 else high[0]
        if any(a > b for a, b in zip(first, last, strict=True)):
            return (0.0,) * self.dimension, (0.0,) * self.dimension
        return first, last

    def _distance(self, p: Array) -> Array:
        result = self.parts[0]._distance(p)
        for part in self.parts[1:]:
            result = np.maximum(result, part._distance(p))
        return result


@value
class Difference(Solid):
    """One solid without another: `whole - without`.

    {fields}

    The distance is a lower bound of the true one. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Difference"

    whole: Solid = given("the solid that is cut")
    without: Solid = given("the solid that is taken away")

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("whole", self.whole, (Solid,), EXAMPLE)
        check.instance("without", self.without, (Solid,), EXAMPLE)
        if not check.problems:
            _same_dimension(check, {"whole": self.whole, "without": self.without})
        return {}

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self.whole.dimension

    @property
    def bounding(self) -> bool:
        """Whether the magnitude of `distance` is never above the true one."""
        return self.whole.bounding and self.without.bounding

    def bounds(self) -> Bounds:
        """Return lower and upper corner of the box around the whole, m."""
        return self.whole.bounds()

    def volume(self) -> float | None:
        """Return the volume of the whole where the boxes around the two are apart; else None."""
        apart = _apart(self.whole.bounds(), self.without.bounds())
        return self.whole.volume() if apart else None

    def _distance(self, p: Array) -> Array:
        return np.maximum(self.whole._distance(p), -self.without._distance(p))


def least(p: Array, parts: Sequence[tuple[Callable[[Array], Array], Bounds]]) -> Array:
    """Return the least of several distances, asking a part only where it may be the least.

    A part is no nearer than the box around it.
    """
    best = np.full(len(p), np.inf)
    order = range(len(parts))
    if len(parts) > 2 and len(p):
        # Near parts first, so that few others need to be asked.
        middle = 0.5 * (p.min(axis=0) + p.max(axis=0))[None]
        away = [float(box_distance(middle, *box)[0]) for _, box in parts]
        order = sorted(order, key=lambda i: away[i])  # type: ignore[assignment]
    for i in order:
        distance, box = parts[i]
        apart = box_distance(p, *box)
        near = np.flatnonzero((apart < best) | (apart <= 0))
        if len(near):
            best[near] = np.minimum(best[near], distance(p[near]))
    return best


def _parts(check: Checker, given: Any, kind: type[Union] | type[Intersection]) -> tuple[Solid, ...]:
    """Return the parts, with those of parts of the same kind taken apart."""
    items = sequence(given)
    if not items:
        check.fail(f"parts is {shown(given)}; expected one or more solids")
        return ()
    for i, item in enumerate(items):
        check.instance(f"parts[{i}]", item, (Solid,), EXAMPLE)
    if check.problems:
        return ()
    _same_dimension(check, {f"parts[{i}]": item for i, item in enumerate(items)})
    return tuple(itertools.chain(*(i.parts if isinstance(i, kind) else (i,) for i in items)))


def _same_dimension(check: Checker, solids: dict[str, Solid]) -> None:
    (first, one), *others = solids.items()
    for name, solid in others:
        if solid.dimension != one.dimension:
            check.fail(
                f"{name} is {solid.dimension}D with {first} {one.dimension}D; expected solids of "
                "one dimension"
            )


def check_length(check: Checker, name: str, given: Sequence[float], shape: Any) -> None:
    if given and isinstance(shape, Solid) and len(given) != shape.dimension:
        check.fail(f"{name} has {len(given)} numbers for a solid in {shape.dimension}D; expected "
                   f"{shape.dimension}")  # fmt: skip


def _corners(parts: Sequence[Solid]) -> tuple[list[Corner], list[Corner]]:
    boxes = [part.bounds() for part in parts]
    return [low for low, _ in boxes], [high for _, high in boxes]


def _apart(one: Bounds, two: Bounds) -> bool:
    ends = zip(*one, *two, strict=True)
    return any(high <= base or top <= low for low, high, base, top in ends)


def shifted(box: Bounds, by: Sequence[float]) -> Bounds:
    low, high = (tuple(x + o for x, o in zip(end, by, strict=True)) for end in box)
    return low, high
