"""Debris of the flume and of the basin, and fields measured by other arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import shapely

import libmpm
from libmpm import debris, materials

__all__ = ["BAR", "BOXES", "HDPE", "WOOD", "distances", "polygon", "polygons", "refused"]

HDPE = materials.FixedCorotated(density=981.0, youngs_modulus=8e8, poissons_ratio=0.4)
WOOD = materials.FixedCorotated(density=648.0, youngs_modulus=2e9, poissons_ratio=0.2)
#: Debris of the large wave flume and of the directional wave basin.
BAR = debris.Prototype(length=0.5, width=0.1, height=0.05, material=HDPE, name="bar")
BOXES = tuple(
    debris.Prototype(length=0.102, width=0.102, height=0.051, material=m, name=n)
    for m, n in ((HDPE, "HDPE"), (WOOD, "wood"))
)


def refused(call: Callable[..., Any], *args: Any, **keywords: Any) -> list[str]:
    """The problems that a call reports."""
    with pytest.raises(libmpm.SceneError) as caught:
        call(*args, **keywords)
    return caught.value.problems


def polygon(x: float, y: float, angle: float, length: float, width: float) -> Any:
    """A rectangle as shapely turns it."""
    box = shapely.box(-length / 2, -width / 2, length / 2, width / 2)
    box = shapely.affinity.rotate(box, angle, origin=(0, 0))
    return shapely.affinity.translate(box, x, y)


def polygons(field: debris.DebrisField) -> list[Any]:
    """The pieces of a field in the plan."""
    kinds = [field.prototypes[p.prototype] for p in field.pieces]
    return [
        polygon(p.x, p.y, p.angle, k.length, k.width)
        for p, k in zip(field.pieces, kinds, strict=True)
    ]


def distances(field: debris.DebrisField) -> npt.NDArray[np.float64]:
    """The gaps between the pieces in the plan, infinite on the diagonal."""
    shapes = np.array(polygons(field))
    found = shapely.distance(shapes[:, None], shapes[None, :])
    np.fill_diagonal(found, np.inf)
    return np.asarray(found)
