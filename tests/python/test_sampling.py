"""Filling shapes with particles."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import pytest

from libmpm._src.shapes import lattices

Hole = tuple[Sequence[float], Sequence[float]]


def positions(grid: lattices.Lattice, holes: Sequence[Hole]) -> npt.NDArray[np.float64]:
    """All points of a lattice in cells of 0.1 m."""
    points = lattices.points(grid, holes, 0.1)
    return points.rows(0, points.count)


def two_holes(dimension: int) -> list[Hole]:
    """Holes that overlap each other, the second one reaching out of the lattice."""
    return [
        ([0.2, 0.1, 0.0][:dimension], [0.5, 0.4, 0.3][:dimension]),
        ([0.4, 0.3, 0.2][:dimension], [0.73, 0.9, 0.4][:dimension]),
    ]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("per_cell", [1, 4, 8, 9, 27, 64, 5])
def test_counts_of_whole_cells(dimension: int, per_cell: int) -> None:
    upper = (1.0, 0.5, 0.7)[:dimension]
    grid = lattices.lattice((0.0,) * dimension, upper, 0.1, per_cell)
    k = per_cell ** (1 / dimension)
    assert grid.shape == tuple(round(x * k / 0.1) for x in upper)
    points = positions(grid, [])
    assert points.shape == (grid.count, dimension)
    np.testing.assert_allclose(points.mean(axis=0), np.array(upper) / 2, rtol=1e-12)


def test_points_are_centres_of_equal_slices() -> None:
    grid = lattices.lattice((1.0, 2.0), (1.4, 2.2), 0.1, 4)
    assert grid.shape == (8, 4)
    np.testing.assert_allclose(grid.axis(0), 1.025 + 0.05 * np.arange(8))
    points = positions(grid, [])
    np.testing.assert_allclose(points[:2], [[1.025, 2.025], [1.025, 2.075]])


def test_at_least_one_point() -> None:
    assert lattices.lattice((0.0, 0.0), (0.01, 0.3), 0.1, 1).shape == (1, 3)


def test_ties_do_not_depend_on_rounding() -> None:
    shapes = {
        lattices.lattice((x, 0.0), (x + 0.25, 0.1), 0.1, 1).shape
        for x in np.linspace(0.0, 1000.0, 97)
    }
    assert shapes == {(3, 1)}


@pytest.mark.parametrize("dimension", [2, 3])
def test_holes_against_the_plain_test(dimension: int) -> None:
    grid = lattices.lattice((0.0,) * dimension, (1.0, 0.8, 0.6)[:dimension], 0.1, 2**dimension)
    holes = two_holes(dimension)
    points = positions(grid, [])
    inside = np.zeros(len(points), dtype=bool)
    for low, high in holes:
        inside |= np.all((points >= low) & (points < high), axis=1)
    kept = positions(grid, holes)
    np.testing.assert_array_equal(kept, points[~inside])
    assert len(kept) < len(points)


def test_point_on_a_face_belongs_to_the_hole_above_it() -> None:
    grid = lattices.lattice((0.0, 0.0), (0.5, 0.1), 0.1, 1)
    noise = 1e-13
    kept = positions(grid, [([0.15 + noise, 0.0], [0.35 - noise, 1.0])])
    np.testing.assert_allclose(kept[:, 0], [0.05, 0.35, 0.45])


def test_nothing_is_left() -> None:
    grid = lattices.lattice((0.0, 0.0), (0.5, 0.3), 0.1, 4)
    assert positions(grid, [([-1.0, -1.0], [1.0, 1.0])]).shape == (0, 2)


@pytest.mark.parametrize("with_holes", [False, True])
@pytest.mark.parametrize("dimension", [2, 3])
def test_pieces_are_the_whole(dimension: int, with_holes: bool) -> None:
    """Wherever the rows are cut: within lines and sections, at their ends, in a hole's run."""
    grid = lattices.lattice((0.0,) * dimension, (1.0, 0.8, 0.6)[:dimension], 0.1, 2**dimension)
    points = lattices.points(grid, two_holes(dimension) if with_holes else [], 0.1)
    n = points.count
    whole = points.rows(0, n)
    random = np.random.default_rng(2)
    for size in (1, 2, 7, 12, 16, 192, 193, n // 2, n):
        cuts = [*range(0, n, size), n]
        pieces = [points.rows(a, b) for a, b in pairwise(cuts)]
        np.testing.assert_array_equal(np.concatenate(pieces), whole)
    for first, last in np.sort(random.integers(0, n + 1, (200, 2)), axis=1).tolist():
        np.testing.assert_array_equal(points.rows(first, last), whole[first:last])
    for wrong in ((-1, 2), (3, 2), (n - 1, n + 1)):
        with pytest.raises(IndexError, match=f"of {n} points"):
            points.rows(*wrong)


@pytest.mark.parametrize("with_holes", [False, True])
def test_two_billion_points(with_holes: bool) -> None:
    """Any rows come at once and take the memory that they fill."""
    grid = lattices.lattice((0.0,) * 3, (63.0,) * 3, 0.1, 8)
    assert grid.count == 1260**3 > 2e9
    holes: list[Hole] = [([1.0, 1.0, 1.0], [3.0, 3.0, 3.0]), ([2.0, 2.0, 0.0], [5.0, 8.0, 2.5])]
    tracemalloc.start()
    began = time.perf_counter()
    points = lattices.points(grid, holes if with_holes else [], 0.1)
    n = points.count
    end, middle = points.rows(n - 1000, n), points.rows(n // 2, n // 2 + 100_000)
    wall, (_, peak) = time.perf_counter() - began, tracemalloc.get_traced_memory()
    tracemalloc.stop()
    # 40³ points in the first hole, 60 × 120 × 50 in the second, 20 × 20 × 30 in both.
    assert grid.count - n == (64_000 + 360_000 - 12_000 if with_holes else 0)
    np.testing.assert_allclose(end[[0, -1]], [[62.975, 62.975, 13.025], [62.975] * 3], rtol=1e-12)
    assert peak < 1.1 * (end.nbytes + middle.nbytes) + 200_000
    assert wall < 0.5  # some milliseconds on an idle machine
