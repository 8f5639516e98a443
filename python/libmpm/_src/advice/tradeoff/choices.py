"""Numerical choices that `tradeoff` can vary of a scene that is already described."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from libmpm._src.base.values import Checker, nearest, plain, sequence, shown
from libmpm._src.boundaries.responses import DecayLayer
from libmpm._src.errors import Error, SceneError
from libmpm._src.grids.shapes import Cells, Points
from libmpm._src.materials.rigid import Rigid
from libmpm._src.methods.method import FBar
from libmpm._src.methods.transfer import as_kernel, as_transfer
from libmpm._src.run import backends
from libmpm._src.run.choices import PIPELINES, PRECISIONS
from libmpm._src.scene.parts import Body
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.element_mesh import ElementMesh, Tetrahedra, Triangles
from libmpm._src.shapes.solid import GivenPoints
from libmpm._src.studies.study.plan import OPTIONS

__all__ = ["CHOICES", "apply_choices", "check_value", "refusal", "unknown"]

Document = dict[str, Any]

#: What a scene does not say in one number, and where it is said.
_ELSEWHERE = {
    "dimension": "shapes, sensors and boundaries have to change with it",
    "density": "it is physics, not a numerical choice",
    "gravity": "it is physics, not a numerical choice",
    "youngs_modulus": "the stiffness of a solid is physics, not a numerical choice",
    "walls": "each boundary has a response of its own",
    "lattice": "each body has one of its own",
}
#: Choices that are none, because nothing else exists.
_ALWAYS = {
    "reproducible": (
        "every run gives the same bits on the same backend, and there is no faster mode without "
        "it; leave it out"
    ),
    "deterministic": (
        "every run gives the same bits on the same backend, and there is no faster mode without "
        "it; leave it out"
    ),
}


@dataclass(frozen=True)
class Choice:
    """A numerical choice of a scene.

    `take` checks a value and returns what `put` writes into the scene's dictionary; `bar` returns
    why a scene has no such choice, or nothing.
    """

    take: Callable[[Checker, str, Any], Any]
    bar: Callable[[Scene], str]
    put: Callable[[Document, Scene, Any], None]


# What keeps a scene from having a choice --------------------------------------------------------


def _on_functions(scene: Scene) -> str:
    return "" if scene.grid is None else "the scene's grid of functions has its own"


def _bar_particles(scene: Scene) -> str:
    barred = ""
    for body in scene.bodies:
        if body.lattice is not None:
            barred = barred or f"body '{body.name}' has a lattice of its own"
        elif isinstance(body.shape, GivenPoints | Cells | Points):
            kind = type(body.shape).__name__
            barred = barred or f"body '{body.name}' takes its particles from {kind}"
    return barred


def _has_bulk(body: Body) -> bool:
    return "bulk_modulus" in body.material.parameters()


def _bar_bulk(scene: Scene) -> str:
    if not any(map(_has_bulk, scene.bodies)):
        return "no body of the scene has a bulk_modulus"
    return ""


def _bar_transfer(scene: Scene) -> str:
    own = [body.name for body in scene.bodies if body.transfer is not None]
    return f"body '{own[0]}' has a transfer of its own" if own else _on_functions(scene)


def _bar_fluid(scene: Scene) -> str:
    if not any(body.material.table.stores_volume for body in scene.bodies):
        return "no body of the scene is a fluid; vary solid_fbar for solids"
    return _on_functions(scene)


def _smooths_solid(body: Body) -> bool:
    return not body.material.table.stores_volume and body.material.table.fbar


def _bar_solid(scene: Scene) -> str:
    if not any(map(_smooths_solid, scene.bodies)):
        return "no solid of the scene has volume smoothing; vary fbar for fluids"
    return _on_functions(scene)


def _bar_layer(scene: Scene) -> str:
    if not any(boundary.is_surface for boundary in scene.boundaries):
        return "no boundary of the scene is a surface, which alone has a layer"
    return ""


# How a value is checked -------------------------------------------------------------------------


def _positive(unit: str = "", upper: float = float("inf")) -> Callable[[Checker, str, Any], float]:
    def take(check: Checker, name: str, value: Any) -> float:
        return check.number(name, value, lower=0, lower_open=True, upper=upper, unit=unit)

    return take


def _count(check: Checker, name: str, value: Any) -> int:
    return check.integer(name, value, lower=1)


def _within(check: Checker, name: str, make: Callable[[Checker], Any]) -> Any:
    """Return what `make` makes, with its problems under the axis' name."""
    inner = Checker(name)
    try:
        made = make(inner)
        inner.finish()
    except SceneError as error:
        for problem in error.problems:
            check.fail(problem)
        return None
    return made


def _transfer(check: Checker, name: str, value: Any) -> Any:
    if value is None:  # what the scene takes
        return None
    return _within(check, name, lambda inner: as_transfer(inner, value))


def _kernel(check: Checker, name: str, value: Any) -> Any:
    return _within(check, name, lambda inner: as_kernel(inner, value))


def _fbar(check: Checker, name: str, value: Any) -> Any:
    if value is None or value == "default" or isinstance(value, FBar):
        return value
    if not isinstance(value, str):
        check.fail(
            f'{name} has {shown(value)}; expected FBar(...), the name of a form, "default", None'
        )
        return None
    return _within(check, name, lambda _: FBar(form=value))  # type: ignore[arg-type]


def _names(check: Checker, name: str, value: Any) -> tuple[str, ...]:
    items = (value,) if isinstance(value, str) else sequence(value)
    if items is None or not all(isinstance(item, str) for item in items):
        check.fail(f"{name} has {shown(value)}; expected names of bodies; give () for none")
        return ()
    return tuple(items)


def _layer(check: Checker, name: str, value: Any) -> Any:
    if value is None:
        return value
    return check.instance(name, value, (DecayLayer,), "boundaries.DecayLayer(...) or None")


# How a value is put into a scene ----------------------------------------------------------------


def _put_head(name: str) -> Callable[[Document, Scene, Any], None]:
    def put(document: Document, _scene: Scene, value: Any) -> None:
        document[name] = value

    return put


def _put_method(name: str) -> Callable[[Document, Scene, Any], None]:
    def put(document: Document, _scene: Scene, value: Any) -> None:
        document["method"] = {**document["method"], name: plain(value)}

    return put


def _put_bodies(
    name: str, applies: Callable[[Body], bool] = lambda body: True
) -> Callable[[Document, Scene, Any], None]:
    def put(document: Document, scene: Scene, value: Any) -> None:
        for part, body in zip(document["bodies"], scene.bodies, strict=True):
            if applies(body):
                part[name] = plain(value)

    return put


def _put_bulk(document: Document, scene: Scene, value: Any) -> None:
    for part, body in zip(document["bodies"], scene.bodies, strict=True):
        if _has_bulk(body):
            modulus = body.material.parameters()["bulk_modulus"] * value
            part["material"] = {**part["material"], "bulk_modulus": modulus}


def _put_layer(document: Document, scene: Scene, value: Any) -> None:
    for part, boundary in zip(document["boundaries"], scene.boundaries, strict=True):
        if boundary.is_surface:
            part["layer"] = plain(value)


def _named_solids(axis: str, scene: Scene, value: tuple[str, ...]) -> None:
    solids = {b.name for b in scene.bodies if not b.material.table.stores_volume}
    for name in value:
        if name not in solids:
            raise SceneError(
                f"tradeoff: {axis} has '{name}', which is no solid body of the scene; "
                f"{nearest(name, sorted(solids))}"
            )


def _put_rigid(document: Document, scene: Scene, value: tuple[str, ...]) -> None:
    _named_solids("rigid", scene, value)
    for part, body in zip(document["bodies"], scene.bodies, strict=True):
        if body.name in value:
            density = body.material.parameters()["density"]
            part["material"] = Rigid(density=density).to_dict()


def _put_elements(document: Document, scene: Scene, value: tuple[str, ...]) -> None:
    _named_solids("elements", scene, value)
    mesh = Triangles if scene.dimension == 2 else Tetrahedra
    for part, body in zip(document["bodies"], scene.bodies, strict=True):
        if body.name not in value or isinstance(body.shape, ElementMesh):
            continue
        if isinstance(body.shape, GivenPoints | Cells | Points):
            kind = type(body.shape).__name__
            raise SceneError(
                f"tradeoff: elements has '{body.name}', whose particles come from {kind}; expected "
                f"a solid of libmpm.shapes, which can be meshed"
            )
        # Half a cell is as good as 2ᵈ particles a cell (docs/elements.md).
        made = mesh.fill(solid=body.shape, edge=0.5 * document["cell_size"])
        part["shape"] = made.to_dict()
        # A mesh that cuts corners off has the solid's mass all the same.
        whole = body.shape.volume()
        if whole is not None and abs(made.total_volume() / whole - 1) > 1e-9:
            density = body.material.parameters()["density"] * whole / made.total_volume()
            part["material"] = {**part["material"], "density": density}
        for of_particles in ("particles_per_cell", "lattice", "sampling", "fbar"):
            part.pop(of_particles, None)


_NEVER: Callable[[Scene], str] = lambda scene: ""  # noqa: E731

#: Name -> choice, of the scene itself; options of `Simulation` come beside them.
CHOICES: Mapping[str, Choice] = {
    "cell_size": Choice(_positive("m"), _on_functions, _put_head("cell_size")),
    "particles_per_cell": Choice(_count, _bar_particles, _put_bodies("particles_per_cell")),
    "bulk_modulus": Choice(_positive(), _bar_bulk, _put_bulk),
    "cfl": Choice(_positive(upper=1.0), _NEVER, _put_method("cfl")),
    "transfer": Choice(_transfer, _bar_transfer, _put_method("transfer")),
    "kernel": Choice(_kernel, _on_functions, _put_method("kernel")),
    "fbar": Choice(
        _fbar, _bar_fluid, _put_bodies("fbar", lambda body: body.material.table.stores_volume)
    ),
    "solid_fbar": Choice(_fbar, _bar_solid, _put_bodies("fbar", _smooths_solid)),
    "layer": Choice(_layer, _bar_layer, _put_layer),
    "rigid": Choice(_names, _on_functions, _put_rigid),
    "elements": Choice(_names, _on_functions, _put_elements),
}


# For the axes ------------------------------------------------------------------------------------


def unknown(name: str, also: tuple[str, ...] = ()) -> str:
    """Return why there is no choice `name`, and the remedy; `also` are names of a factory."""
    if name in _ALWAYS:
        return f"'{name}' cannot be varied: {_ALWAYS[name]}"
    factory = "give a factory with it as a parameter in place of the scene"
    if name in _ELSEWHERE:
        return f"'{name}' cannot be varied of a scene: {_ELSEWHERE[name]}; {factory}"
    hint = nearest(name, (*also, *CHOICES, *OPTIONS))
    return f"'{name}' is no numerical choice of a scene; {hint}; for anything else, {factory}"


def refusal(name: str, scene: Scene) -> str:
    """Return why a scene has not the choice `name` of `CHOICES`; empty if it has."""
    if scene.start is not None:
        why = "it continues from a checkpoint, whose state has its own; vary the run that wrote it"
    else:
        why = CHOICES[name].bar(scene)
    return why and f"'{name}' cannot be varied of this scene: {why}"


def check_value(check: Checker, name: str, value: Any) -> None:
    """Report a value that a choice, or an option of `Simulation`, cannot have."""
    if name in CHOICES:
        CHOICES[name].take(check, name, value)
    elif name == "precision":
        check.choice(name, value, ("auto", *PRECISIONS))
    elif name == "pipeline":
        check.choice(name, value, PIPELINES)
    elif name == "threads":
        check.integer(name, value)
    elif name == "time_step" and value is not None:
        check.number(name, value, lower=0, lower_open=True, unit="s")
    elif name == "shared_device":
        check.instance(name, value, (bool,), "True or False")
    elif name == "device":
        try:
            backends.parse_device(value)
        except (Error, AttributeError, TypeError) as error:
            check.fail(f"{name} has {shown(value)}: {error}")


def apply_choices(scene: Scene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other numerical choices; raises `SceneError` with all problems."""
    if not values:
        return scene
    check = Checker("tradeoff")
    for name in values:
        if why := refusal(name, scene):
            check.fail(why)
    taken = {name: CHOICES[name].take(check, name, value) for name, value in values.items()}
    check.finish()
    document = scene.to_dict()
    for name in (name for name in CHOICES if name in taken):  # elements by the cells of cell_size
        CHOICES[name].put(document, scene, taken[name])
    return Scene.from_dict(document)
