"""Water that comes in and goes out: `Inflow`, `Outflow`, and the bore behind a broken dam."""

from __future__ import annotations

import math
from typing import Any, ClassVar, NamedTuple

from libmpm._src.base.arguments import keywords_only, quoted
from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, Value, value
from libmpm._src.errors import SceneError
from libmpm._src.shapes.boxes import FACES, Solid

__all__ = ["Bore", "Flow", "Inflow", "Outflow", "PlacedFlow", "riemann_inlet"]

#: As many particles as a body may have; the engine's limit.
MOST_PARTICLES = 2**32 - 257

#: Least number of cells of a zone: the nodes that lead its first particles, and one more.
_LEAST_ZONE = 2


class Flow(Value):
    """Base of what lets particles in or out through a face of the domain."""

    face: str
    zone: int

    def _check_face(self, check: Checker) -> None:
        check.choice("face", self.face, FACES)

    def _check_zone(self, check: Checker) -> int:
        remedy = "fewer cells do not lead the particles at the face"
        return check.integer("zone", self.zone, lower=_LEAST_ZONE, remedy=remedy)


def _check_speed(check: Checker, speed: Any) -> float | TimeTable | None:
    """Return a speed in the direction of the flow: a number or a table of numbers, none < 0."""
    remedy = "the other direction is that of an Outflow, or of an Inflow"
    if not isinstance(speed, TimeTable):
        return check.number("velocity", speed, lower=0, unit="m/s", remedy=remedy)
    if speed.components:
        check.fail(
            f"velocity has rows of {speed.components} numbers; expected plain numbers, the speed "
            "normal to the face in m/s"
        )
    elif min(speed.value) < 0:
        check.fail(f"velocity falls to {min(speed.value)} m/s; expected ≥ 0 m/s; {remedy}")
    return speed


@value
class Inflow(Flow):
    """Particles that come in through a face of the domain, at a stated rate and level.

    A zone of whole cells inside the face moves with the prescribed velocity, normal to the face
    and the same at all heights. Whenever the water in it has moved on by the distance s between two
    layers, a layer of new particles appears at the face: up to the level, across the whole
    domain, without what lies in `bed`. s makes the supplied mass ρ u A for the wetted area A of the
    layer. New particles join `body`, which fills the zone at the start, with its material, their
    ids following its own; they start with ρ g depth below the level.

    {fields}

    Waves that come back from the domain meet the zone as they would a moving wall. Raises
    `SceneError`. Source: Yang (2016), laminar inflow, eq. 4.19.
    """

    label: ClassVar[str] = "boundaries.Inflow"

    body: str = given("body that the particles join", range="a name")
    face: str = given('"x-" ... "z+"; no wall may stand there', range="a face")
    velocity: float | TimeTable = given(
        "into the domain: a number or a `TimeTable` of numbers", unit="m/s", low=0
    )
    level: float | None = given(
        "surface of the water that comes in, along the vertical axis; None = all of the face",
        default=None,
        unit="m",
        range="level",
        remedy="give the surface level",
    )
    bed: Solid | None = given(
        "what the layers stay out of; None = nothing", default=None, range="a Solid"
    )
    zone: int = given("thickness of the zone that is led", default=3, unit="cells", low=2)
    max_particles: int | None = given(
        "of the body in all; None = 2³² - 257, as many as it can have",
        default=None,
        unit="1",
        low=1,
        whole=True,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        self._check_face(check)
        if self.bed is not None:
            check.instance("bed", self.bed, (Solid,), "a Solid of libmpm.shapes or None")
        level, most = self.level, self.max_particles
        if level is not None:
            level = check.given("level", self, level)
        if most is not None:
            most = check.given("max_particles", self, most)
            if most > MOST_PARTICLES:
                check.fail(f"max_particles is {most}; expected ≤ {MOST_PARTICLES}, all that one "
                           "body can have; use None")  # fmt: skip
        return {
            "body": check.text("body", self.body),
            "velocity": _check_speed(check, self.velocity),
            "level": level,
            "zone": self._check_zone(check),
            "max_particles": most,
        }


@value
class Outflow(Flow):
    """A face of the domain through which particles leave for good, and are counted.

    Whatever `Method(leaving=...)` says of other faces, those that cross this one are taken out
    without a warning; `Simulation.outflow` has their number, mass and volume over time.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Outflow"

    face: str = given('"x-" ... "z+"; no wall may stand there', range="a face")
    velocity: float | TimeTable | None = given(
        "out of the domain, held in the `zone`: a number or a `TimeTable` of numbers, a "
        "pump that draws. None = nothing is held: a free overfall",
        default=None,
        unit="m/s",
        low=0,
    )
    zone: int = given("thickness of the zone that is led", default=3, unit="cells", low=2)

    def _check(self, check: Checker) -> dict[str, Any]:
        self._check_face(check)
        found: dict[str, Any] = {"zone": self._check_zone(check)}
        if self.velocity is not None:
            found["velocity"] = _check_speed(check, self.velocity)
        return found


@value
class PlacedFlow(Value):
    """An inflow or outflow with its name in the scene.

    {fields}
    """

    name: str = given("name among the flows", range="unique")
    flow: Flow = given("`Inflow` or `Outflow`")

    def _label(self) -> str:
        return f"flow {quoted(self.name)}"

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("flow", self.flow, (Flow,), "boundaries.Inflow(...) or Outflow(...)")
        return {"name": check.text("name", self.name)}


class Bore(NamedTuple):
    """State behind a bore that runs into still water, and its speed; m/s, m, m/s."""

    velocity: float
    depth: float
    speed: float


@keywords_only("boundaries.riemann_inlet", 3, method=False)
def riemann_inlet(reservoir_depth: float, flume_depth: float, gravity: float = 9.81) -> Bore:
    """Return velocity and depth behind the bore of a broken dam, and the speed of the bore.

    The gate between still water of the depths h_L and h_R (m, h_L > h_R > 0) opens at once; of the
    shallow-water equations' solution, this is the state between rarefaction and bore:

        2(√(g h_L) - √(g h)) = (h - h_R) √((g/2)(1/h + 1/h_R)),
        v = 2(√(g h_L) - √(g h)),  bore speed = h v / (h - h_R).

    `Inflow(velocity=v, level=bed + h)` is the bore's inlet. Raises `SceneError`. Source: Yang
    (2016), section 5.2; Toro (2001).
    """
    check = Checker("riemann_inlet")
    left = check.number("reservoir_depth", reservoir_depth, lower=0, lower_open=True, unit="m")
    right = check.number("flume_depth", flume_depth, lower=0, lower_open=True, unit="m")
    g = check.number("gravity", gravity, lower=0, lower_open=True, unit="m/s²")
    check.finish()
    if left <= right:
        raise SceneError(
            f"riemann_inlet: reservoir_depth is {left:g} with flume_depth {right:g} m; expected a "
            "deeper reservoir; no bore runs uphill"
        )

    def excess(h: float) -> float:
        drop = 2 * (math.sqrt(g * left) - math.sqrt(g * h))
        return (h - right) * math.sqrt(0.5 * g * (1 / h + 1 / right)) - drop

    # It grows with h, from below 0 at h_R to above 0 at h_L.
    low, depth = right, left
    while low < (middle := 0.5 * (low + depth)) < depth:
        low, depth = (low, middle) if excess(middle) > 0 else (middle, depth)
    velocity = 2 * (math.sqrt(g * left) - math.sqrt(g * depth))
    return Bore(velocity, depth, depth * velocity / (depth - right))
