"""The engine against the naive method of `support.reference`, both from the same specification.

Expected duration: 20 s, nearly all of it the naive method.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from support import scenes
from support.devices import device  # noqa: F401
from support.reference import Reference
from support.tolerances import REFERENCE

FORMS = {
    "none": None,
    "one-volume": libmpm.FBar(form="one-volume"),
    "one-volume-gradient": libmpm.FBar(),
    "ratio": libmpm.FBar(form="one-volume-gradient", ratio=0.3),
    "two-volume": libmpm.FBar(form="two-volume", length=0.2),
    "stress-only": libmpm.FBar(form="stress-only"),
}


def compare(scene, device, steps=60, pipeline="auto"):
    """Run both; every stored and derived quantity agrees to rounding."""
    spec = scenes.specification(scene, pipeline=pipeline)
    machine, naive = scenes.engine(spec, device), Reference(spec)
    assert sum(body["count"] for body in spec["bodies"]) < 1000
    scenes.advance(machine, steps)
    naive.run(steps)
    assert machine.time == pytest.approx(naive.time, rel=1e-12)
    for k, body in enumerate(spec["bodies"]):
        position = scenes.by_id(machine, k, "position")
        velocity = scenes.by_id(machine, k, "velocity")
        expected = naive.velocity(k)[0]
        assert np.abs(position - naive.position[k]).max() < REFERENCE * naive.dx
        assert np.abs(velocity - expected).max() < REFERENCE * max(np.abs(expected).max(), 1e-3)
        if body["material"] == "TaitFluid":
            ratio = scenes.by_id(machine, k, "volume_ratio")
            assert np.abs(ratio - (1 - naive.j[k])).max() < REFERENCE
        else:
            gradient = scenes.by_id(machine, k, "deformation_gradient")
            assert np.abs(gradient - np.eye(naive.d) - naive.h[k]).max() < REFERENCE
    return machine, naive


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("dimension", [2, 3])
def test_everything_at_once(dimension, form, device):
    steps = 100 if dimension == 2 else 40
    compare(scenes.crowded(dimension, fbar=FORMS[form]), device, steps)


@pytest.mark.parametrize("dimension", [2, 3])
def test_moving_box_and_turning_gravity(dimension, device):
    steps = 100 if dimension == 2 else 40
    compare(scenes.crowded(dimension, moving=True), device, steps)


@pytest.mark.parametrize("pipeline", ["fused", "two-pass"])
def test_either_pipeline(pipeline):
    compare(scenes.crowded(2), "cpu", 60, pipeline)


def test_speed_limits_the_step(device):
    """A body faster than half a cell per step shortens the step."""
    scene = scenes.free_body(2, velocity=(30.0, 4.0))
    machine, naive = compare(scene, device, 8)
    assert naive.dt < 0.9 * naive.dt_limit
    assert machine.time_step == pytest.approx(naive.dt, rel=1e-12)


def test_load_cells(device):
    """Momentum that the boundaries take out, summed over the samples."""
    scene = scenes.crowded(2)
    steps = 100
    sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
    naive = Reference(scenes.specification(scene))
    sim.step(steps)
    for k, name in enumerate(("walls", "step")):
        time, length, pushed = scenes.force(sim, name)
        found = (pushed * length[:, None]).sum(axis=0)
        while naive.time < time[-1] - 1e-9:
            naive.step()
        expected = sum(naive.impulse[k].values())
        assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
