"""What comparisons and drawings know of a facility: its instruments, clock, bed and criteria."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from libmpm._src.flumes.criteria import Criterion

__all__ = ["Instrument", "Laboratory"]


class Instrument(NamedTuple):
    """One instrument under its laboratory name, in the facility's coordinates.

    `kind` is "level", "depth", "height", "velocity" or "load"; `x`, `y`, `z` are its place, m (z
    where it has one), `boundary` what a load cell is part of. `scale` is what a reading stands for:
    2 of a load on half a structure, the depth of 1 kg where mass is weighed, in m, the run-up of 1
    m along the scene's vertical axis.
    """

    name: str
    kind: str
    x: float
    y: float = 0.0
    z: float = 0.0
    boundary: str = ""
    scale: float = 1.0


class Laboratory(Protocol):
    """A `Facility`, as those see it that lie below it."""

    @property
    def label(self) -> str:
        """Its name in messages."""
        ...

    @property
    def title(self) -> str:
        """Its name in tables and pictures."""
        ...

    @property
    def cases(self) -> Mapping[str, Any]:
        """The set-ups that were measured, by name."""
        ...

    @property
    def cell_size(self) -> float:
        """Of the scene, m."""
        ...

    @property
    def width(self) -> str:
        """How much of the width the scene has."""
        ...

    @property
    def clock(self) -> float:
        """Measured time at the begin of a run, s."""
        ...

    @property
    def rest(self) -> float:
        """Until when the water stands still, s."""
        ...

    @property
    def still_water(self) -> float | None:
        """Its level, m; None where there is none."""
        ...

    @property
    def bed_profile(self) -> Sequence[tuple[float, float]]:
        """(x, z) of the bed, m."""
        ...

    def criteria(self) -> Sequence[Criterion]:
        """Return what runs are judged by."""
        ...

    def instruments(self) -> Sequence[Instrument]:
        """Return what was measured with."""
        ...

    def outlines(self) -> Iterable[tuple[str, Sequence[tuple[float, float]]]]:
        """Return names and corners (x, z) of what stands in the water, m."""
        ...
