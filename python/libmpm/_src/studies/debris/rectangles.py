"""Rectangles in the plan: corners, clear gaps, obliquities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from libmpm._src.shapes.oriented_boxes import cosine_sine

__all__ = ["Rectangles", "gaps", "obliquity", "rounded"]

Floats = npt.NDArray[np.float64]

#: Coordinates in m and angles in degrees are kept to this part, so that how a machine rounds a
#: cosine cannot show in a field.
_DIGITS = 1e9


def rounded(x: npt.ArrayLike) -> Floats:
    """Return numbers rounded to 1e-9."""
    return np.rint(np.asarray(x, dtype=np.float64) * _DIGITS) / _DIGITS


def obliquity(angle: npt.ArrayLike) -> Floats:
    """Return angles in degrees folded to [0, 90]: a rectangle looks alike at ±θ + 180° k."""
    folded = np.mod(np.asarray(angle, dtype=np.float64) + 90.0, 180.0) - 90.0
    return rounded(np.abs(folded))


@dataclass(frozen=True)
class Rectangles:
    """n rectangles: middles x, y (n,) m, angles (n,) degrees, lengths and widths (n,) m."""

    x: Floats
    y: Floats
    angle: Floats
    length: Floats
    width: Floats

    def __len__(self) -> int:
        """Return their number."""
        return len(self.x)

    def __getitem__(self, which: slice | npt.NDArray[np.bool_]) -> Rectangles:
        """Return some of them."""
        parts = (self.x, self.y, self.angle, self.length, self.width)
        return Rectangles(*(part[which] for part in parts))

    def corners(self) -> Floats:
        """Return their corners, counterclockwise, (n, 4, 2) m."""
        c, s = cosine_sine(self.angle)
        along = 0.5 * self.length[:, None] * np.array([1.0, -1.0, -1.0, 1.0])
        across = 0.5 * self.width[:, None] * np.array([1.0, 1.0, -1.0, -1.0])
        x = self.x[:, None] + along * c[:, None] - across * s[:, None]
        y = self.y[:, None] + along * s[:, None] + across * c[:, None]
        return np.stack([x, y], axis=2)


def _seen(corners: Floats, frames: Rectangles) -> tuple[Floats, Floats]:
    """Return corners (m, 4, 2) in the own frames of n rectangles, (m, n, 4) along and across."""
    c, s = (part[:, None] for part in cosine_sine(frames.angle))
    x = corners[:, None, :, 0] - frames.x[:, None]
    y = corners[:, None, :, 1] - frames.y[:, None]
    return x * c + y * s, y * c - x * s


def gaps(one: Rectangles, two: Rectangles) -> Floats:
    """Return the shortest distances between m and n rectangles, (m, n) m; 0 where they overlap.

    Two rectangles that are apart are nearest to each other at a corner of one of them.
    """
    nearest = np.full((len(one), len(two)), np.inf)
    apart = np.zeros((len(one), len(two)), dtype=bool)
    for first, second, turn in ((one, two, False), (two, one, True)):
        along, across = _seen(first.corners(), second)
        half = 0.5 * second.length[:, None], 0.5 * second.width[:, None]
        beyond = [
            np.maximum(np.abs(u) - h, 0.0) for u, h in zip((along, across), half, strict=True)
        ]
        distance = np.sqrt(beyond[0] ** 2 + beyond[1] ** 2).min(axis=2)
        # All corners beyond one face: its line separates the two.
        split = np.zeros(distance.shape, dtype=bool)
        for u, h in zip((along, across), half, strict=True):
            split |= (u >= h).all(axis=2) | (u <= -h).all(axis=2)
        nearest = np.minimum(nearest, distance.T if turn else distance)
        apart |= split.T if turn else split
    return np.where(apart, nearest, 0.0)
