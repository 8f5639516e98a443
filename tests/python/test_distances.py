"""Signed distances of every solid against brute force, in the layer where boundaries use them.

Surface meshes have theirs in `test_meshes.py` too, triangle by triangle. Expected duration: 60 s.
"""

from __future__ import annotations

import inspect
import warnings
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

import libmpm
from libmpm import Scene, shapes
from libmpm._src.boundaries.distance_field import FIELD_EDGE, distance_field
from libmpm.boundaries import DecayLayer, Slip
from libmpm.materials import TaitFluid

Array = npt.NDArray[np.float64]

PROFILE = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 0.4), (0.2, 1.2)]
BALL = shapes.Sphere(centre=(0.3, -0.2, 1.0), radius=0.7)
BOX = shapes.Box(lower=(-0.4, -0.5, 0.2), upper=(0.6, 1.5, 1.4))
RAMP = shapes.HalfSpace(point=(0, 0, 0.3), normal=(-0.4, 0.2, 1))
ROUGH = np.random.default_rng(7).random((5, 4)).tolist()
X, Y = [0.0, 0.7, 1.0, 2.0, 2.5], [0.0, 0.5, 1.5, 2.0]
#: A step of 0.6 m within 5 mm, along each axis.
STEP_X = shapes.HeightField(
    x=[0, 1, 1.005, 2], y=[0, 2], z=[[0, 0], [0, 0], [0.6, 0.6], [0.6, 0.6]]
)
STEP_Y = shapes.HeightField(x=[0, 2], y=[0, 1, 1.005, 2], z=[[0, 0, 0.6, 0.6]] * 2, base=-0.5)

#: In EXACT the magnitude is that of brute force, in BOUNDS no more than it.
EXACT: dict[str, shapes.Solid] = {
    "box": BOX,
    "turned box": shapes.OrientedBox(centre=(0, 0, 0), size=(1, 2, 0.5), angle=30, axis="x"),
    "sphere": BALL,
    "disc": shapes.Sphere(centre=(0, 1), radius=0.7),
    "cylinder": shapes.Cylinder(start=(0, 0, 0), end=(1, 1, 1), radius=0.4),
    "cone": shapes.Cone(start=(0, 0, 0), end=(1, 0.2, 1), radius=0.4),
    "truncated cone": shapes.Cone(start=(0, 0, 0), end=(1, 0, 1), radius=0.4, end_radius=0.9),
    "wedge": shapes.Wedge(lower=(0, 0, 0), upper=(1, 2, 1), high="y-"),
    "half-space": RAMP,
    "profile": shapes.Extrusion(profile=PROFILE),
    "extrusion": shapes.Extrusion(profile=PROFILE[::-1], axis="y", lower=-1, upper=1),
    "bed in 2D": shapes.HeightField(x=[0, 1, 1.005, 2], z=[0, 0.1, 0.6, 0.3]),
    "block in 2D": shapes.HeightField(x=[0, 1, 1.005, 2], z=[0, 0.1, 0.6, 0.3], base=-0.5),
    "rough bed": shapes.HeightField(x=X, y=Y, z=ROUGH),
    "rough block": shapes.HeightField(x=X, y=Y, z=ROUGH, base=-0.5),
    "step along x": STEP_X,
    "step along y": STEP_Y,
    "moved": STEP_X.moved((0.1, 0.2, 0.3)),
    "turned": STEP_Y.turned(25, "x", about=(0, 0, 0)),
    "repeated": shapes.Wedge(lower=(0, 0), upper=(1, 1)).repeated((2, 2), (1.5, 1.6)),
}
BOUNDS: dict[str, shapes.Solid] = EXACT | {
    "union": BALL | BOX,
    "intersection": STEP_Y & BALL.moved((0.5, 0.5, -0.6)),
    "difference": BOX - BALL,
}


def room(solid: shapes.Solid, margin: float) -> tuple[Array, Array]:
    """The box around a solid, of one without end what is near the origin."""
    low, high = (np.array(end) for end in solid.bounds())
    low = np.where(np.isfinite(low), low, -0.8)
    return low - margin, np.where(np.isfinite(high), high, 2.8) + margin


def brute(solid: shapes.Solid, per_axis: int) -> tuple[Array, float]:
    """Points of the surface, where lattice lines along each axis change sides, and their pitch.

    Of the distance only the sign is asked.
    """
    low, high = room(solid, 0.6)
    d = solid.dimension
    axes = [
        np.linspace(a, b, per_axis) + 1e-3 * k
        for k, (a, b) in enumerate(zip(low, high, strict=True))
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = (solid.distance(grid.reshape(-1, d)) < 0).reshape(grid.shape[:-1])
    found = []
    for a in range(d):
        before, after = (tuple(slice(None) if b != a else part for b in range(d))
                         for part in (slice(None, -1), slice(1, None)))  # fmt: skip
        turned = inside[before] != inside[after]
        one, two, within = grid[before][turned], grid[after][turned], inside[before][turned]
        for _ in range(30):
            middle = 0.5 * (one + two)
            same = ((solid.distance(middle) < 0) == within)[:, None]
            one, two = np.where(same, middle, one), np.where(same, two, middle)
        found.append(0.5 * (one + two))
    return np.concatenate(found), float(max((high - low) / (per_axis - 1)))


@pytest.mark.parametrize("name", BOUNDS)
def test_distances_in_the_layer_are_those_of_brute_force(name: str) -> None:
    """Up to 0.4 m on either side, as several cells of a grid are."""
    solid = BOUNDS[name]
    surface, pitch = brute(solid, 80 if solid.dimension == 2 else 30)
    low, high = room(solid, 0.0)
    rng = np.random.default_rng(4)
    foot = surface[rng.integers(0, len(surface), 1500)]
    away = rng.normal(size=foot.shape)
    p = foot + away / np.linalg.norm(away, axis=1)[:, None] * rng.uniform(0.1, 0.4, (len(foot), 1))
    if not np.all(np.isfinite(solid.bounds())):  # what is nearest must lie where it was sought
        p = p[np.all((p > low) & (p < high), axis=1)]
    wanted = cKDTree(surface).query(p)[0]
    found = np.abs(solid.distance(p))
    assert np.all(found <= wanted + 1e-6)
    if name not in EXACT:
        return
    near = wanted > 0.15
    assert near.sum() > 100
    # One of the points lies within the pitch of the nearest place: beside it on a smooth surface,
    # which matters little, and past it by as much at edges and corners.
    beyond = (wanted - found)[near]
    assert np.mean(beyond <= np.sqrt(found[near] ** 2 + pitch**2) - found[near]) > 0.85
    assert np.all(beyond <= 1.1 * pitch)


#: A surface mesh: a step from 0.3 to 0.8 m, within the length of one cell.
MESH_PROFILE = [(0.0, 0.0), (2.0, 0.0), (2.0, 0.8), (1.0, 0.8), (0.95, 0.3), (0.0, 0.3)]
MESH_TRIANGLES = [(0, 1, 4), (0, 4, 5), (1, 2, 3), (1, 3, 4)]


def step_mesh(folder: Path) -> shapes.SurfaceMesh:
    """The step as a prism of triangles, 1 m wide, in an OBJ file."""
    n = len(MESH_PROFILE)
    lines = [f"v {x} {y} {z}" for y in (0.0, 1.0) for x, z in MESH_PROFILE]
    faces = MESH_TRIANGLES + [(c + n, b + n, a + n) for a, b, c in MESH_TRIANGLES]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j + n, j), (i, i + n, j + n)]
    lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces]
    (folder / "step.obj").write_text("\n".join(lines))
    return shapes.SurfaceMesh(file=folder / "step.obj")


@pytest.mark.parametrize("name", [*BOUNDS, "mesh"])
def test_nodes_in_the_layer_of_a_boundary_have_brute_forces_distances(
    name: str, tmp_path: Path
) -> None:
    """What the engine is given: every node that the layer reaches, with its distance in cells."""
    solid = step_mesh(tmp_path) if name == "mesh" else BOUNDS[name]
    d, dx, layer = solid.dimension, 0.1, 2
    surface, pitch = brute(solid, 160 if d == 2 else 32)
    low, high = room(solid, 0.35)
    cells = np.ceil((high - low) / dx).astype(int)
    scene = Scene(
        dimension=d,
        cell_size=dx,
        lower=tuple(low.tolist()),
        upper=tuple((low + cells * dx).tolist()),
    )
    scene.add_boundary(
        name="solid", shape=solid, response=Slip(), layer=DecayLayer(thickness=layer)
    )
    field = distance_field(scene, scene.boundaries[0])
    np.testing.assert_array_equal(field.origin, 0)
    assert field.spacing == dx

    node = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1)
    node = node.reshape(-1, d)
    point = node * dx + low
    within = solid.distance(point) < 0
    wanted = cKDTree(surface).query(point)[0]
    if not np.all(np.isfinite(solid.bounds())):  # what is nearest must lie where it was sought
        whole = np.all((point > low + 0.3) & (point < high - 0.3), axis=1)
        node, within, wanted = node[whole], within[whole], wanted[whole]

    of_block = {tuple(k): p for k, p in zip(field.keys.tolist(), field.place.tolist(), strict=True)}
    place = np.array([of_block.get(tuple(k), -2) for k in (node // FIELD_EDGE).tolist()])
    # No node that the layer acts on is left out, nor one deep inside.
    exact = name not in BOUNDS or name in EXACT
    if exact:
        assert np.all(place[~within & (wanted + pitch < layer * dx)] >= 0)
    assert np.all(place[within] >= -1)
    assert np.all(wanted[within & (place == -1)] > 0.3)

    shown = (place >= 0) & (wanted < 0.4)
    corner = np.ravel_multi_index(tuple((node[shown] % FIELD_EDGE).T), (FIELD_EDGE + 1,) * d)
    value = field.values[place[shown], corner] * dx
    assert shown.sum() > 50
    np.testing.assert_array_equal(
        value[np.abs(value) > 1e-5] < 0, within[shown][np.abs(value) > 1e-5]
    )
    assert np.all(np.abs(value) <= wanted[shown] + 1e-5)
    if exact:
        # Beyond a sharp tip, which lines of the lattice miss, the nearest crossing lies further in.
        beyond = wanted[shown] - np.abs(value)
        assert np.mean(beyond <= 1.1 * pitch) > 0.98
        assert np.all(beyond <= 2 * pitch)


def test_no_solid_is_left_out() -> None:
    """A new kind of solid gets its row in `EXACT` or `BOUNDS`."""
    public = {
        kind
        for name in shapes.__all__
        if inspect.isclass(kind := getattr(shapes, name)) and issubclass(kind, shapes.Solid)
    } - {shapes.Solid}
    assert public == {type(solid) for solid in BOUNDS.values()} | {shapes.SurfaceMesh}


def test_a_raster_with_a_step_holds_the_nodes_that_its_profile_drawn_out_holds() -> None:
    """0.226 m within 5 mm, in cells of 0.2 m: nodes far from the step are free."""
    x, z = [0.0, 4.28, 4.285, 8.0], [0.0, 0.0, 0.226, 0.226]
    raster = shapes.HeightField(x=x, y=[-2.0, 3.0], z=[[h, h] for h in z])
    drawn = shapes.Extrusion(
        profile=[(-5, -5), (15, -5), (15, z[-1]), *zip(x[::-1], z[::-1], strict=True), (-5, 0)],
        axis="y", lower=-5, upper=5,
    )  # fmt: skip
    fields = []
    for shape in (raster, drawn):
        scene = Scene(cell_size=0.2, lower=(0, 0, -1), upper=(8, 1, 3))
        scene.add_boundary(name="bed", shape=shape, response=Slip(), layer=DecayLayer(thickness=3))
        field = distance_field(scene, scene.boundaries[0])
        shown = field.place >= 0
        keys = [tuple(k) for k in field.keys[shown].tolist()]
        fields.append(dict(zip(keys, field.values[field.place[shown]], strict=True)))
    shared = [k for k in fields[0] if k in fields[1]]
    assert len(shared) > 10
    for key in shared:
        both = np.minimum(fields[0][key], fields[1][key]) < 3
        np.testing.assert_allclose(fields[0][key][both], fields[1][key][both], atol=1e-5)


@pytest.mark.parametrize(("angle", "warned"), [(20, True), (40, True), (90, False)])
def test_what_a_layer_holds_ahead_of_a_sharp_edge_is_said(angle: float, warned: bool) -> None:
    """Two half-spaces: ahead of their edge distances are sin(angle / 2) of the true ones."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(-2, -1), upper=(2, 1), gravity=(0, -9.81))
    half = np.radians(angle / 2)
    sides = [
        shapes.HalfSpace(point=(0, 0.03), normal=(-np.sin(half), s * np.cos(half))) for s in (1, -1)
    ]
    scene.add_boundary(name="knife", shape=sides[0] & sides[1], response=Slip())
    water = TaitFluid(density=1000, bulk_modulus=1e6)
    scene.add_body(name="water", shape=shapes.Box(lower=(-2, -1), upper=(-1, 0)), material=water)
    if warned:
        with pytest.warns(libmpm.ModelWarning, match="ahead of a sharp edge"):
            scene.validate()
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            scene.validate()
