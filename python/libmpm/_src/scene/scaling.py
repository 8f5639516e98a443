"""`Scene.scaled`: Froude and Froude-Cauchy scaling, driven by the unit of every field.

`UNITS` is the one place where the fields of all values in a scene have their units; materials bring
their own. A field without an entry cannot be scaled, and a test points it out.
"""

from __future__ import annotations

import ast
import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker, Value, shown
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import Material
from libmpm._src.scene.data import HEAD, SceneData
from libmpm._src.scene.scene_file import SceneReader

__all__ = ["OUTSIDE", "OWNER", "TEXT", "UNITS", "Scaling", "scale_scene"]

S = TypeVar("S", bound=SceneData)

#: Unit of what is no quantity: names, choices, flags, whole numbers, and values with fields of
#: their own.
TEXT = "-"
#: Unit of a table or formula, which its owner gives.
OWNER = "owner"
#: Unit of what lies in a file and cannot be scaled: a scene that has it is refused.
FIXED = "fixed"
#: Unit of a volume: m³, of which a plane scene has m².
VOLUME = "mᵈ"

#: Twice the power of the length ratio λ that a quantity takes where density and gravity stay:
#: m → λ, s → λ^½, kg → λ³.
HALF_POWERS: dict[str, int] = {
    TEXT: 0, "1": 0, "%": 0, "°": 0, "degrees": 0, "rad": 0, "cells": 0,
    "m": 2, "m²": 4, "m³": 6, "m³/s": 5, "m²/s": 3, "1/m": -2,
    "s": 1, "1/s": -1, "rad/s": -1, "°/s": -1, "m/s": 1, "m/s²": 0, "rad/s²": -2,
    "kg": 6, "kg/m": 4, "kg/m³": 0, "N": 6, "N/m": 4, "J": 8, "Pa": 2, "Pa/s": 1,
}  # fmt: skip

#: Unit of every field, by the value's name. "Scene" and "RunSettings" are no values but described
#: in the same manner.
UNITS: dict[str, dict[str, str]] = {
    "Scene": {
        "name": TEXT, "dimension": TEXT, "cell_size": "m", "lower": "m", "upper": "m",
        "grid": TEXT, "origin": "m", "gravity": "m/s²", "method": TEXT, "start": FIXED,
    },
    "RunSettings": {
        "until": "s", "frame_interval": "s", "checkpoint_interval": "s", "attributes": TEXT,
        "filter": "s", "debris": TEXT,
    },
    # parts of a scene
    "Body": {
        "name": TEXT, "shape": TEXT, "material": TEXT, "particles_per_cell": TEXT,
        "velocity": "m/s", "fbar": TEXT, "hydrostatic": "m", "subtract_from": TEXT,
        "lattice": TEXT, "stress": "Pa", "tractions": TEXT, "transfer": TEXT, "sampling": TEXT,
        "smoothing": TEXT, "assumed": TEXT, "damping": "1", "force": TEXT,
    },
    "Boundary": {
        "name": TEXT, "shape": TEXT, "response": TEXT, "motion": "m/s", "time": "s",
        "layer": TEXT, "rotation": TEXT, "within": TEXT, "spacing": "m", "bodies": TEXT,
    },
    "PlacedSensor": {"name": TEXT, "sensor": TEXT},
    "Start": {
        "checkpoint": FIXED, "digest": TEXT, "time": "s", "step": TEXT, "bodies": TEXT,
        "boundaries": TEXT, "sensors": TEXT, "time_step": "s", "tiles": TEXT, "axis": TEXT,
    },
    "RestoredBody": {
        "name": TEXT, "first_id": TEXT, "ids": TEXT, "particle_mass": "kg", "stored_as": TEXT,
    },
    # tables and formulas
    "TimeTable": {"time": "s", "value": OWNER, "end": TEXT},
    "Field": {"components": OWNER},
    "Traction": {"face": TEXT, "value": "Pa"},
    # method
    "Method": {
        "cfl": "1", "time_step": "s", "leaving": TEXT, "transfer": TEXT, "kernel": TEXT,
    },
    "FBar": {"form": TEXT, "time": "s", "ratio": "1", "length": "m"},
    "Transfer": {
        "scheme": TEXT, "flip": "1", "shift_max": "1", "shift_min": "1", "shift_rule": TEXT,
        "critical_ratio": "1", "width": "1", "power": "1", "below": TEXT, "guard": TEXT,
        "order": TEXT, "every": TEXT,
    },
    "Kernel": {
        "name": TEXT, "gradient": TEXT, "boundary": TEXT, "modified": TEXT, "moved_nodes": TEXT,
    },
    "Smoothing": {"method": TEXT, "gamma": "1", "field": TEXT, "flux_length": TEXT},
    "AssumedFields": {"over": TEXT, "part": TEXT, "rate": TEXT},
    "PlacedForce": {"axis": TEXT, "place": "m", "value": "m/s²"},
    # shapes
    "Box": {"lower": "m", "upper": "m"},
    "OrientedBox": {"centre": "m", "size": "m", "angle": "degrees", "axis": TEXT},
    "DomainWalls": {"faces": TEXT},
    "Sphere": {"centre": "m", "radius": "m"},
    "Cylinder": {"start": "m", "end": "m", "radius": "m"},
    "Cone": {"start": "m", "end": "m", "radius": "m", "end_radius": "m"},
    "Wedge": {"lower": "m", "upper": "m", "high": TEXT, "up": TEXT},
    "HalfSpace": {"point": "m", "normal": "1"},
    "Extrusion": {"profile": "m", "axis": TEXT, "lower": "m", "upper": "m"},
    "HeightField": {"x": "m", "z": "m", "y": "m", "base": "m"},
    "Union": {"parts": TEXT},
    "Intersection": {"parts": TEXT},
    "Difference": {"whole": TEXT, "without": TEXT},
    "Moved": {"shape": TEXT, "by": "m"},
    "Turned": {"shape": TEXT, "angle": "degrees", "axis": TEXT, "about": "m"},
    "Repeated": {"shape": TEXT, "counts": TEXT, "spacing": "m"},
    # The factor on a file's numbers makes them m, and takes the file along.
    "PointFile": {
        "file": TEXT, "volume": VOLUME, "particle_volume": VOLUME, "scale": "m", "offset": "m",
        "sha256": TEXT,
    },
    "SurfaceMesh": {
        "file": TEXT, "scale": "m", "offset": "m", "heal": TEXT, "sha256": TEXT,
    },
    "Columns": {"axis": TEXT},
    "Jitter": {"share": "1", "seed": TEXT},
    "PoissonDisk": {"seed": TEXT},
    "Cells": {"within": "m"},
    "Points": {"position": "m", "volume": "m²", "within": "m"},
    "Outline": {"points": "m"},
    # boundaries
    "Sticky": {},
    "Slip": {"cell": TEXT},
    "Separable": {"static_friction": "1", "dynamic_friction": "1", "cell": TEXT},
    "Mirror": {"slip": TEXT},
    "Prescribed": {"components": TEXT},
    "DecayLayer": {"function": TEXT, "thickness": "cells"},
    "Displacement": {"table": "m"},
    "Travel": {"velocity": "m/s"},
    "Rotation": {"about": "m", "rate": "rad/s", "angle": "rad", "axis": "1"},
    "PlacedFlow": {"name": TEXT, "flow": TEXT},
    "Inflow": {
        "body": TEXT, "face": TEXT, "velocity": "m/s", "level": "m", "bed": TEXT, "zone": "cells",
        "max_particles": TEXT,
    },
    "Outflow": {"face": TEXT, "velocity": "m/s", "zone": "cells"},
    # sensors
    "LoadCell": {"boundary": TEXT, "faces": TEXT, "interval": "s", "reference": "m"},
    "WaveGauge": {"position": "m", "interval": "s", "body": TEXT},
    "VelocityProbe": {"position": "m", "interval": "s"},
    "ParticleTracker": {"body": TEXT, "ids": TEXT, "interval": "s"},
    "Energy": {"body": TEXT, "interval": "s"},
    "ParticleSensor": {
        "attribute": TEXT, "operation": TEXT, "body": TEXT, "direction": TEXT, "region": "m",
        "interval": "s",
    },
    "GridSensor": {
        "attribute": TEXT, "operation": TEXT, "direction": TEXT, "region": "m", "interval": "s",
    },
    "BodyTracker": {"body": TEXT, "quantities": TEXT, "interval": "s"},
    "ContactForce": {"body": TEXT, "by": TEXT, "interval": "s"},
    "AttributeTracker": {"body": TEXT, "ids": TEXT, "attributes": TEXT, "interval": "s"},
    "PressureProbe": {
        "position": "m", "radius": "m", "order": TEXT, "body": TEXT, "interval": "s",
    },
    "ElevationGauge": {
        "position": "m", "radius": "m", "method": TEXT, "percentile": "%", "body": TEXT,
        "interval": "s",
    },
    "ColumnGauge": {"position": "m", "width": "m", "bed": "m", "body": TEXT, "interval": "s"},
    "Custom": {"function": TEXT, "columns": TEXT, "units": TEXT, "interval": "s"},
    # grids of functions
    "Mesh": {"vertices": "m", "triangles": TEXT},
    "Linear": {},
    "Lagrange": {"degree": TEXT},
    "PowellSabin": {"split": "m"},
    "CubicPowellSabin": {},
    "ConsistentMass": {
        "solver": TEXT, "tolerance": "1", "iterations": TEXT, "deactivate_below": "kg/m",
    },
    "LumpedMass": {},
    "PartialMass": {"form": TEXT},
    "TriangularGrid": {"mesh": TEXT, "basis": TEXT, "mass": TEXT},
    "SplineGrid": {
        "lower": "m", "upper": "m", "spans": TEXT, "degree": TEXT, "mass": TEXT, "knots": "m",
    },
}  # fmt: skip

#: Values that never are part of a scene: recipes that make bodies, and ratios.
OUTSIDE = frozenset(
    {
        "DebrisField", "Froude", "Guard", "Partition", "Piece", "Placement", "Prototype",
        "SpreadAngles", "UniformAngles",
    }
)  # fmt: skip


@dataclass(frozen=True)
class Scaling:
    """What a length ratio makes of every quantity, with density and gravity kept.

    Lengths × λ, velocities and times × λ^½, masses and forces × λ³, stresses that are given as
    loads or states × λ. Of materials, what is in Pa is × λ with `cauchy` and stays without; what is
    in Pa·s is × λ^1.5 with `reynolds` and stays without (Pa·sⁿ: × λ^(1 + n/2)).

    Kept are Froude's number v/√(gL) always, Cauchy's ρv²/K with `cauchy` (else × λ), Reynolds'
    ρvL/μ with `reynolds` (else × λ^1.5). Of a plane scene, `dimension` 2, masses and forces are per
    metre of thickness and × λ². Source: Bonus (2023) 7.2, 7.3.
    """

    length_ratio: float
    cauchy: bool = False
    reynolds: bool = False
    dimension: int = 3

    def __post_init__(self) -> None:
        """Check the ratio; raises `SceneError`."""
        check = Checker("Scene.scaled")
        ratio = check.number(
            "length_ratio", self.length_ratio, lower=0, lower_open=True,
            remedy="new length over old one, 0.1 for a model at 1:10",
        )  # fmt: skip
        for name in ("cauchy", "reynolds"):
            if not isinstance(getattr(self, name), bool):
                check.fail(f"{name} is {getattr(self, name)!r}; expected True or False")
        check.finish()
        object.__setattr__(self, "length_ratio", ratio)

    def power(self, half: float) -> float:
        """Return λ^(half/2); exact where λ is a power of four."""
        found: float = math.sqrt(self.length_ratio) ** half
        return found

    def factor(self, unit: str) -> float:
        """Return the factor of a quantity in `unit`, one of `HALF_POWERS`."""
        if unit == VOLUME:
            return self.power(2 * self.dimension)
        return self.power(HALF_POWERS[unit])

    def material(self, unit: str, index: float = 1.0) -> float:
        """Return the factor of a material's parameter; `index` is n where the unit is Pa·sⁿ."""
        if unit == "Pa":
            return self.factor("Pa") if self.cauchy else 1.0
        if unit in ("Pa·s", "Pa·sⁿ"):
            n = 1.0 if unit == "Pa·s" else index
            return self.power(2 + n) if self.reynolds else 1.0
        return self.factor(unit)

    def ratios(self) -> dict[str, float]:
        """Return new over old of the common quantities and groups."""
        modulus, viscosity = self.material("Pa"), self.material("Pa·s")
        return {
            "length": self.factor("m"),
            "velocity": self.factor("m/s"),
            "time": self.factor("s"),
            "mass": self.factor("kg") if self.dimension == 3 else self.factor("kg/m"),
            "force": self.factor("N") if self.dimension == 3 else self.factor("N/m"),
            "pressure": self.factor("Pa"),
            "moduli and strengths": modulus,
            "viscosity": viscosity,
            "Froude number": 1.0,
            "Cauchy number": self.factor("Pa") / modulus,
            "Reynolds number": self.power(3) / viscosity,
        }

    def __str__(self) -> str:
        """Return the ratios as a table."""
        kind = "Froude-Cauchy" if self.cauchy else "Froude"
        lines = [f"{kind} scaling by {self.length_ratio:g}: new over old"]
        lines += [f"  {name:<21} {ratio:.6g}" for name, ratio in self.ratios().items()]
        return "\n".join(lines)

    # Values ----------------------------------------------------------------------------------

    def value(self, item: Value, unit: str = TEXT) -> Any:
        """Return a value with every field scaled; `unit` is that of a table's or formula's rows."""
        if isinstance(item, Field):
            made = [_scaled_formula(c, self.length_ratio, self.factor(unit)) for c in _texts(item)]
            return Field(components=made)
        if isinstance(item, Material):
            return self._material(item)
        kind = type(item).__name__
        known = UNITS.get(kind, {})
        changed = {}
        for field in dataclasses.fields(item):  # type: ignore[arg-type]
            if field.name not in known:
                raise SceneError(
                    f"Scene.scaled: the unit of {kind}.{field.name} is not known; expected an "
                    "entry in libmpm._src.scene.scaling.UNITS; add it, or leave the value out"
                )
            own = unit if known[field.name] == OWNER else known[field.name]
            changed[field.name] = self.item(getattr(item, field.name), own, f"{kind}.{field.name}")
        return type(item)(**changed)

    def item(self, item: Any, unit: str, label: str) -> Any:
        """Return a number, a value, or a list or mapping of them, scaled."""
        if isinstance(item, Value):
            return self.value(item, unit)
        if isinstance(item, Mapping):
            return {key: self.item(one, unit, label) for key, one in item.items()}
        if isinstance(item, list | tuple):
            return tuple(self.item(one, unit, label) for one in item)
        if item is None or isinstance(item, str | bool) or callable(item):
            if unit == FIXED and item is not None:
                raise SceneError(
                    f"Scene.scaled: {label} is {shown(item)}, a file that has lengths of its own; "
                    "expected a scene that stands for itself; scale the scene that wrote it, or "
                    "give the geometry as values"
                )
            return item
        if isinstance(item, int) and HALF_POWERS.get(unit) == 0:
            return item
        if unit == TEXT:
            raise SceneError(
                f"Scene.scaled: {label} is {shown(item)} and has no unit; expected one in "
                "libmpm._src.scene.scaling.UNITS"
            )
        return item * self.factor(unit)

    def _material(self, item: Material) -> Material:
        have = item.parameters()
        index = have.get("index", 1.0)
        scaled = {
            p.name: have[p.name] * self.material(p.unit, index) for p in item.table.parameters
        }
        return dataclasses.replace(item, **scaled)  # type: ignore[type-var]

    # Scenes ----------------------------------------------------------------------------------

    def scene(self, scene: S) -> S:
        """Return the scene with everything scaled; raises `SceneError`."""
        if scene.start is not None:
            raise SceneError(
                f"Scene.scaled: the scene goes on from {scene.start.checkpoint}, whose particles "
                "cannot be scaled; expected a scene of its own; scale the scene that wrote the "
                "checkpoint, run it, and go on from there"
            )
        if scene.dimension != self.dimension:
            return dataclasses.replace(self, dimension=scene.dimension).scene(scene)
        data = scene.to_dict()
        for key in HEAD:
            if key in data:
                made = self.item(getattr(scene, key), UNITS["Scene"][key], f"Scene.{key}")
                data[key] = made.to_dict() if isinstance(made, Value) else made
        for kind, parts in scene._parts().items():
            made = [self.value(part).to_dict() for part in parts]
            data[kind] = [{k: v for k, v in part.items() if k != "type"} for part in made]
        return SceneReader(type(scene), data).read()


def scale_scene(
    scene: S, length_ratio: float, *, cauchy: bool = False, reynolds: bool = False
) -> S:
    """Return the scene in similitude; see `Scene.scaled`."""
    return Scaling(length_ratio, cauchy, reynolds).scene(scene)


# Formulas of coordinates -------------------------------------------------------------------------

_AXES = ("x", "y", "z")


def _texts(field: Field) -> tuple[str, ...]:
    return tuple(field.components)


def _scaled_formula(text: str, length: float, factor: float) -> str:
    """Return f · formula(x/λ, y/λ, z/λ) as a formula of the same grammar."""
    tree = _Coordinates(length).visit(ast.parse(text.strip(), mode="eval").body)
    return ast.unparse(_times(tree, factor))


def _number(node: ast.AST) -> float | None:
    """Return a plain number; None of anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    return None


def _rounded(number: float) -> float:
    """Return 1 for what is 1 to rounding, so that scaling there and back leaves no factor."""
    return 1.0 if abs(number - 1) < 1e-12 else number


class _Coordinates(ast.NodeTransformer):
    """Replaces x by x / λ, and x / a by x / (a λ)."""

    def __init__(self, length: float) -> None:
        self._length = length

    def _over(self, name: ast.expr, number: float) -> ast.expr:
        number = _rounded(number)
        return name if number == 1 else ast.BinOp(name, ast.Div(), ast.Constant(number))

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return self._over(node, self._length) if node.id in _AXES else node

    def visit_Call(self, node: ast.Call) -> ast.expr:
        # The function's own name is no coordinate.
        node.args = [self.visit(argument) for argument in node.args]
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        below = _number(node.right)
        if (
            isinstance(node.op, ast.Div)
            and isinstance(node.left, ast.Name)
            and node.left.id in _AXES
            and below is not None
        ):
            return self._over(node.left, below * self._length)
        self.generic_visit(node)
        return node


def _times(node: ast.expr, factor: float) -> ast.expr:
    """Return factor · node, taken into a leading number where there is one."""
    number = _number(node)
    if number is not None:
        return ast.Constant(number * factor)
    if factor == 1:
        return node
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        leading = _number(node.left)
        if leading is not None:
            return _times(node.right, _rounded(leading * factor))
    return ast.BinOp(ast.Constant(factor), ast.Mult(), node)
