"""`Columns`, `Jitter`, `PoissonDisk`: how particles are placed where not on the plain lattice."""

from __future__ import annotations

from typing import Any, ClassVar

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, value

__all__ = ["Columns", "Jitter", "PoissonDisk", "Sampling"]


class Sampling(Value):
    """Base of the ways to place particles."""


@value
class Columns(Sampling):
    """Columns of points, each divided evenly between the surfaces that its line crosses.

    {fields}

    Lines stand as far apart as the points of the lattice. A length l of one inside the solid takes
    n = round(l / spacing) points at (k + 1/2) l / n from its lower end, and none where it is
    shorter than half a spacing. Water above a bed that is not level then begins and ends as bed
    and level do; a lattice ends in stairs there, whose unequal weights set it going
    (`design/walls.md` section 6). Gaps thinner than a quarter of the spacing may be filled.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Columns"

    axis: str | None = given(
        'along which the columns stand, "x", "y" or "z"; None = that of gravity',
        default=None,
        range="a name",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        if self.axis is not None:
            check.choice("axis", self.axis, AXES)
        return {}


@value
class Jitter(Sampling):
    """A lattice whose points are moved at random, each within its own slice.

    {fields}

    The move follows from the seed and the number of the lattice point alone. Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Jitter"

    share: float = given(
        "of the spacing: a point moves by up to half of it either way on every axis, evenly "
        "distributed",
        unit="1",
        above=0,
        high=1,
    )
    seed: int = given("of the random numbers", unit="1", range="0 .. 2^63-1")

    def _check(self, check: Checker) -> dict[str, Any]:
        share = check.given("share", self)
        return {"share": share, "seed": _seed(check, self.seed)}


@value
class PoissonDisk(Sampling):
    """Points at random, none too close to another: Poisson-disk sampling (Bridson 2007).

    {fields}

    On average `particles_per_cell`, no two closer than about 0.8 of the spacing of the lattice with
    as many. One periodic tile of about a thousand points, made by SciPy, is repeated.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.PoissonDisk"

    seed: int = given("of the random numbers", unit="1", range="0 .. 2^63-1")

    def _check(self, check: Checker) -> dict[str, Any]:
        return {"seed": _seed(check, self.seed)}


def _seed(check: Checker, given: Any) -> int:
    seed = check.integer("seed", given)
    if seed >= 2**63:
        check.fail(f"seed is {seed}; expected below 2^63")
        return 0
    return seed
