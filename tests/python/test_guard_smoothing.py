"""A guard says where smoothing over cells takes what a body must hold, and nothing of what is well.

Bars of Yang (2016) 3.6 (T2, T3 of the digest's section 10). Expected duration: 2 s.
"""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.run.guard_watch import Watch
from support.bars import LENGTH, YOUNG, Bar
from support.devices import device  # noqa: F401

LOAD = -10e3  # N/m


def bar(folder, method, *, cells=4, courant=0.1, guard=True, **how):
    """Return a bar that swings under a sudden load, as a simulation."""
    made = Bar(
        folder, cells, load=LOAD, courant=courant, modified=True, damping=0.02,
        smoothing=libmpm.methods.Smoothing(method=method), **how,
    )  # fmt: skip
    simulation = libmpm.Simulation(
        made.scene, device="cpu", precision="double", threads=1, guard=guard
    )
    return simulation, made.begin


def warned(run):
    """Return what a run is warned of, as texts."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        run()
    # What the collector finds of earlier tests, files left open say, is warned of meanwhile.
    return [str(w.message) for w in seen if issubclass(w.category, libmpm.ModelWarning)]


@pytest.mark.parametrize("method", ["F0", "NB"])
def test_a_bar_that_gives_way_is_named_once(tmp_path, method):
    simulation, begin = bar(tmp_path, method)
    texts = warned(lambda: simulation.run(until=5.0, progress=False))
    # The outermost particle of three a cell; at rest the end moves by q L² / 2 E.
    rest = LENGTH * (1 - 0.5 / 12)
    end = simulation.particles["bar"]["position"][:, 0].max() - begin
    settled = rest + LOAD * LENGTH**2 / 2 / YOUNG
    assert abs(end - settled) > 0.5 * abs(settled - rest), "it holds its load after all"
    assert len(texts) == 1
    for part in ("body 'bar'", f"smoothing '{method}'", "at most", "step 1000", "'F0AL1'", "'C0'",
                 "more cells", "Guard(smoothing=None)"):  # fmt: skip
        assert part in texts[0]
    # How much of the most that it held, by the record that users read.
    record = simulation.smoothing["bar"]
    before = record["time"] < simulation.dt * 999.5
    held = record["energy"][before].max()
    times = -record["energy_change"][before].sum() / held
    said = float(re.search(r"has taken ([\d.]+) times", texts[0])[1])
    assert said == pytest.approx(times, rel=0.01)
    assert times > 5


@pytest.mark.parametrize("method", ["F0AL1", "C0"])
@pytest.mark.parametrize("every", [50, 1000])
def test_a_bar_that_holds_is_left_alone(tmp_path, method, every):
    simulation, _ = bar(tmp_path, method, guard=libmpm.Guard(every=every))
    assert warned(lambda: simulation.run(until=5.0, progress=False)) == []


def test_a_limiter_that_fails_is_named_too(tmp_path):
    """Free, on four cells: F0AL1 loses the bar as well, C0 does not (digest 9.2)."""
    for method, count in (("F0AL1", 1), ("C0", 0)):
        simulation, _ = bar(tmp_path, method, free=True)
        texts = warned(lambda run=simulation: run.run(until=3.0, progress=False))
        assert len(texts) == count, texts
        assert all("'C0'" in t and "limiter" not in t for t in texts)


def test_none_leaves_it_unwatched_and_bits_are_the_same(tmp_path):
    states = []
    for guard in (libmpm.Guard(smoothing=None), libmpm.Guard(every=100), None):
        simulation, _ = bar(tmp_path, "F0", guard=guard)
        texts = warned(lambda run=simulation: run.step(1200))
        assert len(texts) == (guard is not None and guard.smoothing is not None)
        states.append(simulation.engine.save())
    for name, array in states[0].items():
        for other in states[1:]:
            assert array.tobytes() == other[name].tobytes(), name


def test_a_resumed_run_says_the_same_and_once(tmp_path):
    whole, _ = bar(tmp_path, "F0")
    texts = warned(lambda: whole.step(2200))
    early, late = tmp_path / "early.npz", tmp_path / "late.npz"
    first, _ = bar(tmp_path, "F0")
    assert warned(lambda: (first.step(640), first.save_checkpoint(early))) == []
    again = libmpm.Simulation.resume(early)
    assert warned(lambda: (again.step(800), again.save_checkpoint(late))) == texts
    more = libmpm.Simulation.resume(late)
    assert warned(lambda: more.step(760)) == []


def test_water_that_breaks_is_smoothed_and_not_warned_of(device):  # noqa: F811
    """Motion makes noise that smoothing takes, many times what water holds: as it should."""
    scene = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=(1, 1), cell_size=0.05, gravity=(0.0, -9.81)
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(0.4, 0.8)),
        material=materials.TaitFluid(bulk_modulus=4e5),
        smoothing=libmpm.methods.Smoothing(method="F0AL1"),
    )  # fmt: skip
    simulation = libmpm.Simulation(scene, device=device, guard=libmpm.Guard(every=100), threads=1)
    assert warned(lambda: simulation.step(1200)) == []
    record = simulation.smoothing["water"]
    assert -record["energy_change"].sum() > 2 * record["energy"].max()


def test_a_scene_without_it_is_not_asked(monkeypatch):
    monkeypatch.setattr(Watch, "_record", lambda *_: pytest.fail("asked"))
    scene = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=(1, 1), cell_size=0.1, gravity=(0.0, -9.81)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.3, 0.3), upper=(0.6, 0.6)),
        material=materials.TaitFluid(bulk_modulus=4e5),
    )  # fmt: skip
    simulation = libmpm.Simulation(scene, device="cpu", guard=libmpm.Guard(every=5), threads=1)
    simulation.step(12)


@pytest.mark.parametrize(("courant", "error"), [(0.9, "SceneError"), (0.3, "NumericalError")])
def test_steps_too_long_are_named_and_no_array_has_a_nan(tmp_path, courant, error):
    """Above the limit the scene is refused; below it bars break at the first crossing of a cell."""
    with pytest.raises(getattr(libmpm, error)) as caught:
        simulation, _ = bar(tmp_path, "F0AL1", cells=64, courant=courant)
        simulation.run(until=1.0, progress=False)
    assert "body 'bar'" in str(caught.value)
    if error == "NumericalError":
        assert re.search(r"particle \d+: .* at step \d+", str(caught.value))
        assert "Method.cfl" in str(caught.value)
        view = simulation.particles["bar"]
        for name in ("position", "velocity", "stress"):
            assert np.isfinite(view[name]).all(), name
        for values in simulation.smoothing["bar"].values():
            assert np.isfinite(values).all()
