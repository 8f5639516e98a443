"""Values: frozen, keyword-only, comparable, picklable descriptions that round-trip through JSON.

`value` turns an annotated class into one. Its `_check` method receives a `Checker` that converts
each field and collects every broken rule, so one `SceneError` reports all of them.
"""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import numbers
import operator
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, dataclass_transform, overload

from libmpm._src.base.arguments import hint, wrong_arguments
from libmpm._src.base.arguments import keywords_only as keywords_only
from libmpm._src.base.arguments import nearest as nearest
from libmpm._src.base.arguments import shown as shown
from libmpm._src.base.arrays import are_shared
from libmpm._src.base.declarations import declared, filled, given
from libmpm._src.errors import ArgumentError, Error, ModelWarning, SceneError

T = TypeVar("T")

#: Tags of `to_dict` and the classes they stand for.
registry: dict[str, type[Value]] = {}

#: Tags of values that `import libmpm` leaves alone, and the modules that define them.
_LATE = {
    "Rigid": "libmpm._src.materials.rigid",
    **dict.fromkeys(("DebrisField", "Placement"), "libmpm._src.studies.debris.field"),
    **dict.fromkeys(("SpreadAngles", "UniformAngles"), "libmpm._src.studies.debris.laws"),
    **dict.fromkeys(("Piece", "Prototype"), "libmpm._src.studies.debris.prototype"),
    "DebrisFlowFlume": "libmpm._src.flumes.debris_flow_flume",
    "DirectionalWaveBasin": "libmpm._src.flumes.directional_wave_basin",
    "LargeWaveFlume": "libmpm._src.flumes.large_wave_flume",
    "WASIRF": "libmpm._src.flumes.wasirf",
    "WasedaBasin": "libmpm._src.flumes.waseda_basin",
    "Froude": "libmpm._src.studies.design.similitude",
}

#: Below it are all numbers of a description, and what is above 0 is no less than its inverse:
#: squares, cubes and quotients of them are numbers then. Nothing that is measured comes near.
MOST = 1e100

#: Bytes of a name; file systems take 255, with ending and number.
_LONGEST = 200


class Checker:
    """Converts the fields of one object and collects what is wrong with them."""

    def __init__(self, label: str) -> None:
        """`label` names the object in every message."""
        self.label = label
        self.problems: list[str] = []

    def fail(self, message: str) -> None:
        """Record a problem of this object."""
        self.problems.append(f"{self.label}: {message}")

    def finish(self) -> None:
        """Raise `SceneError` if anything was wrong."""
        if self.problems:
            raise SceneError(self.problems)

    def number(
        self,
        name: str,
        value: Any,
        *,
        lower: float = -math.inf,
        upper: float = math.inf,
        lower_open: bool = False,
        upper_open: bool = False,
        unit: str = "",
        remedy: str = "",
        infinite: bool = False,
    ) -> float:
        """Return `value` as float, within its range."""
        tail = f" {unit}" if unit and unit != "1" else ""
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            self.fail(f"{name} is {shown(value)}; expected a number{' in' + tail if tail else ''}")
            return math.nan
        try:
            number = float(value)
        except OverflowError:
            self.fail(f"{name} is {shown(value, 40)}; expected a number below {MOST:g}{tail}")
            return math.nan
        rules = []
        if lower > -math.inf:
            rules.append(f"{'>' if lower_open else '≥'} {lower:g}")
        if upper < math.inf:
            rules.append(f"{'<' if upper_open else '≤'} {upper:g}")
        below = number <= lower if lower_open else number < lower
        above = number >= upper if upper_open else number > upper
        # The infinite default bounds are no rule; only a stated bound may refuse a value here.
        out = (lower > -math.inf and below) or (upper < math.inf and above)
        endless = math.isinf(number) and infinite
        tiny = lower == 0 and lower_open and 0 < number < 1 / MOST
        if math.isnan(number) or out or tiny or not (abs(number) < MOST or endless):
            rule = f"{' and '.join(rules)}{tail}"
            if tiny:
                rule = f"≥ {1 / MOST:g}{tail}"
            elif MOST <= abs(number) < math.inf and not out:
                rule = f"a number below {MOST:g}{tail}"
            elif not rules or (math.isinf(number) and not out):
                rule = f"a {'' if infinite else 'finite '}number{' in' + tail if tail else ''}"
            self.fail(f"{name} is {number:g}; expected {rule}" + (f"; {remedy}" if remedy else ""))
            return math.nan
        return number

    def integer(self, name: str, value: Any, *, lower: int = 0, remedy: str = "") -> int:
        """Return `value` as int, not below `lower`, and of no more than 64 bits with its sign."""
        try:
            number = operator.index(value)
        except TypeError:
            number = None
        if number is None or isinstance(value, bool) or number < lower:
            tail = f"; {remedy}" if remedy else ""
            self.fail(f"{name} is {shown(value, 40)}; expected a whole number ≥ {lower}{tail}")
            return lower
        if number >= 1 << 63:
            self.fail(f"{name} is {shown(value, 40)}; expected a whole number < 2^63")
            return lower
        return number

    def vector(
        self, name: str, value: Any, *, lengths: Sequence[int] = (2, 3), unit: str = ""
    ) -> tuple[float, ...]:
        """Return `value` as a tuple of finite floats, of one of the lengths."""
        wanted = f"expected {' or '.join(map(str, lengths))} numbers{' in ' + unit if unit else ''}"
        items = sequence(value)
        if items is None or len(items) not in lengths:
            self.fail(f"{name} is {shown(value)}; {wanted}")
            return ()
        before = len(self.problems)
        result = tuple(self.number(f"{name}[{i}]", x, unit=unit) for i, x in enumerate(items))
        return result if len(self.problems) == before else ()

    def called(self, name: str, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a user's function gives; what it raises is a `SceneError` with its name."""
        try:
            return function(*arguments)
        except Error:
            raise
        except Exception as error:
            self.fail(
                f"{name}({', '.join(shown(x, 40) for x in arguments)}) gives "
                f"{type(error).__name__}: {error}; expected numbers; correct the function"
            )
            raise SceneError(self.problems) from error

    def items(self, name: str, given: Any, what: str) -> list[Any]:
        """Return what can be walked through as a list; reports what cannot, and returns none."""
        try:
            return list(given)
        except TypeError:  # an array without a length says so only when it is walked
            self.fail(f"{name} is {shown(given, 80)}; expected {what}")
            return []

    def given(self, name: str, owner: Any, item: Any = ..., *, remedy: str = "") -> Any:
        """Return a field of a value as its declaration says: a vector, whole or other number.

        `item` stands for the field's content where that has been turned into another.
        """
        says = declared(type(owner))[name]
        item = getattr(owner, name) if item is ... else item
        unit, remedy = "" if says.unit in ("-", "1") else says.unit, remedy or says.remedy
        if says.lengths:
            return self.vector(name, item, lengths=says.lengths, unit=unit)
        lower = says.low if says.above is None else says.above
        upper = says.high if says.below is None else says.below
        if says.whole:
            return self.integer(name, item, lower=int(lower or 0), remedy=remedy)
        return self.number(
            name,
            item,
            lower=-math.inf if lower is None else lower,
            upper=math.inf if upper is None else upper,
            lower_open=says.above is not None,
            upper_open=says.below is not None,
            unit=unit,
            remedy=remedy,
        )

    def choice(self, name: str, value: Any, choices: Sequence[str]) -> str:
        """Return `value` if it is one of the names."""
        if not isinstance(value, str) or value not in choices:
            self.fail(f"{name} is {shown(value)}; {nearest(value, choices)}")
            return choices[0]
        return value

    def text(self, name: str, value: Any, *, empty: bool = False) -> str:
        """Return `value` if it is a string that can serve as a name."""
        if not isinstance(value, str) or (not value.strip() and not empty) or "/" in value:
            self.fail(f"{name} is {shown(value)}; expected a non-empty text without '/'")
            return ""
        if any(not (c.isprintable() or c == " ") for c in value):
            self.fail(
                f"{name} is {shown(value)}; expected characters that can be printed, since names "
                "become parts of file names"
            )
            return ""
        if len(value.encode()) > _LONGEST:
            self.fail(
                f"{name} is {shown(value, 40)}, {len(value.encode())} bytes long; expected at most "
                f"{_LONGEST}, since names become parts of file names"
            )
            return ""
        return value

    def instance(self, name: str, value: Any, kinds: tuple[type, ...], example: str) -> Any:
        """Return `value` if it is an instance of one of the classes."""
        if not isinstance(value, kinds):
            self.fail(f"{name} is {shown(value)}; expected {example}")
        return value


def sequence(value: Any) -> list[Any] | None:
    """Return list, tuple or array as a list of Python objects; None for anything else."""
    if hasattr(value, "__dlpack__") and not hasattr(value, "tolist"):
        from libmpm._src.base.arrays import host_array

        value = host_array(value, "a sequence")
    if hasattr(value, "tolist"):
        value = value.tolist()
    return list(value) if isinstance(value, list | tuple) else None


class Value:
    """Base of all descriptions; see the module text."""

    #: Name in messages, for instance ``shapes.Box``.
    label: ClassVar[str] = ""
    #: Whether it is large arrays that cannot change (`arrays_shared`).
    holds_arrays: ClassVar[bool] = False
    #: Names of the fields, which are what is compared.
    _fields: ClassVar[tuple[str, ...]] = ()

    def _label(self) -> str:
        """Return the name of this object in messages."""
        return self.label or type(self).__name__

    def _check(self, check: Checker) -> dict[str, Any]:
        """Return the converted fields; report what is wrong to `check`."""
        return {}

    def __post_init__(self) -> None:
        """Convert and validate the fields."""
        check = Checker(self._label())
        converted = self._check(check)
        check.finish()
        for name, item in converted.items():
            object.__setattr__(self, name, item)

    def __eq__(self, other: object) -> bool:
        """Return whether both are of one class and hold the same."""
        if type(other) is not type(self):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        """Return the hash of the content."""
        return hash(self._content())

    def _content(self) -> tuple[Any, ...]:
        """Return what the fields hold."""
        return tuple([getattr(self, name) for name in self._fields])

    if not TYPE_CHECKING:  # a checker takes a `__setattr__` to allow names that are no fields

        def __setattr__(self, name: str, item: Any) -> None:
            """Refuse to change the value; a subclass that is none may have more attributes."""
            if name in self._fields or "_fields" in type(self).__dict__:
                raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
            object.__setattr__(self, name, item)

        def __delattr__(self, name: str) -> None:
            """Refuse to change the value."""
            if name in self._fields or "_fields" in type(self).__dict__:
                raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
            object.__delattr__(self, name)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists, numbers, texts and dictionaries; "type" names the class."""
        found = {name: plain(getattr(self, name)) for name in self._fields}
        return {"type": type(self).__name__} | found

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Any:
        """Build the value that `to_dict` described; raises `SceneError`."""
        result = from_plain(data)
        if not isinstance(result, cls):
            raise SceneError(
                f"{cls.label or cls.__name__}: the data describe {type(result).__name__}; "
                f'expected "type": "{cls.__name__}"'
            )
        return result

    def __repr__(self) -> str:
        """Return the call that makes this value."""
        inside = ", ".join(f"{name}={_text(getattr(self, name))}" for name in self._fields)
        return f"{self.label or type(self).__name__}({inside})"


def _text(item: Any) -> str:
    """Return what is read as the same item again; 2.2e+09 and not 2200000000.0."""
    if isinstance(item, float) and 1e6 <= abs(item) < math.inf:
        for digits in range(1, 6):
            if float(text := f"{item:.{digits}g}") == item:
                return text
    return repr(item)


def _constructor(
    label: str, fields: Sequence[dataclasses.Field[Any]], positional: int
) -> Callable[..., None]:
    """Return the `__init__` of a value: it checks the names, sets the fields and looks at them."""
    names = [f.name for f in fields]
    missing = dataclasses.MISSING
    defaults = {f.name: f.default for f in fields if f.default is not missing}
    required = [name for name in names if name not in defaults]

    def __init__(self: Any, /, *args: Any, **kwargs: Any) -> None:
        problems = wrong_arguments(label, names, required, len(args), positional, kwargs)
        if problems:
            raise ArgumentError(problems)
        found = defaults | dict(zip(names, args, strict=False)) | kwargs
        for name in names:
            object.__setattr__(self, name, found[name])
        self.__post_init__()

    Parameter = inspect.Parameter
    kind = Parameter.POSITIONAL_OR_KEYWORD if positional else Parameter.KEYWORD_ONLY
    hints = {f.name: hint(f.type) for f in fields}
    shown_as = [Parameter("self", Parameter.POSITIONAL_OR_KEYWORD)]
    for name in names:
        default = defaults.get(name, Parameter.empty)
        shown_as.append(Parameter(name, kind, default=default, annotation=hints[name]))
    __init__.__annotations__ = {**hints, "return": hint("None")}
    __init__.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        shown_as, return_annotation=hint("None")
    )
    return __init__


@overload
def value(cls: type[T], /) -> type[T]: ...
@overload
def value(*, kw_only: bool = True) -> Callable[[type[T]], type[T]]: ...
@dataclass_transform(
    kw_only_default=True, frozen_default=True, eq_default=True, field_specifiers=(given,)
)
def value(cls: type[T] | None = None, /, *, kw_only: bool = True) -> Any:
    """Make a frozen, keyword-only dataclass that reports wrong keywords like other problems."""

    def make(cls: type[T]) -> type[T]:
        # What `Value` and `_constructor` do for all, the library would compile for each: half of
        # the time of the package's import.
        made = dataclasses.dataclass(init=False, eq=False, repr=False, kw_only=kw_only)(cls)
        fields = dataclasses.fields(made)  # type: ignore[arg-type]
        label = getattr(made, "label", "") or made.__name__
        made._fields = tuple([f.name for f in fields])  # type: ignore[attr-defined]
        type.__setattr__(
            made, "__init__", _constructor(label, fields, 0 if kw_only else len(fields))
        )
        made.__doc__ = filled(made.__doc__, declared(made))
        registry[made.__name__] = made  # type: ignore[assignment]
        return made

    return make if cls is None else make(cls)


def plain(item: Any) -> Any:
    """Return `item` in terms of JSON; infinity becomes null, the mark of an open end."""
    if isinstance(item, Value):
        return item if item.holds_arrays and are_shared() else item.to_dict()
    if isinstance(item, Mapping):
        return {str(k): plain(v) for k, v in item.items()}
    if isinstance(item, tuple | list):
        return [plain(v) for v in item]
    if isinstance(item, float) and math.isinf(item):
        return None
    return item


#: Bits of the largest whole number that a floating-point number can come near.
_LARGEST = 1023

#: Lists and objects inside each other that a description may have; solids are made of solids.
_DEEPEST = 200


def from_plain(item: Any) -> Any:
    """Undo `plain`; dictionaries with a "type" become values, and all problems are collected."""
    problems: list[str] = []
    if deeper_than(item, _DEEPEST):
        raise SceneError(
            f"lists and objects are nested more than {_DEEPEST} deep; expected fewer; a Union has "
            "any number of parts side by side"
        )
    result = _from_plain(item, problems)
    if problems:
        raise SceneError(problems)
    return result


def deeper_than(item: Any, limit: int) -> bool:
    """Return whether lists and dictionaries are nested more than so deep, without recursion."""
    level = [item]
    for _ in range(limit):
        inner: list[Any] = []
        for one in level:
            if isinstance(one, Mapping):
                inner += one.values()
            elif isinstance(one, list | tuple):
                inner += [x for x in one if isinstance(x, Mapping | list | tuple)]
        level = inner
        if not level:
            return False
    return True


def _from_plain(item: Any, problems: list[str], name: str = "") -> Any:
    """Undo `plain`; `name` is the key under which the item stands."""
    if isinstance(item, Mapping):
        strange = [k for k in item if not isinstance(k, str)]
        if strange:
            where = f"{name}: " if name else ""
            problems.append(f"{where}the key {shown(strange[0])} is no text; expected names")
            return None
        parts = {k: _from_plain(v, problems, k) for k, v in item.items() if k != "type"}
        if "type" not in item:
            return parts
        tag = item["type"]
        if isinstance(tag, str) and tag in _LATE:
            importlib.import_module(_LATE[tag])
        if not isinstance(tag, str) or tag not in registry:
            where = f"{name}: " if name else ""
            problems.append(f'{where}"type" is {shown(tag)}; {nearest(tag, {**registry, **_LATE})}')
            return None
        try:
            return registry[tag](**parts)
        except SceneError as error:
            problems.extend(error.problems)
            return None
    if isinstance(item, list | tuple):
        return [_from_plain(v, problems, name) for v in item]
    if isinstance(item, int) and item.bit_length() > _LARGEST:
        problems.append(
            f"{name or 'a value'} is a whole number of {item.bit_length()} bits; expected one "
            "below 1.8e308"
        )
        return None
    return item


#: The folder of the package.
_PACKAGE = f"{Path(__file__).parents[2]}{os.sep}"

_quiet: ContextVar[bool] = ContextVar("libmpm_quiet", default=False)


@contextmanager
def warned_already() -> Iterator[None]:
    """Let `warn` skip a scene's warnings, which its user has had already.

    Filters of `warnings` belong to the process; several simulations may be made at a time.
    """
    token = _quiet.set(True)
    try:
        yield
    finally:
        _quiet.reset(token)


def warn(messages: Iterable[str]) -> None:
    """Issue each message as a `ModelWarning`, at the line that called the package."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    for message in () if _quiet.get() else messages:
        warnings.warn(message, ModelWarning, stacklevel=level)
