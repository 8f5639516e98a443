"""`LoadCell`, `WaveGauge`, `VelocityProbe`, ...: sensors that the engine evaluates.

Every sensor has an `interval` in seconds between samples, whatever the time step; 0 samples every
step. Sampling never changes the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.shapes.boxes import check_faces

__all__ = ["Energy", "LoadCell", "ParticleTracker", "Sensor", "VelocityProbe", "WaveGauge"]
__all__ += ["check_interval"]

#: Least interval but 0, s. Samples are counted from time 0: a step passes over dt / interval of
#: them one by one, and their number must fit into 64 bits.
LEAST_INTERVAL = 1e-9


class Sensor(Value):
    """Base of all sensors."""

    #: Name of the sensor in the engine.
    kind: ClassVar[str]
    interval: float = 0.0


def check_interval(check: Checker, interval: Any, name: str = "interval") -> float:
    """Return an interval in s: 0, which samples every step, or one that can be counted."""
    remedy = "0 samples every step"
    found = check.number(name, interval, lower=0, unit="s", remedy=remedy)
    if 0 < found < LEAST_INTERVAL:
        check.fail(f"{name} is {found:g}; expected ≥ {LEAST_INTERVAL:g} s or 0; {remedy}")
    return found


def _body(check: Checker, name: str | None) -> str | None:
    return None if name is None else check.text("body", name)


@value
class LoadCell(Sensor):
    """Force and moment on faces of one boundary, as momentum removed per sample interval.

    A sample is the mean over its interval, so no impact falls between samples; positive in the
    direction in which the boundary is pushed. N and N·m, per metre of thickness in 2D.

    =========  ====  ==========  ===========================================================
    parameter  unit  range       meaning
    =========  ====  ==========  ===========================================================
    boundary   -     a name      the boundary of the scene that carries the cell
    faces      -     names       faces of that boundary that are measured; "all" = each
    interval   s     ≥ 0         time between samples; 0 = every step
    reference  m     (2|3,)      point of the moments; None = centre of the box or domain
    =========  ====  ==========  ===========================================================

    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.LoadCell"
    kind: ClassVar[str] = "load-cell"

    boundary: str
    faces: Literal["all"] | Sequence[str] = "all"
    interval: float = 0.0
    reference: Sequence[float] | None = None

    def _check(self, check: Checker) -> dict[str, Any]:
        reference = self.reference
        return {
            "boundary": check.text("boundary", self.boundary),
            "faces": check_faces(check, self.faces),
            "interval": check_interval(check, self.interval),
            "reference": (
                None if reference is None else check.vector("reference", reference, unit="m")
            ),
        }


@value
class WaveGauge(Sensor):
    """Height of the free surface in a column of cells, in m.

    =========  ====  ==========  ===========================================================
    parameter  unit  range       meaning
    =========  ====  ==========  ===========================================================
    position   m     (1|2,)      horizontal place: every axis but that of gravity, in order
    interval   s     ≥ 0         time between samples; 0 = every step
    body       -     a name      the body whose surface counts; None = all
    =========  ====  ==========  ===========================================================

    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.WaveGauge"
    kind: ClassVar[str] = "wave-gauge"

    position: Sequence[float]
    interval: float = 0.0
    body: str | None = None

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "position": check.vector("position", self.position, lengths=(1, 2), unit="m"),
            "interval": check_interval(check, self.interval),
            "body": _body(check, self.body),
        }


@value
class VelocityProbe(Sensor):
    """Velocity of the material at a fixed point, in m/s.

    =========  ====  ==========  ===========================================================
    parameter  unit  range       meaning
    =========  ====  ==========  ===========================================================
    position   m     (2|3,)      the point, inside the domain
    interval   s     ≥ 0         time between samples; 0 = every step
    =========  ====  ==========  ===========================================================

    The mean of the velocities of the nodes around the point that carry mass, by the scene's
    functions there; of functions that average over a particle (GIMP, CPDI) by the linear ones, for
    a point has no extent. Not-a-number where there is no mass. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.VelocityProbe"
    kind: ClassVar[str] = "velocity-probe"

    position: Sequence[float]
    interval: float = 0.0

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "position": check.vector("position", self.position, unit="m"),
            "interval": check_interval(check, self.interval),
        }


@value
class ParticleTracker(Sensor):
    """Position and velocity of chosen particles of one body.

    =========  ====  ==========  ===========================================================
    parameter  unit  range       meaning
    =========  ====  ==========  ===========================================================
    body       -     a name      the body that the particles belong to
    ids        -     ≥ 0         ids of the scene, as ``sim.particles[body]["id"]`` lists them;
                                 "all" follows every particle of the body
    interval   s     ≥ 0         time between samples; 0 = every step
    =========  ====  ==========  ===========================================================

    The velocity is that of ``sim.particles[body]["velocity"]``: the one that the particle stores
    where its transfer makes it store one, else what the grid gives it. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.ParticleTracker"
    kind: ClassVar[str] = "tracker"

    body: str
    ids: Literal["all"] | Sequence[int]
    interval: float = 0.0

    def _check(self, check: Checker) -> dict[str, Any]:
        ids: Any = self.ids
        if not isinstance(ids, str) or ids != "all":
            items = sequence(ids)
            if not items:
                check.fail(f"ids is {shown(self.ids)}; expected whole numbers ≥ 0, at least one")
                items = []
            ids = tuple(check.integer(f"ids[{i}]", x) for i, x in enumerate(items))
            if len(set(ids)) < len(ids):
                check.fail("ids has an id more than once; expected each at most once")
        return {
            "body": check.text("body", self.body),
            "ids": ids,
            "interval": check_interval(check, self.interval),
        }


@value
class Energy(Sensor):
    """Kinetic, elastic, potential and dissipated energy, in J (J/m in 2D).

    `body` names one body, None sums over all; `interval` is in seconds, ≥ 0, 0 = every step.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.Energy"
    kind: ClassVar[str] = "energy"

    body: str | None = None
    interval: float = 0.0

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "body": _body(check, self.body),
            "interval": check_interval(check, self.interval),
        }
