"""Where the modules of version 0.1 are now, so that its pickles and imports still load.

An old name gives the new module, with a `DeprecationWarning`. To be left out in version 0.3.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from types import ModuleType
from typing import Any

__all__ = ["MOVED", "forward", "install"]

_ROOT = "libmpm._src."
#: Old module or package -> new one, without `libmpm._src.`.
MOVED = {
    "advice.ranges": "advice.validity_ranges",
    "analysis": "studies.analysis",
    "analysis.curves": "studies.demand.curves",
    "analysis.exceedance": "studies.demand.exceedance",
    "analysis.laws": "studies.demand.laws",
    "analysis.ordered": "studies.demand.ordered",
    "backends": "run.backends",
    "bench": "cli.bench",
    "cases": "advice.cases",
    "checks": "scene.checks",
    "checks_bodies": "scene.checks_bodies",
    "checks_boundaries": "boundaries.checks",
    "checks_range": "scene.checks_sizes",
    "checks_steps": "scene.checks_time_steps",
    "claymore": "compat.claymore",
    "debris": "studies.debris",
    "demo": "cli.demo",
    "design": "studies.design",
    "device_arrays": "run.device_arrays",
    "export": "output.export",
    "faults": "run.fault_messages",
    "field": "base.formulas",
    "filling": "shapes.filling",
    "flow": "boundaries.flows",
    "foreign": "base.arrays",
    "forking": "run.forked_processes",
    "friction": "materials.friction",
    "geometry": "shapes",
    "geometry.arranged": "shapes.transformed",
    "geometry.choices": "shapes.particle_placement",
    "geometry.columns": "shapes.particle_columns",
    "geometry.esri": "shapes.esri_grid",
    "geometry.files": "shapes.shape_files",
    "geometry.fill": "shapes.basin",
    "geometry.mesh": "shapes.surface_mesh",
    "geometry.patches": "shapes.raster_distance",
    "geometry.tiles": "shapes.particle_tiles",
    "geometry.triangles": "shapes.mesh_distance",
    "guard": "run.guard",
    "guard_level": "run.guard_water_level",
    "guard_memory": "run.guard_memory",
    "guard_report": "run.guard_messages",
    "hidden": "boundaries.covered_faces",
    "html": "output.html",
    "info": "cli.info",
    "initial": "run.initial_values",
    "initial_stress": "materials.initial_stress",
    "interrupts": "base.interrupts",
    "looking": "run.plotting",
    "lowering": "run.engine_spec",
    "materials_generated": "materials.generated",
    "method": "methods.method",
    "optional": "base.optional_packages",
    "output.atomic": "output.atomic_files",
    "output.earlier": "output.earlier_run",
    "output.holding": "output.folder_lock",
    "output.image": "output.hdf5_image",
    "output.reading": "output.reading_files",
    "output.together": "output.rank_files",
    "parameters": "materials.material",
    "partition": "run.partition",
    "parts": "scene.parts",
    "persistence": "run.files",
    "pictures.figure": "pictures.figures",
    "pictures.space": "pictures.view_3d",
    "pictures.splats": "pictures.particle_discs",
    "pictures.views": "pictures.directions",
    "placed_force": "scene.placed_force",
    "plan": "run.plan",
    "processes": "run.rank_messages",
    "progress": "run.progress",
    "report": "output.report",
    "results": "output.results",
    "runfile": "scene.run_file",
    "sampling": "shapes.lattices",
    "scaling": "scene.scaling",
    "scene_file": "scene.scene_file",
    "schema": "scene.schema",
    "sensing": "sensors",
    "sensing.bodies": "sensors.body_sensors",
    "sensing.column": "sensors.column_gauge",
    "sensing.custom": "sensors.custom_functions",
    "sensing.grid": "sensors.grid_sensors",
    "sensing.loop": "sensors.sampling_loop",
    "sensing.moment": "sensors.step_readings",
    "sensing.of_column": "sensors.column_gauge_sampler",
    "sensing.pair": "sensors.contact_force",
    "sensing.particles": "sensors.particle_sensors",
    "sensing.reduce": "sensors.reductions",
    "sensing.rules": "sensors.checks",
    "sensing.values": "sensors.python_sensors",
    "sharing": "run.shared_ranks",
    "simulation": "run.simulation",
    "smoothing": "methods.smoothing",
    "snapshot": "run.checkpoint_state",
    "start": "scene.start",
    "still_water": "run.hydrostatic",
    "study": "studies.study",
    "study.files": "studies.study.shared_files",
    "study.loop": "studies.study.dispatch",
    "study.samplers": "studies.study.parameter_samples",
    "supply": "boundaries.flow_layers",
    "surfaces": "boundaries.distance_field",
    "tables": "base.tables",
    "timetable": "base.time_tables",
    "tradeoff": "advice.tradeoff",
    "transfer": "methods.transfer",
    "triangular": "grids",
    "triangular.choices": "grids.grid",
    "triangular.rules": "grids.checks",
    "turned": "shapes.oriented_boxes",
    "turns": "run.thread_turns",
    "values": "base.values",
    "views": "run.views",
    "watch": "run.guard_watch",
    "wave_makers": "boundaries.wave_makers",
}
#: Modules whose names are now folders: where their public names are.
FOLDERS = {
    "boundaries": (
        "boundaries.responses",
        "DecayLayer Displacement Mirror Prescribed Response Rotation Separable Slip Sticky Travel",
    ),
    "cli": ("cli.commands", "ExitCode main"),
    "scene": ("scene.scene", "Scene"),
    "sensors": (
        "sensors.engine_sensors",
        "Energy LoadCell ParticleTracker Sensor VelocityProbe WaveGauge",
    ),
    "shapes": ("shapes.boxes", "Box DomainWalls OrientedBox"),
}


def _warn(old: str, new: str) -> None:
    """Say where a name is now; at the caller, past the machinery of imports."""
    warnings.warn(
        f"{old} is {new} since libmpm 0.2; the old name goes in 0.3; public names are in libmpm "
        "and its modules (libmpm.shapes, libmpm.materials, ...)",
        DeprecationWarning,
        stacklevel=3,
    )


def _new_name(old: str) -> str | None:
    """Return what the module `old`, without `libmpm._src.`, is called now, or None."""
    if old in MOVED:
        return MOVED[old]
    package, _, module = old.partition(".")
    return f"{MOVED[package]}.{module}" if module and package in MOVED else None


class _Moved:
    """Finds modules by the names that they had.

    It has what finders and loaders have, without their bases: `importlib.abc` alone would take a
    twentieth of the time of the package's import.
    """

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return a specification for an old name, None for all others."""
        if not fullname.startswith(_ROOT) or _new_name(fullname[len(_ROOT) :]) is None:
            return None
        loader: Any = self
        return importlib.machinery.ModuleSpec(fullname, loader, is_package=True)

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        """Leave the making of the module to Python."""
        return None

    def exec_module(self, module: ModuleType) -> None:
        """Put the new module under the old name, so that its classes exist once."""
        old = module.__name__
        new = f"{_ROOT}{_new_name(old[len(_ROOT) :])}"
        _warn(old, new)
        sys.modules[old] = importlib.import_module(new)


def install() -> None:
    """Let imports find old names; before other finders, which see moved folders as new modules."""
    if not any(isinstance(finder, _Moved) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Moved())


def forward(folder: str) -> Callable[[str], Any]:
    """Return the `__getattr__` of a folder that was a module: its public names, with a warning."""
    module, names = FOLDERS[folder]

    def get(name: str) -> Any:
        if name not in names.split():
            raise AttributeError(f"module '{_ROOT}{folder}' has no attribute '{name}'")
        _warn(f"{_ROOT}{folder}.{name}", f"{_ROOT}{module}.{name}")
        return getattr(importlib.import_module(_ROOT + module), name)

    return get


def renamed(module: str, names: Mapping[str, str]) -> Callable[[str], Any]:
    """Return the `__getattr__` of a public module that had names which meant two things."""

    def get(name: str) -> Any:
        if name not in names:
            raise AttributeError(f"module '{module}' has no attribute '{name}'")
        warnings.warn(
            f"{module}.{name} is {module}.{names[name]} since libmpm 0.2; the old name goes in 0.3",
            DeprecationWarning,
            stacklevel=2,
        )
        return getattr(sys.modules[module], names[name])

    return get
