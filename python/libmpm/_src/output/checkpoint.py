"""Checkpoints: the whole state in one NumPy archive, written atomically, two generations kept.

The archive is uncompressed; its CRC-32 per array and its directory at the end of the file tell a
damaged or truncated file from a whole one.
"""

from __future__ import annotations

import json
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import shown
from libmpm._src.errors import CheckpointError, Error, ModelWarning
from libmpm._src.output.atomic_files import replacing, sync_folder

__all__ = [
    "FORMAT",
    "Checkpoint",
    "checkpoint_path",
    "find_checkpoints",
    "find_newest",
    "keep_newest",
    "load_checkpoint",
    "load_header",
    "save_checkpoint",
]

T = TypeVar("T")

#: Number of the checkpoint layout, and of those that are read. 1 has the engine's clock as an image
#: of its memory, 2 by names.
FORMAT = 2
_READABLE = (1, FORMAT)

_NAME = re.compile(r"step_(\d{10,})\.npz")


@dataclass
class Checkpoint:
    """What a run needs to continue.

    `header` is JSON: format, version, scene, device, precision, pipeline, threads, time_step,
    time (s), step, until (s), output settings, and engine_sensors, the names of the sensors that
    `state` has; in those of earlier versions they are the ones that no version reads in Python.
    `state` is the engine's own, and `sensors` holds per sensor (time (n,), values (n, components),
    components, units). `memory` is what sensors that are made in Python need besides their series,
    by number of the sensor.
    """

    header: dict[str, Any]
    state: dict[str, Any]
    sensors: list[tuple[NDArray[np.float64], NDArray[np.float64], list[str], list[str]]] = field(
        default_factory=list
    )
    memory: dict[int, dict[str, NDArray[Any]]] = field(default_factory=dict)

    def memory_of(self, sensor: int) -> dict[str, NDArray[Any]]:
        """Return what sensor number `sensor` remembers."""
        return self.memory.get(sensor, {})

    def stored_as(self) -> dict[str, list[int]]:
        """Return the entry of a specification by which an engine takes bodies as the state does.

        Raises `CheckpointError` where it is no list of numbers of bodies.
        """
        found = self.state.get("body_of")
        if found is None:
            return {}
        array = np.asarray(found)
        wrong = array.dtype.kind not in "iu" or array.ndim != 1
        if wrong or np.any(array < 0) or np.any(array > len(array)):
            raise CheckpointError(
                f"body_of has shape {array.shape} and type {array.dtype}; expected a number of a "
                "body for every body; the checkpoint is damaged, use an older one"
            )
        return {"stored_as": array.tolist()}


def checkpoint_path(folder: Path, step: int) -> Path:
    """Return the file of the checkpoint taken at `step`."""
    return folder / f"step_{step:010d}.npz"


def find_checkpoints(folder: Path) -> list[Path]:
    """Return the complete checkpoints of a folder, newest (highest step) first."""
    found = [p for p in folder.glob("step_*.npz") if _NAME.fullmatch(p.name)]
    return sorted(found, key=step_of, reverse=True)


def step_of(path: Path) -> int:
    """Return the step in the name of a checkpoint file."""
    match = _NAME.fullmatch(path.name)
    return int(match[1]) if match else -1


def keep_newest(folder: Path, count: int = 2) -> None:
    """Delete all but the newest `count` checkpoints."""
    for old in find_checkpoints(folder)[count:]:
        old.unlink(missing_ok=True)
    sync_folder(folder)


def save_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write `checkpoint` to `path`: the old file or the whole new one, also after power failure."""
    numbers: dict[str, Any] = {}
    arrays: dict[str, NDArray[Any]] = {}
    for key, value in checkpoint.state.items():
        if isinstance(value, np.ndarray):
            arrays[f"state/{key}"] = value
        else:
            numbers[key] = value.item() if isinstance(value, np.generic) else value
    columns = []
    for i, (time, values, components, units) in enumerate(checkpoint.sensors):
        arrays[f"sensor/{i}/time"] = time
        arrays[f"sensor/{i}/values"] = values
        columns.append([components, units])
    for i, remembered in checkpoint.memory.items():
        arrays |= {f"memory/{i}/{key}": value for key, value in remembered.items()}
    shapes = {
        key: [*np.shape(array), str(np.asarray(array).dtype)] for key, array in arrays.items()
    }
    header = {
        **checkpoint.header, "format": FORMAT, "numbers": numbers, "columns": columns,
        "arrays": shapes,
    }  # fmt: skip
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    with replacing(path, durable=True) as part, part.open("wb") as file:
        np.savez(file, header=text, **arrays)  # type: ignore[arg-type]
        file.flush()
        os.fsync(file.fileno())


def load_header(path: Path) -> tuple[dict[str, Any], list[int]]:
    """Read the header of a checkpoint, and as which of its bodies the scene's are stored.

    Raises as `load_checkpoint`.
    """
    with _opened(path) as archive:
        header = _header(path, archive)
        bodies = range(len(header["scene"]["bodies"]))
        stored = archive["state/body_of"] if "state/body_of" in archive.files else bodies
        if np.shape(stored) != (len(bodies),):
            raise ValueError(f"it stores {np.shape(stored)} bodies, its scene has {len(bodies)}")
        return header, [int(i) for i in stored]


def load_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint written by `save_checkpoint`.

    Raises
    ------
    CheckpointError
        If the file is missing, truncated, damaged or of another version; the message says which.
    """
    with _opened(path) as archive:
        header = _header(path, archive)
        _check_arrays(header.pop("arrays", {}), archive)
        state: dict[str, Any] = dict(header.pop("numbers"))
        for key in archive.files:
            if key.startswith("state/"):
                state[key.removeprefix("state/")] = archive[key]
        sensors = [
            (archive[f"sensor/{i}/time"], archive[f"sensor/{i}/values"], components, units)
            for i, (components, units) in enumerate(header.pop("columns"))
        ]
        for i, (time, *_) in enumerate(sensors):
            _check_times(i, time, header["time"])
        memory: dict[int, dict[str, NDArray[Any]]] = {}
        for key in archive.files:
            if key.startswith("memory/"):
                _, number, name = key.split("/", 2)
                memory.setdefault(int(number), {})[name] = archive[key]
        return Checkpoint(header, state, sensors, memory)


def _header(path: Path, archive: Any) -> dict[str, Any]:
    header: dict[str, Any] = json.loads(archive["header"].tobytes().decode())
    if not isinstance(header, dict):
        raise ValueError("its header is no object")
    if header.get("format") not in _READABLE:
        raise CheckpointError(
            f"{path} has checkpoint format {shown(header.get('format'))}, written by libmpm "
            f"{header.get('version')}; this libmpm reads formats {_READABLE}: resume with the "
            "version that wrote it"
        )
    for key, (kind, wanted) in _HEADER.items():
        missing = key not in header and key not in _LATER
        if missing or (key in header and not kind(header[key])):
            raise CheckpointError(
                f"{path} is not a complete checkpoint: its header has {key} = "
                f"{shown(header.get(key))}; expected {wanted}; use the other generation in "
                "its folder"
            )
    return header


def _number(x: Any) -> bool:
    number = isinstance(x, int | float) and not isinstance(x, bool)
    return number and 0 <= x <= sys.float_info.max


def _count(x: Any) -> bool:
    return isinstance(x, int) and not isinstance(x, bool) and 0 <= x < 1 << 63


def _columns(x: Any) -> bool:
    """Return whether there are names and units, as many of each, for every sensor."""
    if not isinstance(x, list):
        return False
    pairs = all(isinstance(row, list) and len(row) == 2 for row in x)
    lists = pairs and all(isinstance(part, list) for row in x for part in row)
    return lists and all(
        len(row[0]) == len(row[1]) and all(isinstance(t, str) for part in row for t in part)
        for row in x
    )


def _action(x: Any) -> bool:
    keys = {"interval", "last"}
    return isinstance(x, dict) and set(x) == keys and all(_number(x[key]) for key in keys)


#: What the headers of older versions lack.
_LATER = (
    "run", "shared_device", "displaced", "until", "output", "guard", "arrays", "partition",
    "actions", "engine_sensors",
)  # fmt: skip

#: What a header must hold: key -> (test, in words).
_HEADER: dict[str, tuple[Callable[[Any], bool], str]] = {
    "version": (lambda x: isinstance(x, str), "a text"),
    "scene": (lambda x: isinstance(x, dict), "a scene"),
    "run": (lambda x: x is None or isinstance(x, dict), "an object"),
    "device": (lambda x: isinstance(x, str), "a device"),
    "precision": (lambda x: isinstance(x, str), "a precision"),
    "pipeline": (lambda x: isinstance(x, str), "a pipeline"),
    "threads": (_count, "a whole number"),
    "shared_device": (lambda x: isinstance(x, bool), "true or false"),
    "time_step": (lambda x: x is None or _number(x), "seconds"),
    "time": (_number, "seconds"),
    "step": (_count, "a whole number"),
    "displaced": (
        lambda x: isinstance(x, dict) and all(map(_count, x.values())),
        "numbers by body",
    ),
    "until": (lambda x: x is None or _number(x), "seconds"),
    "output": (lambda x: x is None or isinstance(x, dict), "settings of an Output"),
    "guard": (lambda x: x is None or isinstance(x, dict), "settings of a Guard"),
    "partition": (lambda x: x is None or isinstance(x, dict), "settings of a Partition"),
    "engine_sensors": (
        lambda x: isinstance(x, list) and all(isinstance(name, str) for name in x),
        "names of sensors",
    ),
    "actions": (
        lambda x: isinstance(x, dict) and all(map(_action, x.values())),
        "interval and last call of every action, s",
    ),
    "arrays": (lambda x: isinstance(x, dict), "shapes by name"),
    "numbers": (lambda x: isinstance(x, dict), "an object"),
    "columns": (_columns, "names and units of every sensor"),
}


def _check_times(sensor: int, time: NDArray[Any], now: float) -> None:
    """Raise ValueError unless samples were taken one after another, up to the present time."""
    if not np.isfinite(time).all() or np.any(np.diff(time) < 0):
        raise ValueError(f"sensor {sensor} has times that are not finite or do not ascend")
    if len(time) and not 0 <= time[0] <= time[-1] <= now * (1 + 1e-9):
        raise ValueError(f"sensor {sensor} has times outside 0 to {now:g} s, its own")


def _check_arrays(stated: dict[str, list[Any]], archive: Any) -> None:
    """Raise ValueError where an array is not what the header says; the engine trusts its sizes."""
    for key, wanted in stated.items():
        found = archive[key]
        if [*found.shape, str(found.dtype)] != wanted:
            raise ValueError(f"{key} is {found.dtype} of shape {found.shape}, not {wanted}")


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open the archive; whatever is wrong with the file becomes a `CheckpointError`."""
    try:
        # NumPy leaves a file open that is no archive.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            yield archive
    except FileNotFoundError as error:
        raise CheckpointError(f"{path} does not exist; give a checkpoint or its folder") from error
    except Error:
        raise
    # NumPy, zipfile and zlib raise whatever they come upon in a damaged file.
    except Exception as error:
        size = path.stat().st_size if path.is_file() else 0
        raise CheckpointError(
            f"{path} is not a complete checkpoint: {size} bytes, {error}; it is truncated or "
            "damaged, use the other generation in its folder"
        ) from error


def _files_of(path: Path) -> list[Path]:
    """Return the checkpoints in the folder of a run, newest first; at least one."""
    folder = path / "checkpoints" if (path / "checkpoints").is_dir() else path
    found = find_checkpoints(folder)
    if not found:
        raise CheckpointError(
            f"{folder} holds no checkpoint; give a checkpoint file, or the folder of a run with "
            "a checkpoint interval"
        )
    return found


def find_newest(path: Path, read: Callable[[Path], T]) -> tuple[Path, T]:
    """Return the file `path`, or the newest whole checkpoint of a folder, and what `read` gives.

    A file that is not complete is skipped with a warning; the last one's error is raised.
    """
    try:
        folder = path.is_dir()
    except OSError as error:  # a name that is too long
        raise CheckpointError(f"{path}: cannot be read: {error.strerror}") from error
    if not folder:
        return path, read(path)
    *newer, oldest = _files_of(path)
    for candidate in newer:
        try:
            return candidate, read(candidate)
        except CheckpointError as error:
            warnings.warn(f"{error}; an older one is used", ModelWarning, stacklevel=4)
    return oldest, read(oldest)
