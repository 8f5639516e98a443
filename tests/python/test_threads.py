"""Threads: whoever reads, saves or draws a run of another thread changes none of its bits.

Expected duration: 3 s.
"""

import threading
import time
import warnings

import numpy as np
import pytest

import libmpm
from libmpm._src.run.thread_turns import Turns

END = 0.25


def simulation(new_scene, **changes):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        return libmpm.Simulation(new_scene(), device="cpu", **changes)


def same(a, b):
    assert (a.steps, a.time) == (b.steps, b.time)
    for body in a.particles:
        for name in ("id", "position", "velocity", "stress"):
            np.testing.assert_array_equal(a.particles[body][name], b.particles[body][name])
    for name in a.sensors:
        one, two = a.sensors[name], b.sensors[name]
        np.testing.assert_array_equal(one.time, two.time)
        np.testing.assert_array_equal(one.values, two.values)


def in_thread(work, **arguments):
    """Start a thread; the function returned waits for its end and raises what it has raised."""
    failed = []

    def guarded():
        try:
            work(**arguments)
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=guarded, name="runs it")
    thread.start()

    def join():
        thread.join()
        if failed:
            raise failed[0]

    return thread, join


def test_reading_from_another_thread_changes_no_bit(new_scene, tmp_path, monkeypatch):
    monkeypatch.setattr("libmpm._src.run.loop.SLICE", 0.005)  # so that there are many moments
    alone, read = simulation(new_scene), simulation(new_scene, output=tmp_path / "out")
    alone.run(until=END, progress=False)
    thread, join = in_thread(read.run, until=END, progress=False)
    moments = []
    while thread.is_alive():
        water, block = read.particles["water"], read.particles["block"]
        assert np.isfinite(water["velocity"]).all()
        assert np.isfinite(block["stress"]).all()
        assert read.statistics["sorts"] >= 0
        assert len(read.grid["velocity"])
        _ = read.dt, len(water), read.timings, [read.sensors[s].values for s in read.sensors]
        with read.paused():
            with read.device_arrays("water", "position") as arrays:
                position = arrays.position.to_numpy()
            np.testing.assert_array_equal(position, water["position"])
            assert len(read.grid["position"]) == len(read.grid["mass"])
            latest = [read.sensors[s].time for s in read.sensors]
            assert all(t[-1] <= read.time for t in latest if len(t))
            read.save_checkpoint(tmp_path / "moment.npz")
            moments.append((read.steps, read.time, position, water["velocity"]))
    join()
    same(alone, read)
    # What was read while it ran is of the boundary of one step.
    within = [m for m in moments if 0 < m[0] < alone.steps]
    assert within, "nothing was read while it ran"
    steps, at, position, velocity = within[-1]
    again = simulation(new_scene)
    again.step(steps)
    assert again.time == at
    np.testing.assert_array_equal(again.particles["water"]["position"], position)
    np.testing.assert_array_equal(again.particles["water"]["velocity"], velocity)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        resumed = libmpm.Simulation.resume(tmp_path / "moment.npz")
    assert resumed.steps == moments[-1][0]
    resumed.run(until=END, progress=False)
    same(alone, resumed)


def test_a_second_thread_that_runs_it_is_refused_by_name(new_scene):
    sim, begun, over = simulation(new_scene), threading.Event(), threading.Event()

    def hold(_state):
        begun.set()
        over.wait(20)

    _, join = in_thread(sim.run, until=1e-3, progress=hold)
    try:
        assert begun.wait(20)
        for advance in (sim.step, lambda: sim.run(until=1.0, progress=False), sim.close):
            with pytest.raises(libmpm.Error, match=r"is run by thread 'runs it' at this moment; "):
                advance()
        assert sim.particles["water"]["position"].shape[1] == sim.dimension  # reading is not
    finally:
        over.set()
        join()
    sim.step(1)


def test_the_engine_is_made_once(new_scene):
    sim, found = simulation(new_scene), []
    threads = [threading.Thread(target=lambda: found.append(sim.engine)) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 4
    assert all(engine is sim.engine for engine in found)


def test_who_waits_comes_before_who_enters_again():
    turns, inside, over = Turns(), [], threading.Event()

    def loop():
        while not over.is_set():
            with turns, turns:
                inside.append(1)
                time.sleep(0.02)
                inside.pop()

    _, join = in_thread(loop)
    began = time.monotonic()
    for _ in range(20):
        with turns:
            assert not inside
    over.set()
    join()
    assert time.monotonic() - began < 20
