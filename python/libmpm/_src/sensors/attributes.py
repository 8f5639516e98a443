"""Every particle attribute by its library name: what it is, what it is made from, who has it.

The names are those of ClaymoreUW's output (Bonus 2023, listing of attributes); they are accepted
wherever attributes are named, besides the engine's own (`position`, `stress`, ...), and nothing is
computed before it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import nearest
from libmpm._src.sensors import tensors
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["ENGINE", "Attribute", "attribute", "compute", "find", "is_known", "names"]
__all__ += ["of_elements", "reads", "refusal", "upward"]

Array = NDArray[np.float64]

#: The engine's own names that sensors take, with units; vectors have one number per axis.
ENGINE: dict[str, str] = {
    "position": "m", "velocity": "m/s", "mass": "kg", "volume": "m³", "density": "kg/m³",
    "pressure": "Pa", "speed": "m/s", "kinetic_energy": "J", "elastic_energy": "J",
    "volume_ratio": "1", "volume_ratio_smoothed": "1", "plastic_strain": "1", "yields": "1",
    "element_pressure": "Pa", "element_volume_ratio": "1", "element_energy": "J",
    "element_plastic_strain": "1",
}  # fmt: skip
VECTORS = ("position", "velocity")


@dataclass(frozen=True)
class Source:
    """What attributes are computed from: arrays of one body's particles by engine name.

    Positions are in the world, m; `up` is the unit vector against gravity, (d,).
    """

    arrays: Mapping[str, NDArray[Any]]
    body: Body
    up: Array

    def deformation(self) -> Array:
        """Return F, (n, 3, 3)."""
        return tensors.solid(self.arrays["deformation_gradient"], 1.0)

    def cauchy(self, of: str = "") -> Array:
        """Return σ, (n, 3, 3), Pa; in plane strain σ_zz = -3p - σ_xx - σ_yy.

        `of` is "element_" for that of elements, empty for that of particles.
        """
        stress, pressure = self.arrays[f"{of}stress"], self.arrays[f"{of}pressure"]
        if stress.shape[-1] == 3:
            return stress
        return tensors.solid(stress, -3 * pressure - np.trace(stress, axis1=1, axis2=2))

    def strain(self) -> Array:
        """Return the small strain, (n, 3, 3); of linear elasticity the one that it stores."""
        if not _stores_strain(self.body):
            return tensors.small_strain(self.deformation())
        d = len(self.up)
        places = ((0, 2), (2, 1)) if d == 2 else ((0, 5, 4), (5, 1, 3), (4, 3, 2))
        return tensors.solid(self.arrays["state"][:, np.array(places)], 0.0)

    def column(self, name: str) -> Array:
        """Return a scalar that the material stores, (n,)."""
        at = 0
        for column in self.body.material.table.columns:
            if column.name == name:
                return np.asarray(self.arrays["state"][:, at], dtype=np.float64)
            at += _plane(column.components) if len(self.up) == 2 else column.components
        raise KeyError(name)


def _plane(components: int) -> int:
    """Return the numbers in 2D of what has so many in 3D: of symmetric tensors with their zz."""
    return {9: 4, 6: 4}.get(components, components)


def _stores_strain(body: Body) -> bool:
    return [c.name for c in body.material.table.columns] == ["strain"]


@dataclass(frozen=True)
class Attribute:
    """One attribute: name, SI unit, engine arrays it is made from, and how.

    `needs` is "F" for a deformation gradient, "strain" for that or a stored strain, "z" for a third
    axis, "logJp" and "pore" for what few materials have, "" for what all have.
    """

    name: str
    unit: str
    reads: tuple[str, ...]
    make: Callable[[Source], NDArray[Any]]
    needs: str = ""


_STRESS = ("stress", "pressure")
_ELEMENT_STRESS = ("element_stress", "element_pressure")
_F = ("deformation_gradient",)


def _component(tensor: Callable[[Source], Array], i: int, j: int) -> Callable[[Source], Array]:
    return lambda s: tensor(s)[:, i, j]


def _of(tensor: Callable[[Source], Array], rule: Any, number: int) -> Callable[[Source], Array]:
    return lambda s: rule(tensor(s), number)


def _piola(rule: Callable[[Array, Array], Array]) -> Callable[[Source], Array]:
    return lambda s: rule(s.deformation(), s.cauchy())


def _log_volume(s: Source) -> Array:
    """Return logJp: opened volume of sand, consolidation of Cam-Clay."""
    names = [c.name for c in s.body.material.table.columns]
    if "gap" in names:
        return s.column("gap")
    return s.body.material.parameters()["log_plastic_volume"] + s.column("consolidation")


def _element_cauchy(s: Source) -> Array:
    """Return σ of elements, (m, 3, 3), Pa."""
    return s.cauchy("element_")


def of_elements(name: str) -> bool:
    """Tell whether an attribute has a row for each element, not for each particle or vertex."""
    return name.startswith("element_")


def _table() -> dict[str, Attribute]:
    found: list[Attribute] = []

    def add(name: str, unit: str, reads: Sequence[str], make: Any, needs: str = "") -> None:
        found.append(Attribute(name, unit, tuple(reads), make, needs))

    def plain(name: str, unit: str, engine: str) -> None:
        add(name, unit, (engine,), lambda s: s.arrays[engine])

    plain("ID", "1", "id")
    plain("Mass", "kg", "mass")
    plain("Volume", "m³", "volume")
    for a, axis in enumerate("XYZ"):
        for name, engine, unit in (("Position", "position", "m"), ("Velocity", "velocity", "m/s")):
            one = partial(lambda s, e, a: s.arrays[e][:, a], e=engine, a=a)
            add(f"{name}_{axis}", unit, (engine,), one, "z" if a == 2 else "")
    plain("Velocity_Magnitude", "m/s", "speed")
    add("Elevation", "m", ("position",), lambda s: s.arrays["position"] @ s.up)
    for name in ("J", "DefGrad_Determinant"):
        plain(name, "1", "volume_ratio")
    for name in ("JBar", "DefGrad_Determinant_FBAR"):
        # Where one ratio is stored, it is the smoothed one.
        smoothed = ("volume_ratio_smoothed",)
        add(name, "1", smoothed, lambda s: s.arrays[_smoothed(s.arrays)])
    plain("Pressure", "Pa", "pressure")
    of_element = partial(add, unit="Pa", reads=_ELEMENT_STRESS, needs="elements")
    of_element("element_von_mises", make=lambda s: tensors.von_mises(_element_cauchy(s), 1.5))
    for k in (1, 2, 3):
        of_element(f"element_stress_{k}", make=_of(_element_cauchy, tensors.principal, k))
    for (i, row), (j, line) in combinations_with_replacement(enumerate("XYZ"), 2):
        of_element(f"element_stress_{row}{line}", make=_component(_element_cauchy, i, j))
    add("VonMisesStress", "Pa", _STRESS, lambda s: tensors.von_mises(s.cauchy(), 1.5))
    add("VonMisesStrain", "1", _F, lambda s: tensors.von_mises(s.strain(), 2 / 3), "strain")
    add("PorePressure", "Pa", (), None, "pore")
    add("logJp", "1", ("state",), _log_volume, "logJp")

    first, second = _piola(tensors.first_piola), _piola(tensors.second_piola)
    each = (
        ("DefGrad", "1", _F, Source.deformation, Source.deformation, tensors.stretches, "F"),
        ("StressCauchy", "Pa", _STRESS, Source.cauchy, Source.cauchy, tensors.principal, ""),
        ("StressPK1", "Pa", _F + _STRESS, first, _piola(tensors.biot), tensors.principal, "F"),
        ("StressPK2", "Pa", _F + _STRESS, second, second, tensors.principal, "F"),
        ("StrainSmall", "1", _F, Source.strain, Source.strain, tensors.principal, "strain"),
    )
    for name, unit, needed, tensor, symmetric, rule, needs in each:
        for i, row in enumerate("XYZ"):
            for j, line in enumerate("XYZ"):
                add(f"{name}_{row}{line}", unit, needed, _component(tensor, i, j), needs)
        for k in (1, 2, 3):
            power = unit if k == 1 or unit == "1" else f"{unit}{'²' if k == 2 else '³'}"
            make = _of(tensor, tensors.invariant, k)
            add(f"{name}_Invariant{k}", power, needed, make, needs)
            add(f"{name}_{k}", unit, needed, _of(symmetric, rule, k), needs)
    strain = {a.name: a for a in found if a.name.startswith("StrainSmall_Invariant")}
    for alias, k in (("Dilation", 1), ("StrainSmall_Determinant", 3)):
        same = strain[f"StrainSmall_Invariant{k}"]
        add(alias, same.unit, same.reads, same.make, same.needs)
    return {a.name: a for a in found}


def _smoothed(arrays: Mapping[str, Any]) -> str:
    return "volume_ratio_smoothed" if "volume_ratio_smoothed" in arrays else "volume_ratio"


_ATTRIBUTES = _table()


def names() -> tuple[str, ...]:
    """Return every library name, aliases included."""
    return tuple(_ATTRIBUTES)


def find(name: str) -> Attribute | None:
    """Return what is known of a library name; None of any other."""
    return _ATTRIBUTES.get(name) if isinstance(name, str) else None


def is_known(name: object) -> bool:
    """Return whether a name is in the table or one of the engine's that sensors take."""
    return name in _ATTRIBUTES or name in ENGINE


def upward(scene: SceneData) -> Array:
    """Return the unit vector against gravity at time 0, (d,); the last axis without gravity."""
    from libmpm._src.scene.places import initial_gravity  # which knows how bodies are filled

    gravity = initial_gravity(scene)
    strength = float(np.linalg.norm(gravity))
    if strength == 0:
        found: Array = np.eye(scene.dimension)[-1]
        return found
    return -gravity / strength


def reads(name: str, body: Body, stored: Iterable[str]) -> tuple[str, ...]:
    """Return the engine's arrays that an attribute of a body is made from.

    `stored` are the names that the engine has for the body.
    """
    found = _ATTRIBUTES.get(name)
    if found is None:
        return (name,)
    if "volume_ratio_smoothed" in found.reads and "volume_ratio_smoothed" not in stored:
        return ("volume_ratio",)
    if found.needs == "strain" and _stores_strain(body):
        return ("state",)
    return found.reads


def compute(name: str, source: Source) -> NDArray[Any]:
    """Return an attribute, (n,), from the arrays that `reads` names."""
    found = _ATTRIBUTES.get(name)
    return source.arrays[name] if found is None else found.make(source)


def _has(body: Body, needs: str, scene: SceneData) -> bool:
    table = body.material.table
    meshed = isinstance(body.shape, ElementMesh)
    # What a law stores is an element's, and not a vertex'.
    if needs == "elements" or (meshed and needs in ("F", "strain", "logJp", "pore")):
        return meshed and needs == "elements"
    columns = [c.name for c in table.columns]
    if needs == "F":
        return table.needs == "deformation_gradient"
    if needs == "strain":
        return table.needs == "deformation_gradient" or (
            _stores_strain(body) and scene.grid is None
        )
    if needs == "logJp":
        return scene.grid is None and bool({"gap", "consolidation"} & set(columns))
    if needs == "pore":
        return "pore_pressure" in columns
    return True


_MEANING = {
    "F": "deformation gradient",
    "strain": "deformation gradient and no strain",
    "logJp": "logarithm of a plastic volume",
    "pore": "pore pressure",
    "elements": "elements",
}


def refusal(name: str, body: Body, scene: SceneData) -> str | None:
    """Return why a body of a scene has no such attribute, with the remedy; None if it has."""
    found = _ATTRIBUTES.get(name)
    if name in ENGINE and of_elements(name):
        found = _ATTRIBUTES["element_von_mises"]  # needs what these need
        flows = "plastic_strain" in [c.name for c in body.material.table.columns]
        if name == "element_plastic_strain" and _has(body, "elements", scene) and not flows:
            return _refused_by_engine("plastic_strain", body, scene)
    if found is None:
        if name in ENGINE:
            return _refused_by_engine(name, body, scene)
        return f"attribute is '{name}'; {nearest(name, (*_ATTRIBUTES, *ENGINE))}"
    if found.needs == "z" and scene.dimension == 2:
        return f"attribute is '{name}' in 2D; expected an axis x or y; leave it out"
    if _has(body, found.needs, scene):
        return None
    able = [b.name for b in scene.bodies if _has(b, found.needs, scene)]
    which = ", ".join(f"'{n}'" for n in able) or "none of this scene"
    remedy = f"ask for it of {which}" if able else "choose another material or attribute"
    return (
        f"attribute is '{name}' of body '{body.name}', whose {body.material.table.name} stores no "
        f"{_MEANING[found.needs]}; bodies that do: {which}; {remedy}"
    )


def _refused_by_engine(name: str, body: Body, scene: SceneData) -> str | None:
    columns = [c.name for c in body.material.table.columns]
    form = body.fbar.form if body.fbar not in ("default", None) else ""  # type: ignore[union-attr]
    missing = {
        "plastic_strain": "plastic_strain" not in columns,
        "yields": isinstance(body.shape, ElementMesh),
        "volume_ratio_smoothed": form not in ("two-volume", "split", "literal"),
    }.get(name, False)
    if not missing:
        return None
    return (
        f"attribute is '{name}' of body '{body.name}' ({body.material.table.name}), which does not "
        "store it; choose another body or attribute"
    )


def attribute(simulation: Running, body: str, name: str) -> NDArray[Any]:
    """Return an attribute of a body's particles, (n,) in SI units, rows sorted by id.

    `name` is one of `names`, or an attribute of the engine. Positions are in the world, m. Raises
    `KeyError` where the body does not have it, and says which do.
    """
    return simulation.particles[body][name]
