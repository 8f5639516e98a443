"""Reading a box of a simulation: all that lies in it, with the bits of reading everything.

Expected duration: 15 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from libmpm import materials, sensors, shapes
from support import scenes
from support.devices import device  # noqa: F401

NAMES = ["position", "velocity", "pressure", "volume", "stress", "velocity_gradient"]
METHODS = {
    "APIC": {"cfl": 0.3, "transfer": "APIC"},
    "FLIP": {"cfl": 0.3, "transfer": libmpm.methods.Transfer(scheme="FLIP")},
    "cubic": {"cfl": 0.3, "transfer": "APIC", "kernel": libmpm.methods.Kernel(name="cubic")},
}


def drifting(dimension, method):
    """Blocks that fly fast, so that particles are outside of the cells that they are stored by."""
    scene = scenes.crowded(dimension, moving=True, method=libmpm.Method(**METHODS[method]))
    size = 1.2 if dimension == 2 else 0.8
    return scene, size


def lie_in(points, box):
    low, high = (np.asarray(side) for side in box)
    return np.all((points >= low) & (points <= high), axis=1)


def same_rows(some, everything, place):
    """Return which rows of all those of a part are, by their places; they have the same bits."""
    row = {tuple(x): k for k, x in enumerate(everything[place].tolist())}
    rows = [row[tuple(x)] for x in some[place].tolist()]
    for key in some:
        np.testing.assert_array_equal(some[key], everything[key][rows], err_msg=key)
    return rows


def machine(scene, where, precision, ranks):
    device = [where] * ranks if ranks > 1 else where
    sim = libmpm.Simulation(scene, device=device, threads=ranks, precision=precision)
    sim.step(25)
    return sim


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("dimension", "precision", "ranks"),
    [(2, "single", 1), (3, "single", 1), (3, "double", 1), (3, "double", 2)],
)
def test_a_box_has_what_all_has_there(dimension, precision, ranks, method, device):
    if device == "cuda" and ranks > 1:
        device = "cuda:0"
    scene, size = drifting(dimension, method)
    sim = machine(scene, device, precision, ranks)
    engine = sim.engine
    middle = np.full(dimension, 0.35 * size)
    boxes = {
        "one": [(list(middle - 0.06), list(middle + 0.06))],
        "two": [
            ([0.0] * dimension, [0.1] * dimension),
            ([-np.inf, 0.3, -np.inf][:dimension], [0.2, np.inf, np.inf][:dimension]),
        ],
        "none": [([5.0 * size] * dimension, [6.0 * size] * dimension)],
    }
    for name, box in boxes.items():
        fewer = False
        for body in range(2):
            everything = engine.attributes(body, NAMES)
            some = engine.attributes(body, NAMES, box)
            fewer = fewer or len(some["id"]) < len(everything["id"])
            row = {i: k for k, i in enumerate(everything["id"].tolist())}
            rows = [row[i] for i in some["id"].tolist()]
            assert len(set(rows)) == len(rows)
            for key in NAMES:
                np.testing.assert_array_equal(some[key], everything[key][rows], err_msg=key)
            inside = np.zeros(len(row), dtype=bool)
            for one in box:
                inside |= lie_in(everything["position"], one)
            assert set(np.flatnonzero(inside)) <= set(rows)
        keys = ("position", "mass", "velocity")
        nodes = {key: engine.grid(key) for key in keys}
        near = {key: engine.grid(key, box) for key in keys}
        fewer = fewer or len(near["mass"]) < len(nodes["mass"])
        rows = same_rows(near, nodes, "position")
        inside = np.zeros(len(nodes["mass"]), dtype=bool)
        for one in box:
            inside |= lie_in(nodes["position"], one)
        assert set(np.flatnonzero(inside)) <= set(rows)
        same_rows(engine.sums(box), engine.sums(), "cell")
        assert name == "two" or fewer
        # A block has 64 cells: of a box of a few of them most of the scene is left out.
        assert name != "none" or len(near["mass"]) == 0


def test_readings_between_steps_change_nothing(device):
    """Velocities that were made for one reader serve the next, and not those after a step."""
    scene, _ = drifting(3, "APIC")
    read, plain = (machine(scene, device, "single", 1) for _ in range(2))
    for _ in range(3):
        first = read.engine.attributes(0, ["velocity"])
        again = read.engine.attributes(0, ["velocity"])
        np.testing.assert_array_equal(first["velocity"], again["velocity"])
        read.step(1)
        plain.step(1)
        now = read.engine.attributes(0, ["velocity"])["velocity"]
        assert not np.array_equal(now, first["velocity"])
        np.testing.assert_array_equal(now, plain.engine.attributes(0, ["velocity"])["velocity"])
    state = read.engine.save()
    before = read.engine.attributes(0, ["velocity"])["velocity"]
    read.step(2)
    read.engine.load(state)
    np.testing.assert_array_equal(read.engine.attributes(0, ["velocity"])["velocity"], before)


def test_sensors_with_regions_read_what_alone_they_read():
    """A sensor's values do not depend on which others are sampled with it."""
    method = libmpm.Method(cfl=0.3, transfer="APIC")

    def made(names):
        scene = scenes.crowded(3, method=method)
        scene.add_body(
            name="bar", shape=shapes.Box(lower=(0.5, 0.5, 0.5), upper=(0.7, 0.6, 0.7)),
            material=materials.FixedCorotated(
                density=600.0, youngs_modulus=2e5, poissons_ratio=0.3
            ),
        )  # fmt: skip
        region = shapes.Box(lower=(0.0, 0.0, 0.0), upper=(0.15, 0.4, 0.4))
        ball = shapes.Sphere(centre=(0.3, 0.3, 0.3), radius=0.12)
        known = {
            "push": sensors.GridSensor(attribute="momentum", region=region, interval=2e-3),
            "volume": sensors.GridSensor(attribute="volume", region=ball, interval=2e-3),
            "jbar": sensors.GridSensor(attribute="jbar", operation="mean", region=region),
            "worst": sensors.ParticleSensor(attribute="Pressure", region=ball, operation="max"),
            "toe": sensors.PressureProbe(position=(0.05, 0.05, 0.2), interval=2e-3),
            "level": sensors.ElevationGauge(position=(0.2, 0.2), interval=2e-3),
            "column": sensors.ColumnGauge(position=(0.2, 0.2), interval=2e-3),
            "bar": sensors.BodyTracker(
                body="bar", quantities=("centroid", "boundary_force"), interval=2e-3
            ),
            "all": sensors.ParticleSensor(attribute="velocity", operation="mean"),
        }
        for name in names:
            scene.add_sensor(name=name, sensor=known[name])
        sim = libmpm.Simulation(scene, precision="double")
        sim.step(12)
        return {name: sim.sensors[name].values for name in names}, list(known)

    _, names = made([])
    together, _ = made(names)
    for name in names:
        alone, _ = made([name])
        assert np.isfinite(together[name]).all()
        np.testing.assert_allclose(
            together[name], alone[name], rtol=1e-12, atol=1e-12, err_msg=name
        )


def test_particles_are_followed_however_far_they_go():
    """Particles that leave the boxes in which they are looked for, and one that leaves the run."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(4.0, 1.0), gravity=(0.0, 0.0),
        method=libmpm.Method(cfl=0.3, transfer="APIC", leaving="delete"),
    )  # fmt: skip
    for k, speed in enumerate((9.0, 3.0)):
        scene.add_body(
            name=f"block{k}", shape=shapes.Box(lower=(0.3, 0.2 + 0.4 * k),
            upper=(0.7, 0.4 + 0.4 * k)), velocity=(speed, 0.0),
            material=materials.FixedCorotated(
                density=600.0, youngs_modulus=2e5, poissons_ratio=0.3
            ),
        )  # fmt: skip
        first = 32 * k
        scene.add_sensor(
            name=f"seen{k}",
            sensor=sensors.AttributeTracker(
                body=f"block{k}", ids=(first, first + 7), attributes=("position", "Velocity_X"),
                interval=0.05,
            ),
        )  # fmt: skip
    sim = libmpm.Simulation(scene, precision="double")
    sim.run(until=0.8, progress=False)
    fast, slow = (sim.sensors[f"seen{k}"] for k in range(2))
    for series, speed in ((fast, 9.0), (slow, 3.0)):
        start = series.values[0]
        there = np.isfinite(series.values[:, 0])
        x = start[0] + speed * (series.time - series.time[0])
        np.testing.assert_allclose(series.values[there, 0], x[there], rtol=1e-9)
        np.testing.assert_allclose(series.values[there, 2], speed, rtol=1e-9)
    assert np.isfinite(slow.values).all()
    assert 5 < np.isfinite(fast.values[:, 0]).sum() < len(fast.time)
