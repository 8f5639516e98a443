"""Surface meshes: distances and winding numbers against brute force, defects, formats."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

import libmpm
from libmpm import shapes
from libmpm._src.base.values import from_plain
from libmpm._src.shapes import mesh_file
from libmpm._src.shapes.mesh_distance import TriangleTree
from libmpm._src.shapes.volume import counted_volume

meshio = pytest.importorskip("meshio")
trimesh = pytest.importorskip("trimesh")

Array = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=0.5)


def to_triangles(p: Array, triangles: Array) -> Array:
    """Every point with every triangle: by barycentric coordinates, and by edges."""
    a, b, c = (triangles[None, :, i] for i in range(3))
    best = np.full((len(p), len(triangles)), np.inf)
    for start, end in ((a, b), (b, c), (c, a)):
        edge, away = end - start, p[:, None] - start
        t = np.clip((away * edge).sum(2) / (edge * edge).sum(2), 0, 1)
        best = np.minimum(best, np.linalg.norm(away - t[..., None] * edge, axis=2))
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal, axis=2, keepdims=True)
    height = ((p[:, None] - a) * normal).sum(2)
    foot = p[:, None] - height[..., None] * normal
    sides = [
        (np.cross(end - start, foot - start) * normal).sum(2) >= 0
        for start, end in ((a, b), (b, c), (c, a))
    ]
    return np.where(np.all(sides, axis=0), np.abs(height), best).min(axis=1)


def windings(p: Array, triangles: Array) -> Array:
    a, b, c = (triangles[None, :, i] - p[:, None] for i in range(3))
    la, lb, lc = (np.linalg.norm(x, axis=2) for x in (a, b, c))
    above = (a * np.cross(b, c)).sum(2)
    below = la * lb * lc + (a * b).sum(2) * lc + (b * c).sum(2) * la + (c * a).sum(2) * lb
    return 2 * np.arctan2(above, below).sum(axis=1) / (4 * np.pi)


def test_trees_are_brute_force() -> None:
    """Triangles of all sizes and forms, far from closed."""
    rng = np.random.default_rng(1)
    middle = rng.random((301, 1, 3)) * 4
    triangles = middle + rng.normal(0, 1, (301, 3, 3)) * rng.exponential(0.5, (301, 1, 1))
    p = rng.uniform(-2, 6, (400, 3))
    tree = TriangleTree(triangles)
    assert tree.distance(p) == pytest.approx(to_triangles(p, triangles), abs=1e-12)
    assert tree.winding(p) == pytest.approx(windings(p, triangles), abs=0.03)
    part = slice(17, 203)
    assert np.array_equal(tree.distance(p[part]), tree.distance(p)[part])
    assert np.array_equal(tree.winding(p[part]), tree.winding(p)[part])


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_triangles_need_no_tree(count: int) -> None:
    rng = np.random.default_rng(count)
    triangles, p = rng.random((count, 3, 3)), rng.uniform(-1, 2, (200, 3))
    tree = TriangleTree(triangles)
    assert tree.distance(p) == pytest.approx(to_triangles(p, triangles), abs=1e-12)
    assert tree.winding(p) == pytest.approx(windings(p, triangles), abs=0.03)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_a_box_is_a_box(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"box.{ending}"
    trimesh.creation.box(extents=(1, 2, 3)).export(path)
    mesh = shapes.SurfaceMesh(file=path, offset=(0.5, 1, 1.5))
    box = shapes.Box(lower=(0, 0, 0), upper=(1, 2, 3))
    p = np.random.default_rng(0).uniform(-1, 4, (3000, 3))
    assert mesh.distance(p) == pytest.approx(box.distance(p), abs=1e-12)
    assert mesh.volume() == pytest.approx(6.0)
    assert mesh.bounds() == box.bounds()
    assert counted_volume(mesh) == pytest.approx(6.0, rel=1e-3)
    assert mesh.report() == {
        "triangles": 12, "collapsed": 0, "open_edges": 0, "flipped_edges": 0, "parts": 1,
    }  # fmt: skip
    assert from_plain(json.loads(json.dumps(mesh.to_dict()))) == mesh


@pytest.mark.parametrize("ending", ["stl", "obj", "ply"])
def test_a_plain_installation_reads_meshes(
    ending: str, ball: trimesh.Trimesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ball.export(tmp_path / f"ball.{ending}")
    shutil.copy(tmp_path / f"ball.{ending}", tmp_path / f"plain.{ending}")
    with_trimesh = shapes.SurfaceMesh(file=tmp_path / f"ball.{ending}")
    expected = with_trimesh.volume(), with_trimesh.report()
    monkeypatch.setitem(sys.modules, "trimesh", None)
    monkeypatch.setattr(mesh_file, "find_spec", lambda name: None)
    plain = shapes.SurfaceMesh(file=tmp_path / f"plain.{ending}")
    assert plain.volume() == pytest.approx(expected[0], rel=1e-6)
    assert plain.report() == expected[1]


def test_a_ball_is_a_ball(ball: trimesh.Trimesh, tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    ball.export(path)
    mesh = shapes.SurfaceMesh(file=path, scale=2.0)
    sphere = shapes.Sphere(centre=(0, 0, 0), radius=1.0)
    p = np.random.default_rng(0).uniform(-2, 2, (1500, 3))
    # Edges are 0.16 long: the triangles lie up to e²/(6 R) within the ball.
    error = mesh.distance(p) - sphere.distance(p)
    assert np.all((error > -1e-6) & (error < 0.16**2 / 6 * 1.5))
    assert mesh.volume() == pytest.approx(8 * ball.volume, rel=1e-6)


def test_meshes_that_are_inside_out_are_turned(ball: trimesh.Trimesh, tmp_path: Path) -> None:
    turned = ball.copy()
    turned.invert()
    turned.export(tmp_path / "ball.ply")
    mesh = shapes.SurfaceMesh(file=tmp_path / "ball.ply")
    assert mesh.volume() == pytest.approx(ball.volume, rel=1e-6)
    assert np.array_equal(mesh.distance([(0, 0, 0), (0, 0, 1)]) < 0, [True, False])


def test_open_meshes_are_refused_or_healed(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    torn = ball.copy()
    torn.update_faces(np.arange(len(torn.faces)) != 100)
    torn.export(tmp_path / "torn.stl")
    with pytest.raises(libmpm.SceneError, match=r"3 open edges among 319 triangles.*heal=.winding"):
        shapes.SurfaceMesh(file=tmp_path / "torn.stl")
    mesh = shapes.SurfaceMesh(file=tmp_path / "torn.stl", heal="winding")
    assert mesh.volume() is None
    assert not (mesh | shapes.Sphere(centre=(0, 0, 0), radius=0.1)).bounding
    p = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    radius = np.linalg.norm(p, axis=1)
    sure = np.abs(radius - 0.5) > 0.03
    assert np.array_equal(mesh.distance(p[sure]) < 0, radius[sure] < 0.5)
    assert counted_volume(mesh) == pytest.approx(ball.volume, rel=5e-3)


def test_wrong_orientations_are_reported_and_healed(ball: trimesh.Trimesh, tmp_path: Path) -> None:
    dirty = ball.copy()
    dirty.faces[50] = dirty.faces[50][::-1]
    dirty.export(tmp_path / "dirty.stl")
    with pytest.raises(libmpm.SceneError, match="3 edges whose triangles are oriented differently"):
        shapes.SurfaceMesh(file=tmp_path / "dirty.stl")
    mesh = shapes.SurfaceMesh(file=tmp_path / "dirty.stl", heal="winding")
    assert mesh.report()["flipped_edges"] == 3
    assert np.array_equal(mesh.distance([(0, 0, 0), (0, 0, 1)]) < 0, [True, False])


def test_overlapping_parts_count_once(tmp_path: Path) -> None:
    one, two = (trimesh.creation.box(extents=(1, 1, 1)) for _ in range(2))
    two.apply_translation((0.5, 0.25, 0.1))
    trimesh.util.concatenate([one, two]).export(tmp_path / "both.ply")
    mesh = shapes.SurfaceMesh(file=tmp_path / "both.ply")
    assert mesh.report()["parts"] == 2
    assert mesh.volume() is None
    assert counted_volume(mesh) == pytest.approx(2 - 0.5 * 0.75 * 0.9, rel=2e-3)


@pytest.mark.parametrize("kind", ["tetra", "hexahedron"])
def test_finite_elements_give_their_outside(kind: str, tmp_path: Path) -> None:
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1, 2)], float)
    low, high = [0, 6, 9, 3, 1, 7, 10, 4], [1, 7, 10, 4, 2, 8, 11, 5]
    cells = np.array([low, high])
    if kind == "tetra":
        six = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
        cells = np.concatenate([cells[:, list(t)] for t in six])
    path = tmp_path / "brick.vtu"
    meshio.write_points_cells(path, corners, [(kind, cells)])
    mesh = shapes.SurfaceMesh(file=path)
    p = np.random.default_rng(0).uniform(-1, 3, (1000, 3))
    box = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 2))
    assert mesh.volume() == pytest.approx(2.0)
    assert mesh.distance(p) == pytest.approx(box.distance(p), abs=1e-12)


def test_a_body_of_a_mesh(ball: trimesh.Trimesh, tmp_path: Path) -> None:
    from libmpm._src.run.engine_spec import lower

    ball.export(tmp_path / "ball.stl")
    scene = libmpm.Scene(cell_size=0.1, lower=(0, 0, 0), upper=(2, 2, 2))
    mesh = shapes.SurfaceMesh(file=tmp_path / "ball.stl", offset=(1, 1, 1))
    scene.add_body(name="ball", shape=mesh, material=libmpm.materials.TaitFluid(density=1000.0))
    body = lower(scene)["bodies"][0]
    assert body["particle_mass"] * body["count"] == pytest.approx(1000 * ball.volume, rel=1e-6)
    p = body["position"](0, body["count"])
    assert np.all(np.linalg.norm(p - 1, axis=1) < 0.5)
    assert body["count"] == pytest.approx(ball.volume / 0.05**3, rel=0.02)


def test_files_that_are_no_meshes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(libmpm.SceneError, match=r"file '.*none.stl' cannot be read"):
        shapes.SurfaceMesh(file=tmp_path / "none.stl")
    (tmp_path / "text.vtk").write_text("not a mesh")
    with pytest.raises(libmpm.SceneError, match="cannot be read as a mesh"):
        shapes.SurfaceMesh(file=tmp_path / "text.vtk")
    with pytest.raises(libmpm.SceneError, match=r"choose|did you mean"):
        shapes.SurfaceMesh(file=tmp_path / "text.vtk", heal="wind")


_BROKEN_PIPE = """
import ctypes, os, signal, sys, threading
from libmpm._src.base.signals import ignore_broken_pipes
ctypes.CDLL(None).signal(int(signal.SIGPIPE), ctypes.c_void_p(0))  # as gmsh.initialize leaves it
if sys.argv[1] == "main":
    ignore_broken_pipes()
else:
    thread = threading.Thread(target=ignore_broken_pipes)
    thread.start()
    thread.join()
reading, writing = os.pipe()
os.close(reading)
try:
    os.write(writing, b"x")
except BrokenPipeError:
    print("an error")
"""


@pytest.mark.parametrize("thread", ["main", "another"])
def test_a_broken_pipe_is_an_error_after_gmsh(thread):
    """In the C library gmsh makes it the end of the process."""
    call = [sys.executable, "-c", _BROKEN_PIPE, thread]
    found = subprocess.run(call, capture_output=True, text=True, check=False)
    assert found.stdout == "an error\n", found
