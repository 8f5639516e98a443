"""Arguments of public functions: unknown, missing and unnamed ones are one error, with a guess.

`keywords_only` is for functions and methods; values have the same rules by `values.value`.
"""

from __future__ import annotations

import difflib
import functools
import inspect
import numbers
import os
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from libmpm._src.errors import ArgumentError, SceneError

__all__ = [
    "file_path", "hint", "is_number", "keywords_only", "known", "nearest", "path_option",
    "quoted", "resolved", "shown", "wrong_arguments",
]  # fmt: skip

T = TypeVar("T")
P = ParamSpec("P")


#: Lists in lists that a message still shows; none that means something has as many.
_DEEPEST = 100

#: Arguments that another class has -> what to use.
_ELSEWHERE = {
    ("shapes.Box", key): "use lower and upper, or shapes.OrientedBox(centre=, size=)"
    for key in ("center", "centre", "size")
}


def nearest(name: Any, names: Iterable[str]) -> str:
    """Return a hint naming the candidate closest to `name`, or all of them."""
    names = [str(n) for n in names]
    # The comparison takes a time that grows with the square of the lengths.
    wanted = name if isinstance(name, str) else shown(name)
    close = difflib.get_close_matches(wanted[:200], names, n=1, cutoff=0.5)
    if close:
        return f"did you mean '{close[0]}'?"
    return f"choose from {', '.join(names)}" if names else "there are none"


def shown(item: Any, most: int = 200) -> str:
    """Return the text of any object for a message: no longer than `most` characters.

    Lists in lists without end, and whole numbers of thousands of digits, have no text of their own.
    """
    try:
        # How deep `repr` goes differs between versions of Python.
        text = "" if _deeper_than(item, _DEEPEST) else repr(item)
    except (RecursionError, ValueError):
        text = ""
    if not text:
        return f"a {type(item).__name__} without a text of its own"
    return text if len(text) <= most else f"{text[:most]}…"


def _deeper_than(item: Any, levels: int) -> bool:
    """Tell whether lists, tuples and dictionaries lie deeper in each other than so many levels."""
    inside = [item]
    for _ in range(levels):
        within = [x.values() if isinstance(x, dict) else x for x in inside
                  if isinstance(x, list | tuple | dict)]  # fmt: skip
        inside = list({id(x): x for some in within for x in some}.values())
        if not inside:
            return False
    return True


def known(name: object, names: Iterable[str]) -> bool:
    """Tell whether something is one of the names; an array, a list or a number never is."""
    return isinstance(name, str) and name in names


def is_number(item: object) -> bool:
    """Tell whether something is a real number, and no truth value."""
    return isinstance(item, numbers.Real) and not isinstance(item, bool)


def quoted(name: object) -> str:
    """Return a name for a message: a text in quotes, anything else as it is shown."""
    return f"'{name}'" if isinstance(name, str) and len(name) <= 200 else shown(name, 80)


#: Bytes of a name in a folder that all systems take.
_LONGEST_NAME = 255


def file_path(path: object, what: str) -> Path:
    """Return the path of a file or folder; raises `SceneError` for what no system can have."""
    try:
        if isinstance(path, str | os.PathLike) and str(path):
            names = os.fsencode(path).split(os.sep.encode())
            if not any(b"\0" in name or len(name) > _LONGEST_NAME for name in names):
                return Path(path)
    except (TypeError, UnicodeError):  # a path of bytes; a text that no system has
        pass
    raise SceneError(f"{what}: path is {shown(path, 80)}; expected the name of a file or folder")


def path_option(text: str) -> Path:
    """Return the path that an option of the command line names."""
    try:
        return file_path(text, "option")
    except SceneError:
        from argparse import ArgumentTypeError

        raise ArgumentTypeError(
            f"{shown(text, 80)}; expected the name of a file or folder"
        ) from None


def resolved(path: object, what: str) -> Path:
    """Return the absolute path of a file or folder without links; raises `SceneError`."""
    found = file_path(path, what)
    try:
        return found.resolve()
    except (OSError, RuntimeError) as error:  # links that lead to each other
        raise SceneError(f"{what}: {found} leads nowhere: {error}") from error


class hint(str):
    """An annotation as text, which a signature shows as it is written, without quotes."""

    def __repr__(self) -> str:
        """Return the text."""
        return str(self)


def wrong_arguments(
    label: str,
    names: Sequence[str],
    required: Sequence[str],
    unnamed: int,
    positional: int,
    kwargs: Mapping[str, Any],
    instead: Mapping[str, Sequence[str]] | None = None,
) -> list[str]:
    """Return what is wrong with a call: `unnamed` arguments of at most `positional`, and `kwargs`.

    `names` are all arguments, `required` those without a default. `instead` names an argument that
    makes others unnecessary.
    """
    problems = []
    if unnamed > positional:
        problems.append(
            f"{label}: takes keyword arguments only ({unnamed - positional} positional given too "
            f"many); write them as keywords: {', '.join(names)}"
        )
    for key in kwargs:
        if key not in names:
            remedy = _ELSEWHERE.get((label, key), nearest(key, names))
            problems.append(f"{label}: unknown argument '{key}'; {remedy}")
        elif key in names[: min(unnamed, positional)]:
            problems.append(f"{label}: argument '{key}' is given twice; expected it once")
    if unnamed <= positional:
        missing = [k for k in required if k not in kwargs and k not in names[:unnamed]]
        for other, names_of in (instead or {}).items():
            if kwargs.get(other) is None:
                missing += [key for key in names_of if kwargs.get(key) is None]
        problems += [f"{label}: argument '{key}' is missing; it has no default" for key in missing]
    return problems


def keywords_only(
    label: str,
    positional: int = 0,
    instead: Mapping[str, Sequence[str]] | None = None,
    *,
    method: bool = True,
    renamed: Mapping[str, str] | None = None,
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Make a method report unnamed, unknown and missing arguments as one `ArgumentError`.

    Python's own TypeError names one of them only, and no remedy. The first `positional` arguments
    after self may come without a name. `instead` names an argument that makes others unnecessary.
    A function that is no `method` has no self. In the label of a method that several classes have,
    {} stands for the label of the class. `renamed` has arguments by their names of version 0.1,
    which warn until 0.3.
    """
    own = int(method)

    def decorate(function: Callable[P, T]) -> Callable[P, T]:
        function.__annotations__ = {k: hint(v) for k, v in function.__annotations__.items()}

        @functools.cache  # at the first call: to look at all signatures would slow the import down
        def parameters() -> tuple[list[str], list[str], set[Any]]:
            found = list(inspect.signature(function).parameters.values())[own:]
            named = [p for p in found if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)]
            required = [p.name for p in named if p.default is p.empty]
            return [p.name for p in named], required, {p.kind for p in found}

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> T:
            said = label.format(getattr(args[0], "label", "")) if method and args else label
            for old in [key for key in renamed or {} if key in kwargs]:
                new = (renamed or {})[old]
                warnings.warn(
                    f"{said}: '{old}' is '{new}' since libmpm 0.2; the old name goes in 0.3",
                    DeprecationWarning,
                    stacklevel=2,
                )
                kwargs[new] = kwargs.pop(old)
            names, required, kinds = parameters()
            known, unnamed = kwargs, len(args) - own
            if inspect.Parameter.VAR_KEYWORD in kinds:  # it checks the others itself
                known = {k: v for k, v in kwargs.items() if k in names}  # type: ignore[assignment]
            if inspect.Parameter.VAR_POSITIONAL in kinds:
                unnamed = min(unnamed, positional)
            problems = wrong_arguments(said, names, required, unnamed, positional, known, instead)
            if problems:
                raise ArgumentError(problems)
            return function(*args, **kwargs)

        return checked

    return decorate
