"""Closed form of a column of water that settles on held nodes."""

from __future__ import annotations

import numpy as np

__all__ = ["missing_depth"]


def missing_depth(cells: int, per_axis: int = 2) -> float:
    """Return the depth, in cells, that a column of quadratic splines lacks on held lowest nodes.

    In one dimension, with particles on a lattice and small strains, the settled column of so many
    cells solves a linear system: weight of the nodes against ∫ ε², with the strain that APIC
    gathers.
    """
    x = (np.arange(cells * per_axis) + 0.5) / per_axis
    row, cell = np.arange(len(x)), np.floor(x).astype(int)
    xi = x - cell - 0.5
    weight, strain = np.zeros((2, len(x), cells + 2))  # nodes -1, 0, ..., cells
    for k, n in ((-1, 0.5 * (0.5 - xi) ** 2), (0, 0.75 - xi**2), (1, 0.5 * (0.5 + xi) ** 2)):
        weight[row, cell + k + 1] = n
        strain[row, cell + k + 1] = 4 * n * (k - xi)
    mass, b = weight.sum(axis=0)[2:], strain[:, 2:]  # nodes -1 and 0 are held
    settled = np.linalg.solve(b.T @ b, mass)
    # The force is half the square of the depth.
    return float(cells - np.sqrt(2 * np.sum(b @ settled) / per_axis))
