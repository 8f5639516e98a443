"""Places of pieces: the plan, heights, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from libmpm._src.base.values import Checker
from libmpm._src.shapes.oriented_boxes import TurnedBox, close_pairs, cosine_sine, depth, rotation
from libmpm._src.studies.debris.prototype import Piece, Prototype
from libmpm._src.studies.debris.rectangles import Rectangles, gaps

__all__ = ["above", "check_apart", "check_clear", "check_inside", "seen"]

#: Depth in m up to which pieces touch rather than overlap: positions are kept to 1e-9.
_TOUCH = 1e-8


def _solid(kind: Prototype, piece: Piece) -> TurnedBox:
    centre = (piece.x, piece.y, piece.elevation + 0.5 * kind.height)
    return TurnedBox(centre, (kind.length, kind.width, kind.height), rotation(3, piece.angle))


def seen(prototypes: Sequence[Prototype], pieces: Sequence[Piece]) -> Rectangles:
    """Return pieces as seen in the plan."""
    rows = [
        (p.x, p.y, p.angle, prototypes[p.prototype].length, prototypes[p.prototype].width)
        for p in pieces
    ]
    return Rectangles(*np.array(rows, dtype=np.float64).reshape(-1, 5).T)


def above(prototypes: Sequence[Prototype], pieces: Sequence[Piece]) -> npt.NDArray[np.float64]:
    """Return the vertical gap between every two pieces, (n, n) m; < 0 where they share heights."""
    low = np.array([p.elevation for p in pieces])
    high = low + [prototypes[p.prototype].height for p in pieces]
    return np.asarray(np.maximum(low[:, None] - high, low - high[:, None]))


def check_inside(
    check: Checker,
    rectangles: Rectangles,
    corner: Sequence[float],
    footprint: Sequence[float],
    turn: float,
) -> None:
    """Refuse pieces that reach out of the footprint turned about its middle by degrees."""
    half = 0.5 * np.array(footprint)
    c, s = cosine_sine(turn)
    x, y = np.moveaxis(rectangles.corners() - (np.array(corner) + half), 2, 0)
    own = np.abs(np.stack([x * c + y * s, y * c - x * s], axis=2)) - half
    beyond = own.max(axis=(1, 2))
    for i in np.flatnonzero(beyond > _TOUCH).tolist():
        check.fail(
            f"pieces[{i}] reaches {beyond[i]:.3g} m out of the footprint; expected all of it "
            "inside, or the porosity is wrong; move it, or give another corner or a larger "
            "footprint"
        )


def check_clear(
    check: Checker,
    rectangles: Rectangles,
    up: npt.NDArray[np.float64],
    clearance: float,
) -> None:
    """Refuse pieces side by side, with a vertical gap `up` < 0, nearer than the clearance."""
    gap = gaps(rectangles, rectangles)
    close = (gap < clearance - _TOUCH) & (up < -_TOUCH)
    for i, j in np.argwhere(np.triu(close, 1)).tolist():
        check.fail(
            f"pieces {i} and {j} are {gap[i, j]:.3g} m apart; expected ≥ {clearance:g} m, the "
            "clearance; move one of them, or give a smaller clearance"
        )


def check_apart(check: Checker, prototypes: Sequence[Prototype], pieces: Sequence[Piece]) -> None:
    """Refuse pieces that overlap."""
    solids = [_solid(prototypes[p.prototype], p) for p in pieces]
    for i, j in close_pairs([solid.bounds() for solid in solids]):
        deep = depth(solids[i], solids[j])
        if deep > _TOUCH:
            check.fail(
                f"pieces {i} and {j} overlap by {deep:.3g} m; expected apart; move one of them"
            )
