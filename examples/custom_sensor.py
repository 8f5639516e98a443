"""A custom sensor: a function that reads the simulation at every sample.

    python examples/custom_sensor.py

The front of a dam break, against the experiments of Martin and Moyce (1952): 1.16 √(2 g a) between
one and a half and three widths a from the dam. Some seconds.
"""

import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes

A, G = 0.2, 9.81


def front(sim: libmpm.Simulation) -> tuple[float, float]:
    """Return the furthest place of the water, m, and its height at the dam's wall, m."""
    position = sim.particles["water"]["position"]
    return position[:, 0].max(), position[position[:, 0] < 0.02, 1].max()


scene = libmpm.Scene(
    dimension=2, cell_size=0.0125, lower=(0, 0), upper=(1.2, 0.4), gravity=(0, -G), name="front"
)
scene.add_body(
    name="water",
    shape=shapes.Box(lower=(0, 0), upper=(A, A)),
    material=materials.TaitFluid(density=1000, bulk_modulus=4e5),
    hydrostatic=A,
)
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
sensor = sensors.Custom(
    function=front, columns=("front", "height"), units=("m", "m"), interval=0.005
)
scene.add_sensor(name="front", sensor=sensor)

if __name__ == "__main__":
    sim = libmpm.Simulation(scene)
    sim.run(until=0.4)
    series = sim.sensors["front"]
    moving = (series["front"] > 2.5 * A) & (series["front"] < 4 * A)
    slope = np.polyfit(series.time[moving], series["front"][moving], 1)[0]
    print(f"speed of the front {slope / np.sqrt(2 * G * A):.2f} √(2 g a), measured 1.16")
    series.plot().savefig("custom_sensor.png", dpi=150)
