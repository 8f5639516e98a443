"""Local maxima of samples, placed between the samples by a parabola."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need

__all__ = ["Peak", "local_maxima"]

Floats = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

#: A parabola may rise above its sample by this many times what the smallest curvature around the
#: peak allows. More would be the corner of a front, which the curve does not rise above.
_SMOOTH = 2.0


class Peak(NamedTuple):
    """A local maximum."""

    time: float
    """Its time, s; NaN where there is none."""
    value: float
    """Its value, in the unit of the signal; 0 where there is none."""


def local_maxima(
    label: str, place: Floats, width: Floats, value: Floats, height: float, prominence: float
) -> list[Peak]:
    """Return the local maxima in the order of time.

    `place` (n,) s are the middles of the samples, `width` (n,) s the lengths of time that they are
    means over, 0 for values at one time. `height` and `prominence` are in the unit of `value`.
    What lies outside the record counts as lower than everything in it, so its ends can be maxima.
    """
    signal = need("scipy.signal", label, "studies")
    padded = np.concatenate([[-np.inf], value, [-np.inf]])
    _, found = signal.find_peaks(
        padded, height=height, prominence=prominence or None, plateau_size=1
    )
    left, right = found["left_edges"] - 1, found["right_edges"] - 1
    time, top = 0.5 * (place[left] + place[right]), value[left].copy()
    # Two equal samples may stand on both sides of a vertex; more are flat.
    round_ = np.flatnonzero((right - left < 2) & (left > 0) & (right < len(value) - 1))
    vertex, gain, part = _vertices(place, width, value, left[round_])
    time[round_] += np.sqrt(part) * (vertex - time[round_])
    top[round_] += part * gain
    return [Peak(t, v) for t, v in zip(time.tolist(), top.tolist(), strict=True)]


def _vertices(
    place: Floats, width: Floats, value: Floats, rows: Numbers
) -> tuple[Floats, Floats, Floats]:
    """Return the vertices of parabolas around samples: times, heights above the samples, shares.

    The share, 0 to 1, is the part of the height that the curvature beside the sample supports.
    """
    centre, slope, bend = _parabolas(place, width, value, rows)
    last = len(value) - 2
    beside = [_parabolas(place, width, value, np.clip(rows + k, 1, last))[2] for k in (-1, 1)]
    # Curvature of the same sign on both sides tells a rounded top from the corner of a front.
    least = np.minimum(np.minimum(-bend, -beside[0]), -beside[1]).clip(min=0.0)
    safe = np.where(bend < 0, bend, -1.0)
    gain = np.where(bend < 0, centre - slope**2 / (4 * safe) - value[rows], 0.0)
    gap = np.maximum(place[rows + 1] - place[rows], place[rows] - place[rows - 1])
    # A vertex is at most half a gap from the middle of the highest sample.
    allowed = _SMOOTH * least * (0.25 * gap**2 + width[rows] ** 2 / 12)
    part = np.divide(allowed, gain, out=np.zeros_like(gain), where=gain > 0).clip(max=1.0)
    return place[rows] - slope / (2 * safe), gain, part


def _parabolas(
    place: Floats, width: Floats, value: Floats, rows: Numbers
) -> tuple[Floats, Floats, Floats]:
    """Return a, b, c of a + b x + c x² through three samples, x from the middle of `rows`.

    A mean over a length w around x is a + b x + c (x² + w²/12).
    """
    three = rows[:, None] + np.array([-1, 0, 1])
    scale = place[rows + 1] - place[rows - 1]
    x = (place[three] - place[rows, None]) / scale[:, None]
    w = width[three] / scale[:, None]
    matrix = np.stack([np.ones_like(x), x, x**2 + w**2 / 12], axis=2)
    a, b, c = np.linalg.solve(matrix, value[three][..., None])[..., 0].T
    return a, b / scale, c / scale**2
