"""A piston makes a long wave in a flume; gauges follow it.

    python examples/wave_flume.py

A slice in the plane, 12 m long and 0.4 m deep, with the error-function stroke of the Large Wave
Flume at a smaller scale. The wave runs at √(g h) = 2 m/s and a little more. About half a minute.
"""

import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes

DEPTH, G = 0.4, 9.81
stroke = boundaries.piston_stroke(amplitude=0.3, rate=1.2, delay=2.0, until=8.0)
BACK = float(stroke.at(0.0)[0])  # where the stroke begins

scene = libmpm.Scene(
    dimension=2, cell_size=0.04, lower=(-0.6, 0), upper=(12, 0.8), gravity=(0, -G), name="flume"
)
scene.add_body(
    name="water",
    shape=shapes.Box(lower=(0, 0), upper=(12, DEPTH)),
    material=materials.TaitFluid(density=1000, bulk_modulus=4e5),
    hydrostatic=DEPTH,
)
slip = boundaries.Slip()
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=slip)
scene.add_boundary(
    name="piston",
    shape=shapes.Box(lower=(-1.0, -0.2), upper=(-BACK, 1.0)),
    response=slip,
    motion=boundaries.Displacement(stroke),
)
for x in (3.0, 6.0, 9.0):
    gauge = sensors.WaveGauge(position=(x,), interval=0.02)
    scene.add_sensor(name=f"x = {x:g} m", sensor=gauge)

if __name__ == "__main__":
    sim = libmpm.Simulation(scene)
    sim.run(until=8.0)
    crests = {x: sim.sensors[f"x = {x:g} m"].peak() for x in (3.0, 6.0, 9.0)}
    for x, crest in crests.items():
        print(f"crest at {x:g} m: {1e3 * (crest.value - DEPTH):.0f} mm at {crest.time:.2f} s")
    speed = 6.0 / (crests[9.0].time - crests[3.0].time)
    height = np.mean([c.value for c in crests.values()]) - DEPTH
    print(f"speed {speed:.2f} m/s, solitary wave {np.sqrt(G * (DEPTH + height)):.2f} m/s")
    figure = sim.sensors["x = 3 m"].plot()
    for x in (6.0, 9.0):
        sim.sensors[f"x = {x:g} m"].plot(axes=figure.axes[0])
    figure.savefig("wave_flume.png", dpi=150)
