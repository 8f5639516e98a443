"""Filling bodies with particles on a grid of triangles or splines."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.grids.grid import TriangularGrid
from libmpm._src.grids.mesh import Mesh
from libmpm._src.grids.particles import subdivide, voronoi_areas
from libmpm._src.grids.shapes import Cells, Points, Traction
from libmpm._src.shapes import lattices
from libmpm._src.shapes.boxes import Box

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["Placed", "chosen_triangles", "place", "traction_rows"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Placed:
    """Particles of a body: `position` (n, 2) m in the scene, `volume` (n,) m²; read-only."""

    position: Floats
    volume: Floats

    def __post_init__(self) -> None:
        """Keep what may be shared from being written to."""
        self.position.flags.writeable = self.volume.flags.writeable = False

    @property
    def count(self) -> int:
        """Number of particles."""
        return len(self.position)


def box_lattice(scene: SceneData, body: Body) -> lattices.Lattice:
    """Return the lattice of a body in a box, m in the scene."""
    assert isinstance(body.shape, Box)
    low, high = body.shape.lower, body.shape.upper
    return lattices.lattice(low, high, scene.cell_size, body.particles_per_cell, body.lattice)


def chosen_triangles(mesh: Mesh, within: Any) -> npt.NDArray[np.intp]:
    """Return the triangles of a mesh whose centres lie in a polygon; all for None."""
    corners = mesh.corners()
    if within is None:
        return np.arange(len(corners))
    from matplotlib.path import Path

    return np.flatnonzero(Path(np.asarray(within)).contains_points(corners.mean(axis=1)))


def place(scene: SceneData, body: Body) -> Placed:
    """Return the particles of a body, in the order of their ids."""
    if isinstance(body.shape, Box):
        grid = box_lattice(scene, body)
        rows = lattices.points(grid, [], scene.cell_size).rows(0, grid.count)
        return Placed(rows, np.full(grid.count, grid.volume / grid.count))
    assert isinstance(scene.grid, TriangularGrid)  # the scene's checks refuse others
    assert isinstance(body.shape, Cells | Points)
    return _fill(scene.grid.mesh, body.shape, body.particles_per_cell)


@functools.lru_cache(maxsize=16)
def _fill(mesh: Mesh, shape: Cells | Points, particles_per_cell: int) -> Placed:
    """Return particles that depend on the mesh; checks, plan and engine all ask for them."""
    triangles = chosen_triangles(mesh, shape.within)
    if isinstance(shape, Cells):
        corners = mesh.corners()[triangles]
        return Placed(*subdivide(corners, math.isqrt(particles_per_cell)))
    position = np.asarray(shape.position, dtype=np.float64)
    if shape.volume is not None:
        return Placed(position, np.asarray(shape.volume, dtype=np.float64))
    if shape.within is not None:
        vertices, every = mesh.arrays()
        used, renumbered = np.unique(every[triangles], return_inverse=True)
        mesh = Mesh(vertices=vertices[used], triangles=renumbered.reshape(-1, 3))
    return Placed(position, voronoi_areas(position, mesh))


def traction_rows(
    scene: SceneData, body: Body, traction: Traction
) -> tuple[npt.NDArray[Any], float]:
    """Return the particles along a face of a body's box, and the length that each stands for."""
    grid = box_lattice(scene, body)
    numbers = np.arange(grid.count).reshape(grid.shape)
    assert traction.face is not None  # the scene's checks refuse it
    axis, end = "xy".index(traction.face[0]), -1 if traction.face[1] == "+" else 0
    rows = np.take(numbers, end, axis=axis)
    along = 1 - axis
    return rows, (grid.upper[along] - grid.lower[along]) / grid.shape[along]
