"""`Tetrahedra` and `Triangles`: bodies of finite elements, whose vertices move with the grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np
import numpy.typing as npt

from libmpm._src.base.axes import AXES
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, keywords_only, shown, value
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.oriented_boxes import rotation
from libmpm._src.shapes.solid import Array, GivenPoints, Solid
from libmpm._src.shapes.surface_mesh import SurfaceMesh

__all__ = ["ElementMesh", "Tetrahedra", "Triangles"]

Numbers = npt.NDArray[np.int64]

#: What may be said about volumes, and Poisson's ratio from which "vertex" is meant by None.
VOLUMES = ("element", "vertex")
LOCKS = 0.4
_MESHERS = ("auto", "lattice", "gmsh")


class ElementMesh(GivenPoints):
    """What `Tetrahedra` and `Triangles` have in common."""

    holds_arrays: ClassVar[bool] = True
    #: Number of axes.
    _d: ClassVar[int]

    vertices: Any
    elements: Any
    volumes: Literal["element", "vertex"] | None

    def _check(self, check: Checker) -> dict[str, Any]:
        if self.volumes is not None:
            check.choice("volumes", self.volumes, VOLUMES)
        # Here and below: a scene without elements loads none of it.
        from libmpm._src.shapes import element_checks

        found = element_checks.check_mesh(check, self.vertices, self.elements, self._d)
        if found is None:
            return {}
        vertices, elements = found[0], found[1].astype(np.int32)
        vertices.setflags(write=False)
        elements.setflags(write=False)
        return {"vertices": vertices, "elements": elements}

    # Making ----------------------------------------------------------------------------------

    @classmethod
    def _of(cls, mesh: tuple[Array, Numbers], volumes: Any) -> Self:
        return cls(vertices=mesh[0], elements=mesh[1], volumes=volumes)  # type: ignore[call-arg]

    @classmethod
    @keywords_only("{}.box")
    def box(
        cls,
        *,
        lower: Sequence[float],
        upper: Sequence[float],
        edge: float,
        pattern: Literal["alternating", "one-way"] = "alternating",
        volumes: Literal["element", "vertex"] | None = None,
    ) -> Self:
        """Cut a box into cubes of at most `edge` m, each into six tetrahedra; 2D: two triangles.

        `lower` and `upper` (d,) m are its corners, met exactly. Cubes are mirrored in turn along
        every axis, so that diagonals alternate; "one-way" has all alike, which locks and bends
        more to one side: for tests. `volumes` as of the class. Raises `SceneError`.
        """
        from libmpm._src.shapes import element_lattices

        label = f"{cls.label}.box"
        check = Checker(label)
        low = check.vector("lower", lower, lengths=(cls._d,), unit="m")
        high = check.vector("upper", upper, lengths=(cls._d,), unit="m")
        size = check.number("edge", edge, lower=0, lower_open=True, unit="m")
        check.choice("pattern", pattern, ("alternating", "one-way"))
        check.finish()
        box = Box(lower=low, upper=high)
        counts = _counts(label, box.size, size)
        return cls._of(
            element_lattices.structured(low, high, counts, pattern == "alternating"), volumes
        )

    @classmethod
    @keywords_only("{}.fill")
    def fill(
        cls,
        *,
        solid: Solid,
        edge: float,
        mesher: Literal["auto", "lattice", "gmsh"] = "auto",
        volumes: Literal["element", "vertex"] | None = None,
    ) -> Self:
        """Mesh a solid with edges of at most √d `edge`, m, that is as dense as cubes of `edge`.

        "auto": a Box or OrientedBox as `box` does, exactly; others by gmsh where it is installed
        (`pip install libmpm[elements]`), else by a lattice cut at the surface, whose sharp edges
        are cut off: its volume falls short by 1 to 7 % at 10 edges across (`docs/elements.md`
        has numbers). A SurfaceMesh needs gmsh, unless "lattice" is asked for. Raises `SceneError`.
        """
        label = f"{cls.label}.fill"
        check = Checker(label)
        check.instance("solid", solid, (Solid,), "a solid of libmpm.shapes")
        size = check.number("edge", edge, lower=0, lower_open=True, unit="m")
        check.choice("mesher", mesher, _MESHERS)
        if isinstance(solid, Solid) and solid.dimension != cls._d:
            other = "Triangles" if cls._d == 3 else "Tetrahedra"
            check.fail(f"solid is in {solid.dimension}D; expected {cls._d}D; use shapes.{other}")
        check.finish()
        return cls._of(_filled(solid, size, mesher, label), volumes)

    @classmethod
    @keywords_only("{}.read", 1)
    def read(
        cls,
        path: str | Path,
        *,
        scale: float = 1.0,
        offset: Sequence[float] | None = None,
        weld: bool = False,
        part: int | None = None,
        volumes: Literal["element", "vertex"] | None = None,
    ) -> Self:
        """Read the tetrahedra (2D: triangles) of a file of Gmsh, VTK, Abaqus (.msh, .vtu, .inp).

        By meshio. `scale` turns coordinates into m, `offset` (d,) m is added after that. Vertices
        that no element uses are left out; `weld` makes those at one place one. `part` takes one
        of several parts, 0 the largest. Of quadratic elements the corners count. The scene holds
        the mesh itself and no longer needs the file. Raises `SceneError`.
        """
        from libmpm._src.shapes import element_files

        label = f"{cls.label}.read"
        mesh = element_files.read_mesh(path, cls._d, label)
        return cls._taken(mesh, scale, offset, weld, part, volumes, label)

    @classmethod
    def _taken(
        cls, mesh: tuple[Array, Numbers], scale: Any, offset: Any, weld: Any, part: Any,
        volumes: Any, label: str,
    ) -> Self:  # fmt: skip
        from libmpm._src.shapes import element_files

        check = Checker(label)
        factor = check.number("scale", scale, lower=0, lower_open=True)
        by = (0.0,) * cls._d
        if offset is not None:
            by = check.vector("offset", offset, lengths=(cls._d,), unit="m")
        if not isinstance(weld, bool):
            check.fail(f"weld is {shown(weld)}; expected True or False")
        check.finish()
        vertices, elements = element_files.tidied(*mesh, weld=weld, part=part, label=label)
        return cls._of((vertices * factor + np.asarray(by), elements), volumes)

    # What it is ------------------------------------------------------------------------------

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return self._d

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    def positions(self) -> Array:
        """Return the vertices (n, d), m."""
        return np.asarray(self.vertices, dtype=np.float64)

    def rows(self) -> Numbers:
        """Return the elements (m, d + 1) as 64-bit numbers."""
        return np.asarray(self.elements, dtype=np.int64)

    @cached_property
    def sizes(self) -> npt.NDArray[np.float64]:
        """Volume of each element, (m,) m³ (area in m² in 2D)."""
        from libmpm._src.shapes import element_topology as topology

        return topology.determinants(self.vertices, self.rows()) / math.factorial(self._d)

    def total_volume(self) -> float:
        """Return the volume of all elements, m³ (m² in 2D)."""
        return math.fsum(self.sizes)

    @cached_property
    def longest_edge(self) -> float:
        """Longest edge of all elements, m; √d times the edge of the cubes of a box."""
        from libmpm._src.shapes import element_topology as topology

        return float(topology.longest_edges(self.vertices, self.rows()).max())

    @property
    def edge(self) -> float:
        """Longest edge over √d, m: the edge h of cubes that are cut into such elements."""
        return self.longest_edge / math.sqrt(self._d)

    @cached_property
    def quality(self) -> npt.NDArray[np.float64]:
        """Shortest height of each element over its longest edge, (m,); ≥ 0.1."""
        from libmpm._src.shapes import element_topology as topology

        return topology.qualities(self.vertices, self.rows())

    @cached_property
    def surface(self) -> npt.NDArray[np.int64]:
        """Vertices of the faces outside, (k, d), ordered so that their normals point outwards."""
        from libmpm._src.shapes import element_topology as topology

        found = topology.faces(self.rows())
        return np.asarray(found.corners[found.times[found.number] == 1])

    def volumes_for(self, poissons_ratio: float | None, *, flows: bool = False) -> str:
        """Return "element" or "vertex": `volumes`, or what None means for a material.

        `flows`: it flows at constant volume.
        """
        if self.volumes is not None:
            return self.volumes
        if flows:
            return "vertex"
        return "vertex" if poissons_ratio is not None and poissons_ratio >= LOCKS else "element"

    # Moving ----------------------------------------------------------------------------------

    def _with(self, vertices: Array) -> Self:
        return type(self)._of((vertices, self.rows()), self.volumes)

    def _check_vector(self, name: str, given: Any) -> tuple[float, ...]:
        check = Checker(self.label)
        found = check.vector(name, given, lengths=(self._d,), unit="m")
        check.finish()
        return found

    @keywords_only("{}.moved", 1)
    def moved(self, by: Sequence[float]) -> Self:
        """Return the mesh moved by (d,) m."""
        return self._with(self.vertices + np.asarray(self._check_vector("by", by)))

    @keywords_only("{}.turned", 3)
    def turned(
        self, angle: float, axis: str | None = None, about: Sequence[float] | None = None
    ) -> Self:
        """Return the mesh turned by `angle` degrees, by the right-hand rule.

        From x to y in 2D; in 3D about "x", "y" or "z" (None = "z"). The point `about` (d,) m stays
        where it is; None = the middle of `bounds`.
        """
        check = Checker(self.label)
        degrees = check.number("angle", angle, unit="degrees")
        if axis is not None and self._d == 2:
            check.fail(f"axis is {shown(axis)} in 2D; leave it out")
        elif axis is not None:
            check.choice("axis", axis, AXES)
        check.finish()
        if about is None:
            about = [0.5 * (a + b) for a, b in zip(*self.bounds(), strict=True)]
        centre = np.asarray(self._check_vector("about", about))
        rows = rotation(self._d, degrees, axis)
        away = (self.vertices - centre).T
        turned = [sum(r * x for r, x in zip(row, away, strict=True)) for row in rows]
        return self._with(np.stack(turned, axis=1) + centre)

    # As a value ------------------------------------------------------------------------------

    def _content(self) -> tuple[Any, ...]:
        """Return what is compared: bits of the arrays."""
        return self.vertices.tobytes(), self.elements.tobytes(), self.volumes

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists; "type" names the class."""
        return {
            "type": type(self).__name__,
            "vertices": self.vertices.tolist(),
            "elements": self.elements.tolist(),
            "volumes": self.volumes,
        }

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what can be worked out again."""
        return {name: self.__dict__[name] for name in self._fields}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take a pickle; its arrays are read-only as those of a new value."""
        self.__dict__.update(state)
        for name in ("vertices", "elements"):
            self.__dict__[name].setflags(write=False)

    def __repr__(self) -> str:
        """Return numbers and sizes; the arrays are long."""
        size = " × ".join(f"{b - a:.4g}" for a, b in zip(*self.bounds(), strict=True))
        how = "" if self.volumes is None else f", volumes={self.volumes!r}"
        return (
            f"<{self.label}: {len(self.vertices):,} vertices, {len(self.elements):,} elements in "
            f"{size} m, longest edge {self.longest_edge:.4g} m{how}>"
        )


@value
class Tetrahedra(ElementMesh):
    """A body of linear tetrahedra in 3D, whose vertices move with the grid.

    {fields}

    Stress follows from where the vertices are now and at rest: no numerical fracture, no stress
    between bodies, bending closer to the beam's than that of particles (`docs/elements.md`).
    Elements of negative orientation have their last two vertices exchanged. Refused, by number, are
    elements without volume, with numbers out of range, with a height below 0.1 of the longest edge;
    loose and double vertices; parts that no face joins. `box`, `fill`, `read` and `read_tables`
    make meshes. Raises `SceneError` with every broken rule.
    """

    label: ClassVar[str] = "shapes.Tetrahedra"
    _d: ClassVar[int] = 3

    vertices: Sequence[Sequence[float]] | npt.NDArray[Any] = given(
        "at rest, relative to the scene's `origin`; kept as a read-only array",
        unit="m",
        shape="(n, 3)",
    )
    elements: Sequence[Sequence[int]] | npt.NDArray[Any] = given(
        "vertex numbers from 0, four an element", unit="1", shape="(m, 4)"
    )
    volumes: Literal["element", "vertex"] | None = given(
        '"vertex" averages volumes at vertices, against locking (Bonet and Burton 1998); "element" '
        "does not; None = vertex where Poisson's ratio is 0.4 or more, or the law flows at "
        "constant volume (VonMises)",
        default=None,
    )

    @classmethod
    @keywords_only("shapes.Tetrahedra.read_tables")
    def read_tables(
        cls,
        *,
        vertices: str | Path,
        elements: str | Path,
        first: int = 1,
        scale: float = 1.0,
        offset: Sequence[float] | None = None,
        weld: bool = False,
        part: int | None = None,
        volumes: Literal["element", "vertex"] | None = None,
    ) -> Tetrahedra:
        """Read tables of vertices (x, y, z) and elements (four numbers), as ClaymoreUW has them.

        Rows of numbers separated by commas or blanks, a line of names allowed. Vertices count from
        `first`, 1 in ClaymoreUW. Other arguments as of `read`. Raises `SceneError`.
        """
        from libmpm._src.shapes import element_files

        label = f"{cls.label}.read_tables"
        mesh = element_files.read_tables(vertices, elements, 3, first, label)
        return cls._taken(mesh, scale, offset, weld, part, volumes, label)


@value
class Triangles(ElementMesh):
    """A body of linear triangles in 2D, plane strain, whose vertices move with the grid.

    {fields}

    As `Tetrahedra`, with edges in the place of faces. Raises `SceneError` with every broken rule.
    """

    label: ClassVar[str] = "shapes.Triangles"
    _d: ClassVar[int] = 2

    vertices: Sequence[Sequence[float]] | npt.NDArray[Any] = given(
        "at rest, relative to the scene's `origin`; kept as a read-only array",
        unit="m",
        shape="(n, 2)",
    )
    elements: Sequence[Sequence[int]] | npt.NDArray[Any] = given(
        "vertex numbers from 0, three an element", unit="1", shape="(m, 3)"
    )
    volumes: Literal["element", "vertex"] | None = given(
        '"vertex" averages volumes at vertices, against locking (Bonet and Burton 1998); "element" '
        "does not; None = vertex where Poisson's ratio is 0.4 or more, or the law flows at "
        "constant volume (VonMises)",
        default=None,
    )


def _counts(label: str, size: Sequence[float], edge: float) -> list[int]:
    """Return cubes of at most `edge` on each axis."""
    check = Checker(label)
    exact = [s / edge for s in size]
    if not math.prod(exact) < 2**28:
        check.fail(
            f"edge is {edge:g}, of which the box holds {math.prod(exact):.3g} cubes; expected "
            "< 2^28; give a longer edge"
        )
        check.finish()
    return [max(1, math.ceil(n - 1e-6)) for n in exact]


def _filled(solid: Solid, edge: float, mesher: str, label: str) -> tuple[Array, Numbers]:
    from libmpm._src.shapes import element_lattices
    from libmpm._src.shapes.gmsh_mesher import has_gmsh, knows, mesh_by_gmsh

    if mesher == "auto" and isinstance(solid, Box | OrientedBox):
        return _box_mesh(solid, edge, label)
    by_gmsh = isinstance(solid, SurfaceMesh) or (has_gmsh() and knows(solid))
    if mesher == "gmsh" or (mesher == "auto" and by_gmsh):
        return mesh_by_gmsh(solid, edge, label)
    return element_lattices.cut_lattice(solid, edge, label)


def _box_mesh(solid: Box | OrientedBox, edge: float, label: str) -> tuple[Array, Numbers]:
    from libmpm._src.shapes import element_lattices

    counts = _counts(label, solid.size, edge)
    if isinstance(solid, Box):
        return element_lattices.structured(solid.lower, solid.upper, counts, True)
    low, high = [-0.5 * s for s in solid.size], [0.5 * s for s in solid.size]
    own, elements = element_lattices.structured(low, high, counts, True)
    box = solid.turned_box()
    places = [
        sum(x * r for x, r in zip(own.T, row, strict=True)) + centre
        for centre, row in zip(box.centre, box.axes, strict=True)
    ]
    return np.stack(places, axis=1), elements
