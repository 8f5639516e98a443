"""Packages that only some parts of libmpm need."""

from __future__ import annotations

import importlib
from typing import Any

from libmpm._src.errors import SceneError

__all__ = ["need"]


def need(module: str, what: str, extra: str = "triangular") -> Any:
    """Import a module on behalf of `what`; raises `SceneError` if it is not installed.

    `extra` is the set of optional dependencies that brings it.
    """
    try:
        return importlib.import_module(module)
    # Of a package that is there a library of the system may be missing.
    except (ImportError, OSError) as error:
        package = module.split(".")[0]
        raise SceneError(
            f"{what}: the package {package} is not installed, or not whole ({error}); expected "
            f"it for this call; run `pip install libmpm[{extra}]`"
        ) from error
