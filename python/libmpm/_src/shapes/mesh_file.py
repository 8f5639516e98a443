"""Reading surface meshes (STL, OBJ, PLY): triangles, welded, with what is wrong with them."""

from __future__ import annotations

import functools
import importlib
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from libmpm._src.errors import SceneError
from libmpm._src.shapes.solid import Array

__all__ = ["Surface", "read_surface"]

Numbers = npt.NDArray[np.int64]

#: Endings that trimesh reads, where it is installed: it takes more dialects of these than meshio,
#: which reads all others.
_SURFACES = (".stl", ".obj", ".ply", ".off")

#: Faces of the cells of finite elements, by meshio's names.
_FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1, 2),),
    "quad": ((0, 1, 2, 3),),
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "pyramid": ((0, 3, 2, 1), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": (
        (0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7),
    ),
}  # fmt: skip
_FLAT = ("triangle", "quad")
_PASSED_OVER = ("vertex", "line")


@dataclass(frozen=True)
class Surface:
    """Triangles of a file, with corners that are equal made one.

    corners     (k, 3)   in the file's unit
    faces       (m, 3)   rows of `corners`
    collapsed   int      triangles with two equal corners, left out
    open_edges  int      edges that an odd number of triangles have
    flipped     int      edges that an even number have, not half of them each way round
    parts       int      pieces that no edge joins
    """

    corners: Array
    faces: Numbers
    collapsed: int
    open_edges: int
    flipped: int
    parts: int

    @property
    def closed(self) -> bool:
        """Whether it encloses a volume with one orientation."""
        return not self.open_edges and not self.flipped

    @property
    def triangles(self) -> Array:
        """The corners of every triangle, (m, 3, 3)."""
        return np.asarray(self.corners[self.faces])

    def volume(self) -> float:
        """Return the enclosed volume of a closed surface, negative if it is inside out."""
        a, b, c = (self.corners[self.faces[:, i]] - self.corners[0] for i in range(3))
        return float(np.sum(a * np.cross(b, c)) / 6.0)


@functools.lru_cache(maxsize=8)
def read_surface(path: str, size: int, changed: int) -> Surface:
    """Return the surface in a file of this size and time of change; raises `SceneError`."""
    what = f"shapes.SurfaceMesh: file '{path}'"
    flat = Path(path).suffix.lower() in _SURFACES and find_spec("trimesh") is not None
    try:
        corners, faces = (
            _by_trimesh(importlib.import_module("trimesh"), path)
            if flat
            else _by_meshio(importlib.import_module("meshio"), path, what)
        )
    except SceneError:
        raise
    # Readers of many formats raise whatever they come upon, one of them SystemExit.
    except (Exception, SystemExit) as error:
        raise SceneError(f"{what} cannot be read as a mesh: {error}") from error
    if corners.ndim != 2 or corners.shape[1] != 3 or not len(faces):
        raise SceneError(
            f"{what} has {len(faces)} triangles and corners of shape {corners.shape}; expected a "
            "surface in 3D; in 2D use shapes.Extrusion"
        )
    if not np.isfinite(corners).all():
        raise SceneError(f"{what} has corners that are not finite; expected numbers; repair it")
    wrong = faces[(faces < 0) | (faces >= len(corners))]
    if len(wrong):
        raise SceneError(
            f"{what} has a triangle with corner {wrong[0]} of {len(corners)}; expected numbers of "
            "corners, from 0; repair the file"
        )
    return _welded(corners, faces)


def is_without_end(path: Path) -> bool:
    """Tell whether meshio would look for a line of this file's head without end."""
    ending = path.suffix.lower()
    if ending not in (".off", ".ply"):
        return False
    with path.open("rb") as file:
        next(file, b"")
        for line in file:
            text = line.strip()
            if ending == ".off" and text and not text.startswith(b"#"):
                return False
            if ending == ".ply" and text == b"end_header":
                return False
    return True


def _by_trimesh(trimesh: Any, path: str) -> tuple[Array, Numbers]:
    found = trimesh.load(path, force="mesh", process=False)
    return np.array(found.vertices, dtype=np.float64), np.array(found.faces, dtype=np.int64)


def _by_meshio(meshio: Any, path: str, what: str) -> tuple[Array, Numbers]:
    if is_without_end(Path(path)):
        raise SceneError(f"{what} is cut; expected a head, corners and triangles; write it again")
    found = meshio.read(path)
    blocks = [(b.type, np.asarray(b.data, dtype=np.int64)) for b in found.cells if len(b.data)]
    unknown = {kind for kind, _ in blocks if kind not in _FACES and kind not in _PASSED_OVER}
    if unknown:
        raise SceneError(
            f"{what} has cells of type {', '.join(sorted(unknown))}; expected {', '.join(_FACES)}; "
            "convert them to linear ones"
        )
    solid = [(kind, data) for kind, data in blocks if kind in _FACES and kind not in _FLAT]
    faces = _outside(solid) if solid else _split([d for kind, d in blocks if kind in _FLAT])
    return np.array(found.points, dtype=np.float64), faces


def _outside(blocks: list[tuple[str, Numbers]]) -> Numbers:
    """Return the faces that one cell alone has, as triangles."""
    kept = []
    for corners in (3, 4):
        faces = [data[:, face] for kind, data in blocks for face in _FACES[kind]
                 if len(face) == corners]  # fmt: skip
        if not faces:
            continue
        every = np.concatenate(faces)
        _, back, count = np.unique(
            np.sort(every, axis=1), axis=0, return_inverse=True, return_counts=True
        )
        kept.append(every[count[back.ravel()] == 1])
    return _split(kept)


def _split(faces: list[Numbers]) -> Numbers:
    """Return faces of three or four corners as triangles."""
    triangles = [np.zeros((0, 3), dtype=np.int64)]
    for face in faces:
        triangles.append(face[:, [0, 1, 2]])
        if face.shape[1] == 4:
            triangles.append(face[:, [0, 2, 3]])
    return np.concatenate(triangles)


def _welded(corners: Array, faces: Numbers) -> Surface:
    corners, back = np.unique(corners, axis=0, return_inverse=True)
    faces = back.ravel()[faces]
    whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    collapsed, faces = int(np.count_nonzero(~whole)), faces[whole]
    ahead = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    turned = np.where(ahead[:, 0] < ahead[:, 1], 1, -1)
    edges, row, count = np.unique(
        np.sort(ahead, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    balance = np.bincount(row.ravel(), turned, len(edges))
    odd = count % 2 == 1
    return Surface(
        corners,
        faces,
        collapsed,
        int(np.count_nonzero(odd)),
        int(np.count_nonzero(~odd & (balance != 0))),
        _parts(len(corners), edges),
    )


def _parts(n: int, edges: Numbers) -> int:
    """Return in how many pieces n corners are joined by edges; corners of no edge do not count."""
    label = np.arange(n)
    while True:
        low = np.minimum(label[edges[:, 0]], label[edges[:, 1]])
        found = label.copy()
        np.minimum.at(found, label[edges[:, 0]], low)
        np.minimum.at(found, label[edges[:, 1]], low)
        found = found[found]
        if np.array_equal(found, label):
            return len(np.unique(label[edges]))
        label = found
