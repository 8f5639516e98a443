"""Cook's membrane at ν = 0.4999: with F-bar it bends as it should, without it locks.

The reference is a solution with mixed elements of the same membrane and plate, here below. Expected
duration: 25 s; with the full level 5 min of one core.
"""

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.optimize import brentq
from scipy.sparse.linalg import spsolve

from libmpm import FBar
from libmpm._src.advice.cases import locking
from libmpm.cases import Options

pytestmark = [
    pytest.mark.validation,
    # Columns of boxes that lie side by side are no thin bodies.
    pytest.mark.filterwarnings("ignore::libmpm.ModelWarning"),
]

(COOK,) = locking.CASES
POISSON = 0.4999


# ---- the reference ------------------------------------------------------------------------------


def shape_functions(degree, at):
    """Lagrange's functions on [-1, 1] and their derivatives."""
    if degree == 1:
        return np.array([(1 - at) / 2, (1 + at) / 2]), np.array([-0.5, 0.5])
    value = np.array([at * (at - 1) / 2, 1 - at * at, at * (at + 1) / 2])
    return value, np.array([at - 0.5, -2 * at, at + 0.5])


def elements(count, poisson=POISSON):
    """Taylor-Hood elements Q2-Q1: `count` a side of the membrane and one in eight in the plate.

    Small strains; returns the mean lift of the plate, m, for ρ g / E = 1 / m.
    """
    layers = count // 8
    x = np.concatenate(
        [
            np.linspace(0, 48, 2 * count + 1),
            48 + 6 * np.arange(1, 2 * layers + 1) / (2 * layers),
        ]
    )
    low, high = (end + np.minimum(x, 48) * rise / 48 for end, rise in ((0, 44), (44, 16)))
    t = np.linspace(0, 1, 2 * count + 1)
    y = low[:, None] + (high - low)[:, None] * t
    i, j = (k.ravel() for k in np.indices((count + layers, count)))
    rows = len(t)
    nodes = np.stack([(2 * i + a) * rows + 2 * j + b for a in range(3) for b in range(3)], axis=1)
    plate = i >= count
    # The pressure jumps between the materials.
    corners = np.stack([(i + a) * (count + 1) + j + b for a in (0, 1) for b in (0, 1)], axis=1)
    corners = corners + np.where(plate, (count + layers + 1) * (count + 1), 0)[:, None]
    ratio = np.where(plate, 0.3, poisson)
    shear, lame = 0.5 / (1 + ratio), ratio / (1 + ratio) / (1 - 2 * ratio)
    density = np.where(plate, 1440 / 3 / (6 * 16), 1.0)
    px, py = np.repeat(x, rows)[nodes], y.ravel()[nodes]
    n = len(nodes)
    k, b, c = np.zeros((n, 18, 18)), np.zeros((n, 18, 4)), np.zeros((n, 4, 4))
    f = np.zeros((n, 18))
    points, weights = np.polynomial.legendre.leggauss(3)
    for u, v in np.ndindex(3, 3):
        (nu, du), (nv, dv) = (shape_functions(2, points[q]) for q in (u, v))
        value, along, across = (np.outer(*p).ravel() for p in ((nu, nv), (du, nv), (nu, dv)))
        area = (px @ along) * (py @ across) - (px @ across) * (py @ along)
        w = area * weights[u] * weights[v]
        dx = (np.outer(py @ across, along) - np.outer(py @ along, across)) / area[:, None]
        dy = (np.outer(px @ along, across) - np.outer(px @ across, along)) / area[:, None]
        strain = np.zeros((n, 3, 18))
        strain[:, 0, 0::2] = strain[:, 2, 1::2] = dx
        strain[:, 1, 1::2] = strain[:, 2, 0::2] = dy
        pressure = np.outer(*(shape_functions(1, points[q])[0] for q in (u, v))).ravel()
        weighted = strain * np.array([2.0, 2.0, 1.0])[:, None]
        k += (w * shear)[:, None, None] * (strain.transpose(0, 2, 1) @ weighted)
        b += w[:, None, None] * (strain[:, 0] + strain[:, 1])[:, :, None] * pressure
        c += (w / lame)[:, None, None] * np.outer(pressure, pressure)
        f[:, 1::2] += np.outer(w * density, value)
    freedoms = np.stack([2 * nodes, 2 * nodes + 1], axis=2).reshape(n, 18)
    size, pressures = 2 * y.size, corners.max() + 1

    def assemble(parts, row, column, shape):
        at = [np.broadcast_to(e, parts.shape).ravel() for e in (row[:, :, None], column[:, None])]
        return sparse.coo_matrix((parts.ravel(), at), shape).tocsr()

    free, used = np.arange(2 * rows, size), np.unique(corners)
    kk = assemble(k, freedoms, freedoms, (size, size))[free][:, free]
    bb = assemble(b, freedoms, corners, (size, pressures))[free][:, used]
    cc = assemble(c, corners, corners, (pressures, pressures))[used][:, used]
    load = np.bincount(freedoms.ravel(), f.ravel(), size)
    system = sparse.bmat([[kk, -bb], [-bb.T, -cc]]).tocsc()
    found = np.zeros(size)
    solved = spsolve(system, np.concatenate([load[free], np.zeros(len(used))]))
    found[free] = solved[: len(free)]
    weight = f[plate]
    return float(np.sum(weight * found[freedoms[plate]]) / np.sum(weight))


def test_the_reference():
    """Elements of three sizes, extrapolated by their own order, give the number of the case."""
    counts = (8, 16, 24)
    lifts = [elements(n) for n in counts]

    def excess(order):
        h = [n**-order for n in counts]
        return (lifts[1] - lifts[0]) / (h[0] - h[1]) - (lifts[2] - lifts[1]) / (h[1] - h[2])

    order = brentq(excess, 0.5, 4.0)
    step = (lifts[2] - lifts[1]) / (counts[1] ** -order - counts[2] ** -order)
    limit = lifts[2] + step * counts[2] ** -order
    assert order > 1  # the corners of the clamped edge take the rest
    assert limit == pytest.approx(locking.LIFT, rel=1e-3)


def test_where_the_clamp_stands():
    """A bar that starts `CLAMP` behind the wall is by the linear field as long as it looks."""
    s = np.linspace(locking.CLAMP, 1, 100_001)
    strain = 2 * s**2 * (1.5 - s)
    assert np.trapezoid(strain**2, s) == pytest.approx(locking.CLAMP, abs=1e-3)


# ---- the membrane -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def locked():
    """The reduced level without F-bar."""
    return COOK.run(options=Options(solid_fbar=None), precision="double", threads=1).values


def test_reduced(device, locked):
    """Within 3 % at 16 cells a side, and without the checkerboard."""
    result = COOK.run(device=device, precision="double", threads=1)
    assert not result.failures, result.failures
    assert result.values["checkerboard"] < 0.1
    assert result.values["checkerboard"] < 0.01 * locked["checkerboard"]


def test_it_locks_without(locked):
    """Negative control: too stiff by far more than the bound, and its pressure is noise alone."""
    assert locked["lift_ratio"] < 0.85
    assert locked["checkerboard"] > 10


def test_a_compressible_one_does_not(device):
    """Positive control: at ν = 0.3 it bends as it should without F-bar."""
    values = COOK.run(
        options=Options(solid_fbar=None), device=device, precision="double", threads=1,
        poissons_ratio=0.3,
    ).values  # fmt: skip
    assert values["lift_ratio"] * locking.LIFT == pytest.approx(elements(24, 0.3), rel=0.03)


@pytest.mark.parametrize(
    "fbar",
    [
        FBar(form="one-volume"),
        FBar(form="two-volume", ratio=0.9998),
        FBar(form="split", ratio=0.9998),
    ],
    ids=lambda fbar: fbar.form,
)
def test_other_forms(fbar, full):
    """Forms with two volumes leave what the grid cannot see the stiffness (1 - psi) K.

    It must not be above the shear modulus, K / 5000 here: psi of 0.9998, a length of 35 cells. The
    undamped membrane tears with "literal", and with "stress-only" of psi = 1.
    """
    result = COOK.run(options=Options(solid_fbar=fbar), precision="double", threads=1)
    assert not result.failures, result.failures
    assert result.values["checkerboard"] < 0.1


def test_full(full):
    """Cells of half the size."""
    result = COOK.run("full", precision="double", threads=1)
    assert not result.failures, result.failures
