"""Pieces of debris as tetrahedra, for finite elements."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, nearest
from libmpm._src.errors import SceneError
from libmpm._src.moved import renamed
from libmpm._src.output.atomic_files import writing
from libmpm._src.shapes.oriented_boxes import cosine_sine

if TYPE_CHECKING:
    from libmpm._src.studies.debris.field import DebrisField

#: Names of version 0.1.
__getattr__ = renamed(__name__, {"Tetrahedra": "DebrisMesh"})

__all__ = ["DebrisMesh", "mesh", "save_mesh"]


class DebrisMesh(NamedTuple):
    """Tetrahedra of all pieces; each piece has points of its own."""

    points: npt.NDArray[np.float64]
    """Their corners, (p, 3) m."""
    cells: npt.NDArray[np.int64]
    """Four points each, (t, 4), of positive volume."""
    piece: npt.NDArray[np.int64]
    """The piece that each belongs to, (t,)."""


def _bricks(counts: tuple[int, ...]) -> npt.NDArray[np.int64]:
    """Return six tetrahedra for each brick of a block, as numbers of its points, (t, 4).

    Each path along the edges from the first corner of a brick to the opposite one is a
    tetrahedron; so are those of the bricks beside it, and their faces match.
    """
    shape = tuple(n + 1 for n in counts)
    places = np.indices(counts).reshape(3, -1)
    first = np.asarray(np.ravel_multi_index(tuple(places), shape))
    steps = [math.prod(shape[a + 1 :]) for a in range(3)]
    found = []
    for path in itertools.permutations(range(3)):
        corners = np.cumsum([0, *(steps[a] for a in path)])
        even = (path[1] - path[0]) % 3 == 1
        if not even:
            corners = corners[[0, 1, 3, 2]]
        found.append(first[:, None] + corners)
    return np.concatenate(found)


def mesh(field: DebrisField, *, edge: float | None, elevation: float) -> DebrisMesh:
    """Return the pieces as tetrahedra; see `DebrisField.mesh`."""
    check = Checker(f"{field.label}.mesh")
    if edge is not None:
        edge = check.number("edge", edge, lower=0, lower_open=True, unit="m")
    elevation = check.number("elevation", elevation, unit="m")
    if not field.pieces:
        check.fail("there are no pieces; expected some to cut")
    check.finish()
    points, cells, piece = [], [], []
    known = 0
    for i, one in enumerate(field.pieces):
        kind = field.prototypes[one.prototype]
        size = (kind.length, kind.width, kind.height)
        # The allowance keeps an edge that divides the size from adding a brick by rounding.
        counts = tuple(1 if edge is None else max(1, math.ceil(s / edge - 1e-9)) for s in size)
        along, across, up = np.meshgrid(
            *(np.linspace(-0.5 * s, 0.5 * s, n + 1) for s, n in zip(size, counts, strict=True)),
            indexing="ij",
        )
        c, s = cosine_sine(one.angle)
        place = [one.x + along * c - across * s, one.y + along * s + across * c]
        place.append(elevation + one.elevation + 0.5 * kind.height + up)
        points.append(np.stack(place, axis=3).reshape(-1, 3))
        bricks = _bricks(counts)
        cells.append(known + bricks)
        piece.append(np.full(len(bricks), i))
        known += len(points[-1])
    return DebrisMesh(np.concatenate(points), np.concatenate(cells), np.concatenate(piece))


def save_mesh(field: DebrisField, path: Path, *, edge: float | None, elevation: float) -> None:
    """Write the tetrahedra to a file; see `DebrisField.save_mesh`."""
    meshio = need("meshio", "debris.DebrisField.save_mesh", "studies")
    found = mesh(field, edge=edge, elevation=elevation)
    known = meshio.extension_to_filetypes
    if not any(path.name.lower().endswith(suffix) for suffix in known):
        raise SceneError(
            f"{field.label}.save_mesh: meshio knows no files of the kind '{path.suffix}' of "
            f"{path.name}; {nearest(path.suffix, known)}"
        )
    prototype = np.array([p.prototype for p in field.pieces])[found.piece]
    data = {"piece": [found.piece], "prototype": [prototype]}
    with writing(path):
        meshio.Mesh(found.points, [("tetra", found.cells)], cell_data=data).write(path)
