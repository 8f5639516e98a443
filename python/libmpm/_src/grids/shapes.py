"""`Cells`, `Points`, `Outline`; `Traction`, `Pin`: on such grids, and on surfaces of bodies."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from libmpm._src.base.arrays import real_array
from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable, check_vector_table
from libmpm._src.base.values import Checker, Value, sequence, shown, value
from libmpm._src.boundaries.responses import Displacement
from libmpm._src.shapes.boxes import Box, Shape, faces_of

__all__ = ["Cells", "Outline", "Pin", "Points", "Traction"]


def _points(check: Checker, name: str, given: Any, least: int) -> tuple[tuple[float, ...], ...]:
    """Return rows of two finite numbers, at least so many."""
    try:
        array = real_array(given, name)
    except (OverflowError, TypeError, ValueError):
        check.fail(f"{name} is {shown(given, 80)}; expected rows of two numbers in m")
        return ()
    if array.ndim != 2 or array.shape[1] != 2:
        check.fail(f"{name} has the shape {array.shape}; expected (n, 2) in m")
        return ()
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        check.fail(f"{name}[{bad[0]}] is not finite; expected two numbers in m")
        return ()
    if len(array) < least:
        check.fail(f"{name} has {len(array)} rows; expected {least} or more")
    return tuple(tuple(row) for row in array.tolist())


@value
class Cells(Shape):
    """The triangles of the grid's mesh, or those inside a polygon, as a body.

    {fields}

    Every triangle is filled with the same number of particles, `particles_per_cell`, a square
    number k²: at the centres of k² equal triangles, each with its exact area. Equal numbers keep
    the quadrature error small. Raises `SceneError`. Source: de Koster (2018) 2.3.
    """

    label: ClassVar[str] = "shapes.Cells"

    within: Sequence[Sequence[float]] | None = given(
        "corners of a polygon; triangles whose centre lies inside belong to the body. None = all",
        default=None,
        unit="m",
        shape="(k, 2)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        if self.within is None:
            return {}
        return {"within": _points(check, "within", self.within, 3)}

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return 2


@value
class Points(Shape):
    """Given particles as a body.

    {fields}

    Raises `SceneError`. Source: de Koster (2018) 2.3.
    """

    label: ClassVar[str] = "shapes.Points"

    position: Sequence[Sequence[float]] = given(
        "where they are, inside the grid", unit="m", shape="(n, 2)"
    )
    volume: Sequence[float] | None = given(
        "area of each; None = of its Voronoi cell", default=None, unit="m²", shape="(n,)"
    )
    within: Sequence[Sequence[float]] | None = given(
        "corners of a polygon: Voronoi cells are cut at the outline of the triangles whose "
        "centres lie inside. None = all",
        default=None,
        unit="m",
        shape="(k, 2)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        points = _points(check, "position", self.position, 1)
        within = None if self.within is None else _points(check, "within", self.within, 3)
        volume = self.volume
        if volume is not None:
            try:
                areas = real_array(volume, "volume")
            except (OverflowError, TypeError, ValueError):
                areas = np.empty(())
            if areas.shape != (len(points),):
                check.fail(
                    f"volume has the shape {areas.shape}; expected ({len(points)},), one a particle"
                )
            elif not (np.all(np.isfinite(areas)) and np.all(areas > 0)):
                bad = int(np.flatnonzero(~(np.isfinite(areas) & (areas > 0)))[0])
                check.fail(f"volume[{bad}] is {areas[bad]:g}; expected > 0 m²")
            volume = tuple(areas.ravel().tolist())
            if within is not None:
                check.fail("volume and within are given; expected one: within is for Voronoi cells")
        return {"position": points, "volume": volume, "within": within}

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return 2


@value
class Outline(Shape):
    """A part of the outline of the grid's mesh as a boundary.

    {fields}

    Raises `SceneError`.
    """

    label: ClassVar[str] = "shapes.Outline"

    points: Sequence[Sequence[float]] = given(
        "a line of straight parts along the outline; the edges of the mesh that lie on it are held",
        unit="m",
        shape="(k, 2)",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        points = _points(check, "points", self.points, 2)
        if any(a == b for a, b in pairwise(points)):
            check.fail("points has the same point twice in a row; leave one out")
        return {"points": points}

    @property
    def dimension(self) -> int:
        """Number of axes."""
        return 2

    def segments(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the straight parts, (k - 1, 4): x and y of both ends, m."""
        points = np.asarray(self.points, dtype=np.float64)
        return np.hstack([points[:-1], points[1:]])


def _check_place(
    check: Checker, part: Traction | Pin, bounds_of: str, around: str
) -> dict[str, Any]:
    """Check an end of a body's bounds, a box, or both, of which one is needed."""
    told: dict[str, Any] = {}
    if part.face is not None:
        told["face"] = check.choice("face", part.face, faces_of(3))
    elif part.within is None:
        check.fail(
            f"face and within are missing; expected one of them or both: {bounds_of} "
            f"bounds, or within=shapes.Box(lower=, upper=) around {around}"
        )
    if part.within is not None:
        check.instance("within", part.within, (Box,), "shapes.Box(lower=..., upper=...)")
    return told


def _misplaced(part: Traction | Pin, dimension: int) -> list[str]:
    """Return what of its place is not of this dimension."""
    found = []
    if part.face is not None and part.face not in faces_of(dimension):
        found.append(f"face is {part.face!r} in {dimension}D; expected "
                     f"{', '.join(faces_of(dimension))}")  # fmt: skip
    if part.within is not None and part.within.dimension != dimension:
        found.append(f"within is a box in {part.within.dimension}D; expected {dimension}D")
    return found


@value
class Traction(Value):
    """A force on a part of the surface of a body of elements, or of a box on a grid of functions.

    {fields}

    Of a body of elements (`shapes.Tetrahedra`, `Triangles`) it acts on outer faces with all
    vertices at the end of the mesh's bounds that `face` names, or in `within`, or both where both
    are given: on vertex a with f_a = Σ A t / d over these faces, A their area at rest, so that the
    sum is ∫ t dA. It is a dead load: it keeps direction and size however the body moves. On a
    `grid` it acts on one face of a `shapes.Box`: each particle next to it stands for an equal part
    of its length and keeps that force wherever it goes. Raises `SceneError`; the scene refuses one
    that no face answers to. Source: de Koster (2018) eq. 2.28.
    """

    label: ClassVar[str] = "Traction"

    face: str | None = given(
        '"x-", "x+", "y-", "y+" and in 3D "z-" or "z+": an end of the body\'s bounds at the start. '
        "None = of elements, what lies in `within`",
        default=None,
        range="a name",
    )
    value: Sequence[float] | TimeTable = given(
        "force per area, or a `TimeTable` of it", unit="Pa", shape="(2|3,)"
    )
    within: Box | None = given(
        "of elements: a `shapes.Box` that holds all vertices of the faces at rest, on its faces "
        "too. None = all that `face` names",
        default=None,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        told = _check_place(check, self, "face='x+' of a body's", "a part of a mesh's surface")
        if isinstance(self.value, TimeTable):
            if self.value.components not in (2, 3):
                check_vector_table(check, "value", self.value, 3, "Pa")
            return told
        return told | {"value": check.given("value", self)}

    def _misfits(self, dimension: int) -> list[str]:
        """Return what of it is not of this dimension."""
        found = []
        if isinstance(self.value, TimeTable):
            components: int | None = self.value.components
        else:
            components = len(self.value)
        if components != dimension:
            found.append(f"value has {components} numbers; expected {dimension}, in Pa")
        return found + _misplaced(self, dimension)


@value
class Pin(Value):
    """Vertices of a body of elements that are held where they are, or driven.

    {fields}

    All vertices at the end of the mesh's bounds that `face` names, or in `within`, or both where
    both are given. Each takes the velocity (u(t + Δt) - u) / Δt along the named axes, u its
    displacement, and nothing of what the grid gives it; the momentum by which that differs from
    what it would have kept is the pin's push, which `sensors.PinForce` reads. Held nodes
    (`boundaries.Prescribed` on a region) hold what lies within a cell of them as well; pins hold
    the vertices alone. Raises `SceneError`; the scene refuses one that no vertex answers to, and
    two with a vertex in common.
    """

    label: ClassVar[str] = "grids.Pin"

    face: str | None = given(
        '"x-", "x+", "y-", "y+" and in 3D "z-" or "z+": an end of the mesh\'s bounds at the start. '
        "None = what lies in `within`",
        default=None,
        range="a name",
    )
    within: Box | None = given(
        "a `shapes.Box` that holds the vertices at rest, on its faces too. None = all that `face` "
        "names",
        default=None,
    )
    motion: Displacement | None = given(
        "`boundaries.Displacement`: how far they are from their places at rest. None = nowhere",
        default=None,
    )
    components: str | Sequence[str] = given(
        '"all", or the axes along which they are held, ("x",)', default="all", range="names"
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        told = _check_place(check, self, "face='x-' of a mesh's", "the vertices")
        if self.motion is not None:
            example = "boundaries.Displacement(TimeTable(...)) or None"
            check.instance("motion", self.motion, (Displacement,), example)
        if self.components == "all":
            return told
        axes = (self.components,) if isinstance(self.components, str) else self.components
        chosen = sequence(axes)
        if not chosen or len(set(chosen)) != len(chosen) or not set(chosen) <= set("xyz"):
            check.fail(
                f"components is {shown(self.components)}; expected 'all', or some of 'x', 'y' and "
                "'z', each once"
            )
            return told
        return told | {"components": tuple(chosen)}

    def axes(self, dimension: int) -> tuple[int, ...]:
        """Return the numbers of the axes along which it holds."""
        if self.components == "all":
            return tuple(range(dimension))
        return tuple(sorted("xyz".index(name) for name in self.components))

    def _misfits(self, dimension: int) -> list[str]:
        """Return what of it is not of this dimension."""
        found = _misplaced(self, dimension)
        if max(self.axes(dimension)) >= dimension:
            found.append(f"components is {self.components!r}; expected axes of {dimension}D")
        if self.motion is not None and self.motion.table.components != dimension:
            found.append(
                f"motion has {self.motion.table.components} numbers; expected {dimension}, in m"
            )
        return found
