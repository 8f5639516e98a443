"""Mass, momentum and angular momentum on the grid, and free fall.

Rounding is allowed to accumulate: unit × steps, relative to the largest value of the quantity.
Expected duration: 3 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from support import scenes
from support.devices import device  # noqa: F401
from support.tolerances import ROUNDING

PRECISIONS = pytest.mark.parametrize(
    ("device", "precision"),
    [("cpu", "single"), ("cpu", "double")]
    + [pytest.param("cuda", p, marks=pytest.mark.gpu) for p in ("single", "mixed", "double")],
    indirect=["device"],
)
DIMENSIONS = pytest.mark.parametrize("dimension", [2, 3])
STEPS = 200


def sums(mass, velocity, position):
    """Mass, momentum and angular momentum about the origin, formed in double precision."""
    momentum = mass[:, None] * velocity
    x, p = position, momentum
    if position.shape[1] == 2:
        angular = np.array([np.sum(x[:, 0] * p[:, 1] - x[:, 1] * p[:, 0])])
    else:
        angular = np.cross(x, p).sum(axis=0)
    return mass.sum(), momentum.sum(axis=0), angular


def grid(machine):
    return sums(*(machine.grid(name) for name in ("mass", "velocity", "position")))


@PRECISIONS
@DIMENSIONS
def test_free_spinning_body(dimension, precision, device):
    """Without walls and gravity nothing changes, the affine part of the rotation included.

    The sums of the grid hold it: Σ m x × v over nodes equals the particles' angular momentum plus
    that of their affine velocities, and a symmetric stress adds none.
    """
    spec = scenes.specification(scenes.free_body(dimension), precision=precision)
    body = spec["bodies"][0]
    arm = body["position"] - body["position"].mean(axis=0)
    spin = np.zeros_like(arm)
    spin[:, 0], spin[:, 1] = -8.0 * arm[:, 1], 8.0 * arm[:, 0]
    body["velocity"] = spin + np.array([0.3, 0.2, -0.1])[:dimension]
    machine = scenes.engine(spec, device)
    first = grid(machine)
    scenes.advance(machine, STEPS)
    last = grid(machine)
    total = body["count"] * body["particle_mass"]
    size = spec["cells"][0] * spec["cell_size"]
    speed = np.abs(body["velocity"]).max()
    unit = ROUNDING[precision] * STEPS
    assert first[0] == pytest.approx(total, rel=20 * ROUNDING[precision])
    assert last[0] == pytest.approx(total, rel=20 * ROUNDING[precision])
    assert np.abs(last[1] - first[1]).max() < unit * total * speed
    assert np.abs(last[2] - first[2]).max() < unit * total * speed * size
    # It really spins, and the stress really acts.
    assert np.abs(first[2]).max() > 0.01 * total
    gradient = machine.attribute(0, "deformation_gradient")
    assert np.abs(gradient - np.eye(dimension)).max() > 0.1


@PRECISIONS
@DIMENSIONS
def test_free_fall(dimension, precision, device):
    """No stress arises: y = v t - g Δt² n (n + 1) / 2, the sum that symplectic Euler makes."""
    launch, g = (0.5, 2.0, 1.0)[:dimension], 9.81
    scene = scenes.free_body(dimension, velocity=launch, gravity=g)
    sim = libmpm.Simulation(scene, device=device, precision=precision, threads=1)
    start = sim.particles["solid"]["position"]
    sim.step(100)
    dt, n = sim.time / 100, 100
    moved = sim.particles["solid"]["position"] - start
    expected = np.array(launch) * sim.time
    expected[-1] -= g * dt**2 * n * (n + 1) / 2
    unit = ROUNDING[precision] * n
    assert np.abs(moved - expected).max() < unit * 1.0
    # Readers give the velocity of the coming step.
    v = np.array(launch)
    v[-1] -= g * dt * (n + 1)
    assert np.abs(sim.particles["solid"]["velocity"] - v).max() < unit * 4.0
    gradient = sim.particles["solid"]["deformation_gradient"]
    assert np.abs(gradient - np.eye(dimension)).max() < 10 * unit


@PRECISIONS
def test_walls_take_what_is_missing(precision, device):
    """In a closed basin the momentum gained equals gravity's impulse less that of the walls."""
    scene = scenes.crowded(2)
    sim = libmpm.Simulation(scene, device=device, precision=precision, threads=1)
    first = np.zeros(2)
    for body in scenes.specification(scene)["bodies"]:
        velocity = np.broadcast_to(body["velocity"], (body["count"], 2))
        first += body["particle_mass"] * velocity.sum(axis=0)
    expected = 0.8 * 0.6 * 1000.0 + 0.24 * 0.22 * 600.0
    assert np.sum(sim.grid["mass"]) == pytest.approx(expected, rel=20 * ROUNDING[precision])
    steps = 150
    sim.step(steps)
    # The grid shows the velocities of the coming step; the load cells learn of it when it is made.
    mass, last, _ = sums(sim.grid["mass"], sim.grid["velocity"], sim.grid["position"])
    assert mass == pytest.approx(expected, rel=20 * ROUNDING[precision])
    sim.step(1)
    taken = np.zeros(2)
    for name in ("walls", "step"):
        _, length, pushed = scenes.force(sim, name)
        taken += (pushed * length[:, None]).sum(axis=0)
    gravity = np.array([0.0, -scenes.GRAVITY * mass * sim.time])
    bound = ROUNDING[precision] * steps * max(np.abs(first).max(), np.abs(gravity).max())
    assert np.abs(taken).max() > 100 * bound
    assert np.abs(last - first - gravity + taken).max() < bound


@PRECISIONS
def test_two_bodies_collide(precision, device):
    """Momentum passes from one to the other through the grid."""
    scene = scenes.free_body(2, velocity=(2.0, 0.0), cells=20)
    shape = scene.bodies[0].shape
    gap = 0.55
    low = (shape.lower[0] + gap, shape.lower[1] + 0.05)
    high = (shape.upper[0] + gap, shape.upper[1] + 0.05)
    scene.add_body(
        name="other",
        shape=libmpm.shapes.Box(lower=low, upper=high),
        material=scene.bodies[0].material,
        velocity=(-1.0, 0.5),
    )
    machine = scenes.engine(scenes.specification(scene, precision=precision), device)
    first = grid(machine)
    scenes.advance(machine, 60)
    last = grid(machine)
    bound = ROUNDING[precision] * 60 * first[0] * 2.0
    assert np.abs(last[1] - first[1]).max() < bound
    assert np.abs(last[2] - first[2]).max() < bound * 2.0
    assert machine.attribute(0, "velocity")[:, 0].mean() < 1.0
