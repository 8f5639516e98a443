"""Files that shapes refer to: by path and SHA-256."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from libmpm._src.base.file_digest import file_digest
from libmpm._src.base.values import Checker, shown

__all__ = ["check_file"]


def check_file(check: Checker, file: Any, sha256: Any) -> tuple[str, str | None]:
    """Return path and SHA-256 of a file; report one that is missing or not as it was."""
    if not isinstance(file, str | Path) or not str(file):
        check.fail(f"file is {shown(file)}; expected the path of a file")
        return "", None
    try:
        found = file_digest(file)
    except (OSError, ValueError) as error:  # a path may hold what no path can
        reason = getattr(error, "strerror", None) or error
        check.fail(f"file '{file}' cannot be read: {reason}; give a path that can be, from here")
        return str(file), None
    if sha256 is not None and not isinstance(sha256, str):
        check.fail(f"sha256 is {shown(sha256)}; expected a text, or None")
    elif sha256 is not None and sha256 != found:
        check.fail(
            f"file '{file}' has SHA-256 {found[:12]}..., the scene was made with "
            f"{str(sha256)[:12]}...; expected the same file; restore it, or leave sha256 out to "
            "use the present file"
        )
    # Absolute, so that what was begun in one folder can be resumed or read from another.
    return str(Path(file).absolute()), found
