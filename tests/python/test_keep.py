"""Stored velocities in the fused step: the discretisation of the phased one, for less.

Expected duration: 20 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import math

import numpy as np
import pytest

import libmpm
from libmpm import FBar, Method, materials, sensors
from libmpm.methods import Transfer
from support import scenes
from support.devices import device  # noqa: F401
from support.methods_reference import choose

SHIFTS = {"flip": 0.95, "shift_max": 0.3, "shift_min": 0.05, "critical_ratio": 1.0}
CHOICES = {
    "FLIP": {},
    "PIC-FLIP": {"flip": 0.9},
    "AFLIP": {"flip": 0.9},
    "NFLIP": {"flip": 0.9},
    "SFLIP": SHIFTS,
    "ASFLIP": SHIFTS,
}
#: Without F-bar, one volume with and without its gradient, two volumes, and stress alone.
FORMS = [None, "one-volume-gradient", "one-volume", "two-volume", "stress-only"]


def pool(dimension, pipeline, scheme="ASFLIP", form="one-volume-gradient", *, precision="double",
         beside=False, threads=1, **shifts):  # fmt: skip
    """Water that falls between walls and around a box that slides; with `beside` a second fluid."""
    fbar = None if form is None else FBar(form=form, ratio=0.3)
    scene = scenes.crowded(dimension, fbar=fbar, moving=True)
    spec = scenes.specification(scene, precision=precision, pipeline=pipeline, threads=threads)
    block = spec["bodies"].pop()
    if beside:
        heavy = dict(spec["bodies"][0], name="brine", first_id=block["first_id"])
        heavy |= {k: block[k] for k in ("position", "count", "bounds", "velocity", "particle_mass")}
        heavy |= {
            "parameters": [600.0, 2e5, 7.0, 1.0],
            "pressure": None,
            "fbar": {"form": "none", "time": 0.0, "ratio": 0.0},
        }
        spec["bodies"].append(heavy)
    return choose(spec, scheme, **(CHOICES[scheme] | shifts))


def states(spec, steps, device, names=("position", "velocity", "pressure")):
    machine = scenes.engine(spec, device)
    scenes.advance(machine, steps)
    return [
        scenes.by_id(machine, b, name) for b in range(len(spec["bodies"])) for name in names
    ]  # fmt: skip


def distance(a, b):
    """The largest difference of two fields, relative to the largest value."""
    return np.abs(a - b).max() / np.abs(a).max()


def equal_to_rounding(pipeline, device, dimension, scheme, form):
    """The same sums in another order as in phases, which 60 steps of a splash let grow."""
    found, phased = (
        states(pool(dimension, p, scheme, form), 60, device) for p in (pipeline, "phased")
    )
    for a, b in zip(found, phased, strict=True):
        assert distance(a, b) < 1e-9


def equal_in_single_precision(pipeline, device, dimension, precision):
    """To the phased step: a device adds integers of 32 bits."""
    found, phased = (
        states(pool(dimension, p, precision=precision), 40, device, ("position", "velocity"))
        for p in (pipeline, "phased")
    )
    assert np.abs(found[0] - phased[0]).max() < 2e-5 * 0.1
    assert np.abs(found[1] - phased[1]).max() < 2e-3 * np.abs(phased[1]).max()


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("scheme", CHOICES)
@pytest.mark.parametrize("dimension", [2, 3])
def test_fused_is_phased(dimension, scheme, form):
    equal_to_rounding("fused", "cpu", dimension, scheme, form)


@pytest.mark.gpu
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("scheme", CHOICES)
@pytest.mark.parametrize("dimension", [2, 3])
def test_two_passes_are_phased(dimension, scheme, form):
    """In double precision, in which a device adds integers of 64 bits."""
    equal_to_rounding("two-pass", "cuda", dimension, scheme, form)


@pytest.mark.gpu
@pytest.mark.parametrize("dimension", [2, 3])
def test_two_passes_in_mixed_precision(dimension):
    equal_in_single_precision("two-pass", "cuda", dimension, "mixed")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("scheme", ["APIC", "AFLIP"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_mud_in_one_pass(dimension, scheme, form):
    """A law of the shear rate, whose packs of particles take powers and exponentials."""
    found = []
    for pipeline in ("fused", "phased"):
        spec = pool(dimension, pipeline, "AFLIP", form)
        spec["bodies"][0] |= {
            "material": "HerschelBulkleyFluid",
            "parameters": {
                "density": 1000.0,
                "bulk_modulus": 2e5,
                "exponent": 7.15,
                "yield_stress": 20.0,
                "consistency": 2.0,
                "index": 0.7,
                "largest_viscosity": 40.0,
            },
        }
        found.append(states(choose(spec, scheme), 60, "cpu"))
    for a, b in zip(*found, strict=True):
        assert distance(a, b) < 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("change", [
    {"rule": "smooth", "width": 0.002, "power": 2},
    {"rule": "smooth", "width": 0.002, "power": 3.5, "below": "zero"},
    {"guard": False},
])  # fmt: skip
def test_every_rule_of_the_shift(dimension, change):
    spec = [pool(dimension, p, **change) for p in ("fused", "phased")]
    for a, b in zip(*(states(s, 60, "cpu") for s in spec), strict=True):
        assert distance(a, b) < 1e-9


@pytest.mark.parametrize("dimension", [2, 3])
def test_single_precision(dimension, device):
    equal_in_single_precision("fused", device, dimension, "single")


def test_what_is_given_is_what_moves(device):
    """A shift changes where particles go, and a share what they keep."""
    plain, shifted = (
        states(pool(2, "fused", "SFLIP", precision="single", shift_max=s, shift_min=s), 40, device)
        for s in (0.0, 1.0)
    )
    assert distance(plain[0], shifted[0]) > 1e-5


def test_a_halt_and_a_checkpoint_change_no_bit(device):
    """Stored velocities are columns like others, their sums channels like others."""
    spec = pool(2, "fused", precision="single")
    whole = scenes.engine(spec, device)
    scenes.advance(whole, 40)
    first = scenes.engine(spec, device)
    scenes.advance(first, 17)
    second = scenes.engine(spec, device)
    second.load(first.save())
    scenes.advance(second, 23)
    for name in ("position", "velocity"):
        assert np.array_equal(scenes.by_id(whole, 0, name), scenes.by_id(second, 0, name))


def test_threads_change_no_bit():
    found = [states(pool(3, "fused", threads=n), 20, "cpu") for n in (1, 2)]
    for a, b in zip(*found, strict=True):
        assert np.array_equal(a, b)


def water(dimension=2, *, material=None, transfer, **options):
    scene = libmpm.Scene(
        dimension=dimension, cell_size=0.1, lower=(0.0,) * dimension, upper=(1.6,) * dimension,
        method=Method(transfer=transfer), gravity=(0.0,) * dimension,
    )  # fmt: skip
    scene.add_body(
        name="body",
        shape=libmpm.shapes.Box(lower=(0.4,) * dimension, upper=(1.2,) * dimension),
        material=material or materials.TaitFluid(bulk_modulus=1e4),
        **options,
    )
    return scene


def test_energy_is_of_the_stored_velocities():
    """The sensor adds up what particles store: of a body at one velocity, that."""
    scene = water(transfer=Transfer(scheme="AFLIP", flip=0.9), velocity=(0.3, -0.2), fbar=None)
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    spec = scenes.specification(scene)
    machine = scenes.engine(spec)
    scenes.advance(machine, 10)
    values = machine.drain()[0][1]
    kinetic = values[-1][machine.sensor_columns(0)[0].index("kinetic")]
    assert kinetic == pytest.approx(machine.attribute(0, "kinetic_energy").sum(), rel=1e-9)
    total = 0.5 * machine.attribute(0, "mass").sum() * (0.3**2 + 0.2**2)
    assert kinetic == pytest.approx(total, rel=1e-9)


def test_who_has_it():
    def pipeline(**options):
        return water(**options).plan(device="cpu", precision="double").pipeline

    aflip = Transfer(scheme="AFLIP", flip=0.9)
    assert pipeline(transfer=aflip) == "fused"
    assert pipeline(transfer=aflip, fbar=FBar(form="split", ratio=0.9)) == "phased"
    assert pipeline(transfer=Transfer(scheme="FMPM", every=2)) == "phased"
    assert pipeline(transfer=Transfer(scheme="XPIC")) == "phased"
    solid = materials.FixedCorotated(density=1000.0, youngs_modulus=1e5)
    assert pipeline(transfer=aflip, material=solid) == "fused"
    mud = materials.HerschelBulkleyFluid(
        density=1e3, bulk_modulus=1e4, yield_stress=10.0, consistency=1.0, largest_viscosity=10.0
    )
    assert pipeline(transfer=aflip, material=mud) == "fused"
    clay = materials.CamClay(density=1000.0, youngs_modulus=1e5, log_plastic_volume=-0.02)
    assert pipeline(transfer=aflip, material=clay) == "phased"
    # On a device single precision alone has a fused form.
    scene = water(transfer=aflip)
    assert scene.plan(device="cuda", precision="single").pipeline == "fused"
    for precision in ("double", "mixed"):
        plan = scene.plan(device="cuda", precision=precision, pipeline="two-pass")
        assert scene.plan(device="cuda", precision=precision).pipeline == plan.pipeline
        assert plan.pipeline == "two-pass"
        assert {"gather:body", "scatter:body"} <= set(plan.kernels)
    with pytest.raises(libmpm.SceneError, match="two-pass"):
        scene.plan(device="cpu", pipeline="two-pass")


def test_a_step_stores_no_deposits():
    """What the fused form saves: the columns between the parts of the phased one."""
    scene = water(transfer=Transfer(scheme="AFLIP", flip=0.9), fbar=None)
    fused, phased = (scene.plan(device="cpu", pipeline=p) for p in ("fused", "phased"))
    assert set(phased.columns("body")) - set(fused.columns("body")) == {"deposit"}
    assert fused.channels == phased.channels


def test_fast_particles_call_for_a_sort():
    """Shifts are in no bound on the drift: who goes far from home makes the clock sort in time."""
    spec = pool(2, "fused", "NFLIP", None, flip=1.0)
    rng = np.random.default_rng(3)
    body = spec["bodies"][0]
    body["velocity"] = rng.normal(0.0, 4.0, body["position"].shape)
    machine = scenes.engine(spec)
    report = machine.run(150, math.inf, 60.0)
    assert report["reason"] == "steps", report
    assert machine.statistics()["sorts"] >= 3
    assert np.isfinite(machine.attribute(0, "position")).all()
