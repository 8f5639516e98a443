"""What a field of a value is, said once by `given`: meaning, unit, shape, range, source.

Docstring, check, scaling (`libmpm._src.scene.scaling`), JSON schema and the page of units follow
from it. A field of a value without a declaration fails a test.
"""

from __future__ import annotations

import builtins
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from libmpm._src.base.tables import text_table

F = TypeVar("F", bound=Callable[..., Any])

__all__ = [
    "FIXED",
    "OWNER",
    "TEXT",
    "Given",
    "about",
    "declared",
    "documents",
    "filled",
    "given",
    "table_of",
]

#: Unit of what is no quantity: names, choices, flags, whole numbers, and values with fields of
#: their own.
TEXT = "-"
#: Unit of a table or formula, which its owner gives.
OWNER = "owner"
#: Unit of what lies in a file and cannot be scaled: a scene that has it is refused.
FIXED = "fixed"

#: Where a docstring has its table.
MARK = "{fields}"
_KEY = "libmpm"
#: Columns of text in a docstring.
_WIDTH = 96


@dataclasses.dataclass(frozen=True)
class Given:
    """The declaration of one field.

    `unit` is that of its numbers. `shape` is that of an array: "(2|3,)" has 2 or 3 numbers. Of
    numbers `low` ≤ x or `above` < x, x ≤ `high` or x < `below`; what else may stand there is said
    in words, `range`. `remedy` ends the message about a number out of range. `scales` is the unit
    by which `Scene.scaled` treats it where that is another one. `source` is where an equation or a
    default comes from.
    """

    meaning: str
    unit: str = TEXT
    shape: str = ""
    range: str = ""
    low: float | None = None
    above: float | None = None
    high: float | None = None
    below: float | None = None
    remedy: str = ""
    scales: str = ""
    source: str = ""
    whole: bool = False

    @property
    def lengths(self) -> tuple[int, ...]:
        """Numbers of a vector; empty where the shape does not say it."""
        inner = self.shape.removeprefix("(").removesuffix(",)")
        counts = inner.split("|")
        ok = self.shape == f"({inner},)" and all(c.isdecimal() for c in counts)
        return tuple(map(int, counts)) if ok else ()

    @property
    def allowed(self) -> str:
        """Shape, range in words, and bounds."""
        low, high = self.low, self.high
        if low is not None and high is not None:
            bounds = [f"{low:g} to {high:g}"]
        else:
            pairs = (("≥", low), (">", self.above), ("≤", high), ("<", self.below))
            bounds = [f"{sign} {bound:g}" for sign, bound in pairs if bound is not None]
        return ", ".join([t for t in (self.shape, self.range) if t] + bounds)

    @property
    def scaled_as(self) -> str:
        """The unit by which it is scaled."""
        return self.scales or self.unit

    def description(self) -> str:
        """Return meaning, unit and range in one line."""
        details = [self.unit if self.unit != TEXT else "", self.allowed]
        listed = ", ".join(d for d in details if d)
        text = f"{self.meaning} [{listed}]" if listed else self.meaning
        return f"{text} ({self.source})" if self.source else text


def given(
    meaning: str,
    *,
    default: Any = dataclasses.MISSING,
    unit: str = TEXT,
    shape: str = "",
    range: str = "",
    low: float | None = None,
    above: float | None = None,
    high: float | None = None,
    below: float | None = None,
    remedy: str = "",
    scales: str = "",
    source: str = "",
    whole: bool = False,
) -> Any:
    """Declare a field of a value; see `Given`."""
    says = Given(
        meaning, unit, shape, range, low, above, high, below, remedy, scales, source, whole
    )
    return dataclasses.field(default=default, metadata=about(says))


def about(says: Given) -> dict[str, Given]:
    """Return a declaration as the `metadata` of a field of a dataclass that is no value."""
    return {_KEY: says}


def declared(kind: type) -> dict[str, Given]:
    """Return the declarations of a value's fields, in their order; those it has."""
    fields = dataclasses.fields(kind)
    return {f.name: f.metadata[_KEY] for f in fields if _KEY in f.metadata}


def _wrapped(text: str, width: int) -> list[str]:
    """Return lines of whole words; all values are described on import, and `textwrap` is slow."""
    lines = [""]
    for word in text.split():
        if not lines[-1]:
            lines[-1] = word
        elif len(lines[-1]) + 1 + len(word) <= width:
            lines[-1] += f" {word}"
        else:
            lines.append(word)
    return lines


def table_of(fields: Mapping[str, Given]) -> str:
    """Return a table in reStructuredText for a docstring."""
    head = ("parameter", "unit", "range", "meaning")
    rows = [(n, g.unit, g.allowed, g.meaning + (f" ({g.source})" if g.source else ""))
            for n, g in fields.items()]  # fmt: skip
    allowed = max(len(head[2]), *(min(len(r[2]), 24) for r in rows))
    used = [max(len(x) for x in column) for column in zip(head, *rows, strict=True)]
    room = max(30, _WIDTH - used[0] - used[1] - allowed - 6)
    lines: list[tuple[str, str, str, str]] = [head]
    for name, unit, limits, meaning in rows:
        left = _wrapped(limits, allowed)
        right = _wrapped(meaning, room)
        for i in builtins.range(max(len(left), len(right))):
            first = (name, unit) if i == 0 else ("", "")
            lines.append((
                *first, left[i] if i < len(left) else "", right[i] if i < len(right) else "",
            ))  # fmt: skip
    return text_table(lines, flush="left", ruled=True)


def documents(kind: type | Mapping[str, Given], **also: Given) -> Callable[[F], F]:
    """Fill the docstring of a method that takes a value's fields, or of a class, from these.

    `also` are arguments that the value does not have, or that mean something else there.
    """
    known = {**(declared(kind) if isinstance(kind, type) else kind), **also}

    def decorate(item: F) -> F:
        item.__doc__ = filled(item.__doc__, known)
        item._declared = known  # type: ignore[attr-defined]
        return item

    return decorate


def filled(text: str | None, fields: Mapping[str, Given]) -> str | None:
    """Return a docstring with the table in the place of its mark."""
    if not text or not fields or MARK not in text:
        return text
    before, _, after = text.partition(MARK)
    indent = before[before.rfind("\n") + 1 :]
    return before + table_of(fields).replace("\n", f"\n{indent}") + after
