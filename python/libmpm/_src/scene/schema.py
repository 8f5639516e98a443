"""`libmpm schema`: the JSON Schema of scene files, made from the values themselves.

Types come from the annotations of fields and arguments; meanings, units and ranges from their
declarations (`given`), those of materials from the core. A new value is in the schema as soon as it
is defined.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import importlib
import inspect
import json
import math
import types
import typing
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import numpy as np

from libmpm._src.base.declarations import Given, declared
from libmpm._src.base.values import Value, plain, registry
from libmpm._src.materials.material import Material, Parameter
from libmpm._src.scene.data import HEAD, SCHEMA, SceneData
from libmpm._src.scene.scene import Scene

__all__ = ["DRAFT", "scene_schema", "schema_text"]

DRAFT = "https://json-schema.org/draft/2020-12/schema"

#: Made by libmpm alone, and accepted as they are.
_OPAQUE = {"Start"}

_NOTHING: dict[str, Any] = {"not": {}}
#: A file writes infinity, the mark of an open end, as null.
_OPEN: dict[str, Any] = {"type": ["number", "null"]}


def _summary(kind: type) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0].replace("\n", " ")


# Types --------------------------------------------------------------------------------------------


class _Types:
    """Turns annotations into schemas that refer to definitions of values.

    `definitions` holds every value that one of them has referred to.
    """

    def __init__(self) -> None:
        # All that a file can name is registered by then, and nothing else can be read from one.
        importlib.import_module("libmpm")
        self.definitions: dict[str, dict[str, Any]] = {}

    def of(self, hint: Any) -> dict[str, Any]:
        """Return the schema of an annotation."""
        hint = _behind(hint)
        origin, arguments = typing.get_origin(hint), typing.get_args(hint)
        if hint is Any:
            return {}
        if origin is collections.abc.Callable:
            # No file holds a function; what else its field takes stays.
            return _NOTHING
        if hint is type(None):
            return {"type": "null"}
        if origin in (typing.Union, types.UnionType):
            return _any([self.of(a) for a in arguments])
        if origin is Literal:
            return {"enum": list(arguments)}
        if origin is tuple and Ellipsis not in arguments:
            items = [_OPEN if a is float else self.of(a) for a in arguments]
            return {
                "type": "array", "prefixItems": items, "minItems": len(items),
                "maxItems": len(items),
            }  # fmt: skip
        if origin is np.ndarray:
            return {"type": "array"}
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return {"type": "object", "additionalProperties": self.of(arguments[1])}
        if isinstance(origin, type) and issubclass(origin, Sequence | list | tuple):
            return {"type": "array", "items": self.of(arguments[0])}
        if isinstance(hint, type) and issubclass(hint, Value):
            return self._value(hint)
        simple = {bool: "boolean", int: "integer", float: "number", str: "string"}
        if hint in simple:
            return {"type": simple[hint]}
        raise TypeError(f"schema: no JSON for the annotation {hint!r}")

    def _value(self, base: type[Value]) -> dict[str, Any]:
        """Return references to every value that is a `base`."""
        kinds = {
            name: kind
            for name, kind in sorted(registry.items())
            if issubclass(kind, base) and kind.__module__.startswith("libmpm.")
        }
        for name, kind in kinds.items():
            if name not in self.definitions:
                self.definitions[name] = {}  # stands in while the value refers to itself
                self.definitions[name] = _of_value(name, kind, self)
        return _any([{"$ref": f"#/$defs/{name}"} for name in kinds])


def _behind(hint: Any) -> Any:
    """Return what an alias of a ``type`` statement stands for: `NDArray` is one since NumPy 2.5."""
    alias, arguments = typing.get_origin(hint) or hint, typing.get_args(hint)
    if not hasattr(alias, "__value__"):
        return hint
    return _behind(alias.__value__[arguments] if arguments else alias.__value__)


def _any(choices: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the schema that one of several fits; a free one swallows the others."""
    flat: list[dict[str, Any]] = []
    for choice in choices:
        for one in choice.get("anyOf", [choice]) if set(choice) <= {"anyOf"} else [choice]:
            if one not in flat and one != _NOTHING:
                flat.append(one)
    if {} in flat:
        return {}
    # An array of anything would hide what the other arrays ask for.
    arrays = [c for c in flat if c.get("type") == "array"]
    if len(arrays) > 1:
        flat = [c for c in flat if c != {"type": "array"}]
    if not flat:
        return _NOTHING
    return flat[0] if len(flat) == 1 else {"anyOf": flat}


def _object(
    properties: Mapping[str, Any], required: Sequence[str], description: str = ""
) -> dict[str, Any]:
    head = {"description": description} if description else {}
    return {
        **head,
        "type": "object",
        "properties": dict(properties),
        "required": list(required),
        "additionalProperties": False,
    }


def _defaulted(schema: dict[str, Any], default: Any) -> dict[str, Any]:
    """Return the schema with a default, where it has one that a file can hold."""
    item = plain(default)
    if item is None or (isinstance(item, float) and not math.isfinite(item)):
        return schema
    return schema | {"default": item}


# Parts of a file ----------------------------------------------------------------------------------


def _of_value(name: str, kind: type[Value], of: _Types) -> dict[str, Any]:
    """Return the definition of a value: its "type" and its fields."""
    if name in _OPAQUE:
        return {"description": _summary(kind), "type": "object"}
    hints = typing.get_type_hints(kind)
    known = declared(kind)
    numbers: dict[str, Parameter] = {}
    if issubclass(kind, Material):
        numbers = {p.name: p for p in kind.table.parameters}
    properties: dict[str, Any] = {"type": {"const": name}}
    required = ["type"]
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        schema = dict(of.of(hints[field.name]))
        if field.name in numbers:
            schema |= _ranged(numbers[field.name])
        elif field.name in known:
            schema |= _said(known[field.name])
        if field.default is not dataclasses.MISSING:
            schema = _defaulted(schema, field.default)
        elif field.default_factory is dataclasses.MISSING:
            required.append(field.name)
        properties[field.name] = schema
    return _object(properties, required, _summary(kind))


def _said(says: Given) -> dict[str, Any]:
    """Return meaning, unit and range of a declared field; bounds are those of a number."""
    found: dict[str, Any] = {"description": says.description()}
    if says.shape:
        return found
    bounds = {
        "minimum": says.low, "exclusiveMinimum": says.above,
        "maximum": says.high, "exclusiveMaximum": says.below,
    }  # fmt: skip
    return found | {key: bound for key, bound in bounds.items() if bound is not None}


def _ranged(parameter: Parameter) -> dict[str, Any]:
    """Return range, unit and meaning of a material's parameter."""
    found: dict[str, Any] = {"description": f"{parameter.meaning} [{parameter.unit}]"}
    if parameter.lower > -math.inf:
        found["exclusiveMinimum" if parameter.lower_open else "minimum"] = parameter.lower
    if parameter.upper < math.inf:
        found["exclusiveMaximum" if parameter.upper_open else "maximum"] = parameter.upper
    return found


def _of_call(call: Any, of: _Types, only: Mapping[str, Given] | None = None) -> dict[str, Any]:
    """Return the arguments of a method as an object, with what is declared of them."""
    hints = typing.get_type_hints(call)
    known: Mapping[str, Given] = call._declared if only is None else only
    properties: dict[str, Any] = {}
    required: list[str] = []
    for name, parameter in list(inspect.signature(call).parameters.items())[1:]:
        if only is not None and name not in only:
            continue
        schema = dict(of.of(hints[name]))
        if name in known:
            schema |= _said(known[name])
        if parameter.default is inspect.Parameter.empty:
            required.append(name)
        else:
            schema = _defaulted(schema, parameter.default)
        properties[name] = schema
    return _object(properties, required)


def _run(of: _Types) -> dict[str, Any]:
    """Return the "run" key."""
    from libmpm._src.scene.run_file import RunSettings

    hints = typing.get_type_hints(RunSettings)
    properties = {}
    for field in dataclasses.fields(RunSettings):
        properties[field.name] = of.of(hints[field.name]) | _said(declared(RunSettings)[field.name])
    return _object(properties, [], "how `libmpm run` treats the scene")


def scene_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of what `Scene.save` and `libmpm run` use.

    It knows names, types, choices and ranges of materials; what concerns several values, such as
    corners in order or names that exist, `libmpm check` finds.
    """
    of = _Types()
    head = _of_call(Scene.__init__, of, HEAD)
    adders = [name.removeprefix("add_") for name in vars(SceneData) if name.startswith("add_")]
    parts = {_plural(name): _of_call(getattr(Scene, f"add_{name}"), of) for name in adders}
    properties: dict[str, Any] = {
        "$schema": {"type": "string"},
        "libmpm": {"const": SCHEMA, "description": "version of the scene files"},
        **head["properties"],
        **{kind: {"type": "array", "items": {"$ref": f"#/$defs/{kind}"}} for kind in parts},
        "run": _run(of),
    }
    regular = ["cell_size", "lower", "upper"]
    null = {"properties": {"grid": {"type": "null"}}}
    return {
        "$schema": DRAFT,
        "title": "Scene of libmpm",
        **_object(properties, ["libmpm"]),
        "anyOf": [{"required": regular, **null}, {"required": ["grid"]}],
        "$defs": parts | dict(sorted(of.definitions.items())),
    }


def _plural(name: str) -> str:
    """Return the key of a scene file that lists such parts."""
    return f"{name[:-1]}ies" if name.endswith("y") else f"{name}s"


def schema_text() -> str:
    """Return the schema as the text of a file."""
    return json.dumps(scene_schema(), indent=1, ensure_ascii=False) + "\n"
