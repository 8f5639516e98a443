"""`SceneData`: bodies, boundaries, sensors, flows and method of a scene, as a pure value."""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar

from libmpm._src.base.declarations import FIXED, Given, declared, documents
from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable, check_vector_table
from libmpm._src.base.values import Checker, Value, keywords_only, plain, shown
from libmpm._src.boundaries.contact_laws import Contact, ContactLaw
from libmpm._src.boundaries.flows import Flow, PlacedFlow
from libmpm._src.boundaries.responses import DecayLayer, Displacement, Response, Rotation, Travel
from libmpm._src.errors import SceneError
from libmpm._src.grids.grid import SplineGrid, TriangularGrid
from libmpm._src.grids.shapes import Cells, Outline, Pin, Points, Traction
from libmpm._src.materials.material import Material
from libmpm._src.methods.method import FBar, Method
from libmpm._src.methods.smoothing import AssumedFields, Smoothing
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.parts import Body, Boundary, PlacedSensor
from libmpm._src.scene.placed_force import PlacedForce
from libmpm._src.scene.start import Start
from libmpm._src.sensors.engine_sensors import Sensor
from libmpm._src.shapes.basin import has_bed
from libmpm._src.shapes.boxes import Box, DomainWalls, Solid
from libmpm._src.shapes.element_mesh import Tetrahedra, Triangles
from libmpm._src.shapes.particle_placement import Columns, Sampling
from libmpm._src.shapes.point_file import PointFile

__all__ = ["HEAD", "SCHEMA", "Body", "Boundary", "PlacedSensor", "SceneData"]

#: Version of the scene files.
SCHEMA = 1

#: Part of a cell by which the domain's width may differ from a whole number of cells.
_WHOLE = 1e-6

T = TypeVar("T", bound=Value)


#: Arguments of `Scene`, in the order of its files.
HEAD: dict[str, Given] = {
    "name": Given("for titles and files", range="text"),
    "dimension": Given(
        "2 is plane strain of unit thickness; None = 3, 2 with a `grid`", range="2, 3"
    ),
    "cell_size": Given("edge Δx of the square or cubic cells of the grid", unit="m", above=0),
    "lower": Given("lower corner of the domain, relative to `origin`", unit="m", shape="(d,)"),
    "upper": Given("upper corner, a whole number of cells above `lower`", unit="m", shape="(d,)"),
    "grid": Given(
        "of `libmpm.grids`: triangles or splines in place of square cells, in 2D on the CPU; cell "
        "size and corners come from it",
        range="a grid",
    ),
    "origin": Given(
        "world position of coordinate zero; None = zero. All coordinates of the scene are relative "
        "to it",
        unit="m",
        shape="(d,)",
    ),
    "gravity": Given(
        "vector or `TimeTable` of vectors; None = no gravity", unit="m/s²", shape="(d,)"
    ),
    "method": Given("numerical choices", range="`Method`"),
    "start": Given("what the scene continues from; set by `from_checkpoint` alone", scales=FIXED),
}


class SceneData:
    """A scene as a pure value: what every part of libmpm annotates, validates, lowers and draws.

    `Scene` adds what users do with one; its docstring has the table of arguments. Scenes compare
    equal when all their values do, can be pickled, and have `to_dict`.
    """

    @keywords_only("Scene", instead={"grid": ("cell_size", "lower", "upper")})
    def __init__(
        self,
        *,
        dimension: int | None = None,
        cell_size: float | None = None,
        lower: Sequence[float] | None = None,
        upper: Sequence[float] | None = None,
        grid: TriangularGrid | SplineGrid | None = None,
        origin: Sequence[float] | None = None,
        gravity: Sequence[float] | TimeTable | None = None,
        method: Method | None = None,
        name: str = "",
        start: Start | None = None,
    ) -> None:
        """See the class."""
        check = Checker(f"Scene '{name}'" if isinstance(name, str) and name else "Scene")
        if dimension is None:
            dimension = 3 if grid is None else 2
        whole = isinstance(dimension, numbers.Real) and not isinstance(dimension, bool)
        if not whole or dimension not in (2, 3):
            check.fail(f"dimension is {shown(dimension)}; expected 2 or 3")
            check.finish()
        d = int(dimension)
        self._dimension = d
        self._grid = grid
        given = {"cell_size": cell_size, "lower": lower, "upper": upper}
        if grid is None:
            self._cell_size = check.number(
                "cell_size", cell_size, lower=0, lower_open=True, unit="m"
            )
            self._lower = check.vector("lower", lower, lengths=(d,), unit="m")
            self._upper = check.vector("upper", upper, lengths=(d,), unit="m")
        else:
            self._take_grid(check, grid, given)
        zero = (0.0,) * d
        self._origin = (
            zero if origin is None else check.vector("origin", origin, lengths=(d,), unit="m")
        )
        self._gravity: tuple[float, ...] | TimeTable
        if isinstance(gravity, TimeTable):
            check_vector_table(check, "gravity", gravity, d, "m/s²")
            self._gravity = gravity
        elif gravity is None:
            self._gravity = zero
        else:
            self._gravity = check.vector("gravity", gravity, lengths=(d,), unit="m/s²")
        self._method = Method() if method is None else method
        check.instance("method", self._method, (Method,), "Method(...)")
        self._start = start
        if start is not None:
            check.instance("start", start, (Start,), "what Scene.from_checkpoint gives")
        self._name = check.text("name", name, empty=True)
        self._cells = (grid.cells,) if grid is not None else self._count_cells(check)
        self._bodies: dict[str, Body] = {}
        self._found_transfer: tuple[tuple[Any, ...], Transfer] | None = None
        self._boundaries: dict[str, Boundary] = {}
        self._sensors: dict[str, PlacedSensor] = {}
        self._flows: dict[str, PlacedFlow] = {}
        self._contacts: dict[str, Contact] = {}
        check.finish()

    def _take_grid(
        self, check: Checker, grid: TriangularGrid | SplineGrid, given: Mapping[str, Any]
    ) -> None:
        """Take the corners of the domain from a grid of functions."""
        kinds = (TriangularGrid, SplineGrid)
        check.instance("grid", grid, kinds, "a grid of libmpm.grids")
        check.finish()
        for key, item in given.items():
            if item is not None:
                check.fail(f"{key} is {shown(item)} with a grid, which has its own; leave it out")
        if self._dimension != 2:
            check.fail(
                f"dimension is {self._dimension} with {shown(grid)}; expected 2; leave it out"
            )
            check.finish()
        self._cell_size = grid.spacing
        self._lower, self._upper = tuple(grid.lower), tuple(grid.upper)

    def _count_cells(self, check: Checker) -> tuple[int, ...]:
        if not (self._lower and self._upper and self._cell_size > 0):
            return ()
        cells = []
        for a, (low, high) in enumerate(zip(self._lower, self._upper, strict=True)):
            if high <= low:
                check.fail(
                    f"upper[{a}] is {high:g} with lower[{a}] {low:g}; expected upper > lower"
                )
                continue
            width = (high - low) / self._cell_size
            if math.isinf(width):
                check.fail(
                    f"the domain is {high - low:g} m wide on axis {a} with cells of "
                    f"{self._cell_size:g} m; expected fewer than 1.8e308 of them"
                )
                continue
            n = max(1, round(width))
            if abs(width - n) > _WHOLE:
                check.fail(
                    f"the domain is {width:.6g} cells wide on axis {a}; expected a whole number; "
                    f"use upper[{a}] = {low + n * self._cell_size:.9g}"
                )
            cells.append(n)
        return tuple(cells)

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self._dimension

    @property
    def grid(self) -> TriangularGrid | SplineGrid | None:
        """The grid of triangles or splines; None where the cells are squares or cubes."""
        return self._grid

    @property
    def cell_size(self) -> float:
        """Edge of a cell, m; the shortest of a `grid`."""
        return self._cell_size

    @property
    def lower(self) -> tuple[float, ...]:
        """Lower corner of the domain relative to `origin`, m."""
        return self._lower

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper corner of the domain relative to `origin`, m."""
        return self._upper

    @property
    def origin(self) -> tuple[float, ...]:
        """World position of coordinate zero, m."""
        return self._origin

    @property
    def gravity(self) -> tuple[float, ...] | TimeTable:
        """Acceleration of gravity, m/s²."""
        return self._gravity

    @property
    def method(self) -> Method:
        """Numerical choices."""
        return self._method

    @property
    def transfer(self) -> Transfer:
        """The transfer of bodies that name none: the method's, or what suits the scene.

        AFLIP with flip 0.99 where a fluid flows past a structure, that is a boundary at rest along
        which it slips and that is neither a wall of the domain nor a bed through all of it; with
        flip 0.95 where a body is of DruckerPrager; APIC elsewhere.
        """
        from libmpm._src.scene.default_transfer import default_transfer

        given = self._method.transfer
        if isinstance(given, Transfer):
            return given
        # Each of thousands of bodies asks. Parts are values: where all are those that it was found
        # for, so is what was found.
        parts = (self.bodies, self.boundaries)
        if self._found_transfer is None or self._found_transfer[0] != parts:
            self._found_transfer = (parts, default_transfer(self))
        return self._found_transfer[1]

    @property
    def name(self) -> str:
        """Name for titles and files."""
        return self._name

    @property
    def start(self) -> Start | None:
        """The checkpoint that the scene continues from; None of a scene of its own."""
        return self._start

    @property
    def cells(self) -> tuple[int, ...]:
        """Number of cells on each axis; of a `grid` its one number of cells."""
        return self._cells

    @property
    def bodies(self) -> tuple[Body, ...]:
        """The bodies in the order in which they were added."""
        return tuple(self._bodies.values())

    @property
    def boundaries(self) -> tuple[Boundary, ...]:
        """The boundaries in the order in which they were added."""
        return tuple(self._boundaries.values())

    @property
    def sensors(self) -> tuple[PlacedSensor, ...]:
        """The sensors (`name`, `sensor`) in the order in which they were added."""
        return tuple(self._sensors.values())

    @property
    def flows(self) -> tuple[PlacedFlow, ...]:
        """Inflows and outflows (`name`, `flow`) in the order in which they were added."""
        return tuple(self._flows.values())

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts (`name`, `between`, `law`) in the order in which they were added."""
        return tuple(self._contacts.values())

    @documents(
        Body,
        sampling=dataclasses.replace(
            declared(Body)["sampling"],
            meaning="`shapes.Columns`, `Jitter` or `PoissonDisk` in place of the plain lattice, "
            'None; "default" is columns for fluids under gravity in a box without what is no box, '
            "as `shapes.basin` makes it, else the lattice",
        ),
    )
    @keywords_only("Scene.add_body")
    def add_body(
        self,
        *,
        name: str,
        shape: Solid | PointFile | Tetrahedra | Triangles | Cells | Points,
        material: Material,
        particles_per_cell: int | None = None,
        velocity: Sequence[float] | Field | None = None,
        fbar: FBar | Literal["default"] | None = "default",
        hydrostatic: float | None = None,
        subtract_from: Sequence[str] = (),
        lattice: Sequence[int] | None = None,
        stress: Sequence[float] | Field | None = None,
        tractions: Sequence[Traction] = (),
        pins: Sequence[Pin] = (),
        transfer: Transfer | None = None,
        sampling: Sampling | Literal["default"] | None = "default",
        smoothing: Smoothing | None = None,
        assumed: AssumedFields | None = None,
        damping: float = 0.0,
        force: PlacedForce | None = None,
    ) -> str:
        """Add a body and return its name.

        {fields}

        Raises `SceneError`; `validate` checks what concerns several objects.
        """
        if particles_per_cell is None:
            particles_per_cell = 2**self._dimension
        body = Body(
            name=name,
            shape=shape,
            material=material,
            particles_per_cell=particles_per_cell,
            velocity=(0.0,) * self._dimension if velocity is None else velocity,
            fbar=fbar,
            hydrostatic=hydrostatic,
            subtract_from=subtract_from,
            lattice=lattice,
            stress=stress,
            tractions=tractions,
            pins=pins,
            transfer=transfer,
            sampling=self._placed(shape, material, lattice)
            if isinstance(sampling, str) and sampling == "default"
            else sampling,
            smoothing=smoothing,
            assumed=assumed,
            damping=damping,
            force=force,
        )
        return _insert(self._bodies, "body", body.name, body)

    def _placed(
        self, shape: object, material: Material, lattice: Sequence[int] | None
    ) -> Sampling | None:
        """Return how a body is filled by default: fluids above an uneven bed in columns.

        A lattice ends in stairs there: it cost 7 cm of level and 1.7 s at a gauge of a flume.
        """
        pull = self._gravity
        heavy = isinstance(pull, TimeTable) or any(pull)
        fluid = isinstance(material, Material) and material.table.stores_volume
        return Columns() if fluid and heavy and lattice is None and has_bed(shape) else None

    @documents(Boundary)
    @keywords_only("Scene.add_boundary")
    def add_boundary(
        self,
        *,
        name: str,
        shape: Solid | DomainWalls | Outline,
        response: Response | Mapping[str, Response],
        motion: TimeTable | Displacement | Travel | None = None,
        time: tuple[float, float] | None = None,
        layer: DecayLayer | None = None,
        rotation: Rotation | None = None,
        within: Box | None = None,
        spacing: float | None = None,
        bodies: Sequence[str] = (),
        uplift: bool = False,
    ) -> str:
        """Add a boundary and return its name.

        {fields}

        A `Box` with a layer, a rotation, a spacing or a motion of its shape is a surface too.

        `uplift`: of a bed at rest, of held nodes, for solids of one density (`docs/boundaries.md`).

        Raises `SceneError`; `validate` checks what concerns several objects.
        """
        boundary = Boundary(
            name=name, shape=shape, response=response, motion=motion, time=time, layer=layer,
            rotation=rotation, within=within, spacing=spacing, bodies=bodies, uplift=uplift,
        )  # fmt: skip
        return _insert(self._boundaries, "boundary", boundary.name, boundary)

    @documents(PlacedSensor)
    @keywords_only("Scene.add_sensor")
    def add_sensor(self, *, name: str, sensor: Sensor) -> str:
        """Add a value of `libmpm.sensors` under a name unique among sensors; return the name.

        Raises `SceneError`; `validate` checks what concerns several objects.
        """
        return _insert(self._sensors, "sensor", name, PlacedSensor(name=name, sensor=sensor))

    @documents(PlacedFlow)
    @keywords_only("Scene.add_flow")
    def add_flow(self, *, name: str, flow: Flow) -> str:
        """Add a `boundaries.Inflow` or `Outflow` under a name unique among both; return the name.

        Raises `SceneError`; `validate` checks what concerns several objects.
        """
        return _insert(self._flows, "flow", name, PlacedFlow(name=name, flow=flow))

    @documents(Contact)
    @keywords_only("Scene.add_contact")
    def add_contact(self, *, name: str, between: Sequence[str], law: ContactLaw) -> str:
        """Let bodies push, slide and separate by a law of `libmpm.contacts`; return the name.

        {fields}

        Each body that a contact names has a field of velocities of its own; those that none names
        share one. Two bodies without a law move as one where they share nodes. A pair has one law.
        On the CPU, with plain quadratic splines. Raises `SceneError`; `validate` checks what
        concerns several objects.
        """
        contact = Contact(name=name, between=between, law=law)
        return _insert(self._contacts, "contact", contact.name, contact)

    def to_dict(self) -> dict[str, Any]:
        """Return the scene in terms of JSON; "libmpm" is the version of the schema."""
        head = {"libmpm": SCHEMA} | {key: plain(getattr(self, key)) for key in self._head()}
        parts = {
            kind: [{k: v for k, v in p.to_dict().items() if k != "type"} for p in placed]
            for kind, placed in self._parts().items()
        }
        return head | parts

    def _head(self) -> tuple[str, ...]:
        """Return the arguments that make this scene."""
        left_out = {"grid"} if self._grid is None else {"cell_size", "lower", "upper"}
        if self._start is None:
            left_out.add("start")
        return tuple(key for key in HEAD if key not in left_out)

    def _by_kind(self) -> dict[str, dict[str, Any]]:
        """Return the parts by name, of each kind: what `changes` changes."""
        return {
            "body": self._bodies, "boundary": self._boundaries, "sensor": self._sensors,
            "flow": self._flows, "contact": self._contacts,
        }  # fmt: skip

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take a pickle, of a version before contacts too."""
        self.__dict__.update({"_contacts": {}} | state)

    def _parts(self) -> dict[str, Sequence[Value]]:
        parts: dict[str, Sequence[Value]] = {
            "bodies": self.bodies,
            "boundaries": self.boundaries,
            "sensors": self.sensors,
        }
        # Files of scenes without any stay as they were.
        parts |= {"flows": self.flows} if self._flows else {}
        return parts | ({"contacts": self.contacts} if self._contacts else {})

    def _identity(self) -> tuple[Any, ...]:
        return (*(getattr(self, key) for key in HEAD), *self._parts().values())

    def __eq__(self, other: object) -> bool:
        """Compare all values."""
        if not isinstance(other, SceneData):
            return NotImplemented
        return self._identity() == other._identity()

    __hash__ = None  # type: ignore[assignment]  # a scene grows with add_body and the like

    def __repr__(self) -> str:
        """Return a line with the scene's size."""
        return f"<Scene {self.name!r}: {self._in_short()}>"

    def _in_short(self) -> str:
        """Return dimension, cells and numbers of parts in words."""
        counts = (
            (len(self._bodies), "body", "bodies"),
            (len(self._boundaries), "boundary", "boundaries"),
            (len(self._sensors), "sensor", "sensors"),
        )
        parts = ", ".join(f"{n} {one if n == 1 else many}" for n, one, many in counts)
        cells = " × ".join(map(str, self.cells))
        return f"{self.dimension}D, {cells} cells of {self.cell_size:g} m, {parts}"


def _insert(placed: dict[str, T], kind: str, name: str, item: T) -> str:
    if name in placed:
        raise SceneError(
            f"{kind} '{name}': the name is taken; names are unique; choose another, "
            f"for instance '{name}-2'"
        )
    placed[name] = item
    return name
