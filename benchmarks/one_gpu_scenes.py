"""Scenes of `one_gpu.py`: domains, materials with the wave speed of the water, sparse particles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from libmpm._src.cli.bench import DENSITY, GRAVITY, SOUND
from libmpm._src.run import backends
from libmpm._src.run.engine_spec import lower
from libmpm._src.run.plan import Plan

POISSON = 0.3


def solid(density: float = DENSITY) -> libmpm.materials.FixedCorotated:
    """Return a solid with the wave speed of the water: strains of a few hundredths."""
    modulus = (1 + POISSON) * (1 - 2 * POISSON) / (1 - POISSON) * density * SOUND**2
    return libmpm.materials.FixedCorotated(
        density=density, youngs_modulus=modulus, poissons_ratio=POISSON
    )


def solids() -> list[Any]:
    """Return every solid with the wave speed of the water; the metal flows as it lands."""
    moduli = {k: getattr(solid(), k) for k in ("density", "youngs_modulus", "poissons_ratio")}
    kinds = libmpm.materials
    return [
        kinds.FixedCorotated(**moduli),
        kinds.NeoHookean(**moduli),
        kinds.StVenantKirchhoffHencky(**moduli),
        kinds.LinearElastic(**moduli),
        kinds.VonMises(**moduli, yield_stress=1e-3 * moduli["youngs_modulus"]),
    ]


def sand() -> libmpm.materials.DruckerPrager:
    """Return sand with the wave speed of the water."""
    one = solid()
    return libmpm.materials.DruckerPrager(
        density=one.density, youngs_modulus=one.youngs_modulus, poissons_ratio=one.poissons_ratio
    )


def domain(
    name: str, dx: float, cells: Sequence[int], method: libmpm.Method | None = None
) -> libmpm.Scene:
    """Return a scene of so many cells with gravity, slip walls and nothing in it."""
    scene = libmpm.Scene(
        dimension=3, cell_size=dx, lower=(0, 0, 0), upper=[n * dx for n in cells],
        gravity=(0, 0, -GRAVITY), name=name, method=method,
    )  # fmt: skip
    slip = libmpm.boundaries.Slip()
    scene.add_boundary(name="walls", shape=libmpm.shapes.DomainWalls(), response=slip)
    return scene


def add(
    scene: libmpm.Scene, name: str, material: Any, low: Sequence[int], size: Sequence[int],
    **more: Any,
) -> None:  # fmt: skip
    """Add a box with its lower corner and its size in cells, 8 particles per cell."""
    dx = scene.cell_size
    upper = [(a + b) * dx for a, b in zip(low, size, strict=True)]
    box = libmpm.shapes.Box(lower=[a * dx for a in low], upper=upper)
    scene.add_body(name=name, shape=box, material=material, particles_per_cell=8, **more)


def place(simulation: libmpm.Simulation, places: NDArray[np.float64]) -> None:
    """Construct the engine with the particles of the only body at `places` in m, (n, 3).

    No lattice is as sparse, so this goes through the seam that design/engine-contract.md describes.
    The body's box bounds the particles and gives their mass.
    """
    backend, scene = simulation._assembly.backend, simulation.scene
    options = simulation._assembly.requested | {"device_index": backend.index}
    spec = lower(scene, with_particles=False, **options)
    spec["bodies"][0] |= {"count": len(places), "position": places}
    plan = Plan(
        backends.core().plan(spec, backend.kind), scene=scene, device=simulation.device,
        precision=simulation.precision,
    )  # fmt: skip
    engine = backend.module.Engine(spec)
    simulation._assembly.use(engine, spec, plan)
