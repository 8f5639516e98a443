"""Series of a sensor: columns by name, peaks, impulses against closed forms, table and plot."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest

import libmpm
from libmpm._src.output.report import summaries, table
from libmpm._src.output.series import Peak, Series


def load_cell(count=400, dt=0.01):
    """Means over `dt` of a half sine push in x and a constant weight in z."""
    series = Series(
        "load",
        ("force_x", "force_y", "force_z", "moment_x"),
        ("N", "N", "N", "N m"),
        {"kind": "load-cell", "interval": dt},
    )
    ends = dt * np.arange(1, count + 1)
    antiderivative = -np.cos(np.pi * ends / (count * dt))
    force = 100.0 * np.diff(antiderivative, prepend=-1.0) * count / np.pi
    zeros = np.zeros(count)
    series.append(ends, np.stack([-force, zeros, np.full(count, 2.0), zeros], axis=1))
    return series


def gauge(time, level):
    series = Series("gauge", ("elevation",), ("m",), {"kind": "wave-gauge", "interval": 0.1})
    series.append(np.asarray(time, float), np.asarray(level, float)[:, None])
    return series


def test_columns_have_names():
    series = load_cell()
    assert (series["force_z"] == 2.0).all()
    series["force_z"][:] = 0  # a copy
    assert (series["force_z"] == 2.0).all()
    assert "force_x" in series and "force" not in series
    with pytest.raises(KeyError, match=r"'load' has no component 'force_u'.*force_"):
        series["force_u"]
    assert "400 samples, 0.01 to 4 s; force_x [N]" in repr(series)


def test_impulse_of_means_is_exact_whatever_the_interval():
    # The integral of 100 sin(pi t / 4) over its half period is 100 * 4 * 2 / pi.
    for count in (7, 400):
        series = load_cell(count, 4.0 / count)
        assert series.impulse("force_x") == pytest.approx(-800.0 / np.pi, rel=1e-12)
        assert series.impulse() == series.impulse("force_x")
        assert series.impulse("force_z") == pytest.approx(8.0, rel=1e-12)
        # A part of a mean counts with its part of the interval.
        assert series.impulse("force_z", start=1.003, end=2.5) == pytest.approx(2.994, rel=1e-12)
        halves = [series.impulse(start=0, end=1.23), series.impulse(start=1.23)]
        assert sum(halves) == pytest.approx(series.impulse(), rel=1e-12)


def test_impulse_of_instants_joins_them_by_lines():
    series = Series("body", ("contact_force_x",), ("N",), {"kind": "BodyTracker"})
    series.append(np.array([1.0, 2.0, 4.0]), np.array([[0.0], [3.0], [3.0]]))
    assert series.impulse() == pytest.approx(1.5 + 6.0)
    assert series.impulse(start=1.5, end=3.0) == pytest.approx(0.5 * (1.5 + 3.0) * 0.5 + 3.0)


def test_impulse_of_what_is_no_force_is_refused():
    series = gauge([0.1, 0.2], [1.0, 2.0])
    with pytest.raises(libmpm.Error, match=r"'gauge'.*elevation \[m\].*this sensor has none"):
        series.impulse()
    with pytest.raises(libmpm.Error, match=r"impulse from 2 to 1.*start < end"):
        load_cell().impulse(start=2, end=1)


def test_peak_keeps_its_sign_and_skips_nan():
    series = load_cell()
    peak = series.peak()
    assert isinstance(peak, Peak) and peak.component == "force_x"
    assert peak.value == pytest.approx(-100.0, rel=1e-4)
    assert peak.time == pytest.approx(2.0, abs=0.011)
    smooth = series.peak(filter=1.0)
    # The mean of a sine over a quarter of its half period about the crest: sin(a)/a, a = pi/8.
    assert smooth.value == pytest.approx(-100 * np.sin(np.pi / 8) / (np.pi / 8), rel=1e-3)
    dry = gauge([0.1, 0.2, 0.3], [np.nan, 0.4, np.nan])
    assert dry.peak() == (0.4, 0.2, "elevation")
    with pytest.raises(libmpm.Error, match="no sample of elevation"):
        gauge([0.1], [np.nan]).peak()
    with pytest.raises(libmpm.Error, match="filter is -1"):
        series.peak(filter=-1)


def test_table_for_pandas():
    pytest.importorskip("pandas")
    series = load_cell()
    frame = series.to_pandas()
    assert list(frame.columns) == list(series.components) and frame.index.name == "time [s]"
    assert (frame["force_z"].to_numpy() == 2.0).all() and (frame.index == series.time).all()
    assert frame.attrs["units"]["moment_x"] == "N m"


def test_plot_draws_forces_with_units():
    series = load_cell()
    axes = series.plot().axes[0]
    assert [line.get_label() for line in axes.lines] == ["force_x", "force_y", "force_z"]
    assert axes.get_xlabel() == "time [s]" and axes.get_ylabel() == "force [N]"
    # Several series in one picture, each with a colour and the name of its series.
    figure, axes = plt.subplots()
    assert series.plot("force_x", filter=0.1, axes=axes) is figure
    gauge([0, 1], [2, 3]).plot(axes=axes)
    shown = [line for line in axes.lines if line.get_label()[0] != "_"]
    assert [line.get_label() for line in shown] == [
        "load, force_x, mean over 100 ms",
        "gauge, elevation",
    ]
    assert shown[0].get_color() != shown[1].get_color()
    with pytest.raises(libmpm.Error, match="one plot has one unit"):
        series.plot(["force_x", "moment_x"])
    with pytest.raises(KeyError, match="has no component"):
        series.plot("level")
    plt.close(figure)


def test_the_table_of_a_run_says_where_nothing_loaded_a_cell():
    series = Series("load", ("force_x",), ("N",), {"kind": "load-cell", "interval": 0.01})
    series.append(0.01 * np.arange(1, 100), np.zeros((99, 1)))
    (load,) = summaries({"load": series}, 0.02)
    text = table([load], 1e6, 2.0, 100)
    assert "none, no sample differs from 0 N" in text
    assert "arrival" not in text and "peak" not in text.split("samples and filter")[0]
    loaded = table(summaries({"load": load_cell()}, 0.02), 1e6, 2.0, 100)
    assert "arrival" in loaded and "first peak" in loaded
