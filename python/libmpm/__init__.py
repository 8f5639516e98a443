"""libmpm: the material point method for floods, debris and the structures they hit.

A `Scene` describes a simulation as plain values, `Scene.plan` says what it will cost, and a
`Simulation` runs it. SI units throughout.
"""

from __future__ import annotations

import importlib
import os
from typing import TYPE_CHECKING, Any

from libmpm import (
    analysis,
    boundaries,
    debris,
    demand,
    design,
    grids,
    materials,
    sensors,
    shapes,
    smoothing,
)
from libmpm._src.errors import (
    CapacityError,
    CheckpointError,
    DeviceError,
    Error,
    ModelWarning,
    NumericalError,
    OutputError,
    SceneError,
)
from libmpm._src.field import Field
from libmpm._src.guard import Guard
from libmpm._src.method import FBar, Method
from libmpm._src.partition import Partition
from libmpm._src.placed_force import PlacedForce
from libmpm._src.plan import Plan
from libmpm._src.scene import Scene
from libmpm._src.smoothing import AssumedFields, Smoothing
from libmpm._src.timetable import TimeTable
from libmpm._src.transfer import Kernel, Transfer
from libmpm._src.triangular.shapes import Traction

if TYPE_CHECKING:
    from libmpm import studies
    from libmpm._src.advice.result import Advice
    from libmpm._src.output.writer import Output
    from libmpm._src.results import Results, load
    from libmpm._src.simulation import Simulation
    from libmpm._src.study.plan import Trunk
    from libmpm._src.study.study import Study
    from libmpm._src.tradeoff.result import TradeOff
    from libmpm._src.tradeoff.run import tradeoff

__all__ = [
    "Advice",
    "AssumedFields",
    "CapacityError",
    "CheckpointError",
    "DeviceError",
    "Error",
    "FBar",
    "Field",
    "Guard",
    "Kernel",
    "Method",
    "ModelWarning",
    "NumericalError",
    "Output",
    "OutputError",
    "Partition",
    "PlacedForce",
    "Plan",
    "Results",
    "Scene",
    "SceneError",
    "Simulation",
    "Smoothing",
    "Study",
    "TimeTable",
    "Traction",
    "TradeOff",
    "Transfer",
    "Trunk",
    "__version__",
    "analysis",
    "animate",
    "boundaries",
    "build_info",
    "debris",
    "demand",
    "design",
    "grids",
    "load",
    "materials",
    "sensors",
    "shapes",
    "smoothing",
    "studies",
    "tradeoff",
]

# A thread that waits at the end of a loop spins for some microseconds and then sleeps. libgomp
# reads this once, when the core is first loaded. Its own choice is to spin for milliseconds: with
# other work on both cores the benchmark then ran at 1.7e6 particle-steps/s instead of 1.0e7. What
# the user has set stands.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "4000")

#: Names that need the compiled core, or packages that descriptions do not: loaded on first use.
_LAZY = {
    "Advice": "libmpm._src.advice.result",
    "Output": "libmpm._src.output.writer",
    "Results": "libmpm._src.results",
    "Simulation": "libmpm._src.simulation",
    "Study": "libmpm._src.study.study",
    "TradeOff": "libmpm._src.tradeoff.result",
    "Trunk": "libmpm._src.study.plan",
    "animate": "libmpm._src.pictures.animate",
    "load": "libmpm._src.results",
    "tradeoff": "libmpm._src.tradeoff.run",
}


def build_info() -> dict[str, Any]:
    """Return version, compiler, precisions, materials, threads and instruction set in use."""
    return dict(importlib.import_module("libmpm._core").build_info())


def __getattr__(name: str) -> Any:
    """Load `Simulation`, `Output`, `Study` and the like, and `__version__`, on first use."""
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    if name == "studies":
        return importlib.import_module("libmpm.studies")
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("libmpm")
        except PackageNotFoundError:
            return "0+source"
    raise AttributeError(f"module 'libmpm' has no attribute '{name}'")


def __dir__() -> list[str]:
    """List the public names, the lazy ones too."""
    return sorted(__all__)
