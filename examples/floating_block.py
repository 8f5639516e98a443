"""A block of timber afloat stays where Archimedes says.

    python examples/floating_block.py

In two dimensions the model is plane strain. Some seconds.
"""

import libmpm
from libmpm import boundaries, materials, sensors, shapes

DENSITY, HEIGHT, LEVEL = 600.0, 0.2, 0.4  # kg/m³, m, m

# Puts the block at its draught, DENSITY / 1000 of its height, and says whether it would turn over.
floats = shapes.afloat(
    shape=shapes.Box(lower=(0.3, 0.3), upper=(0.7, 0.3 + HEIGHT)),
    density=DENSITY,
    level=LEVEL,
)
scene = libmpm.Scene(
    dimension=2, cell_size=0.02, lower=(0, 0), upper=(1, 0.8), gravity=(0, -9.81), name="block"
)
scene.add_body(
    name="water",
    shape=shapes.Box(lower=(0, 0), upper=(1, LEVEL)),
    material=materials.TaitFluid(density=1000, bulk_modulus=1e6),
    hydrostatic=LEVEL,
)
scene.add_body(
    name="block",
    shape=floats.shape,
    subtract_from=("water",),
    # Stiff enough to keep its shape; timber's own modulus would only cost steps.
    material=materials.FixedCorotated(density=DENSITY, youngs_modulus=4e5, poissons_ratio=0.3),
)
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
scene.add_sensor(name="block", sensor=sensors.BodyTracker(body="block", interval=0.01))

if __name__ == "__main__":
    sim = libmpm.Simulation(scene)
    sim.run(until=3.0)
    block = sim.sensors["block"]
    height = block["centroid_y"][block.time > 2.0].mean()
    archimedes = LEVEL - DENSITY / 1000 * HEIGHT + HEIGHT / 2
    print(f"centre of the block at {height:.4f} m, Archimedes {archimedes:.4f} m")
    block.plot("centroid_y").savefig("floating_block.png", dpi=150)
