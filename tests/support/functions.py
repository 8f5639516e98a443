"""Grids of functions for tests, and a field to project onto them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import grids

UNIT: dict[str, Any] = {"lower": (0.0, 0.0), "upper": (1.0, 1.0)}
BASES: list[Any] = [
    grids.Linear(),
    grids.Lagrange(degree=3),
    grids.PowellSabin(),
    grids.CubicPowellSabin(),
]


def sines(x: Any, y: Any) -> Any:
    return np.sin(np.pi * x) * np.sin(np.pi * y)


def squares(n: int, basis: Any, diagonal: Any = "same") -> grids.TriangularGrid:
    """Return a grid with n by n vertices on the unit square."""
    mesh = grids.Mesh.squares(columns=n - 1, rows=n - 1, **UNIT, diagonal=diagonal)
    return grids.TriangularGrid(mesh=mesh, basis=basis, mass=grids.ConsistentMass())


def scattered(seed: int, lower: tuple[float, float] = (0.0, 0.0)) -> grids.Mesh:
    """Return a triangulation of the unit square at `lower` with random vertices inside."""
    random = np.random.default_rng(seed)
    side = np.linspace(0.0, 1.0, 5)
    points = [(a, b) for a in side for b in side if {a, b} & {0.0, 1.0}]
    while len(points) < 36:
        new = 0.08 + 0.84 * random.random(2)
        if min(math.hypot(*(new - p)) for p in points) > 0.09:
            points.append((float(new[0]), float(new[1])))
    return grids.Mesh.delaunay(np.array(points) + lower)


def functions_on(basis: Any, seed: int = 1, **changes: Any) -> grids.Functions:
    mesh = scattered(seed, **changes)
    mass = grids.ConsistentMass()
    return grids.Functions(grids.TriangularGrid(mesh=mesh, basis=basis, mass=mass))


def splines(spans: int, degree: Any = 2) -> grids.Functions:
    return grids.Functions(grids.SplineGrid(**UNIT, spans=(spans, spans), degree=degree))


def refused(call: Callable[[], Any]) -> str:
    with pytest.raises(libmpm.SceneError) as caught:
        call()
    assert len(caught.value.problems) == 1
    return caught.value.problems[0]


ALL = [pytest.param(lambda b=b: functions_on(b), id=type(b).__name__) for b in BASES]
ALL.append(pytest.param(lambda: splines(4), id="splines"))
