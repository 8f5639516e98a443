"""The naive method for functions that are no products over the axes: CPDI and DDMP.

Weights and gradients are dense matrices, particles times all nodes of the domain, by definition:
corners of parallelepipeds are found by corner, integrals over spans between nodes by quadrature.
"""

import itertools

import numpy as np
from scipy import sparse

from support.reference import PAD

GAUSS = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3)  # exact for squares of linear functions


def signs(d):
    return np.array(list(itertools.product((-1, 1), repeat=d)), float)


def bits(d):
    return np.array(list(itertools.product((0, 1), repeat=d)))


class DenseWeights:
    """What lies between the particles at `x` (n, d) and all nodes, each flattened."""

    def __init__(self, x, dx, cells):
        self.x, self.dx, self.cells = x, dx, cells
        axes = [(np.arange(-PAD, n + PAD) + 0.5) * dx for n in cells]
        self.shape = tuple(len(a) for a in axes)
        self.nodes = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, len(cells))
        self.build()
        self.arm = self.nodes - x[:, None]  # (n, nodes, d)
        # Sum of weights times arm times arm.
        self.moment = np.einsum("pi,pia,pib->pab", self.weight, self.arm, self.arm)

    def hats(self, x):
        """Linear functions at points (n, d): (n, nodes)."""
        hat = np.maximum(0.0, 1 - np.abs(x[:, None] - self.nodes) / self.dx)
        return np.prod(np.where(hat < 1e-13, 0.0, hat), axis=-1)  # a rounding away is on the node

    def gather(self, field):
        flat = field.reshape(len(self.nodes), -1)
        out = self.weight @ flat
        return out if field.ndim > len(self.cells) else out[:, 0]

    def scatter(self, q):
        return (self.weight.T @ q).reshape(*self.shape, *q.shape[1:])

    def matrix(self):
        return self.weight

    def affine(self, field):
        """Slope of a node field by moments: the last axis is the direction."""
        moments = np.einsum(
            "pi,ic,pia->pca", self.weight, field.reshape(len(self.nodes), -1), self.arm
        )
        return moments @ np.linalg.inv(self.moment)

    def gradient(self, field, form):
        assert form == "kernel"
        out = np.einsum("pia,ic->pca", self.slope, field.reshape(len(self.nodes), -1))
        return out if field.ndim > len(self.cells) else out[:, 0]

    def scatter_linear(self, mass, value, slope):
        one = value.ndim == 1
        value, slope = (value[:, None], slope[:, None]) if one else (value, slope)
        at = value[:, None] + np.einsum("pca,pia->pic", slope, self.arm)
        out = np.einsum("p,pi,pic->ic", mass, self.weight, at)
        return out.reshape(*self.shape, *([] if one else [-1]))

    def force(self, tau, form):
        assert form == "kernel"
        return -np.einsum("pca,pia->ic", tau, self.slope).reshape(*self.shape, -1)


class CornerWeights(DenseWeights):
    """Particles of half-edge `half` (cells) whose edges have followed `stretch` (n, d, d)."""

    def __init__(self, x, half, stretch, dx, cells):
        self.edges = half * dx * stretch
        super().__init__(x, dx, cells)

    def build(self):
        turned = np.swapaxes(np.linalg.inv(self.edges), 1, 2)
        self.weight, self.slope = 0.0, 0.0
        for side in signs(len(self.cells)):
            at_corner = self.hats(self.x + self.edges @ side)
            self.weight = self.weight + at_corner
            self.slope = self.slope + at_corner[:, :, None] * (turned @ side)[:, None]
        corners = 2 ** len(self.cells)
        self.weight, self.slope = self.weight / corners, self.slope / corners


class DualWeights(DenseWeights):
    """Linear functions; `occupy` gives them their gradients."""

    def build(self):
        self.weight = self.hats(self.x)
        self.slope = None

    def occupy(self, mass):
        """Gradients, from where nodes have mass."""
        d, dx = len(self.cells), self.dx
        # On a node the upper span counts, and between them all functions but its own vanish.
        place = self.x / dx - 0.5 + PAD
        low = np.floor(place).astype(int)
        s = place - low
        numbers = np.arange(len(self.nodes)).reshape(self.shape)
        plain = np.zeros((*self.weight.shape, d))
        for up in bits(d):
            node = numbers[tuple((low + up).T)]
            for a in range(d):
                factor = np.where(up == 1, s, 1 - s)
                factor[:, a] = (1.0 if up[a] else -1.0) / dx
                plain[np.arange(len(node)), node, a] = factor.prod(axis=1)
        # Spans by their lowest node, those with mass at all of their nodes.
        held = np.ones(tuple(n - 1 for n in self.shape), bool)
        for up in bits(d):
            part = tuple(slice(u, n - 1 + u) for u, n in zip(up, self.shape, strict=True))
            held &= mass[part] > 0
        spans = np.argwhere(held)
        points = np.array(list(itertools.product(GAUSS, repeat=d)))
        values = {tuple(u): np.where(u == 1, points, 1 - points) for u in bits(d)}
        volume = np.zeros(len(self.nodes))
        entries = [([], [], []) for _ in range(d)]
        for j in bits(d):
            n_j, row = values[tuple(j)].prod(axis=1), numbers[tuple((spans + j).T)]
            np.add.at(volume, row, n_j.mean())
            for i in bits(d):
                column = numbers[tuple((spans + i).T)]
                for a in range(d):
                    slope = values[tuple(i)].copy()
                    slope[:, a] = (1.0 if i[a] else -1.0) / dx
                    integral = np.mean(n_j * slope.prod(axis=1))
                    for kept, new in zip(
                        entries[a], (row, column, np.full(len(row), integral)), strict=True
                    ):
                        kept.append(new)
        alpha = 0.5 * np.prod(4 * s * (1 - s), axis=1) ** (2 ** (d - 1))
        means = self.weight / np.where(volume > 0, volume, np.inf)
        self.slope = alpha[:, None, None] * plain
        for a in range(d):
            row, column, value = (np.concatenate(e) for e in entries[a])
            b = sparse.coo_matrix((value, (row, column)), shape=(len(self.nodes),) * 2).tocsr()
            self.slope[:, :, a] += (1 - alpha)[:, None] * (b.T @ means.T).T
