"""Particle frames as VTKHDF, for ParaView: one PolyData file per body and frame.

A body of elements is an UnstructuredGrid: its vertices are the points, its elements the cells.

One file per body, not one composite file: each opens on its own in ParaView and VTK, groups into a
time series by its number, and a kill loses the file in flight and nothing else. Metadata lies in
the group ``/libmpm`` because strings inside ``/VTKHDF`` crash VTK's reader.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import h5py
import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import OutputError
from libmpm._src.output.atomic_files import file_name, write_json
from libmpm._src.output.hdf5_image import attributes_of, new_file, new_group, set_attributes
from libmpm._src.output.reading_files import array_of, is_cut, reading

__all__ = [
    "cut_parts",
    "frame_path",
    "frame_time",
    "list_frames",
    "of_elements",
    "part_path",
    "read_frame",
    "read_series",
    "write_frame",
    "write_index",
    "write_series",
]

#: SI units of the attributes that the engine can derive or stores under these names.
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "speed": "m/s",
    "mass": "kg",
    "volume": "m^3",
    "density": "kg/m^3",
    "pressure": "Pa",
    "stress": "Pa",
    "kinetic_energy": "J",
    "elastic_energy": "J",
    "id": "1",
    "volume_ratio": "1",
    "deformation_gradient": "1",
    "element_stress": "Pa",
    "element_pressure": "Pa",
    "element_von_mises": "Pa",
    "element_volume_ratio": "1",
    "element_energy": "J",
    "element_plastic_strain": "1",
}

#: VTK's numbers of linear triangles and tetrahedra, by vertices.
_CELL_TYPES = {3: 5, 4: 10}

#: What a file of a frame is, and what to do about one that is damaged.
WHAT, REMEDY = "frame of libmpm", "delete it, or resume the run from a checkpoint before it"

_NAME = re.compile(r"(?P<body>.+)_(?P<index>\d{6,})\.vtkhdf")


def frame_path(folder: Path, body: str, index: int) -> Path:
    """Return the file of one body and frame."""
    return folder / f"{file_name(body)}_{index:06d}.vtkhdf"


def list_frames(folder: Path) -> dict[str, dict[int, Path]]:
    """Return body -> frame index -> file, for every complete frame in `folder`."""
    found: dict[str, dict[int, Path]] = {}
    for path in sorted(folder.glob("*.vtkhdf")):
        match = _NAME.fullmatch(path.name)
        if match:
            found.setdefault(unquote(match["body"]), {})[int(match["index"])] = path
    return found


def _three(vectors: NDArray[Any]) -> NDArray[Any]:
    """Return (n, 3) from (n, dimension): VTK knows three components only."""
    if vectors.shape[1] == 3:
        return vectors
    padded = np.zeros((len(vectors), 3), vectors.dtype)
    padded[:, : vectors.shape[1]] = vectors
    return padded


def _point_data(values: NDArray[Any], real: type) -> NDArray[Any]:
    """Return the array as VTK takes it: (n,), (n, 3) for vectors, (n, d * d) for tensors.

    A plane-strain tensor keeps its four components (xx, xy, yx, yy): padding it to nine would
    claim an out-of-plane stress of zero, which is false.
    """
    if values.dtype.kind == "f":
        values = values.astype(real)
    if values.ndim == 2:
        return _three(values)
    if values.ndim == 3:
        return values.reshape(len(values), values.shape[1] * values.shape[2])
    return values


def write_frame(
    path: Path,
    position: NDArray[np.float64],
    attributes: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, Any],
    *,
    real: type = np.float64,
    elements: NDArray[Any] | None = None,
) -> None:
    """Write one body at one time.

    Parameters
    ----------
    path
        The final name; the data goes to a temporary one that is renamed when complete.
    position
        World coordinates, m, (n, dimension), always stored as float64.
    attributes
        Name -> (n,), (n, dimension) or (n, dimension, dimension), SI units.
    metadata
        Attributes of ``/libmpm``; ``time`` (s) and ``step`` are also stored as field data.
    real
        Type of the stored floating-point attributes.
    elements
        Of a body of elements: rows of `position`, (m, dimension + 1). Attributes that
        `of_elements` then have a row each of these.
    """
    with new_file(path) as file:
        names = ["position", *attributes]
        data = _frame(file, len(position), names, metadata, elements)
        file["VTKHDF"].create_dataset("Points", data=_three(np.asarray(position, np.float64)))
        for name, values in attributes.items():
            group = data if not of_elements(name) else file["VTKHDF/CellData"]
            group.create_dataset(name, data=_point_data(values, real))


def of_elements(name: str) -> bool:
    """Tell whether an attribute has a row for each element and not for each vertex."""
    return name.startswith("element_")


def _frame(
    file: h5py.File,
    count: int,
    names: Sequence[str],
    metadata: Mapping[str, Any],
    elements: NDArray[Any] | None = None,
) -> h5py.Group:
    """Write all of a frame but its points; return the group that their data goes to."""
    root = new_group(file, "VTKHDF")
    root.attrs["Version"] = np.array([2, 0], np.int64)
    kind = "PolyData" if elements is None else "UnstructuredGrid"
    root.attrs.create("Type", np.bytes_(kind))
    root.create_dataset("NumberOfPoints", data=np.array([count], np.int64))
    if elements is None:
        _put_points(root, count)
    else:
        _put_elements(root, elements)
    field = new_group(root, "FieldData")
    field.create_dataset("TimeValue", data=np.array([metadata["time"]], np.float64))
    field.create_dataset("Step", data=np.array([metadata["step"]], np.int64))
    about = new_group(file, "libmpm")
    set_attributes(about, metadata)
    set_attributes(new_group(about, "units"), {name: UNITS.get(name, "") for name in names})
    return new_group(root, "PointData")


def _put_elements(root: h5py.Group, elements: NDArray[Any]) -> None:
    """Write the cells of an UnstructuredGrid."""
    m, corners = elements.shape
    packed: dict[str, Any] = {"compression": "gzip", "compression_opts": 1, "shuffle": True}
    root.create_dataset("NumberOfCells", data=np.array([m], np.int64))
    root.create_dataset("NumberOfConnectivityIds", data=np.array([m * corners], np.int64))
    root.create_dataset("Connectivity", data=elements.ravel().astype(np.int64), **packed)
    root.create_dataset("Offsets", data=corners * np.arange(m + 1), **packed)
    root.create_dataset("Types", data=np.full(m, _CELL_TYPES[corners], np.uint8), **packed)
    new_group(root, "CellData")


def _put_points(root: h5py.Group, count: int) -> None:
    """Write the cells of PolyData: a vertex for each point."""
    for kind in ("Vertices", "Lines", "Polygons", "Strips"):
        cells = count if kind == "Vertices" else 0
        group = new_group(root, kind)
        group.create_dataset("NumberOfCells", data=np.array([cells], np.int64))
        group.create_dataset("NumberOfConnectivityIds", data=np.array([cells], np.int64))
        # Counting numbers shrink to nothing; noise in the attributes would not.
        packed: dict[str, Any] = (
            {"compression": "gzip", "compression_opts": 1, "shuffle": True} if cells else {}
        )
        group.create_dataset("Connectivity", data=np.arange(cells), **packed)
        group.create_dataset("Offsets", data=np.arange(cells + 1), **packed)


def part_path(folder: Path, body: str, index: int, rank: int) -> Path:
    """Return the file of what one process has of a frame."""
    path = frame_path(folder / "parts", body, index)
    return path.with_name(f"{path.stem}.{rank:04d}.vtkhdf")


def cut_parts(folder: Path, last: int) -> None:
    """Remove the parts of frames after number `last`."""
    for path in (folder / "parts").glob("*.vtkhdf"):
        match = re.fullmatch(r".+_(\d{6,})\.\d{4,}\.vtkhdf", path.name)
        if match and int(match[1]) > last:
            path.unlink()


def write_index(
    path: Path, parts: Sequence[Path], counts: Sequence[int], metadata: Mapping[str, Any]
) -> None:
    """Write a frame whose points are those of `parts`, by reference, one file behind the other.

    `counts` are the points of each. Readers see one frame; the parts must stay where they are,
    relative to it.
    """
    with h5py.File(parts[0], "r", locking=False) as like:
        points = {"Points": like["VTKHDF/Points"]} | {
            f"PointData/{name}": data for name, data in like["VTKHDF/PointData"].items()
        }
        forms = {name: (data.shape[1:], data.dtype) for name, data in points.items()}
    names = ["position", *(name.partition("/")[2] for name in forms if "/" in name)]
    total = int(sum(counts))
    with new_file(path) as file:
        _frame(file, total, names, metadata)
        for name, (width, dtype) in forms.items():
            whole = h5py.VirtualLayout((total, *width), dtype)
            at = 0
            for part, count in zip(parts, counts, strict=True):
                if count:
                    source = part.relative_to(path.parent).as_posix()
                    whole[at : at + count] = h5py.VirtualSource(
                        source, f"VTKHDF/{name}", (count, *width), dtype
                    )
                at += count
            if total:
                file["VTKHDF"].create_virtual_dataset(name, whole)
            else:
                file["VTKHDF"].create_dataset(name, (0, *width), dtype)


def read_frame(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return (arrays, metadata) of a frame; ``position`` is (n, 3) m, tensors are (n, d * d).

    Raises `SceneError` where the file is damaged, `OutputError` where a part of it is missing.
    """
    with reading(path, WHAT, REMEDY), h5py.File(path, "r", locking=False) as file:
        require_parts(path, file["VTKHDF/Points"])
        arrays = {"position": array_of(file["VTKHDF/Points"])}
        for group in ("PointData", "CellData"):
            for name, dataset in file["VTKHDF"].get(group, {}).items():
                arrays[name] = array_of(dataset)
        return arrays, attributes_of(file["libmpm"])


def require_parts(path: Path, dataset: h5py.Dataset) -> None:
    """Refuse a frame without its parts: HDF5 would read zeros in their place."""
    sources = dataset.virtual_sources() if dataset.is_virtual else []
    gone = [s.file_name for s in sources if is_cut(path.parent / s.file_name)]
    if gone:
        raise OutputError(
            f"{path}: {len(gone)} of its {len(sources)} parts are missing or cut, the first "
            f"{gone[0]}; keep the folder 'parts' of a run on several processes next to its frames"
        )


def frame_time(path: Path) -> float:
    """Return the simulated time of a frame, s; raises `SceneError` where it is damaged."""
    with reading(path, WHAT, REMEDY):
        with h5py.File(path, "r", locking=False) as file:
            time = float(file["libmpm"].attrs["time"])
        if not math.isfinite(time):
            raise ValueError(f"its time is {time}")
        return time


def write_series(folder: Path, body: str, times: Mapping[int, float]) -> None:
    """Write the list of frames with their times that ParaView and PyVista read as one series."""
    files = [
        {"name": frame_path(folder, body, index).name, "time": time}
        for index, time in sorted(times.items())
    ]
    content = {"file-series-version": "1.0", "files": files}
    write_json(folder / f"{file_name(body)}.vtkhdf.series", content)


def read_series(folder: Path, body: str) -> dict[int, float]:
    """Return frame index -> time, s, of a series written before; empty where there is none."""
    path = folder / f"{file_name(body)}.vtkhdf.series"
    times = {}
    try:
        for entry in json.loads(path.read_text(encoding="utf-8"))["files"]:
            match, time = _NAME.fullmatch(entry["name"]), float(entry["time"])
            if match and math.isfinite(time):
                times[int(match["index"])] = time
    # Frames know their times: a list that is damaged costs nothing but looking into them.
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError,
            OverflowError):  # fmt: skip
        return {}
    return times
