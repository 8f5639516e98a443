"""Odd arguments for every public constructor and function, and how what they answer is judged."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import json
import math
import random
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

import libmpm
from libmpm import (
    analysis,
    boundaries,
    debris,
    demand,
    design,
    grids,
    materials,
    methods,
    sensors,
    shapes,
    studies,
)
from libmpm._src.base.values import Value, registry
from support import fuzzing
from support.fuzz_scenes import SOLID, WATER

__all__ = ["Call", "calls", "judge", "odd", "some"]

_MODULES = (analysis, boundaries, debris, demand, design, grids, materials, methods, sensors)
_MODULES += (shapes, studies)
#: What runs scenes or writes files; other attacks are for these.
_LEFT_OUT = {"Study", "save_metadata", "from_study", "Case", "convergence"}
#: Class methods of files and documents, which have attacks of their own.
_NOT_MADE = ("from_dict", "from_esri", "load")
#: Tries to find arguments that a callable takes.
_TRIES = 40


@dataclasses.dataclass
class Call:
    """A public callable, and arguments that it takes if some were found."""

    name: str
    function: Callable[..., Any]
    parameters: tuple[str, ...]
    good: dict[str, Any]
    valid: bool = False


def _nothing(*_: Any, **__: Any) -> float:
    return 0.5


def likely() -> list[Any]:
    """Values that many parameters take."""
    law = materials.FixedCorotated(**SOLID)
    kind = debris.Prototype(length=0.1, width=0.05, height=0.05, material=law)
    rows = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0]
    return [
        0.5, 0.3, 1, 2, 3, 8, 1e5, 1000.0, 0, "x", "y+", "water", "all", "x-", True, None,
        (0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (2, 2), (2, 2, 2),
        (0.1, 0.9), rows, np.array(rows) ** 1.5, np.eye(3), np.linspace(0, 1, 40).reshape(10, 4),
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], [[0, 1, 2]], {"a": (0.0, 1.0)}, {"a": rows},
        shapes.Box(lower=(0, 0), upper=(1, 1)), shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1)),
        WATER, law, boundaries.Slip(), libmpm.TimeTable((0.0, 1.0), ((0.0, 0.0), (1.0, 0.0))),
        libmpm.TimeTable((0.0, 1.0), (0.0, 1.0)), _nothing, kind, [kind],
        [debris.Piece(x=0.5, y=0.5, angle=0.0)], debris.UniformAngles(),
        libmpm.Field(components=("x", "y")),
        grids.Mesh.squares(columns=2, rows=2, lower=(0, 0), upper=(1, 1)), sensors.Energy(),
    ]  # fmt: skip


def odd(rng: random.Random) -> Any:
    """A value that hardly any parameter takes."""
    if rng.random() < 0.02:
        return fuzzing.nested(rng.choice((3, 900, 5000)))
    more = [
        np.array([[1, 2], [3, 4]], dtype=object), np.array([{}, None], dtype=object),
        [[1.0], [2.0, 3.0]], [], (), [[]], np.zeros((0, 3)), np.full(4, math.nan), [math.inf] * 3,
        np.zeros((2, 2, 2, 2)), np.array(["1", "2"]), np.arange(3) + 1j, "1e999", -1, 0, True,
        False, None, 10**18, 2**31 - 1, 10**9, -(10**9), [-1.0, -2.0, -3.0], [0.0] * 1000,
        np.array([1e308, -1e308, 1e308]), [None] * 3, [[0, 1, 10**9]], (1e-320, 1e-320), {}, [{}],
        [True, False], (10**400, 1), _nothing,
    ]  # fmt: skip
    pool = rng.choice((fuzzing.WORDS, fuzzing.NUMBERS, fuzzing.NUMBERS, fuzzing.NOT_FINITE,
                       fuzzing.HUGE, fuzzing.python_values(), more, more, more))  # fmt: skip
    return rng.choice(pool)


def _harvest(item: Any, into: dict[str, list[dict[str, Any]]]) -> None:
    """Collect the fields of all values in a document, by their class."""
    if isinstance(item, Mapping):
        if isinstance(item.get("type"), str):
            fields = {k: v for k, v in item.items() if k != "type"}
            into.setdefault(item["type"], []).append(fields)
        for one in item.values():
            _harvest(one, into)
    elif isinstance(item, list):
        for one in item:
            _harvest(one, into)


def calls(documents: Mapping[str, Any]) -> list[Call]:
    """Return all public callables, most of them with arguments that they take."""
    found: dict[str, Callable[..., Any]] = {}
    for module in _MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if name in _LEFT_OUT or not callable(thing):
                continue
            found[f"{module.__name__.split('.')[-1]}.{name}"] = thing
            for key, inner in vars(thing).items() if inspect.isclass(thing) else ():
                if isinstance(inner, classmethod) and key not in _NOT_MADE and key[0] != "_":
                    found[f"{module.__name__.split('.')[-1]}.{name}.{key}"] = getattr(thing, key)
    for name in ("FBar", "Field", "Guard", "Method", "Output", "Partition", "Scene"):
        found[name] = getattr(libmpm, name)
    found |= {"TimeTable": libmpm.TimeTable, "TimeTable.sample": libmpm.TimeTable.sample}
    known: dict[str, list[dict[str, Any]]] = {}
    _harvest(list(documents.values()), known)
    return [made for name in sorted(found) if (made := _call(name, found[name], known))]


def _call(
    name: str, function: Callable[..., Any], known: Mapping[str, list[dict[str, Any]]]
) -> Call | None:
    """Return a callable with arguments that it takes, where some can be found."""
    if inspect.isclass(function) and (
        inspect.isabstract(function) or function.__name__.startswith("_")
        or issubclass(function, BaseException) or not _is_made_by_users(function)
    ):  # fmt: skip
        return None
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return None
    parameters = [
        p
        for p in signature.parameters.values()
        if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)
    ]
    if not parameters:
        return None
    names = tuple(p.name for p in parameters)
    needed = [p.name for p in parameters if p.default is p.empty]
    for fields in known.get(getattr(function, "__name__", ""), ())[:20]:
        with_values = {
            k: fuzzing.answer(functools.partial(_value, v), (Exception,)) for k, v in fields.items()
        }
        if set(with_values) <= set(names) and not _fails(function, with_values):
            return Call(name, function, names, with_values, True)
    rng, pool = random.Random(name), likely()
    good = {key: rng.choice(pool) for key in needed}
    for _ in range(_TRIES):
        error = _fails(function, good)
        if not error:
            return Call(name, function, names, good, True)
        named = [key for key in needed if key in error] or needed
        good = good | {key: rng.choice(pool) for key in named}
    return Call(name, function, names, good)


def _is_made_by_users(kind: type) -> bool:
    """Return whether a class checks its arguments; results are made by the library alone."""
    return issubclass(kind, Value) or hasattr(kind.__init__, "__wrapped__")


def _value(item: Any) -> Any:
    from libmpm._src.base.values import from_plain

    return from_plain(item)


def _fails(function: Callable[..., Any], arguments: dict[str, Any]) -> str:
    """Return what is said against arguments; empty if they are taken."""
    with fuzzing.bounded(5.0):
        try:
            function(**arguments)
        except Exception as error:
            return str(error) or "?"
        except fuzzing.Hang:
            return "?"
    return ""


def some(every: list[Call], rng: random.Random) -> tuple[Call, dict[str, Any], list[str]]:
    """Return a callable, its arguments with one or a few odd ones, and what these are."""
    call = rng.choice(every)
    arguments, said = dict(call.good), [call.name]
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        key = rng.choice(call.parameters)
        arguments[key] = odd(rng) if rng.random() < 0.9 else rng.choice(likely())
        said.append(f"{key} = {fuzzing.brief(arguments[key], 100)}")
    return call, arguments, said


def judge(call: Call, arguments: dict[str, Any]) -> str:
    """A call is refused by name, or gives something that has a text and can be stored."""
    found = fuzzing.answer(lambda: call.function(**arguments))
    if isinstance(found, libmpm.Error):
        return "refused"
    fuzzing.answer(lambda: repr(found))
    if isinstance(found, sensors.Custom) and callable(found.function):
        return "made"  # with a function of Python, which its scene refuses to store
    if isinstance(found, Value) and registry.get(type(found).__name__) is type(found):
        stored = fuzzing.answer(lambda: json.dumps(found.to_dict(), allow_nan=False))
        if isinstance(stored, libmpm.Error):
            return "made, not stored"
        again = fuzzing.answer(lambda: type(found).from_dict(json.loads(stored)))
        assert not isinstance(again, libmpm.Error), f"what it has stored is refused: {again}"
    return "made"
