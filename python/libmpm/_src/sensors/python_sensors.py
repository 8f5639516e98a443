"""`PressureProbe`, `BodyTracker`, ...: sensors evaluated in Python, at step boundaries.

Those that are sums over particles the engine takes in its step, where it can (`tallied.in_step`).
The others are evaluated at the first step boundary with time ≥ k × interval, k = 0, 1, ...;
nothing is added to the engine's step, and no bit of a run changes. A sample copies what it reads
from the device, once for all sensors due at that moment, and works on it with NumPy: of a sensor
with a place or a region the blocks that it touches, else all. On a CPU that takes about 0.1 µs a
particle for positions and 1 µs for velocities, pressures and stresses (docs/sensors.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, sequence, shown, value
from libmpm._src.sensors.engine_sensors import Sensor, check_interval
from libmpm._src.sensors.reductions import DIRECTIONS, OPERATIONS
from libmpm._src.shapes.solid import Solid

__all__ = [
    "AttributeTracker",
    "BodyTracker",
    "ContactForce",
    "Custom",
    "ElevationGauge",
    "GridSensor",
    "ParticleSensor",
    "PressureProbe",
    "Sampled",
]

Operation = Literal["sum", "mean", "min", "max", "std", "variance", "range", "count"]

Direction = Literal["x", "x+", "x-", "y", "y+", "y-", "z", "z+", "z-"]

#: Attribute of a grid sensor -> (unit, whether it is a vector).
GRID: dict[str, tuple[str, bool]] = {
    "force": ("N", True), "momentum": ("kg·m/s", True), "velocity": ("m/s", True),
    "acceleration": ("m/s²", True), "mass": ("kg", False), "volume": ("m³", False),
    "jbar": ("1", False), "kinetic_energy": ("J", False),
    "kinetic_energy_before": ("J", False), "potential_energy": ("J", False),
    "volume_energy": ("J", False),
}  # fmt: skip

QUANTITIES = (
    "centroid", "velocity", "orientation", "angular_velocity", "extent", "momentum",
    "contact_force", "boundary_force",
)  # fmt: skip


class Sampled(Sensor):
    """Base of the sensors whose samples are made in Python: of sums, or of what is read."""


def _optional(check: Checker, name: str, item: str | None) -> str | None:
    return None if item is None else check.text(name, item)


def _region(check: Checker, region: Any) -> None:
    if region is not None:
        check.instance("region", region, (Solid,), "a solid of libmpm.shapes, or None for all")


def _direction(check: Checker, direction: str | None) -> None:
    if direction is not None:
        check.choice("direction", direction, DIRECTIONS)


@value
class ParticleSensor(Sampled):
    """One number from an attribute of all particles in a region: sum, mean, largest, ...

    {fields}

    Operations: "sum", "mean", "min", "max", "std", "variance" (of the values, divided by their
    number), "range" (largest less smallest), "count". Of no particle count and sum are 0, all
    others NaN. Directions: "x", "y", "z", with "+" or "-" only the values of that sign.
    Positions are in the world. Raises `SceneError`.

    Sums of most attributes, everywhere or in a `Box`, are taken by the engine in its step
    (docs/sensors.md); of others a sample reads the attribute of the bodies' particles, with a
    region of those about it. Source: Bonus (2023), particle-sensors of the scene file.
    """

    label: ClassVar[str] = "sensors.ParticleSensor"
    kind: ClassVar[str] = "particles"

    attribute: str = given(
        'library name ("Pressure", "StressCauchy_XX", ...) or an attribute of the engine '
        '("velocity", ...)',
        range="a name",
    )
    operation: Operation = given("what becomes of the particles' values", default="max")
    body: str | None = given(
        "the body that the particles belong to; None = all", default=None, range="a name"
    )
    direction: Direction | None = given(
        'of "position" and "velocity": the component; None = each', default=None
    )
    region: Solid | None = given(
        "coordinates of the scene; its surface belongs to it; None = all",
        default=None,
        unit="m",
        range="a solid",
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        _direction(check, self.direction)
        _region(check, self.region)
        return {
            "attribute": check.text("attribute", self.attribute),
            "operation": check.choice("operation", self.operation, tuple(OPERATIONS)),
            "body": _optional(check, "body", self.body),
            "interval": check_interval(check, self.interval),
        }


@value
class GridSensor(Sampled):
    """One number from all nodes with mass in a region of the grid: sum, mean, largest, ...

    {fields}

    Nodes are the centres of cells. Attributes, per node:

    - "mass" m, kg; "velocity" v, m/s, with which the coming step moves particles; "momentum" m v;
    - "force" (p + m g Δt - m v)/Δt, N: the momentum p that particles have left there and gravity's
      share of it, less what the boundaries leave, per time of the coming step. Positive as the
      boundaries are pushed; the sum around a boundary is what its `LoadCell` measures in that
      step, and zero where none acts. It is the force in one step; a mean over an interval is what
      a load cell gives. Not defined for XPIC and FMPM, whose grids are filtered in between;
    - "acceleration" change of v since the previous sample per time, m/s², at the nodes that had
      mass both times: ∂v/∂t at a fixed place. The first sample has none;
    - "volume" Σ N_ip V_p, m³; "jbar" Σ N_ip V_p / Σ N_ip V_p⁰, with the functions of the deposit
      (linear, quadratic, cubic; else quadratic ones);
    - "kinetic_energy" m v²/2, J, of the velocity with which the coming step moves particles. With
      APIC their sum is at least the kinetic energy of `Energy`, whose velocities are means over
      nodes; "kinetic_energy_before" p²/(2 m), of the momentum p that particles have left there,
      stress included, before gravity and boundaries. Where contacts keep bodies apart both are of
      the mean velocity of all of them at a node;
    - "potential_energy" - m g · (x - lower corner), J; their sum is that of the particles with
      linear, quadratic and cubic functions;
    - "volume_energy" Σ over fluids of V⁰_i Ψ(J̄_i), J, with V⁰_i = Σ N_ip V_p⁰,
      J̄_i = Σ N_ip V_p / V⁰_i and Ψ the energy of `TaitFluid`'s volume law: what is left of the
      elastic energy when volumes are averaged at nodes. Refused where no body is a fluid.

    Of no node count and sum are 0, all others NaN. In 2D per metre of thickness. Square
    cells only. A sample reads the nodes about its region, of "volume", "jbar" and "volume_energy"
    the particles there as well. Raises `SceneError`.

    Source: Bonus (2023), grid-sensors of the scene file and energies of the grid; force as in
    `LoadCell`.
    """

    label: ClassVar[str] = "sensors.GridSensor"
    kind: ClassVar[str] = "grid"

    attribute: Literal[
        "force", "momentum", "velocity", "acceleration", "mass", "volume", "jbar",
        "kinetic_energy", "kinetic_energy_before", "potential_energy", "volume_energy",
    ] = given("quantity of the nodes", default="force")  # fmt: skip
    operation: Operation = given("as of `ParticleSensor`", default="sum")
    direction: Direction | None = given(
        'component of a vector, with "+" or "-" only the values of that sign; None = each '
        "component",
        default=None,
    )
    region: Solid | None = given(
        "coordinates of the scene; its surface belongs to it; None = all",
        default=None,
        unit="m",
        range="a solid",
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        _direction(check, self.direction)
        _region(check, self.region)
        attribute = check.choice("attribute", self.attribute, tuple(GRID))
        if self.direction is not None and not GRID[attribute][1]:
            check.fail(
                f"direction is '{self.direction}' of '{attribute}', which is no vector; leave it "
                "out"
            )
        return {
            "attribute": attribute,
            "operation": check.choice("operation", self.operation, tuple(OPERATIONS)),
            "interval": check_interval(check, self.interval),
        }


@value
class BodyTracker(Sampled):
    """Motion and loads of one body as a whole.

    {fields}

    - "centroid", m, in the world, and "velocity", m/s: means weighted by mass;
    - "orientation": the rotation that takes the body best from where it was when the run began to
      where it is, in the least squares weighted by mass: in 2D "angle" in rad, counted on over
      full turns, in 3D a unit quaternion, "quaternion_w" to "quaternion_z", continuous from sample
      to sample. A turn between two samples must stay below half a revolution;
    - "angular_velocity" I⁻¹ L, rad/s: moment of momentum about the centroid over the inertia now;
    - "extent": smallest and largest coordinates of its particles, "lower_x" to "upper_z", m, in
      the world;
    - "momentum", kg·m/s;
    - "contact_force", N: what all other bodies and boundaries together do to the body, the mean
      since the previous sample, ΔM/Δt - m g. It holds every impact in between. The velocities have
      the coming step in them, so the interval is one step later than that of a `LoadCell`. The
      first sample has none, and so has one before which particles have left or entered the body;
    - "boundary_force", N: the boundaries' part of it, in the one coming step: of what they do to
      every node the body has its share of the mass, Σ (m_i of the body/m_i) f_i. With interval 0
      the rest of the contact force is that of other bodies, and with exactly two bodies that touch
      the force between the pair (where particles store a velocity, of the step before). For square
      cells with linear, quadratic, cubic and "ddmp" functions, not with XPIC and FMPM.

    Components of vectors end in _x, _y, _z, such as "centroid_x"; "angular_velocity" is one number
    in 2D. NaN without particles. In 2D per metre of thickness. Raises `SceneError`.

    The sums that all this follows from are taken by the engine in its step; with "boundary_force" a
    sample reads masses, positions and velocities of the body, and the nodes about it. The engine
    and checkpoints hold the first positions, 8 bytes a particle and axis, where orientation is
    asked for. Source: Horn (1987), J. Opt. Soc. Am. A 4, for the rotation.
    """

    label: ClassVar[str] = "sensors.BodyTracker"
    kind: ClassVar[str] = "body"

    body: str = given("the body", range="a name")
    quantities: Sequence[str] = given("what is recorded, in this order", default=(
        "centroid", "velocity", "orientation", "angular_velocity", "extent", "momentum",
        "contact_force",
    ))  # fmt: skip
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        given = self.quantities
        chosen = [given] if isinstance(given, str) else sequence(given)
        if not chosen:
            check.fail(f"quantities is {shown(given)}; expected some of {', '.join(QUANTITIES)}")
            chosen = []
        for name in chosen:
            check.choice("quantities", name, QUANTITIES)
        if not check.problems and len(set(chosen)) < len(chosen):
            check.fail("quantities has a name more than once; expected each at most once")
        return {
            "body": check.text("body", self.body),
            "quantities": tuple(chosen),
            "interval": check_interval(check, self.interval),
        }


@value
class ContactForce(Sampled):
    """Force of one body on another through the nodes that they share, in N (N/m in 2D).

    {fields}

    A sample is the mean over one step, the one after the first at or past its time: at each node
    m_b m_c (u_c - u_b) / (m Δt) of the bodies' own masses and velocities, so that forces of a pair
    are opposite and those of all bodies and boundaries add up to what the body feels. For APIC on
    quadratic splines. A sample reads both bodies and the nodes at two step boundaries. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "sensors.ContactForce"
    kind: ClassVar[str] = "contact-force"

    body: str = given("the body that the force acts on", range="a name")
    by: str = given("the other body that it comes from", range="a name")
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        return {
            "body": check.text("body", self.body),
            "by": check.text("by", self.by),
            "interval": check_interval(check, self.interval),
        }


@value
class AttributeTracker(Sampled):
    """Any attributes of chosen particles of one body, by their ids.

    {fields}

    Columns are called "Pressure:17" for particle 17; of one that has left they are NaN. A
    sample reads the attributes of the whole body; `ParticleTracker` does positions and velocities
    without that. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.AttributeTracker"
    kind: ClassVar[str] = "attributes"

    body: str = given("the body that the particles belong to", range="a name")
    ids: Sequence[int] = given(
        'ids of the scene, as ``sim.particles[body]["id"]`` lists them', low=0
    )
    attributes: Sequence[str] = given("library names, or attributes of the engine", range="names")
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        items = sequence(self.ids)
        if not items:
            check.fail(f"ids is {shown(self.ids)}; expected whole numbers ≥ 0, at least one")
            items = []
        ids = tuple(check.integer(f"ids[{i}]", x) for i, x in enumerate(items))
        if len(set(ids)) < len(ids):
            check.fail("ids has an id more than once; expected each at most once")
        given = self.attributes
        names = [given] if isinstance(given, str) else sequence(given)
        if not names:
            check.fail(f"attributes is {shown(given)}; expected names, at least one")
            names = []
        return {
            "body": check.text("body", self.body),
            "ids": ids,
            "attributes": tuple(check.text("attributes", n) for n in names),
            "interval": check_interval(check, self.interval),
        }


@value
class PressureProbe(Sampled):
    """Pressure at a fixed point, in Pa, from the particles around it.

    {fields}

    Particles weigh by their volume too; without any in reach the place is dry, NaN.

    Order 1 brings the mean of a fluid to the point by its weight: each pressure plus ρ g · (point -
    particle). At a flat wall that rests this is the slope of the pressure across it, in still water
    and in a flow; the inertia of a wall that is accelerated is not in it. A line fitted to the
    particles beside a wall would amplify what their pressures alternate by within a cell, which
    forces on the wall do not feel. It is not negative where the mean is not: above a surface there
    is no weight to take off. Where a particle of a solid is in reach it is such a line, of
    least squares; with fewer than 2(d + 1) of them, or all of them on a plane, the mean.

    A sample reads positions, volumes and pressures of the bodies. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.PressureProbe"
    kind: ClassVar[str] = "pressure-probe"

    position: Sequence[float] = given(
        "the point, inside the domain, also on a wall", unit="m", shape="(2|3,)"
    )
    radius: float | None = given(
        "half width of the quadratic B-spline that weighs the particles; None = 2 cells, with "
        "order 0 1.5",
        default=None,
        unit="m",
        above=0,
    )
    order: int = given(
        "1: the weighted mean, brought to the point by the weight of the fluid, so that it does "
        "not lag at walls; 0: the weighted mean",
        default=1,
        range="0, 1",
    )
    body: str | None = given(
        "the body whose particles count; None = all", default=None, range="a name"
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        radius = self.radius
        if radius is not None:
            radius = check.given("radius", self, radius)
        if type(self.order) is not int or self.order not in (0, 1):
            check.fail(f"order is {shown(self.order, 40)}; expected 0 (mean) or 1 (at the point)")
        return {
            "position": check.given("position", self),
            "radius": radius,
            "body": _optional(check, "body", self.body),
            "interval": check_interval(check, self.interval),
        }


@value
class ElevationGauge(Sampled):
    """Height of the material above a place, in m of the world, from the particles there.

    {fields}

    "max" is the highest particle and half its width, V^(1/d)/2; a single drop counts. "percentile"
    is the height below which that share of the mass in the column lies, half a width added: it
    passes spray over, and in a full column of depth h lies (100 - percentile) % of h below the
    surface. NaN where it is dry. `WaveGauge` finds the surface on the grid, which is
    smoother and cheaper. A sample reads positions, volumes and masses of the bodies. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "sensors.ElevationGauge"
    kind: ClassVar[str] = "elevation-gauge"

    position: Sequence[float] = given(
        "horizontal place: every axis but that of gravity, in order", unit="m", shape="(1|2,)"
    )
    radius: float | None = given(
        "particles nearer than this, horizontally, count; None = 1 cell",
        default=None,
        unit="m",
        above=0,
    )
    method: Literal["max", "percentile"] = given('"max" or "percentile"', default="max")
    percentile: float | None = given(
        'share of the mass that lies below, for "percentile"',
        default=None,
        unit="%",
        low=0,
        high=100,
    )
    body: str | None = given(
        "the body whose surface counts; None = all", default=None, range="a name"
    )
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        radius, share = self.radius, self.percentile
        if radius is not None:
            radius = check.given("radius", self, radius)
        method = check.choice("method", self.method, ("max", "percentile"))
        if (share is None) == (method == "percentile"):
            need = "expected 0 to 100 %" if share is None else "expected it with 'percentile' only"
            check.fail(f"percentile is {shown(share)} with method '{method}'; {need}")
        elif share is not None:
            share = check.given("percentile", self, share)
        return {
            "position": check.given("position", self),
            "radius": radius,
            "method": method,
            "percentile": share,
            "body": _optional(check, "body", self.body),
            "interval": check_interval(check, self.interval),
        }


@value
class Custom(Sampled):
    """Custom numbers: whatever a function reads from the simulation.

    {fields}

    The function may read the simulation and must not advance it. For a resumed run to have the
    same series it must depend on nothing else. Of ranks that are processes each calls it, with
    what reads the particles and nodes of all: it must read the same on every rank. Nodes come in
    another order then.

    No file holds a function: `Scene.save` refuses the scene. A run with it works, and its
    ``scene.json`` and checkpoints keep the function's name; to continue from them give it again,
    ``Simulation.resume(path, functions={"<sensor>": function})``. Raises `SceneError`.
    """

    label: ClassVar[str] = "sensors.Custom"
    kind: ClassVar[str] = "custom"

    function: Callable[[Any], Any] | str = given(
        "called with the `Simulation`; returns one number a column", range="a callable"
    )
    columns: Sequence[str] = given("of the numbers, at least one", range="names")
    units: Sequence[str] | None = given('of the columns; None = "1"', default=None, range="texts")
    interval: float = given("time between samples; 0 = every step", default=0.0, unit="s", low=0)

    def _check(self, check: Checker) -> dict[str, Any]:
        if not callable(self.function) and not isinstance(self.function, str):
            check.fail(f"function is {shown(self.function)}; expected a callable of the simulation")
        given = self.columns
        names = [given] if isinstance(given, str) else sequence(given)
        if not names:
            check.fail(f"columns is {shown(given)}; expected names, at least one")
            names = []
        columns = tuple(check.text("columns", n) for n in names)
        if len(set(columns)) < len(columns):
            check.fail("columns has a name more than once; expected each at most once")
        units = self.units
        if units is not None:
            texts = [units] if isinstance(units, str) else sequence(units)
            if texts is None or len(texts) != len(columns):
                check.fail(f"units is {shown(units)}; expected {len(columns)} texts, one a column")
                texts = []
            units = tuple(check.instance("units", u, (str,), "a text such as 'm/s'") for u in texts)
        interval = check_interval(check, self.interval)
        return {"columns": columns, "units": units, "interval": interval}

    @property
    def function_name(self) -> str:
        """What files keep of the function: its module and name."""
        made = self.function
        if isinstance(made, str):
            return made
        name = getattr(made, "__qualname__", type(made).__qualname__)
        return f"{getattr(made, '__module__', '?')}:{name}"
