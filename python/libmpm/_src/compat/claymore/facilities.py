"""Flumes that ClaymoreUW knows by name, in its coordinates: x along the flow, y up.

Source: Bonus (2023) chapters 7 to 9; beds as the public program has them, on a grid of 2.5 cm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import accumulate

__all__ = ["BEDS", "GATE", "HARBOR", "PUBLISHED_ENDS", "Bed", "Gate"]

Pairs = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Bed:
    """A bed: (x, y) in m, the layer in which its hold decays, and where water begins.

    `water_shift` is x of the bed's first point less the offset of the water body in which the
    program fills the facility.
    """

    name: str
    profile: Pairs
    layer: str
    water_shift: float


def _lwf() -> Pairs:
    """Return the Large Wave Flume: x = 2.0 is the neutral place of the wave-maker."""
    lengths = (14.275, 3.65, 10.975, 14.625, 36.575, 7.35)
    heights = (0.225, 0.225, 0.225, 1.15, 1.75, 1.75, 2.35)
    places = accumulate(lengths, initial=2.0)
    return tuple(zip((round(x, 6) for x in places), heights, strict=True))


BEDS: Mapping[str, Bed] = {
    "lwf": Bed("OSU Large Wave Flume", _lwf(), "linear", 0.1),
    "twb": Bed(
        "OSU Directional Wave Basin",
        ((0.0, 0.0), (11.3, 0.0), (31.3, 1.0), (41.3, 1.0), (41.3, 0.0), (50.0, 0.0)),
        "quadratic",
        0.0,
    ),
    "usgs": Bed(
        "USGS debris-flow flume, in coordinates along its slope",
        ((0.0, 0.0), (80.0, 0.0), (81.0, 0.176), (82.0, 0.54), (100.0, 10.926)),
        "quadratic",
        0.0,
    ),
}

#: x between which the USGS flume has its bumpy tiles, m, and the friction outside of them.
PUBLISHED_ENDS = (6.0, 79.0, 2.0)

#: x and y of the edge of the quay in the Waseda basin, m.
HARBOR = (4.45, 0.255)


@dataclass(frozen=True)
class Gate:
    """The two doors of the USGS flume: they lean upstream and part from the middle.

    `foot` is x at y = 0, m; `lean` (x, y) of the doors' upward direction, `width` of each door, m;
    they begin to move at `opens` and are gone at `gone`, s.
    """

    foot: float = 4.7
    lean: tuple[float, float] = (-0.5, 0.8660254037844386)
    width: float = 1.0
    middle: float = 4.0
    opens: float = 1.0
    gone: float = 2.0


GATE = Gate()
