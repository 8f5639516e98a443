"""Sensor series in one HDF5 file that neither a kill nor a full disk can damage.

Every dataset is one chunk with room to grow, written whole when the file is made. An append puts
raw values into that room with plain system calls and then moves the dataset's length through HDF5:
the file never grows and its structure never changes while a process may die. A full chunk is
replaced through a new, larger file and a rename. The format of HDF5 1.8 keeps HDF5's
open-for-writing mark out of the file, which would otherwise stop readers after a kill. Lengths of
values move before those of times: a reader that trims to the shorter of the two has every sample
up to the last flush.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import ModelWarning, OutputError
from libmpm._src.output.atomic_files import file_name, writing
from libmpm._src.output.hdf5_image import LIBVER, attributes_of, new_file, new_group, set_attributes
from libmpm._src.output.reading_files import array_of, reading
from libmpm._src.output.series import Series

__all__ = ["SensorFile", "append_csv", "read_sensors", "series_of"]

#: Bytes of values for which space is taken at first, per sensor.
FIRST_SPACE = 1 << 18
#: HDF5 holds no chunk of 4 GiB.
LARGEST_CHUNK = (1 << 32) - 1
#: What the file is, and what to do about one that is damaged.
WHAT, REMEDY = "sensor file", "resume the run, which writes it again from its checkpoint"


class SensorFile:
    """Writes series to `path`; `flush` brings the file up to date with them."""

    def __init__(self, path: Path, series: Sequence[Series]) -> None:
        """Create `path` with everything that `series` hold already, replacing an older file."""
        self.path = path
        self._series = list(series)
        self._file: h5py.File | None = None
        self._raw: io.FileIO | None = None
        self._written = [0 for _ in self._series]
        self._capacity = [max(64, FIRST_SPACE // (8 * max(1, len(s.components)))) for s in series]
        self._replace()

    def _replace(self) -> None:
        """Write a new file with room to grow and put it in the place of the old one."""
        self.close()
        with new_file(self.path) as file:
            set_attributes(file, {"generator": "libmpm"})
            for i, series in enumerate(self._series):
                while self._capacity[i] < 2 * len(series):
                    self._capacity[i] *= 2
                most = LARGEST_CHUNK // (8 * len(series.components))
                self._capacity[i] = min(self._capacity[i], most)
                if len(series) > most:
                    raise OutputError(
                        f"cannot write {self.path}: sensor '{series.name}' has {len(series)} "
                        "samples, more than 4 GiB; raise its interval or follow fewer particles"
                    )
                self._create(file, series, self._capacity[i])
        self._written = [len(series) for series in self._series]
        self._reopen()

    @staticmethod
    def _create(file: h5py.File, series: Series, capacity: int) -> None:
        group = new_group(file, file_name(series.name))
        listed = {"components": list(series.components), "units": list(series.units)}
        set_attributes(group, {"name": series.name, **series.attributes, **listed})
        time, values = series.since(0)
        width = len(series.components)
        kind = np.dtype("<f8")
        group.create_dataset("time", data=time, dtype=kind, maxshape=(None,), chunks=(capacity,))
        group.create_dataset(
            "values", data=values, dtype=kind, maxshape=(None, width), chunks=(capacity, width)
        )
        set_attributes(group["time"], {"unit": "s"})

    def _reopen(self) -> None:
        with writing(self.path):
            # HDF5's chunk cache must not hold what the system calls write beside it.
            self._file = h5py.File(self.path, "r+", libver=LIBVER, rdcc_nbytes=0, locking=False)
            self._raw = self.path.open("r+b", buffering=0)

    def flush(self) -> None:
        """Append what the series gained; afterwards it survives the death of the process."""
        behind = [i for i, s in enumerate(self._series) if len(s) > self._written[i]]
        if self._is_gone():
            warnings.warn(
                f"{self.path} was deleted or replaced during the run; it is written again with all "
                "samples",
                ModelWarning, stacklevel=4,
            )  # fmt: skip
            self._replace()
            return
        if not behind:
            return
        # The first sample of a sensor allocates its chunk, and so does one beyond a full chunk.
        if any(not self._written[i] or len(self._series[i]) > self._capacity[i] for i in behind):
            self._replace()
            return
        if self._file is None:
            self._reopen()
        assert self._file is not None
        with writing(self.path):
            for i in behind:
                series = self._series[i]
                time, values = series.since(self._written[i])
                group = self._file[file_name(series.name)]
                self._put(group["values"], values, self._written[i])
                self._put(group["time"], time, self._written[i])
            # Data first, everywhere: the lengths change only after all of it is in the file.
            for name in ("values", "time"):
                for i in behind:
                    dataset = self._file[file_name(self._series[i].name)][name]
                    dataset.resize(len(self._series[i]), axis=0)
                self._file.flush()
            for i in behind:
                self._written[i] = len(self._series[i])

    def _is_gone(self) -> bool:
        """Tell whether the name no longer leads to the file that is open."""
        with writing(self.path):
            try:
                found = self.path.stat()
            except FileNotFoundError:
                return True
            return self._raw is not None and not os.path.samestat(
                found, os.fstat(self._raw.fileno())
            )

    def _put(self, dataset: h5py.Dataset, data: NDArray[np.float64], first: int) -> None:
        """Write rows from index `first` on into the dataset's only chunk."""
        assert self._raw is not None
        row = 8 * (data.shape[1] if data.ndim == 2 else 1)
        start = dataset.id.get_chunk_info(0).byte_offset + row * first
        content = memoryview(np.ascontiguousarray(data, "<f8").tobytes())
        while content:
            done = os.pwrite(self._raw.fileno(), content, start)
            content, start = content[done:], start + done

    def close(self) -> None:
        """Close the file; a later `flush` opens it again."""
        if self._file is not None:
            # A full disk makes closing fail too; the error was reported by the write before it.
            with contextlib.suppress(OSError, RuntimeError):
                self._file.close()
            self._file = None
        if self._raw is not None:
            self._raw.close()
            self._raw = None


def read_sensors(path: Path) -> dict[str, Series]:
    """Return name -> series of a sensor file, also of one whose writer was killed.

    Times and values are trimmed to the shorter of the two, and to the samples with a time. Raises
    `SceneError` where the file is missing or damaged.
    """
    result = {}
    with reading(path, WHAT, REMEDY), h5py.File(path, "r", locking=False) as file:
        for group in file.values():
            series = series_of(group)
            result[series.name] = series
    return result


def series_of(group: h5py.Group) -> Series:
    """Return the series of one group of a sensor file, trimmed as `read_sensors` says.

    Of a damaged file it raises whatever h5py and NumPy do: see `reading`.
    """
    attributes = attributes_of(group)
    name = str(attributes.pop("name"))
    series = Series(
        name,
        tuple(str(c) for c in attributes.pop("components")),
        tuple(str(u) for u in attributes.pop("units")),
        attributes,
    )
    count = min(len(group["time"]), len(group["values"]))
    time, values = (array_of(group[key], slice(count)) for key in ("time", "values"))
    if time.ndim != 1 or values.shape != (count, len(series.components)):
        raise ValueError(f"sensor '{name}' has times {time.shape} and values {values.shape}")
    known = np.isfinite(time)
    series.append(time[known], values[known])
    return series


def append_csv(path: Path, series: Series, first: int) -> None:
    """Write the samples from index `first` on to `path`; 0 starts the file with its header.

    A file that is gone is started again, with all samples.
    """
    first = first if path.exists() else 0
    time, values = series.since(first)
    with (
        writing(path),
        path.open(
            "a" if first else "w", encoding="utf-8", errors="backslashreplace", newline=""
        ) as file,
    ):
        if not first:
            titles = [f"{c} [{u}]" for c, u in zip(series.components, series.units, strict=True)]
            file.write(",".join(["time [s]", *titles]) + "\n")
        for t, row in zip(time, values, strict=True):
            file.write(",".join([repr(float(t)), *(repr(float(v)) for v in row)]) + "\n")
