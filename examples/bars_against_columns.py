"""A stream carries timber bars against three columns: what the bars add to the load, who stays.

    python examples/bars_against_columns.py

A plan in plane strain, without gravity: a body of water 4 m long arrives at 0.5 m/s. Each bar has
velocities of its own (`Scene.add_contact`), so that bars turn in the water, slide along each other
and come off again, where one velocity for all would glue them together. Half a minute.
"""

import numpy as np

import libmpm
from libmpm import boundaries, contacts, debris, materials, sensors, shapes

SPEED = 0.5  # m/s
COLUMNS = (0.4, 0.8, 1.2)  # m, middles across the channel
FACE, SIDE, CELL = 4.6, 0.16, 0.04  # m: where the columns begin, their side, a cell

# Stiff enough to keep its shape; timber's own modulus would only cost steps.
timber = materials.FixedCorotated(density=600, youngs_modulus=2e5, poissons_ratio=0.0)
bar = debris.Prototype(length=0.48, width=0.12, height=0.12, material=timber, name="bar")


def scene(count: int) -> libmpm.Scene:
    """Return the stream with so many bars in its front half."""
    made = libmpm.Scene(name="bars", dimension=2, cell_size=CELL, lower=(0, 0), upper=(12, 1.6))
    made.add_body(
        name="water",
        shape=shapes.Box(lower=(0.4, 0), upper=(4.4, 1.6)),
        material=materials.TaitFluid(density=1000, bulk_modulus=4e4),
        velocity=(SPEED, 0.0),
    )
    if count:
        field = debris.random(bar, count=count, footprint=(1.8, 1.4), corner=(2.5, 0.1),
                              clearance=0.08, seed=2)  # fmt: skip
        field.add_to(made, velocity=(SPEED, 0.0), name="bar", subtract_from=("water",))
        made.add_contact(name="bars", between=("bar-*", "bar-*"), law=contacts.Friction(static=0.4))
        made.add_contact(name="afloat", between=("bar-*", "water"), law=contacts.Fluid())
    made.add_boundary(name="channel", shape=shapes.DomainWalls(), response=boundaries.Separable())
    rough = boundaries.Separable(static_friction=0.4, dynamic_friction=0.4)
    for k, y in enumerate(COLUMNS):
        box = shapes.Box(lower=(FACE, y - SIDE / 2), upper=(FACE + SIDE, y + SIDE / 2))
        made.add_boundary(name=f"column {k}", shape=box, response=rough)
        load = sensors.LoadCell(boundary=f"column {k}", interval=4e-3)
        made.add_sensor(name=f"column {k}", sensor=load)
    return made


def against(sim: libmpm.Simulation) -> list[str]:
    """Return the bars that lie at a column and that the stream moves no further.

    Bodies come to rest one to two cells off a wall, which holds the nodes before it.
    """
    found = []
    for name, particles in sim.particles.items():
        position, velocity = particles["position"], particles["velocity"].mean(axis=0)
        if name == "water" or np.linalg.norm(velocity) > 0.2 * SPEED:
            continue
        for y in COLUMNS:
            off = np.maximum(np.abs(position - (FACE + SIDE / 2, y)) - SIDE / 2, 0)
            if np.linalg.norm(off, axis=1).min() < 2 * CELL:
                found.append(name)
                break
    return found


if __name__ == "__main__":
    runs = {}
    for count in (8, 0):
        sim = runs[count] = libmpm.Simulation(scene(count))
        sim.run(until=4.8)
        loads = [sim.sensors[f"column {k}"] for k in range(len(COLUMNS))]
        force = sum(load["force_x"] for load in loads)
        mean = np.convolve(force, np.full(10, 0.1), mode="valid")  # over 40 ms
        impulse = sum(load.impulse("force_x") for load in loads)
        print(f"{count} bars: largest force {mean.max():.0f} N/m, impulse {impulse:.0f} N·s/m")
    bars = [p["position"][:, 0].mean() for n, p in runs[8].particles.items() if n != "water"]
    stay, touch = sum(x < FACE for x in bars), len(against(runs[8]))
    print(f"{stay} of 8 bars stay before the columns, {touch} of them rest against one")
    runs[8].plot("speed").savefig("bars_against_columns.png", dpi=150)
