"""Shape of the USGS debris-flow flume: slope, arc, pad, release, in coordinates along its bed."""

from __future__ import annotations

import math

from libmpm._src.flumes.facility import Pairs

__all__ = [
    "ALONG", "END", "FOOT", "PRISM", "RADIUS", "SLOPE", "TURN", "UP", "along_bed", "bed_line",
    "place",
]  # fmt: skip

SLOPE, PAD = math.radians(31.0), math.radians(2.4)
#: Where the bed begins to curve, m, and the radius of the arc, m (drawing of hdro-0008).
FOOT, RADIUS = 74.0, 20.0
TURN = SLOPE - PAD
#: Where the pad ends in a scene, m: beyond where single grains come to rest, 134 m.
END = 150.0
#: Release: corners of the prism (x, z), m: bed, gate, top (drawing of hdro-0008).
PRISM: Pairs = ((-4.7, 0.0), (0.0, 0.0), (-0.979, 1.629), (-4.181, 0.831))
#: Vertical and downstream directions (x, z) in the flume's coordinates.
UP = (-math.sin(SLOPE), math.cos(SLOPE))
ALONG = (math.cos(SLOPE), math.sin(SLOPE))


def place(s: float) -> tuple[float, float]:
    """Return (x, z) of a place s m along the bed, m."""
    angle = min(max((s - FOOT) / RADIUS, 0.0), TURN)
    x, z = RADIUS * math.sin(angle), RADIUS * (1.0 - math.cos(angle))
    rest = max(s - FOOT - RADIUS * TURN, 0.0)
    return (
        min(s, FOOT) + x + rest * math.cos(TURN),
        z + rest * math.sin(TURN),
    )


def along_bed(x: float) -> float:
    """Return how far along the bed a place x is, m: the inverse of `place`."""
    end = FOOT + RADIUS * math.sin(TURN)
    if x <= FOOT:
        return x
    if x <= end:
        return FOOT + RADIUS * math.asin((x - FOOT) / RADIUS)
    return FOOT + RADIUS * TURN + (x - end) / math.cos(TURN)


def bed_line(first: float, last: float) -> Pairs:
    """Return the bed between two places along it, its arc in pieces of a degree, (x, z), m."""
    arc = [FOOT + RADIUS * TURN * k / 28 for k in range(29)]
    return tuple(place(s) for s in (first, *[s for s in arc if first < s < last], last))
