"""A saved state goes on under another pipeline, precision or device, within rounding."""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm._src.run import backends
from support import scenes
from support.devices import device  # noqa: F401

pytest.importorskip("libmpm._core")

FUSED, HALVES = ("double", "fused"), ("double", "two-pass")
SINGLE, DOUBLE = ("single", "auto"), ("double", "auto")


def build(kind, where):
    spec = scenes.specification(
        scenes.crowded(3), precision=kind[0], pipeline=kind[1] if where == "cpu" else "auto"
    )
    return scenes.engine(spec, where)


@pytest.mark.parametrize(
    ("before", "after", "bound"),
    [
        (FUSED, HALVES, 1e-11),
        (HALVES, FUSED, 1e-11),
        (SINGLE, DOUBLE, 2e-4),
        (DOUBLE, SINGLE, 2e-4),
    ],
)
def test_the_run_goes_on_elsewhere(before, after, bound, device):  # noqa: F811
    """Saved on the CPU, continued on `device`; against the run that was never interrupted.

    Offsets are in cells, so the bound for single precision is some hundred steps of its rounding,
    6e-8, grown by the collision that the scene is made of.
    """
    first = build(before, "cpu")
    scenes.advance(first, 60)
    start = scenes.by_id(first, 0, "position")
    second = build(after, device)
    second.load(first.save())
    assert second.time == first.time
    assert np.abs(scenes.by_id(second, 0, "position") - start).max() < 1e-7
    for machine in (first, second):
        scenes.advance(machine, 60)
    moved = np.abs(scenes.by_id(first, 0, "position") - start).max()
    assert moved > 0.01
    for body in range(2):
        apart = scenes.by_id(second, body, "position") - scenes.by_id(first, body, "position")
        assert np.abs(apart).max() < bound * 0.1


def test_what_cannot_fit_is_refused_with_the_numbers_of_the_plan(monkeypatch):
    simulation = libmpm.Simulation(scenes.crowded(2), device="cpu")
    monkeypatch.setattr(backends, "memory_free", lambda _: 1000)
    with pytest.raises(libmpm.CapacityError, match=r"plan asks for .* MiB \(particles .*cell_size"):
        simulation.step(1)
    monkeypatch.undo()
    simulation.step(1)
    assert simulation.steps == 1
