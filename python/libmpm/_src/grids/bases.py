"""Basis functions on triangles, and how the mass matrix is solved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, shown, value

__all__ = ["HIGHEST", "Basis", "ConsistentMass", "CubicPowellSabin", "Lagrange", "Linear"]
__all__ += ["LumpedMass", "Mass", "PartialMass", "PowellSabin", "degree_of"]

#: Highest polynomial degree that the engine evaluates.
HIGHEST = 5


def degree_of(check: Checker, name: str, item: Any, lower: int, upper: int = HIGHEST) -> int:
    """Return a polynomial degree within its range."""
    degree = check.integer(name, item, lower=lower, remedy="2 is a good start")
    if degree > upper:
        check.fail(f"{name} is {degree}; expected a whole number ≤ {upper}; 2 is a good start")
        return upper
    return degree


class Basis(Value):
    """Base of the functions on triangles."""

    def specification(self) -> dict[str, Any]:
        """Return "basis" and "degree" as the engine takes them."""
        raise NotImplementedError


@value
class Linear(Basis):
    """Linear functions, one for each vertex: P1.

    Their slopes jump from triangle to triangle, so a particle that changes its triangle causes a
    force that is not there (grid crossing). Source: de Koster (2018) 3.1.
    """

    label: ClassVar[str] = "grids.Linear"

    def specification(self) -> dict[str, Any]:
        """Return "basis" and "degree" as the engine takes them."""
        return {"basis": "linear", "degree": 1}


@value
class Lagrange(Basis):
    """Lagrange polynomials on the lattice of each triangle, continuous only.

    {fields}

    From degree 2 on the functions are negative in places, so their mass cannot be lumped. Meant for
    comparisons. Raises `SceneError`. Source: de Koster (2018) eq. 3.11.
    """

    label: ClassVar[str] = "grids.Lagrange"

    degree: int = given(
        "polynomial degree p; (p + 1)(p + 2)/2 functions on a triangle", default=2, low=1, high=5
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"degree": degree_of(check, "degree", self.degree, 1)}

    def specification(self) -> dict[str, Any]:
        """Return "basis" and "degree" as the engine takes them."""
        return {"basis": "lagrange", "degree": self.degree}


@value
class PowellSabin(Basis):
    """Quadratic Powell-Sabin splines, three for each vertex: smooth, non-negative, of sum 1.

    Each triangle is cut into six by an inner point and a point on every side, where the line
    between the inner points of neighbours crosses it (the middle of an outer edge).

    {fields}

    Incentres always do. Other points must lie inside their triangles, and the line between those of
    neighbours must cross the common side; `TriangularGrid` checks it. Raises `SceneError`.
    Source: de Koster (2018) 3.5.
    """

    label: ClassVar[str] = "grids.PowellSabin"

    split: Literal["incentre"] | Sequence[Sequence[float]] = given(
        'inner point of every triangle of the mesh, or "incentre"',
        default="incentre",
        unit="m",
        shape="(m, 2)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        if isinstance(self.split, str):
            if self.split != "incentre":
                check.fail(
                    f'split is {shown(self.split)}; expected "incentre" or one point (x, y) '
                    "in m for "
                    "each triangle"
                )
            return {}
        points = sequence(self.split)
        if not points:
            check.fail(
                f'split is {shown(self.split, 80)}; expected "incentre" or points (m, 2) in m'
            )
            return {}
        found = [
            check.vector(f"split[{t}]", p, lengths=(2,), unit="m") for t, p in enumerate(points)
        ]
        return {"split": tuple(found)}

    def specification(self) -> dict[str, Any]:
        """Return "basis" and "degree" as the engine takes them."""
        return {"basis": "powell-sabin", "degree": 2}


@value
class CubicPowellSabin(Basis):
    """Cubic Powell-Sabin splines on the same split, at the incentres: smooth and non-negative.

    Three functions for each vertex, six for each triangle and two for each outer edge.
    Source: de Koster (2018) A.3.
    """

    label: ClassVar[str] = "grids.CubicPowellSabin"

    def specification(self) -> dict[str, Any]:
        """Return "basis" and "degree" as the engine takes them."""
        return {"basis": "cubic-powell-sabin", "degree": 3}


class Mass(Value):
    """Base of the ways to solve M a = F."""

    def specification(self) -> dict[str, Any]:
        """Return the entry "mass" as the engine takes it."""
        raise NotImplementedError


def _mass(kind: str, source: ConsistentMass | None = None) -> dict[str, Any]:
    source = source or ConsistentMass()
    return {
        "kind": kind,
        "solver": source.solver,
        "tolerance": source.tolerance,
        "iterations": source.iterations,
        "deactivate_below": source.deactivate_below,
    }


@value
class ConsistentMass(Mass):
    """The full mass matrix M_ij = Σ_p m_p φ_i φ_j, solved exactly or to a tolerance.

    {fields}

    Solvers: "direct" factorises M; "cg" is the method of conjugate gradients; "richardson" repeats
    a += M̃⁻¹ (F - M a) with the lumped M̃, which converges slowly. `tolerance` and `iterations`
    concern the last two. `deactivate_below` keeps a nearly empty element from making M singular;
    mass and momentum are then no longer conserved, and displacements err. Raises `SceneError`.
    Source: de Koster (2018) eq. 2.27, and 5.2 for `deactivate_below`.
    """

    label: ClassVar[str] = "grids.ConsistentMass"

    solver: Literal["direct", "cg", "richardson"] = given("how M a = F is solved", default="direct")
    tolerance: float = given(
        "residual at which the iteration ends, parts of F",
        default=1e-10,
        unit="1",
        above=0,
        below=1,
        remedy="1e-10 is a good start",
    )
    iterations: int = given("most of them", default=200, low=1, whole=True)
    deactivate_below: float = given(
        "a function with M_ii below it is left out; 0: none",
        default=0.0,
        unit="kg/m",
        low=0,
        remedy="0 keeps every function",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        tolerance = check.given("tolerance", self)
        below = check.given("deactivate_below", self)
        return {
            "solver": check.choice("solver", self.solver, ("direct", "cg", "richardson")),
            "tolerance": tolerance,
            "iterations": check.given("iterations", self),
            "deactivate_below": below,
        }

    def specification(self) -> dict[str, Any]:
        """Return the entry "mass" as the engine takes it."""
        return _mass("consistent", self)


@value
class LumpedMass(Mass):
    """The diagonal matrix M̃_ii = Σ_p m_p φ_i: stable with empty elements, but less accurate.

    Velocities of Powell-Sabin splines then err by 14 to 30 percent in the bar and the column of the
    documentation, and refinement does not help.
    Needs functions that are nowhere negative. Source: de Koster (2018) A.2 and 5.3.
    """

    label: ClassVar[str] = "grids.LumpedMass"

    def specification(self) -> dict[str, Any]:
        """Return the entry "mass" as the engine takes it."""
        return _mass("lumped")


@value
class PartialMass(Mass):
    """Lumped for the functions between filled and empty elements, consistent for all others.

    {fields}

    The grid should reach at least one layer of elements beyond a free surface. Needs functions that
    are nowhere negative. Raises `SceneError`. Source: de Koster (2018) 5.4.
    """

    label: ClassVar[str] = "grids.PartialMass"

    form: Literal["symmetric", "rows"] = given(
        '"symmetric" moves every M_ij with i or j among them to both diagonals and '
        'conserves momentum; "rows" adds up their rows only, as published, and does not '
        "conserve it",
        default="symmetric",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"form": check.choice("form", self.form, ("symmetric", "rows"))}

    def specification(self) -> dict[str, Any]:
        """Return the entry "mass" as the engine takes it."""
        return _mass(f"partial-{self.form}")
