"""Ordered debris: rows, columns and layers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from libmpm._src.base.values import Checker, keywords_only, sequence, shown
from libmpm._src.studies.debris.field import DebrisField, Placement
from libmpm._src.studies.debris.laws import Stream, counts_of
from libmpm._src.studies.debris.prototype import MOST_PIECES, Piece, Prototype, check_prototypes
from libmpm._src.studies.debris.rectangles import rounded

__all__ = ["ordered"]

_LABEL = "debris.ordered"


@keywords_only("debris.ordered", 1, method=False)
def ordered(
    prototypes: Prototype | Sequence[Prototype],
    *,
    rows: int,
    columns: int,
    layers: int = 1,
    clearance: float | Sequence[float],
    orientation: int = 0,
    rotation: float = 0.0,
    centre: Sequence[float] = (0.0, 0.0),
    shares: Sequence[float] | None = None,
    seed: int | None = None,
) -> DebrisField:
    """Return an array of debris.

    ===========  =======  ======  ==============================================================
    parameter    unit     range   meaning
    ===========  =======  ======  ==============================================================
    prototypes   -        -       one, or several that take turns, column by column
    rows         1        ≥ 1     one behind another along the flow, x
    columns      1        ≥ 1     side by side across the flow, y
    layers       1        ≥ 1     on top of each other
    clearance    m        ≥ 0     gap between neighbours: one number, or (along, across, up)
    orientation  degrees  0, 90   long edges along (0) or across (90) the flow
    rotation     degrees  -       of the whole about its centre
    centre       m        (2,)    middle of the array in the plan
    shares       1        ≥ 0     parts of the prototypes, in place of turns, with a `seed`
    seed         1        ≥ 0     of the places at which each prototype lies; shares are met
                                  to the piece
    ===========  =======  ======  ==============================================================

    The footprint is the frame around the array. Prototypes of unlike size lie in the middle of
    places as large as the largest. Raises `SceneError`. Source: Bonus (2023) 7.3.5, 10.3.
    """
    kinds = check_prototypes(_LABEL, prototypes)
    check = Checker(_LABEL)
    numbers = [
        check.integer(name, n, lower=1)
        for name, n in (("rows", rows), ("columns", columns), ("layers", layers))
    ]
    if not check.problems and math.prod(numbers) > MOST_PIECES:
        check.fail(
            f"rows, columns and layers are {numbers[0]}, {numbers[1]} and {numbers[2]}; expected "
            f"{MOST_PIECES} pieces at most"
        )
        check.finish()
    given = sequence(clearance)
    if given is None:
        free = [check.number("clearance", clearance, lower=0, unit="m")] * 3
    else:
        free = [check.number(f"clearance[{i}]", x, lower=0, unit="m") for i, x in enumerate(given)]
    if len(free) != 3:
        check.fail(
            f"clearance is {shown(clearance)}; expected a number or (along, across, up) in m"
        )
    if orientation not in (0, 90):
        check.fail(
            f"orientation is {shown(orientation)}; expected 0, long edges along the flow, or 90; "
            "use rotation to turn the whole"
        )
    middle = check.vector("centre", centre, lengths=(2,), unit="m")
    rotation = check.number("rotation", rotation, unit="degrees")
    if seed is not None:
        seed = check.integer("seed", seed)
    if shares is not None and seed is None:
        check.fail("shares are given without a seed; expected one, which places the pieces")
    check.finish()
    along = max(k.width if orientation else k.length for k in kinds)
    across = max(k.length if orientation else k.width for k in kinds)
    pitch = [edge + gap for edge, gap in zip((along, across), free, strict=False)]
    storey = max(k.height for k in kinds) + free[2]
    frame = rounded([n * p - gap for n, p, gap in zip(numbers, pitch, free, strict=False)])
    count = numbers[0] * numbers[1] * numbers[2]
    if seed is None:
        chosen = [i % len(kinds) for i in range(count)]
    else:
        parts = counts_of(_LABEL, shares, len(kinds), count)
        chosen = Stream(seed).shuffle([k for k, n in enumerate(parts) for _ in range(n)])
    corner = rounded([m - 0.5 * edge for m, edge in zip(middle, frame, strict=True)])
    first = corner + 0.5 * rounded([along, across])
    pieces = []
    places = itertools.product(range(numbers[2]), range(numbers[0]), range(numbers[1]))
    for kind, (layer, row, column) in zip(chosen, places, strict=True):
        x, y, up = rounded(
            [first[0] + row * pitch[0], first[1] + column * pitch[1], layer * storey]
        ).tolist()
        pieces.append(Piece(prototype=kind, x=x, y=y, angle=float(orientation), elevation=up))
    field = DebrisField(
        prototypes=kinds,
        pieces=pieces,
        corner=corner.tolist(),
        footprint=frame.tolist(),
        clearance=min(free[:2]),
        placement=Placement(kind="ordered", seed=seed),
    )
    return field.turned(rotation) if rotation else field
