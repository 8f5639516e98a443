"""Archimedes: floating, fixed and sinking bodies (Bonus 2023, 6.8).

Expected duration: 20 s (four floats of 1.5e7, fixed boxes of 6e7 and sinking blocks of 5e7
particle-steps).
"""

import numpy as np
import pytest

import libmpm
from support import scenes
from support.tolerances import FLOAT_DRIFT, FLOAT_SETTLED, SUBMERGED_FORCE

pytestmark = pytest.mark.validation


def lift(sim, frames, until, cell_size):
    """Height of the block's centre over its first, in cells, at `frames` times."""
    start = sim.particles["block"]["position"][:, 1].mean()
    time, height = [0.0], [0.0]
    for end in np.linspace(0, until, frames + 1)[1:]:
        sim.run(until=end, progress=False)
        time.append(sim.time)
        height.append((sim.particles["block"]["position"][:, 1].mean() - start) / cell_size)
    return np.array(time), np.array(height)


@pytest.mark.parametrize("ratio", [0.5, 0.75])
@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_floating_block(ratio, offset, device, figure):
    """At its draft it stays; one cell too high it settles, within 20 sqrt(H/g)."""
    cell = 0.05
    scene, rest = scenes.floating(ratio, offset=offset, cell_size=cell)
    sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
    until = 20 * np.sqrt(12 * cell / scenes.GRAVITY)
    time, height = lift(sim, 40, until, cell)
    away = height + offset - rest
    bound = FLOAT_SETTLED if offset else FLOAT_DRIFT
    _, axes = figure.new()
    axes.plot(time, away)
    axes.axhspan(-bound, bound, alpha=0.2, color="r", label="bound")
    axes.set(xlabel="time [s]", ylabel="cells above Archimedes' draft",
             title=f"ρ/ρ_w {ratio}, released {offset:g} cells off: {away[-1]:.3f}")  # fmt: skip
    axes.legend()
    if offset:
        assert abs(away[-1]) <= bound
    else:
        assert np.abs(away).max() <= bound


BOXES = {
    # basin, lower and upper corner of the box, all in cells, and the time in seconds
    "16x8": ((32, 20), (8, 5), (24, 13), 3.2),
    "4x4": ((16, 20), (6, 8), (10, 12), 12.0),
}


@pytest.mark.parametrize("box", BOXES)
def test_fixed_submerged_box(box, device, figure):
    """A box carries the weight of the water that its defined faces displace, and goes on doing so.

    The small one is four cells a side, too few for the bound, and runs long: with a single normal
    inside its corners it let water in, and its lift fell from 1.07 to 0.59 of that weight within
    12 s (design/walls.md). It has to keep the lift that it starts with.
    """
    cell = 0.05
    basin, lower, upper, until = BOXES[box]
    depth = basin[1] * cell
    speed = np.sqrt(scenes.stiffness(depth) / scenes.WATER)
    scene, weight = scenes.submerged(
        cell_size=cell, basin=basin, lower=lower, upper=upper, interval=4 * depth / speed
    )
    sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
    sim.run(until=until, progress=False)
    time, step, pushed = scenes.force(sim)
    up, across = pushed[:, 1] / weight, pushed[:, 0] / weight
    mean = np.average(up, weights=step)
    _, axes = figure.new()
    axes.plot(time, up, label="lift")
    axes.axhspan(1 - SUBMERGED_FORCE, 1 + SUBMERGED_FORCE, alpha=0.2, color="r", label="bound")
    axes.set(xlabel="time [s]", ylabel="force / ρgV",
             title=f"{box} cells: mean {mean:.4f}, last {up[-1]:.4f}")  # fmt: skip
    axes.legend()
    expected = 1.0 if box == "16x8" else up[0]
    assert np.abs(up - expected).max() <= SUBMERGED_FORCE
    assert np.abs(across).max() <= 1e-6


def model(density, duration, edge=0.4, gravity=10.0, drag=2.1):
    """Fall in open water with the true volume, quadratic drag and the added mass of a square."""
    water, added = scenes.WATER, 1.51 * np.pi * (edge / 2) ** 2 * scenes.WATER
    v, y, dt = 0.0, 0.0, duration / 4000
    for _ in range(4000):
        push = (water - density) * edge**2 * gravity - 0.5 * drag * water * edge * v * abs(v)
        v += dt * push / (density * edge**2 + added)
        y += dt * v
    return y


def test_sinking_blocks_in_order(device, figure):
    """Light rises, heavy sinks faster, and refinement moves each towards the open-water model."""
    duration, sizes = 0.8, (0.2, 0.1, 0.05)
    moved = {}
    for density in (750.0, 1500.0, 3000.0):
        moved[density] = []
        for size in sizes:
            scene = scenes.sinking(density, cell_size=size)
            sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
            moved[density].append(lift(sim, 1, duration, 1.0)[1][-1])
    expected = {density: model(density, duration) for density in moved}
    _, axes = figure.new()
    for density, values in moved.items():
        (line,) = axes.plot(sizes, values, "o-", label=f"ρ {density:g}")
        axes.axhline(expected[density], color=line.get_color(), ls="--")
    axes.set(xlabel="Δx [m]", ylabel="rise after 0.8 s [m]", title="dashed: open-water model")
    axes.legend()
    for k in range(len(sizes)):
        rise = [moved[d][k] for d in (750.0, 1500.0, 3000.0)]
        assert rise[0] > 0 > rise[1] > rise[2]
    for density, values in moved.items():
        error = [abs(expected[density] - v) for v in values]
        assert error[0] > error[1] > error[2]


@pytest.mark.gpu
@pytest.mark.parametrize("density", [750.0, 1500.0, 3000.0])
def test_sinking_blocks_full_size(density, full, figure):
    """Full tier: the tank of the dissertation at K 2.2e7; the error to the model falls with Δx."""
    duration, place, errors = 1.5, {}, []
    for size in (0.025, 0.0125):
        scene = scenes.sinking(
            density, cell_size=size, width=3.2, depth=6.4, base=5.0, modulus=2.2e7,
            block_modulus=1e7,
        )  # fmt: skip
        sim = libmpm.Simulation(scene, device="cuda", precision="single")
        place[size] = lift(sim, 15, duration, 1.0)
        errors.append(abs(place[size][1][-1] - model(density, duration)))
    _, axes = figure.new()
    for size, (time, height) in place.items():
        axes.plot(time, height, label=f"Δx {size}")
    time = place[0.025][0][1:]
    axes.plot(time, [model(density, t) for t in time], "k--", label="true volume + added mass")
    author = [author_model(density, t) for t in time]
    axes.plot(time, author, "k:", label="dissertation's model")
    axes.set(xlabel="time [s]", ylabel="rise [m]", title=f"ρ {density:g}")
    axes.legend()
    assert errors[1] < errors[0]


def author_model(density, duration, edge=0.4, cell=0.0125, gravity=10.0, drag=2.1):
    """The dissertation's model: displaced volume enlarged by a cell on each side, no added mass."""
    water, mass = scenes.WATER, density * edge**3
    volume, area = (edge + 2 * cell) ** 2 * edge, (edge + 2 * cell) ** 2
    v, y, dt = 0.0, 0.0, duration / 4000
    for _ in range(4000):
        push = water * gravity * volume - mass * gravity - 0.5 * drag * water * area * v * abs(v)
        v += dt * push / mass
        y += dt * v
    return y
