"""A column of dry sand collapses: the distance it runs out, and the heap that stays.

    python examples/sand_column.py

Plane strain, aspect ratio 1, the angle of loose sand. Experiments in a channel (Lube et al. 2005;
Lajeunesse et al. 2005) run out by about 1.2 times the initial height. About half a minute.
"""

import numpy as np

import libmpm
from libmpm import boundaries, materials, shapes

WIDTH = HEIGHT = 0.2  # m

scene = libmpm.Scene(
    dimension=2, cell_size=0.01, lower=(0, 0), upper=(1.0, 0.4), gravity=(0, -9.81), name="sand"
)
scene.add_body(
    name="sand",
    shape=shapes.Box(lower=(0, 0), upper=(WIDTH, HEIGHT)),
    material=materials.DruckerPrager(
        density=1600, youngs_modulus=1e6, poissons_ratio=0.3, friction_angle=34.7
    ),
)
bed = boundaries.Separable(static_friction=0.6, dynamic_friction=0.5)
slip = boundaries.Slip()
scene.add_boundary(name="bed", shape=shapes.DomainWalls(faces=("y-",)), response=bed)
scene.add_boundary(name="sides", shape=shapes.DomainWalls(faces=("x-", "x+")), response=slip)

if __name__ == "__main__":
    sim = libmpm.Simulation(scene)
    sim.run(until=1.0)
    position = sim.particles["sand"]["position"]
    toe = np.percentile(position[:, 0], 98)  # single grains roll further
    print(f"run-out {(toe - WIDTH) / HEIGHT:.2f} of the height")
    print(f"height left at the wall {position[position[:, 0] < 0.03, 1].max() / HEIGHT:.2f}")
    sim.plot("speed").savefig("sand_column.png", dpi=150)
