"""Kills (-9) at random moments in chains of resumes, against the bits of a run left alone."""

from __future__ import annotations

import functools
import json
import os
import signal
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from attack.base import PRINTED, Attack, Defect
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.output.checkpoint import find_checkpoints, load_checkpoint
from libmpm._src.output.frames import list_frames, read_frame
from libmpm._src.output.sensor_file import read_sensors

__all__ = ["SCENES", "Kills", "compare", "go_on"]

#: Kills of one chain at most; then the run is left alone.
MOST = 10
#: Steps of a run, about.
STEPS = 600
#: Parts of a run's length up to which the delays of a chain go: far apart, and so dense that most
#: kills meet a run that has just been taken up.
SPANS = (1.0, 0.5, 0.25)


def _tank(scheme: str = "APIC", width: float = 2.0) -> libmpm.Scene:
    transfer = libmpm.methods.Transfer(
        scheme=scheme, **({"flip": 0.95} if scheme == "APIC-FLIP" else {})
    )
    return libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(width, 1.0), gravity=(0, -9.81),
        method=libmpm.Method(transfer=transfer),
    )  # fmt: skip


def _puddle(scheme: str = "APIC") -> libmpm.Scene:
    """Water that runs against a post."""
    scene = _tank(scheme)
    water = materials.TaitFluid(bulk_modulus=5e5)
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(0.6, 0.5)), material=water)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    post = shapes.Box(lower=(1.4, 0), upper=(1.5, 0.4))
    scene.add_boundary(name="post", shape=post, response=boundaries.Separable())
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="post", interval=0.002))
    scene.add_sensor(name="energy", sensor=sensors.Energy())
    return scene


def _blocks() -> libmpm.Scene:
    """Two blocks of unlike laws that fall into water."""
    scene = _puddle()
    for i, law in enumerate((materials.FixedCorotated, materials.NeoHookean)):
        x = 0.2 + 0.8 * i
        scene.add_body(
            name=f"block {i}", shape=shapes.Box(lower=(x, 0.6), upper=(x + 0.2, 0.8)),
            material=law(density=600.0, youngs_modulus=1e6), velocity=(0.0, -2.0),
        )  # fmt: skip
    scene.add_sensor(name="track", sensor=sensors.ParticleTracker(body="block 0", ids=(500,)))
    return scene


def _channel() -> libmpm.Scene:
    """Water that flows in and out."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1.6, 1), gravity=(0, -9.81)
    )
    water = materials.TaitFluid(density=1000.0, bulk_modulus=1e5)
    whole = shapes.Box(lower=(0, 0), upper=(1.6, 0.5))
    scene.add_body(name="water", shape=whole, material=water, hydrostatic=0.5, velocity=(0.5, 0))
    walls = shapes.DomainWalls(faces=("y-", "y+"))
    scene.add_boundary(name="walls", shape=walls, response=boundaries.Slip())
    inlet = boundaries.Inflow(body="water", face="x-", velocity=0.5, level=0.5, max_particles=4000)
    scene.add_flow(name="in", flow=inlet)
    scene.add_flow(name="out", flow=boundaries.Outflow(face="x+", velocity=0.5))
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=(0.5,), interval=0.004))
    return scene


#: Name -> scene and options of its runs.
SCENES: dict[str, tuple[Callable[[], libmpm.Scene], dict[str, Any]]] = {
    "puddle": (_puddle, {"precision": "single", "threads": 1}),
    "puddle in double, two threads": (_puddle, {"precision": "double", "threads": 2}),
    "puddle with FLIP": (lambda: _puddle("FLIP"), {"precision": "single", "threads": 1}),
    "blocks": (_blocks, {"precision": "single", "threads": 2}),
    "channel": (_channel, {"precision": "double", "threads": 1}),
}


class Kills(Attack):
    """Chains of kills and resumes."""

    name = "kills"
    what = "kills (-9) at random moments of runs that are resumed until they end"
    unit = "kills"
    share = 2.0
    limit = 600.0

    def prepare(self) -> None:
        """Run each scene undisturbed."""
        about = {}
        for number, (name, (scene, options)) in enumerate(SCENES.items()):
            folder = self.folder / f"whole_{number}"
            sim = libmpm.Simulation(scene(), device="cpu", **options)
            sim.step(1)
            until = STEPS * sim.dt
            began = time.monotonic()
            go_on(name, folder, until)
            about[name] = {"until": until, "seconds": time.monotonic() - began}
        (self.folder / "about.json").write_text(json.dumps(about))

    def open(self) -> None:
        """Read how long the scenes take."""
        self.about = json.loads((self.folder / "about.json").read_text())

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Kill, resume, kill ... until a run ends; compare all that is left."""
        rng = self.rng(seed, number)
        name = rng.choice(list(SCENES))
        whole = self.folder / f"whole_{list(SCENES).index(name)}"
        until, seconds = self.about[name]["until"], self.about[name]["seconds"]
        folder, delays = room / "run", []
        kills, span = 0, rng.choice(SPANS) * seconds
        seen: set[tuple[str, int, int, int]] = set()
        self.note(room, scene=name)
        for _ in range(MOST):
            delay = rng.uniform(0, min(0.1, span) if rng.random() < 0.2 else span)
            delays.append(round(delay, 4))
            self.note(room, delays=delays)
            if _started(lambda: go_on(name, folder, until), delay, room):
                break
            kills += 1
            _compare_part(folder, whole, seen)
        else:
            _started(lambda: go_on(name, folder, until), self.limit, room)
        compare(folder, whole)
        return {"kills": kills, f"chains: {name}": 1}


def go_on(name: str, folder: Path, until: float) -> None:
    """Run a scene in a folder to its end, from its newest checkpoint if it has one."""
    scene, options = SCENES[name]
    settings: dict[str, Any] = {"frame_interval": until / 13, "checkpoint_interval": until / 9}
    output = libmpm.Output(folder, **settings, overwrite=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if find_checkpoints(folder / "checkpoints"):
            sim = libmpm.Simulation.resume(folder, output=libmpm.Output(folder, **settings))
        else:
            sim = libmpm.Simulation(scene(), device="cpu", output=output, **options)
    with sim:
        sim.run(until=until, progress=False)
        sim.save_checkpoint(folder / "end.npz")


def _started(call: Callable[[], None], delay: float, room: Path) -> bool:
    """Run `call` in a fork; kill it after a delay. Tells whether it came to its end before."""
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            call()
            code = 0
        except BaseException as error:
            with (room / PRINTED).open("a") as file:
                file.write(f"{type(error).__name__}: {error}\n")
        finally:
            os._exit(code)
    with (room / "processes").open("a") as file:
        file.write(f"{pid}\n")
    limit = time.monotonic() + delay
    while time.monotonic() < limit:
        found, status = os.waitpid(pid, os.WNOHANG)
        if found:
            return _ended(status, room)
        time.sleep(min(0.002, max(limit - time.monotonic(), 0.0)))
    os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL:
        return False
    return _ended(status, room)


def _ended(status: int, room: Path) -> bool:
    if status == 0:
        return True
    if os.WIFSIGNALED(status):
        raise Defect(f"crash: {signal.Signals(os.WTERMSIG(status)).name}")
    path = room / PRINTED
    said = path.read_text(errors="replace")[-2000:] if path.exists() else ""
    raise Defect(f"a run after a kill did not end: {said}")


@functools.lru_cache(maxsize=256)
def _frame(path: Path) -> Mapping[str, Any]:
    """Return a frame of a run that nobody disturbs: nothing writes it any more."""
    return read_frame(path)[0]


@functools.lru_cache(maxsize=8)
def _samples(path: Path) -> Mapping[str, Any]:
    """Return the samples of such a run."""
    return read_sensors(path)


def _compare_part(folder: Path, whole: Path, seen: set[tuple[str, int, int, int]]) -> None:
    """What a killed run has left opens, and is the beginning of what the whole one wrote.

    `seen` are the frames that were compared after an earlier kill; a file that was written again
    has another number, time or size.
    """
    if (folder / "sensors.h5").exists():
        reference = _samples(whole / "sensors.h5")
        for name, series in read_sensors(folder / "sensors.h5").items():
            n = len(series)
            _same(series.time, reference[name].time[:n], f"times of '{name}' after a kill")
            _same(series.values, reference[name].values[:n], f"values of '{name}' after a kill")
    there = list_frames(whole / "frames")
    for body, numbered in list_frames(folder / "frames").items():
        for index, path in numbered.items():
            about = path.stat()
            mark = (str(path), about.st_ino, about.st_mtime_ns, about.st_size)
            if mark not in seen:
                _same_frames(path, there[body][index])
                seen.add(mark)


def compare(folder: Path, whole: Path) -> None:
    """State, samples, frames and checkpoints are those of a run left alone, to the bit."""
    one, two = (load_checkpoint(f / "end.npz") for f in (folder, whole))
    if (one.header["time"], one.header["step"]) != (two.header["time"], two.header["step"]):
        raise Defect(f"ends at {one.header['time']} s, step {one.header['step']}")
    for key, values in two.state.items():
        _same(one.state[key], values, f"state {key}")
    first, second = (read_sensors(f / "sensors.h5") for f in (folder, whole))
    if list(first) != list(second):
        raise Defect(f"sensors are {list(first)}")
    for name, series in second.items():
        _same(first[name].time, series.time, f"times of '{name}'")
        _same(first[name].values, series.values, f"values of '{name}'")
    here, there = (list_frames(f / "frames") for f in (folder, whole))
    if {k: list(v) for k, v in here.items()} != {k: list(v) for k, v in there.items()}:
        raise Defect(f"frames are {here}")
    for body, numbered in there.items():
        for index, path in numbered.items():
            _same_frames(here[body][index], path)
    names = [[p.name for p in find_checkpoints(f / "checkpoints")] for f in (folder, whole)]
    if names[0] != names[1]:
        raise Defect(f"checkpoints are {names[0]}, not {names[1]}")
    for name in names[0]:
        saved = [load_checkpoint(f / "checkpoints" / name).state for f in (folder, whole)]
        for key, values in saved[1].items():
            _same(saved[0][key], values, f"{name}: {key}")
    removed = [f / "removed.csv" for f in (folder, whole)]
    texts = [p.read_text() if p.exists() else "" for p in removed]
    if texts[0] != texts[1]:
        raise Defect("removed.csv is another one")
    left = [p for p in folder.rglob("*") if p.suffix == ".part" or p.name == "lock"]
    if left:
        raise Defect(f"left behind: {left}")


def _same_frames(one: Path, two: Path) -> None:
    first, second = read_frame(one)[0], _frame(two)
    for name, values in second.items():
        _same(first[name], values, f"{one.name}: {name}")


def _same(one: Any, two: Any, what: str) -> None:
    a, b = np.asarray(one), np.asarray(two)
    if a.shape != b.shape or a.dtype != b.dtype or a.tobytes() != b.tobytes():
        raise Defect(f"{what} differs: {a.shape} {a.dtype}, {b.shape} {b.dtype}")
