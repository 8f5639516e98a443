"""HDF5 files made in memory and written with plain system calls.

HDF5 must not meet a full disk: after a failed write it cannot close the file, and the process may
crash when it is collected. Python's own writes fail cleanly.

HDF5 follows what a damaged file says, into endless loops and beyond its memory, unless a checksum
stops it. Its format since 1.8 has checksums on the heads of files, groups and datasets; the heap of
texts of any length has none in any format, so that texts are stored with the length they have.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from libmpm._src.output.atomic_files import replacing

__all__ = ["LIBVER", "attributes_of", "new_file", "set_attributes"]

#: HDF5 format bounds: without the upper one a newer library writes what older readers refuse; with
#: a higher lower one a killed process leaves a file marked as open, which cannot be read, and with
#: the one below there are no checksums.
LIBVER = ("v108", "v110")


def set_attributes(item: Any, values: Mapping[str, Any]) -> None:
    """Set attributes of a group or dataset; texts and lists of texts in UTF-8, of fixed length."""
    for name, value in values.items():
        texts = [value] if isinstance(value, str) else value
        if isinstance(texts, list | tuple) and texts and all(isinstance(t, str) for t in texts):
            raw = [t.encode() for t in texts]
            width = max(1, *(len(r) for r in raw))
            kind = h5py.string_dtype("utf-8", width)
            data = np.array(raw if texts is value else raw[0], f"S{width}")
            item.attrs.create(name, data, dtype=kind)
        else:
            item.attrs[name] = value


def attributes_of(item: Any) -> dict[str, Any]:
    """Return the attributes of a group or dataset, texts as `str` however they are stored."""
    return {name: _decoded(value) for name, value in item.attrs.items()}


def _decoded(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.dtype.kind == "S":
        return [one.decode() for one in value.ravel()]
    return value


@contextlib.contextmanager
def new_file(path: Path, size: int = 0) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory that becomes `path` when the block ends, atomically.

    `size` is an estimate in bytes; memory is taken in such pieces.
    """
    with h5py.File(
        f"{path}.image",
        "w",
        driver="core",
        backing_store=False,
        block_size=max(1 << 16, size),
        libver=LIBVER,
    ) as file:
        yield file
        file.flush()
        content = file.id.get_file_image()
    with replacing(path) as part:
        part.write_bytes(content)
