"""What an output folder holds of an earlier run: whose it is, what of it stays, what is damaged."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from libmpm._src.errors import Error, ModelWarning, OutputError, SceneError
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output import frames
from libmpm._src.output.atomic_files import TEMPORARY, file_name, replacing, writing
from libmpm._src.output.reading_files import array_of, read_object, reading
from libmpm._src.output.sensor_file import REMEDY, WHAT
from libmpm._src.output.series import Series
from libmpm._src.scene.scene import Scene

__all__ = [
    "clear",
    "cut_folder",
    "document_of",
    "frame_times",
    "has_results",
    "other_run",
    "read_log",
]

#: What a run writes and nobody else.
_RESULTS = ("sensors.h5", "log.json")
_NUMBER = (int, float)
#: What the log of a run has, as far as anything follows from it.
_LOG: dict[str, type | tuple[type, ...]] = {
    **dict.fromkeys(("status", "message", "version", "device", "writer", "began"), str),
    **dict.fromkeys(("precision", "pipeline"), str),
    **dict.fromkeys(("time", "wall_time", "particle_steps_per_s"), _NUMBER),
    "steps": int, "particles": dict, "displaced": dict, "output": dict,
}  # fmt: skip
#: Rows of a series that are compared: they follow from all before them.
_ROWS = 64


def read_log(folder: Path) -> dict[str, Any]:
    """Return ``log.json`` without what is no such value; empty where there is no whole one."""
    try:
        content = read_object(folder / "log.json", "log of a run", "")
    except Error:
        return {}
    return {k: v for k, v in content.items() if isinstance(v, _LOG.get(k, object))}


def has_results(folder: Path) -> str:
    """Return the name of a result that a folder holds; empty where it holds none."""
    for name in _RESULTS:
        if (folder / name).exists():
            return name
    for pattern in ("frames/*.vtkhdf", "checkpoints/step_*.npz"):
        found = next(folder.glob(pattern), None)
        if found is not None:
            return found.relative_to(folder).as_posix()
    return ""


def _described(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return what of a scene file describes the scene: a function of a sensor may be another."""
    scene = {k: v for k, v in document.items() if k not in ("run", "$schema")}
    sensors = scene.get("sensors")
    if isinstance(sensors, list):
        scene["sensors"] = [
            part | {"sensor": {k: v for k, v in part["sensor"].items() if k != "function"}}
            if isinstance(part, dict) and isinstance(part.get("sensor"), dict)
            else part
            for part in sensors
        ]
    return scene


def _same_scene(document: Mapping[str, Any], wanted: Mapping[str, Any]) -> bool:
    """Return whether two scene files describe the same scene, however they write defaults."""
    # Through text, as one of them came from a file: lists for tuples.
    given, own = _described(document), json.loads(json.dumps(_described(wanted)))
    if given == own:
        return True
    try:
        return Scene.from_dict(given).to_dict() == Scene.from_dict(own).to_dict()
    except Error:
        return False


def document_of(folder: Path) -> tuple[dict[str, Any] | None, str]:
    """Return the scene file of a folder, or its newest checkpoint's scene, and what is wrong."""
    path = folder / "scene.json"
    try:
        return read_object(path, "scene file", "the newest checkpoint has the scene too"), ""
    except Error as error:
        problem = str(error)
    for checkpoint in checkpoints.find_checkpoints(folder / "checkpoints"):
        try:
            header = checkpoints.load_header(checkpoint)[0]
        except Error:
            continue
        run = {"run": header["run"]} if header.get("run") else {}
        return header["scene"] | run, problem
    return None, problem


def other_run(folder: Path, wanted: Mapping[str, Any], series: Sequence[Series]) -> str:
    """Return why the results in a folder are not those of a run; empty where they may be.

    `wanted` is the scene file of the run that continues, `series` what its sensors have recorded:
    the folder's own must have the same samples, as far as both go.
    """
    document, problem = document_of(folder)
    if problem:
        warnings.warn(problem, ModelWarning, stacklevel=5)
    if document is None:
        return "a run whose scene cannot be read"
    if not _same_scene(document, wanted):
        name = document.get("name")
        return f"the run of another scene{f' ({name!r:.40})' if name else ''}"
    return _other_samples(folder / "sensors.h5", series)


def _other_samples(path: Path, series: Sequence[Series]) -> str:
    if not path.exists():
        return ""
    try:
        with reading(path, WHAT, REMEDY), h5py.File(path, "r", locking=False) as file:
            for one in series:
                group = file.get(file_name(one.name))
                if group is None:
                    continue
                count = min(len(one), len(group["time"]), len(group["values"]))
                rows = slice(max(0, count - _ROWS), count)
                for name, own in (("time", one.time), ("values", one.values)):
                    kept = array_of(group[name], rows)
                    if not np.array_equal(kept, own[rows], equal_nan=True):
                        return f"another run of this scene (sensor '{one.name}' has other samples)"
    except SceneError as error:
        warnings.warn(str(error), ModelWarning, stacklevel=6)
    return ""


def clear(folder: Path, wanted: Mapping[str, Any], *, overwrite: bool) -> None:
    """Remove the results of an earlier run; raises `OutputError` unless that is asked for."""
    found = has_results(folder)
    what = f"the results of an earlier run ({found})" if found else ""
    scene = folder / "scene.json"
    if not found and not overwrite and scene.exists():
        try:
            same = _same_scene(read_object(scene, "scene file", ""), wanted)
        except Error:
            same = False
        what = "" if same else "a scene.json of another scene"
    if what and not overwrite:
        raise OutputError(
            f"{folder} holds {what}; choose another folder, resume that run, or pass "
            "overwrite=True (command line: --overwrite)"
        )
    with writing(folder):
        stale = [folder / name for name in (*_RESULTS, "removed.csv", "scene.json")]
        stale += folder.glob(f"*{TEMPORARY}")
        for name, patterns in (
            ("frames", ("*.vtkhdf", "*.series", f"*{TEMPORARY}")),
            ("frames/parts", ("*.vtkhdf", f"*{TEMPORARY}")),
            ("checkpoints", ("step_*.npz", f"*{TEMPORARY}")),
            ("csv", ("*.csv",)),
        ):
            for pattern in patterns:
                stale += (folder / name).glob(pattern)
        for path in stale:
            path.unlink(missing_ok=True)


def cut_folder(folder: Path, reached: int | None, step: int) -> None:
    """Remove what lies after a checkpoint: frames above number `reached`, rows after `step`."""
    with writing(folder):
        if reached is not None:
            for numbered in frames.list_frames(folder / "frames").values():
                for index, path in numbered.items():
                    if index > reached:
                        path.unlink()
            frames.cut_parts(folder / "frames", reached)
        for path in checkpoints.find_checkpoints(folder / "checkpoints"):
            if checkpoints.step_of(path) > step:
                path.unlink()
        for name in (".", "frames", "frames/parts", "checkpoints"):
            for part in (folder / name).glob(f"*{TEMPORARY}"):
                part.unlink()
        _cut_removed(folder / "removed.csv", step)


def _rows_of(lines: Iterable[str]) -> list[list[str]]:
    """Return the rows of a table; a line that is none becomes an empty row."""
    text = [line.replace("\0", "\N{REPLACEMENT CHARACTER}") for line in lines]
    try:
        return list(csv.reader(text))
    except csv.Error:
        return list(csv.reader(line if len(line) < 1000 else "" for line in text))


def _cut_removed(path: Path, step: int) -> None:
    if not path.exists():
        return
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        rows = _rows_of(file)
    kept, damaged = rows[:1], 0
    for row in rows[1:]:
        whole = len(row) == len(rows[0]) and row[0].isdecimal() and len(row[0]) < 20
        damaged += not whole
        if whole and int(row[0]) <= step:
            kept.append(row)
    # The row in flight when a process was killed is cut short: that is no damage.
    if damaged - (len(rows) > 1 and len(rows[-1]) < len(rows[0])):
        warnings.warn(
            f"{path}: {damaged} of {len(rows) - 1} rows cannot be read and are left out",
            ModelWarning, stacklevel=6,
        )  # fmt: skip
    with replacing(path) as part, part.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(kept)


def frame_times(folder: Path, body: str) -> dict[int, float]:
    """Return index -> time, s, of the whole frames of a body; others are named in a warning."""
    times: dict[int, float] = {}
    damaged: list[str] = []
    for index, path in frames.list_frames(folder).get(body, {}).items():
        try:
            times[index] = frames.frame_time(path)
        except Error as error:
            damaged.append(str(error))
    if damaged:
        more = f"; and {len(damaged) - 1} more" if len(damaged) > 1 else ""
        warnings.warn(
            f"{damaged[0]}{more}; the run continues without it, as it cannot be written again",
            ModelWarning, stacklevel=6,
        )  # fmt: skip
    return times
