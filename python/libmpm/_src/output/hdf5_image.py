"""HDF5 files made in memory and written with plain system calls.

HDF5 must not meet a full disk: after a failed write it cannot close the file, and the process may
crash when it is collected. Python's own writes fail cleanly.

HDF5 follows what a damaged file says, into endless loops and beyond its memory, unless a checksum
stops it. Its format since 1.8 has checksums on the heads of files, groups and datasets; the heap of
texts of any length has none in any format, so that texts are stored with the length they have.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from libmpm._src.output.atomic_files import replacing

__all__ = ["LIBVER", "attributes_of", "new_file", "new_group", "set_attributes"]

#: HDF5 format bounds: without the upper one a newer library writes what older readers refuse; with
#: a higher lower one a killed process leaves a file marked as open, which cannot be read, and with
#: the one below there are no checksums.
LIBVER = ("v108", "v110")


def storable_text(text: str) -> str:
    """Return a text as HDF5 holds it: what is no character, and the one that ends a text, escaped.

    Names of files may have bytes that are no text.
    """
    return text.replace("\0", "\\x00").encode(errors="backslashreplace").decode()


def set_attributes(item: Any, values: Mapping[str, Any]) -> None:
    """Set attributes of a group or dataset; texts and lists of texts in UTF-8, of fixed length."""
    for name, value in values.items():
        texts = [value] if isinstance(value, str) else value
        if isinstance(texts, list | tuple) and texts and all(isinstance(t, str) for t in texts):
            raw = [storable_text(t).encode() for t in texts]
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


def new_group(parent: h5py.Group, name: str) -> h5py.Group:
    """Create a group without the time at which it was created: equal runs write equal bytes."""
    links, group = (h5py.h5p.create(k) for k in (h5py.h5p.LINK_CREATE, h5py.h5p.GROUP_CREATE))
    links.set_char_encoding(h5py.h5t.CSET_UTF8)
    group.set_obj_track_times(False)
    return h5py.Group(h5py.h5g.create(parent.id, name.encode(), links, group))


@contextlib.contextmanager
def new_file(path: Path) -> Iterator[h5py.File]:
    """Yield an HDF5 file in memory that becomes `path` when the block ends, atomically.

    HDF5 writes it into a file of Python's: the images that versions before 2 make of files in
    memory (`get_file_image`) have heads whose checksum is wrong. They also keep the time of
    creation in each group, the root included, unless told not to.
    """
    content = io.BytesIO()
    access, root = (h5py.h5p.create(k) for k in (h5py.h5p.FILE_ACCESS, h5py.h5p.FILE_CREATE))
    access.set_libver_bounds(h5py.h5f.LIBVER_V18, h5py.h5f.LIBVER_V110)
    access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)
    access.set_fileobj_driver(h5py.h5fd.fileobj_driver, content)
    root.set_obj_track_times(False)
    with h5py.File(h5py.h5f.create(b"memory", h5py.h5f.ACC_TRUNC, root, access)) as file:
        yield file
    # Python 3.12.1 crashes if its garbage collector frees a view of these bytes, which the frames
    # of an error would keep alive (`Path.write_bytes` makes one).
    with replacing(path) as part, part.open("wb") as target, content.getbuffer() as buffer:
        target.write(buffer)
