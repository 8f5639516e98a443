"""The forms of F-bar: what each does to a field of volume, to a tank, and to solids.

Fields of volume loss are given to water so soft, or stepped so finely, that it stands still: what
changes the field is then F-bar alone. Expected duration: 15 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import dataclasses

import numpy as np
import pytest

import libmpm
import libmpm.cases
from libmpm import FBar, materials, shapes
from libmpm.cases import Options
from support import scenes
from support.devices import device  # noqa: F401

DX, CELLS, HALF_WAVES = 0.1, 64, 6
MODULUS = 1e6
#: Phase of the sound wave, k dx c dt / dx, that passes in a thousand such steps: 3e-4.
STILL = 1e-6 * DX / np.sqrt(MODULUS / scenes.WATER)
K = np.pi * HALF_WAVES / (CELLS * DX)  # 1/m, k Δx = 0.29
AMPLITUDE = 1e-5

FORMS = {
    "one-volume-gradient": FBar(ratio=0.1),
    "one-volume": FBar(form="one-volume", ratio=0.1),
    "two-volume": FBar(form="two-volume", length=3 * DX),
    "stress-only": FBar(form="stress-only", ratio=0.9),
    "split": FBar(form="split", length=3 * DX),
    "literal": FBar(form="literal", length=3 * DX),
}
EVERY = pytest.mark.parametrize("form", FORMS)
SOLIDS = {
    "FixedCorotated": materials.FixedCorotated,
    "NeoHookean": materials.NeoHookean,
    "StVenantKirchhoffHencky": materials.StVenantKirchhoffHencky,
    "VonMises": materials.VonMises,
}


# ---- fields in still water ----------------------------------------------------------------------


def slab(fbar, *, cells=(CELLS, 4), lower=(4 * DX, 4 * DX), scene=None, name="water"):
    """Water of so many cells in an empty domain without walls and gravity."""
    size = np.array(cells) * DX
    if scene is None:
        upper = tuple(np.array(lower) + size + 4 * DX)
        scene = libmpm.Scene(dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=upper)
    scene.add_body(
        name=name,
        shape=shapes.Box(lower=lower, upper=tuple(np.array(lower) + size)),
        material=materials.TaitFluid(density=scenes.WATER, bulk_modulus=MODULUS, viscosity=0.0),
        fbar=fbar,
    )
    return scene


class Wave:
    """A cosine of the volume loss over the slab, with crests at its ends."""

    def __init__(self, fbar, device, time_step=STILL, speed=0.0):
        spec = scenes.specification(slab(fbar))
        body = spec["bodies"][0]
        x = body["position"][:, 0] - 4 * DX
        self.shape = np.cos(K * x)
        # Away from the ends, over whole waves.
        self.middle = (x > 2 * np.pi / K) & (x < CELLS * DX - 2 * np.pi / K)
        body["pressure"] = MODULUS * AMPLITUDE * self.shape
        body["velocity"] = np.stack([-speed * np.sin(K * x), 0 * x], axis=1)
        spec["time_step"] = time_step
        self.machine = scenes.engine(spec, device)

    def step(self, count):
        scenes.advance(self.machine, count)
        return self

    def speed(self):
        """Amplitude of the sine in the velocity along x, m/s."""
        x = scenes.by_id(self.machine, 0, "position")[self.middle, 0] - 4 * DX
        v = scenes.by_id(self.machine, 0, "velocity")[self.middle, 0]
        return float(np.sin(K * x) @ v / np.sum(np.sin(K * x) ** 2))

    def of(self, name):
        """Amplitude of the cosine in what a reader sees, parts of the one at the start."""
        found = scenes.by_id(self.machine, 0, name)
        loss = found / MODULUS if name == "pressure" else 1 - found
        shape, loss = self.shape[self.middle], loss[self.middle]
        return float(shape @ loss / (shape @ shape)) / AMPLITUDE


@pytest.mark.parametrize("form", ["two-volume", "split", "literal"])
@pytest.mark.parametrize("cells", [1.0, 3.0])
def test_two_volumes_are_a_filter_of_the_given_length(form, cells, device):
    """1 / (1 + (k l)²), whatever the time step, while the stored volume stays.

    The mean over particles and nodes is 1 - (k Δx)²/4 + O((k Δx)⁴), k Δx = 0.29: of 1 - it 2 %, and
    at most as much of 1 - amplitude.
    """
    length = cells * DX
    expected = 1 / (1 + (K * length) ** 2)
    found = []
    for factor in (1.0, 0.25):
        wave = Wave(FBar(form=form, length=length), device, STILL * factor).step(600)
        assert wave.of("volume_ratio") == pytest.approx(1, abs=1e-4)
        found.append(wave.of("volume_ratio_smoothed"))
        assert wave.of("pressure") == pytest.approx(found[-1], abs=1e-4)
    assert abs(found[0] - expected) < 0.02 * (1 - expected)
    assert abs(found[1] - found[0]) < 1e-4


@pytest.mark.parametrize("choice", ["ratio", "time"])
def test_one_volume_diffuses(choice, device):
    """The cosine decays with the diffusivity psi Δx² / (4 Δt), which is Δx² / (4 τ)."""
    ratio, steps = 0.05, 600
    fbar = {"ratio": ratio} if choice == "ratio" else {"time": -STILL / np.log1p(-ratio)}
    wave = Wave(FBar(form="one-volume", **fbar), device).step(steps)
    rate = -np.log(wave.of("volume_ratio")) / steps
    assert rate == pytest.approx(ratio * (K * DX) ** 2 / 4, rel=0.03)
    assert wave.of("pressure") == pytest.approx(wave.of("volume_ratio"), abs=1e-6)


def test_the_gradient_removes_the_diffusion(device):
    """What is left is of fourth order: (k Δx)⁴ / 16 a pass or less instead of (k Δx)² / 4."""
    ratio, steps = 0.05, 600
    wave = Wave(FBar(ratio=ratio), device).step(steps)
    rate = -np.log(wave.of("volume_ratio")) / steps
    assert 0 < rate < ratio * (K * DX) ** 4 / 16


def test_stress_only_averages_once(device):
    """The stored volume stays; from the second step on it pushes 1 - psi (k Δx)²/4 as much.

    The pressure that a reader sees is that of the stored volume.
    """
    ratio, steps = 0.9, 101
    speeds = []
    for fbar in (FBar(form="stress-only", ratio=ratio), None):
        wave = Wave(fbar, device).step(steps)
        assert wave.of("volume_ratio") == pytest.approx(1, abs=1e-4)
        assert wave.of("pressure") == pytest.approx(1, abs=1e-4)
        speeds.append(wave.speed())
    lost = (1 - speeds[0] / speeds[1]) * steps / (steps - 1)
    assert lost == pytest.approx(ratio * (K * DX) ** 2 / 4, rel=0.03)


@EVERY
def test_uniform_volume_is_left_alone(form, device):
    """Of equal volumes the average is the same, up to the free edges."""
    spec = scenes.specification(slab(FORMS[form], cells=(8, 8)))
    spec["bodies"][0]["pressure"] = np.full(spec["bodies"][0]["count"], MODULUS * 1e-3)
    spec["time_step"] = STILL
    machine = scenes.engine(spec, device)
    before = machine.attribute(0, "volume_ratio")[0]
    scenes.advance(machine, 50)
    assert np.abs(machine.attribute(0, "volume_ratio") - before).max() < 1e-8
    assert np.ptp(machine.attribute(0, "pressure")) < 1e-8 * MODULUS


# ---- split and literal --------------------------------------------------------------------------


def squeezed(fbar, device, steps, speed=50.0):
    """Volumes in the middle of a slab that shrinks evenly, after each of the steps."""
    spec = scenes.specification(slab(fbar, cells=(48, 48)))
    body = spec["bodies"][0]
    offset = body["position"] - body["position"].mean(axis=0)
    body["velocity"] = -speed * offset
    spec["time_step"] = 1e-5
    machine = scenes.engine(spec, device)
    middle = np.abs(offset).max(axis=1) < 4 * DX
    found = []
    for _ in range(steps):
        scenes.advance(machine, 1)
        found.append(scenes.by_id(machine, 0, "volume_ratio_smoothed")[middle])
    return np.array(found)


def test_literal_is_a_step_late(device):
    """Shrinking from rest: all of it shows one step after it does with two volumes."""
    settings = {"ratio": 1.0}
    now = squeezed(FBar(form="two-volume", **settings), device, 5)
    split = squeezed(FBar(form="split", **settings), device, 5)
    late = squeezed(FBar(form="literal", **settings), device, 5)
    shrinks = 1 - now[0]
    assert shrinks.min() > 9e-4  # 2 dt speed
    assert np.abs(late[0] - 1).max() < 1e-10
    assert np.abs(late[1:] - now[:-1]).max() < 1e-10
    assert np.abs(split - now).max() < 1e-10


def test_split_tends_to_two_volumes(device):
    """Where the volume changes at an uneven rate they differ by a part of what a step changes.

    With e cos(k x) a step: two volumes average before it, split after it, so that their difference
    d obeys d = psi (1 - (k Δx)²/4) d + psi (k Δx)²/4 e, and d = e (k l)² / (1 + (k l)²).
    """
    length, steps = 2 * DX, 400
    differences = []
    for time_step in (STILL, STILL / 2):
        volumes = {}
        for form in ("two-volume", "split"):
            wave = Wave(FBar(form=form, length=length), device, time_step, speed=1.0).step(steps)
            before = wave.of("volume_ratio")
            wave.step(1)
            volumes[form] = wave.of("volume_ratio_smoothed")
        change = wave.of("volume_ratio") - before
        square = (K * length) ** 2
        differences.append(volumes["split"] - volumes["two-volume"])
        assert differences[-1] == pytest.approx(-change * square / (1 + square), rel=0.05)
    assert differences[0] / differences[1] == pytest.approx(2, abs=0.01)


# ---- tanks --------------------------------------------------------------------------------------


def test_split_keeps_a_tank_at_rest(device):
    """Bounds of the tank at rest (40 cells, 1e5 steps by default), after a quarter of the steps.

    Its ringing, which decays within some 1e4 steps, is the last to come below its bound.
    """
    fbar = FBar(form="split", length=5 / 40)  # 5 cells: psi = 0.99
    result = libmpm.cases.run(
        "tank", options=Options(fbar=fbar), device=device, precision="double", threads=1,
        steps=24_000,
    )  # fmt: skip
    assert not result.failures, result.failures


@pytest.fixture(scope="module")
def unsmoothed():
    """Noise and checkerboard of the disordered tank without F-bar."""
    return disordered(None)


def disordered(fbar):
    """A disordered tank, twelve cells deep, after 3,000 steps: noise and checkerboard."""
    result = libmpm.cases.run(
        "tank", options=Options(fbar=fbar), precision="double", threads=1,
        cells=12, width=6, depth=0.3, steps=3000, jitter=0.1,
    )  # fmt: skip
    return np.array([result.values["noise"], result.values["checkerboard"]])


@EVERY
@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_checkerboard_of_a_disordered_tank(form, unsmoothed):
    """All but stress only smooth it; there the stored volume, which nothing smooths, runs away."""
    fbar = FORMS[form]
    if fbar.length is not None:
        fbar = dataclasses.replace(fbar, length=3 * 0.3 / 12)
    noise, board = disordered(fbar) / unsmoothed
    if form == "stress-only":
        assert noise > 1
    else:
        assert noise < 1
        assert board < 1


def test_forms_are_chosen_per_body(device):
    """Two bodies with forms of their own in one scene, far apart, move as each does alone."""
    places = {"two-volume": (4 * DX, 4 * DX), "one-volume": (4 * DX, 24 * DX)}

    def run(forms):
        scene = libmpm.Scene(
            dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=(1.6, 3.6), gravity=(0.0, -1.0)
        )
        for form in forms:
            slab(FORMS[form], cells=(8, 8), lower=places[form], scene=scene, name=form)
        spec = scenes.specification(scene)
        spec["time_step"] = 5e-4
        for body in spec["bodies"]:
            body["pressure"] = 1e3 * np.random.default_rng(4).uniform(-1, 1, body["count"])
        machine = scenes.engine(spec, device)
        scenes.advance(machine, 100)
        return [
            [scenes.by_id(machine, k, name) for name in ("position", "velocity", "pressure")]
            for k in range(len(forms))
        ]

    both = run(tuple(places))
    for k, form in enumerate(places):
        for found, expected in zip(both[k], run((form,))[0], strict=True):
            assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    # And the form does make a difference.
    (_, _, p), (_, _, q) = both
    assert np.abs(p - q).max() > 1e-2 * np.abs(p).max()


# ---- solids -------------------------------------------------------------------------------------


def solid(name, fbar, velocity, *, precision="double", lower=(0.513, 0.726), size=(1.0, 0.6),
          cells=20):  # fmt: skip
    """The specification of a free block, 10 x 6 cells, whose particles move as they are told."""
    more = {"yield_stress": 2e3, "hardening_modulus": 1e4} if name == "VonMises" else {}
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=(cells * DX, cells * DX)
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=lower, upper=(lower[0] + size[0], lower[1] + size[1])),
        material=SOLIDS[name](density=1000.0, youngs_modulus=1e5, poissons_ratio=0.45, **more),
        fbar=fbar,
    )
    spec = scenes.specification(scene, precision=precision)
    body = spec["bodies"][0]
    offset = body["position"] - body["position"].mean(axis=0)
    body["velocity"] = np.asarray(velocity(offset))
    return spec


def shaken(offset):
    """Every particle its own way, 0.3 m/s, and a spin."""
    spin = np.stack([-offset[:, 1], offset[:, 0]], axis=1)
    return spin + 0.3 * np.random.default_rng(7).normal(size=offset.shape)


def run_solid(spec, device, steps, names=("position", "velocity", "volume_ratio")):
    machine = scenes.engine(spec, device)
    scenes.advance(machine, steps)
    return [scenes.by_id(machine, 0, name) for name in names]


@EVERY
@pytest.mark.parametrize("material", SOLIDS)
def test_a_quarter_turn_of_a_solid(material, form, device):
    spec = solid(material, FORMS[form], shaken)
    x, v, ratio = run_solid(spec, device, 40)
    assert np.ptp(ratio) > 1e-3
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    offset = np.array([20 * DX, 0.0])
    body = spec["bodies"][0]
    body["position"] = body["position"] @ turn.T + offset
    body["velocity"] = body["velocity"] @ turn.T
    corners = body["bounds"] @ turn.T + offset
    body["bounds"] = np.array([corners.min(axis=0), corners.max(axis=0)])
    y, w, turned = run_solid(spec, device, 40)
    assert np.abs(y - (x @ turn.T + offset)).max() < 1e-11
    assert np.abs(w - v @ turn.T).max() < 1e-10 * np.abs(v).max()
    assert np.abs(turned - ratio).max() < 1e-11


@EVERY
@pytest.mark.parametrize("material", SOLIDS)
def test_an_even_deformation_of_a_solid(material, form, device):
    """Where the volume is the same everywhere F-bar changes nothing, `literal` but for its delay.

    Compared away from the edges, whose nodes see no even field in the first deposit; what they do
    gets three cells further a step.
    """
    slope = np.array([[0.3, 0.5], [-0.2, 0.4]])

    def flow(offset):
        return offset @ slope.T

    steps, names = 2, ("position", "velocity", "volume_ratio", "stress")
    # On the cells: elsewhere even an even stress pushes the nodes a little, and late ones less.
    even = {"lower": (0.5, 0.7), "size": (2.0, 2.0), "cells": 32}
    spec = solid(material, None, flow, **even)
    offset = spec["bodies"][0]["position"] - spec["bodies"][0]["position"].mean(axis=0)
    middle = np.abs(offset).max(axis=1) < DX
    spec["time_step"] = 1e-3
    plain = run_solid(spec, device, steps, names)
    spec = solid(material, FORMS[form], flow, **even)
    spec["time_step"] = 1e-3
    smooth = run_solid(spec, device, steps, names)
    assert np.abs(plain[2][middle] - 1).min() > 1e-3
    for found, expected in zip(smooth[: 3 if form == "literal" else 4], plain, strict=False):
        assert np.abs(found - expected)[middle].max() < 1e-9 * np.abs(expected[middle]).max()


@pytest.mark.parametrize("form", [f for f in FORMS if f != "literal"])
def test_the_volume_of_a_solid_is_kept(form, device):
    """Averages only move volume between particles: what is left is of second order, <v²>/c².

    Not of the literal form, whose late pressure feeds the waves of an undamped solid until it
    breaks.
    """
    spec = solid("FixedCorotated", FORMS[form], shaken)
    modulus = 1e5 * (1 - 0.45) / (1 + 0.45) / (1 - 2 * 0.45)
    square = np.mean(np.sum(spec["bodies"][0]["velocity"] ** 2, axis=1)) * 1000 / modulus
    ratio = run_solid(spec, device, 400)[2]
    assert abs(ratio.mean() - 1) < square


@EVERY
@pytest.mark.parametrize("material", SOLIDS)
def test_single_precision_of_a_solid(material, form, device):
    found = {}
    for precision in ("double", "single"):
        spec = solid(material, FORMS[form], shaken, precision=precision)
        spec["time_step"] = 1e-3
        found[precision] = run_solid(spec, device, 50)
    for one, two in zip(*found.values(), strict=True):
        assert np.abs(one - two).max() < 1e-4 * np.abs(one).max()
