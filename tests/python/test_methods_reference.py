"""The naive method of `support.methods_reference` against identities, without the engine.

Expected duration: 5 s.
"""

from itertools import pairwise

import numpy as np
import pytest

from support import scenes
from support.methods_reference import (
    AFFINE,
    DEGREE,
    KERNELS,
    PAD,
    SCHEMES,
    MethodsReference,
    Weights,
    axis_weights,
    choose,
    full_mass,
    ghosts,
    greville,
    shift,
)
from support.reference import Reference

CELLS = 12
X = np.random.default_rng(3).uniform(0.0, CELLS, 400)
HALF = np.random.default_rng(4).uniform(0.1, 0.5, 400)
NODES = np.arange(-PAD, CELLS + PAD) + 0.5


def weights(name, x=X, boundary=False):
    half = np.full(len(x), 0.25) if name == "ugimp" else HALF[: len(x)]
    return axis_weights(name, x, CELLS, half=half, boundary=boundary)


# ---- kernels ------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", KERNELS)
def test_uniform_kernels(name):
    """Partition of unity, linear fields, and derivatives that are those of the values."""
    value, slope = weights(name)
    assert np.abs(value.sum(axis=1) - 1).max() < 1e-14
    assert np.abs(slope.sum(axis=1)).max() < 1e-13
    assert np.abs(value @ NODES - X).max() < 1e-13
    assert np.abs(slope @ NODES - 1).max() < 1e-12
    assert value.min() >= 0
    h = 1e-6
    difference = (weights(name, X + h)[0] - weights(name, X - h)[0]) / (2 * h)
    # Second derivatives jump by up to 1/(2 l) = 5 at the knots of GIMP; the hat has none there.
    smooth = np.abs(X - np.round(X * 2) / 2) > h if name == "linear" else np.ones(len(X), bool)
    assert np.abs(difference - slope)[smooth].max() < 10 * h


@pytest.mark.parametrize("name", DEGREE)
def test_clamped_kernels(name):
    """Nothing is left outside, linear fields at Greville's abscissae, 1 at the wall."""
    degree = DEGREE[name]
    value, slope = weights(name, boundary=True)
    used = slice(PAD - ghosts(degree), PAD + CELLS + ghosts(degree))
    assert np.abs(np.delete(value, np.arange(len(NODES))[used], axis=1)).max() == 0
    assert np.abs(value.sum(axis=1) - 1).max() < 1e-14
    at = greville(degree, CELLS)
    assert np.abs(value[:, used] @ at - X).max() < 1e-13
    assert np.abs(slope[:, used] @ at - 1).max() < 1e-12
    ends = weights(name, np.array([0.0, CELLS]), boundary=True)[0][:, used]
    expected = np.zeros_like(ends)
    expected[0, 0] = expected[1, -1] = 1
    assert np.abs(ends - expected).max() < 1e-14
    h = 1e-6
    inside = (h < X) & (CELLS - h > X) & (np.abs(X - np.round(X * 2) / 2) > h)
    difference = (
        weights(name, X + h, True)[0] - weights(name, X - h, True)[0]
    ) / (2 * h)  # fmt: skip
    assert np.abs(difference - slope)[inside].max() < 50 * h
    # Away from the ends they are the uniform ones.
    middle = np.abs(X - CELLS / 2) < CELLS / 2 - 3
    assert np.abs(value - weights(name)[0])[middle].max() < 1e-14


def test_second_moments():
    """1/4 and 1/3 of a square cell; of GIMP s (1 - s) where no node lies under the particle."""
    for name, expected in (("quadratic", 0.25), ("cubic", 1 / 3)):
        value = weights(name)[0]
        assert np.abs(np.sum(value * (NODES - X[:, None]) ** 2, axis=1) - expected).max() < 1e-13
    s = np.abs(X - 0.5 - np.round(X - 0.5))  # from the nearest node
    for name, half in (("ugimp", np.full(len(X), 0.25)), ("cpgimp", HALF)):
        found = np.sum(weights(name)[0] * (NODES - X[:, None]) ** 2, axis=1)
        # With a node inside the mean of |y| over [s - l, s + l] replaces s.
        expected = np.where(s >= half, s, (s**2 + half**2) / (2 * half)) - s**2
        one_node = s + half <= 1
        assert np.abs(found - expected)[one_node].max() < 1e-13


@pytest.mark.parametrize("name", KERNELS)
def test_products_of_axes(name):
    """Value and gradient of a field linear in x, y and z, and the adjoint."""
    random = np.random.default_rng(8)
    cells, dx = (4, 5, 6), 0.3
    x = random.uniform(0, 1, (20, 3)) * np.array(cells) * dx
    w = Weights({"name": name, "boundary": False}, x, np.full((20, 3), 0.25), dx, cells)
    grid = np.stack(
        np.meshgrid(*((np.arange(-PAD, n + PAD) + 0.5) * dx for n in cells), indexing="ij"), -1
    )
    slope = random.normal(size=(3, 3))
    field = grid @ slope.T + 2.0
    assert np.abs(w.gather(field) - (x @ slope.T + 2.0)).max() < 1e-13
    forms = ("kernel",) if name == "linear" else ("kernel", "mls")
    for form in forms:
        assert np.abs(w.gradient(field, form) - slope).max() < 1e-11
    q, any_field = random.normal(size=(20, 3)), random.normal(size=field.shape)
    there = np.sum(w.scatter(q) * any_field)
    assert there == pytest.approx(np.sum(q * w.gather(any_field)), rel=1e-12)
    assert np.abs(w.matrix() @ any_field.reshape(-1, 3) - w.gather(any_field)).max() < 1e-13
    # Forces are the adjoint of the velocity gradient, whichever form it has.
    tau = random.normal(size=(20, 3, 3))
    for form in forms:
        power = np.sum(w.force(tau, form) * any_field)
        assert power == pytest.approx(-np.sum(tau * w.gradient(any_field, form)), rel=1e-11)


# ---- sweeps -------------------------------------------------------------------------------------


def dense(reference):
    """S, S+ and the filled nodes of the bodies of a reference."""
    s = np.concatenate([w.matrix() for w in reference.weights])
    mass = np.concatenate([reference._masses(k) for k in range(len(reference.weights))])
    m = s.T @ mass
    filled = m > 0
    s = s[:, filled]
    return s, (s * mass[:, None]).T / m[filled, None], filled


@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_residuals_are_the_closed_form(order):
    """The sum of (I - S+S)^m, and of XPIC and FMPM what the particles see: I - (I - S S+)^k."""
    reference = MethodsReference(choose(scenes.specification(scenes.crowded(2))))
    s, back, filled = dense(reference)
    v = (
        np.random.default_rng(2).normal(size=reference.momentum.shape)
        * (reference.m > 0)[..., None]
    )
    found = full_mass(v, reference._project, order).reshape(-1, 2)[filled]
    flat = v.reshape(-1, 2)[filled]
    step = np.eye(filled.sum()) - back @ s
    closed = sum(np.linalg.matrix_power(step, m) for m in range(order))
    assert np.abs(found - closed @ flat).max() < 1e-12
    own = np.random.default_rng(6).normal(size=(len(s), 2))
    seen = own - np.linalg.matrix_power(np.eye(len(s)) - s @ back, order) @ own
    assert np.abs(s @ closed @ (back @ own) - seen).max() < 1e-12
    # The binomial recursion of the publications.
    binomial, term = 0.0, order * flat
    for r in range(1, order + 1):
        if r > 1:
            term = (order - r + 1) / r * (back @ (s @ term))
        binomial = binomial + (-1) ** (r + 1) * term
    assert np.abs(found - binomial).max() < 1e-11


def test_many_sweeps_solve_with_the_full_mass():
    """FMPM(k) of a velocity lumped from a smooth one tends to the solution with m S+S."""
    reference = MethodsReference(choose(scenes.specification(scenes.crowded(2))))
    s, back, filled = dense(reference)
    place = np.argwhere(reference.m > 0) * 0.5
    wanted = np.stack([np.sin(place[:, 0]), np.cos(place[:, 1])], axis=-1)
    lumped = np.zeros((filled.size, 2))
    lumped[filled] = back @ (s @ wanted)
    lumped = lumped.reshape(reference.momentum.shape)
    errors = []
    for order in (1, 2, 4, 8, 16, 128):
        v = full_mass(lumped, reference._project, order).reshape(-1, 2)[filled]
        errors.append(np.linalg.norm(s @ (v - wanted)) / np.linalg.norm(s @ wanted))
    # Where particles see it: nodes that hardly any particle reaches converge slowly.
    assert all(late < 0.7 * early for early, late in pairwise(errors))
    assert errors[-1] < 1e-3


# ---- the step -----------------------------------------------------------------------------------


@pytest.mark.parametrize("dimension", [2, 3])
def test_without_options_it_is_the_other_reference(dimension):
    spec = scenes.specification(scenes.crowded(dimension))
    one, other = Reference(spec), MethodsReference(spec)
    one.run(20)
    other.run(20)
    for k in range(len(one.bodies)):
        assert np.abs(one.position[k] - other.position[k]).max() < 1e-13
        assert np.abs(one.velocity(k)[0] - other.velocity(k)[0]).max() < 1e-11
        assert np.abs(one.h[k] - other.h[k]).max() < 1e-12
    assert np.abs(one.j[0] - other.j[0]).max() < 1e-13


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kernel", KERNELS)
def test_mass_and_momentum(scheme, kernel):
    if kernel == "linear" and scheme in AFFINE:
        pytest.skip("not defined: the second moment of a hat is zero at its node")
    shifts = {"shift_max": 0.2, "shift_min": 0.05} if "SFLIP" in scheme else {}
    flip = 0.9 if scheme in ("PIC-FLIP", "AFLIP", "SFLIP", "ASFLIP") else None
    spec = scenes.specification(scenes.free_body(2, velocity=(0.3, -0.2)))
    body = spec["bodies"][0]
    random = np.random.default_rng(0)
    body["velocity"] = body["velocity"] + random.normal(size=body["position"].shape)
    # With linear functions a node that a particle barely reaches is accelerated without bound: so
    # short a step that none is thrown out of the domain.
    spec["time_step"] = 1e-4
    choose(spec, scheme, kernel, flip=flip, order=3, every=2, **shifts)
    reference = MethodsReference(spec)
    mass, momentum = reference.totals()
    expected = body["particle_mass"] * np.sum(body["velocity"], axis=0)
    assert mass == pytest.approx(body["count"] * body["particle_mass"], rel=1e-13)
    assert np.abs(momentum - expected).max() < 1e-12 * mass
    reference.run(10)
    assert reference.totals()[0] == pytest.approx(mass, rel=1e-13)
    assert np.abs(reference.totals()[1] - momentum).max() < 1e-12 * mass


def test_shift_rules():
    """beta(J_c) = beta_min, beta(J_c + width) = beta_max, and both choices below J_c."""
    rule = {"shift_min": 0.05, "shift_max": 0.2, "critical_ratio": 0.99, "width": 0.02, "power": 2}
    ratio = np.array([0.98, 0.9900001, 1.0, 1.01, 1.2])
    smooth = shift(1 - ratio, rule | {"rule": "smooth", "below": "min"})
    assert smooth == pytest.approx([0.05, 0.05, 0.0875, 0.2, 0.2], abs=1e-9)
    assert shift(1 - ratio, rule | {"rule": "smooth", "below": "zero"})[0] == 0
    binary = shift(1 - ratio, rule | {"rule": "binary"})
    assert binary == pytest.approx([0.05, 0.2, 0.2, 0.2, 0.2])
