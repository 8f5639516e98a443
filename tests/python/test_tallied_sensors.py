"""Sensors whose sums the engine takes in its step: what is read from particles, to rounding.

Their bits do not depend on threads, ranks and resumes. Expected duration: 40 s.
"""

# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.output.checkpoint import load_checkpoint, save_checkpoint
from libmpm._src.sensors import body_sensors, tallied
from support.devices import device  # noqa: F401
from support.sensing_scenes import busy_scene

ATTRIBUTES = {
    "water": (
        "position", "velocity", "speed", "kinetic_energy", "Elevation", "volume", "density",
        "Pressure", "J", "elastic_energy", "StressCauchy_XY", "StressCauchy_ZZ", "VonMisesStress",
        "Velocity_Y",
    ),
    "block": ("VonMisesStress", "StressCauchy_XX", "pressure", "elastic_energy", "volume_ratio"),
}  # fmt: skip
FLUID = materials.HerschelBulkleyFluid(
    density=1000, bulk_modulus=2e5, yield_stress=1.0, consistency=0.5, largest_viscosity=50.0
)
OPERATIONS = ("sum", "mean", "min", "max", "range", "count")


def pool(d: int, **more) -> libmpm.Scene:
    """A block that spins, falls into water that runs against a wall, and load cells."""
    wide = (0.4,) * (d - 2)
    scene = libmpm.Scene(
        dimension=d, cell_size=0.05, lower=(100.0, *(0.0,) * (d - 2), 10.0),
        upper=(101.2, *wide, 10.8), gravity=(0.0,) * (d - 1) + (-9.81,), **more,
    )  # fmt: skip
    low = (100.0, *(0.0,) * (d - 2), 10.0)
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=(100.6, *wide, 10.3)),
        material=FLUID,
        particles_per_cell=4, hydrostatic=10.3, velocity=(0.7,) + (0.0,) * (d - 1),
    )  # fmt: skip
    turn = {2: ("-6*(y-10.45)", "6*(x-100.35)"), 3: ("-6*(z-10.45)", "0", "6*(x-100.35)")}[d]
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(100.2, *(0.1,) * (d - 2), 10.35), upper=(100.5, *wide, 10.55)),
        material=materials.NeoHookean(density=600, youngs_modulus=4e5, poissons_ratio=0.3),
        particles_per_cell=4, velocity=libmpm.Field(components=turn),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


def all_of(scene: libmpm.Scene, interval: float) -> libmpm.Scene:
    """Add sensors of every attribute, operation and direction."""
    d = scene.dimension
    between = (0.1,) * (d - 2), (0.3,) * (d - 2)
    box = shapes.Box(lower=(100.2, *between[0], 10.0), upper=(100.45, *between[1], 10.4))
    for body, names in ATTRIBUTES.items():
        for i, name in enumerate(names):
            for k, operation in enumerate(OPERATIONS):
                scene.add_sensor(
                    name=f"{body} {name} {operation}",
                    sensor=sensors.ParticleSensor(
                        attribute=name, operation=operation, interval=interval,
                        body=None if (i + k) % 3 == 0 and name != "Velocity_Y" else body,
                        region=box if k % 2 else None,
                    ),
                )  # fmt: skip
    for direction in ("x", "x+", "x-", "y", "y-"):
        for name in ("position", "velocity"):
            scene.add_sensor(
                name=f"{name} {direction}",
                sensor=sensors.ParticleSensor(
                    attribute=name, operation="sum", direction=direction, interval=interval
                ),
            )
    for body in ("water", "block"):
        scene.add_sensor(name=body, sensor=sensors.BodyTracker(body=body, interval=interval))
    return scene


def by_reading(monkeypatch, scene: libmpm.Scene, until: float, **options) -> libmpm.Simulation:
    """Run with the same sensors read from particles."""
    with monkeypatch.context() as patch:
        patch.setattr(tallied, "in_step", lambda *_: False)
        sim = libmpm.Simulation(scene, **options)
        sim.run(until=until, progress=False)
        return sim


@pytest.mark.parametrize(
    ("d", "precision", "scheme"),
    [(2, "double", "APIC"), (2, "single", "AFLIP"), (3, "double", "APIC"), (3, "single", "FLIP")],
)
def test_they_are_what_is_read_from_particles(monkeypatch, device, d, precision, scheme):
    transfer = libmpm.methods.Transfer(scheme=scheme, flip=0.95 if scheme == "AFLIP" else None)
    scene = all_of(pool(d, method=libmpm.Method(transfer=transfer)), 0.004)
    assert all(tallied.in_step(scene, s) for s in scene.sensors)
    until = 0.012 if d == 3 else 0.04
    sim = libmpm.Simulation(scene, device=device, precision=precision)
    sim.run(until=until, progress=False)
    read = by_reading(monkeypatch, scene, until, device=device, precision=precision)
    for name, series in sim.sensors.items():
        expected = read.sensors[name]
        assert series.components == expected.components
        np.testing.assert_array_equal(series.time, expected.time, err_msg=name)
        assert len(series) > 2
        size = np.nanmax(np.abs(expected.values), axis=0, initial=1e-9)
        wrong = np.abs(series.values - expected.values) / size
        assert (np.isnan(series.values) == np.isnan(expected.values)).all(), name
        assert np.nanmax(wrong, initial=0) < 1e-9, (name, np.nanmax(wrong))


def test_pressures_of_a_viscous_fluid_are_those_that_are_read(monkeypatch, device):
    """What expands has a part of its viscosity in its pressure."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(2.0, 1.0), gravity=(0.0, 0.0)
    )
    spread = libmpm.Field(components=("2*(x-1)", "3*(y-0.5)"))
    scene.add_body(
        name="syrup", shape=shapes.Box(lower=(0.6, 0.3), upper=(1.4, 0.7)),
        material=materials.TaitFluid(bulk_modulus=2e5, viscosity=20.0), velocity=spread,
    )  # fmt: skip
    for name in ("pressure", "StressCauchy_XX", "VonMisesStress"):
        mean = sensors.ParticleSensor(attribute=name, operation="mean")
        scene.add_sensor(name=name, sensor=mean)
    options = {"device": device, "precision": "double"}
    sim = libmpm.Simulation(scene, **options)
    sim.run(until=2e-3, progress=False)
    read = by_reading(monkeypatch, scene, 2e-3, **options)
    for name, series in sim.sensors.items():
        np.testing.assert_allclose(series.values, read.sensors[name].values, rtol=1e-9)
    # -2/3 mu div v at the very first.
    assert sim.sensors["pressure"].values[0, 0] == pytest.approx(-2 / 3 * 20 * 5, rel=1e-6)


def test_a_scene_without_them_has_no_pass_for_them():
    scene = pool(2)
    assert "measure_tallies" not in libmpm.Simulation(scene).plan.kernels
    with_one = all_of(pool(2), 0.01)
    assert "measure_tallies" in libmpm.Simulation(with_one).plan.kernels


@pytest.mark.parametrize("d", [2, 3])
def test_their_bits_are_those_of_one_rank(device, d):
    def scene():
        made = all_of(pool(d), 0.004)
        made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.003))
        return made

    until = 0.04 if d == 2 else 0.012
    runs = {}
    for ranks in (1, 2, 3):
        one = "cpu" if device == "cpu" else "cuda:0"
        sim = libmpm.Simulation(scene(), device=[one] * ranks if ranks > 1 else one)
        sim.run(until=until, progress=False)
        runs[ranks] = sim
    for ranks in (2, 3):
        expect_the_same_samples(runs[1], runs[ranks])


def whole_and_half(path):
    """Run with every sensor to 0.04 s; another to 0.0205 s, which leaves its state at `path`."""
    runs = []
    for until in (0.04, 0.0205):
        scene = all_of(pool(2), 0.004)
        scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.003))
        runs.append(libmpm.Simulation(scene))
        runs[-1].run(until=until, progress=False)
    runs[1].save_checkpoint(path)
    return runs[0]


def expect_the_same_samples(whole, other):
    for name, series in whole.sensors.items():
        np.testing.assert_array_equal(series.time, other.sensors[name].time, err_msg=name)
        np.testing.assert_array_equal(series.values, other.sensors[name].values, err_msg=name)


def test_a_resumed_run_has_the_same_samples(tmp_path):
    whole = whole_and_half(tmp_path / "run.npz")
    resumed = libmpm.Simulation.resume(tmp_path / "run.npz", device=["cpu", "cpu"])
    resumed.run(until=0.04, progress=False)
    expect_the_same_samples(whole, resumed)


def test_a_checkpoint_without_them_goes_on(monkeypatch, tmp_path):
    def scene():
        made = pool(2)
        made.add_sensor(name="tracker", sensor=sensors.BodyTracker(body="block", interval=0.004))
        made.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls", interval=0.003))
        return made

    whole = libmpm.Simulation(scene())
    whole.run(until=0.04, progress=False)
    with monkeypatch.context() as patch:
        patch.setattr(tallied, "in_step", lambda *_: False)
        first = libmpm.Simulation(scene())
        first.run(until=0.0205, progress=False)
        first.save_checkpoint(tmp_path / "run.npz")
    resumed = libmpm.Simulation.resume(tmp_path / "run.npz")
    resumed.run(until=0.04, progress=False)
    np.testing.assert_array_equal(whole.sensors["load"].values, resumed.sensors["load"].values)
    tracked = whole.sensors["tracker"], resumed.sensors["tracker"]
    np.testing.assert_array_equal(tracked[0].time, tracked[1].time)
    force = [tracked[0].components.index(f"contact_force_{a}") for a in "xy"]
    seam = int(np.searchsorted(tracked[0].time, 0.0205))
    ours, theirs = (s.values.copy() for s in tracked)
    # What the body did before the seam is not in what the engine remembers.
    assert np.isnan(theirs[seam, force]).all()
    ours[seam, force] = theirs[seam, force] = 0
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


def test_a_scene_that_goes_on_has_the_samples_of_the_whole(tmp_path):
    whole = whole_and_half(tmp_path / "run.npz")
    more = libmpm.Scene.from_checkpoint(tmp_path / "run.npz")
    late = sensors.BodyTracker(body="block", quantities=("orientation", "velocity"))
    more.add_sensor(name="late", sensor=late)
    # How a body has turned since this branch began is worked out from its particles.
    assert [tallied.in_step(more, s) for s in more.sensors[-3:]] == [True, False, False]
    sim = libmpm.Simulation(more)
    sim.run(until=0.04, progress=False)
    expect_the_same_samples(whole, sim)
    assert sim.sensors["late"].values[0, 0] == 0


def test_rotations_go_on_over_many_samples_at_once():
    scene = busy_scene()
    track = sensors.BodyTracker(body="block", quantities=("orientation",))
    rates = np.linspace(0, 9, 40)
    moments = np.stack([np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for a in rates])
    once, by_parts = (body_sensors.OfBody(scene, track) for _ in range(2))
    found = once._turning(moments)[:, 0]
    np.testing.assert_allclose(found, rates, atol=1e-12)
    parts = [by_parts._turning(m)[:, 0] for m in np.split(moments, [1, 7, 20, 33])]
    np.testing.assert_array_equal(np.concatenate(parts), found)


def test_what_is_no_sum_is_read():
    scene = pool(2)
    disc = shapes.Sphere(centre=(100.3, 10.2), radius=0.1)
    for name, sensor in {
        "disc": sensors.ParticleSensor(attribute="velocity", operation="mean", region=disc),
        "spread": sensors.ParticleSensor(attribute="velocity", operation="std"),
        "strain": sensors.ParticleSensor(attribute="VonMisesStrain", body="block"),
        "walls": sensors.BodyTracker(body="block", quantities=("boundary_force",)),
    }.items():
        scene.add_sensor(name=name, sensor=sensor)
    assert not any(tallied.in_step(scene, s) for s in scene.sensors)


@pytest.mark.parametrize("damage", ["ids", "rows", "numbers"])
def test_damaged_first_places_are_refused(tmp_path, damage):
    scene = pool(2)
    scene.add_sensor(name="turn", sensor=sensors.BodyTracker(body="block", interval=0.004))
    sim = libmpm.Simulation(scene)
    sim.step(3)
    sim.save_checkpoint(tmp_path / "run.npz")
    kept = load_checkpoint(tmp_path / "run.npz")
    own = kept.memory[0]
    change = {
        "ids": {"first_id": own["first_id"] - 1},
        "rows": {"first_place": own["first_place"][1:]},
        "numbers": {"first_place": np.where(own["first_place"] > 0.3, np.nan, 0.0)},
    }
    own |= change[damage]
    save_checkpoint(tmp_path / "damaged.npz", kept)
    with pytest.raises(libmpm.CheckpointError, match="first places"):
        libmpm.Simulation.resume(tmp_path / "damaged.npz").step(1)


def test_trackers_of_alike_bodies_have_their_own_particles(device):
    """They are stored as one body: each tracker has the motion of its own, whatever the others."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(4.0, 2.0), gravity=(0.0, 0.0)
    )
    for k in range(12):
        low = (0.2 + 0.3 * k, 0.5 + 0.1 * (k % 3))
        scene.add_body(
            name=f"bar{k}", shape=shapes.Box(lower=low, upper=(low[0] + 0.2, low[1] + 0.1)),
            material=materials.NeoHookean(density=600, youngs_modulus=4e5, poissons_ratio=0.3),
            velocity=(0.01 * k, 0.1 * k),
        )  # fmt: skip
        track = sensors.BodyTracker(body=f"bar{k}", quantities=("velocity", "momentum", "extent"))
        scene.add_sensor(name=f"bar{k}", sensor=track)
    sim = libmpm.Simulation(scene, device=device, precision="double")
    sim.step(5)
    for k in range(12):
        values = sim.sensors[f"bar{k}"].values
        np.testing.assert_allclose(values[:, :2], np.tile([0.01 * k, 0.1 * k], (6, 1)), atol=1e-12)
        np.testing.assert_allclose(values[:, 2:4], 0.2 * 0.1 * 600 * values[:, :2], rtol=1e-12)
        assert (values[:, 4] > 0.19 + 0.3 * k).all()
