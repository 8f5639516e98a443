"""ESRI ASCII grids: a head of names and numbers, then rows of heights from north to south."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np

from libmpm._src.errors import SceneError
from libmpm._src.shapes.solid import Array

__all__ = ["read_esri"]


def read_esri(path: Path, fill: float | None) -> tuple[Array, Array, Array]:
    """Return x (n,), y (m,) and heights (n, m) of a grid, m; raises `SceneError`."""
    what = f"ESRI grid {path}"
    head: dict[str, float] = {}
    try:
        with path.open(encoding="utf-8") as file:
            # Six lines at most are a head; the last one, NODATA_value, may be missing.
            for line in islice(file, 6):
                words = line.split()
                if len(words) != 2 or not words[0][0].isalpha():
                    break
                head[words[0].lower()] = float(words[1])
        values = np.loadtxt(path, skiprows=len(head), ndmin=2, dtype=np.float64)
    except (OSError, ValueError, IndexError, MemoryError, OverflowError) as error:
        raise SceneError(f"{what}: cannot be read: {error}") from error
    ends = [next((k for k in (f"{a}llcorner", f"{a}llcenter") if k in head), None) for a in "xy"]
    missing = [k for k in ("ncols", "nrows", "cellsize") if k not in head]
    missing += [f"{a}llcorner" for a, end in zip("xy", ends, strict=True) if end is None]
    if missing:
        raise SceneError(f"{what}: its head has no {', '.join(missing)}; expected these first")
    for key in head:
        whole = key not in ("nrows", "ncols") or (head[key] >= 1 and head[key] % 1 == 0)
        if key != "nodata_value" and not (np.isfinite(head[key]) and whole):
            raise SceneError(f"{what}: {key} is {head[key]:g}; expected a finite number; of rows "
                             "and columns a whole one ≥ 1")  # fmt: skip
    if not head["cellsize"] > 0:
        raise SceneError(f"{what}: cellsize is {head['cellsize']:g}; expected > 0 m")
    shape = int(head["nrows"]), int(head["ncols"])
    if values.size != shape[0] * shape[1]:
        raise SceneError(f"{what}: {values.size} heights; expected {shape[0]} rows of {shape[1]}")
    z = values.reshape(shape)[::-1].T.copy()
    empty = ~np.isfinite(z)
    if "nodata_value" in head:
        empty |= z == head["nodata_value"]
    if np.any(empty):
        if fill is None:
            raise SceneError(
                f"{what}: {np.count_nonzero(empty)} of {z.size} heights have no data; expected "
                "all; give fill=... in m, or fill the gaps first"
            )
        z[empty] = fill
    axes: list[Array] = []
    for end, n in zip(ends, (shape[1], shape[0]), strict=True):
        assert end is not None
        first = head[end] + (0.5 * head["cellsize"] if end.endswith("corner") else 0.0)
        axes.append(first + head["cellsize"] * np.arange(n, dtype=np.float64))
    return axes[0], axes[1], z
