"""What a guard remembers between its looks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

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
    #: Highest speed of a node in all looks, m/s.
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
