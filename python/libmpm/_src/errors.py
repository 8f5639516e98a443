"""Exceptions and warnings of libmpm.

The compiled modules raise the classes of the same names, so ``except libmpm.SceneError`` catches a
rule broken in Python and one broken in the engine alike.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = [
    "ArgumentError",
    "CapacityError",
    "CheckpointError",
    "DeviceError",
    "Error",
    "ModelWarning",
    "NumericalError",
    "OutputError",
    "SceneError",
]


class Error(Exception):
    """Base of every exception that libmpm raises on purpose."""


class SceneError(Error, ValueError):
    """A description breaks one or more rules.

    `problems` lists all of them, each naming the object, the value, the rule and the remedy. The
    message is that list.
    """

    problems: list[str]

    def __init__(self, problems: str | Iterable[str] = ()) -> None:
        """Take one problem or several."""
        self.problems = [problems] if isinstance(problems, str) else [str(p) for p in problems]
        super().__init__(self.problems)

    def __str__(self) -> str:
        """Return the only problem, or a numbered list."""
        if len(self.problems) == 1:
            return self.problems[0]
        listed = "\n".join(f"  {i}. {p}" for i, p in enumerate(self.problems, 1))
        return f"{len(self.problems)} problems:\n{listed}"


class ArgumentError(SceneError, TypeError):
    """A call has unknown, missing or unnamed arguments; a `TypeError` too, as Python's own."""


class DeviceError(Error, RuntimeError):
    """The device asked for is absent, or a call to it failed."""


class CapacityError(Error, MemoryError):
    """Memory or an index range does not suffice; the message carries the plan's numbers."""


class NumericalError(Error, ArithmeticError):
    """The state became unusable: not finite, inverted, or faster than the grid can follow."""


class OutputError(Error, OSError):
    """A result cannot be written, for instance because the folder is read-only or the disk full."""


class CheckpointError(Error, ValueError):
    """A checkpoint is truncated, damaged, or of a version that this libmpm cannot read."""


class ModelWarning(UserWarning):
    """The scene can run, but the result will carry an error that its author may not expect."""
