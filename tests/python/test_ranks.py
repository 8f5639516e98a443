"""Several ranks share a scene: the bits of one, files as of one, resumed on another number.

Expected duration: 30 s.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from python.test_guard import bar

import libmpm
import libmpm.cases
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.run import backends
from python import fake_engine
from support import sensing_scenes
from support.between_ranks import between_ranks

#: Cases whose values come from particles, with smaller parameters than their own.
CASES: dict[str, dict[str, Any]] = {
    "vortex": {"cells": 16, "turnovers": 0.3},
    "slope-basin": {"until": 1.0},
    "pump-current": {"until": 1.0},
    "tank": {"cells": 16, "steps": 1000},
    "buoyancy": {"until": 0.05},
    "dam-break": {"cells": 12, "until": 3.0},
    "ritter": {"cells": 10},
    "incline": {"cells": 4},
    "block-impact": {},
    "column-collapse": {"cells": 16, "duration": 1.5},
    "spinning-disc": {"turns": 0.2},
}


def simulate(ranks, **changes):
    device = "cpu" if ranks == 1 else ["cpu"] * ranks
    return libmpm.Simulation(fake_engine.small_scene(), device=device, threads=ranks, **changes)


def same(a, b):
    """Tell whether two simulations hold the same bits of particles, whatever their order."""
    assert (a.time, a.steps) == (b.time, b.steps)
    for body in a.particles:
        order = [np.argsort(s.particles[body]["id"]) for s in (a, b)]
        for name in ("id", "position", "velocity", "stress"):
            x, y = (s.particles[body][name][o] for s, o in zip((a, b), order, strict=True))
            assert (x == y).all(), (body, name)
    return True


@pytest.mark.parametrize("ranks", [2, 3])
def test_bits_of_one(ranks):
    """Particles and sensors to the bit, energies to the rounding of their sums."""
    one, many = simulate(1), simulate(ranks)
    for sim in (one, many):
        sim.run(until=0.1)
    assert many.ranks == ranks
    assert same(one, many)
    for name in one.sensors:
        x, y = one.sensors[name], many.sensors[name]
        assert (x.time == y.time).all()
        assert np.allclose(x.values, y.values, rtol=0, atol=between_ranks(x), equal_nan=True), name


def test_resume_on_another_number(tmp_path):
    """A checkpoint of three ranks goes on on as many, or on as many as are asked for."""
    one, three = simulate(1), simulate(3)
    one.run(until=0.1)
    three.run(until=0.05)
    file = tmp_path / "three.npz"
    three.save_checkpoint(file)
    assert libmpm.Simulation.resume(file).ranks == 3
    for device in (None, "cpu", ["cpu", "cpu"]):
        resumed = libmpm.Simulation.resume(file, device=device)
        resumed.run(until=0.1)
        assert same(one, resumed)


def test_files_are_those_of_one(tmp_path):
    """Frames and series do not say how many ranks wrote them."""
    seen = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        output = libmpm.Output(folder, frame_interval=0.02)
        with simulate(ranks, output=output) as sim:
            sim.run(until=0.05)
        seen.append(sorted(p.name for p in folder.rglob("*") if p.is_file()))
    assert seen[0] == seen[1]


def channel(dimension, transfer=None):
    """Water that runs from an inlet to an outlet, around a column of any shape and under a log."""
    flat = dimension == 2
    low, wide = (0.0,) * dimension, () if flat else (0.4,)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=0.05, lower=low, upper=(1.6, *wide, 0.6),
        gravity=(*low[:-1], -9.81), method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    near, far = ((), ()) if flat else ((0.1,), (0.25,))
    column = shapes.Box(lower=(1.0, *near, 0.0), upper=(1.1, *far, 0.2))
    ball = shapes.Sphere(centre=(0.75, *wide, 0.25), radius=0.12)
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=(1.6, *wide, 0.3)) - column - ball,
        material=materials.TaitFluid(bulk_modulus=1e5), velocity=(0.8, *low[1:]),
        hydrostatic=0.3,
    )  # fmt: skip
    scene.add_body(
        name="log", shape=shapes.Box(lower=(0.3, *near, 0.35), upper=(0.5, *far, 0.45)),
        material=materials.NeoHookean(density=600.0, youngs_modulus=1e5, poissons_ratio=0.3),
    )  # fmt: skip
    faces = ("y-",) if flat else ("y-", "y+", "z-")
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=faces), response=boundaries.Slip()
    )
    scene.add_boundary(
        name="column", shape=column,
        response=boundaries.Separable(static_friction=0.3, dynamic_friction=0.2),
    )  # fmt: skip
    scene.add_boundary(
        name="ball",
        shape=ball,
        response=boundaries.Slip(),
        layer=boundaries.DecayLayer(function="linear", thickness=1.5),
    )
    scene.add_flow(
        name="in",
        flow=boundaries.Inflow(body="water", face="x-", velocity=0.8, level=0.3),
    )
    scene.add_flow(name="out", flow=boundaries.Outflow(face="x+", velocity=0.8))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="column"))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    gauge = (0.9,) if flat else (0.9, 0.23)
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=gauge, interval=0.005))
    probe = sensors.VelocityProbe(position=(*gauge, 0.12), interval=0.005)
    scene.add_sensor(name="probe", sensor=probe)
    return scene


@pytest.mark.parametrize(
    ("dimension", "precision", "pipeline", "transfer"),
    [(2, "single", "auto", None), (2, "double", "two-pass", "APIC"), (3, "double", "auto", None)],
)
def test_a_channel_with_a_column(dimension, precision, pipeline, transfer):
    """Inflow, outflow, obstacles and a guard that looks often: as on one rank."""
    until = 0.4 if dimension == 2 else 0.12
    found = []
    for ranks in (1, 2, 4):
        sim = libmpm.Simulation(
            channel(dimension, transfer), device="cpu" if ranks == 1 else ["cpu"] * ranks,
            threads=ranks, precision=precision, pipeline=pipeline, guard=libmpm.Guard(every=20),
        )  # fmt: skip
        sim.run(until=until)
        found.append(sim)
    one = found[0]
    assert len(one.inflow["in"]) > 2 and (dimension == 3 or len(one.outflow["out"]) > 2)
    for many in found[1:]:
        assert many.statistics["migrated"] > 0
        assert same(one, many)
        for name in one.sensors:
            x, y = one.sensors[name], many.sensors[name]
            assert (x.time == y.time).all()
            np.testing.assert_allclose(
                x.values, y.values, rtol=0, atol=between_ranks(x), err_msg=name
            )
        here, there = ((s.inflow["in"], s.outflow["out"]) for s in (one, many))
        for a, b in zip(here, there, strict=True):
            assert (a.time == b.time).all() and (a.values[:, 0] == b.values[:, 0]).all()
            np.testing.assert_allclose(a.values, b.values, rtol=1e-12)


def test_arrays_of_other_libraries():
    """Dense arrays are gathered from all ranks, in the order of the ids."""
    one, many = simulate(1), simulate(3)
    for sim in (one, many):
        sim.step(60)
    with one.device_arrays("water") as a, many.device_arrays("water") as b:
        assert set(a) == set(b)
        for name in a:
            np.testing.assert_array_equal(np.from_dlpack(a[name]), np.from_dlpack(b[name]), name)
    # Nodes that ranks share are there once.
    assert len(one.grid["mass"]) == len(many.grid["mass"])
    columns = ("position", "mass", "velocity")
    nodes = [np.column_stack([s.grid[name] for name in columns]) for s in (one, many)]
    assert sorted(map(tuple, nodes[0])) == sorted(map(tuple, nodes[1]))


def test_sensors_evaluated_in_python():
    """Of grid, particles and bodies, each node and particle once."""
    runs = []
    for device in ("cpu", ["cpu"] * 3):
        sim = libmpm.Simulation(sensing_scenes.busy_scene(), device=device, precision="double")
        sim.run(until=0.08)
        runs.append(sim)
    one, many = runs
    assert same(one, many) and len(one.sensors) > 10
    for name, series in one.sensors.items():
        x, y = np.asarray(series.values), np.asarray(many.sensors[name].values)
        assert len(x) > 0 and np.isfinite(x).any(), name
        apart = between_ranks(series, 1e-9)
        np.testing.assert_allclose(y, x, rtol=0, atol=apart, equal_nan=True, err_msg=name)


@pytest.mark.parametrize("name", CASES)
def test_reference_cases(name):
    """Values with known answers are those of one rank."""
    values = []
    for ranks in (1, 2, 3, 4):
        device = "cpu" if ranks == 1 else ["cpu"] * ranks
        result = libmpm.cases.run(name, device=device, threads=ranks, **CASES[name])
        assert result.steps > 50
        values.append(result.values)
    for other in values[1:]:
        assert other == pytest.approx(values[0], rel=1e-9, nan_ok=True)


@pytest.mark.parametrize("ranks", [2, 4])
def test_guards_find_what_they_find_on_one(ranks):
    """What may not be is noticed at the same step, in the same words, and not saved."""
    texts = []
    for n in (1, ranks):
        scene = fake_engine.small_scene()
        device = "cpu" if n == 1 else ["cpu"] * n
        # The splash of the collapse is far slower than sound, and faster than this.
        sim = libmpm.Simulation(
            scene, device=device, threads=n, guard=libmpm.Guard(every=10, mach=0.05)
        )
        with pytest.raises(libmpm.NumericalError, match="sound speed") as caught:
            sim.run(until=1.0)
        texts.append((sim.steps, str(caught.value)))
    assert texts[0] == texts[1]


def method(transfer="APIC", flip=None, **given):
    if flip is not None:
        transfer = libmpm.methods.Transfer(scheme=transfer, flip=flip)
    return libmpm.Method(transfer=transfer, **given)


def with_fbar(scene, **fbars):
    """Return the scene with these forms of F-bar on its bodies."""
    old = scene.to_dict()
    for body in old["bodies"]:
        if body["name"] in fbars:
            body["fbar"] = fbars[body["name"]].to_dict()
    return libmpm.Scene.from_dict(old)


METHODS = {
    "FLIP": {"method": method(transfer="FLIP")},
    "ASFLIP, split F-bar on one": {
        "method": method(transfer="ASFLIP", flip=0.97),
        "block": "split",
    },
    "PIC, cubic": {"method": method(transfer="PIC", kernel="cubic")},
    "AFLIP, cubic": {"method": method(transfer="AFLIP", flip=0.97, kernel="cubic")},
    "FLIP, linear": {"method": method(transfer="FLIP", kernel="linear")},
    "XPIC": {"method": method(transfer=libmpm.methods.Transfer(scheme="XPIC", order=3))},
    "phased": {"pipeline": "phased"},
    "two volumes on a solid": {"block": "two-volume", "water": "two-volume"},
    "literal": {"block": "literal", "water": "literal"},
}


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("case", METHODS)
def test_methods(case, precision, tmp_path):
    """Transfers, kernels and forms of F-bar: on three ranks as on one, saved, and on two."""
    given = dict(METHODS[case])
    options = {"pipeline": given.pop("pipeline", "auto"), "precision": precision}
    scene = fake_engine.small_scene(**{k: given.pop(k) for k in ("method",) if k in given})
    if given:
        forms = {body: libmpm.FBar(form=form, length=0.1) for body, form in given.items()}
        scene = with_fbar(scene, **forms)
    one = libmpm.Simulation(scene, device="cpu", **options)
    three = libmpm.Simulation(scene, device=["cpu"] * 3, threads=3, **options)
    one.run(until=0.1)
    three.run(until=0.05)
    three.save_checkpoint(tmp_path / "three.npz")
    two = libmpm.Simulation.resume(tmp_path / "three.npz", device=["cpu", "cpu"])
    for sim in (two, three):
        sim.run(until=0.1)
        assert same(one, sim)


def over_a_bed(dimension):
    """Return water that falls down a slope onto a level bed, past a ball: lines of nodes towards
    surfaces, which run along every axis and end in blocks of other ranks."""
    beyond = (0.4,) * (dimension - 2)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=0.025, lower=(0.0,) * dimension, upper=(1.6, *beyond, 0.8),
        gravity=(*(0.0,) * (dimension - 1), -9.81),
    )  # fmt: skip
    profile = [(-1.0, 0.31), (0.3, 0.31), (0.8, 0.11), (3.0, 0.11), (3.0, -1.0), (-1.0, -1.0)]
    if dimension == 2:
        bed = shapes.Extrusion(profile=profile)
        ball = shapes.Sphere(centre=(1.11, 0.17), radius=0.12)
    else:
        bed = shapes.Extrusion(axis="y", lower=-1.0, upper=2.0, profile=profile)
        ball = shapes.Sphere(centre=(1.11, 0.21, 0.17), radius=0.12)
    scene.add_body(
        name="water", material=materials.TaitFluid(bulk_modulus=1e5),
        shape=shapes.Box(lower=(0.0, *(0.0,) * len(beyond), 0.325), upper=(0.4, *beyond, 0.7)),
    )  # fmt: skip
    linear = boundaries.Slip(cell="linear")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=linear)
    scene.add_boundary(name="bed", shape=bed, response=linear)
    scene.add_boundary(name="ball", shape=ball, response=boundaries.Separable(cell="linear"))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="ball", interval=0.01))
    return scene


def one_and_three(scene, end, precision, folder):
    """Return runs on one rank and on three, whose bits are alike, as on two from halfway on."""
    one = libmpm.Simulation(scene, device="cpu", precision=precision)
    three = libmpm.Simulation(scene, device=["cpu"] * 3, threads=3, precision=precision)
    one.run(until=end)
    three.run(until=end / 2)
    three.save_checkpoint(folder / "three.npz")
    two = libmpm.Simulation.resume(folder / "three.npz", device=["cpu", "cpu"])
    for sim in (two, three):
        sim.run(until=end)
        assert same(one, sim)
        assert sim.statistics["migrated"] > 0
    return one, three


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_lines_towards_surfaces(dimension, precision, tmp_path):
    scene, end = over_a_bed(dimension), 1.0 if dimension == 2 else 0.36
    one, _ = one_and_three(scene, end, precision, tmp_path)
    assert np.abs(one.sensors["load"]["force_x"]).max() > 0


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("method", ["C1", "F0AL1", "NB"])
def test_smoothing_over_cells(method, precision, tmp_path):
    """What cells and nodes sum up is what one rank sums up; what it did agrees to rounding."""
    one, three = one_and_three(fake_engine.smoothed_scene(method), 0.3, precision, tmp_path)
    for name, expected in one.smoothing["water"].items():
        scale = np.abs(one.smoothing["water"]["energy" if "energy" in name else name]).max()
        found = three.smoothing["water"][name]
        assert np.allclose(found, expected, rtol=1e-6, atol=1e-9 * scale), name
    assert one.smoothing["water"]["energy_change"].sum() < 0


def test_functions_over_cells_are_refused():
    scene = bar(4, (20, 4))
    libmpm.Simulation(scene, device="cpu").step(1)
    with pytest.raises(libmpm.SceneError, match=r"\['cpu', 'cpu'\].* grid of functions"):
        libmpm.Simulation(scene, device=["cpu", "cpu"])


def test_branches(tmp_path):
    """A trunk and branches that add bodies may run on any number of ranks."""
    trunk = simulate(2)
    trunk.step(40)
    trunk.save_checkpoint(tmp_path / "trunk.npz")
    branch = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz")
    going_on = libmpm.Simulation(branch, device=["cpu"] * 3, threads=3)
    for sim in (trunk, going_on):
        sim.step(20)
    assert same(trunk, going_on)
    branch.add_body(
        name="log", shape=shapes.Box(lower=(0.6, 0.1, 0.6), upper=(0.8, 0.3, 0.8)),
        material=materials.FixedCorotated(density=500, youngs_modulus=1e5),
    )  # fmt: skip
    one = libmpm.Simulation(branch, device="cpu")
    many = libmpm.Simulation(branch, device=["cpu"] * 3, threads=3)
    for sim in (one, many):
        sim.step(40)
    assert same(one, many)
    for name in one.sensors:
        x, y = one.sensors[name], many.sensors[name].values
        np.testing.assert_allclose(
            y, x.values, rtol=0, atol=between_ranks(x), equal_nan=True, err_msg=name
        )


def test_the_engine_is_told(monkeypatch):
    """One rank leaves no trace in the specification."""
    monkeypatch.setitem(sys.modules, "libmpm._core", fake_engine.module())
    assert "ranks" not in simulate(1).engine._spec
    assert simulate(2).engine._spec["ranks"] == {"count": 2}
    assert backends.parse_device(["cpu", "cpu"]) == ("cpu", 0)
    with pytest.raises(libmpm.DeviceError, match="several devices"):
        backends.parse_device(["cpu", "auto"])
