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
    except ImportError as error:
        package = module.split(".")[0]
        raise SceneError(
            f"{what}: the package {package} is not installed ({error}); expected it for this call; "
            f"run `pip install libmpm[{extra}]`"
        ) from error
