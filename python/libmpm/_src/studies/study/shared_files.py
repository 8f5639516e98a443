"""Files of a study's folder that several processes read, and some write."""

from __future__ import annotations

import contextlib
import glob
import json
import os
import uuid
from pathlib import Path
from typing import Any

from libmpm._src.errors import OutputError
from libmpm._src.output.atomic_files import TEMPORARY, writing
from libmpm._src.output.folder_lock import LOCK
from libmpm._src.output.locks import is_gone, this_process

__all__ = [
    "CASES",
    "CHECKPOINT",
    "LOCK",
    "PARAMETERS",
    "RESPONSE",
    "STATUS",
    "STUDY",
    "TRACEBACK",
    "TRUNKS",
    "glance",
    "read_object",
    "sweep_shared",
    "write_shared",
]

#: In the folder of a study.
STUDY, CASES, TRUNKS = "study.json", "cases", "trunks"
#: In the folder of a case or trunk, beside what the run writes.
STATUS, PARAMETERS, RESPONSE = "status.json", "parameters.json", "response.json"
TRACEBACK, CHECKPOINT = "traceback.txt", "trunk.npz"


def read_object(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file; an empty one if there is no whole one.

    Raises `OutputError` if there is a file that cannot be read: what is in it must not be replaced.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError, ValueError, RecursionError):
        return {}
    except OSError as error:
        raise OutputError(
            f"cannot read {path}: {error.strerror or error}; make it readable, or choose another "
            "folder"
        ) from error
    return content if isinstance(content, dict) else {}


def glance(path: Path) -> dict[str, Any]:
    """Return the JSON object in a file, for what only looks; an empty one if there is none."""
    try:
        return read_object(path)
    except OutputError:
        return {}


def write_shared(path: Path, content: Any) -> None:
    """Write JSON atomically to a file that others may be writing at the same moment."""
    # The temporary names of two writers differ, so neither renames the other's half file.
    own = path.with_name(f".{path.name}.{this_process()}-{uuid.uuid4().hex}{TEMPORARY}")
    with writing(path):
        try:
            own.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
            os.replace(own, path)
        except BaseException:
            with contextlib.suppress(OSError):
                own.unlink()
            raise


def sweep_shared(path: Path) -> None:
    """Remove what killed writers of `path` have left beside it, and nothing of those that live."""
    first = f".{path.name}."
    with contextlib.suppress(OSError):
        for other in path.parent.glob(f"{glob.escape(first)}*{TEMPORARY}"):
            if is_gone(other.name.removeprefix(first)):
                other.unlink(missing_ok=True)
