"""Functions of `Custom` sensors, which no file can hold."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from libmpm._src.base.values import nearest
from libmpm._src.errors import SceneError
from libmpm._src.sensors.python_sensors import Custom

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["check_functions", "check_storable", "storable", "with_functions"]


def _customs(document: Mapping[str, Any]) -> list[dict[str, Any]]:
    parts = document.get("sensors", [])
    return [p for p in parts if p["sensor"].get("type") == Custom.__name__]


def storable(scene: SceneData) -> dict[str, Any]:
    """Return the scene in terms of JSON, with the names of functions in their place."""
    document = scene.to_dict()
    named = {p.name: p.sensor for p in scene.sensors if isinstance(p.sensor, Custom)}
    for part in _customs(document):
        part["sensor"] = part["sensor"] | {"function": named[part["name"]].function_name}
    return document


def with_functions(
    document: dict[str, Any], functions: Mapping[str, Callable[[Any], Any]] | None
) -> dict[str, Any]:
    """Return a scene's dictionary with the functions of its `Custom` sensors, by sensor name."""
    found = {part["name"]: part for part in _customs(document)}
    problems = [
        f"functions has '{name}', which is no sensors.Custom of the scene; "
        + (nearest(name, found) if found else "it has none; leave it out")
        for name in functions or {}
        if name not in found
    ]
    if problems:
        raise SceneError(problems)
    for name, function in (functions or {}).items():
        part = found[name]
        part["sensor"] = part["sensor"] | {"function": function}
    return document


def check_storable(scene: SceneData) -> None:
    """Raise `SceneError` for every sensor that a scene file cannot hold."""
    problems = [
        f"sensor '{p.name}': its function {p.sensor.function_name} cannot be written to a file; "
        "expected sensors that are plain values; use another, or add it where the scene is run"
        for p in scene.sensors
        if isinstance(p.sensor, Custom) and not isinstance(p.sensor.function, str)
    ]
    if problems:
        raise SceneError(problems)


def check_functions(scene: SceneData) -> None:
    """Raise `SceneError` for every `Custom` sensor of which there is only a name."""
    problems = [
        f"sensor '{p.name}': its function '{p.sensor.function}' is only a name, which a file kept; "
        f"expected the callable; give Simulation(..., functions={{'{p.name}': function}}), or "
        "the same to Simulation.resume"
        for p in scene.sensors
        if isinstance(p.sensor, Custom) and isinstance(p.sensor.function, str)
    ]
    if problems:
        raise SceneError(problems)
