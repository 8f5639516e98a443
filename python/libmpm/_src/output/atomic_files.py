"""Writing files so that a kill leaves either the old or the new one; errors of a full disk."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

from libmpm._src.base.arguments import file_path
from libmpm._src.errors import OutputError

__all__ = ["TEMPORARY", "file_name", "replacing", "sync_folder", "write_json", "writing"]

#: Suffix of files that are still being written; a reader may ignore or delete them.
TEMPORARY = ".part"


def file_name(name: str) -> str:
    """Return `name` as part of a file or HDF5 name; unlike names stay unlike."""
    return quote(name, safe=" ()+,=") if name.strip(".") else name.replace(".", "%2E")


def _remedy(path: Path, error: BaseException) -> str:
    """Return what went wrong in words, and what to do."""
    code = getattr(error, "errno", None)
    text = str(error)
    if code is None and "errno = " in text:
        # HDF5 reports the system's error number inside its message only.
        digits = text.split("errno = ", 1)[1].split(",", 1)[0]
        code = int(digits) if digits.isdigit() else None
    try:
        folder = path if path.is_dir() else path.parent
    except OSError:  # a name that is too long
        folder = path.parent
    if code in (errno.ENOSPC, errno.EDQUOT):
        free = ""
        with contextlib.suppress(OSError):
            free = f" ({shutil.disk_usage(folder).free / 1e6:.1f} MB free)"
        return (
            f"the disk or quota is full{free}; free space or choose another folder, "
            "then continue this run or resume from the last checkpoint"
        )
    if code == errno.EFBIG:
        return "the file size limit of this process is reached; raise it (ulimit -f unlimited)"
    if code in (errno.EACCES, errno.EPERM, errno.EROFS):
        return "writing is not permitted there; choose a folder that you may write to"
    if code in (errno.ENOTDIR, errno.EEXIST):
        return "a file stands where a folder is needed; choose another folder"
    return f"{text or type(error).__name__}; check the folder, or choose another one"


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn every failure to write `path` into an `OutputError` that names path and remedy."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, RuntimeError) as error:
        # h5py raises RuntimeError where a flush or a close fails.
        raise OutputError(f"cannot write {path}: {_remedy(path, error)}") from error


def sync_folder(folder: Path) -> None:
    """Make renames inside `folder` durable, where the system allows it."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def replacing(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary name beside `path`; rename it to `path` if the block succeeds.

    `durable` also forces the data to the disk before the rename, so that a power failure leaves
    the old or the new file, never an empty one.
    """
    try:
        part = file_path(path, "writing").with_name(path.name + TEMPORARY)
    except ValueError as error:  # no name, or one that no file can have
        raise OutputError(f"cannot write {path}: expected the name of a file") from error
    with writing(path):
        try:
            yield part
            if durable:
                handle = os.open(part, os.O_RDONLY)
                try:
                    os.fsync(handle)
                finally:
                    os.close(handle)
            os.replace(part, path)
            if durable:
                sync_folder(path.parent)
        except BaseException:
            with contextlib.suppress(OSError):
                part.unlink()
            raise


def write_json(path: Path, content: Any) -> None:
    """Write `content` as indented JSON, atomically."""
    with replacing(path) as part:
        part.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
