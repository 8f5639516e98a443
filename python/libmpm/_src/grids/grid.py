"""`TriangularGrid` and `SplineGrid`, in place of square cells."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from libmpm._src.base.declarations import given
from libmpm._src.base.text import marked
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.grids.bases import (
    Basis,
    ConsistentMass,
    Lagrange,
    LumpedMass,
    Mass,
    PartialMass,
    PowellSabin,
    degree_of,
)
from libmpm._src.grids.mesh import Mesh, cross, pairs

__all__ = ["SplineGrid", "TriangularGrid"]

Floats = npt.NDArray[np.float64]

#: Cells of a spline grid; with more the matrices alone would take tens of gigabytes.
_MOST = 10_000_000

#: Part of the width by which the end knots may differ from the corners.
_END = 1e-9


def _check_mass(check: Checker, mass: Any) -> None:
    check.instance("mass", mass, (Mass,), "grids.ConsistentMass(), LumpedMass() or PartialMass()")


@value
class TriangularGrid(Value):
    """Functions on a mesh of triangles as the grid of a plane scene.

    {fields}

    Raises `SceneError`. Source: de Koster (2018) 2 and 3.
    """

    label: ClassVar[str] = "grids.TriangularGrid"

    mesh: Mesh = given(
        "the `Mesh`; it must hold every place that a particle will ever take, empty "
        "triangles do no harm"
    )
    basis: Basis = given("or `Linear`, `Lagrange`, `CubicPowellSabin`", default=PowellSabin())
    mass: Mass | None = given(
        "`ConsistentMass`, `LumpedMass` or `PartialMass`. None is `PartialMass()`, which is "
        "consistent away from empty triangles; with `Lagrange` of degree 2 and more "
        "`ConsistentMass()`, the only one for it",
        default=None,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("mesh", self.mesh, (Mesh,), "a grids.Mesh, for instance Mesh.blocks(...)")
        check.instance("basis", self.basis, (Basis,), "a basis such as grids.PowellSabin()")
        negative = isinstance(self.basis, Lagrange) and self.basis.degree > 1
        mass = self.mass
        if mass is None:
            mass = ConsistentMass() if negative else PartialMass()
        _check_mass(check, mass)
        if negative and isinstance(mass, LumpedMass | PartialMass):
            check.fail(
                f"mass is {shown(mass)} with {shown(self.basis)}, whose functions have sums "
                "of mass "
                "that are zero or negative; expected ConsistentMass; or use PowellSabin or Linear"
            )
        if isinstance(self.basis, PowellSabin) and isinstance(self.mesh, Mesh):
            _check_split(check, self.mesh, self.basis.split)
        return {"mass": mass}

    @property
    def lower(self) -> tuple[float, float]:
        """Smallest coordinate on each axis, m."""
        return self.mesh.lower

    @property
    def upper(self) -> tuple[float, float]:
        """Largest coordinate on each axis, m."""
        return self.mesh.upper

    @property
    def spacing(self) -> float:
        """Length of the shortest edge, m."""
        return self.mesh.shortest_edge

    @property
    def cells(self) -> int:
        """Number of triangles."""
        return len(self.mesh.triangles)

    def doubts(self) -> list[str]:
        """Return what may spoil a result on this grid, as texts for a `ModelWarning`."""
        return self.mesh.doubts()

    def specification(self) -> dict[str, Any]:
        """Return the grid as the engine takes it, lengths in m relative to `lower`.

        "vertices" (n, 2) float64, "triangles" (m, 3) int32, "split" (m, 2) float64 or None.
        """
        vertices, triangles = self.mesh.arrays()
        split = None
        if isinstance(self.basis, PowellSabin) and self.basis.split != "incentre":
            split = np.array(self.basis.split, dtype=np.float64) - self.lower
        return {
            "kind": "triangular",
            "vertices": vertices - self.lower,
            "triangles": triangles.astype(np.int32),
            **self.basis.specification(),
            "split": split,
            "mass": (self.mass or PartialMass()).specification(),
        }


def _check_split(check: Checker, mesh: Mesh, split: Any) -> None:
    """Report inner points outside their triangles, and lines that miss the common side."""
    if split == "incentre":
        return
    if len(split) != len(mesh.triangles):
        check.fail(
            f"basis.split has {len(split)} points for {len(mesh.triangles)} triangles; expected "
            'one for each; or use "incentre"'
        )
        return
    points = np.array(split, dtype=np.float64)
    corners = mesh.corners()
    sides = np.roll(corners, -1, axis=1) - corners
    # Every side has its triangle on the left.
    outside = (cross(sides, points[:, None] - corners) <= 0).any(axis=1)
    if outside.any():
        check.fail(
            f"basis.split has points {marked(outside)} outside the triangles of these numbers; "
            'expected inside; move them, or use "incentre"'
        )
        return
    edges, other = pairs(mesh.arrays()[1])
    inner = np.flatnonzero(other > np.arange(len(other)))
    own, beyond = points[inner // 3], points[other[inner] // 3]
    start, end = (mesh.arrays()[0][edges[inner, k]] for k in (0, 1))
    line = beyond - own
    missed = (cross(line, start - own) >= 0) | (cross(line, end - own) <= 0)
    for i in inner[missed][:5].tolist():
        check.fail(
            f"basis.split: the line between the points of triangles {i // 3} and {other[i] // 3} "
            'misses their common side; expected to cross it; move the points, or use "incentre"'
        )


@value
class SplineGrid(Value):
    """Products of B-splines N_i(x) N_j(y) as the grid of a plane scene.

    {fields}

    An open knot vector does not fall, its ends are `lower` and `upper`, each p + 1 times, and an
    inner knot is there at most p times; at one of multiplicity r the functions have p - r
    continuous derivatives. Degree 0 makes the functions constant on an axis, which then has one
    span; degree (p, 0) is the one-dimensional method. Raises `SceneError`.

    Source: de Koster (2018) eq. 3.12 to 3.15.
    """

    label: ClassVar[str] = "grids.SplineGrid"

    lower: Sequence[float] = given(
        "corner of the grid with the smallest coordinates", unit="m", shape="(2,)"
    )
    upper: Sequence[float] = given(
        "opposite corner, greater than `lower` on every axis", unit="m", shape="(2,)"
    )
    spans: Sequence[int] | None = given(
        "number of equal spans on each axis", default=None, shape="(2,)", low=1
    )
    degree: int | Sequence[int] = given(
        "polynomial degree, one or (p_x, p_y)", default=2, low=0, high=5
    )
    mass: Mass | None = given(
        "`ConsistentMass`, `LumpedMass` or `PartialMass`; None = the last",
        default=None,
        range="`Mass`",
    )
    knots: Sequence[Sequence[float]] | None = given(
        "open knot vectors instead of `spans`", default=None, unit="m", range="(x, y)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        lower = check.given("lower", self)
        upper = check.given("upper", self)
        for a, (low, high) in enumerate(zip(lower, upper, strict=False)):
            if low >= high:
                check.fail(
                    f"upper[{a}] is {high:g} with lower[{a}] {low:g}; expected upper > lower"
                )
        degree = _pair(self.degree)
        if degree is None:
            check.fail(f"degree is {shown(self.degree)}; expected a whole number or (p_x, p_y)")
            degree = [2, 2]
        degree = [degree_of(check, f"degree[{a}]", p, 0) for a, p in enumerate(degree)]
        if degree == [0, 0]:
            check.fail("degree is (0, 0), functions without slopes; expected ≥ 1 on an axis")
        mass = PartialMass() if self.mass is None else self.mass
        _check_mass(check, mass)
        found: dict[str, Any] = {
            "lower": lower, "upper": upper, "degree": tuple(degree), "mass": mass
        }  # fmt: skip
        if (self.spans is None) == (self.knots is None):
            have = "both are" if self.spans is not None else "neither is"
            check.fail(f"spans and knots: {have} given; expected one of them")
        elif self.spans is not None:
            found["spans"] = _check_spans(check, self.spans, degree)
        elif lower and upper:
            found["knots"] = _check_knots(check, self.knots, degree, lower, upper)
        return found

    def _knots(self, axis: int) -> Floats:
        """Return the knots of an axis in m relative to `lower`."""
        low = self.lower[axis]
        if self.knots is not None:
            return np.array(self.knots[axis], dtype=np.float64) - low
        assert self.spans is not None  # one of the two is given
        breaks = np.linspace(0.0, self.upper[axis] - low, self.spans[axis] + 1)
        return np.pad(breaks, self._degree(axis), mode="edge")

    def _degree(self, axis: int) -> int:
        return self.degree if isinstance(self.degree, int) else self.degree[axis]

    @property
    def spacing(self) -> float:
        """Length of the shortest span, m, on the axes with a degree above 0."""
        sloping = [a for a in (0, 1) if self._degree(a) > 0]
        return float(min(np.diff(np.unique(self._knots(a))).min() for a in sloping))

    @property
    def cells(self) -> int:
        """Number of rectangles between the knots."""
        return math.prod(len(np.unique(self._knots(a))) - 1 for a in (0, 1))

    def doubts(self) -> list[str]:
        """Return what may spoil a result on this grid: nothing is known."""
        return []

    def specification(self) -> dict[str, Any]:
        """Return the grid as the engine takes it, knots float64 in m relative to `lower`."""
        return {
            "kind": "splines",
            "knots": [self._knots(0), self._knots(1)],
            "degree": [self._degree(0), self._degree(1)],
            "mass": (self.mass or PartialMass()).specification(),
        }


def _pair(item: Any) -> list[Any] | None:
    """Return a number twice, or a pair as a list."""
    items = sequence(item)
    if items is None and isinstance(item, numbers.Integral):
        items = [item, item]
    return items if items is not None and len(items) == 2 else None


def _check_spans(check: Checker, spans: Any, degree: list[int]) -> tuple[int, ...]:
    items = sequence(spans)
    if items is None or len(items) != 2:
        check.fail(f"spans is {shown(spans)}; expected a pair of whole numbers")
        return (1, 1)
    found = tuple(check.integer(f"spans[{a}]", n, lower=1) for a, n in enumerate(items))
    if math.prod(found) > _MOST:
        check.fail(f"spans is {found}, {math.prod(found):,} cells; expected {_MOST:,} at most")
        return (1, 1)
    for a, (n, p) in enumerate(zip(found, degree, strict=True)):
        if p == 0 and n > 1:
            check.fail(
                f"spans[{a}] is {n} with degree 0, whose functions jump between spans; expected 1; "
                "or use a higher degree"
            )
    return found


def _check_knots(
    check: Checker, knots: Any, degree: list[int], lower: Sequence[float], upper: Sequence[float]
) -> tuple[tuple[float, ...], ...]:
    axes = sequence(knots)
    if axes is None or len(axes) != 2:
        check.fail(f"knots is {shown(knots, 80)}; expected a pair of knot vectors in m")
        return ()
    found = []
    for a, (items, p) in enumerate(zip(axes, degree, strict=True)):
        name = f"knots[{a}]"
        items = sequence(items)
        if items is None or len(items) < 2 * (p + 1):
            check.fail(
                f"{name} is {shown(items, 80)}; expected at least {2 * (p + 1)} numbers in "
                "m for degree "
                f"{p}, each end {p + 1} times"
            )
            continue
        before = len(check.problems)
        x = tuple(check.number(f"{name}[{i}]", k, unit="m") for i, k in enumerate(items))
        if len(check.problems) == before:
            _check_vector(check, name, np.array(x), p, (lower[a], upper[a]))
        found.append(x)
    return tuple(found)


def _check_vector(check: Checker, name: str, x: Floats, p: int, ends: tuple[float, float]) -> None:
    falls = np.diff(x) < 0
    if falls.any():
        i = int(np.argmax(falls)) + 1
        check.fail(f"{name}[{i}] is {x[i]:g} after {x[i - 1]:g}; expected knots that do not fall")
        return
    places, times = np.unique(x, return_counts=True)
    for k, (place, n) in enumerate(zip(places.tolist(), times.tolist(), strict=True)):
        outer = k in (0, len(places) - 1)
        if outer and n != p + 1:
            check.fail(
                f"{name} has its end {place:g} {n} times; expected {p + 1} times for degree {p}"
            )
        if not outer and n > p:
            check.fail(
                f"{name} has {place:g} {n} times; expected at most {p} times for degree {p}, "
                "or the functions jump"
            )
    for side, have, want in zip(("lower", "upper"), (x[0], x[-1]), ends, strict=True):
        if abs(have - want) > _END * (ends[1] - ends[0]):
            check.fail(
                f"{name} has the end {have:g} with {side} {want:g} m; expected the same; correct "
                "one of them"
            )
