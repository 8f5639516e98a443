"""`LoadCell`, `ContactLoad`, `WaveGauge`, ...: sensors that the engine evaluates.

Every sensor has an `interval` in seconds between samples, whatever the time step; 0 samples every
step. Sampling never changes the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.shapes.boxes import check_faces

__all__ = ["ContactLoad", "Energy", "LoadCell", "ParticleTracker", "Sensor", "VelocityProbe"]
__all__ += ["MEANS", "PinForce", "RigidMotion", "WaveGauge", "check_interval"]

#: Kinds of sensors whose samples are means since the sample before.
MEANS = frozenset({"load-cell", "contact-load"})

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

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.LoadCell"
    kind: ClassVar[str] = "load-cell"

    boundary: str = given("the boundary of the scene that carries the cell", range="a name")
    faces: Literal["all"] | Sequence[str] = given(
        'faces of that boundary that are measured; "all" = each', default="all", range="names"
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)
    reference: Sequence[float] | None = given(
        "point of the moments; None = centre of the box or domain",
        default=None,
        unit="m",
        shape="(2|3,)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        reference = self.reference
        return {
            "boundary": check.text("boundary", self.boundary),
            "faces": check_faces(check, self.faces),
            "interval": check_interval(check, self.interval),
            "reference": (None if reference is None else check.given("reference", self, reference)),
        }


@value
class ContactLoad(Sensor):
    """Force that the bodies of a contact exert on each other, by the impulses of each step.

    {fields}

    A sample is the mean over its interval, so no blow falls between samples. With the impulses J of
    `contacts.Friction` over nodes, pairs and sweeps, their parts J_n along the normal and J_t
    along the faces, and what each leaves of the approach, w':

    ================  ======  =====================================================================
    component         unit    meaning
    ================  ======  =====================================================================
    force_x, ...      N       Σ J / t, on the second body of each pair by the first
    normal            N       Σ ‖J_n‖ / t, whatever its direction; ≥ 0
    tangential        N       Σ ‖J_t‖ / t, what friction holds and what it slows down; ≥ 0
    friction_power    W       Σ J_t · w' / t, the energy that sliding takes; 0 where friction holds
    ================  ======  =====================================================================

    Per metre of thickness in 2D. First and second are those of the contact's `between`; where both
    of its names fit both bodies, the first is the one that was added to the scene first. The
    momentum of each body changes by exactly these impulses beside those of gravity, of boundaries
    and of other contacts. Each sensor repeats the pass over the nodes at which its bodies meet.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.ContactLoad"
    kind: ClassVar[str] = "contact-load"

    contact: str = given("the contact of the scene, of a law other than Stick", range="a name")
    pair: Sequence[str] | None = given(
        "two bodies of the contact that count alone, the force on the second by the first; "
        "None = the sum over its pairs",
        default=None,
        range="names",
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        pair = self.pair
        if pair is not None:
            names = None if isinstance(pair, str) else sequence(pair)
            if not names or len(names) != 2 or names[0] == names[1]:
                check.fail(f"pair is {shown(pair)}; expected the names of two bodies, or None")
                pair = None
            else:
                pair = tuple(check.text(f"pair[{i}]", name) for i, name in enumerate(names))
        return {
            "contact": check.text("contact", self.contact),
            "pair": pair,
            "interval": check_interval(check, self.interval),
        }


@value
class WaveGauge(Sensor):
    """Height of the free surface in a column of cells, in m.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.WaveGauge"
    kind: ClassVar[str] = "wave-gauge"

    position: Sequence[float] = given(
        "horizontal place: every axis but that of gravity, in order", unit="m", shape="(1|2,)"
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)
    body: str | None = given(
        "the body whose surface counts; None = all", default=None, range="a name"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "position": check.given("position", self),
            "interval": check_interval(check, self.interval),
            "body": _body(check, self.body),
        }


@value
class VelocityProbe(Sensor):
    """Velocity of the material at a fixed point, in m/s.

    {fields}

    The mean of the velocities of the nodes around the point that carry mass, by the scene's
    functions there; of functions that average over a particle (GIMP, CPDI) by the linear ones, for
    a point has no extent. NaN where there is no mass. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.VelocityProbe"
    kind: ClassVar[str] = "velocity-probe"

    position: Sequence[float] = given("the point, inside the domain", unit="m", shape="(2|3,)")
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "position": check.given("position", self),
            "interval": check_interval(check, self.interval),
        }


@value
class ParticleTracker(Sensor):
    """Position and velocity of chosen particles of one body.

    {fields}

    The velocity is that of ``sim.particles[body]["velocity"]``: the one that the particle stores
    where its transfer makes it store one, else what the grid gives it. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.ParticleTracker"
    kind: ClassVar[str] = "tracker"

    body: str = given("the body that the particles belong to", range="a name")
    ids: Literal["all"] | Sequence[int] = given(
        'ids of the scene, as ``sim.particles[body]["id"]`` lists them; "all" follows every '
        "particle of the body",
        low=0,
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

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
class RigidMotion(Sensor):
    """Motion of a rigid body, and what acts on it beside gravity.

    {fields}

    ==========================  =====  =============================================================
    component                   unit   meaning
    ==========================  =====  =============================================================
    centroid_x, ...             m      centre of mass, in the world
    velocity_x, ...             m/s    of the centre, with which the step that begins moves it
    angular_velocity            rad/s  in 3D angular_velocity_x, ..., on the axes of the scene
    angle                       rad    since the start; in 3D quaternion_w, _x, _y and _z, the unit
                                       quaternion of the turn since the start, quaternion_w >= 0
    force_x, ...                N      mean of all that pushed it since the sample before
    moment_z                    N·m    the same about its centre; in 3D moment_x, ...
    ==========================  =====  =============================================================

    Per metre of thickness in 2D. Force and moment are the change of momentum by contacts, walls and
    bodies that it moves with as one, without gravity; NaN in the first sample. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.RigidMotion"
    kind: ClassVar[str] = "rigid-motion"

    body: str = given("a body of materials.Rigid", range="a name")
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "body": check.text("body", self.body),
            "interval": check_interval(check, self.interval),
        }


@value
class PinForce(Sensor):
    """Force of a body of elements on one of its pins, in N (N/m in 2D).

    {fields}

    Components force_x, ...: the mean since the sample before, of the momentum by which the pinned
    vertices differ from what they would have kept; 0 along axes that the pin leaves free, NaN in
    the first sample. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.PinForce"
    kind: ClassVar[str] = "pin-force"

    body: str = given("a body with `pins`", range="a name")
    pin: int = given("which of its pins", default=0, unit="1", low=0, whole=True)
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "body": check.text("body", self.body),
            "pin": check.given("pin", self),
            "interval": check_interval(check, self.interval),
        }


@value
class Energy(Sensor):
    """Kinetic, elastic, potential and dissipated energy, in J (J/m in 2D).

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.Energy"
    kind: ClassVar[str] = "energy"

    body: str | None = given("name of a body; None = the sum over all", default=None)
    interval: float = given("between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "body": _body(check, self.body),
            "interval": check_interval(check, self.interval),
        }
