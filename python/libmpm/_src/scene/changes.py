"""`Scene.copy`, `replace`, `remove`: changes of a scene that is already described."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from libmpm._src.base.arguments import wrong_arguments
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import ArgumentError, SceneError
from libmpm._src.methods.method import FBar
from libmpm._src.scene.data import HEAD, SceneData
from libmpm._src.scene.parts import Body
from libmpm._src.shapes.particle_placement import Sampling

__all__ = ["copied", "drop_packing_options", "remove", "replace"]

S = TypeVar("S", bound=SceneData)

#: What a grid of functions takes the place of.
_OF_SQUARES = ("cell_size", "lower", "upper", "dimension")


def copied(scene: S, changes: Mapping[str, Any]) -> S:
    """Return a scene of the same parts, with some arguments of `Scene` changed."""
    if scene.start is not None and changes:
        raise SceneError(
            f"Scene.copy: {', '.join(changes)} of a scene that continues from a checkpoint cannot "
            "change, because its state was computed with what it has; expected no changes; make "
            "the run itself with them"
        )
    if "start" in changes:
        raise SceneError("Scene.copy: start is what Scene.from_checkpoint sets; leave it out")
    _check_names("copy", [key for key in HEAD if key != "start"], changes)
    head = {key: getattr(scene, key) for key in scene._head()}
    if changes.get("grid") is not None:
        head = {key: item for key, item in head.items() if key not in _OF_SQUARES}
    made = type(scene)(**{**head, **changes})
    for kind, parts in scene._by_kind().items():
        for name, part in parts.items():
            if isinstance(part, Body) and _is_default(scene, part):
                part = _filled(part, made)
            made._by_kind()[kind][name] = part
    return made


def replace(scene: SceneData, name: str, kind: str | None, changes: Mapping[str, Any]) -> None:
    """Change what is given of the part `name`, which keeps its place among the others."""
    kind = _kind_of(scene, "replace", name, kind)
    old = scene._by_kind()[kind][name]
    inner: Any = old.sensor if kind == "sensor" else old.flow if kind == "flow" else old
    fields = [f.name for f in dataclasses.fields(inner) if f.name != "name"]
    _check_names("replace", fields, changes)
    new = dataclasses.replace(inner, **changes)
    if inner is not old:
        new = dataclasses.replace(old, **{kind: new})
    elif isinstance(old, Body) and "sampling" not in changes and _is_default(scene, old):
        new = _filled(new, scene)
    scene._by_kind()[kind][name] = new


def remove(scene: SceneData, name: str, kind: str | None) -> None:
    """Take the part `name` out of the scene."""
    del scene._by_kind()[_kind_of(scene, "remove", name, kind)][name]


def drop_packing_options(scene: SceneData, name: str) -> None:
    """Let a fluid's volumes be as they are from here on, led by no density and not shifted.

    The one change of what is part of the run that a scene continues from: neither has a state of
    its own, which would have to be computed with it.
    """
    body = scene._bodies[name]
    if isinstance(body.fbar, FBar):
        fbar = dataclasses.replace(body.fbar, density=False, shifting=False)
        scene._bodies[name] = dataclasses.replace(body, fbar=fbar)


def _check_names(what: str, names: Iterable[str], changes: Mapping[str, Any]) -> None:
    problems = wrong_arguments(f"Scene.{what}", list(names), (), 0, 0, changes)
    if problems:
        raise ArgumentError(problems)


def _default(scene: SceneData, body: Body) -> Sampling | None:
    """Return how a body is filled where nothing is said of it."""
    return scene._placed(body.shape, body.material, body.lattice)


def _is_default(scene: SceneData, body: Body) -> bool:
    return body.sampling == _default(scene, body)


def _filled(body: Body, scene: SceneData) -> Body:
    """Return the body filled by default; itself where it is."""
    sampling = _default(scene, body)
    return body if body.sampling == sampling else dataclasses.replace(body, sampling=sampling)


def _kind_of(scene: SceneData, what: str, name: str, kind: str | None) -> str:
    """Return the kind of part that a name is of; refuses what a checkpoint knows of."""
    known = scene._by_kind()
    if kind is not None and kind not in known:
        raise SceneError(f"Scene.{what}: kind is {shown(kind)}; {nearest(kind, known)}")
    found = [k for k, parts in known.items() if name in parts and kind in (None, k)]
    if not found:
        names = [n for k, parts in known.items() for n in parts if kind in (None, k)]
        raise SceneError(
            f"Scene.{what}: the scene has no {kind or 'part'} {shown(name)}; {nearest(name, names)}"
        )
    if len(found) > 1:
        raise SceneError(
            f"Scene.{what}: '{name}' is a {' and a '.join(found)}; expected one of them; "
            f"say which: kind='{found[0]}'"
        )
    start, at = scene.start, list(known[found[0]]).index(name)
    own = {} if start is None else {
        "body": len(start.bodies), "boundary": start.boundaries, "sensor": start.sensors,
    }  # fmt: skip
    if at < own.get(found[0], 0):
        raise SceneError(
            f"Scene.{what}: {found[0]} '{name}' is part of the run that the scene continues from, "
            "whose state was computed with it; expected a part that was added since; make the run "
            "itself without it"
        )
    return found[0]
