"""Gauges with hat weights, trimmed means and error norms against arrays made by hand."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import sensors, shapes
from libmpm._src.sensors.column_gauge_sampler import hat, mean_column
from libmpm.analysis import Signal
from support.sensing_scenes import WATER, G, add_walls, open_scene, simulate


def test_hat_weighs_both_sides_alike():
    """E-25: printed without the modulus, particles upstream would weigh up to twice."""
    away = np.array([[-0.1], [-0.05], [0.0], [0.025], [0.05], [0.11]])
    np.testing.assert_allclose(hat(away, 0.1), [0, 0.5, 1, 0.75, 0.5, 0])
    np.testing.assert_allclose(hat(np.array([[0.05, -0.025]]), 0.1), [0.375])


def test_mean_column_of_particles_made_by_hand():
    height = np.array([0.1, 0.3, 0.5, 0.2])
    velocity = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, -1.0], [9.0, 9.0]])
    weight = np.array([1.0, 1.0, 2.0, 0.0])
    # Σ w h = 0.1 + 0.3 + 1.0, Σ w = 4.
    np.testing.assert_allclose(mean_column(height, velocity, weight), [0.7, 2.25, -0.5])
    assert np.isnan(mean_column(height, velocity, 0 * weight)).all()


def test_gauges_of_a_tank_and_of_a_step():
    """Still water reads its level; two depths read their mean weighted by the hat."""
    scene = open_scene()
    deep = shapes.Box(lower=(0.0, 0.0), upper=(1.0, 0.8))
    shallow = shapes.Box(lower=(1.0, 0.0), upper=(2.0, 0.4))
    for name, box in (("deep", deep), ("shallow", shallow)):
        scene.add_body(
            name=name, shape=box, material=libmpm.materials.TaitFluid(**WATER),
            velocity=(2.0, 0.0) if name == "deep" else (1.0, 0.0), particles_per_cell=16,
        )  # fmt: skip
    add_walls(scene)
    gauges = {
        "left": {"position": (0.55,)},
        "step": {"position": (1.0,), "width": 0.3},
        "raised": {"position": (0.55,), "bed": 0.1, "body": "deep"},
        "all": {},
        "deep": {"body": "deep"},
    }
    for name, what in gauges.items():
        scene.add_sensor(name=name, sensor=sensors.ColumnGauge(interval=0.1, **what))
    sim = simulate(scene)
    sim.step(1)
    got = {name: sim.sensors[name].values[0] for name in gauges}
    base = 10.0  # origin of the scene along y
    assert sim.sensors["left"].components == ("level", "velocity_x", "velocity_y")
    assert got["left"][0] == pytest.approx(base + 0.8, abs=1e-12)
    assert got["left"][1] == pytest.approx(2.0, rel=0.05)
    # Σ w h: 2/3 of the mass is deep: 2 (2/3 · 0.4 + 1/3 · 0.2).
    assert got["step"][0] == pytest.approx(base + 2 / 3, abs=1e-12)
    assert got["step"][1] == pytest.approx(5 / 3, rel=0.05)
    # All stands above a bed at 0 but for the part below 0.1, which counts as negative height.
    assert got["raised"][0] == pytest.approx(base + 0.1 + 2 * (0.4 - 0.1), abs=1e-12)
    # h_eq of bodies: masses 0.8 and 0.4.
    assert got["all"][0] == pytest.approx(base + 2 / 3, abs=1e-12)
    assert got["deep"][0] == pytest.approx(base + 0.8, abs=1e-12)


def test_gauges_move_with_the_water_and_read_nothing_where_it_is_dry():
    """The equivalent depth of water at rest stays, a column that collapses loses its level."""
    scene = open_scene()
    water = libmpm.materials.TaitFluid(**WATER)
    scene.add_body(name="water", shape=shapes.Box(lower=(0, 0), upper=(0.6, 0.8)), material=water)
    add_walls(scene)
    for name, place in (("near", (0.3,)), ("far", (1.5,))):
        scene.add_sensor(name=name, sensor=sensors.ColumnGauge(position=place, interval=0.05))
    scene.add_sensor(name="all", sensor=sensors.ColumnGauge(interval=0.05))
    sim = simulate(scene, 0.3)
    near, far, whole = (sim.sensors[name].values[:, 0] for name in ("near", "far", "all"))
    assert near[-1] < near[0] - 0.1
    assert np.isnan(far[0])
    fallen = whole[0] - whole[-1]
    assert 0 < fallen < 0.5 * G * 0.3**2 * 2
    place = sim.particles["water"]["position"]
    assert whole[-1] == pytest.approx(10 + 2 * (place[:, 1].mean() - 10), abs=1e-9)


def test_gauges_are_refused():
    with pytest.raises(libmpm.SceneError, match=r"width is 0\.2 without a position"):
        sensors.ColumnGauge(width=0.2)
    scene = open_scene()
    box = shapes.Box(lower=(0, 0), upper=(1, 1))
    scene.add_body(name="water", shape=box, material=libmpm.materials.TaitFluid(**WATER))
    scene.add_sensor(name="gauge", sensor=sensors.ColumnGauge(position=(3.0,)))
    with pytest.raises(libmpm.SceneError, match="the gauge is at 3 m on axis 0"):
        scene.validate()


# Means and norms ------------------------------------------------------------------------------


def test_trimmed_mean_of_eleven_samples():
    """Nine are averaged: the largest and the smallest of each window do not count."""
    value = np.array([0.0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 1000, 11, -1000])
    signal = Signal(0.01 * np.arange(13), value)
    found = signal.moving_mean(11, trim=1)
    np.testing.assert_allclose(found.value, [45 / 9, 55 / 9, 55 / 9])
    np.testing.assert_allclose(found.time, 0.05 + 0.01 * np.arange(3))


def test_mean_of_ten_samples_stands_in_their_middle():
    time = 0.01 * np.arange(1, 31)
    line = Signal(time, 3 * time)
    found = line.moving_mean(10)
    assert len(found) == 21
    np.testing.assert_allclose(found.value, 3 * found.time)
    means = Signal(time, time, sampling="mean", start=0.0).moving_mean(10)
    # A mean belongs to the middle of its interval.
    np.testing.assert_allclose(means.time, found.time - 0.005)
    np.testing.assert_allclose(line.moving_mean(1).value, line.value)


def test_trimmed_mean_takes_outliers_out_and_keeps_a_plateau():
    rng = np.random.default_rng(3)
    value = np.where(rng.random(400) < 0.02, 50.0, 1.0)
    spikes = np.flatnonzero(value > 1)
    assert len(spikes) > 3
    found = Signal(0.01 * np.arange(400), value).moving_mean(11, trim=1)
    lonely = [k for k in spikes if np.sum(np.abs(spikes - k) < 11) == 1 and 10 <= k < 390]
    assert lonely
    for k in lonely:
        np.testing.assert_allclose(found.value[k - 10 : k + 1], 1.0)


def test_l2_error_is_the_root_of_the_mean_square():
    time = np.linspace(0, 2, 5)
    assert Signal(time, np.full(5, 1.3)).l2_error(1.0) == pytest.approx(0.3)
    # A straight line from -1 to 1 has the mean square 1/3.
    assert Signal(time, time - 1).l2_error(0.0) == pytest.approx(1 / math.sqrt(3))
    assert Signal(time, time - 1).l2_error(0.0, 1.0, 2.0) == pytest.approx(1 / math.sqrt(3))
    steps = Signal(time[1:], [1.0, -1.0, 3.0, 1.0], sampling="mean", start=0.0)
    assert steps.l2_error(1.0) == pytest.approx(math.sqrt((0 + 4 + 4 + 0) / 4))
    line = Signal(np.linspace(-1, 3, 9), np.linspace(-1, 3, 9))
    assert Signal(time, time + 0.5).l2_error(line) == pytest.approx(0.5)
    # Means of the line over the same intervals are 0.25, 0.75, 1.25, 1.75.
    means = Signal(time[1:], [0.25, 0.75, 1.25, 2.75], sampling="mean", start=0.0)
    assert means.l2_error(line) == pytest.approx(0.5)


def test_means_and_norms_are_refused():
    signal = Signal([0.0, 0.1, 0.3], [1.0, 2.0, 3.0])
    with pytest.raises(libmpm.SceneError, match=r"0\.1 to 0\.2 s apart.*resampled"):
        signal.moving_mean(2)
    with pytest.raises(libmpm.SceneError, match="trim is 1 of 2 samples"):
        signal.moving_mean(2, trim=1)
    with pytest.raises(libmpm.SceneError, match="count is 4; expected ≤ 3"):
        signal.moving_mean(4)
    assert signal.resampled(0.1).moving_mean(3).value == pytest.approx([2.0], abs=0.2)
    with pytest.raises(libmpm.SceneError, match="means and the signal has points"):
        signal.l2_error(Signal([0.0, 0.3], [1.0, 2.0], sampling="mean", start=-0.1))
    with pytest.raises(libmpm.SceneError, match="expected a time in the record"):
        signal.l2_error(Signal([0.1, 0.3], [1.0, 2.0]))


def test_the_page_on_bridges_says_what_comes_out():
    """Its scene gives the inlet's state at the gauge, its floating block the stated numbers."""
    text = (Path(__file__).parents[2] / "docs" / "bridges.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.S)
    names: dict[str, object] = {}
    for block in blocks:
        exec(block, names)
    bore = names["bore"]
    # As the page says: with FLIP the front is undular, and what follows it still swings.
    assert names["level"] == pytest.approx(0.346, rel=0.005)
    assert names["speed"] == pytest.approx(0.83, rel=0.01)
    assert bore.depth == pytest.approx(0.338, abs=5e-4)
    assert bore.velocity == pytest.approx(0.864, abs=5e-4)
    assert len(names["lift"]) in (59, 60, 61)
    floats = names["floats"]
    assert floats.draught == pytest.approx(0.06)
    assert floats.metacentric_height == pytest.approx((0.080,), abs=5e-4)
    assert floats.stable
    square = shapes.Box(lower=(0, 0), upper=(1, 1))
    with pytest.warns(libmpm.ModelWarning, match="turns over"):
        shapes.afloat(shape=square, density=400, level=0)
