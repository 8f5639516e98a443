"""`libmpm info`: what is installed; what a run, a scene file or a checkpoint holds."""

from __future__ import annotations

import math
import platform
import re
from collections.abc import Iterable
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from libmpm._src.base.tables import pair_table
from libmpm._src.errors import SceneError
from libmpm._src.output.folder_lock import LOCK
from libmpm._src.output.locks import held_by, is_held
from libmpm._src.run import backends

__all__ = ["about", "collect", "describe", "packages_of", "text_of"]

#: Extras that are for work on libmpm, not with it.
_DEVELOPMENT = ("test", "docs", "dev")

#: What libmpm uses where it runs from its source folder, which has no metadata.
_USUAL = (
    "numpy", "h5py", "tqdm", "matplotlib", "scipy", "shapely", "meshio", "trimesh", "pandas",
    "statsmodels", "vtk", "pyvista",
)  # fmt: skip


def packages_of(requirements: Iterable[str]) -> list[str]:
    """Return the packages that requirements name, without those of extras for development."""
    found: dict[str, None] = {}
    for line in requirements:
        name = re.match(r"[A-Za-z0-9._-]+", line)
        extra = re.search(r"extra\s*==\s*[\"']([^\"']+)", line)
        if name and not (extra and extra[1] in _DEVELOPMENT) and name[0] != "libmpm":
            found[name[0]] = None
    return list(found)


def _packages() -> dict[str, str | None]:
    """Return package -> version, None where it is not installed."""
    try:
        names = packages_of(metadata.requires("libmpm") or ())
    except metadata.PackageNotFoundError:
        names = list(_USUAL)
    found: dict[str, str | None] = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def collect() -> dict[str, Any]:
    """Return version, builds, devices, threads, instruction set, and why CUDA is unavailable."""
    build = dict(backends.core().build_info())
    cuda = backends.cuda_status()
    return {
        **build,
        "backends": ["cpu"] + (["cuda"] if cuda.module is not None else []),
        "cuda_build": dict(cuda.module.build_info()) if cuda.module is not None else None,
        "devices": [dict(d) for d in cuda.devices],
        "cuda_unavailable": cuda.reason or None,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": _packages(),
    }


def _join(values: Any) -> str:
    return ", ".join(str(v) for v in values)


def describe() -> str:
    """Return the same as text."""
    found = collect()
    openmp = "OpenMP" if found.get("openmp") else "no OpenMP"
    rows = [
        ("libmpm", found["version"]),
        ("compiler", found.get("compiler", "unknown")),
        ("backends", _join(found["backends"])),
        ("dimensions", _join(found["dimensions"])),
        ("precisions", _join(found["precisions"])),
        ("materials", _join(found["materials"])),
        ("CPU", f"{found['threads']} threads ({openmp}), {found['instruction_set']}"),
    ]
    for device in found["devices"]:
        rows.append(
            (
                f"cuda:{device['index']}",
                f"{device['name']}, {device['memory'] / 2**30:.1f} GiB "
                f"({device['free'] / 2**30:.1f} free), compute capability "
                f"{device['compute_capability']}",
            )
        )
    if found["cuda_build"]:
        build = found["cuda_build"]
        architectures = _join(build.get("architectures", []))
        rows.append(("CUDA", f"runtime {build.get('cuda_runtime')}, {architectures}"))
    if found["cuda_unavailable"]:
        rows.append(("CUDA", f"not available: {found['cuda_unavailable']}"))
    packages = found["packages"]
    missing = [name for name, version in packages.items() if version is None]
    rows += [
        ("Python", f"{found['python']}, {found['platform']}"),
        ("packages", _join(f"{name} {v}" for name, v in packages.items() if v is not None)),
        ("missing", _join(missing) or "none"),
    ]
    return pair_table(rows, 11)


# Files --------------------------------------------------------------------------------------------


def about(path: Path) -> dict[str, Any]:
    """Return what the folder of a run, a scene file or a checkpoint holds, as plain values.

    Raises `SceneError` and `CheckpointError`.
    """
    try:
        folder = path.is_dir()
    except OSError as error:  # a name that is too long
        raise SceneError(f"{path}: cannot be read: {error.strerror}") from error
    if folder:
        return _about_run(path)
    if path.suffix == ".npz":
        return _about_checkpoint(path)
    from libmpm._src.scene.run_file import read_run_file

    source = read_run_file(path)
    return {"kind": "scene", "path": str(path)} | _about_scene(source.to_dict())


def _about_scene(document: dict[str, Any]) -> dict[str, Any]:
    """Return names and sizes of a scene that is known to be valid."""
    from libmpm._src.scene.scene import Scene

    scene = Scene.from_dict(document)
    return {
        "scene": {
            "name": scene.name,
            "dimension": scene.dimension,
            "cells": list(scene.cells),
            "cell_size": scene.cell_size,
            "bodies": {b.name: type(b.material).__name__ for b in scene.bodies},
            "boundaries": [b.name for b in scene.boundaries],
            "sensors": {s.name: type(s.sensor).__name__ for s in scene.sensors},
            "goes_on_from": None if scene.start is None else scene.start.checkpoint,
        },
        "run": document.get("run", {}),
    }


def _about_checkpoint(path: Path) -> dict[str, Any]:
    from libmpm._src.output.checkpoint import load_header

    header, _ = load_header(path)
    keys = ("version", "device", "precision", "pipeline", "time", "step", "until")
    document = header["scene"] | {"run": header.get("run") or {}}
    state = {key: header.get(key) for key in keys}
    size = {"bytes": path.stat().st_size}
    return {"kind": "checkpoint", "path": str(path)} | state | size | _about_scene(document)


def _about_run(path: Path) -> dict[str, Any]:
    from libmpm._src.output.export import whole_series
    from libmpm._src.output.results import Results

    results = Results(path)
    log = results.log
    keys = (
        "status", "message", "version", "device", "precision", "pipeline", "began", "wall_time",
        "time", "steps", "particles", "particle_steps_per_s",
    )  # fmt: skip
    frames = {}
    for body, of in results.frames.items():
        times = of.times[~np.isnan(of.times)]
        frames[body] = {
            "count": len(of), "damaged": len(of.damaged),
            "first": float(times[0]) if len(times) else None,
            "last": float(times[-1]) if len(times) else None,
        }  # fmt: skip
    sensors = {
        series.name: {
            "kind": str(series.attributes.get("kind", "")),
            "samples": len(series),
            "last": float(series.time[-1]) if len(series) else None,
        }
        for series in whole_series(results.sensors)
    }
    return {
        "kind": "run",
        "path": str(path),
        **{key: _readable(log.get(key)) for key in keys},
        "writer": _writer(path, log),
        "until": _until(results.document),
        "frames": frames,
        "sensor_files": sensors,
        "checkpoints": [p.name for p in results.checkpoints],
        **_about_scene(results.document),
    }


def _writer(path: Path, log: dict[str, Any]) -> str:
    """Return in words who runs what the log says is running."""
    if log.get("status") != "running":
        return ""
    if is_held(path / LOCK):
        return f", by {held_by(path / LOCK)}"
    return ", but its process is gone; libmpm resume continues it"


def _until(document: dict[str, Any]) -> float | None:
    """Return the end of a run, s, that its scene file names."""
    run = document.get("run")
    until = run.get("until") if isinstance(run, dict) else None
    return float(_readable(until)) if isinstance(until, int | float) else None


def _readable(value: Any) -> Any:
    """Return what a log says; a whole number beyond all floats as infinite."""
    if not isinstance(value, int) or isinstance(value, bool):
        return value
    try:
        float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf
    return value


def text_of(found: dict[str, Any]) -> str:
    """Return what `about` found as text."""
    scene = found["scene"]
    cells = " × ".join(map(str, scene["cells"]))
    rows = [
        (found["kind"], found["path"]),
        ("scene", f"{scene['name'] or 'unnamed'}, {cells} cells of {scene['cell_size']:g} m"),
        ("bodies", _join(f"{name} ({kind})" for name, kind in scene["bodies"].items())),
        ("boundaries", _join(scene["boundaries"])),
    ]
    if scene["goes_on_from"]:
        rows.append(("continues", f"from {scene['goes_on_from']}"))
    if found["kind"] == "scene":
        rows.append(("sensors", _join(f"{n} ({k})" for n, k in scene["sensors"].items())))
        rows += [(key, str(item)) for key, item in found["run"].items()]
    else:
        rows += _progress(found)
    return pair_table([(name, text or "none") for name, text in rows], 11)


def _progress(found: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a run or a checkpoint."""
    end = "" if found["until"] is None else f" of {found['until']:g} s"
    step = found["step" if found["kind"] == "checkpoint" else "steps"]
    time = found["time"]
    reached = "not begun" if time is None else f"{time:g} s{end}, step {step}"
    where = f"{found['device']}, {found['precision']}, {found['pipeline']}, {found['version']}"
    if found["kind"] == "checkpoint":
        return [("time", reached), ("written by", where), ("size", f"{found['bytes']:,} bytes")]
    message = f": {found['message']}" if found["message"] else ""
    rate = found["particle_steps_per_s"]
    counts = {n: c for n, c in (found["particles"] or {}).items() if isinstance(c, int)}
    rows = [
        ("status", f"{found['status'] or 'unknown'}{message or found['writer']}"),
        ("time", reached),
        ("device", where),
        ("wall time", f"{found['wall_time']} s, {rate or 0:.3g} particle-steps/s"),
        ("particles", _join(f"{n} {c:,}" for n, c in counts.items())),
    ]
    for body, of in found["frames"].items():
        span = "" if of["first"] is None else f", {of['first']:g} to {of['last']:g} s"
        broken = f"; {of['damaged']} are empty or cut" if of["damaged"] else ""
        rows.append(("frames", f"{body}: {of['count']}{span}{broken}"))
    for name, of in found["sensor_files"].items():
        last = "" if of["last"] is None else f" to {of['last']:g} s"
        rows.append(("sensor", f"{name} ({of['kind']}): {of['samples']} samples{last}"))
    return [*rows, ("checkpoints", _join(found["checkpoints"]))]
