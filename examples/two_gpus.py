"""One scene on several devices: two GPUs, or two ranks of this processor.

    python examples/two_gpus.py cuda:0 cuda:1
    python examples/two_gpus.py

The domain is cut between the devices and particles change over as they move; the results are those
of one device to the last bit, which the script checks. Some seconds.
"""

import sys

import numpy as np

import libmpm
from libmpm import boundaries, materials, shapes

scene = libmpm.Scene(cell_size=0.05, lower=(0, 0, 0), upper=(1.6, 0.8, 0.8), gravity=(0, 0, -9.81))
scene.add_body(
    name="water",
    shape=shapes.Box(lower=(0, 0, 0), upper=(0.6, 0.8, 0.6)),
    material=materials.TaitFluid(density=1000, bulk_modulus=1e6),
    hydrostatic=0.6,
)
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())


def positions(device: str | list[str]) -> np.ndarray:
    """Return where the particles are after half a second."""
    with libmpm.Simulation(scene, device=device) as sim:
        sim.run(until=0.5, progress=False)
        return sim.particles["water"]["position"]


if __name__ == "__main__":
    devices = sys.argv[1:] or ["cpu", "cpu"]
    same = np.array_equal(positions(devices[0]), positions(devices))
    print(
        f"{' and '.join(devices)}: {'the bits of' if same else 'other results than'} {devices[0]}"
    )
