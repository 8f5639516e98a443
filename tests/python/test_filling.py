"""Bodies of any shape: their particles, masses, pieces, subtractions and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

import libmpm
from libmpm import Scene, boundaries, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm._src.shapes import filling
from support.scenes import with_arrays

Array = npt.NDArray[np.float64]
Make = Callable[..., Scene]
WATER = materials.TaitFluid(density=1000.0, bulk_modulus=1e6)
WOOD = materials.FixedCorotated(density=600.0, youngs_modulus=1e6, poissons_ratio=0.3)
CELL = 0.05
BALL = shapes.Sphere(centre=(0.5, 0.5, 0.5), radius=0.3)
BED = shapes.HeightField(
    x=[0, 0.4, 1], y=[0, 0.5, 1], z=[[0.2, 0.3, 0.2], [0.4, 0.6, 0.1], [0.2, 0.2, 0.2]]
)
WHOLE = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1))


def room(dimension: int = 3, **changes: Any) -> Scene:
    arguments: dict[str, Any] = {
        "dimension": dimension,
        "cell_size": CELL,
        "lower": (0.0,) * dimension,
        "upper": (1.0,) * dimension,
        "gravity": (0.0,) * (dimension - 1) + (-9.81,),
    }
    return Scene(**(arguments | changes))


def body_of(shape: Any, **changes: Any) -> dict[str, Any]:
    """The specification of a body alone in a room, with its rows as an array."""
    scene = room(shape.dimension)
    scene.add_body(name="body", shape=shape, material=WATER, **changes)
    return with_arrays(lower(scene))["bodies"][0]


def mass(body: dict[str, Any]) -> float:
    return body["particle_mass"] * body["count"]


def test_the_lattice_is_that_of_the_cells() -> None:
    """Half a spacing from cell faces, all that is inside and nothing else."""
    found = body_of(BALL)
    spacing = CELL / 2
    axis = (np.arange(40) + 0.5) * spacing
    every = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = every[BALL.distance(every) < 0]
    order = np.lexsort(found["position"].T[::-1])
    assert np.array_equal(found["position"][order], expected)


@pytest.mark.parametrize(
    ("shape", "volume"),
    [
        (BALL, 4 / 3 * math.pi * 0.027),
        (BALL - shapes.Box(lower=(0.5, 0.5, 0.5), upper=(1, 1, 1)), 7 / 6 * math.pi * 0.027),
        (shapes.Sphere(centre=(0.5, 0.5), radius=0.3), math.pi * 0.09),
        (shapes.basin(level=0.7, bed=BED, within=WHOLE), None),
    ],
)
@pytest.mark.parametrize(
    "how", [None, shapes.Jitter(share=0.6, seed=3), shapes.PoissonDisk(seed=3)]
)
def test_masses_are_exact(shape: shapes.Solid, volume: float | None, how: Any) -> None:
    if volume is None:
        deep = shapes.HeightField(x=BED.x, y=BED.y, z=BED.z, base=0.0)
        volume = 0.7 - deep.volume()
    found = body_of(shape, sampling=how)
    exact = shape.volume() is not None
    assert mass(found) == pytest.approx(1000.0 * volume, rel=1e-12 if exact else 5e-4)
    # The particles stand for cells nearly evenly: as many as the volume holds slices.
    assert found["count"] == pytest.approx(volume / (CELL / 2) ** shape.dimension, rel=0.03)
    assert np.all(shape.distance(found["position"]) < 1e-9)


@pytest.mark.parametrize(
    "how", [None, shapes.Jitter(share=1.0, seed=9), shapes.PoissonDisk(seed=9)]
)
@pytest.mark.parametrize("plain", [True, False])
def test_pieces_are_of_one_whole(how: Any, plain: bool) -> None:
    scene = room()
    if plain:
        scene.add_body(name="water", shape=WHOLE, material=WATER, sampling=how)
    else:
        water = shapes.basin(level=0.7, bed=BED, within=WHOLE)
        scene.add_body(name="water", shape=water, material=WATER, sampling=how)
    scene.add_body(name="ball", shape=BALL, material=WOOD, subtract_from="water")
    body = lower(scene)["bodies"][0]
    n = body["count"]
    whole = body["position"](0, n)
    assert len(whole) == n
    for step in (1, 977):
        starts = range(0, n, step) if step > 1 else (0, 1, n // 2, n - 1)
        for i in starts:
            assert np.array_equal(body["position"](i, min(n, i + step)), whole[i : i + step])
    with pytest.raises(IndexError):
        body["position"](0, n + 1)
    assert BALL.distance(whole).min() > -1e-9
    filling._solid.cache_clear()
    filling._box.cache_clear()
    assert np.array_equal(lower(scene)["bodies"][0]["position"](0, n), whole)


def test_tiles_decide_as_single_points_do() -> None:
    """What is taken as a whole because of its middle is what every point would say."""
    tile = filling.lattice_tile(3)
    solid = shapes.basin(level=0.7, bed=BED, within=WHOLE) | BALL.moved((0, 0, 0.1))

    class Unsure(shapes.Difference):
        bounding = False

    parts = (shapes.Box(lower=(-1, -1, -1), upper=(2, 2, 2)), solid)
    sure = filling.Tiled(parts[0] & solid, [], tile, (0, 0, 0), CELL / 2, WHOLE.bounds())
    wary = filling.Tiled(
        Unsure(whole=solid, without=shapes.Sphere(centre=(9, 9, 9), radius=1.0)),
        [], tile, (0, 0, 0), CELL / 2, WHOLE.bounds(),
    )  # fmt: skip
    assert np.array_equal(sure.rows(0, sure.count), wary.rows(0, wary.count))


def test_large_bodies_are_counted_by_their_surface() -> None:
    """10⁷ particles: whole tiles need no point to be made."""
    scene = room(cell_size=1.0, lower=(0, 0, 0), upper=(140, 140, 140))
    ball = shapes.Sphere(centre=(70, 70, 70), radius=67.0)
    scene.add_body(name="ball", shape=ball, material=WATER)
    found = filling.fill(scene, scene.bodies[0]).points
    assert found.count == pytest.approx(8 * ball.volume(), rel=1e-3)
    assert len(found.rows(10**7, 10**7 + 1000)) == 1000


def test_boxes_without_anything_new_are_as_before() -> None:
    plain = body_of(WHOLE)
    assert plain["count"] == 40**3
    # The formula of the lattice, bit for bit.
    assert plain["position"][1].tolist() == [0.5 / 40, 0.5 / 40, 1.5 * (1 / 40)]
    assert plain["particle_mass"] == 1000.0 * 1.0 / 40**3
    for how in (shapes.Jitter(share=0.5, seed=1), shapes.PoissonDisk(seed=1)):
        assert mass(body_of(WHOLE, sampling=how)) == pytest.approx(1000.0, rel=1e-12)


@pytest.mark.parametrize(
    "shape",
    [
        shapes.Box(lower=(0.1, 0.2), upper=(0.9, 0.77)),
        shapes.OrientedBox(centre=(0.5, 0.5), size=(0.6, 0.3), angle=30),
    ],
)
def test_jitter_keeps_to_its_slices(shape: Any) -> None:
    share = 0.8
    plain, moved = (
        body_of(shape, sampling=how)["position"]
        for how in (None, shapes.Jitter(share=share, seed=5))
    )
    box = shape.turned_box()
    own = (moved - plain) @ np.array(box.axes)
    counts = [len(np.unique(np.round((plain @ np.array(box.axes))[:, a], 9))) for a in range(2)]
    half = 0.5 * share * np.array(box.size) / counts
    assert np.all(np.abs(own) <= half + 1e-12)
    # Evenly distributed and independent: the standard deviation is half / √3.
    assert np.std(own / half, axis=0) == pytest.approx(np.full(2, 1 / math.sqrt(3)), rel=0.08)
    assert abs(np.corrcoef(own.T)[0, 1]) < 4 / math.sqrt(len(own))
    assert np.all(shape.distance(moved) < 0)
    other = body_of(shape, sampling=shapes.Jitter(share=share, seed=6))["position"]
    assert not np.any(np.all(other == moved, axis=1))


@pytest.mark.parametrize(("dimension", "least"), [(2, 0.78), (3, 0.82)])
def test_poisson_disks_keep_apart_across_tiles(dimension: int, least: float) -> None:
    scene = room(dimension, cell_size=0.02 if dimension == 2 else 0.05)
    box = shapes.Box(lower=(0.0,) * dimension, upper=(1.0,) * dimension)
    scene.add_body(name="body", shape=box, material=WATER, sampling=shapes.PoissonDisk(seed=2))
    found = with_arrays(lower(scene))["bodies"][0]["position"]
    spacing = scene.cell_size / 2
    nearest = cKDTree(found).query(found, k=2)[0][:, 1]
    assert nearest.min() >= least * spacing
    assert nearest.max() < 2 * spacing
    assert len(found) == pytest.approx(spacing**-dimension, rel=0.01)


def test_subtractions_leave_the_exact_mass() -> None:
    """A cylinder in a box of water, and a wedge that reaches out of it."""
    log = shapes.Cylinder(start=(0.3, 0.3, 0.2), end=(0.6, 0.5, 0.4), radius=0.1)
    ramp = shapes.Wedge(lower=(0.7, 0, 0), upper=(1, 1, 0.9))
    scene = room()
    water = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 0.6))
    scene.add_body(name="water", shape=water, material=WATER, hydrostatic=0.6)
    scene.add_body(name="log", shape=log, material=WOOD, subtract_from="water")
    scene.add_body(name="ramp", shape=ramp, material=WOOD, subtract_from="water")
    found = with_arrays(lower(scene))["bodies"]
    # Below 0.6 of 0.9 m the ramp has 1 - (1/3)² of its section.
    shared = ramp.volume() * (1 - 1 / 9)
    assert mass(found[0]) == pytest.approx(1000 * (0.6 - log.volume() - shared), rel=5e-4)
    p = found[0]["position"]
    assert min(log.distance(p).min(), ramp.distance(p).min()) > -1e-9
    assert found[0]["pressure"] == pytest.approx(9810 * (0.6 - p[:, 2]))


def test_a_basin_is_filled_to_its_level() -> None:
    flat = shapes.HeightField.from_list([(0, 0.1), (0.5, 0.4), (1, 0.2)])
    sill = shapes.Box(lower=(0.7, 0), upper=(0.8, 0.5))
    water = shapes.basin(level=0.6, bed=(flat, sill), within=shapes.Box(lower=(0, 0), upper=(1, 1)))
    for sampling in (None, shapes.Columns()):
        found = body_of(water, sampling=sampling)["position"]
        # A point on the bed itself may belong to the water.
        assert np.all(found[:, 1] > flat.height(found[:, :1]) - 1e-9)
        # Columns are divided evenly: their upper points are half of a spacing of their own deep.
        assert found[:, 1].max() == pytest.approx(0.5875, abs=1e-3 if sampling else 1e-9)
        assert not np.any((found[:, 0] > 0.7) & (found[:, 0] < 0.8) & (found[:, 1] < 0.5))
    with pytest.raises(libmpm.SceneError, match="level is 2 m; expected above 0 and at most 1 m"):
        shapes.basin(level=2, bed=flat, within=shapes.Box(lower=(0, 0), upper=(1, 1)))


def test_particles_from_files(tmp_path: Any) -> None:
    rng = np.random.default_rng(0)
    p = 0.2 + 0.6 * rng.random((500, 3))
    np.save(tmp_path / "p.npy", p)
    np.savetxt(tmp_path / "p.csv", p, delimiter=",", header="x,y,z", comments="", fmt="%.17g")
    np.savetxt(tmp_path / "p.xyz", p, fmt="%.17g")
    for name in ("p.npy", "p.csv", "p.xyz"):
        shape = shapes.PointFile(file=tmp_path / name, volume=0.25)
        found = body_of(shape)
        assert np.array_equal(found["position"], p)
        assert mass(found) == pytest.approx(250.0, rel=1e-12)
        assert shapes.PointFile.from_dict(shape.to_dict()) == shape
    half = shapes.PointFile(
        file=str(tmp_path / "p.npy"), particle_volume=1e-4, scale=0.5, offset=(0.1, 0, 0)
    )
    assert np.array_equal(body_of(half)["position"], 0.5 * p + (0.1, 0, 0))
    assert mass(body_of(half)) == pytest.approx(50.0, rel=1e-12)
    np.save(tmp_path / "p.npy", p[1:])
    with pytest.raises(libmpm.SceneError, match="expected the same file"):
        shapes.PointFile.from_dict(half.to_dict())
    np.save(tmp_path / "p.npy", p[:, 0])
    for ending, words in ((".npy", r"\(500,\); expected \(n, 2\)"), (".doc", "cannot be read")):
        with pytest.raises(libmpm.SceneError, match=words):
            shapes.PointFile(file=tmp_path / f"p{ending}", volume=1.0)
    with pytest.raises(libmpm.SceneError, match="neither volume nor particle_volume given"):
        shapes.PointFile(file=tmp_path / "p.csv")


def test_scenes_with_solids_survive_files(tmp_path: Any) -> None:
    scene = room()
    water = shapes.basin(level=0.7, bed=BED, within=WHOLE)
    scene.add_body(name="a", shape=water, material=WATER, sampling=shapes.Jitter(share=0.5, seed=1))
    scene.add_body(name="b", shape=BALL, material=WOOD, subtract_from="a")
    scene.save(tmp_path / "scene.json")
    again = Scene.load(tmp_path / "scene.json")
    assert again == scene
    one, two = (with_arrays(lower(s))["bodies"] for s in (scene, again))
    assert all(np.array_equal(a["position"], b["position"]) for a, b in zip(one, two, strict=True))


def add(scene: Scene, name: str, shape: Any, **changes: Any) -> None:
    scene.add_body(name=name, shape=shape, material=WATER, **changes)


def test_overlaps_say_how_deep() -> None:
    scene = room()
    add(scene, "one", BALL)
    add(scene, "two", shapes.Sphere(centre=(0.5, 0.5, 0.9), radius=0.15))
    with pytest.raises(
        libmpm.SceneError, match=r"'one': with body 'two': the bodies overlap by 0\.02\d+, or more"
    ):
        scene.validate()
    apart = room()
    add(apart, "one", BALL - WHOLE.moved((0.5, 0, 0)))
    add(apart, "two", BALL & WHOLE.moved((0.5, 0, 0)))
    apart.validate()


def test_what_leaves_the_domain_is_refused() -> None:
    scene = room()
    add(scene, "ball", BALL.moved((0.3, 0, 0)))
    with pytest.raises(libmpm.SceneError, match=r"'ball': the body spans .* or more on axis 0"):
        scene.validate()
    # The box around a turned ball is wider than the ball, and reaches out.
    inside = room()
    ball = shapes.Sphere(centre=(0.5, 0.5, 0.5), radius=0.45).turned(45)
    assert ball.bounds()[1][0] > 1
    add(inside, "ball", ball)
    inside.validate()


def test_what_cannot_be_filled_is_refused(tmp_path: Any) -> None:
    np.save(tmp_path / "p.npy", [[0.5, 0.5, 0.5]])
    grains = shapes.PointFile(file=tmp_path / "p.npy", volume=1e-3)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"shape": BED}, r"no end on axis 0, 1, 2; expected one inside the domain; cut it with"),
        ({"shape": BALL.moved((5, 0, 0))}, "expected inside the domain"),
        ({"shape": shapes.Sphere(centre=(0, 0), radius=1)}, "shape has 2 numbers; expected 3"),
        (
            {"shape": grains, "sampling": shapes.PoissonDisk(seed=1)},
            "whose particles are given; expected None",
        ),
        (
            {"shape": WHOLE, "sampling": shapes.PoissonDisk(seed=1), "lattice": (3, 3, 3)},
            "expected one of the two",
        ),
        ({"shape": grains, "subtract_from": "other"}, "which has no inside"),
    ]
    for changes, words in cases:
        scene = room()
        scene.add_body(name="body", material=WATER, **changes)
        with pytest.raises(libmpm.SceneError, match=words):
            scene.validate()
    for changes, words in (
        ({"sampling": "jitter"}, "sampling is 'jitter'; expected"),
        ({"lattice": (3, 3, 3)}, "of a shapes.Box or an OrientedBox"),
    ):
        with pytest.raises(libmpm.SceneError, match=words):
            room().add_body(name="body", shape=BALL, material=WATER, **changes)
    for make, words in (
        (lambda: shapes.Jitter(share=1.5, seed=1), "share is 1.5; expected > 0 and ≤ 1"),
        (lambda: shapes.PoissonDisk(seed=-1), "seed is -1"),
    ):
        with pytest.raises(libmpm.SceneError, match=words):
            make()


def test_bodies_inside_a_blocked_box_are_refused() -> None:
    scene = room()
    add(scene, "ball", BALL)
    pier = shapes.Box(lower=(0.5, 0.5, 0), upper=(0.6, 0.6, 0.5))
    scene.add_boundary(name="pier", shape=pier, response=boundaries.Slip())
    with pytest.raises(libmpm.SceneError, match=r"'ball': reaches .* m into boundary 'pier'"):
        scene.validate()


def test_thin_solids_are_doubted() -> None:
    scene = room()
    add(scene, "plate", shapes.Cylinder(start=(0.5, 0.5, 0.5), end=(0.5, 0.5, 0.55), radius=0.3))
    with pytest.warns(libmpm.ModelWarning, match=r"'plate': 0.05 m thick on axis 2"):
        scene.validate()


def test_water_above_a_bed_runs() -> None:
    scene = room(2, upper=(1.0, 1.0))
    bed = shapes.HeightField.from_list([(0, 0.2), (0.5, 0.3), (1, 0.1)])
    water = shapes.basin(level=0.6, bed=bed, within=shapes.Box(lower=(0, 0), upper=(1, 1)))
    scene.add_body(name="water", shape=water, material=WATER, hydrostatic=0.6)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    sim = libmpm.Simulation(scene)
    sim.run(until=0.01)
    assert 0.01 <= sim.time < 0.011


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("devices", ["cpu", ["cpu", "cpu"]])
def test_the_engine_makes_lattices_as_numpy_does(
    dimension: int, devices: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bit by bit: the engine's own rows of positions and pressures, and those of a function."""
    scene = Scene(
        dimension=dimension, cell_size=0.07, lower=(0.3,) * dimension, upper=(1.7,) * dimension,
        gravity=(0.5,) * (dimension - 1) + (-9.81,),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.3,) * dimension, upper=(1.3,) * dimension),
        material=materials.TaitFluid(density=1000, bulk_modulus=1e5), hydrostatic=1.1,
    )  # fmt: skip
    hole = shapes.Box(lower=(0.6,) * dimension, upper=(0.93,) * dimension)
    solid = materials.FixedCorotated(density=900, youngs_modulus=1e5, poissons_ratio=0.3)
    scene.add_body(name="log", shape=hole, material=solid, subtract_from=("water",))

    def start() -> list[npt.NDArray[Any]]:
        sim = libmpm.Simulation(scene, device=devices, precision="double", threads=1)
        water = sim.particles["water"]
        return [np.array(water[name]) for name in ("id", "position", "pressure")]

    own = start()
    monkeypatch.setattr("libmpm._src.run.engine_spec.at_hand", lambda points: points.rows)
    for a, b in zip(own, start(), strict=True):
        assert np.array_equal(a, b)
    assert own[2].max() > 0
