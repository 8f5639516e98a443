"""`Results` and `load`: reading what a run has written, each file when it is asked for."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, overload

import h5py
import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import file_path, keywords_only, known, nearest, quoted
from libmpm._src.base.values import Checker
from libmpm._src.errors import ModelWarning, SceneError
from libmpm._src.output import frames, sensor_file
from libmpm._src.output.checkpoint import find_checkpoints
from libmpm._src.output.earlier_run import document_of, has_results, read_log
from libmpm._src.output.hdf5_image import attributes_of
from libmpm._src.output.reading_files import array_of, is_cut, reading
from libmpm._src.output.sensor_file import series_of
from libmpm._src.output.series import Series
from libmpm._src.scene.scene import Scene

__all__ = ["BodyFrames", "Frame", "Results", "load"]


class Frame(Mapping[str, NDArray[Any]]):
    """One body at one time: ``frame["position"]`` is a NumPy array, read when asked for.

    Scalars are (n,), vectors (n, dimension), tensors (n, dimension, dimension), in SI units; rows
    are sorted by id, positions are in world coordinates, m. Of a body of elements rows are its
    vertices, and `elements` and attributes ``element_...`` have one for each element.
    """

    def __init__(self, path: Path, dimension: int) -> None:
        """Read what the frame holds, no array."""
        self.path = path
        self._dimension = dimension
        with reading(path, frames.WHAT, frames.REMEDY):
            with h5py.File(path, "r", locking=False) as file:
                about = attributes_of(file["libmpm"])
                self._units = {k: str(v) for k, v in attributes_of(file["libmpm/units"]).items()}
                cells = file["VTKHDF"].get("CellData", {})
                self._names = ["position", *file["VTKHDF/PointData"], *cells]
                self._of_cells = frozenset(cells)
                self._count = int(file["VTKHDF/NumberOfPoints"][0])
                whole = "VTKHDF/Connectivity" in file
                self._cells = int(file["VTKHDF/NumberOfCells"][0]) if whole else 0
            self.body = str(about["body"])
            self.index, self.step = int(about["index"]), int(about["step"])
            time = float(about["time"])
            if not math.isfinite(time):
                raise ValueError(f"its time is {time}")
        #: Simulated time, s.
        self.time = time
        #: What the writer noted besides: version, precision, ...
        self.metadata = about

    @property
    def count(self) -> int:
        """Number of particles."""
        return self._count

    @property
    def elements(self) -> NDArray[Any] | None:
        """Vertices of each element, rows of "position", (m, d + 1); None of a body of particles.

        Attributes ``element_...`` have a row for each. Raises `SceneError` where it is damaged.
        """
        if not self._cells:
            return None
        with (
            reading(self.path, frames.WHAT, frames.REMEDY),
            h5py.File(self.path, "r", locking=False) as file,
        ):
            rows = array_of(file["VTKHDF/Connectivity"])
            if rows.size != self._cells * (self._dimension + 1):
                raise ValueError(f"it has {rows.size} vertices of {self._cells} elements")
            return rows.reshape(self._cells, self._dimension + 1)

    @property
    def names(self) -> list[str]:
        """Attributes that the frame holds."""
        return list(self._names)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each attribute; empty where it is not known."""
        return {name: self._units.get(name, "") for name in self._names}

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return one attribute; raises `KeyError` naming those there are.

        Raises `SceneError` where the file is damaged.
        """
        if not known(name, self._names):
            raise KeyError(
                f"{self.path.name} has no {quoted(name)}; {nearest(name, self._names)}; what "
                "a frame lacks a checkpoint may have: libmpm export CHECKPOINT --attributes"
            )
        with (
            reading(self.path, frames.WHAT, frames.REMEDY),
            h5py.File(self.path, "r", locking=False) as file,
        ):
            group = "CellData" if name in self._of_cells else "PointData"
            dataset = file["VTKHDF/Points" if name == "position" else f"VTKHDF/{group}/{name}"]
            frames.require_parts(self.path, dataset)
            whole = array_of(dataset)
            expected = self._cells if name in self._of_cells else self._count
            if whole.ndim < 1 or len(whole) != expected:
                raise ValueError(f"'{name}' has {whole.shape} values of {expected}")
            return self._narrow(whole, name)

    def _narrow(self, values: NDArray[Any], name: str) -> NDArray[Any]:
        """Take off what VTK needs and a plane scene does not have."""
        d = self._dimension
        if values.ndim == 2 and values.shape[1] == d * d and (d == 3 or d * d == 4):
            return values.reshape(-1, d, d)
        if values.ndim == 2 and values.shape[1] == 3 and d == 2 and not values[:, 2].any():
            return np.ascontiguousarray(values[:, :2])
        return values

    def __iter__(self) -> Iterator[str]:
        """Iterate over the attribute names."""
        return iter(self._names)

    def __len__(self) -> int:
        """Return the number of attributes."""
        return len(self._names)

    def __repr__(self) -> str:
        """Return body, count, time and attributes."""
        return (
            f"<frame {self.index} of '{self.body}' at {self.time:g} s: {self.count} particles, "
            f"{', '.join(self._names)}>"
        )


class BodyFrames(Sequence[Frame]):
    """The frames of one body in the order of time."""

    def __init__(self, body: str, paths: Mapping[int, Path], dimension: int) -> None:
        """List the files; none is opened."""
        self.body = body
        self._paths = dict(sorted(paths.items()))
        self._dimension = dimension

    @property
    def indices(self) -> list[int]:
        """Numbers of the frames: number k is due at k times the frame interval."""
        return list(self._paths)

    @functools.cached_property
    def times(self) -> NDArray[np.float64]:
        """Simulated time of each frame, s, (frames,); NaN of one that is damaged and not listed."""
        if not self._paths:
            return np.empty(0)
        listed = frames.read_series(next(iter(self._paths.values())).parent, self.body)
        return np.array([listed[i] if i in listed else _time(p) for i, p in self._paths.items()])

    @property
    def damaged(self) -> list[Path]:
        """Files that are empty or cut short."""
        return [path for path in self._paths.values() if is_cut(path)]

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._paths)

    @overload
    def __getitem__(self, which: int) -> Frame: ...
    @overload
    def __getitem__(self, which: slice) -> BodyFrames: ...
    def __getitem__(self, which: int | slice) -> Frame | BodyFrames:
        """Return the frame at a place in the list, or a part of the list."""
        items = list(self._paths.items())
        if isinstance(which, slice):
            return BodyFrames(self.body, dict(items[which]), self._dimension)
        return Frame(items[which][1], self._dimension)

    def at(self, time: float) -> Frame:
        """Return the frame nearest to `time`, s."""
        if not self._paths:
            raise SceneError(f"body '{self.body}': the run has no frames; give a frame_interval")
        check = Checker(f"body '{self.body}'")
        time = check.number("time", time, unit="s")
        check.finish()
        if np.isnan(self.times).all():
            return self[0]
        return self[int(np.nanargmin(np.abs(self.times - time)))]

    def __repr__(self) -> str:
        """Return body, number and span of time."""
        span = f", {self.times[0]:g} to {self.times[-1]:g} s" if len(self) else ""
        return f"<frames of '{self.body}': {len(self)}{span}>"


def _time(path: Path) -> float:
    """Return the time of a frame, s; NaN and a warning where it is damaged."""
    try:
        return frames.frame_time(path)
    except SceneError as error:
        warnings.warn(str(error), ModelWarning, stacklevel=4)
        return math.nan


class _Sensors(Mapping[str, Series]):
    """Sensor name -> series, read from the file when asked for."""

    def __init__(self, path: Path, order: Sequence[str]) -> None:
        self._path = path
        self._order = order

    @functools.cached_property
    def _groups(self) -> dict[str, str]:
        if not self._path.exists():
            return {}
        with (
            reading(self._path, sensor_file.WHAT, sensor_file.REMEDY),
            h5py.File(self._path, "r", locking=False) as file,
        ):
            found = {str(attributes_of(group)["name"]): key for key, group in file.items()}
        return {name: found[name] for name in _ordered(found, self._order)}

    def __getitem__(self, name: str) -> Series:
        if name not in self._groups:
            raise KeyError(f"no sensor '{name}'; {nearest(name, self._groups)}")
        key = self._groups[name]
        with (
            reading(self._path, f"{sensor_file.WHAT} ('{name}')", sensor_file.REMEDY),
            h5py.File(self._path, "r", locking=False) as file,
        ):
            return series_of(file[key])

    def __iter__(self) -> Iterator[str]:
        return iter(self._groups)

    def __len__(self) -> int:
        return len(self._groups)

    def __repr__(self) -> str:
        return f"<sensors of {self._path.parent}: {', '.join(self._groups) or 'none'}>"


class Results:
    """What a run has written into its folder; see `libmpm.load`.

    Nothing is read before it is asked for, nothing is kept but names, and nothing is locked: a run
    that is still running can be read, and shows what it has written since.
    """

    def __init__(self, path: str | Path) -> None:
        """Take a folder; raises `SceneError` unless a run has written it."""
        self.path = file_path(path, "load")
        try:
            found = has_results(self.path)
        except OSError as error:
            raise SceneError(f"{self.path}: cannot be read: {error.strerror}") from error
        if not found:
            raise SceneError(
                f"{self.path}: holds no scene.json with results beside it; expected the folder "
                "that a run has written, such as OUT of libmpm run scene.json -o OUT"
            )

    @functools.cached_property
    def document(self) -> dict[str, Any]:
        """The scene file of the run, with its "run" key; where damaged, of its newest checkpoint.

        Raises `SceneError` where neither can be read.
        """
        document, problem = document_of(self.path)
        if document is None:
            raise SceneError(f"{problem}, but there is no complete one: restore the scene file")
        if problem:
            warnings.warn(f"{problem}: it is taken", ModelWarning, stacklevel=2)
        return document

    @functools.cached_property
    def scene(self) -> Scene:
        """The scene that was run."""
        return Scene.from_dict(self.document)

    @property
    def log(self) -> dict[str, Any]:
        """How the run went: status, time, steps, device, ... as in ``log.json``.

        Without what is damaged, with a warning; empty where there is none.
        """
        content = read_log(self.path)
        if not content and (self.path / "log.json").exists():
            warnings.warn(
                f"{self.path / 'log.json'}: is not a complete log; its content is left out",
                ModelWarning, stacklevel=2,
            )  # fmt: skip
        return content

    @property
    def sensors(self) -> Mapping[str, Series]:
        """Sensor name -> `time` (n,) s, `values` (n, components), `components` and `units`."""
        order = _names(self.document, "sensors")
        return _Sensors(self.path / "sensors.h5", order)

    @property
    def frames(self) -> dict[str, BodyFrames]:
        """Body name -> its frames in the order of time."""
        dimension = 2 if self.document.get("dimension") == 2 or "grid" in self.document else 3
        found = frames.list_frames(self.path / "frames")
        order = _names(self.document, "bodies")
        return {n: BodyFrames(n, found[n], dimension) for n in _ordered(found, order)}

    @property
    def checkpoints(self) -> list[Path]:
        """Checkpoint files, the newest first."""
        return find_checkpoints(self.path / "checkpoints")

    def __repr__(self) -> str:
        """Return folder and status."""
        log = self.log
        return (
            f"<Results {self.path}: {log.get('status', 'no log')} at {log.get('time', 0.0):g} s, "
            f"{len(self.sensors)} sensors, frames of {', '.join(self.frames) or 'no body'}>"
        )


def _names(document: Mapping[str, Any], kind: str) -> list[str]:
    """Return the names of the bodies or sensors of a scene file."""
    parts = document.get(kind)
    entries = parts if isinstance(parts, list) else []
    return [str(part["name"]) for part in entries if isinstance(part, dict) and "name" in part]


def _ordered(found: Mapping[str, object], order: Sequence[str]) -> list[str]:
    """Return names in the scene's order, then what else there is."""
    return [n for n in order if n in found] + sorted(set(found) - set(order))


@keywords_only("load", 1, method=False)
def load(path: str | Path) -> Results:
    """Open the folder of a run: ``libmpm.load("out").sensors["load"].values``.

    `frames["water"][-1]["velocity"]` is an array of the last frame, `scene` the scene, `log` how it
    went. Raises `SceneError` where no run has written the folder.
    """
    return Results(path)
