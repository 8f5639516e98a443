"""What distances from a bed cost: little beside a wall, estimated and bounded before they are paid.

Expected duration: 8 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, shapes
from libmpm._src.boundaries import distance_field
from libmpm._src.boundaries.covered_faces import Covers
from libmpm._src.shapes.height_field import HeightField
from libmpm._src.shapes.raster_distance import PatchTree, _ruled_distance2
from support import fuzz_scenes, fuzzing


def bed_between_walls(cell):
    """The bed of the scene with which the attack on scenes found a hang, in its domain of 2 m."""
    scene = libmpm.Scene(dimension=3, cell_size=cell, lower=(0, 0, 0), upper=(2, 2, 2))
    walls = shapes.DomainWalls(faces=("x-", "y-"))
    scene.add_boundary(name="sides", shape=walls, response=boundaries.Mirror())
    height = ((0.1, 0.1), (0.2, 0.2), (0.3, 0.1))
    bed = shapes.HeightField(x=(0, 1, 2), y=(0, 2), z=height, base=-0.2)
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Separable())
    return scene, scene.boundaries[1]


@pytest.fixture
def asked(monkeypatch):
    """Points of which a bed was asked for the distance, and behind which walls were looked."""
    counts = {"distances": 0, "points": 0}
    distance, seen = HeightField._distance, Covers.seen

    def counted(self, p):
        counts["distances"] += len(p)
        return distance(self, p)

    def looked(self, of, points, *more):
        counts["points"] += len(points)
        return seen(self, of, points, *more)

    monkeypatch.setattr(HeightField, "_distance", counted)
    monkeypatch.setattr(Covers, "seen", looked)
    distance_field._sampled.cache_clear()
    return counts


def test_points_beside_walls_cost_few_distances(asked):
    """A face that is seen at once is not looked for in seven steps, and no point is asked twice."""
    scene, bed = bed_between_walls(0.04)
    field = distance_field.distance_field(scene, bed)
    edge = distance_field.FIELD_EDGE
    blocks = len(field.values)
    assert asked["points"] < 1.6 * blocks * edge**3
    assert asked["distances"] < 20 * asked["points"], asked


@pytest.mark.slow
def test_a_scene_in_cells_ten_times_finer_is_judged_in_less_than_the_patience():
    """8 million cells: distances alone took 39 s of processor time; 20 s count as a hang."""
    document = fuzz_scenes._solids().to_dict()
    scene = libmpm.Scene.from_dict(document | {"cell_size": 0.1 * document["cell_size"]})
    distance_field._sampled.cache_clear()
    with fuzzing.bounded():
        scene.validate()


def test_a_long_wait_is_estimated_before_it_begins(asked, monkeypatch):
    scene, bed = bed_between_walls(0.04)
    monkeypatch.setattr(distance_field, "_LONG", 1e-3)
    monkeypatch.setattr(distance_field, "_MEASURED", 10)
    before = []

    def noted(self, of, points, *more):
        before.append(dict(asked))
        raise KeyboardInterrupt

    monkeypatch.setattr(Covers, "seen", noted)
    with (
        pytest.warns(libmpm.ModelWarning, match=r"HeightField.*blocks of 0.32 m will take about"),
        pytest.raises(KeyboardInterrupt),
    ):
        distance_field.distance_field(scene, bed)
    assert before and before[0]["distances"] < 2000


def test_more_distances_than_memory_holds_are_refused_before_they_are_taken(asked, monkeypatch):
    scene, _ = bed_between_walls(0.04)
    water = libmpm.materials.TaitFluid(bulk_modulus=1e5)
    box = shapes.Box(lower=(0.5, 0.5, 0.5), upper=(0.7, 0.7, 0.7))
    scene.add_body(name="w", shape=box, material=water)
    monkeypatch.setattr(distance_field, "_MOST_BYTES", 100 * 4 * 9**3)
    with pytest.raises(
        libmpm.SceneError, match=r"blocks of 0.32 m are needed; expected ≤ 100; use"
    ):
        scene.validate()
    assert asked["points"] == 0
    assert asked["distances"] < 2000


@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 2), (3, 7), (13, 9)])
def test_the_nearest_patch_is_that_of_all(size):
    rng = np.random.default_rng(size[0])
    x, y = (np.cumsum(rng.uniform(0.2, 1.0, n + 1)) for n in size)
    z = rng.uniform(0.0, 1.0, (len(x), len(y)))
    tree = PatchTree(x, y, z)
    p = rng.uniform(-1.0, 6.0, (500, 3))
    found = tree.distance(p, np.full(len(p), 1e3))
    best = np.full(len(p), np.inf)
    for i in range(size[0]):
        for j in range(size[1]):
            n = len(p)
            square = _ruled_distance2(
                (p[:, 0] - x[i], p[:, 1] - y[j], p[:, 2] - z[i, j]),
                (np.full(n, x[i + 1] - x[i]), np.full(n, y[j + 1] - y[j])),
                (np.full(n, z[i + 1, j] - z[i, j]), np.full(n, z[i, j + 1] - z[i, j])),
                np.full(n, z[i + 1, j + 1] - z[i + 1, j] - z[i, j + 1] + z[i, j]),
            )
            best = np.minimum(best, square)
    np.testing.assert_allclose(found, np.sqrt(best), rtol=1e-13, atol=1e-13)
