"""`Body`, `Boundary` and `PlacedSensor`: what a scene is made of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from libmpm._src.base.arguments import quoted
from libmpm._src.base.declarations import given
from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.boundaries.responses import DecayLayer, Displacement, Response, Rotation, Travel
from libmpm._src.grids.shapes import Cells, Outline, Pin, Points, Traction
from libmpm._src.materials.material import Material
from libmpm._src.methods.method import FBar
from libmpm._src.methods.smoothing import AssumedFields, Smoothing
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.placed_force import PlacedForce
from libmpm._src.sensors.engine_sensors import Sensor
from libmpm._src.shapes.boxes import FACES, Box, DomainWalls, OrientedBox, Solid
from libmpm._src.shapes.element_mesh import Tetrahedra, Triangles
from libmpm._src.shapes.particle_placement import Sampling
from libmpm._src.shapes.point_file import PointFile

__all__ = ["Body", "Boundary", "PlacedSensor"]


@value
class Body(Value):
    """A body of the scene; see `Scene.add_body` for the fields.

    {fields}
    """

    name: str = given("name among the bodies", range="unique")
    shape: Solid | PointFile | Tetrahedra | Triangles | Cells | Points = given(
        "any solid of `libmpm.shapes`, exact total mass: boxes by a lattice of their own, "
        "others by that of the cells; a PointFile; Tetrahedra or Triangles, whose vertices are "
        "the particles; on a `grid` Box, Cells or Points",
        range="a shape",
    )
    material: Material = given("a value of `libmpm.materials`", range="material")
    particles_per_cell: int = given("None = 2 per axis", unit="1", low=1, whole=True)
    velocity: Sequence[float] | Field = given(
        "at the start, or a `Field`; None = at rest", unit="m/s", shape="(2|3,)"
    )
    fbar: FBar | Literal["default"] | None = given(
        '"default" is on for fluids, off for solids', default="default", range="`FBar`"
    )
    hydrostatic: float | None = given(
        "surface level against gravity, for instance z of the surface: the body starts with "
        "ρ g depth below it",
        default=None,
        unit="m",
        range="level",
        remedy="give the surface level",
    )
    subtract_from: Sequence[str] = given(
        "bodies that lose their particles inside this one", default=(), range="names"
    )
    lattice: Sequence[int] | None = given(
        "particles of a box on each of its axes, in place of particles_per_cell",
        default=None,
        unit="1",
        shape="(d,)",
    )
    stress: Sequence[float] | Field | None = given(
        "Cauchy stress at the start, or a `Field`: xx, yy, xy, zz of Hypoelastic in 2D; xx, "
        "yy, xy of LinearElastic in 2D, whose zz follows, and of elements of laws without flow, at "
        "their middles; xx, yy, zz, yz, xz, xy in 3D",
        default=None,
        unit="Pa",
        shape="(3|4|6,)",
    )
    tractions: Sequence[Traction] = given(
        "`Traction` values on the surface of a body of elements, or on faces of a Box on a `grid`",
        default=(),
    )
    pins: Sequence[Pin] = given(
        "`Pin` values: vertices of a body of elements that are held or driven", default=()
    )
    transfer: Transfer | None = given(
        "of the scene's scheme, with a flip and shifts of its own; None = that of the "
        "scene's `Method`",
        default=None,
        range="Transfer",
    )
    sampling: Sampling | None = given(
        "`shapes.Columns`, `Jitter` or `PoissonDisk` in place of the plain lattice, None; "
        '"default" is columns for fluids under gravity in a box without what is no box, as '
        "`shapes.basin` makes it, else the lattice",
        default=None,
    )
    smoothing: Smoothing | None = given(
        "`Smoothing` of its state over cells, in place of F-bar", default=None
    )
    assumed: AssumedFields | None = given(
        "`AssumedFields`: means of its rate and stress", default=None
    )
    damping: float = given(
        "ratio ξ of numerical damping, of elastic solids: σ_ij += 2 Δx ξ √(M ρ) d_ij, M the "
        "modulus of the pressure wave (i = j) or the shear modulus (Yang 2016, A.6), of elements "
        "in the form that no turn of the axes changes; 1 is critical in one dimension",
        default=0.0,
        unit="1",
        low=0,
    )
    force: PlacedForce | None = given(
        "`PlacedForce`: a force by mass that changes with the place, besides gravity", default=None
    )

    def _label(self) -> str:
        return f"body {quoted(self.name)}"

    def _check(self, check: Checker) -> dict[str, Any]:
        kinds = (Solid, PointFile, Tetrahedra, Triangles, Cells, Points)
        check.instance("shape", self.shape, kinds, "shapes.Box(lower=..., upper=...)")
        check.instance("material", self.material, (Material,), "a value of libmpm.materials")
        named = isinstance(self.fbar, str) and self.fbar == "default"
        if not (named or isinstance(self.fbar, FBar | None)):
            check.fail(f'fbar is {shown(self.fbar)}; expected "default", None or FBar(...)')
        if self.transfer is not None:
            check.instance("transfer", self.transfer, (Transfer,), "Transfer(...) or None")
        if self.sampling is not None:
            example = "shapes.Columns(), shapes.Jitter(share=, seed=), PoissonDisk(seed=) or None"
            check.instance("sampling", self.sampling, (Sampling,), example)
        parts = {"smoothing": Smoothing, "assumed": AssumedFields, "force": PlacedForce}
        for part, kind in parts.items():
            if getattr(self, part) is not None:
                check.instance(part, getattr(self, part), (kind,), f"{kind.__name__}(...) or None")
        level = self.hydrostatic
        if level is not None:
            level = check.given("hydrostatic", self, level)
        others = self.subtract_from
        if isinstance(others, str):
            others = (others,)
        if not isinstance(others, list | tuple):
            check.fail(f"subtract_from is {shown(others)}; expected names of bodies")
            others = ()
        remedy = "use 4 in 2D and 8 in 3D where nothing speaks for another number"
        velocity, stress = self.velocity, self.stress
        if not isinstance(velocity, Field):
            velocity = check.given("velocity", self, velocity)
        if stress is not None and not isinstance(stress, Field):
            stress = check.given("stress", self, stress)
        tractions = self._values(check, "tractions", Traction, "Traction(face=, value=)")
        pins = self._values(check, "pins", Pin, "Pin(face=)")
        return {
            "name": check.text("name", self.name),
            "particles_per_cell": check.given("particles_per_cell", self, remedy=remedy),
            "velocity": velocity,
            "damping": check.given("damping", self),
            "hydrostatic": level,
            "subtract_from": tuple(check.text("subtract_from", name) for name in others),
            "lattice": self._lattice(check),
            "stress": stress,
            "tractions": tractions,
            "pins": pins,
        }

    def _values(
        self, check: Checker, name: str, kind: type[Value], example: str
    ) -> tuple[Any, ...]:
        """Return a field of values of one kind, of which one alone needs no tuple."""
        given = getattr(self, name)
        single = isinstance(given, kind)
        items = [given] if single else None if isinstance(given, str) else sequence(given)
        if items is None:
            check.fail(f"{name} is {shown(given)}; expected a tuple of {example}")
            return ()
        for i, item in enumerate(items):
            check.instance(f"{name}[{i}]", item, (kind,), example)
        return tuple(items)

    def _lattice(self, check: Checker) -> tuple[int, ...] | None:
        if self.lattice is None:
            return None
        counts = sequence(self.lattice)
        if not counts or not isinstance(self.shape, Box | OrientedBox):
            check.fail(
                f"lattice is {shown(self.lattice)}; expected the number of particles on "
                "each axis of "
                "a shapes.Box or an OrientedBox"
            )
            return None
        return tuple(check.integer(f"lattice[{a}]", n, lower=1) for a, n in enumerate(counts))


@value
class Boundary(Value):
    """A boundary of the scene; see `Scene.add_boundary` for the fields.

    {fields}
    """

    name: str = given("name among the boundaries", range="unique")
    shape: Solid | DomainWalls | Outline = given(
        "`DomainWalls`, a rigid `Box` on cell faces or any other Solid, which is a surface; "
        "on a `grid` also `Outline`",
        range="a shape",
    )
    response: Response | Mapping[str, Response] = given(
        "one for all faces, or a dictionary by face", range="a response"
    )
    motion: TimeTable | Displacement | Travel | None = given(
        "`TimeTable` (m/s): a velocity that its face has; `Displacement` or `Travel`: the "
        "shape moves; None = at rest",
        default=None,
        unit="m/s",
        range="a motion",
    )
    time: tuple[float, float] | None = given(
        "(start, end) of its action; None = always", default=None, unit="s", range="0 ≤ a < b"
    )
    layer: DecayLayer | None = given(
        "of a surface; None = constrained, one cell", default=None, range="`DecayLayer`"
    )
    rotation: Rotation | None = given("of a surface; None = none", default=None, range="`Rotation`")
    within: Box | None = given(
        "acts on nodes inside it alone; None = everywhere", default=None, range="`Box`"
    )
    spacing: float | None = given(
        "of the lattice of a surface's distances; None = cell_size", default=None, unit="m", above=0
    )
    bodies: Sequence[str] = given(
        "acts on the share of a node's mass that is theirs; () = all", default=(), range="names"
    )
    uplift: bool = given(
        "of solids alone: water in the gap between them and a bed presses up on what stands there "
        "with the pressure beside it, linear between the edges of a base and 0 at a dry one "
        "(Terzaghi, uplift below dams); False: a base is sealed",
        default=False,
    )

    def _label(self) -> str:
        return f"boundary {quoted(self.name)}"

    def _check(self, check: Checker) -> dict[str, Any]:
        kinds = (Solid, DomainWalls, Outline)
        check.instance("shape", self.shape, kinds, "shapes.DomainWalls() or a Solid")
        response = self.response
        example = "a value of libmpm.boundaries"
        if isinstance(response, Mapping):
            for face, one in response.items():
                if face not in FACES:
                    check.fail(f"response has face {face!r}; expected some of {', '.join(FACES)}")
                check.instance(f"response['{face}']", one, (Response,), example)
            response = dict(response)
        else:
            check.instance("response", response, (Response,), f"{example}, or one for each face")
        if self.motion is not None:
            moving = (TimeTable, Displacement, Travel)
            check.instance("motion", self.motion, moving, "a TimeTable of velocities in m/s")
        for name, kind in (("layer", DecayLayer), ("rotation", Rotation), ("within", Box)):
            if getattr(self, name) is not None:
                check.instance(name, getattr(self, name), (kind,), f"{kind.__name__}(...)")
        spacing = self.spacing
        if spacing is not None:
            spacing = check.given("spacing", self, spacing)
        if not self.is_surface:
            for name in ("layer", "rotation", "spacing"):
                if getattr(self, name) is not None:
                    check.fail(
                        f"{name} is given with {type(self.shape).__name__}; expected a Solid of "
                        f"shapes; leave {name} out"
                    )
        elif isinstance(self.response, Mapping):
            check.fail(
                "response has faces, which a surface of any shape has not; expected one response"
            )
        if not isinstance(self.uplift, bool):
            check.fail(f"uplift is {shown(self.uplift)}; expected True or False")
        bodies = (self.bodies,) if isinstance(self.bodies, str) else sequence(self.bodies)
        if bodies is None:
            check.fail(f"bodies is {shown(self.bodies)}; expected names of bodies; give ('block',)")
        return {
            "spacing": spacing,
            "bodies": tuple(check.text("bodies", name) for name in bodies or ()),
            "name": check.text("name", self.name),
            "response": response,
            "time": self._window(check),
        }

    def _window(self, check: Checker) -> tuple[float, float] | None:
        if self.time is None:
            return None
        if not isinstance(self.time, list | tuple) or len(self.time) != 2:
            check.fail(
                f"time is {shown(self.time)}; expected (start, end) in s, or None for always"
            )
            return None
        start, end = self.time
        start = check.number("time[0]", start, lower=0, unit="s")
        # None is how a file writes an open end.
        end = math.inf if end is None else check.number("time[1]", end, unit="s", infinite=True)
        if end <= start:
            check.fail(f"time is ({start:g}, {end:g}); expected end > start, in s")
        return start, end

    @property
    def is_surface(self) -> bool:
        """Whether its shape is taken by its signed distance, not by the cells of the grid.

        A `Box` lies on cell faces, unless it moves, turns or has a decay layer.
        """
        if isinstance(self.shape, Box):
            moves = isinstance(self.motion, Displacement | Travel)
            return moves or any(x is not None for x in (self.layer, self.rotation, self.spacing))
        return isinstance(self.shape, Solid)

    @property
    def responses(self) -> tuple[Response, ...]:
        """Its response, or those of its faces."""
        given = self.response
        return tuple(given.values()) if isinstance(given, Mapping) else (given,)

    def response_at(self, face: str = "") -> Response:
        """Return the response of a face; its only one, or the first, where none is named."""
        given = self.response
        return given if isinstance(given, Response) else given[face or next(iter(given))]

    @property
    def at_rest(self) -> bool:
        """Whether it neither moves nor turns, nor its faces run."""
        return self.motion is None and self.rotation is None

    @property
    def window(self) -> tuple[float, float]:
        """Start and end of the time in which the boundary acts, in s; (0, inf) is always."""
        return (0.0, math.inf) if self.time is None else self.time


@value
class PlacedSensor(Value):
    """A sensor with its name in the scene.

    {fields}
    """

    name: str = given("name among the sensors", range="unique")
    sensor: Sensor = given("a value of `libmpm.sensors`")

    def _label(self) -> str:
        return f"sensor {quoted(self.name)}"

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("sensor", self.sensor, (Sensor,), "a value of libmpm.sensors")
        return {"name": check.text("name", self.name)}
