"""Small scenes on grids of functions."""

from __future__ import annotations

import numpy as np

import libmpm
from libmpm import grids, materials, shapes
from support import triangular as t

ELASTIC = materials.Hypoelastic(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3)


def square(basis=None, mass=None, gravity=(0.0, 0.0), method=None, n=2, lower=(0.0, 0.0), size=1.0):
    mesh = grids.Mesh.blocks(
        columns=n, rows=n, lower=lower, upper=(lower[0] + size, lower[1] + size)
    )
    grid = grids.TriangularGrid(
        mesh=mesh, basis=basis or grids.PowellSabin(), mass=mass or grids.ConsistentMass()
    )
    return libmpm.Scene(grid=grid, gravity=gravity, method=method)


def block(scene, name="block", low=0.0, high=1.0, **options):
    corner = np.asarray(scene.lower)
    options.setdefault("shape", shapes.Box(lower=corner + low, upper=corner + high))
    options.setdefault("material", ELASTIC)
    scene.add_body(name=name, **options)
    return scene


def column(**options):
    grid = t.blocks(1, 4, 0.1, 1.0, grids.PowellSabin())
    return t.column(t.LARGE_COLUMN, grid, (4, 24), **options)
