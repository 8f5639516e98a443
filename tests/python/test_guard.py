"""A guard notices energy from nowhere, drifting volumes, lost particles and supersonic flow."""

from __future__ import annotations

import json
import math
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.run.guard import opened_by
from libmpm._src.run.guard_messages import energy_remedy
from libmpm._src.run.guard_watch import Watch
from support.devices import device  # noqa: F401

SOFT = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
#: Order 4 in every step makes energy in solids and at free surfaces (docs/method-tables.md).
GAINING = libmpm.Method(transfer=libmpm.methods.Transfer(scheme="FMPM", order=4))


def empty(method=None, gravity=(0.0, -9.81), **more):
    scene = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=(1, 1), cell_size=0.05, gravity=gravity,
        method=method or libmpm.Method(),
    )  # fmt: skip
    response = more.pop("response", boundaries.Separable())
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response, **more)
    return scene


def drop(method=None, **body):
    """Return a soft block that falls on a floor and bounces."""
    scene = empty(method)
    given = {"material": materials.FixedCorotated(**SOFT), "velocity": (0.0, -3.0)}
    box = shapes.Box(lower=(0.3, 0.3), upper=(0.7, 0.7))
    scene.add_body(name="block", shape=box, **(given | body))
    return scene


def dam(method=None, fbar="default", **more):
    scene = empty(method, **more)
    box = shapes.Box(lower=(0, 0), upper=(0.4, 0.6))
    water = materials.TaitFluid(bulk_modulus=4e5)
    scene.add_body(name="water", shape=box, material=water, fbar=fbar)
    return scene


def rising():
    """Return a tank at rest whose water rises by itself: a method that makes energy."""
    scene = empty(GAINING)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)),
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    return scene


def bar(blocks, particles):
    """Return a swinging bar of linear functions on triangles, whose particles cross edges."""
    mesh = grids.Mesh.blocks(columns=blocks, rows=1, lower=(0, 0), upper=(25.0, 25.0 / blocks))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh, basis=grids.Linear()))
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(0, 0), upper=(25.0, 25.0 / blocks)), lattice=particles,
        material=materials.Hypoelastic(density=1.0, youngs_modulus=100.0, poissons_ratio=0.0),
        velocity=libmpm.Field(components=("0.5 * sin(pi * x / 25)", "0")),
    )  # fmt: skip
    scene.add_boundary(name="ends", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


def start(scene, **how):
    if scene.grid is not None and how.get("device") == "cuda":
        pytest.skip("grids of functions run on the CPU")
    how = {"device": "cpu", "threads": 1} | how
    return libmpm.Simulation(scene, **how)


# The watch changes nothing ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scene", "precision"),
    [
        (dam(), "single"),
        (dam(), "double"),
        (dam(libmpm.Method(transfer="FLIP"), fbar=libmpm.FBar(form="two-volume", length=0.05)),
         "single"),
        (drop(libmpm.Method(transfer=libmpm.methods.Transfer(scheme="FMPM", order=2))), "single"),
        (drop(libmpm.Method(transfer=libmpm.methods.Transfer(scheme="XPIC", order=3),
                            kernel="cubic")),
         "single"),
        (bar(8, (40, 4)), "double"),
    ],
)  # fmt: skip
def test_no_bit_depends_on_it(scene, precision, device):  # noqa: F811
    states = []
    for guard in (None, libmpm.Guard(every=7)):
        simulation = start(scene, precision=precision, guard=guard, device=device)
        simulation.step(60)
        states.append(simulation.engine.save())
    for name, array in states[0].items():
        assert array.tobytes() == states[1][name].tobytes(), name


def test_it_looks_at_fixed_steps_however_a_run_is_split(monkeypatch):
    looks = []
    seen = Watch._condition

    def condition(self):
        looks[-1].append(self._simulation.steps)
        return seen(self)

    monkeypatch.setattr(Watch, "_condition", condition)
    for portions in ((45,), (3,) * 15, (10, 1, 34)):
        looks.append([])
        simulation = start(dam(), guard=libmpm.Guard(every=10))
        for n in portions:
            simulation.step(n)
    assert looks[0] == [0, 10, 20, 30, 40]
    assert looks[1] == looks[0] and looks[2] == looks[0]


@pytest.mark.parametrize(
    "make",
    [dam, lambda: drop(libmpm.Method(transfer="FLIP")), lambda: bar(4, (20, 4))],
    ids=["water", "solid", "functions"],
)
def test_energies_are_those_of_the_sensor(make, device):  # noqa: F811
    scene = make()
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0))
    simulation = start(scene, guard=None, device=device)
    simulation.step(30)
    condition = simulation.engine.condition(4096)
    row = simulation.sensors["energy"].values[-1]
    kept = [condition[k] for k in ("kinetic", "elastic", "potential")]
    assert kept == pytest.approx(row[:3], rel=1e-12)
    body = simulation.scene.bodies[0].name
    ratio = simulation.particles[body]["volume_ratio"].mean()
    assert condition["volume_ratio"][0] == pytest.approx(ratio, abs=1e-3)
    assert condition["mass"] == pytest.approx(simulation.particles[body]["mass"].sum())


def test_memory_survives_a_checkpoint(tmp_path):
    texts = []
    for stop in (None, 505):
        simulation = start(rising(), guard=libmpm.Guard(every=10))
        if stop:
            simulation.step(stop)
            simulation.save_checkpoint(tmp_path / "half.npz")
            simulation = libmpm.Simulation.resume(tmp_path / "half.npz")
            assert simulation.guard == libmpm.Guard(every=10)
        with pytest.raises(libmpm.NumericalError) as caught:
            simulation.step(1200)
        texts.append(str(caught.value))
    assert texts[0] == texts[1]
    other = libmpm.Simulation.resume(tmp_path / "half.npz", guard=None)
    assert other.guard is None
    other.step(10)


# Honest scenes -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "scene",
    [
        dam(),
        dam(libmpm.Method(transfer="FLIP")),
        dam(libmpm.Method(kernel="cubic")),
        dam(fbar=libmpm.FBar(form="two-volume", length=0.1)),
        dam(response=boundaries.Separable(static_friction=0.4, dynamic_friction=0.4)),
        dam(response=boundaries.Mirror()),
        drop(),
        drop(libmpm.Method(transfer=libmpm.methods.Transfer(scheme="AFLIP", flip=0.95))),
        drop(material=materials.LinearElastic(**SOFT)),
        drop(material=materials.VonMises(**SOFT, yield_stress=2e3)),
        drop(fbar=libmpm.FBar(form="two-volume", length=0.05)),
        bar(8, (40, 4)),
    ],
)
@pytest.mark.parametrize("every", [1, 25])
def test_honest_scenes_pass(scene, every, device):  # noqa: F811
    simulation = start(scene, guard=libmpm.Guard(every=every), device=device)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation.step(60 if every == 1 else 600)


def test_rest_stays_rest_far_from_the_datum():
    # The potential energy is 2500 times what a column's height makes, and in single precision.
    scene = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=(0.4, 500), cell_size=0.05, gravity=(0.0, -9.81)
    )
    scene.add_boundary(
        name="shelf", shape=shapes.Box(lower=(0, 0), upper=(0.4, 499)), response=boundaries.Slip()
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 499), upper=(0.4, 499.2)), hydrostatic=499.2,
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    start(scene, guard=libmpm.Guard(every=20)).step(1000)


# What is noticed ---------------------------------------------------------------------------------


def test_energy_from_nowhere_ends_the_run(tmp_path, device):  # noqa: F811
    output = libmpm.Output(tmp_path / "out", checkpoint_interval=0.02)
    simulation = start(rising(), guard=libmpm.Guard(every=25), output=output, device=device)
    with pytest.raises(libmpm.NumericalError) as caught:
        simulation.run(until=2.0, progress=False)
    text = str(caught.value)
    for part in ("mechanical energy has grown", "since step", "at step", "body 'water', particle",
                 "m/s", "Remedy", "FMPM"):  # fmt: skip
        assert part in text
    step = simulation.steps
    assert step % 25 == 0
    # Nothing goes on from a broken state, and nothing keeps it.
    assert json.loads((tmp_path / "out" / "log.json").read_text())["status"] == "failed"
    kept = sorted((tmp_path / "out").rglob("step_*.npz"))
    assert kept and all(int(p.stem.split("_")[1]) < step for p in kept)
    for again in (
        lambda: simulation.step(1),
        lambda: simulation.save_checkpoint(tmp_path / "x.npz"),
    ):
        with pytest.raises(libmpm.NumericalError, match="mechanical energy has grown"):
            again()
    assert not (tmp_path / "x.npz").exists()
    assert np.isfinite(simulation.particles["water"]["position"]).all()
    # Without a guard it goes on for as long.
    start(rising(), guard=None, device=device).step(step + 25)


def test_a_checkpoint_between_looks_is_not_written_over_with_a_broken_state(tmp_path):
    simulation = start(rising(), guard=libmpm.Guard(every=10000))
    simulation.step(20)
    simulation.save_checkpoint(tmp_path / "good.npz")
    simulation.step(1100)
    with pytest.raises(libmpm.NumericalError, match="mechanical energy has grown"):
        simulation.save_checkpoint(tmp_path / "good.npz")
    assert libmpm.Simulation.resume(tmp_path / "good.npz").steps == 20


def test_linear_functions_on_triangles_that_gain_energy():
    simulation = start(bar(26, (156, 4)), guard=libmpm.Guard(every=50))
    with pytest.raises(libmpm.NumericalError, match=r"grown by.*quadratic Powell-Sabin"):
        simulation.run(until=120.0, progress=False)


def test_an_open_scene_is_not_judged_by_its_energy():
    push = libmpm.TimeTable(time=(0.0, 0.1), value=((3.0, 0.0), (3.0, 0.0)))
    scene = empty(response={f: boundaries.Slip() for f in ("x-", "x+", "y-", "y+")})
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.3, 0), upper=(0.7, 0.4)),
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    assert opened_by(scene) == []
    pier = shapes.Box(lower=(0.1, 0), upper=(0.2, 0.6))
    scene.add_boundary(name="paddle", shape=pier, response=boundaries.Slip(),
                       motion=boundaries.Travel(velocity=push))  # fmt: skip
    assert opened_by(scene) == ["boundary 'paddle' moves"]
    start(scene, guard=libmpm.Guard(every=5)).step(60)


def test_lost_and_doubled_particles_are_named(monkeypatch):
    simulation = start(dam(), guard=libmpm.Guard(every=10))
    simulation.step(5)
    count = simulation.particle_count(0)
    monkeypatch.setattr(type(simulation), "particle_count", lambda self, body: count - 2)
    with pytest.raises(libmpm.NumericalError, match=f"'water' has {count - 2} .* expected {count}"):
        simulation.step(20)


@pytest.mark.parametrize("leaving", ["delete", "freeze"])
def test_particles_that_are_listed_as_gone_are_not_lost(leaving):
    scene = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=(1, 1), cell_size=0.05, gravity=(0.0, -9.81),
        method=libmpm.Method(leaving=leaving),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.3, 0.1), upper=(0.7, 0.5)), velocity=(0, -4.0),
        material=materials.FixedCorotated(**SOFT),
    )  # fmt: skip
    simulation = start(scene, guard=libmpm.Guard(every=10))
    with pytest.warns(libmpm.ModelWarning, match="left the domain"):
        simulation.step(200)


def shear(mach):
    """Return water in slip walls whose layers glide past each other; c is 10 m/s."""
    scene = empty(libmpm.Method(cfl=0.1), gravity=(0.0, 0.0), response=boundaries.Slip())
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 1)),
        material=materials.TaitFluid(density=1000.0, bulk_modulus=1e5),
        velocity=libmpm.Field(components=(f"{10 * mach} * sin(pi * x) * cos(pi * y)",
                                          f"-{10 * mach} * cos(pi * x) * sin(pi * y)")),
    )  # fmt: skip
    return scene


def test_fast_water_is_warned_of_once_and_supersonic_water_refused():
    simulation = start(shear(0.6), guard=libmpm.Guard(every=4))
    with pytest.warns(libmpm.ModelWarning, match="'water', particle .* of the sound speed") as seen:
        simulation.step(12)
    assert sum("of the sound speed" in str(w.message) for w in seen) == 1
    with pytest.raises(libmpm.NumericalError, match=r"'water', particle \d+ at .* bulk_modulus"):
        start(shear(1.4), guard=libmpm.Guard(every=4)).step(12)


def test_a_body_that_flies_faster_than_its_sound_is_left_alone():
    # Its own sound speed is 11.6 m/s; nothing happens to it.
    scene = drop(libmpm.Method(cfl=0.05), velocity=(0.0, 0.0))
    scene = empty(libmpm.Method(cfl=0.05), gravity=(0.0, 0.0))
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.2, 0.3), upper=(0.4, 0.7)), velocity=(20.0, 0.0),
        material=materials.FixedCorotated(**SOFT),
    )  # fmt: skip
    start(scene, guard=libmpm.Guard(every=10)).step(40)


@pytest.mark.parametrize(
    ("entry", "value", "text"),
    [
        ("volume_ratio", [1.3], "mean volume ratio is 1.3"),
        ("volume_ratio", [0.7], "mean volume ratio is 0.7"),
        ("density", 1800.0, "times as densely"),
        ("kinetic", math.inf, "kinetic energy is inf"),
    ],
)
def test_drifting_volumes_are_named(monkeypatch, entry, value, text):
    scene = empty()
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 0.4)), hydrostatic=0.4,
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    simulation = start(scene, guard=libmpm.Guard(every=10))
    simulation.step(15)
    seen = Watch._condition
    monkeypatch.setattr(Watch, "_condition", lambda self: seen(self) | {entry: value})
    with pytest.raises(libmpm.NumericalError, match=text):
        simulation.step(10)


# The value ---------------------------------------------------------------------------------------


def test_guard_is_a_value():
    guard = libmpm.Guard(every=10, energy=None, volume=0.1)
    assert libmpm.Guard.from_dict(json.loads(json.dumps(guard.to_dict()))) == guard
    assert start(dam()).guard == libmpm.Guard()
    assert start(dam(), guard=False).guard is None
    for bad in ({"every": 0}, {"energy": -1.0}, {"mach": math.nan}, {"particles": "yes"}):
        with pytest.raises(libmpm.SceneError, match=f"Guard: {next(iter(bad))}"):
            libmpm.Guard(**bad)
    with pytest.raises(libmpm.SceneError, match="guard"):
        start(dam(), guard="on")


def test_none_switches_a_rule_off():
    start(rising(), guard=libmpm.Guard(every=25, energy=None, mach=None, volume=None)).step(75)


def test_a_particle_alone_may_breathe():
    scene = empty(libmpm.Method(cfl=0.4), gravity=(0.0, 0.0))
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.47, 0.47), upper=(0.52, 0.52)),
        material=materials.TaitFluid(bulk_modulus=1e6), lattice=(1, 1), fbar=None,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", guard=libmpm.Guard(every=1))
    sim.particles["water"]["pressure"] = np.full(1, 100.0)
    swings = []
    for _ in range(50):
        sim.step(1)
        swings.append(float(sim.particles["water"]["volume_ratio"][0]) - 1)
    assert min(swings) < -5e-5 and max(swings) > 5e-5, "it breathes, and no guard ends it"


def test_the_remedy_names_a_linear_floor_on_which_bodies_pile():
    """Bars eight high on a floor with linear cells were sheared until the guard ended the run."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81))
    solid = materials.FixedCorotated(density=700, youngs_modulus=1e6, poissons_ratio=0.3)
    water = shapes.Box(lower=(0, 0), upper=(1, 0.4))
    scene.add_body(name="water", shape=water, material=materials.TaitFluid(bulk_modulus=1e5))
    for k in range(2):
        bar = shapes.Box(lower=(1.2, 0.3 * k), upper=(1.5, 0.3 * (k + 1)))
        scene.add_body(name=f"bar-{k}", shape=bar, material=solid)
    said = "where bodies lie in piles on 'floor', cell=\"held\" for it"
    by_default, by_name = boundaries.Separable(), boundaries.Separable(cell="linear")
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(), response=by_name)
    assert said not in energy_remedy(libmpm.Simulation(scene, device="cpu"))
    scene.add_contact(name="rub", between=("bar*", "bar*"), law=libmpm.contacts.Friction())
    assert said in energy_remedy(libmpm.Simulation(scene, device="cpu"))
    scene.remove("floor")
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(), response=by_default)
    assert said not in energy_remedy(libmpm.Simulation(scene, device="cpu"))
