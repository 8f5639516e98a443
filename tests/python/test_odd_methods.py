"""Odd values for every argument of the methods of scenes, simulations and results: ended by name.

`python -m tests.attack --only values` does this with constructors and functions; here are methods,
each argument of which takes each of the values below. Expected duration: 10 s.
"""

from __future__ import annotations

import math
import os

import matplotlib.pyplot as plt
import numpy as np
import pytest

import libmpm
from libmpm._src.cli.commands import ExitCode, main
from libmpm.studies import Study
from support import fuzz_readers, fuzzing

ODD = {
    "empty": "", "word": "nobody", "long": "a" * 5000, "nul": "\0", "surrogate": "\ud800",
    "bytes": b"x", "minus": -1, "nan": math.nan, "infinite": math.inf, "huge": 10**400,
    "longest": 10**5000, "true": np.bool_(True), "none": np.array([]), "four": np.zeros((2, 2)),
    "words": np.array(["a", "b"]), "one": np.array("a"), "set": {1, 2}, "object": object(),
    "deep": fuzzing.nested(5000), "pair": (10**400, 1), "list": [], "dict": {"a": 1},
}  # fmt: skip

#: Name -> a call with one argument; what it is of comes first.
CALLS = {
    "Simulation scene": lambda of, x: libmpm.Simulation(x, device="cpu"),
    "Simulation device": lambda of, x: libmpm.Simulation(of["scene"], device=x),
    "Simulation precision": lambda of, x: libmpm.Simulation(of["scene"], precision=x),
    "Simulation pipeline": lambda of, x: libmpm.Simulation(of["scene"], pipeline=x),
    "Simulation threads": lambda of, x: libmpm.Simulation(of["scene"], device="cpu", threads=x),
    "Simulation time_step": lambda of, x: libmpm.Simulation(of["scene"], time_step=x),
    "resume": lambda of, x: libmpm.Simulation.resume(x, device="cpu"),
    "step": lambda of, x: of["sim"].step(x),
    "run until": lambda of, x: of["sim"].run(until=None if x == math.inf else x)
    if isinstance(x, float) else of["sim"].run(until=x),
    "run wall_limit": lambda of, x: of["sim"].run(until=0.0, progress=False, wall_limit=x),
    "save_checkpoint": lambda of, x: of["sim"].save_checkpoint(x),
    "set_output": lambda of, x: of["sim"].set_output(x),
    "particle_count": lambda of, x: of["sim"].particle_count(x),
    "particles": lambda of, x: of["sim"].particles[x],
    "particles of a body": lambda of, x: of["sim"].particles["w"][x],
    "read": lambda of, x: of["sim"].particles["w"].read(x),
    "set": lambda of, x: of["sim"].particles["w"].__setitem__(x, 1.0),
    "set_initial body": lambda of, x: of["sim"].set_initial(x, "velocity", 1.0),
    "assign": lambda of, x: of["sim"].assign(x, velocity_change=1.0),
    "grid": lambda of, x: of["sim"].grid[x],
    "gather": lambda of, x: of["sim"].gather(x),
    "stored": lambda of, x: of["sim"].stored(x),
    "add_force body": lambda of, x: of["sim"].add_force("f", x, len, interval=0.1),
    "plot colour": lambda of, x: of["sim"].plot(colour=x),
    "plot bodies": lambda of, x: of["sim"].plot(bodies=x),
    "plot planes": lambda of, x: of["sim"].plot(planes=x),
    "plot cut": lambda of, x: of["sim"].plot(cut=x),
    "plot limits": lambda of, x: of["sim"].plot(limits=x),
    "plot axes": lambda of, x: of["sim"].plot(axes=x),
    "preview backend": lambda of, x: of["scene"].preview(backend=x),
    "preview planes": lambda of, x: of["scene"].preview(planes=x),
    "preview cut": lambda of, x: of["scene"].preview(cut=x),
    "validate": lambda of, x: of["scene"].validate(strict=x),
    "plan precision": lambda of, x: of["scene"].plan(device="cpu", until=1.0, precision=x),
    "plan time_step": lambda of, x: of["scene"].plan(device="cpu", until=1.0, time_step=x),
    "plan body": lambda of, x: of["plan"].body(x),
    "save": lambda of, x: of["scene"].save(x),
    "Scene.load": lambda of, x: libmpm.Scene.load(x),
    "from_checkpoint": lambda of, x: libmpm.Scene.from_checkpoint(x),
    "Output path": lambda of, x: libmpm.Output(x),
    "Study folder": lambda of, x: Study(x, _tank, [{"a": 1}], until=1.0),
    "Study.open": lambda of, x: Study.open(x),
    "run_axes": lambda of, x: Study("s", _tank, [{"a": 1}], until=1.0, run_axes=x),
    "options": lambda of, x: Study("s", _tank, [{"a": 1}], until=1.0, options=x),
    "add_body": lambda of, x: of["scene"].add_body(name=x, shape=None, material=None),
    "add_boundary": lambda of, x: of["scene"].add_boundary(name=x, shape=None, response=None),
    "add_sensor": lambda of, x: of["scene"].add_sensor(name=x, sensor=None),
    "load": lambda of, x: libmpm.load(x),
    "frame": lambda of, x: of["frames"][0][x],
    "frames at": lambda of, x: of["frames"].at(x),
    "series": lambda of, x: of["series"][x],
    "peak": lambda of, x: of["series"].peak(filter=x),
    "impulse component": lambda of, x: of["series"].impulse(x),
    "impulse start": lambda of, x: of["series"].impulse(start=x),
    "impulse end": lambda of, x: of["series"].impulse(end=x),
    "plot of a series": lambda of, x: of["series"].plot(x),
    "its filter": lambda of, x: of["series"].plot(filter=x),
    "its label": lambda of, x: of["series"].plot(label=x),
    "its axes": lambda of, x: of["series"].plot(axes=x),
}  # fmt: skip

#: These are taken, as they mean something: good values, labels, and names that a file may have.
TAKEN = {
    "its label": {"empty", "word", "long", "nul", "surrogate"},
    "save": {"word"}, "save_checkpoint": {"word"}, "validate": {"true"},
    "run wall_limit": {"infinite"}, "run until": {"minus"}, "impulse start": {"minus"},
    "Output path": {"word"}, "Study folder": {"word"}, "run_axes": {"none", "list"},
    "frames at": {"minus"}, "read": {"none", "list"}, "plot limits": {"set"},
}  # fmt: skip


def _tank(a):
    return fuzz_readers.small_tank()


@pytest.fixture(scope="module")
def of(tmp_path_factory):
    """A scene, a simulation of it, its plan, and what a run has written."""
    folder = tmp_path_factory.mktemp("run") / "out"
    scene = fuzz_readers.small_tank()
    output = libmpm.Output(folder, frame_interval=0.01)
    with libmpm.Simulation(scene, device="cpu", threads=1, output=output) as sim:
        sim.run(until=0.03, progress=False)
    found = libmpm.load(folder)
    return {
        "scene": scene, "sim": libmpm.Simulation(scene, device="cpu", threads=1),
        "plan": scene.plan(device="cpu", until=1.0, threads=1), "frames": found.frames["w"],
        "series": found.sensors["load"],
    }  # fmt: skip


@pytest.mark.parametrize("name", CALLS)
def test_ends_by_name(of, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for key, item in ODD.items():
        # A mapping has no such key, as a dictionary says it.
        found = fuzzing.answer(lambda x=item: CALLS[name](of, x), also=(KeyError,))
        plt.close("all")
        refused = isinstance(found, libmpm.Error | KeyError)
        assert refused or key in TAKEN.get(name, ()), f"{name} takes {key}"


FILES = ("missing", "empty", "bytes", "loop", "dangling", "folder", "deep.json", "null.json", "",
         ".", "a" * 300, "\ud800", os.fsdecode(b"\xff.json"), "/dev/null")  # fmt: skip
COMMANDS = (
    ["check"], ["info"], ["run", "--until", "0.002", "--quiet", "-o", "made"],
    ["resume", "--until", "0.031", "--quiet", "-o", "made"],
    ["export", "--to", "csv", "-o", "made"], ["import", "-o", "made", "claymore"],
    ["study", "run", "-o", "made"], ["study", "status"], ["study", "collect"],
)  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: " ".join(c[:2]))
def test_commands_end_with_the_code_of_an_error(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    for name, raw in (("empty", b""), ("bytes", bytes(range(256))), ("deep.json", b"[" * 100_000),
                      ("null.json", b"null")):  # fmt: skip
        (tmp_path / name).write_bytes(raw)
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "dangling").symlink_to("gone")
    for name in FILES:
        ended = fuzzing.answer(lambda x=name: main([*command, x]), also=(SystemExit,))
        code = getattr(ended, "code", ended)
        assert code in (ExitCode.INPUT, ExitCode.OUTPUT), f"{command} {name!r}: {code}"


@pytest.mark.parametrize("name", FILES)
def test_what_commands_write_ends_with_the_code_of_an_error(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "loop").symlink_to("loop")
    fuzz_readers.small_tank().save("scene.json")
    for command in (
        ["run", "scene.json", "--until", "0.002", "--quiet"],
        ["schema"],
        ["bench", "--particles", "100", "--steps", "1", "--json"],
    ):
        to = [] if command[-1] == "--json" else ["-o"]
        ended = fuzzing.answer(lambda c=[*command, *to, name]: main(c), also=(SystemExit,))
        code = getattr(ended, "code", ended)
        assert code in (ExitCode.DONE, ExitCode.INPUT, ExitCode.OUTPUT), f"{command}: {code}"
