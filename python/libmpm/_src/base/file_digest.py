"""Files known again by their content: SHA-256, read once for each size and time of change."""

from __future__ import annotations

import functools
import hashlib
import stat
from pathlib import Path

__all__ = ["file_digest", "file_state"]


def file_state(file: str | Path) -> tuple[str, int, int]:
    """Return path, size and time of change of a file: what to know its content again by.

    Raises `OSError` where it cannot be read or is no regular file.
    """
    found = Path(file).stat()
    if not stat.S_ISREG(found.st_mode):
        raise OSError(f"{file} is no regular file")
    return str(file), found.st_size, found.st_mtime_ns


def file_digest(file: str | Path) -> str:
    """Return the SHA-256 of a file's content; raises `OSError`."""
    return _digest(*file_state(file))


@functools.lru_cache(maxsize=64)
def _digest(path: str, size: int, changed: int) -> str:
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
