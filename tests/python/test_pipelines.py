"""The pipeline is a property of a body: one that needs more leaves the others as they were.

Expected duration: 15 s, half of it the naive method.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from libmpm import FBar, Method, _core, boundaries, materials, sensors, shapes
from libmpm.methods import Transfer
from support import scenes
from support.devices import device  # noqa: F401
from support.methods_reference import agree, choose

WATER = materials.TaitFluid(bulk_modulus=2e5)
SOLID = materials.CamClay(
    density=900.0, youngs_modulus=1e5, poissons_ratio=0.3, log_plastic_volume=-0.02
)
FLIP = Transfer(scheme="AFLIP", flip=0.95)
#: Transfer, F-bar of the water.
METHODS = {"APIC": ("APIC", None), "APIC, F-bar": ("APIC", FBar()), "AFLIP": (FLIP, FBar())}


def pool(dimension=2, *, fbar=None, solid=True, apart=False, **method):
    """Water between walls, and under or beside it a small block of a law without a fused form."""
    dx, n = 0.1, 16 if dimension == 2 else 12
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=(0.0,) * dimension, upper=(n * dx,) * dimension,
        gravity=(0.0, -10.0, 0.0)[:dimension], method=Method(**method),
    )  # fmt: skip
    high = (0.5, 0.6, 0.5)[:dimension]
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0,) * dimension, upper=high), material=WATER,
        velocity=(0.4, 0.0, 0.2)[:dimension], fbar=fbar,
    )  # fmt: skip
    low = ((1.0, 0.3, 0.8) if apart else (0.1, 0.6, 0.1))[:dimension]
    if solid:
        upper = tuple(a + 0.2 for a in low)
        scene.add_body(name="block", shape=shapes.Box(lower=low, upper=upper), material=SOLID)
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces="all"), response=boundaries.Separable()
    )
    return scene


def states(spec, steps, device, bodies=None):
    machine = scenes.engine(spec, device)
    scenes.advance(machine, steps)
    every = range(len(spec["bodies"])) if bodies is None else bodies
    names = ("position", "velocity", "pressure")
    return [scenes.by_id(machine, b, name) for b in every for name in names]


def plan(scene, device="cpu", precision="double", **options):
    return scene.plan(device=device, precision=precision, **options)


# ---- what the plan says -------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_one_body_leaves_the_others_in_one_pass(method):
    transfer, fbar = METHODS[method]
    mixed = plan(pool(transfer=transfer, fbar=fbar))
    assert mixed.pipeline == "by-body"
    water, block = (mixed.body(name) for name in ("water", "block"))
    assert (water["pipeline"], block["pipeline"]) == ("fused", "phased")
    assert block["pipeline_reason"] == "material CamClay has no fused form"
    assert "body 'block' phased: material CamClay" in mixed.pipeline_reason
    alone = plan(pool(transfer=transfer, fbar=fbar, solid=False))
    assert alone.pipeline == "fused"
    assert mixed.columns("water") == alone.columns("water")
    assert "deposit" in mixed.columns("block")
    kernels = [k for k in mixed.kernels if ":" in k]
    assert kernels == ["fused:water", "collect:block", "respond:block", "spread:block"]


def test_a_body_without_F_bar_costs_the_nodes_nothing():
    mixed, alone = (plan(pool(3, solid=solid)) for solid in (True, False))
    assert mixed.bytes_per_node == alone.bytes_per_node


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"fbar": FBar(form="split", ratio=0.9)}, "this form of F-bar stands between the parts"),
        ({"transfer": Transfer(scheme="XPIC")}, "transfer 'XPIC' has no other form"),
    ],
)
def test_what_makes_the_water_phased(changes, reason):
    made = plan(pool(**changes))
    assert made.pipeline == "phased"
    assert made.body("water")["pipeline_reason"].startswith(reason)


def test_a_kernel_is_a_matter_of_the_scene():
    made = plan(pool(kernel="cubic"))
    assert made.pipeline == "phased"
    assert made.pipeline_reason == "kernel 'cubic' has no other form"


def test_without_a_fused_form_water_takes_two_passes():
    for transfer in ("APIC", FLIP):
        made = plan(pool(transfer=transfer), "cuda", "mixed")
        assert [made.body(b)["pipeline"] for b in made.bodies] == ["two-pass", "phased"]


def test_one_pipeline_may_be_asked_for():
    scene = pool()
    assert plan(scene, pipeline="phased").body("water")["pipeline_reason"] == "asked for"
    assert plan(scene, pipeline="by-body").pipeline == plan(scene).pipeline
    for asked in ("fused", "two-pass"):
        with pytest.raises(libmpm.SceneError, match="body 'block' asks for more: material Cam"):
            plan(scene, pipeline=asked)


# ---- what a step does ---------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_mixed_is_phased(method, dimension, device):
    """The same discretisation. Not the same bits: a fused step adds up a cell's sums before they
    go to the grid, a phased one particle by particle."""
    transfer, fbar = METHODS[method]
    scene = pool(dimension, transfer=transfer, fbar=fbar)
    mixed, phased = (
        states(scenes.specification(scene, pipeline=p), 60, device) for p in ("auto", "phased")
    )
    for a, b in zip(mixed, phased, strict=True):
        assert np.abs(a - b).max() < 1e-10 * np.abs(b).max()
    assert np.abs(mixed[1]).max() > 0.3


@pytest.mark.gpu
@pytest.mark.parametrize("device", ["cuda"], indirect=True)
@pytest.mark.parametrize("method", METHODS)
def test_mixed_is_phased_in_single_precision(method, device):
    transfer, fbar = METHODS[method]
    scene = pool(3, transfer=transfer, fbar=fbar)
    mixed, again, phased = (
        states(scenes.specification(scene, precision="single", pipeline=p), 60, device)
        for p in ("auto", "by-body", "phased")
    )
    for a, b, c in zip(mixed, again, phased, strict=True):
        assert np.array_equal(a, b)
        assert np.abs(a - c).max() < 2e-3 * np.abs(c).max()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_water_that_touches_nothing_has_its_bits(method, dimension):
    """Beside a phased body with which it shares no node, water has the bits of water alone."""
    transfer, fbar = METHODS[method]
    found = []
    for solid in (True, False):
        scene = pool(dimension, transfer=transfer, fbar=fbar, solid=solid, apart=True)
        spec = scenes.specification(scene)
        spec["time_step"] = 5e-4
        found.append(states(spec, 40, "cpu", bodies=[0]))
    for a, b in zip(*found, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("form", ["one-volume-gradient", "split"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_against_the_naive_method(dimension, form, device):
    """Fused water above a solid with F-bar, which has no such form on the CPU, and split none."""
    spec = choose(scenes.specification(scenes.crowded(dimension)), "APIC")
    spec["bodies"][0]["fbar"] = {"form": "one-volume-gradient", "time": 0.0, "ratio": 0.6}
    spec["bodies"][1]["fbar"] = {"form": form, "time": 0.0, "ratio": 0.3}
    agree(spec, device, 60 if dimension == 2 else 12)
    found = [body["pipeline"] for body in _core.plan(spec, device)["bodies"]]
    # In double precision a device has no fused form.
    apart = device == "cpu" or form == "split"
    one = "fused" if device == "cpu" else "two-pass"
    assert found == [one, "phased" if apart else "two-pass"]


@pytest.mark.parametrize("method", METHODS)
def test_threads_change_no_bit(method):
    transfer, fbar = METHODS[method]
    one, two = (
        states(scenes.specification(pool(3, transfer=transfer, fbar=fbar), threads=n), 40, "cpu")
        for n in (1, 2)
    )
    assert all(np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def test_energies_of_all_bodies(device):
    scene = pool()
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=1e-6))
    sim = libmpm.Simulation(scene, device=device, precision="double")
    sim.step(30)
    series = sim.sensors["energy"]
    kinetic = np.asarray(series.values)[:, series.components.index("kinetic")]
    again = libmpm.Simulation(scene, device=device, precision="double", pipeline="phased")
    again.step(30)
    expected = np.asarray(again.sensors["energy"].values)[:, series.components.index("kinetic")]
    assert kinetic == pytest.approx(expected, rel=1e-9)


# ---- a run that goes on -------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
def test_a_resumed_run_has_the_bits(tmp_path, method, device):
    transfer, fbar = METHODS[method]
    sim = libmpm.Simulation(
        pool(transfer=transfer, fbar=fbar), device=device, precision="double", threads=1
    )
    sim.step(25)
    sim.save_checkpoint(tmp_path / "half.npz")
    again = libmpm.Simulation.resume(tmp_path / "half.npz")
    assert again.pipeline == sim.pipeline
    for run in (sim, again):
        run.step(25)
    for name in ("water", "block"):
        for field in ("position", "velocity"):
            a, b = (np.asarray(r.particles[name][field]) for r in (sim, again))
            assert np.array_equal(a, b)


def test_a_phased_run_stays_phased(tmp_path):
    """What was asked for, and what runs of versions with one pipeline a scene had."""
    sim = libmpm.Simulation(pool(), device="cpu", pipeline="phased")
    sim.step(5)
    sim.save_checkpoint(tmp_path / "phased.npz")
    assert libmpm.Simulation.resume(tmp_path / "phased.npz").pipeline == "phased"


def test_ranks_have_each_body_by_its_own():
    one, two = (libmpm.Simulation(pool(), device=d) for d in ("cpu", ["cpu", "cpu"]))
    for sim in (one, two):
        assert "block" in sim.plan.pipeline_reason
        sim.step(60)
    for body in one.particles:
        rows = [sim.gather(body, "position", "velocity", "stress") for sim in (one, two)]
        for name in rows[0]:
            assert (rows[0][name] == rows[1][name]).all(), (body, name)
