"""Rows that cover a space of parameters."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, sequence, shown
from libmpm._src.errors import SceneError

__all__ = ["full_factorial", "latin_hypercube", "sobol"]

Ranges = Mapping[str, Sequence[float]]


@keywords_only("studies.latin_hypercube", 3, method=False)
def latin_hypercube(ranges: Ranges, n: int, seed: int) -> list[dict[str, float]]:
    """Return `n` rows in which each parameter visits each n-th of its range once.

    `ranges` gives name -> (low, high), each in its own unit, low < high; `n` ≥ 1. The same `seed`
    gives the same rows. Needs scipy: ``pip install libmpm[studies]``. Raises `SceneError`.

    Source: McKay, Beckman, Conover (1979), as in `scipy.stats.qmc.LatinHypercube`.
    """
    label = "studies.latin_hypercube"
    names, low, high, n, seed = _checked(label, ranges, n, seed)
    qmc = need("scipy.stats.qmc", label, "studies")
    return _rows(names, qmc.scale(qmc.LatinHypercube(d=len(names), rng=seed).random(n), low, high))


@keywords_only("studies.sobol", 3, method=False)
def sobol(ranges: Ranges, n: int, seed: int) -> list[dict[str, float]]:
    """Return `n` rows of a scrambled Sobol sequence, more even than random ones.

    `ranges` gives name -> (low, high), each in its own unit, low < high; `n` is a power of two,
    without which the sequence loses its balance. Another `seed` scrambles differently. Needs scipy:
    ``pip install libmpm[studies]``. Raises `SceneError`.

    Source: Sobol (1967), Owen (1998), as in `scipy.stats.qmc.Sobol`.
    """
    label = "studies.sobol"
    names, low, high, n, seed = _checked(label, ranges, n, seed)
    power = n.bit_length() - 1
    if n != 1 << power:
        raise SceneError(
            f"{label}: n is {n}; expected a power of two, which keeps the sequence balanced; use "
            f"{1 << power} or {2 << power}"
        )
    qmc = need("scipy.stats.qmc", label, "studies")
    points = qmc.Sobol(d=len(names), rng=seed).random_base2(power)
    return _rows(names, qmc.scale(points, low, high))


@keywords_only("studies.full_factorial", 1, method=False)
def full_factorial(values: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Return every combination of the values of each parameter; the last name changes fastest.

    `values` gives name -> list of values. Raises `SceneError`.
    """
    check = Checker("studies.full_factorial")
    if not isinstance(values, Mapping) or not values:
        check.fail(f"values is {shown(values, 60)}; expected names with lists of values")
        check.finish()
    lists = {}
    for name, items in values.items():
        found = list(items) if isinstance(items, range) else sequence(items)
        if not found:
            check.fail(f"'{name}' is {shown(items, 60)}; expected a list of one or more values")
        lists[name] = found or []
    check.finish()
    return [dict(zip(lists, row, strict=True)) for row in itertools.product(*lists.values())]


def _checked(
    label: str, ranges: Ranges, n: int, seed: int
) -> tuple[list[str], list[float], list[float], int, int]:
    """Return names, lower and upper ends, number of rows and seed."""
    check = Checker(label)
    n = check.integer("n", n, lower=1)
    seed = check.integer("seed", seed)
    if not isinstance(ranges, Mapping) or not ranges:
        check.fail(f"ranges is {shown(ranges, 60)}; expected names with (low, high)")
        check.finish()
    low, high = [], []
    for name, ends in ranges.items():
        pair = check.vector(f"'{name}'", ends, lengths=(2,))
        if not pair:
            continue
        if pair[0] >= pair[1]:
            check.fail(f"'{name}' is ({pair[0]:g}, {pair[1]:g}); expected (low, high), low < high")
        low.append(pair[0])
        high.append(pair[1])
    check.finish()
    return list(ranges), low, high, n, seed


def _rows(names: Sequence[str], points: Any) -> list[dict[str, float]]:
    return [dict(zip(names, point, strict=True)) for point in points.tolist()]
