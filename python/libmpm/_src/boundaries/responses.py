"""`Slip`, `Sticky`, `Separable` and the other walls, and how boundaries move.

v is the velocity relative to the boundary, n the normal that points into the material.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, Value, sequence, shown, value

__all__ = ["DecayLayer", "Displacement", "Mirror", "Prescribed", "Response", "Rotation"]
__all__ += ["Separable", "Slip", "Sticky", "Travel", "decay_thickness"]


class Response(Value):
    """Base of all boundary responses."""

    #: Name of the response in the engine.
    kind: ClassVar[str]

    @property
    def friction(self) -> tuple[float, float]:
        """Static and dynamic coefficient of Coulomb friction."""
        return (0.0, 0.0)

    @property
    def asks_for_linear(self) -> bool:
        """Whether it names linear cells; of "auto" `wall_cells.strains_linearly` knows."""
        return getattr(self, "cell", "held") == "linear"


def _check_cell(check: Checker, cell: Any) -> None:
    check.choice("cell", cell, ("auto", "held", "linear"))


@value
class Sticky(Response):
    """No relative motion at all: v = 0."""

    label: ClassVar[str] = "boundaries.Sticky"
    kind: ClassVar[str] = "sticky"


@value
class Slip(Response):
    """No relative motion along the normal, free along the face: v·n = 0.

    Material cannot come off such a face; use `Separable` where it may, or with friction.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Slip"
    kind: ClassVar[str] = "slip"

    cell: Literal["auto", "held", "linear"] = given(
        '"held": the wall holds nodes, one by one, and the cells beside it strain by half: '
        'their pressure in a flow is wrong. "linear": the velocity towards the wall is '
        "linear in its cell and meets the wall's in the plane of the wall "
        '(`design/walls.md`, 7), with quadratic functions. "auto": "linear" for walls, boxes '
        "and planes of surfaces, level or less than 45 degrees steep, that rest, three cells and "
        "more from where something that moves may come, in a scene with a fluid whose method "
        'allows it, else "held", as for round surfaces. Beside contacts only level ones are '
        "linear, and for fluids alone.",
        default="auto",
        range='"auto", "held" or "linear"',
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        _check_cell(check, self.cell)
        return {}


@value
class Separable(Response):
    """Material may leave but not enter: v·n ≥ 0, with Coulomb friction while pressed on.

    {fields}

    With `cell` "linear" the reaction of a whole line of nodes decides whether material leaves, and
    friction is judged by that reaction. The static coefficient may not be below the dynamic one.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Separable"
    kind: ClassVar[str] = "separable"

    static_friction: float = given(
        "sticks while tangential ≤ static · normal impulse", default=0.0, unit="1", low=0
    )
    dynamic_friction: float = given(
        "tangential = dynamic · normal impulse while sliding", default=0.0, unit="1", low=0
    )
    cell: Literal["auto", "held", "linear"] = given(
        "as of `Slip`", default="auto", range='"auto", "held" or "linear"'
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        _check_cell(check, self.cell)
        remedy = "friction opposes sliding; use 0 for a smooth face"
        found = {
            name: check.number(name, getattr(self, name), lower=0, remedy=remedy)
            for name in ("static_friction", "dynamic_friction")
        }
        if found["static_friction"] < found["dynamic_friction"]:
            check.fail(
                f"static_friction is {found['static_friction']:g} with dynamic_friction "
                f"{found['dynamic_friction']:g}; expected static ≥ dynamic, or sliding would be "
                "harder than starting to slide; raise static_friction"
            )
        return found

    @property
    def friction(self) -> tuple[float, float]:
        """Static and dynamic coefficient of Coulomb friction."""
        return (self.static_friction, self.dynamic_friction)


@value
class Mirror(Response):
    """A plane of symmetry: what lies beyond it is the image of what lies before it.

    {fields}

    The plane itself is held, not the nodes beside it, so that the cell at the wall strains like any
    other (`design/walls.md`). For `DomainWalls` alone. A mirror neither rubs nor lets go. Raises
    `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Mirror"

    slip: bool = given(
        "True: material glides along the plane, which is what symmetry is; False: the "
        "tangential velocity is reversed as well, which holds a viscous fluid at the plane",
        default=True,
        range="bool",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("slip", self.slip, (bool,), "True or False")
        return {}

    @property
    def kind(self) -> str:  # type: ignore[override]  # depends on the value
        """Name of the response in the engine."""
        return "mirror" if self.slip else "mirror-sticky"


@value
class Prescribed(Response):
    """A region of the flow with a given velocity: a pump, an inlet, a current.

    {fields}

    Nodes inside the shape take the velocity of the boundary's `motion`, others are not touched.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Prescribed"
    kind: ClassVar[str] = "prescribed"

    components: Literal["all"] | Sequence[str] = given(
        '"all", or the axes on which nodes take the velocity: some of "x", "y", "z"', default="all"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        if isinstance(self.components, str) and self.components == "all":
            return {}
        given = (self.components,) if isinstance(self.components, str) else self.components
        names = sequence(given) or []
        if not names or any(name not in AXES for name in names):
            check.fail(f'components is {shown(self.components)}; expected "all" or some of x, y, z')
            return {}
        return {"components": tuple(a for a in AXES if a in names)}

    def axes(self, dimension: int) -> int:
        """Return the components as a bit mask."""
        names = AXES[:dimension] if self.components == "all" else self.components
        return sum(1 << AXES.index(a) for a in names)


@value
class DecayLayer(Value):
    """How the hold of a surface fades with the distance r of a node from it (Yang 2016, 4.26).

    {fields}

    On and behind the surface all is held. The default holds nodes up to one cell off, so that on
    average over its places in the cells the impermeable surface is the stated one; functions that
    fade let water seep in (`design/walls.md` section 6). Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.DecayLayer"

    function: Literal["constrained", "quadratic", "linear", "flipped", "cosine", "free"] = given(
        'of s = r / (thickness Δx): "constrained" 1, "quadratic" (1-s)², "linear" 1-s, '
        '"flipped" 1-s², "cosine" (1+cos πs)/2, "free" 0',
        default="constrained",
        range="a name",
    )
    thickness: float = given("beyond it nodes are free", default=1.0, unit="cells", above=0, high=4)

    def _check(self, check: Checker) -> dict[str, Any]:
        names = ("constrained", "quadratic", "linear", "flipped", "cosine", "free")
        return {
            "function": check.choice("function", self.function, names),
            "thickness": check.given("thickness", self),
        }


@keywords_only("boundaries.decay_thickness", 2, method=False)
def decay_thickness(cell: Sequence[float], normal: Sequence[float]) -> float:
    """Return the thickness h, m, of one cell's decay layer along a normal, in rectangular cells.

    h = √(Σ l² n²) with the edges l (d,) m of a cell and the unit normal n of the wall; `normal`
    (d,) may have any length but 0. In square cells it is their edge at any angle, which is a
    `DecayLayer` of thickness 1: the function is for what was done in other cells. Raises
    `SceneError`. Source: Yang (2016), eq. 4.25, printed with n instead of its square.
    """
    check = Checker("boundaries.decay_thickness")
    edges = check.vector("cell", cell, unit="m")
    direction = check.vector("normal", normal)
    if any(x <= 0 for x in edges):
        check.fail(f"cell is {tuple(cell)!r}; expected edges > 0 m")
    if direction and not any(direction):
        check.fail("normal is 0; expected a direction")
    if not check.problems and len(edges) != len(direction):
        check.fail(f"cell has {len(edges)} numbers and normal {len(direction)}; expected as many")
    check.finish()
    length = math.hypot(*direction)
    return math.hypot(*(x * n / length for x, n in zip(edges, direction, strict=True)))


@value(kw_only=False)
class Displacement(Value):
    """A shape that moves by a table of places: how far it is, in m, from where it is stated.

    {fields}

    The velocity is the slope between rows. Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Displacement"

    table: TimeTable = given(
        "how far the shape is from where it is stated: `TimeTable` of rows (d,) that ends "
        'with "hold" or "repeat"',
        unit="m",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("table", self.table, (TimeTable,), "a TimeTable of vectors in m")
        if isinstance(self.table, TimeTable) and self.table.end == "zero":
            check.fail(
                "table ends with 'zero', which would throw the shape back to its place; expected "
                "'hold' or 'repeat'; add rows that bring it back"
            )
        return {}


@value(kw_only=False)
class Travel(Value):
    """A shape that moves with a velocity: a vector (d,) or a `TimeTable` of vectors, m/s.

    {fields}

    A `TimeTable` given as `motion` itself moves no shape: it is a velocity that its face has, like
    a conveyor's. Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Travel"

    velocity: Sequence[float] | TimeTable = given(
        "of the shape: a vector, or a `TimeTable` of vectors", unit="m/s", shape="(2|3,)"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        if isinstance(self.velocity, TimeTable):
            return {}
        return {"velocity": check.given("velocity", self)}


@value
class Rotation(Value):
    """A shape that turns about a point: by a rate or by a table of angles, right-handed.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "boundaries.Rotation"

    about: Sequence[float] = given(
        "the fulcrum at time 0, relative to the scene's `origin`; it goes where the shape's "
        "`motion` takes it",
        unit="m",
        shape="(2|3,)",
    )
    rate: float | TimeTable | None = given(
        "a number or a `TimeTable` of numbers", default=None, unit="rad/s"
    )
    degrees: TimeTable | None = given(
        "`TimeTable` of angles, in place of `rate`", default=None, unit="degrees", range="a table"
    )
    angle: TimeTable | None = given(
        "the same in radians, as in version 0.1; warns, and goes in 0.3",
        default=None,
        unit="rad",
        range="a table",
    )
    axis: str | Sequence[float] | None = given(
        '"x", "y", "z" or a direction; None = "z". Left out in 2D',
        default=None,
        unit="1",
        shape="(3,)",
        range="or a name",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        about = check.given("about", self)
        tables = {"degrees": self.degrees, "angle": self.angle}
        if sum(x is not None for x in (self.rate, *tables.values())) != 1:
            check.fail(
                f"rate is {shown(self.rate)} with degrees {shown(self.degrees)} and "
                f"angle {shown(self.angle)}; expected one of them; give a rate in "
                "rad/s, or a TimeTable of angles in degrees"
            )
        for name, table in (("rate", self.rate), *tables.items()):
            if isinstance(table, TimeTable) and table.components:
                check.fail(f"{name} has rows of {table.components} numbers; expected plain numbers")
        found: dict[str, Any] = {"about": about}
        if self.rate is not None and not isinstance(self.rate, TimeTable):
            found["rate"] = check.given("rate", self)
        for name, table in tables.items():
            if table is None:
                continue
            check.instance(name, table, (TimeTable,), "a TimeTable of angles in degrees")
            if isinstance(table, TimeTable) and table.end == "zero":
                check.fail(f"{name} ends with 'zero', a jump; expected 'hold' or 'repeat'")
        if self.angle is not None:
            warnings.warn(
                "boundaries.Rotation: angle, in radians, is degrees=TimeTable(...) since version "
                "0.2, in degrees as every other angle; it goes in 0.3",
                DeprecationWarning,
                stacklevel=4,
            )
        if self.axis is not None and len(about) == 2:
            check.fail(
                f"axis is {shown(self.axis)} in 2D, where shapes turn in the plane; leave it out"
            )
        elif isinstance(self.axis, str):
            found["axis"] = check.choice("axis", self.axis, AXES)
        elif self.axis is not None:
            axis = check.given("axis", self)
            if axis and not any(axis):
                check.fail("axis is (0, 0, 0); expected a direction")
            found["axis"] = axis
        return found

    def radians(self) -> TimeTable | None:
        """Return the table of angles in rad; None of a turn by a rate."""
        if self.degrees is None:
            return self.angle
        found = np.radians(np.asarray(self.degrees.value, dtype=np.float64))
        return TimeTable(self.degrees.time, found, end=self.degrees.end)

    def direction(self) -> tuple[float, ...]:
        """Return the axis as a unit vector (3,)."""
        if self.axis is None or isinstance(self.axis, str):
            k = 2 if self.axis is None else AXES.index(self.axis)
            return tuple(float(a == k) for a in range(3))
        length = math.hypot(*self.axis)
        return tuple(x / length for x in self.axis)
