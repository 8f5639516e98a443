"""Results in other formats: VTKHDF, CSV and NumPy, from a run's folder or a checkpoint."""

from __future__ import annotations

import math
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.schedule import due_time
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import ModelWarning, OutputError, SceneError
from libmpm._src.output import frames
from libmpm._src.output.atomic_files import file_name, replacing, writing
from libmpm._src.output.reading_files import is_cut
from libmpm._src.output.results import BodyFrames, Frame, Results
from libmpm._src.output.sensor_file import append_csv
from libmpm._src.output.series import Series
from libmpm._src.shapes.element_mesh import ElementMesh

__all__ = ["FORMATS", "Picture", "export", "whole_series"]

FORMATS = ("vtkhdf", "csv", "npz")

#: What a frame of a checkpoint holds where nothing is asked for.
_DEFAULT = ("velocity", "pressure")

#: Seconds between frames that a log may name: integers of JSON have no end.
_MOST = 1e30

#: Rows of a CSV file that are turned into text at a time.
_ROWS = 1 << 16


@dataclass(frozen=True)
class Picture:
    """One body at one time, ready to be written; `elements` (m, d + 1) of a body of them.

    `arrays` holds "position" (n, d) m in the world and what else was asked for; `units` their SI
    units, `metadata` time (s), step, body, index, precision and version.
    """

    arrays: dict[str, NDArray[Any]]
    units: dict[str, str]
    metadata: dict[str, Any]
    elements: NDArray[Any] | None = None


def export(
    source: str | Path,
    to: str,
    *,
    output: str | Path | None = None,
    bodies: Sequence[str] | None = None,
    attributes: Sequence[str] | None = None,
    first: float = -math.inf,
    last: float = math.inf,
    sensors: bool = True,
    one_file: bool = False,
    device: str | None = None,
) -> list[Path]:
    """Write frames and sensors of `source` in another format; return the files.

    ==========  ====  ==========  =============================================================
    parameter   unit  range       meaning
    ==========  ====  ==========  =============================================================
    source      -     a path      folder of a run, or a checkpoint file
    to          -     see below   "vtkhdf", "csv" or "npz"
    output      -     a folder    None = "export" in the run's folder or beside the checkpoint
    bodies      -     names       None = all
    attributes  -     names       besides the position; None = all that frames hold, of a
                                  checkpoint velocity and pressure
    first       s     any         frames and samples from this time on
    last        s     any         up to this time
    sensors     -     bool        whether series are written too
    one_file    -     bool        "npz": all in one file instead of one a frame
    device      -     a device    that reads a checkpoint; None = the one that wrote it
    ==========  ====  ==========  =============================================================

    Frames become ``<body>_<index>`` with the format's ending: VTKHDF as the run writes it, CSV
    with a column for each component, its unit in the head, or NumPy archives with an array for each
    attribute, "time" and "step". Of bodies of elements CSV has a second file,
    ``<body>_<index>.elements.csv``, and archives have "elements". Sensors become ``<sensor>.csv``
    or ``sensors.npz``; VTKHDF has none. A checkpoint gives one frame, numbered by its step, of
    every attribute the engine knows. Frames and series that are damaged are left out, with a
    warning each.
    Raises `SceneError`, `CheckpointError`, `OutputError`.
    """
    bodies = (bodies,) if isinstance(bodies, str) else bodies
    attributes = (attributes,) if isinstance(attributes, str) else attributes
    if to not in FORMATS:
        raise SceneError(f"export: the format is {shown(to)}; {nearest(str(to), FORMATS)}")
    if one_file and to != "npz":
        raise SceneError(f"export: one file is asked for of {to}; expected npz; leave it out")
    if last < first:
        raise SceneError(f"export: the end {last:g} s is before the start {first:g} s; swap them")
    source = Path(source)
    found: Mapping[str, Series] = {}
    if source.is_file():
        pictures = _of_checkpoint(source, bodies, attributes, device)
        target = source.parent / "export"
    else:
        results = Results(source)
        pictures = _of_run(results, bodies, attributes, first, last)
        found = results.sensors if sensors else {}
        target = source / "export"
    target = target if output is None else Path(output)
    if target.resolve() in (source.resolve() / "frames", source.resolve() / "csv"):
        raise SceneError(
            f"export: {target} holds the run's own results, which it would replace; choose another "
            "folder"
        )
    with writing(target):
        target.mkdir(parents=True, exist_ok=True)
    whole = whole_series(found)
    cut = (_between(series, first, last) for series in whole)
    if one_file:
        return [_one_archive(target / "run.npz", pictures, cut)]
    made = [_WRITERS[to](target, picture) for picture in pictures]
    if to == "vtkhdf":
        _list_frames(target, made)
    elif to == "csv":
        made += [_sensor_csv(target, series) for series in cut]
    elif whole:
        made.append(_archive(target / "sensors.npz", _sensor_arrays(cut)))
    return made


# What there is -----------------------------------------------------------------------------------


def _check_bodies(asked: Sequence[str] | None, have: Sequence[str], where: str) -> list[str]:
    for name in asked or ():
        if name not in have:
            raise SceneError(f"export: {where} has no body '{name}'; {nearest(name, have)}")
    return [name for name in have if asked is None or name in asked]


def _check_attributes(what: str, asked: Sequence[str], have: Sequence[str]) -> None:
    for name in asked:
        if name not in have:
            raise SceneError(
                f"export: {what}: there is no '{name}'; {nearest(name, have)}; what frames lack a "
                "checkpoint of the run has"
            )


def _of_run(
    results: Results,
    bodies: Sequence[str] | None,
    attributes: Sequence[str] | None,
    first: float,
    last: float,
) -> Iterator[Picture]:
    """Return the frames of a run one by one; what is missing is refused before any is written."""
    found = results.frames
    if bodies is not None or attributes is not None:
        names = _check_bodies(bodies, list(found), f"frames of {results.path}")
    else:
        names = list(found)
    if attributes is not None:
        for body in names:
            whole = next(_whole(found[body]), None)
            have = [] if whole is None else whole.names
            _check_attributes(f"frames of body '{body}'", attributes, have)
    interval = results.log.get("output", {}).get("frame_interval")
    if not isinstance(interval, int | float) or not 0 < interval < _MOST:
        interval = None

    def made() -> Iterator[Picture]:
        for body in names:
            for frame in _whole(found[body], say=True):
                # A frame belongs to the time that it was due at, a part of a step before its own.
                due = due_time(frame.index, interval) if interval else frame.time
                if frame.time < first or due > last:
                    continue
                chosen = frame.names if attributes is None else ["position", *attributes]
                _check_attributes(f"frame {frame.path}", chosen, frame.names)
                try:
                    arrays = {name: frame[name] for name in dict.fromkeys(chosen)}
                except (SceneError, OutputError) as error:
                    _leave_out(error)
                    continue
                yield Picture(arrays, frame.units, frame.metadata, frame.elements)

    return made()


def _leave_out(error: Exception) -> None:
    """Say that something damaged is not exported; the rest is."""
    warnings.warn(f"{error}; it is left out", ModelWarning, stacklevel=3)


def _whole(found: BodyFrames, *, say: bool = False) -> Iterator[Frame]:
    """Yield the frames of a body that can be opened; `say` what the others are."""
    for i in range(len(found)):
        try:
            frame = found[i]
        except SceneError as error:
            if say:
                _leave_out(error)
            continue
        yield frame


def whole_series(found: Mapping[str, Series]) -> list[Series]:
    """Return the series of a run that can be read; what cannot be is named in a warning."""
    kept = []
    try:
        for name in found:
            try:
                kept.append(found[name])
            except SceneError as error:
                _leave_out(error)
    except SceneError as error:
        _leave_out(error)
    return kept


def _of_checkpoint(
    path: Path,
    bodies: Sequence[str] | None,
    attributes: Sequence[str] | None,
    device: str | None,
) -> Iterator[Picture]:
    """Return one frame of every body of a checkpoint."""
    from libmpm._src.run.simulation import Simulation

    simulation = Simulation.resume(path, device=device)
    names = _check_bodies(bodies, list(simulation.particles), str(path))
    for body in names:
        have = simulation.particles[body].names
        _check_attributes(f"body '{body}'", attributes or (), have)

    def made() -> Iterator[Picture]:
        for body in names:
            view = simulation.particles[body]
            chosen = _DEFAULT if attributes is None else attributes
            arrays = view.read(list(dict.fromkeys(["position", *chosen])))
            metadata = {
                "time": simulation.time, "step": simulation.steps, "body": body,
                "index": simulation.steps, "precision": simulation.precision,
                "version": simulation.version,
            }  # fmt: skip
            units = {name: frames.UNITS.get(name, "") for name in arrays}
            shape = next(b.shape for b in simulation.scene.bodies if b.name == body)
            mesh = shape.rows() if isinstance(shape, ElementMesh) else None
            yield Picture(arrays, units, metadata, mesh)

    return made()


def _between(series: Series, first: float, last: float) -> Series:
    """Return the samples of a span of time."""
    time, values = series.since(0)
    kept = (time >= first) & (time <= last)
    made = Series(series.name, series.components, series.units, series.attributes)
    made.append(time[kept], values[kept])
    return made


# Formats -----------------------------------------------------------------------------------------


def _path(folder: Path, picture: Picture, ending: str) -> Path:
    index = int(picture.metadata["index"])
    return folder / f"{file_name(picture.metadata['body'])}_{index:06d}.{ending}"


def _vtkhdf(folder: Path, picture: Picture) -> Path:
    path = _path(folder, picture, "vtkhdf")
    real = np.float32 if picture.metadata.get("precision") == "single" else np.float64
    others = {k: v for k, v in picture.arrays.items() if k != "position"}
    frames.write_frame(
        path, picture.arrays["position"], others, picture.metadata, real=real,
        elements=picture.elements,
    )  # fmt: skip
    return path


def _list_frames(folder: Path, made: Sequence[Path]) -> None:
    """Write the list of times that ParaView reads, for the bodies that were exported."""
    listed = frames.list_frames(folder)
    names = {path.name for path in made}
    for body, numbered in listed.items():
        if any(path.name in names for path in numbered.values()):
            times = {i: frames.frame_time(path) for i, path in numbered.items() if not is_cut(path)}
            frames.write_series(folder, body, times)


def _columns(name: str, values: NDArray[Any], dimension: int) -> list[str]:
    """Return the names of the columns of an attribute: position_x, stress_xy, ..."""
    axes = "xyz"[:dimension]
    if values.ndim == 1:
        return [name]
    if values.ndim == 3:
        return [f"{name}_{a}{b}" for a in axes for b in axes]
    if values.shape[1] == dimension:
        return [f"{name}_{a}" for a in axes]
    return [f"{name}_{i}" for i in range(values.shape[1])]


def _csv(folder: Path, picture: Picture) -> Path:
    path = _path(folder, picture, "csv")
    arrays = picture.arrays
    points = {name: array for name, array in arrays.items() if not frames.of_elements(name)}
    _table(path, picture, points)
    if picture.elements is not None:
        cells: dict[str, NDArray[Any]] = {
            f"vertex_{i}": column for i, column in enumerate(picture.elements.T)
        }
        cells |= {name: array for name, array in arrays.items() if frames.of_elements(name)}
        _table(path.with_suffix(".elements.csv"), picture, cells)
    return path


def _table(path: Path, picture: Picture, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of one length as columns."""
    position = picture.arrays["position"]
    rows = len(next(iter(arrays.values())))
    titles: list[str] = []
    columns: list[NDArray[Any]] = []
    for name, values in arrays.items():
        unit = picture.units.get(name, "")
        names = _columns(name, values, position.shape[1])
        titles += [f"{n} [{unit}]" if unit else n for n in names]
        columns += list(values.reshape(rows, math.prod(values.shape[1:])).T)
    with (
        replacing(path) as part,
        part.open("w", encoding="utf-8", errors="backslashreplace", newline="") as file,
    ):
        file.write(",".join(titles) + "\n")
        # Texts take many times the memory of numbers.
        for row in range(0, rows, _ROWS):
            # A column's own type gives its shortest exact text: 0.1 for a single 0.1 too.
            texts = [column[row : row + _ROWS].astype("U") for column in columns]
            file.writelines(",".join(line) + "\n" for line in zip(*texts, strict=True))


def _sensor_csv(folder: Path, series: Series) -> Path:
    path = folder / f"{file_name(series.name)}.csv"
    append_csv(path, series, 0)
    return path


def _npz(folder: Path, picture: Picture) -> Path:
    about = {key: np.asarray(picture.metadata[key]) for key in ("time", "step")}
    if picture.elements is not None:
        about["elements"] = picture.elements
    return _archive(_path(folder, picture, "npz"), about | picture.arrays)


def _archive(path: Path, arrays: Mapping[str, NDArray[Any]]) -> Path:
    with replacing(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    return path


def _sensor_arrays(sensors: Iterator[Series]) -> dict[str, NDArray[Any]]:
    """Return "<sensor>/time", "<sensor>/values" and the texts of their columns."""
    arrays: dict[str, NDArray[Any]] = {}
    for series in sensors:
        arrays |= {
            f"{series.name}/time": series.time, f"{series.name}/values": series.values,
            f"{series.name}/components": np.array(series.components, dtype="U"),
            f"{series.name}/units": np.array(series.units, dtype="U"),
        }  # fmt: skip
    return arrays


def _one_archive(path: Path, pictures: Iterator[Picture], sensors: Iterator[Series]) -> Path:
    """Write frames as "frames/<body>/<index>/<attribute>" and sensors as "sensors/<name>/..."."""

    def members() -> Iterator[tuple[str, NDArray[Any]]]:
        for picture in pictures:
            about = picture.metadata
            prefix = f"frames/{about['body']}/{int(about['index']):06d}"
            yield from ((f"{prefix}/{key}", np.asarray(about[key])) for key in ("time", "step"))
            yield from ((f"{prefix}/{name}", item) for name, item in picture.arrays.items())
        yield from ((f"sensors/{k}", item) for k, item in _sensor_arrays(sensors).items())

    # One array at a time: all frames of a run may not fit the memory.
    with replacing(path) as part, zipfile.ZipFile(part, "w") as archive:
        for name, item in members():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, item, allow_pickle=False)
    return path


_WRITERS = {"vtkhdf": _vtkhdf, "csv": _csv, "npz": _npz}
