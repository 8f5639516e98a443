"""Filling shapes with particles."""

from __future__ import annotations

import numpy as np
import pytest

from libmpm._src import sampling


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("per_cell", [1, 4, 8, 9, 27, 64, 5])
def test_counts_of_whole_cells(dimension: int, per_cell: int) -> None:
    upper = (1.0, 0.5, 0.7)[:dimension]
    grid = sampling.lattice((0.0,) * dimension, upper, 0.1, per_cell)
    k = per_cell ** (1 / dimension)
    assert grid.shape == tuple(round(x * k / 0.1) for x in upper)
    points = sampling.positions(grid, [], 0.1)
    assert points.shape == (grid.count, dimension)
    assert sampling.count(grid, [], 0.1) == grid.count
    np.testing.assert_allclose(points.mean(axis=0), np.array(upper) / 2, rtol=1e-12)


def test_points_are_centres_of_equal_slices() -> None:
    grid = sampling.lattice((1.0, 2.0), (1.4, 2.2), 0.1, 4)
    assert grid.shape == (8, 4)
    np.testing.assert_allclose(grid.axis(0), 1.025 + 0.05 * np.arange(8))
    points = sampling.positions(grid, [], 0.1)
    np.testing.assert_allclose(points[:2], [[1.025, 2.025], [1.025, 2.075]])


def test_at_least_one_point() -> None:
    assert sampling.lattice((0.0, 0.0), (0.01, 0.3), 0.1, 1).shape == (1, 3)


def test_ties_do_not_depend_on_rounding() -> None:
    shapes = {
        sampling.lattice((x, 0.0), (x + 0.25, 0.1), 0.1, 1).shape
        for x in np.linspace(0.0, 1000.0, 97)
    }
    assert shapes == {(3, 1)}


@pytest.mark.parametrize("dimension", [2, 3])
def test_holes_against_the_plain_test(dimension: int) -> None:
    grid = sampling.lattice((0.0,) * dimension, (1.0, 0.8, 0.6)[:dimension], 0.1, 2**dimension)
    holes = [
        ([0.2, 0.1, 0.0][:dimension], [0.5, 0.4, 0.3][:dimension]),
        ([0.4, 0.3, 0.2][:dimension], [0.73, 0.9, 0.4][:dimension]),
    ]
    points = sampling.positions(grid, [], 0.1)
    inside = np.zeros(len(points), dtype=bool)
    for low, high in holes:
        inside |= np.all((points >= low) & (points < high), axis=1)
    kept = sampling.positions(grid, holes, 0.1)
    np.testing.assert_array_equal(kept, points[~inside])
    assert sampling.count(grid, holes, 0.1) == len(kept) < len(points)


def test_point_on_a_face_belongs_to_the_hole_above_it() -> None:
    grid = sampling.lattice((0.0, 0.0), (0.5, 0.1), 0.1, 1)
    noise = 1e-13
    kept = sampling.positions(grid, [([0.15 + noise, 0.0], [0.35 - noise, 1.0])], 0.1)
    np.testing.assert_allclose(kept[:, 0], [0.05, 0.35, 0.45])
