"""`basin`: water above a bed."""

from __future__ import annotations

import numbers
from collections.abc import Sequence

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.axes import AXES
from libmpm._src.base.values import sequence, shown
from libmpm._src.errors import SceneError
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.combined import Difference
from libmpm._src.shapes.solid import Solid

__all__ = ["basin", "has_bed"]


@keywords_only("shapes.basin", method=False)
def basin(
    *, level: float, bed: Solid | Sequence[Solid], within: Box, axis: str | None = None
) -> Solid:
    """Return what fills a basin to a level above a bed of any shape: a box without the bed.

    =========  ====  ============  =============================================================
    parameter  unit  range         meaning
    =========  ====  ============  =============================================================
    level      m     in `within`   of the still surface, along `axis`
    bed        -     solids        what the water lies on or stands around, one or several
    within     m     a Box         horizontal ends of the water, and a bottom below all of it
    axis       -     a name        the vertical one, "x", "y" or "z"; None = the last one
    =========  ====  ============  =============================================================

    Everything below the level in the box and outside the bed is filled, closed hollows as well.
    Raises `SceneError`.
    """
    problems = []
    beds = [bed] if isinstance(bed, Solid) else sequence(bed) or []
    if not beds or not all(isinstance(one, Solid) for one in beds):
        problems.append(f"bed is {shown(bed, 80)}; expected a solid or several")
    if not isinstance(within, Box):
        raise SceneError(f"shapes.basin: within is {shown(within, 80)}; expected a shapes.Box")
    names = AXES[: within.dimension]
    known = isinstance(axis, str) and axis in names
    if axis is not None and not known:
        problems.append(f"axis is {shown(axis)}; expected one of {', '.join(names)}")
    up = names.index(str(axis)) if known else within.dimension - 1
    low, high = within.lower[up], within.upper[up]
    if isinstance(level, bool) or not (isinstance(level, numbers.Real) and abs(level) < 1e300):
        problems.append(f"level is {shown(level, 80)}; expected a number in m")
    elif not low < level <= high:
        problems.append(
            f"level is {level:g} m; expected above {low:g} and at most {high:g} m, the bottom "
            "and the top of within"
        )
    if problems:
        raise SceneError([f"shapes.basin: {problem}" for problem in problems])
    upper = list(within.upper)
    upper[up] = float(level)
    water: Solid = Box(lower=within.lower, upper=upper)
    for one in beds:
        water = water - one
    return water


def has_bed(shape: object) -> bool:
    """Return whether a shape is a box without something that is no box, as `basin` makes it."""
    uneven = False
    while isinstance(shape, Difference):
        uneven = uneven or not isinstance(shape.without, Box)
        shape = shape.whole
    return uneven and isinstance(shape, Box)
