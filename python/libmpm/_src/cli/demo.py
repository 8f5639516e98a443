"""`libmpm demo`: the scene that ships with libmpm."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from libmpm._src.scene.run_file import RunFile, read_run_file

__all__ = ["demo_file", "load_demo"]


def demo_file() -> Path:
    """Return the path of the demonstration's scene file."""
    return Path(str(resources.files("libmpm") / "data" / "surge.json"))


def load_demo() -> RunFile:
    """Return the demonstration: a surge that carries debris blocks into a raised box."""
    return read_run_file(demo_file())
