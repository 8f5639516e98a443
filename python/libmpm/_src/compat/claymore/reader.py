"""Reading JSON objects whose keys come in many spellings; problems are kept for one report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from libmpm._src.base.values import nearest, shown
from libmpm._src.compat.claymore.aliases import ALIASES, DROPPED, Names, fold
from libmpm._src.errors import SceneError

__all__ = ["Context", "Record", "pick"]

_MISSING = object()

#: Copies of a shape in an array, each of which becomes a body.
_MOST_COPIES = 100_000

#: What every number of a file is below: products of lengths are numbers then.
_LARGEST = 1e30


@dataclass
class Context:
    """What is said about a file while it is read.

    `problems` make it unusable; `notes` say what became of something that is not taken over as it
    stands; `ignored` are keys that have no effect.
    """

    name: str
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    ignored: list[str] = field(default_factory=list)

    def fail(self, path: str, message: str) -> None:
        """Report a problem of the object at a JSON path."""
        self.problems.append(f"{self.name}: {path} {message}")

    def note(self, message: str) -> None:
        """Keep a note, once."""
        if message not in self.notes:
            self.notes.append(message)

    def finish(self) -> None:
        """Raise `SceneError` if anything was wrong."""
        if self.problems:
            raise SceneError(self.problems)


class Record:
    """A JSON object; what is taken from it is checked, what is left over is listed by `close`.

    `part` names its rows in the table of keys that are known and dropped.
    """

    def __init__(self, context: Context, data: Any, path: str, part: str) -> None:
        """Take the object; anything else is a problem and reads as empty."""
        self.context, self.path, self.part = context, path, part
        if not isinstance(data, Mapping):
            context.fail(path, f"is {shown(data, 60)}; expected an object")
            data = {}
        self._data: dict[str, Any] = dict(data)
        self._taken: set[str] = set()

    def __contains__(self, name: str) -> bool:
        """Return whether the key is there in any spelling."""
        return bool(self._spellings(name))

    def _spellings(self, name: str) -> list[str]:
        wanted = {fold(name), *(fold(other) for other in ALIASES.get(name, ()))}
        return [key for key in self._data if fold(key) in wanted]

    def where(self, name: str) -> str:
        """Return the JSON path of a key, in the file's own spelling."""
        found = self._spellings(name)
        key = found[0] if found else name
        return f"{self.path}.{key}" if self.path else key

    def raw(self, name: str, default: Any = None) -> Any:
        """Return a key's value as it stands; different values by two spellings are a problem."""
        found = self._spellings(name)
        self._taken.update(found)
        values = [self._data[key] for key in found]
        if any(other != values[0] for other in values[1:]):
            both = " and ".join(f"{k} = {shown(v, 40)}" for k, v in zip(found, values, strict=True))
            self.context.fail(self.path, f"has {both}, which mean the same; keep one of them")
        return values[0] if values else default

    def number(
        self,
        name: str,
        default: Any,
        *,
        unit: str = "",
        lower: float = -math.inf,
        upper: float = math.inf,
        above: bool = False,
    ) -> Any:
        """Return a number within its range; `above` leaves the lower end out."""
        given = self.raw(name, _MISSING)
        if given is _MISSING or given is None:
            return default
        rules = [f"{'>' if above else '≥'} {lower:g}"] if lower > -math.inf else []
        rules += [f"≤ {upper:g}" if upper < math.inf else f"below {_LARGEST:g}"]
        rule = " and ".join(rules) + (f" {unit}" if unit not in ("", "1") else "")
        if isinstance(given, bool) or not isinstance(given, int | float):
            self.context.fail(self.where(name), f"is {shown(given, 40)}; expected {rule}")
            return default
        try:
            value = float(given)
        except OverflowError:
            value = math.inf
        out = not abs(value) < _LARGEST or value > upper
        if out or (value <= lower if above else value < lower):
            self.context.fail(self.where(name), f"is {shown(given, 40)}; expected {rule}")
            return default
        return value

    def integer(self, name: str, default: int, *, lower: int = 0) -> int:
        """Return a whole number, written with or without decimals."""
        value = self.number(name, float(default), lower=lower)
        if value != int(value):
            self.context.fail(self.where(name), f"is {value:g}; expected a whole number")
        return int(value)

    def boolean(self, name: str, default: Any) -> Any:
        """Return true or false."""
        given = self.raw(name, _MISSING)
        if given is _MISSING or given is None:
            return default
        if not isinstance(given, bool) and given not in (0, 1):
            self.context.fail(self.where(name), f"is {shown(given, 40)}; expected true or false")
            return default
        return bool(given)

    def text(self, name: str, default: Any) -> Any:
        """Return a text."""
        given = self.raw(name, _MISSING)
        if given is _MISSING or given is None:
            return default
        if not isinstance(given, str):
            self.context.fail(self.where(name), f"is {shown(given, 40)}; expected a text")
            return default
        return given

    def choice(
        self, name: str, default: str, table: Names, refused: Mapping[str, str] | None = None
    ) -> Any:
        """Return what a table has for a text; one of `refused` is a problem with its remedy."""
        given = self.text(name, default)
        key = fold(given)
        if refused and key in refused:
            self.context.fail(self.where(name), f"is '{given}', which is refused: {refused[key]}")
        elif key not in table:
            self.context.fail(self.where(name), f"is '{given}'; {nearest(given, table.spellings)}")
        return table.get(key)

    def vector(
        self, name: str, default: Any, *, unit: str = "m", lengths: Sequence[int] = (3,)
    ) -> Any:
        """Return a tuple of numbers."""
        given = self.raw(name, _MISSING)
        if given is _MISSING or given is None:
            return default
        numbers = _numbers(given)
        if numbers is None or len(numbers) not in lengths:
            count = " or ".join(map(str, lengths))
            self.context.fail(
                self.where(name),
                f"is {shown(given, 60)}; expected {count} numbers below {_LARGEST:g}, {unit}",
            )
            return default
        return numbers

    def counts(self, name: str) -> tuple[int, int, int]:
        """Return three whole numbers ≥ 1; where there are none, ones."""
        found = self.vector(name, (1.0, 1.0, 1.0), unit="1")
        if any(x < 1 or x != int(x) for x in found):
            self.context.fail(self.where(name), f"is {list(found)}; expected whole numbers ≥ 1")
            return (1, 1, 1)
        if math.prod(found) > _MOST_COPIES:
            self.context.fail(
                self.where(name), f"is {list(found)}; expected at most {_MOST_COPIES} copies in all"
            )
            return (1, 1, 1)
        a, b, c = (int(x) for x in found)
        return (a, b, c)

    def names(self, name: str, default: tuple[str, ...] = ()) -> tuple[str, ...]:
        """Return a list of texts."""
        given = self.raw(name, list(default))
        given = [given] if isinstance(given, str) else given
        if not isinstance(given, list) or not all(isinstance(x, str) for x in given):
            self.context.fail(self.where(name), f"is {shown(given, 60)}; expected a list of names")
            return ()
        return tuple(given)

    def pairs(self, name: str) -> tuple[tuple[float, float], ...]:
        """Return a list of pairs of numbers, m."""
        given = self.raw(name, [])
        rows = [_numbers(row) for row in given] if isinstance(given, list) else [None]
        if any(row is None or len(row) != 2 for row in rows):
            self.context.fail(
                self.where(name),
                f"is {shown(given, 60)}; expected pairs [x, y] of numbers below {_LARGEST:g}, m",
            )
            return ()
        return tuple((row[0], row[1]) for row in rows if row is not None)

    def child(self, name: str, part: str) -> Record | None:
        """Return an object inside this one, or None."""
        if name not in self:
            return None
        return Record(self.context, self.raw(name), self.where(name), part)

    def children(self, name: str, part: str) -> list[Record]:
        """Return the objects of a list; a single object counts as a list of one."""
        given = self.raw(name, [])
        if isinstance(given, Mapping):
            given = [given]
        if not isinstance(given, list):
            self.context.fail(self.where(name), f"is {shown(given, 60)}; expected a list")
            return []
        where = self.where(name)
        return [Record(self.context, x, f"{where}[{i}]", part) for i, x in enumerate(given)]

    def drop(self, name: str, reason: str) -> None:
        """List a key as without effect, if it is there."""
        for key in self._spellings(name):
            if key not in self._taken:
                self._taken.add(key)
                self.context.ignored.append(f"{self._at(key)}: {reason}")

    def close(self, unknown: str = "not known") -> None:
        """List every key that nothing has taken."""
        known = {fold(key): reason for key, reason in DROPPED.get(self.part, {}).items()}
        for key in self._data:
            if key not in self._taken:
                self.context.ignored.append(f"{self._at(key)}: {known.get(fold(key), unknown)}")

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key


def pick(records: Sequence[Record | None], kind: str, name: str, default: Any, **rules: Any) -> Any:
    """Return a key of the first record that has it, taking it from the others too.

    ClaymoreUW moved some keys from one object to another; files often have both.
    """
    having = [record for record in records if record is not None and name in record]
    if not having:
        return default
    found = [getattr(record, kind)(name, default, **rules) for record in having]
    for record, value in zip(having[1:], found[1:], strict=True):
        if value != found[0]:
            first = having[0]
            first.context.note(
                f"{record.where(name)} is {shown(value)}, {first.where(name)} is {found[0]!r}; "
                "the latter is taken"
            )
    return found[0]


def _numbers(given: Any) -> tuple[float, ...] | None:
    """Return a list of numbers below the largest as a tuple; None for anything else."""
    if not isinstance(given, list):
        return None
    fine = all(isinstance(x, int | float) and not isinstance(x, bool) for x in given)
    # The bound instead of isfinite, which fails for whole numbers of any length.
    if not fine or not all(abs(x) < _LARGEST for x in given):
        return None
    return tuple(float(x) for x in given)
