"""Forged checkpoints: other values in their arrays and header, under checksums that hold.

A checkpoint is read, one of its arrays or numbers is changed by name, and it is written again by
libmpm itself: whatever the layout is today, sizes and checksums are right and the values are not.
"""

from __future__ import annotations

import contextlib
import copy
import json
import math
import random
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from attack.base import Attack
from libmpm._src.output.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from support import fuzz_readers, fuzz_scenes, fuzzing

__all__ = ["Forged", "forge"]

#: Steps that a forged state is taken further: beyond the next sort.
STEPS = 12
#: Cells that a particle may lie outside of an open face until the next sort ends the run for it:
#: a checkpoint's offsets are held to half a cell and twice the way since the last sort, of which a
#: step sees 1.75 at most (`state_check.cpp`).
OUTSIDE = 1.25
#: Numbers that indices, counts and sizes are changed to.
_WHOLE = (0, 1, 2, 3, 7, 255, 256, 65535, 2**31 - 1, 2**31, 2**32 - 1, 2**53, 2**62, 2**63 - 1, -1)
_REAL = (
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    1e-30,
    1e30,
    -1e30,
    1e300,
    5e-324,
    math.nan,
    math.inf,
    -math.inf,
)


class Forged(Attack):
    """Checkpoints with values that no run writes."""

    name = "forged"
    what = "checkpoints with valid checksums and other values"
    unit = "checkpoints"
    share = 2.0
    limit = 150.0
    batch = 50

    def prepare(self) -> None:
        """Save checkpoints of scenes of all kinds, in both precisions as far as they are built."""
        scenes = [fuzz_readers.small_tank(), *fuzz_scenes.small_scenes(self.folder)]
        for number, scene in enumerate(s for s in scenes if not _custom(s)):
            for precision in ("single", "double"):
                with contextlib.suppress(libmpm.Error):
                    sim = libmpm.Simulation(scene, device="cpu", threads=1, precision=precision)
                    sim.step(3)
                    sim.save_checkpoint(self.folder / f"state_{number}_{precision}.npz")

    def open(self) -> None:
        """List the checkpoints."""
        self.states = sorted(self.folder.glob("state_*.npz"))
        assert len(self.states) > 10, "most scenes give no checkpoint"
        self._whole = {path: load_checkpoint(path) for path in self.states}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for path in self.states:  # what is kept of their shapes comes with forks
                with contextlib.suppress(libmpm.Error):
                    libmpm.Scene.from_checkpoint(path).validate()

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Change a few values of a checkpoint and go on from it."""
        rng = self.rng(seed, number)
        source = rng.choice(self.states)
        found = copy.deepcopy(self._whole[source])
        said = [source.name]
        for _ in range(rng.choice((1, 1, 1, 2, 4))):
            said.append(forge(found, rng))
        path = room / "forged.npz"
        self.note(room, said=said)
        try:
            save_checkpoint(path, found)
        except (TypeError, ValueError, RecursionError):
            return {"not a checkpoint": 1}
        return {_judge(path): 1}

    def replay(self, kept: Mapping[str, Any], room: Path) -> Mapping[str, int]:
        """Judge the checkpoint that was kept."""
        return {_judge(room / "forged.npz"): 1}


def _custom(scene: libmpm.Scene) -> bool:
    return any(isinstance(s.sensor, libmpm.sensors.Custom) for s in scene.sensors)


def _judge(path: Path) -> str:
    """A forged state is refused, ends in a named error, or goes on with what a state must have."""

    def go_on() -> Any:
        sim = libmpm.Simulation.resume(path, device="cpu")
        before = sum(len(body) for body in sim.particles.values())
        _look(sim)
        sim.step(STEPS)
        _look(sim)
        sim.save_checkpoint(path.with_name("again.npz"))
        return before

    found = fuzzing.answer(go_on)
    started = fuzzing.answer(lambda: libmpm.Scene.from_checkpoint(path))
    if isinstance(found, libmpm.Error):
        kind = type(found).__name__
        return f"{'refused' if kind == 'CheckpointError' else 'stopped'}: {kind}"
    if not isinstance(started, libmpm.Error):
        fuzzing.answer(started.validate)
    again = fuzzing.answer(lambda: libmpm.Simulation.resume(path.with_name("again.npz")).steps)
    assert not isinstance(again, libmpm.Error), f"what it has saved is refused: {again}"
    return "went on"


def _look(sim: libmpm.Simulation) -> None:
    """Read everything; what is true of every state must be true of this one."""
    ids: list[NDArray[Any]] = []
    for name, view in sim.particles.items():
        for key in ("id", "position", "velocity", "pressure"):
            values = np.asarray(view[key])
            crushed = key == "pressure" and _crushed(sim, name)
            assert crushed or np.isfinite(values).all(), f"{key} of '{name}' is not finite"
        position = np.asarray(view["position"])
        slack = (OUTSIDE + 1e-3) * sim.scene.cell_size
        ends = (sim.scene.lower, sim.scene.upper)
        low, high = (np.add(end, sim.scene.origin) for end in ends)
        inside = (position >= low - slack).all() and (position <= high + slack).all()
        assert inside or sim.scene.flows, f"particles of '{name}' are outside the domain"
        ids.append(np.asarray(view["id"]))
    every = np.concatenate(ids) if ids else np.empty(0)
    assert len(np.unique(every)) == len(every), "two particles have one id"
    for series in sim.sensors.values():
        assert len(series.time) == len(series.values)
    np.asarray(sim.grid["mass"])


def _crushed(sim: libmpm.Simulation, name: str) -> bool:
    """Tell whether an element of a body has turned inside out, where a law has no stress.

    A run may save such a state: elements are judged as the next step begins, which ends by name.
    """
    shape = next(b.shape for b in sim.scene.bodies if b.name == name)
    if not isinstance(shape, libmpm.shapes.Tetrahedra | libmpm.shapes.Triangles):
        return False
    return not (np.asarray(sim.particles[name]["element_volume_ratio"]) > 0).all()


# Changing values ------------------------------------------------------------------------------


def forge(checkpoint: Checkpoint, rng: random.Random) -> str:
    """Change one thing of a checkpoint's content in place, and say what."""
    arrays: list[tuple[str, Any, Any]] = [
        (f"state/{k}", checkpoint.state, k)
        for k, v in checkpoint.state.items()
        if isinstance(v, np.ndarray)
    ]
    for number, memory in checkpoint.memory.items():
        arrays += [(f"memory/{number}/{k}", memory, k) for k in memory]
    how = rng.random()
    if how < 0.12:
        return _header(checkpoint, rng)
    if how < 0.2:
        numbers = [k for k, v in checkpoint.state.items() if not isinstance(v, np.ndarray)]
        if numbers:
            key = rng.choice(numbers)
            before = checkpoint.state[key]
            checkpoint.state[key] = _other(before, rng)
            return f"number {key}: {before!r} became {checkpoint.state[key]!r}"
    if how < 0.26 and checkpoint.sensors:
        return _series(checkpoint, rng)
    name, owner, key = rng.choice(arrays)
    owner[key], said = spoiled(np.asarray(owner[key]), rng)
    return f"{name}: {said}"


def _header(checkpoint: Checkpoint, rng: random.Random) -> str:
    """Another value, or another part of the scene, in the header."""
    header = json.loads(json.dumps(checkpoint.header))
    broken = fuzzing.Breaker({"header": header}, rng.random(), 0, True).broken()
    made = broken.document
    if not isinstance(made, dict):
        return "header: nothing"
    checkpoint.header = made
    return f"header: {'; '.join(broken.said[1:])}"


def _series(checkpoint: Checkpoint, rng: random.Random) -> str:
    i = rng.randrange(len(checkpoint.sensors))
    time, values, components, units = checkpoint.sensors[i]
    if rng.random() < 0.5:
        time, said = spoiled(time, rng)
    else:
        values, said = spoiled(values, rng)
    checkpoint.sensors[i] = (time, values, components, units)
    return f"series of sensor {i}: {said}"


def spoiled(array: NDArray[Any], rng: random.Random) -> tuple[NDArray[Any], str]:
    """Return an array with other values, length or type, and what was done."""
    made = np.array(copy.deepcopy(array))
    flat = made.reshape(-1)
    ways = ["longer", "type"] if not flat.size else [
        "value", "value", "value", "value", "few", "shorter", "longer", "all", "swap", "repeat",
        "step", "reverse", "shape", "type", "word",
    ]  # fmt: skip
    how = rng.choice(ways)
    i = rng.randrange(flat.size) if flat.size else 0
    said = f"{how} at {i} of {array.dtype} {array.shape}"
    with np.errstate(all="ignore"):
        if how in ("value", "few"):
            for _ in range(1 if how == "value" else 5):
                k = i if how == "value" else rng.randrange(flat.size)
                flat[k] = _item(flat[k], flat.dtype, rng)
                said += f", {flat[k]!r}"
        elif how == "step":
            flat[i] += np.asarray(rng.choice((1, 2, 3, 100))).astype(flat.dtype)
        elif how == "all":
            flat[:] = _item(flat[i], flat.dtype, rng)
            said += f", {flat[i]!r}"
        elif how == "swap":
            k = rng.randrange(flat.size)
            flat[i], flat[k] = flat[k].copy(), flat[i].copy()
        elif how == "repeat":
            flat[i] = flat[rng.randrange(flat.size)]
        elif how == "reverse":
            made = flat[::-1].copy().reshape(made.shape)
        elif how == "shorter":
            made = made[: rng.randrange(len(made))] if made.ndim else made
        elif how == "longer":
            more = np.zeros((rng.choice((1, 3, 1000)), *made.shape[1:]), made.dtype)
            made = np.concatenate([made, more]) if made.ndim else made
        elif how == "shape":
            made = made.reshape(1, -1) if rng.random() < 0.5 else np.stack([made, made])
        elif how == "type":
            kind = rng.choice(("f4", "f8", "i4", "i8", "u1", "u4", "u8", "i2", "?", "c16"))
            made = made.astype(kind) if rng.random() < 0.5 else _seen_as(made, kind)
        elif how == "word":
            made, more_said = _word(made, rng)
            said += more_said
    return made, said


def _item(before: Any, dtype: np.dtype[Any], rng: random.Random) -> Any:
    """Return another value of the type of an array."""
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        near = [int(before) + d for d in (-2, -1, 1, 2)]
        allowed = [
            v for v in (*_WHOLE, *near, limits.min, limits.max) if limits.min <= v <= limits.max
        ]
        return rng.choice(allowed)
    if dtype.kind == "f":
        factors = (before * rng.choice((1e3, -1, 1e-6, 1.0001)),)
        return dtype.type(rng.choice((*_REAL, *factors)))
    return dtype.type(rng.choice((0, 1)))


def _word(array: NDArray[Any], rng: random.Random) -> tuple[NDArray[Any], str]:
    """Change a word of 4 or 8 bytes in the memory of an array: blobs hold numbers of all types."""
    raw = bytearray(array.tobytes())
    kind = rng.choice(("<f8", "<f4", "<i4", "<i8"))
    size = np.dtype(kind).itemsize
    if len(raw) < size:
        return array, ": nothing"
    at = size * rng.randrange(len(raw) // size)
    before = np.frombuffer(bytes(raw[at : at + size]), kind)[0]
    with np.errstate(all="ignore"):
        after = np.asarray(_item(before, np.dtype(kind), rng)).astype(kind)
    raw[at : at + size] = after.tobytes()
    made = np.frombuffer(bytes(raw), array.dtype).reshape(array.shape).copy()
    return made, f": the {kind} at byte {at}, {before!r}, became {after!r}"


def _seen_as(array: NDArray[Any], kind: str) -> NDArray[Any]:
    try:
        return np.ascontiguousarray(array).reshape(-1).view(kind)
    except ValueError:
        return array.astype(kind)


def _other(before: Any, rng: random.Random) -> Any:
    """Return another number of the same type, or something that is none."""
    if isinstance(before, bool):
        return rng.choice((not before, 2, None, "x"))
    if isinstance(before, int):
        return rng.choice((*_WHOLE, before + 1, before - 1, 2**64, 0.5, None, "x", [1]))
    if isinstance(before, float):
        return rng.choice((*_REAL, before * 1e3, -before, None, "x", 10**400))
    return rng.choice((0, -1, None, "x", [], {}))
