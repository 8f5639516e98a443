"""What a guard remembers between its checks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

__all__ = ["Memory"]


@dataclass
class Memory:
    """Extremes and references of a run so far, as plain values: checkpoints keep them."""

    #: Step of the last look; -1 before the first.
    step: int = -1
    #: Energies to count from, J (2D: J/m): of the start, or of the last look before which
    #: particles left.
    first: float = 0.0
    elastic: float = 0.0
    potential: float = 0.0
    #: What has been released of each at most, J, and the largest kinetic energy.
    unloaded: float = 0.0
    fallen: float = 0.0
    kinetic: float = 0.0
    #: The smallest sum of the three, J, and its step.
    least: float = math.inf
    least_step: int = 0
    #: Highest speed of a node in all checks, m/s.
    speed: float = 0.0
    #: Mean volume ratio of each body at the start; None where it had no particles.
    volumes: list[float | None] = field(default_factory=list)
    #: Density at the nodes by that of the particles' volumes at the start.
    packing: float = 1.0
    #: By how much the middle of the water lay lower at the start than it can, m.
    sunk: float = 0.0
    #: That it lies too low now has been warned of.
    sinks: bool = False
    #: Particles that each body must have but for those that came since.
    particles: list[int] = field(default_factory=list)
    #: Particles that inlets had supplied to each body when that was counted.
    supplied: list[int] = field(default_factory=list)
    #: Particles have left since the last look, and energy with them.
    changed: bool = False
    #: Bodies that have been warned of as fast, and the speed of the fastest node, m/s, when others
    #: were last looked at for it.
    warned: list[str] = field(default_factory=list)
    seen: dict[str, float] = field(default_factory=dict)
    #: By body with smoothing over cells: energy Σ m q² that it has taken, and the most that the
    #: body has held, kg; what it had taken when it was last judged, and that time, s.
    smoothing: dict[str, list[float]] = field(default_factory=dict)
    #: Bodies that have been warned of for it.
    smooths: list[str] = field(default_factory=list)

    @classmethod
    def restored(cls, saved: Mapping[str, Any], bodies: int) -> Memory:
        """Return what a checkpoint has kept; raises `ValueError` for what no guard remembers."""
        if not isinstance(saved, Mapping):
            raise ValueError(f"watch is {saved!r:.60}; expected what a guard remembers")
        types = {f.name: str(f.type) for f in fields(cls)}
        for key, value in saved.items():
            if key not in types:
                raise ValueError(f"watch has '{key}', which no guard remembers")
            if not _IS[types[key]](value):
                raise ValueError(f"watch.{key} is {value!r:.60}; expected {types[key]}")
            by_body = key in ("volumes", "particles", "supplied")
            if by_body and len(value) not in (0, bodies):
                raise ValueError(f"watch.{key} has {len(value)} entries; expected {bodies}, or 0")
        made = cls(**saved)
        if made.step >= 0 and not len(made.volumes) == len(made.particles) == bodies:
            raise ValueError(f"watch lacks volumes or particles of {bodies} bodies after its check")
        return made


def _whole(item: Any) -> bool:
    return isinstance(item, int) and not isinstance(item, bool) and abs(item) < 1 << 62


def _real(item: Any) -> bool:
    return (isinstance(item, float) and not math.isnan(item)) or _whole(item)


def _all(item: Any, kind: type, test: Callable[[Any], bool]) -> bool:
    entries: Any = item.values() if isinstance(item, dict) else item
    return type(item) is kind and all(test(one) for one in entries)


def _row(item: Any) -> bool:
    return _all(item, list, _real) and len(item) == 4


def _text(item: Any) -> bool:
    return isinstance(item, str)


#: Type of an entry, as it is written above -> whether a plain value is one.
_IS: dict[str, Callable[[Any], bool]] = {
    "int": _whole,
    "float": _real,
    "bool": lambda v: isinstance(v, bool),
    "list[float | None]": lambda v: _all(v, list, lambda x: x is None or _real(x)),
    "list[int]": lambda v: _all(v, list, _whole),
    "list[str]": lambda v: _all(v, list, _text),
    "dict[str, float]": lambda v: _all(v, dict, _real),
    "dict[str, list[float]]": lambda v: _all(v, dict, _row),
}
