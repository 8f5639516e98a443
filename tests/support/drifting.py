"""Soft bodies with random states that fly off unstrained: all that happens to them is smoothing."""

from pathlib import Path

import numpy as np

import libmpm
from libmpm import materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm.methods import smooth
from support import scenes

DX = 0.1
#: So soft that nothing but smoothing changes a state.
SOFT = {
    "volume": materials.TaitFluid(density=1000, bulk_modulus=1e-12, viscosity=0.0),
    "strain": materials.LinearElastic(density=1000, youngs_modulus=1e-12, poissons_ratio=0.2),
}


def drifting(
    folder: Path, dimension: int, kernel: str, smoothing, field="volume", threads=1, n=900,
    modified=False, modulus=None, device="cpu", precision="double", size=1e-3, **body,
):  # fmt: skip
    """An engine of soft material with a random state, which flies off unstrained."""
    random = np.random.default_rng(5)
    lower_corner = np.array([0.33, 0.21, 0.4])[:dimension]
    points = lower_corner + random.random((n, dimension)) * (1.3, 0.9, 0.5)[:dimension]
    file = folder / f"points{dimension}.npy"
    np.save(file, points)
    kind = libmpm.methods.Kernel(name=kernel, gradient="kernel", modified=modified)
    transfer = "PIC" if modulus is None else "FLIP"
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=(3.0, 2.0, 1.5)[:dimension],
        method=libmpm.Method(transfer=transfer, kernel=kind, time_step=0.01),
    )  # fmt: skip
    material = SOFT[field]
    if modulus is not None:
        material = materials.TaitFluid(density=1000, bulk_modulus=modulus, viscosity=0.0)
    scene.add_body(
        name="b", shape=shapes.PointFile(file=str(file), particle_volume=1e-4), material=material,
        velocity=(1.0, 0.7, -0.4)[:dimension], smoothing=smoothing, **body,
    )  # fmt: skip
    told = lower(scene, precision="double", threads=threads)
    told["precision"] = precision  # which the time step of such a material does not suit
    width = 1 if field == "volume" else dimension * (dimension + 1) // 2
    state = size * (random.random((n, width)) - 0.5)
    velocity = np.zeros((n, 0 if modulus is None else dimension))
    told["bodies"][0] |= {
        "state": np.hstack([state, velocity]),
        "state_width": width + velocity.shape[1],
        "ids": np.arange(n, dtype=np.uint32),
    }
    return scenes.engine(told, device), state


def by_id(engine, name):
    """An attribute of the particles in the order of their ids."""
    return engine.attribute(0, name)[np.argsort(engine.attribute(0, "id"))]


def state_of(engine):
    """What particles store."""
    return by_id(engine, "state")


def undecided(state, position, method, made, rounding=1e-13):
    """Where limiter A is at a tie, two cells with one mean, that the rounding of sums decides."""
    random = np.random.default_rng(1)
    found = np.zeros(state.shape, dtype=bool)
    for _ in range(20 if "A" in method else 0):
        noise = 1 + rounding * (random.random(state.shape) - 0.5)
        other = smooth(state * noise, 1, position, DX, method=method).q
        found |= abs(other - made) > 200 * rounding * abs(state).max()
    return found
