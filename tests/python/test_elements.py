"""Meshes of elements as values: what is refused and how, boxes, solids, files, parts of a scene."""

from __future__ import annotations

import itertools
import json
import math
import pickle
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import libmpm
from libmpm import Scene, SceneError, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm._src.scene.checks_elements import LONGEST
from libmpm._src.shapes.element_topology import determinants, edges, faces
from libmpm._src.shapes.mesh_inside import MeshInside
from libmpm._src.shapes.volume import volume_of

WOOD = materials.NeoHookean(density=600.0, youngs_modulus=1e7, poissons_ratio=0.3)
RUBBER = materials.FixedCorotated(density=1000.0, youngs_modulus=1e6, poissons_ratio=0.45)
WATER = materials.TaitFluid(density=1000.0, bulk_modulus=1e6)
UNIT = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))


def two_tetrahedra() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    return np.array([*UNIT, (1, 1, 1)], float), np.array([(0, 1, 2, 3), (1, 2, 3, 4)])


def conforms(mesh: Any) -> None:
    """Every face belongs to one element or to two on opposite sides of it, and none is left open.

    Vectors of the outer faces of a closed surface add up to nothing.
    """
    found = faces(mesh.elements.astype(np.int64))
    assert found.times.max() <= 2
    assert (determinants(mesh.vertices, mesh.elements) > 0).all()
    x = mesh.vertices[mesh.surface]
    if mesh.dimension == 2:
        total = (x[:, 1] - x[:, 0]).sum(axis=0)
    else:
        total = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]).sum(axis=0)
    assert np.abs(total).max() < 1e-12


def enclosed(mesh: Any) -> float:
    """The volume inside the outer faces, by the divergence theorem."""
    x = mesh.vertices[mesh.surface]
    if mesh.dimension == 2:
        return float((x[:, 0, 0] * x[:, 1, 1] - x[:, 1, 0] * x[:, 0, 1]).sum() / 2)
    return float((x[:, 0] * np.cross(x[:, 1], x[:, 2])).sum() / 6)


# Values ------------------------------------------------------------------------------------------


def test_a_mesh_is_a_value() -> None:
    vertices, elements = two_tetrahedra()
    mesh = shapes.Tetrahedra(vertices=vertices, elements=elements)
    again = shapes.Tetrahedra(vertices=vertices.tolist(), elements=elements.tolist())
    assert mesh == again and hash(mesh) == hash(again)
    assert mesh != shapes.Tetrahedra(vertices=2 * vertices, elements=elements)
    assert mesh != shapes.Tetrahedra(vertices=vertices, elements=elements, volumes="vertex")
    assert pickle.loads(pickle.dumps(mesh)) == mesh
    written = json.loads(json.dumps(mesh.to_dict()))
    assert shapes.Tetrahedra.from_dict(written) == mesh
    with pytest.raises(ValueError, match=r"read-only"):
        mesh.vertices[0, 0] = 1.0
    vertices[0, 0] = 9.0
    assert mesh.vertices[0, 0] == 0.0, "the value keeps a copy"
    assert "5 vertices, 2 elements" in repr(mesh) and len(repr(mesh)) < 200
    assert mesh.count == 5 and mesh.total_volume() == pytest.approx(0.5)
    assert mesh.sizes == pytest.approx([1 / 6, 1 / 3])


def test_orientation_is_put_right_by_swapping_two() -> None:
    vertices, elements = two_tetrahedra()
    turned = elements.copy()
    turned[0] = (1, 0, 2, 3)
    mesh = shapes.Tetrahedra(vertices=vertices, elements=turned)
    assert (determinants(mesh.vertices, mesh.elements) > 0).all()
    assert sorted(mesh.elements[0].tolist()) == [0, 1, 2, 3]
    flat = shapes.Triangles(vertices=[(0, 0), (1, 0), (0, 1)], elements=[(0, 2, 1)])
    assert flat.total_volume() == 0.5


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"vertices": [(0, 0), (1, 0), (0, 1)]}, r"vertices has the shape \(3, 2\).*Triangles"),
        ({"vertices": "no"}, "vertices is 'no'; expected rows of 3 numbers in m"),
        ({"elements": [(0, 1, 2)]}, r"elements has the shape \(1, 3\); expected \(m, 4\)"),
        ({"elements": [(0, 1, 2, 3.5), (1, 2, 3, 4)]}, "elements 0 have numbers that are"),
        ({"elements": [(0, 1, 2, 3), (1, 2, 3, 5)]}, "elements 1 have vertex numbers from 0 to 5"),
        ({"elements": [(1, 2, 3, 4), (2, 3, 4, 5)]}, "they seem to count from 1"),
        ({"elements": [(0, 1, 2, 3), (1, 2, 2, 4)]}, "elements 1 have a vertex twice"),
        ({"elements": [(0, 1, 2, 3)]}, "vertices 4 belong to no element"),
        ({"elements": [(0, 1, 2, 3)] * 2 + [(1, 2, 3, 4)]}, "share a face of three or more"),
        ({"vertices": [*UNIT, (0.9, 0.05, 0.05)]}, "elements 1 have no volume"),
        ({"vertices": [*UNIT, (0.34, 0.34, 0.34)]}, "elements 1 are thin.*down to 0.00"),
        ({"vertices": [*UNIT, (np.nan, 1, 1)]}, "vertices 4 are not finite"),
        ({"vertices": [*UNIT, (-1, -1, -1)]}, "lie on the same side of a face that they share"),
        ({"volumes": "nodes"}, "volumes is 'nodes'"),
    ],
)  # fmt: skip
def test_what_is_refused_names_the_elements(change: dict[str, Any], said: str) -> None:
    vertices, elements = two_tetrahedra()
    arguments: dict[str, Any] = {"vertices": vertices, "elements": elements} | change
    with pytest.raises(SceneError, match=f"(?s)shapes.Tetrahedra: .*{said}"):
        shapes.Tetrahedra(**arguments)


def test_double_vertices_and_parts_are_refused() -> None:
    vertices, _ = two_tetrahedra()
    apart = np.concatenate([vertices[:4], vertices[1:] + 0.0])
    cut = np.array([(0, 1, 2, 3), (4, 5, 6, 7)])
    with pytest.raises(SceneError, match=r"pairs 1 and 4, 2 and 5, 3 and 6") as error:
        shapes.Tetrahedra(vertices=apart, elements=cut)
    assert "has 2 parts that no face joins, of 1, 1 elements" in str(error.value)
    # A hinge: two elements that share an edge alone.
    hinge = np.array([*UNIT, (-1, 0.0, 0), (0, -1.0, 0)])
    with pytest.raises(SceneError, match=r"has 2 parts that no face joins"):
        shapes.Tetrahedra(vertices=hinge, elements=[(0, 1, 2, 3), (0, 3, 4, 5)])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 3))
def test_any_order_of_vertices_elements_and_corners_is_the_same_body(seed: int, d: int) -> None:
    """Renumbering changes neither volume nor surface; a broken element is named by its number."""
    rng = np.random.default_rng(seed)
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    mesh = kind.box(lower=(0,) * d, upper=(1.0, 0.7, 0.4)[:d], edge=0.25)
    place = rng.permutation(mesh.count)
    order = rng.permutation(len(mesh.elements))
    vertices = np.empty_like(mesh.vertices)
    vertices[place] = mesh.vertices + rng.normal(size=mesh.vertices.shape) * 0.01
    elements = rng.permuted(place[mesh.elements[order]], axis=1)
    other = kind(vertices=vertices, elements=elements)
    conforms(other)
    assert enclosed(other) == pytest.approx(other.total_volume(), rel=1e-12)
    assert len(other.surface) == len(mesh.surface)
    row = int(rng.integers(len(elements)))
    bad = elements.copy()
    bad[row, 0] = mesh.count + 3
    with pytest.raises(SceneError, match=f"elements {row} have vertex numbers from"):
        kind(vertices=vertices, elements=bad)


def test_moved_and_turned() -> None:
    mesh = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 0.5, 0.5), edge=0.25)
    assert mesh.moved((1, 2, 3)).bounds() == ((1, 2, 3), (2, 2.5, 3.5))
    turned = mesh.turned(90, "z")
    assert turned.bounds()[0] == pytest.approx((0.25, -0.25, 0))
    assert turned.total_volume() == pytest.approx(0.25)
    assert mesh.turned(90, "x", about=(0, 0, 0)).bounds()[0] == pytest.approx((0, -0.5, 0))
    with pytest.raises(SceneError, match=r"axis is 'z' in 2D"):
        shapes.Triangles.box(lower=(0, 0), upper=(1, 1), edge=1).turned(10, "z")


# Making ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pattern", ["alternating", "one-way"])
@pytest.mark.parametrize("d", [2, 3])
def test_boxes_are_met_exactly(pattern: str, d: int) -> None:
    lower, upper = (0.1, -0.3, 2.0)[:d], (1.1, 0.4, 2.3)[:d]
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    mesh = kind.box(lower=lower, upper=upper, edge=0.1, pattern=pattern)
    counts = (10, 7, 3)[:d]
    assert mesh.count == math.prod(n + 1 for n in counts)
    assert len(mesh.elements) == math.prod(counts) * math.factorial(d)
    assert mesh.bounds() == (lower, upper)
    volume = math.prod(b - a for a, b in zip(lower, upper, strict=True))
    assert mesh.total_volume() == pytest.approx(volume, rel=1e-13)
    assert mesh.edge == pytest.approx(0.1)
    conforms(mesh)
    # Diagonals of the first axis' plane: all one way, or both in equal numbers.
    pairs = edges(mesh.elements.astype(np.int64))
    along = mesh.vertices[pairs[:, 1]] - mesh.vertices[pairs[:, 0]]
    rises = along[:, 0] * along[:, 1]
    flat = (np.abs(along[:, 0]) > 1e-9) & (np.abs(along[:, 1]) > 1e-9)
    if d == 3:
        flat &= np.abs(along[:, 2]) < 1e-9
    ups, downs = (rises[flat] > 0).sum(), (rises[flat] < 0).sum()
    assert downs == 0 if pattern == "one-way" else ups == downs


def test_the_edge_of_a_box_is_an_upper_bound() -> None:
    mesh = shapes.Triangles.box(lower=(0, 0), upper=(1, 0.35), edge=0.1)
    assert mesh.count == 11 * 5 and mesh.edge <= 0.1
    with pytest.raises(SceneError, match=r"edge is -1; expected > 0 m"):
        shapes.Triangles.box(lower=(0, 0), upper=(1, 1), edge=-1)
    with pytest.raises(SceneError, match=r"the box holds 1e.09 cubes"):
        shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 1, 1), edge=1e-3)


SOLIDS = {
    "sphere": (shapes.Sphere(centre=(0.1, 0.2, 0.3), radius=0.5), 0.015),
    "cylinder": (shapes.Cylinder(start=(0, 0, 0), end=(1, 0.3, 0.2), radius=0.3), 0.035),
    "cone": (shapes.Cone(start=(0, 0, 0), end=(0, 0, 1), radius=0.5, end_radius=0.2), 0.045),
    "ring": (
        shapes.Sphere(centre=(0, 0, 0), radius=0.5)
        - shapes.Cylinder(start=(-1, 0, 0), end=(1, 0.1, 0), radius=0.2),
        0.04,
    ),
    "profile": (
        shapes.Extrusion(
            profile=[(0, 0), (1, 0), (1, 1), (0.5, 0.5), (0, 1)], axis="y", lower=0, upper=0.4
        ),
        0.08,
    ),
    "disc": (shapes.Sphere(centre=(0.1, 0.2), radius=0.5), 0.01),
    "plate": (
        shapes.Box(lower=(0, 0), upper=(1, 0.6)).turned(20)
        - shapes.Sphere(centre=(0.5, 0.3), radius=0.15),
        0.02,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_a_lattice_cut_at_the_surface(name: str) -> None:
    """Volume within a share at 10 edges across, half of it at 20; vertices on the surface."""
    solid, share = SOLIDS[name]
    kind: Any = shapes.Triangles if solid.dimension == 2 else shapes.Tetrahedra
    short = []
    for edge in (0.1, 0.05):
        mesh = kind.fill(solid=solid, edge=edge, mesher="lattice")
        conforms(mesh)
        assert mesh.edge <= edge * (1 + 1e-9)
        assert mesh.quality.min() > 0.1
        assert enclosed(mesh) == pytest.approx(mesh.total_volume(), rel=1e-12)
        far = solid.distance(mesh.vertices[np.unique(mesh.surface)])
        assert np.abs(far).max() < 1e-6 * edge, "outer vertices lie on the surface"
        assert solid.distance(mesh.vertices).max() < 1e-6 * edge
        short.append(1 - mesh.total_volume() / volume_of(solid))
    assert abs(short[0]) < share
    assert abs(short[1]) < 0.5 * share


def a_solid(seed: int, d: int) -> shapes.Solid:
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.6, 1.6, d)
    made: list[Any] = [
        shapes.Box(lower=-size / 2, upper=size / 2),
        shapes.Sphere(centre=rng.uniform(-0.2, 0.2, d), radius=size[0] / 2),
    ]
    if d == 3:
        made += [
            shapes.Cylinder(start=(0, 0, 0), end=size, radius=size[1] / 3),
            shapes.Cone(start=(0, 0, 0), end=size, radius=size[1] / 2, end_radius=0.2),
        ]
    solid = made[rng.integers(len(made))]
    return solid.turned(rng.uniform(0, 360), None if d == 2 else "xyz"[rng.integers(3)])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.integers(2, 3), st.floats(0.12, 0.25))
def test_any_solid_gives_a_mesh_that_is_accepted(seed: int, d: int, edge: float) -> None:
    """Quality and conformity are the constructor's to check; edges stay below √d times `edge`."""
    solid = a_solid(seed, d)
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    mesh = kind.fill(solid=solid, edge=edge, mesher="lattice")
    assert mesh.edge <= edge * (1 + 1e-9)
    assert 0.4 < mesh.total_volume() / volume_of(solid) < 1.001
    conforms(mesh)


def test_what_cannot_be_filled_says_so() -> None:
    fill = shapes.Tetrahedra.fill
    half = shapes.HalfSpace(point=(0, 0, 0), normal=(0, 0, 1))
    with pytest.raises(SceneError, match=r"the solid has no end.*cut it with"):
        fill(solid=half, edge=0.1, mesher="lattice")
    ball = shapes.Sphere(centre=(0, 0, 0), radius=0.1)
    with pytest.raises(SceneError, match=r"give a shorter edge"):
        fill(solid=ball, edge=0.5, mesher="lattice")
    with pytest.raises(SceneError, match=r"comes apart into 2 parts"):
        fill(solid=ball | ball.moved((1, 0, 0)), edge=0.05, mesher="lattice")
    with pytest.raises(SceneError, match=r"give a longer edge"):
        fill(solid=ball, edge=1e-4, mesher="lattice")
    with pytest.raises(SceneError, match=r"solid is in 2D; expected 3D; use shapes.Triangles"):
        fill(solid=shapes.Sphere(centre=(0, 0), radius=1), edge=0.1)
    with pytest.raises(SceneError, match=r"mesher is 'netgen'"):
        fill(solid=ball, edge=0.1, mesher="netgen")  # type: ignore[arg-type]


def test_boxes_at_any_angle_are_met_exactly() -> None:
    box = shapes.OrientedBox(centre=(1, 2, 3), size=(1, 0.5, 0.25), angle=30, axis="y")
    mesh = shapes.Tetrahedra.fill(solid=box, edge=0.125)
    assert mesh.total_volume() == pytest.approx(box.volume(), rel=1e-12)
    far = box.distance(mesh.vertices[np.unique(mesh.surface)])
    assert np.abs(far).max() < 1e-12


# Gmsh --------------------------------------------------------------------------------------------


def require_gmsh() -> Any:
    try:
        import gmsh
    except (ImportError, OSError) as error:
        pytest.skip(f"gmsh: {error}")
    return gmsh


def stl_of(mesh: Any, path: Path) -> Path:
    meshio.Mesh(mesh.vertices, [("triangle", mesh.surface)]).write(path)
    return path


def test_a_surface_mesh_without_gmsh_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    bar = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 0.2, 0.2), edge=0.1)
    surface = shapes.SurfaceMesh(file=str(stl_of(bar, tmp_path / "bar.stl")))
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(
        SceneError, match=r"gmsh is not installed, or not whole .*pip install libmpm\[elements\]"
    ):
        shapes.Tetrahedra.fill(solid=surface, edge=0.1)
    by_lattice = shapes.Tetrahedra.fill(solid=surface, edge=0.1, mesher="lattice")
    assert by_lattice.total_volume() == pytest.approx(0.04, rel=0.3)


@pytest.mark.parametrize("name", ["profile", "disc", "plate"])
def test_gmsh_meets_sharp_edges(name: str) -> None:
    require_gmsh()
    solid, _ = SOLIDS[name]
    kind: Any = shapes.Triangles if solid.dimension == 2 else shapes.Tetrahedra
    mesh = kind.fill(solid=solid, edge=0.2, mesher="gmsh")
    conforms(mesh)
    assert mesh.edge <= 0.2 * (1 + 1e-9)
    exact = 1e-9 if name == "profile" else 0.04
    assert mesh.total_volume() == pytest.approx(volume_of(solid), rel=exact)
    assert kind.fill(solid=solid, edge=0.2, mesher="gmsh") == mesh, "the same at every call"


def test_gmsh_fills_a_surface_mesh(tmp_path: Path) -> None:
    gmsh = require_gmsh()
    bar = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 0.2, 0.2), edge=0.1)
    path = stl_of(bar, tmp_path / "bar.stl")
    surface = shapes.SurfaceMesh(file=str(path), scale=2.0, offset=(1, 0, 0))
    mesh = shapes.Tetrahedra.fill(solid=surface, edge=0.2)
    conforms(mesh)
    assert mesh.bounds() == (pytest.approx((1, 0, 0)), pytest.approx((3, 0.4, 0.4)))
    assert mesh.total_volume() == pytest.approx(0.32, rel=1e-9)
    open_ = meshio.Mesh(bar.vertices, [("triangle", bar.surface[1:])])
    open_.write(tmp_path / "open.stl")
    healed = shapes.SurfaceMesh(file=str(tmp_path / "open.stl"), heal="winding")
    with pytest.raises(SceneError, match=r"3 open and .* expected a closed one"):
        shapes.Tetrahedra.fill(solid=healed, edge=0.1)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.model.add("of a user")
        shapes.Tetrahedra.fill(solid=surface, edge=0.15)
        assert gmsh.model.getCurrent() == "of a user"
    finally:
        gmsh.finalize()


# Files -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".msh", ".vtk", ".vtu", ".inp", ".xdmf", ".mesh"])
def test_files_that_meshio_reads(ending: str, tmp_path: Path) -> None:
    bar = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 0.2, 0.1), edge=0.1)
    path = tmp_path / f"bar{ending}"
    loose = np.concatenate([[(9.0, 9, 9)], bar.vertices])
    meshio.Mesh(loose, [("tetra", bar.elements + 1), ("triangle", bar.surface + 1)]).write(path)
    found = shapes.Tetrahedra.read(path)
    assert found.vertices == pytest.approx(bar.vertices, abs=1e-6)
    assert np.array_equal(found.elements, bar.elements)
    small = shapes.Tetrahedra.read(path, scale=1e-3, offset=(1, 2, 3), volumes="vertex")
    assert small.bounds() == (pytest.approx((1, 2, 3)), pytest.approx((1.001, 2.0002, 3.0001)))
    assert small.volumes == "vertex"


def test_quadratic_elements_count_by_their_corners(tmp_path: Path) -> None:
    corners = np.array(UNIT, float)
    middles = [(corners[i] + corners[j]) / 2 for i, j in itertools.combinations(range(4), 2)]
    points = np.concatenate([corners, middles])
    meshio.Mesh(points, [("tetra10", [list(range(10))])]).write(tmp_path / "one.vtu")
    assert shapes.Tetrahedra.read(tmp_path / "one.vtu").count == 4


def test_plane_files(tmp_path: Path) -> None:
    plate = shapes.Triangles.box(lower=(0, 0), upper=(1, 1), edge=0.5)
    points = np.column_stack([plate.vertices, np.full(plate.count, 0.25)])
    meshio.Mesh(points, [("triangle", plate.elements)]).write(tmp_path / "plate.vtk")
    assert shapes.Triangles.read(tmp_path / "plate.vtk") == plate
    points[0, 2] = 0.0
    meshio.Mesh(points, [("triangle", plate.elements)]).write(tmp_path / "bent.vtk")
    with pytest.raises(SceneError, match=r"from z = 0 to 0.25; expected a plane mesh"):
        shapes.Triangles.read(tmp_path / "bent.vtk")


def test_files_that_are_refused(tmp_path: Path) -> None:
    read = shapes.Tetrahedra.read
    with pytest.raises(SceneError, match=r"is not there"):
        read(tmp_path / "none.msh")
    (tmp_path / "text.msh").write_text("no mesh")
    with pytest.raises(SceneError, match=r"cannot be read as a mesh"):
        read(tmp_path / "text.msh")
    points = np.array([*itertools.product((0.0, 1.0), repeat=3)])
    meshio.Mesh(points, [("hexahedron", [[0, 4, 6, 2, 1, 5, 7, 3]])]).write(tmp_path / "hex.vtk")
    with pytest.raises(SceneError, match=r"cells of type hexahedron; expected tetras"):
        read(tmp_path / "hex.vtk")
    bar = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 1, 1), edge=0.5)
    with pytest.raises(SceneError, match=r"has triangle and no tetra.*SurfaceMesh"):
        read(stl_of(bar, tmp_path / "bar.stl"))


def test_welding_and_parts(tmp_path: Path) -> None:
    one = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 1, 1), edge=0.5, pattern="one-way")
    two = shapes.Tetrahedra.box(lower=(1, 0, 0), upper=(1.5, 1, 1), edge=0.5, pattern="one-way")
    points = np.concatenate([one.vertices, two.vertices])
    cells = np.concatenate([one.elements, two.elements + one.count])
    path = tmp_path / "two.vtk"
    meshio.Mesh(points, [("tetra", cells)]).write(path)
    with pytest.raises(SceneError, match=r"lie where others do") as error:
        shapes.Tetrahedra.read(path)
    assert "has 2 parts that no face joins, of 48, 24 elements" in str(error.value)
    whole = shapes.Tetrahedra.read(path, weld=True)
    assert whole.total_volume() == pytest.approx(1.5) and whole.count == one.count + 9
    conforms(whole)
    assert shapes.Tetrahedra.read(path, part=0).bounds() == one.bounds()
    assert shapes.Tetrahedra.read(path, part=1).bounds() == two.bounds()
    with pytest.raises(SceneError, match=r"part is 2 of a mesh with 2; expected 0 to 1"):
        shapes.Tetrahedra.read(path, part=2)


def test_tables_of_claymore(tmp_path: Path) -> None:
    bar = shapes.Tetrahedra.box(lower=(0, 0, 0), upper=(1, 0.2, 0.2), edge=0.1)
    places, rows = tmp_path / "vertices.csv", tmp_path / "elements.csv"
    np.savetxt(places, bar.vertices, delimiter=",", fmt="%.17g")
    np.savetxt(rows, bar.elements + 1, delimiter=",", fmt="%d", header="a,b,c,d", comments="")
    read = shapes.Tetrahedra.read_tables
    assert read(vertices=places, elements=rows) == bar
    np.savetxt(rows, bar.elements, delimiter=" ", fmt="%d")
    assert read(vertices=places, elements=rows, first=0) == bar
    with pytest.raises(SceneError, match=r"vertex numbers from -1 to"):
        read(vertices=places, elements=rows)
    with pytest.raises(
        SceneError, match=r"of the elements has an array of shape .*expected \(n, 4"
    ):
        read(vertices=places, elements=places)
    with pytest.raises(SceneError, match=r"of the vertices cannot be read"):
        read(vertices=tmp_path / "none.csv", elements=rows)


# Scenes ------------------------------------------------------------------------------------------


def room(d: int = 3, dx: float = 0.1, **changes: Any) -> Scene:
    return Scene(dimension=d, cell_size=dx, lower=(0,) * d, upper=(2, 1, 1)[:d], **changes)


def bar_of(d: int = 3, edge: float = 0.05, **changes: Any) -> Any:
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    low, high = (0.3, 0.3, 0.2)[:d], (1.1, 0.5, 0.4)[:d]
    return kind.box(lower=low, upper=high, edge=edge, **changes)


@pytest.mark.parametrize("d", [2, 3])
def test_the_specification_of_a_body(d: int) -> None:
    scene = room(d)
    scene.add_body(name="water", shape=shapes.Box(lower=(1.5,) + (0,) * (d - 1), upper=(2,) +
                   (0.2,) * (d - 1)), material=WATER)  # fmt: skip
    scene.add_body(name="bar", shape=bar_of(d), material=WOOD, velocity=(1,) + (0,) * (d - 1))
    scene.add_body(name="soft", shape=bar_of(d).moved((0, 0.4, 0)[:d]), material=RUBBER)
    for fill in (True, False):
        water, bar, soft = lower(scene, with_particles=fill)["bodies"]
        mesh = scene.bodies[1].shape
        assert "elements" not in water
        assert bar["count"] == mesh.count and bar["first_id"] == water["count"]
        assert soft["first_id"] == bar["first_id"] + bar["count"]
        assert np.array_equal(bar["position"](0, mesh.count), mesh.vertices)
        assert bar["elements"].dtype == np.int32 and np.array_equal(bar["elements"], mesh.elements)
        assert bar["particle_mass"] * bar["count"] == pytest.approx(600 * 0.8 * 0.2 ** (d - 1))
        assert bar["element_volumes"] == "element" and soft["element_volumes"] == "vertex"
        assert bar["fbar"]["form"] == "none" and bar["pressure"] is None


def test_volumes_follow_from_poissons_ratio_unless_given() -> None:
    mesh = bar_of()
    assert [mesh.volumes_for(nu) for nu in (0.0, 0.399, 0.4, 0.49)] == ["element"] * 2 + [
        "vertex"
    ] * 2
    assert bar_of(volumes="element").volumes_for(0.49) == "element"
    assert bar_of(volumes="vertex").volumes_for(0.0) == "vertex"


def test_scene_files_scaling_and_pictures(tmp_path: Path) -> None:
    scene = room(gravity=(0, 0, -9.81), name="bars")
    scene.add_body(name="bar", shape=bar_of(volumes="vertex"), material=WOOD)
    scene.save(tmp_path / "scene.json")
    again = Scene.load(tmp_path / "scene.json")
    assert again == scene and again.bodies[0].shape.volumes == "vertex"
    jsonschema = pytest.importorskip("jsonschema")
    from libmpm._src.scene.schema import scene_schema

    jsonschema.validate(json.loads((tmp_path / "scene.json").read_text()), scene_schema())
    small = scene.scaled(0.25)
    assert np.array_equal(small.bodies[0].shape.vertices, 0.25 * bar_of().vertices)
    assert np.array_equal(small.bodies[0].shape.elements, bar_of().elements)
    for picture in (scene.preview(), scene.preview(cut=(0.5, 0.4, 0.3))):
        drawn = [c for ax in picture.axes for c in ax.collections if hasattr(c, "get_segments")]
        assert sum(len(c.get_segments()) for c in drawn) > 10
    flat = room(2)
    flat.add_body(name="bar", shape=bar_of(2), material=WOOD)
    lines = [c for ax in flat.preview().axes for c in ax.collections if hasattr(c, "get_segments")]
    assert sum(len(c.get_segments()) for c in lines) == len(bar_of(2).surface)


def test_the_edge_is_measured_in_cells() -> None:
    for d in (2, 3):
        scene = room(d, dx=0.05)
        scene.add_body(name="bar", shape=bar_of(d, edge=0.1), material=WOOD)
        with pytest.raises(
            SceneError, match=rf"body 'bar': longest edge .* 2 cells by √{d}; .*cell_size ≥ 0.09524"
        ):
            scene.validate()
    for dx, fits in ((0.1 / LONGEST, True), (0.099 / LONGEST, False)):
        upper = [20 * dx, 10 * dx, 10 * dx]
        scene = Scene(dimension=3, cell_size=dx, lower=(0, 0, 0), upper=upper)
        scene.add_body(name="bar", shape=bar_of(edge=0.1), material=WOOD)
        problems, _ = scene_problems(scene)
        assert (not any("longest edge" in p for p in problems)) == fits


def scene_problems(scene: Scene) -> tuple[list[str], list[str]]:
    from libmpm._src.scene.checks import check_scene

    return check_scene(scene)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"material": WATER}, "material is TaitFluid for elements; expected one of Fixed"),
        ({"material": materials.LinearElastic(density=1e3, youngs_modulus=1e6,
          poissons_ratio=0.3)}, "material is LinearElastic for elements"),
        ({"particles_per_cell": 27}, "particles_per_cell is 27 for a body of elements"),
        ({"sampling": shapes.Jitter(share=0.5, seed=1)}, "sampling is .* the vertices are given"),
        ({"velocity": (1, 0)}, "velocity has 2 numbers"),
    ],
)  # fmt: skip
def test_what_bodies_of_elements_do_not_have(changes: dict[str, Any], said: str) -> None:
    scene = room()
    scene.add_body(**({"name": "bar", "shape": bar_of(), "material": WOOD} | changes))
    scene.add_body(name="other", shape=shapes.Box(lower=(1.5, 0, 0), upper=(1.9, 0.3, 0.3)),
                   material=WOOD)  # fmt: skip
    with pytest.raises(SceneError, match=f"(?s)body 'bar': .*{said}"):
        scene.validate()


def test_places_of_meshes_are_checked() -> None:
    scene = room()
    scene.add_body(name="bar", shape=bar_of().moved((1.2, 0, 0)), material=WOOD)
    with pytest.raises(SceneError, match=r"the body spans 1.5 to 2.3 m on axis 0"):
        scene.validate()
    scene = room()
    scene.add_body(name="bar", shape=bar_of(), material=WOOD)
    scene.add_body(name="other", shape=bar_of().moved((0.31, 0.07, 0.03)), material=WOOD)
    with pytest.raises(SceneError, match=r"of its vertices, the first .* lie inside elements"):
        scene.validate()
    scene = room()
    scene.add_body(name="bar", shape=bar_of(), material=WOOD)
    scene.add_body(name="beside", shape=bar_of().moved((0, 0.2, 0)), material=WOOD)
    assert not scene_problems(scene)[0], "bodies may touch"
    scene.add_body(name="ball", shape=shapes.Sphere(centre=(0.7, 0.4, 0.4), radius=0.05),
                   material=WOOD)  # fmt: skip
    with pytest.raises(SceneError, match=r"with body 'ball': the bodies overlap"):
        scene.validate()
    flat = room(2)
    flat.add_body(name="bar", shape=bar_of(), material=WOOD)
    with pytest.raises(SceneError, match=r"shape has 3 numbers; expected 2"):
        flat.validate()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_what_a_mesh_encloses(seed: int) -> None:
    """Against the signed distance of the box that is meshed."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 4))
    size = rng.uniform(0.3, 1.0, d)
    box = shapes.OrientedBox(centre=(0,) * d, size=size, angle=rng.uniform(0, 90))
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    solid = MeshInside(kind.fill(solid=box, edge=0.2))
    points = rng.uniform(-0.8, 0.8, (60, d))
    far = box.distance(points)
    inner = far < 0
    assert solid.distance(points)[inner] == pytest.approx(far[inner], abs=1e-12)
    assert (solid.distance(points)[~inner] >= -1e-12).all()
    assert solid.volume() == pytest.approx(box.volume())
    assert solid == MeshInside(solid.mesh) and hash(solid) == hash(MeshInside(solid.mesh))


@pytest.mark.parametrize("d", [2, 3])
def test_a_mesh_taken_out_of_water(d: int) -> None:
    """Particles inside the mesh are left out, as where a box is taken out, and mass with them."""
    counts = []
    box = shapes.OrientedBox(centre=(1.0, 0.5, 0.5)[:d], size=(0.8, 0.2, 0.2)[:d], angle=20)
    kind: Any = shapes.Triangles if d == 2 else shapes.Tetrahedra
    for shape in (box, kind.fill(solid=box, edge=0.1)):
        scene = room(d)
        scene.add_body(
            name="water", shape=shapes.Box(lower=(0,) * d, upper=(2, 1, 1)[:d]), material=WATER
        )
        scene.add_body(name="bar", shape=shape, material=WOOD, subtract_from=("water",))
        scene.validate()
        water = lower(scene)["bodies"][0]
        counts.append(water["count"])
    assert counts[0] == counts[1]
    left = 2 - 0.8 * 0.2 ** (d - 1)
    assert water["count"] * water["particle_mass"] == pytest.approx(1000 * left, rel=1e-3)


def test_stiff_elements_in_single_precision_are_doubted() -> None:
    scene = room(gravity=(0, 0, -9.81))
    stiff = materials.NeoHookean(density=600.0, youngs_modulus=1e11, poissons_ratio=0.3)
    scene.add_body(name="bar", shape=bar_of(), material=stiff)
    with pytest.warns(libmpm.ModelWarning, match=r"about E·1e-7 = 1e\+04 Pa in single precision"):
        lower(scene, precision="single")
    with warned() as said:
        lower(scene, precision="double")
    assert not any("E·1e-7" in text for text in said)


def test_thin_parts_with_edges_of_a_cell_are_doubted() -> None:
    scene = room()
    scene.add_body(name="bar", shape=bar_of(edge=0.1), material=WOOD)
    assert any("2 cells thick with edges of 1 cells" in d for d in scene_problems(scene)[1])
    scene = room()
    scene.add_body(name="bar", shape=bar_of(edge=0.05), material=WOOD)
    assert not any("cells thick with edges" in d for d in scene_problems(scene)[1])


class warned:
    """The texts of the warnings inside."""

    def __enter__(self) -> list[str]:
        import warnings

        self._texts: list[str] = []
        self._catch = warnings.catch_warnings(record=True)
        self._found = self._catch.__enter__()
        warnings.simplefilter("always")
        return self._texts

    def __exit__(self, *error: object) -> None:
        self._texts += [str(w.message) for w in self._found or ()]
        self._catch.__exit__(None, None, None)


def test_debris_as_elements() -> None:
    from libmpm import debris

    timber = debris.Prototype(name="timber", length=0.4, width=0.1, height=0.1, material=WOOD)
    field = debris.ordered(timber, columns=2, rows=2, clearance=0.1, centre=(1.0, 0.5))
    scene = room()
    names = field.add_to(scene, elevation=0.3, edge=0.05)
    assert len(names) == 4
    for body, piece in zip(scene.bodies, field.pieces, strict=True):
        assert isinstance(body.shape, shapes.Tetrahedra) and body.particles_per_cell == 8
        assert body.shape.total_volume() == pytest.approx(0.004)
        middle = np.mean(body.shape.bounds(), axis=0)
        assert middle == pytest.approx((piece.x, piece.y, 0.35))


@pytest.mark.parametrize("path", [1, "", None])
def test_tables_are_read_from_paths_alone(path):
    """A number would be the standard output, closed after reading."""
    with pytest.raises(libmpm.SceneError, match=r"vertices is .*; expected the path of a file"):
        shapes.Tetrahedra.read_tables(vertices=path, elements=path)


def test_slow_impacts_of_long_edges_are_named():
    """At 0.0014 of the wave speed a wall had 0.07 of the force (docs/elements.md)."""

    def doubts(speed, edge):
        scene = libmpm.Scene(
            dimension=2, cell_size=0.025, lower=(0, 0), upper=(1.2, 0.5), gravity=(0, 0)
        )
        bar = shapes.Triangles.box(lower=(0.1, 0.1), upper=(1.1, 0.3), edge=edge)
        law = materials.NeoHookean(density=500, youngs_modulus=1e9, poissons_ratio=0.0)
        scene.add_body(name="bar", shape=bar, material=law, velocity=(-speed, 0))
        return [text for text in scene.plan().warnings if "impact" in text]

    (text,) = doubts(2.0, 0.025)
    assert "0.07 at 0.0014" in text and "edge ≤ 0.0125 m" in text
    assert not doubts(40.0, 0.025) and not doubts(2.0, 0.0125)


def test_a_simulation_shares_the_arrays_of_a_mesh() -> None:
    """Its scene is a copy, but a mesh cannot change, and as lists it would take seconds."""
    mesh = shapes.Triangles.box(lower=(0.1, 0.1), upper=(0.5, 0.4), edge=0.05)
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(name="block", shape=mesh, material=WOOD)
    sim = libmpm.Simulation(scene, device="cpu")
    scene.replace("block", material=RUBBER)
    assert sim.scene.bodies[0].material == WOOD
    assert sim.scene.bodies[0].shape.vertices is mesh.vertices
    assert isinstance(scene.to_dict()["bodies"][0]["shape"]["vertices"], list)
    assert isinstance(sim.scene.to_dict()["bodies"][0]["shape"]["vertices"], list)
