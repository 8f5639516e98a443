"""libmpm: the material point method for floods, debris and the structures they hit.

A `Scene` describes a simulation as plain values, `Scene.plan` says what it will cost, and a
`Simulation` runs it. SI units throughout.
"""

from __future__ import annotations

import importlib
import os
import warnings
from typing import TYPE_CHECKING, Any

from libmpm import boundaries, contacts, materials, methods, sensors, shapes
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
from libmpm._src.methods.method import FBar, Method
from libmpm._src.run.guard import Guard
from libmpm._src.run.partition import Partition
from libmpm._src.scene.scene import Scene

if TYPE_CHECKING:
    from libmpm import (
        advice,
        analysis,
        cases,
        compat,
        debris,
        demand,
        design,
        flumes,
        grids,
        studies,
    )
    from libmpm._src.output.results import Results, load
    from libmpm._src.output.settings import Output
    from libmpm._src.pictures.animate import animate
    from libmpm._src.run.plan import Plan
    from libmpm._src.run.simulation import Simulation
    from libmpm._src.studies.study.study import Study

__all__ = [
    "CapacityError",
    "CheckpointError",
    "DeviceError",
    "Error",
    "FBar",
    "Field",
    "Guard",
    "Method",
    "ModelWarning",
    "NumericalError",
    "Output",
    "OutputError",
    "Partition",
    "Plan",
    "Results",
    "Scene",
    "SceneError",
    "Simulation",
    "Study",
    "TimeTable",
    "advice",
    "analysis",
    "animate",
    "boundaries",
    "build_info",
    "cases",
    "compat",
    "contacts",
    "debris",
    "demand",
    "design",
    "flumes",
    "grids",
    "load",
    "materials",
    "methods",
    "sensors",
    "shapes",
    "studies",
]

# A thread that waits at the end of a loop spins for some microseconds and then sleeps. libgomp
# reads this once, when the core is first loaded. Its own choice is to spin for milliseconds: with
# other work on both cores the benchmark then ran at 1.7e6 particle-steps/s instead of 1.0e7. What
# the user has set stands.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "4000")

#: Names that need the compiled core, or packages that descriptions do not: loaded on first use.
#: A test counts what `import libmpm` loads.
_LAZY = {
    "Output": "libmpm._src.output.settings",
    "Plan": "libmpm._src.run.plan",
    "Results": "libmpm._src.output.results",
    "Simulation": "libmpm._src.run.simulation",
    "Study": "libmpm._src.studies.study.study",
    "animate": "libmpm._src.pictures.animate",
    "load": "libmpm._src.output.results",
}
#: Modules that are loaded on first use.
_MODULES = (
    "advice",
    "analysis",
    "cases",
    "compat",
    "debris",
    "demand",
    "design",
    "flumes",
    "grids",
    "studies",
)
#: Names that were here in version 0.1, and the modules that have them now.
_MOVED = {
    "Advice": "advice",
    "AssumedFields": "methods",
    "Kernel": "methods",
    "PlacedForce": "boundaries",
    "Smoothing": "methods",
    "TradeOff": "advice",
    "Traction": "grids",
    "Transfer": "methods",
    "Trunk": "studies",
    "tradeoff": "advice",
}


def build_info() -> dict[str, Any]:
    """Return version, compiler, precisions, materials, threads and instruction set in use."""
    return dict(importlib.import_module("libmpm._core").build_info())


def __getattr__(name: str) -> Any:
    """Load `Simulation`, `Output`, `Study` and the like, and `__version__`, on first use.

    Names that have moved into a module come with a `DeprecationWarning`.
    """
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name]), name)
    if name in _MODULES:
        return importlib.import_module(f"libmpm.{name}")
    if name in _MOVED:
        module = f"libmpm.{_MOVED[name]}"
        warnings.warn(
            f"libmpm.{name} is {module}.{name} since libmpm 0.2; the old name goes in 0.3",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(importlib.import_module(module), name)
    if name == "smoothing":
        return importlib.import_module("libmpm.smoothing")
    if name == "__version__":
        from importlib.metadata import PackageNotFoundError, version

        try:
            return version("libmpm")
        except PackageNotFoundError:
            return "0+source"
    raise AttributeError(f"module 'libmpm' has no attribute '{name}'")


def __dir__() -> list[str]:
    """List the public names, the lazy ones too."""
    return sorted([*__all__, "__version__"])
