"""Reading files that may be damaged: errors that name the file and the remedy."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import Error, SceneError

__all__ = ["array_of", "is_cut", "plain_reason", "read_object", "reading"]

#: What an HDF5 file begins with.
_SIGNATURE = b"\x89HDF\r\n\x1a\n"
#: Version of the head of an HDF5 file -> where the file's own length is in it.
_LENGTH_AT = {0: 40, 1: 44, 2: 28, 3: 28}


def plain_reason(error: BaseException) -> str:
    """Return what went wrong, in one short line."""
    if isinstance(error, OSError) and error.strerror and error.errno:
        return error.strerror
    text = " ".join(str(error).split())
    return f"{text[:200]}" if text else type(error).__name__


@contextlib.contextmanager
def reading(path: Path, what: str, remedy: str) -> Iterator[None]:
    """Turn all that a reader of a damaged file raises into a `SceneError` with path and remedy.

    h5py, NumPy and JSON raise whatever they come upon: OSError, KeyError, ValueError, MemoryError.
    """
    try:
        yield
    except Error:
        raise
    except FileNotFoundError as error:
        raise SceneError(f"{path}: does not exist; expected {what}; {remedy}") from error
    except Exception as error:
        size = f"{path.stat().st_size} bytes, " if path.is_file() else ""
        raise SceneError(
            f"{path}: is no whole {what}: {size}{plain_reason(error)}; {remedy}"
        ) from error


def read_object(path: Path, what: str, remedy: str) -> dict[str, Any]:
    """Return the JSON object in a file; raises `SceneError` where there is none."""
    with reading(path, what, remedy):
        content = json.loads(path.read_text(encoding="utf-8-sig"))
        if not isinstance(content, dict):
            raise ValueError("it holds no JSON object")
        return content


def array_of(dataset: Any, rows: slice = slice(None)) -> NDArray[Any]:
    """Return rows of a dataset; raises ValueError where the file holds fewer bytes than it claims.

    HDF5 would give zeros for what is not stored, and a damaged size would take all memory.
    """
    if not isinstance(dataset, h5py.Dataset):
        raise ValueError(f"{getattr(dataset, 'name', dataset)!r} is no dataset")
    packed = dataset.compression is not None or dataset.is_virtual
    if not packed and dataset.nbytes > dataset.id.get_storage_size():
        raise ValueError(
            f"{dataset.name} claims {dataset.nbytes} bytes and has {dataset.id.get_storage_size()}"
        )
    return np.asarray(dataset[rows] if dataset.shape else dataset[()])


def is_cut(path: Path) -> bool:
    """Tell whether an HDF5 file is missing, empty, cut short or none at all, by its first bytes.

    It finds what a full disk or a power failure leaves, without opening thousands of files.
    """
    try:
        with path.open("rb") as file:
            head = file.read(64)
            size = file.seek(0, os.SEEK_END)
    except OSError:
        return True
    if len(head) < 64 or head[:8] != _SIGNATURE:
        return True
    at = _LENGTH_AT.get(head[8])
    return at is not None and size < int.from_bytes(head[at : at + 8], "little")
