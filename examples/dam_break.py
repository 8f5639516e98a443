"""A dam breaks and the water strikes a pier: the force on it, the level before it, a picture.

    python examples/dam_break.py

In two dimensions the model is plane strain, so forces are N per metre of width. Some seconds.
"""

import libmpm
from libmpm import boundaries, materials, sensors, shapes

scene = libmpm.Scene(
    name="dam break",
    dimension=2,
    cell_size=0.02,
    lower=(0, 0),
    upper=(2, 1),
    gravity=(0, -9.81),
    # APIC, the default, loses shear in every step, which makes loads of a flow too large.
    method=libmpm.Method(transfer=libmpm.methods.Transfer(scheme="FLIP")),
)
scene.add_body(
    name="water",
    shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
    # The sound speed √(K/ρ), here 32 m/s, has to stay ten times above the flow's 3 m/s.
    material=materials.TaitFluid(density=1000, bulk_modulus=1e6),
    hydrostatic=0.5,
)
pier = shapes.Box(lower=(1.4, 0), upper=(1.5, 0.4))
free = boundaries.Separable()
scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=free)
scene.add_boundary(name="pier", shape=pier, response=free)
scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", interval=1e-3))
scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=(1.0,), interval=5e-3))

if __name__ == "__main__":
    sim = libmpm.Simulation(scene)  # on a CUDA GPU where there is one, else on all cores
    sim.run(until=1.0)
    load = sim.sensors["load"]
    peak = load.peak("force_x", filter=0.01)
    print(f"largest force {peak.value:.0f} N/m at {peak.time:.2f} s (mean over 10 ms)")
    print(f"impulse {load.impulse('force_x'):.0f} N·s/m")
    sim.plot("speed").savefig("dam_break.png", dpi=150)
    load.plot("force_x", filter=0.01).savefig("dam_break_load.png", dpi=150)
