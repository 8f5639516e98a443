"""HDF5 files made in memory and written with plain system calls.

HDF5 must not meet a full disk: after a failed write it cannot close the file, and the process may
crash when it is collected. Python's own writes fail cleanly.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import h5py

from libmpm._src.output.atomic_files import replacing

__all__ = ["LIBVER", "new_file"]

#: HDF5 format bounds: without the upper one a newer library writes what older readers refuse;
#: with a higher lower one a killed process leaves a file marked as open, which cannot be read.
LIBVER = ("earliest", "v110")


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
