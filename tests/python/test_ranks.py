"""Several ranks share a scene: the bits of one, files as of one, resumed on another number.

Expected duration: 10 s.
"""

from __future__ import annotations

import sys

import numpy as np
import pytest

import libmpm
from libmpm._src import backends
from python import fake_engine


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
    """Particles to the bit, sensors to the rounding of their sums."""
    one, many = simulate(1), simulate(ranks)
    for sim in (one, many):
        sim.run(until=0.1)
    assert many.ranks == ranks
    assert same(one, many)
    for name in one.sensors:
        x, y = one.sensors[name], many.sensors[name]
        assert (x.time == y.time).all()
        size = np.nanmax(np.abs(x.values), initial=0)
        assert np.allclose(x.values, y.values, rtol=0, atol=1e-10 * size, equal_nan=True)


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


def test_a_step_that_is_not_built_says_so():
    """What several ranks cannot do is refused before it runs."""
    with pytest.raises(libmpm.SceneError, match="'phased' is not built for several ranks"):
        simulate(2, pipeline="phased").step(1)


def test_the_engine_is_told(monkeypatch):
    """One rank leaves no trace in the specification."""
    monkeypatch.setitem(sys.modules, "libmpm._core", fake_engine.module())
    assert "ranks" not in simulate(1).engine._spec
    assert simulate(2).engine._spec["ranks"] == {"count": 2}
    assert backends.parse_device(["cpu", "cpu"]) == ("cpu", 0)
    with pytest.raises(libmpm.DeviceError, match="several devices"):
        backends.parse_device(["cpu", "auto"])
