"""Invariants, principal values and stress measures of many 3x3 tensors at once.

Plane strain has the third axis too: nothing moves along it, the stress on it is real.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "biot",
    "first_piola",
    "invariant",
    "principal",
    "second_piola",
    "small_strain",
    "solid",
    "stretches",
    "von_mises",
]

Array = NDArray[np.float64]


def solid(tensor: Array, third: Array | float) -> Array:
    """Return tensors (n, d, d) as (n, 3, 3), in 2D with `third` at place zz."""
    if tensor.shape[-1] == 3:
        return tensor
    whole = np.zeros((len(tensor), 3, 3))
    whole[:, :2, :2] = tensor
    whole[:, 2, 2] = third
    return whole


def invariant(a: Array, number: int) -> Array:
    """Return tr A, (tr² A - tr A²)/2 or det A of (n, 3, 3), by number 1 to 3."""
    trace: Array = np.trace(a, axis1=1, axis2=2)
    found = trace
    if number == 2:
        found = 0.5 * (trace**2 - np.einsum("nij,nji->n", a, a))
    elif number == 3:
        found = np.linalg.det(a)
    return found


def principal(symmetric: Array, number: int) -> Array:
    """Return an eigenvalue of symmetric (n, 3, 3); 1 is the largest."""
    return np.asarray(np.linalg.eigvalsh(symmetric)[:, 3 - number], dtype=np.float64)


def stretches(f: Array, number: int) -> Array:
    """Return a singular value of F (n, 3, 3), a principal stretch; 1 is the largest."""
    return np.asarray(np.linalg.svd(f, compute_uv=False)[:, number - 1], dtype=np.float64)


def first_piola(f: Array, cauchy: Array) -> Array:
    """Return P = J σ F⁻ᵀ, (n, 3, 3), Pa."""
    found: Array = np.linalg.det(f)[:, None, None] * cauchy @ np.linalg.inv(f).swapaxes(1, 2)
    return found


def second_piola(f: Array, cauchy: Array) -> Array:
    """Return S = F⁻¹ P, (n, 3, 3), Pa."""
    return np.linalg.inv(f) @ first_piola(f, cauchy)


def biot(f: Array, cauchy: Array) -> Array:
    """Return sym(Rᵀ P) with the rotation R of F, (n, 3, 3), Pa: τ_k/λ_k where σ follows b."""
    u, _, v = np.linalg.svd(f)
    turned = (u @ v).swapaxes(1, 2) @ first_piola(f, cauchy)
    found: Array = 0.5 * (turned + turned.swapaxes(1, 2))
    return found


def small_strain(f: Array) -> Array:
    """Return (F + Fᵀ)/2 - I, (n, 3, 3)."""
    return 0.5 * (f + f.swapaxes(1, 2)) - np.eye(3)


def von_mises(a: Array, factor: float) -> Array:
    """Return √(factor dev A : dev A) of (n, 3, 3): 3/2 for stress, 2/3 for strain."""
    deviator = a - np.trace(a, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    found: Array = np.sqrt(factor * np.einsum("nij,nij->n", deviator, deviator))
    return found
