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
from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable
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
from libmpm._src.grids.shapes import Traction
from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.smoothing import AssumedFields, Smoothing
from libmpm._src.methods.transfer import Kernel, Transfer
from libmpm._src.run.guard import Guard
from libmpm._src.run.partition import Partition
from libmpm._src.run.plan import Plan
from libmpm._src.scene.placed_force import PlacedForce
from libmpm._src.scene.scene import Scene

if TYPE_CHECKING:
    from libmpm import studies
    from libmpm._src.advice.result import Advice
    from libmpm._src.advice.tradeoff.result import TradeOff
    from libmpm._src.advice.tradeoff.run import tradeoff
    from libmpm._src.output.results import Results, load
    from libmpm._src.output.settings import Output
    from libmpm._src.run.simulation import Simulation
    from libmpm._src.studies.study.plan import Trunk
    from libmpm._src.studies.study.study import Study

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
    "Output": "libmpm._src.output.settings",
    "Results": "libmpm._src.output.results",
    "Simulation": "libmpm._src.run.simulation",
    "Study": "libmpm._src.studies.study.study",
    "TradeOff": "libmpm._src.advice.tradeoff.result",
    "Trunk": "libmpm._src.studies.study.plan",
    "animate": "libmpm._src.pictures.animate",
    "load": "libmpm._src.output.results",
    "tradeoff": "libmpm._src.advice.tradeoff.run",
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
