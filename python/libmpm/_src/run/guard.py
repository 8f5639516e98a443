"""`Guard`: what a run watches about itself: energy, volumes, overlaps, speeds, particles.

`guard_watch.py` does the watching, `design/guards.md` derives the bounds.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, Value, value
from libmpm._src.boundaries.responses import Prescribed

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["Guard", "as_guard", "opened_by"]


@value
class Guard(Value):
    """What a run watches about itself, and how much of it ends the run; None switches one off.

    {fields}

    A look never changes a bit of the run. Raises `SceneError`.
    """

    label: ClassVar[str] = "Guard"

    every: int | None = given(
        "steps between two checks; None = 1000", default=None, unit="1", low=1, whole=True
    )
    energy: float | None = given(
        "growth of the mechanical energy, in parts of what has been released, of scenes on "
        "which nothing from outside does work",
        default=0.2,
        unit="1",
        above=0,
    )
    volume: float | None = given(
        "change of a body's mean volume ratio beyond what pressure does",
        default=0.05,
        unit="1",
        above=0,
    )
    packing: float | None = given(
        "excess of the density at the nodes, in scenes of water alone, over that of the "
        "particles' own volumes",
        default=0.5,
        unit="1",
        above=0,
    )
    level: float | None = given(
        "part of its height above the floor by which the middle of water may lie lower than "
        "its volume can in the domain, plus a tenth of a cell; more is a `ModelWarning`, "
        "once",
        default=0.05,
        unit="1",
        above=0,
    )
    overlap: float | None = given(
        "depth, in cells, of a particle's middle in a body that friction keeps it apart from, "
        "where one of the two has lost 0.6 of its volume",
        default=0.4,
        unit="1",
        above=0,
    )
    mach: float | None = given(
        "speed within a body, in parts of its sound speed", default=1.0, unit="1", above=0
    )
    smoothing: float | None = given(
        "energy that smoothing over cells takes from a body while a wave crosses 100 cells, "
        "in parts of the most that the body held and of what has been released; more is a "
        "`ModelWarning`, once a body",
        default=0.2,
        unit="1",
        above=0,
    )
    particles: bool = given("whether particles are counted", default=True)

    def _check(self, check: Checker) -> dict[str, Any]:
        remedy = "use None to leave it unwatched"
        found: dict[str, Any] = {}
        if self.every is not None:
            found["every"] = check.given("every", self)
        for name in ("energy", "volume", "packing", "level", "overlap", "mach", "smoothing"):
            bound = getattr(self, name)
            if bound is not None:
                found[name] = check.number(name, bound, lower=0, lower_open=True, remedy=remedy)
        check.instance("particles", self.particles, (bool,), "True or False")
        return found


def as_guard(given: Any) -> Guard | None:
    """Return the guard that an argument stands for: a Guard, True for the usual one, None, False.

    Raises `SceneError`.
    """
    if given is None or given is False:
        return None
    if given is True:
        return Guard()
    check = Checker("Simulation")
    check.instance("guard", given, (Guard,), "Guard(...), True, or None for none")
    check.finish()
    assert isinstance(given, Guard)
    return given


def opened_by(scene: SceneData) -> list[str]:
    """Return what may do work on a scene from outside, in words; nothing: its energy can only fall.

    A boundary that does not move takes or turns momentum and does no work, also one that comes or
    goes.
    """
    found = []
    for boundary in scene.boundaries:
        if any(x is not None for x in (boundary.motion, boundary.rotation)):
            found.append(f"boundary '{boundary.name}' moves")
        elif any(isinstance(r, Prescribed) for r in boundary.responses):
            found.append(f"boundary '{boundary.name}' prescribes velocities")
        elif boundary.uplift:
            found.append(f"boundary '{boundary.name}' has uplift")
    found += [f"flow '{placed.name}'" for placed in scene.flows]
    if isinstance(scene.gravity, TimeTable):
        found.append("gravity changes with time")
    found += [f"body '{body.name}' has tractions" for body in scene.bodies if body.tractions]
    found += [
        f"body '{body.name}' has a pin that is driven"
        for body in scene.bodies
        if any(pin.motion for pin in body.pins)
    ]
    found += [f"body '{body.name}' has a force" for body in scene.bodies if body.force]
    return found
