"""Misuse that is refused by name: copies, forks, times that are no numbers, missing files."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys

import numpy as np
import pytest

import libmpm
from libmpm import materials, shapes


def still():
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2), name="still")
    scene.add_body(name="block", shape=shapes.Box(lower=(0.5, 0.5), upper=(1.0, 1.0)),
                   material=materials.FixedCorotated(density=600, youngs_modulus=1e5))  # fmt: skip
    return scene


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, pickle.dumps])
def test_a_simulation_is_not_copied(copied):
    sim = libmpm.Simulation(still(), device="cpu")
    sim.step(1)
    with pytest.raises(libmpm.Error, match=r"cannot be copied or pickled.*continue from a check"):
        copied(sim)
    sim.step(1)


def thrown():
    """A block that leaves the domain, whose walls are missing."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), name="thrown")
    law = materials.FixedCorotated(density=600, youngs_modulus=1e5)
    box = shapes.Box(lower=(0.3, 0.3), upper=(0.7, 0.7))
    scene.add_body(name="block", shape=box, material=law, velocity=(5.0, 0.0))
    return libmpm.Simulation(scene, device="cpu")


def overflown():
    """Water with a pressure beyond what single precision holds."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), name="overflown")
    law = materials.TaitFluid(bulk_modulus=1e16, exponent=20.0)
    box = shapes.Box(lower=(0.3, 0.3), upper=(0.7, 0.7))
    scene.add_body(name="block", shape=box, material=law)
    sim = libmpm.Simulation(scene, device="cpu", precision="single")
    pressure = 1e16 / 20 * math.expm1(-20 * math.log(0.06))
    sim.particles["block"]["pressure"] = np.full(len(sim.particles["block"]), pressure)
    return sim


@pytest.mark.parametrize(
    ("made", "what"), [(thrown, "left the domain"), (overflown, "no longer finite")]
)
def test_the_state_of_a_run_that_failed_is_not_saved(tmp_path, made, what):
    """After particles had left it was: a checkpoint from which every run failed at once."""
    sim = made()
    with pytest.raises(libmpm.NumericalError, match=what):
        sim.run(until=1.0, progress=False)
    step, ids = sim.steps, np.array(sim.particles["block"]["id"])
    for _ in range(2):
        with pytest.raises(libmpm.NumericalError, match=rf"has failed.* not saved.*{what}"):
            sim.save_checkpoint(tmp_path / "x.npz")
        with pytest.raises(libmpm.NumericalError):
            sim.step(1)
    assert not (tmp_path / "x.npz").exists()
    assert sim.steps == step
    np.testing.assert_array_equal(sim.particles["block"]["id"], ids)


@pytest.mark.parametrize("until", ["1", b"1", True, None, [1.0]])
def test_until_is_a_number(until):
    with pytest.raises(libmpm.Error, match=r"until is .*expected a number in s"):
        libmpm.Simulation(still(), device="cpu").run(until=until)


def test_a_scene_file_that_is_not_there(tmp_path):
    for path in (tmp_path / "none.json", tmp_path):
        with pytest.raises(libmpm.SceneError, match=r"cannot be read: .*expected a scene file"):
            libmpm.Scene.load(path)


def test_formulas_nested_too_deep_are_named():
    with pytest.raises(libmpm.SceneError, match=r"Field: components\[0\] is .*no formula"):
        libmpm.Field(components=("(" * 5000 + "x" + ")" * 5000,))
    deep = libmpm.Field(components=("-" * 150 + "x",))
    assert deep.at([[2.0]])[0, 0] == 2.0


FORKS = """
import os, signal, time
import libmpm
from libmpm import materials, shapes


def made(threads):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2), name="still")
    scene.add_body(name="block", shape=shapes.Box(lower=(0.5, 0.5), upper=(1.0, 1.0)),
                   material=materials.FixedCorotated(density=600, youngs_modulus=1e5))
    return libmpm.Simulation(scene, device="cpu", threads=threads)


def in_a_fork(work):
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            work()
            word = "fine"
        except BaseException as error:
            word = f"{type(error).__name__}: {error}"
        os.write(writing, word.encode())
        os._exit(0)
    deadline = time.monotonic() + 60
    os.set_blocking(reading, False)
    found = b""
    while not found and time.monotonic() < deadline:
        try:
            found = os.read(reading, 4096)
        except BlockingIOError:
            time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return found.decode() or "hangs"


sim, other, alone = made(2), made(2), made(1)
sim.step(3)
for case in (sim, other, alone):
    print(in_a_fork(lambda: case.step(3)))
sim.step(1)
"""


def test_a_fork_of_a_process_with_threads_is_named_and_does_not_hang():
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORKS], capture_output=True, text=True, timeout=280
    )
    assert done.returncode == 0, done.stderr
    theirs, new, alone = done.stdout.splitlines()
    assert theirs.startswith("DeviceError") and "a fork of the one that made" in theirs
    assert new.startswith("DeviceError") and "threads=1" in new
    assert alone == "fine"
