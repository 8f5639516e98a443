"""Scenes with sensors that are evaluated in Python."""

from __future__ import annotations

import numpy as np

import libmpm
from libmpm import boundaries, materials, sensors, shapes

G = 9.81
#: m/s², Pa and kg/m³ of a soft block and of water that is slow enough for short runs.
SOLID = {"density": 500.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
WATER = {"density": 1000.0, "bulk_modulus": 5e5, "viscosity": 0.0}


def open_scene(dimension=2, gravity=G, **method):
    return libmpm.Scene(
        dimension=dimension,
        cell_size=0.1,
        lower=(0.0,) * dimension,
        upper=(2.0,) * dimension,
        origin=(100.0, 10.0, -3.0)[:dimension],
        gravity=(0.0,) * (dimension - 1) + (-gravity,),
        method=libmpm.Method(**method),
    )


def add_block(scene, name="block", lower=(0.6, 0.5), upper=(1.0, 0.9), **changes):
    arguments = {"material": materials.FixedCorotated(**SOLID)} | changes
    scene.add_body(name=name, shape=shapes.Box(lower=lower, upper=upper), **arguments)


def add_walls(scene, response=None):
    response = boundaries.Slip() if response is None else response
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)


def simulate(scene, until=None, **options):
    options = {"device": "cpu", "precision": "double", "threads": 1} | options
    sim = libmpm.Simulation(scene, **options)
    if until is not None:
        sim.run(until=until, progress=False)
    return sim


def column(series, name):
    return series.values[:, series.components.index(name)]


def busy_scene():
    """A block that falls into water, and one of every sensor."""
    scene = open_scene()
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(2, 0.5)),
        material=materials.TaitFluid(**WATER),
        hydrostatic=0.5,
    )
    add_block(scene, lower=(0.6, 0.52), upper=(1.0, 0.9), velocity=(1.0, -1.0))
    add_walls(scene)
    box = shapes.Box(lower=(0.3, 0.0), upper=(1.2, 0.8))
    region = {"region": box, "interval": 0.011}
    for operation in ("sum", "mean", "std", "count"):
        scene.add_sensor(
            name=f"grid {operation}",
            sensor=sensors.GridSensor(attribute="momentum", operation=operation, **region),
        )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.02))
    for name in ("force", "acceleration", "volume", "jbar"):
        scene.add_sensor(name=name, sensor=sensors.GridSensor(attribute=name, **region))
    scene.add_sensor(
        name="speed",
        sensor=sensors.ParticleSensor(attribute="velocity", direction="y-", operation="mean"),
    )
    scene.add_sensor(
        name="mises",
        sensor=sensors.ParticleSensor(attribute="VonMisesStress", body="block", interval=0.01),
    )
    body = sensors.BodyTracker(body="block", interval=0.007)
    scene.add_sensor(name="body", sensor=body)
    scene.add_sensor(
        name="ids",
        sensor=sensors.AttributeTracker(
            body="water", ids=(7, 0), attributes=("Pressure", "position"), interval=0.01
        ),
    )
    scene.add_sensor(name="probe", sensor=sensors.PressureProbe(position=(0.4, 0.2), interval=0.01))
    scene.add_sensor(
        name="gauge", sensor=sensors.ElevationGauge(position=(1.5,), body="water", interval=0.01)
    )
    column = sensors.ColumnGauge(position=(1.5,), body="water", interval=0.01)
    scene.add_sensor(name="column", sensor=column)
    return scene


def same(one, two):
    for name, series in one.sensors.items():
        other = two.sensors[name]
        np.testing.assert_array_equal(series.time, other.time, err_msg=name)
        np.testing.assert_array_equal(series.values, other.values, err_msg=name)


def height(sim):
    return sim.particles["block"]["position"][:, 1].max()
