"""A tank that gravity hits at t = 0: acoustic stage, then mean wall force (Bonus 2023, 6.4).

References: f/f_H = 1 - (32/π³) Σ (-1)^(n+1) cos((2n-1) π c t / 2H) / (2n-1)³ while nothing damps,
with f_H = ρ g H²/2, and 1 - (2/3) ρ g H / K at rest. Without F-bar the lowest cell is compressed
by half of what it should be, because its nodes are held: the column behaves as one that is a third
of a cell less deep, in its period and, with the squared depth, in its force (design/walls.md).
Expected duration: 15 s (1.6e8 particle-steps).
"""

import numpy as np
import pytest

import libmpm
from libmpm._src.advice.cases.settling import missing_depth
from support import scenes
from support.tolerances import ACOUSTIC, ACOUSTIC_ORDER, WALL_FORCE

pytestmark = pytest.mark.validation

DEPTH, G = 3.2, 10.0
FULL = 0.5 * scenes.WATER * G * DEPTH**2


def acoustic(time, speed, depth=DEPTH):
    """The undamped column of some depth, parts of f_H of the full depth."""
    n = 2 * np.arange(1, 400)[:, None] - 1
    sign = (-1.0) ** ((n + 1) // 2 + 1)
    series = sign * np.cos(n * np.pi * speed * time / (2 * depth)) / n**3
    return (depth / DEPTH) ** 2 * (1 - 32 / np.pi**3 * series.sum(axis=0))


def column(modulus, cell_size, periods, device, fbar="default", samples=0, width=4):
    """Run a column of `width` cells; returns time, sample length, force and wave speed."""
    speed = np.sqrt(modulus / scenes.WATER)
    period = 4 * DEPTH / speed
    scene = scenes.tank(
        cells=(width, round(DEPTH / cell_size)), cell_size=cell_size, modulus=modulus, gravity=G,
        fbar=fbar, interval=period / samples if samples else 0.0,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
    sim.run(until=periods * period * (1 + 1e-9), progress=False)
    time, step, pushed = scenes.force(sim)
    return time, step, -pushed[:, 0] / FULL, speed


def period_means(time, step, force, period, count):
    """Means over each of the first `count` periods, from the impulse up to their ends."""
    impulse = np.concatenate([[0.0], np.cumsum(force * step)])
    ends = np.interp(np.arange(count + 1) * period, np.concatenate([[0.0], time]), impulse)
    return np.diff(ends) / period


def ringing(time, force, period, first):
    """Half the range of the force in one period from `first` periods on."""
    part = force[(time > first * period) & (time <= (first + 1) * period)]
    return np.ptp(part) / 2


@pytest.mark.parametrize("cell_size", sorted(ACOUSTIC, reverse=True))
def test_acoustic_stage(cell_size, device, figure):
    """One period against the closed form of the depth that the held nodes leave."""
    time, step, force, speed = column(2.2e8, cell_size, 1.0, device, fbar=None)
    middle = time - step / 2
    expected = acoustic(middle, speed, DEPTH - missing_depth(cells=64) * cell_size)
    error = np.abs(force - expected).max()
    bound = ACOUSTIC[cell_size]
    _, axes = figure.new()
    axes.plot(middle * speed / DEPTH, force, label="libmpm")
    axes.plot(middle * speed / DEPTH, expected, "k--",
              label=f"closed form, depth H - {missing_depth(cells=64):.3f} Δx")  # fmt: skip
    axes.fill_between(middle * speed / DEPTH, expected - bound, expected + bound, alpha=0.2,
                      color="r", label="bound")  # fmt: skip
    axes.set(xlabel="c t / H", ylabel="f / f_H", title=f"Δx {cell_size}: error {error:.4f}")
    axes.legend()
    assert error <= bound


def test_acoustic_stage_converges(device, figure):
    """Against the closed form of the full depth the error falls with the first power of Δx."""
    errors = {}
    for cell_size in sorted(ACOUSTIC, reverse=True):
        time, step, force, speed = column(2.2e8, cell_size, 1.0, device, fbar=None)
        errors[cell_size] = np.abs(force - acoustic(time - step / 2, speed)).max()
    coarse, fine = errors.values()
    _, axes = figure.new()
    axes.loglog(errors.keys(), errors.values(), "o-", label="libmpm, depth H")
    axes.loglog(errors.keys(), [coarse, coarse / ACOUSTIC_ORDER], "r--", label="bound of the slope")
    axes.set(xlabel="Δx [m]", ylabel="largest error / f_H", title=f"ratio {coarse / fine:.3f}")
    axes.legend()
    assert coarse / fine >= ACOUSTIC_ORDER


@pytest.mark.parametrize("modulus", [2.2e7, 2.2e8, 2.2e9])
def test_wall_force_at_equilibrium(modulus, device, figure):
    """The mean over periods 120 to 180; the ringing has died to a fifth of what it was."""
    periods = 180
    time, step, force, speed = column(modulus, 0.1, periods, device, samples=40)
    period = 4 * DEPTH / speed
    means = period_means(time, step, force, period, periods - 1)
    expected = 1 - 2 / 3 * scenes.WATER * G * DEPTH / modulus
    found = means[120:].mean()
    left = ringing(time, force, period, periods - 2)
    _, axes = figure.new()
    axes.plot(means, label="mean over each period")
    axes.axhline(expected, color="k", ls="--", label="1 - (2/3) ρgH/K")
    axes.axhspan(expected - WALL_FORCE, expected + WALL_FORCE, alpha=0.2, color="r", label="bound")
    axes.set(xlabel="period 4H/c", ylabel="f / f_H", ylim=(0.96, 1.02),
             title=f"K {modulus:g}: {found:.5f} / {expected:.5f}, ringing {left:.3f}")  # fmt: skip
    axes.legend()
    assert found == pytest.approx(expected, abs=WALL_FORCE)
    assert left < 0.2


def test_without_smoothing_it_rings_on(device, figure):
    """Negative control: without F-bar the column keeps ringing by two thirds after 180 periods."""
    periods = 180
    time, _, force, speed = column(2.2e8, 0.1, periods, device, fbar=None, samples=40)
    period = 4 * DEPTH / speed
    left = [ringing(time, force, period, k) for k in range(periods - 1)]
    _, axes = figure.new()
    axes.plot(left)
    axes.axhline(0.65, color="r", label="bound")
    axes.legend()
    axes.set(xlabel="period 4H/c", ylabel="half range of f / f_H", title="no F-bar")
    assert left[0] > 0.9
    assert left[-1] > 0.65


@pytest.mark.gpu
def test_full_size_at_real_bulk_modulus(full, figure):
    """Full tier: Δx 0.025, K 2.2e9, started in balance; the wall force stays at its theory."""
    scene = scenes.tank(cells=(128, 128), cell_size=0.025, modulus=2.2e9, gravity=G, at_rest=True)
    sim = libmpm.Simulation(scene, device="cuda", precision="single")
    period = 4 * DEPTH / np.sqrt(2.2e6)
    sim.run(until=40 * period, progress=False)
    time, step, pushed = scenes.force(sim)
    means = period_means(time, step, -pushed[:, 0] / FULL, period, 39)
    _, axes = figure.new()
    axes.plot(means)
    axes.axhspan(1 - WALL_FORCE, 1 + WALL_FORCE, alpha=0.2, color="r", label="bound")
    axes.set(xlabel="period 4H/c", ylabel="f / f_H")
    assert means[20:].mean() == pytest.approx(1, abs=WALL_FORCE)
