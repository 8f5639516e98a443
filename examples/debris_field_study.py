"""Twelve random debris fields drift against a wall in air: how much the load depends on the field.

    python examples/debris_field_study.py

The plan of the blocks in plane strain: no gravity, no water. A study keeps every case in a folder
of its own; run again, it runs only what is missing. `examples/debris_study` is the long version,
with regressions and with water. About half a minute.
"""

import libmpm
from libmpm import boundaries, debris, materials, sensors, shapes

SPEED = 1.0  # m/s
timber = materials.FixedCorotated(density=600, youngs_modulus=1e6, poissons_ratio=0.0)
bar = debris.Prototype(length=0.5, width=0.1, height=0.1, material=timber, name="bar")


def scene(seed: int) -> libmpm.Scene:
    """Return the scene of one random field of eight bars."""
    field = debris.random(bar, count=8, footprint=(1.5, 1.5), corner=(0.5, 0.25), clearance=0.1,
                          seed=seed)  # fmt: skip
    made = libmpm.Scene(
        name="field",
        dimension=2,
        cell_size=0.05,
        lower=(0, -1),
        upper=(4, 3),
        method=libmpm.Method(leaving="delete"),  # what has bounced off may leave the domain
    )
    field.add_to(made, velocity=(-SPEED, 0.0))
    made.add_boundary(
        name="wall",
        shape=shapes.DomainWalls(faces=("x-",)),
        response=boundaries.Separable(),
    )
    made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="wall", interval=1e-3))
    return made


def response(case: libmpm.studies.StudyCase) -> dict[str, float]:
    """Return what the table holds of a case."""
    load = case.sensors["load"]
    return {"peak": -load.peak("force_x").value, "impulse": -load.impulse("force_x")}


if __name__ == "__main__":
    study = libmpm.Study(
        "debris_fields",
        scene,
        [{"seed": seed} for seed in range(12)],
        until=3.0,
        response=response,
    )
    result = study.run()
    for name, unit in (("peak", "N/m"), ("impulse", "N·s/m")):
        values = result[name]
        low, high = values.min(), values.max()
        print(f"{name}: mean {values.mean():.0f}, from {low:.0f} to {high:.0f} {unit}")
