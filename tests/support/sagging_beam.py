"""A beam with both ends held, under water whose surface is level, solved to any deflection.

The truth of `element_load_cases.beam_under_water`: no term of a series, no small angle, and water
that runs to where the beam is deepest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from support.element_cases import SHEAR

__all__ = ["sunk_exactly"]

Array = NDArray[np.float64]
_ACROSS = np.polynomial.legendre.leggauss(4)
#: Of a piece's length, from 0 to 1.
_ALONG = [((p + 1) / 2, w / 2) for p, w in zip(*np.polynomial.legendre.leggauss(3), strict=True)]
_GRAVITY, _WATER = 9.81, 1000.0


class _Half:
    """The left half of the beam in pieces: a Reissner beam of NeoHookean fibres, ν = 0, plane.

    Unknown are x, y and the turn θ of each section, m and rad. Energies are J/m.
    """

    def __init__(
        self, modulus: float, pieces: int, cell: float, *, long: float, high: float,
        density: float, deep: float, level: bool,
    ) -> None:  # fmt: skip
        self.shear_modulus, self.n = modulus / 2, pieces
        self.half, self.high, self.density, self.deep = long / 2, high, density, deep
        self.piece = self.half / pieces
        self.level = level
        # The walls that hold the water stand half a cell inside the last nodes that are held.
        place = np.linspace(0, self.half, pieces + 1)
        self.wet = np.clip((place[1:] - cell / 2) / self.piece, 0, 1)[:, None]
        self.volume = (self.half - cell / 2) * deep

    def sections(self, unknown: Array) -> Array:
        """Return x, y, θ of all sections (3, n + 1, columns): held at the left, symmetric."""
        n = self.n
        out = np.zeros((3, n + 1, unknown.shape[1]))
        out[0, -1] = self.half
        out[0, 1:-1], out[1, 1:], out[2, 1:-1] = np.split(unknown, [n - 1, 2 * n - 1])
        return out

    def energy(self, ends: NDArray[np.complex128], surface: Array, pull: float) -> Array:
        """Return the energy of each piece (n, columns) by x, y, θ of both its ends.

        Fibres at z have the stretch 1 + ε - κ z and the energy μ/2 (λ² - 1 - 2 ln λ); water adds
        -ρ g ∫ (h - y)² / 2 dx over the upper face, whose variation at this level h is its pressure.
        """
        x0, y0, t0, x1, y1, t1 = ends
        turn, along, up = (t0 + t1) / 2, (x1 - x0) / self.piece, (y1 - y0) / self.piece
        stretch = along * np.cos(turn) + up * np.sin(turn)
        slides = up * np.cos(turn) - along * np.sin(turn)
        stored = 0.5 * self.shear_modulus * SHEAR * self.high * slides**2
        for z, weight in zip(*_ACROSS, strict=True):
            fibre = stretch - z * self.high / 2 * (t1 - t0) / self.piece
            share = weight * self.high / 2
            stored = stored + share * 0.5 * self.shear_modulus * (fibre**2 - 1 - 2 * np.log(fibre))
        load = self.density * self.high
        if not self.level:
            load = load + _WATER * self.deep * self.wet
        total = self.piece * (stored + load * pull * (y0 + y1) / 2)
        if not self.level:
            return total
        left, low = x0 - self.high / 2 * np.sin(t0), y0 + self.high / 2 * np.cos(t0)
        right, high = x1 - self.high / 2 * np.sin(t1), y1 + self.high / 2 * np.cos(t1)
        for place, weight in _ALONG:
            depth = surface - low - place * (high - low)
            depth = np.where(depth.real > 0, depth, 0)
            total = total - _WATER * pull * self.wet * weight * depth**2 / 2 * (right - left)
        return total

    def surface(self, sections: Array) -> Array:
        """Return the level of the water (columns,), by Newton's method from above."""
        x, y, turn = sections
        across, face = x - self.high / 2 * np.sin(turn), y + self.high / 2 * np.cos(turn)
        wide = (across[1:] - across[:-1]) * self.wet
        level = face.max(axis=0) + self.deep
        for _ in range(60):
            depth = [(level - face[:-1] - p * (face[1:] - face[:-1]), w) for p, w in _ALONG]
            held = sum((w * np.maximum(d, 0) * wide).sum(axis=0) for d, w in depth)
            area = sum((w * (d > 0) * wide).sum(axis=0) for d, w in depth)
            step = (held - self.volume) / area
            level = level - step
            if np.abs(step).max() < 1e-13:
                break
        return np.asarray(level)

    def forces(self, unknown: Array, pull: float) -> Array:
        """Return the derivative of the energy by the unknowns (unknowns, columns)."""
        sections = self.sections(unknown)
        surface = self.surface(sections)
        ends = np.concatenate([sections[:, :-1], sections[:, 1:]])
        out = np.zeros(sections.shape)
        for k in range(6):
            moved = ends.astype(complex)
            moved[k] += 1e-30j
            part = self.energy(moved, surface, pull).imag / 1e-30
            out[k % 3, k // 3 : k // 3 + self.n] += part
        return np.concatenate([out[0, 1:-1], out[1, 1:], out[2, 1:-1]])

    def sinks(self, steps: int = 10) -> float:
        """Return how far the middle sinks as gravity grows, by Newton's method, m."""
        x = np.linspace(0, self.half, self.n + 1)
        unknown = np.concatenate([x[1:-1], np.zeros(2 * self.n - 1)])
        count, change = len(unknown), 1e-7
        for pull in _GRAVITY * np.linspace(0.05, 1, steps):
            for _ in range(60):
                moved = np.concatenate([np.zeros((count, 1)), change * np.eye(count)], axis=1)
                found = self.forces(unknown[:, None] + moved, float(pull))
                stiff = (found[:, 1:] - found[:, :1]) / change
                step = np.linalg.solve(stiff, -found[:, 0])
                unknown = unknown + min(1.0, 0.3 / np.abs(step).max()) * step
                if np.abs(step).max() < 1e-6:
                    break
            else:
                raise RuntimeError(f"no rest found at {pull} m/s²")
        return -float(self.sections(unknown[:, None])[1, -1, 0])


def sunk_exactly(
    modulus: float, cell: float = 0.25, *, level: bool = True, pieces: int = 30, long: float = 10.0,
    high: float = 1.0, density: float = 100.0, deep: float = 0.5,
) -> float:  # fmt: skip
    """Return how far the middle of the beam sinks, m.

    `level`: the water runs to where it is deepest until its surface is level; else each part of
    the beam keeps the weight that stood on it. `cell` is that of the grid, whose walls stand half
    of one inside the ends.
    """
    beam = _Half(
        modulus, pieces, cell, long=long, high=high, density=density, deep=deep, level=level
    )
    return beam.sinks()
