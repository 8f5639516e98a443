"""Signals: filters, peaks and other numbers of curves whose answers are known."""

from __future__ import annotations

import json
import math
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import libmpm
from libmpm import analysis, boundaries, materials, sensors, shapes
from libmpm._src.output.series import Series
from libmpm.analysis import Signal

pytest.importorskip("scipy")

Curve = Callable[[Any], Any]
#: Samples a second on the coarse side of the comparisons; the fine side has ten times as many.
COARSE = 50.0


def refused(call: Callable[[], Any]) -> list[str]:
    with pytest.raises(libmpm.SceneError) as caught:
        call()
    return caught.value.problems


def sampled(curve: Curve, ends: Any, sampling: str) -> Signal:
    """Return values at `ends`, or means between them by Gauss-Legendre points."""
    ends = np.asarray(ends)
    if sampling == "point":
        return Signal(ends, curve(ends))
    point, weight = np.polynomial.legendre.leggauss(20)
    middle, half = 0.5 * (ends[1:] + ends[:-1]), 0.5 * np.diff(ends)
    mean = curve(middle[:, None] + half[:, None] * point) @ (0.5 * weight)
    return Signal(ends[1:], mean, sampling="mean", start=ends[0])


def spaced(rate: float, phase: float, jitter: float = 0.0) -> Any:
    """Return times over [-0.2, 2.4] s, `phase` of a step late, with steps that vary."""
    ends = -0.2 + (phase + np.arange(int(2.6 * rate) - 1)) / rate
    return ends + jitter / rate * np.random.default_rng(7).uniform(-0.5, 0.5, len(ends))


# Curves with known peaks (time, value) -----------------------------------------------------


def half_sine(t: Any) -> Any:
    return np.where((t > 0) & (t < 1), np.sin(np.pi * t), 0.0)


def damped_sine(t: Any) -> Any:
    return np.where(t > 0, np.exp(-1.5 * t) * np.sin(2 * np.pi * t), 0.0)


def gaussians(t: Any) -> Any:
    return 60 * np.exp(-(((t - 0.6) / 0.15) ** 2)) + 100 * np.exp(-(((t - 1.5) / 0.15) ** 2))


def humps(t: Any) -> Any:
    """A first impact, a gap, and a weaker second impact."""
    first = np.where((t > 0.1) & (t < 0.7), np.sin(np.pi * (t - 0.1) / 0.6) ** 2, 0.0)
    second = np.where((t > 0.9) & (t < 1.9), np.sin(np.pi * (t - 0.9)) ** 2, 0.0)
    return 5 * first + 3 * second


#: e^(-at) sin ωt is largest at ωt = atan(ω/a), and again every full turn.
TURN = math.atan(2 * math.pi / 1.5) / (2 * math.pi)
RINGING = [(TURN + k, float(damped_sine(np.array(TURN + k)))) for k in (0, 1)]
CURVES: dict[str, tuple[Curve, list[tuple[float, float]]]] = {
    "half-sine": (half_sine, [(0.5, 1.0)]),
    "damped sine": (damped_sine, RINGING),
    "two Gaussians": (gaussians, [(0.6, 60.0), (1.5, 100.0)]),
    "double hump": (humps, [(0.4, 5.0), (1.4, 3.0)]),
}


@pytest.mark.parametrize("jitter", [0.0, 0.5], ids=["even", "uneven"])
@pytest.mark.parametrize("sampling", ["point", "mean"])
@pytest.mark.parametrize("name", CURVES)
def test_peaks_are_those_of_the_curve(name: str, sampling: str, jitter: float) -> None:
    curve, known = CURVES[name]
    for rate, bound in ((COARSE, 2e-3), (10 * COARSE, 2e-6)):
        for phase in np.linspace(0, 1, 7, endpoint=False):
            signal = sampled(curve, spaced(rate, phase, jitter), sampling)
            found = signal.peaks(threshold=0.1, prominence=0.1)
            assert len(found) == len(known)
            for peak, (time, value) in zip(found, known, strict=True):
                assert peak.value == pytest.approx(value, rel=bound)
                assert peak.time == pytest.approx(time, abs=0.05 / rate)
            assert signal.first_peak(threshold=0.1) == found[0]
            assert signal.largest_peak() == max(found, key=lambda peak: peak.value)


@pytest.mark.parametrize("sampling", ["point", "mean"])
@pytest.mark.parametrize("name", CURVES)
def test_responses_do_not_depend_on_the_sample_rate(name: str, sampling: str) -> None:
    curve = CURVES[name][0]
    coarse, fine = (
        analysis.responses(
            sampled(curve, spaced(rate, 0.37), sampling).window(-0.15, 2.3), threshold=0.1
        )
        for rate in (COARSE, 10 * COARSE)
    )
    for key in ("f_max", "f_first", "duration"):
        assert coarse[key] == pytest.approx(fine[key], rel=4e-3), key
    # Means lose nothing but at the two ends of the window.
    bound = 1e-3 if sampling == "point" else 1e-4
    assert coarse["impulse"] == pytest.approx(fine["impulse"], rel=bound)
    for key in ("t_max", "t_first"):
        assert coarse[key] == pytest.approx(fine[key], abs=0.05 / COARSE), key
    assert coarse["arrival"] == pytest.approx(fine["arrival"], abs=0.3 / COARSE)


@pytest.mark.parametrize("sampling", ["point", "mean"])
@pytest.mark.parametrize("phase", [0.0, 0.3, 0.5, 0.95])
def test_first_peak_of_a_rectangular_pulse_is_its_plateau(phase: float, sampling: str) -> None:
    """A bar's impact: v A √(ρE) for 2 L √(ρ/E)."""

    def pulse(t: Any) -> Any:
        return np.where((t > 0.3) & (t < 1.3), 4429.0, 0.0)

    for rate in (COARSE, 10 * COARSE):
        ends = spaced(rate, phase)
        if sampling == "point":
            signal = Signal(ends, pulse(ends))
        else:
            mean = np.diff(4429.0 * np.clip(ends - 0.3, 0, 1)) * rate
            # Rounding breaks the ties on the plateau.
            mean *= 1 + 1e-13 * np.random.default_rng(1).standard_normal(len(mean))
            signal = Signal(ends[1:], mean, sampling="mean", start=ends[0])
        assert signal.first_peak().value == pytest.approx(4429.0, rel=1e-9)
        assert signal.largest_peak().value == pytest.approx(4429.0, rel=1e-9)
        assert signal.plateau(0.4, 1.2) == pytest.approx(4429.0, rel=1e-9)
        assert signal.impulse() == pytest.approx(4429.0, rel=1.01 / rate)
        assert signal.significant_duration() == pytest.approx(0.8, abs=1.25 / rate)


def test_a_front_that_bends_down_on_both_sides() -> None:
    """The parabola through 0.6, 1.001 and 1 rises to 1.05, but what follows is nearly flat."""
    signal = Signal(np.arange(7.0), [0.0, 0.0, 0.6, 1.001, 1.0, 0.9985, 0.996])
    assert 1.001 <= signal.largest_peak().value < 1.0012


def test_small_and_shallow_maxima_are_no_first_peak() -> None:
    time = np.arange(9.0)
    signal = Signal(time, [0.0, 1.0, 0.0, 6.0, 5.5, 9.0, 0.0, 10.0, 0.0])
    assert [p.value for p in signal.peaks(threshold=0, prominence=0)] == [1, 6, 9, 10]
    assert [p.value for p in signal.peaks()] == [9, 10]  # 1 is below 2, 6 falls by 0.5 only
    assert [p.value for p in signal.peaks(prominence=0.05)] == [6, 9, 10]
    assert [p.value for p in signal.peaks(threshold=0.1)] == [1, 9, 10]
    assert signal.first_peak().time == 5
    assert signal.largest_peak() == (7, 10)


def test_ends_of_a_record_can_be_peaks() -> None:
    falling = Signal([0.0, 1.0, 2.0], [4.0, 2.0, 1.0])
    assert falling.first_peak() == falling.largest_peak() == (0.0, 4.0)
    assert (Signal([0.0, 1.0, 2.0], [1.0, 2.0, 4.0])).largest_peak() == (2.0, 4.0)
    assert Signal([0.0, 1.0, 2.0], [3.0, 3.0, 3.0]).peaks() == [(1.0, 3.0)]


def test_a_mean_lies_at_the_middle_of_its_interval() -> None:
    signal = Signal([1.0, 2.0, 3.0, 4.0], [0.0, 5.0, 0.0, 0.0], sampling="mean", start=0.0)
    assert signal.largest_peak().time == pytest.approx(1.5)
    assert Signal([2.0, 3.0], [1.0, 2.0], sampling="mean").start == 1.0


# Integrals ---------------------------------------------------------------------------------


def test_impulse_follows_the_samples() -> None:
    time, value = [1.0, 2.0, 4.0], [3.0, 5.0, -1.0]
    points = Signal(time, value)
    assert points.impulse() == pytest.approx(4 + 4)
    assert points.impulse(1.5, 3.0) == pytest.approx(0.5 * 4.5 + 1 * 3.5)
    means = Signal(time, value, sampling="mean", start=0.5)
    assert means.impulse() == pytest.approx(1.5 + 5 - 2)
    assert means.impulse(0.75, 3.0) == pytest.approx(0.75 + 5 - 1)
    assert means.plateau(0.75, 3.0) == pytest.approx(4.75 / 2.25)
    for signal in (points, means):
        total = signal.cumulative_impulse()
        assert total.value[0] == 0
        assert total.value[-1] == pytest.approx(signal.impulse())
        assert total.unit == "N·s"
        assert np.interp(2.0, total.time, total.value) == pytest.approx(
            signal.impulse(signal.start, 2.0)
        )


SERIES = st.integers(2, 60).flatmap(
    lambda n: st.tuples(
        st.lists(st.floats(0.01, 1.0), min_size=n, max_size=n),
        st.lists(st.floats(-100.0, 100.0), min_size=n, max_size=n),
        st.sampled_from(["point", "mean"]),
    )
)


@settings(max_examples=60, deadline=None)
@given(SERIES, st.floats(0.05, 0.45), st.floats(0.55, 0.95))
def test_other_signals_keep_the_impulse(found: Any, low: float, high: float) -> None:
    steps, value, sampling = found
    time = np.cumsum(steps)
    signal = Signal(time, value, sampling=sampling)
    size = 1e-9 * (1 + float(np.abs(value).max()) * (signal.end - signal.start))
    for other in (
        signal.resampled(),
        signal.resampled(0.3 * (signal.end - signal.start)),
        Signal.__neg__(-signal),
    ):
        assert other.impulse() == pytest.approx(signal.impulse(), abs=size)
        assert (other.start, other.end) == (signal.start, signal.end)
    length = signal.end - signal.start
    a, b = signal.start + low * length, signal.start + high * length
    parts = [signal.window(None, a), signal.window(a, b), signal.window(b)]
    assert sum(p.impulse() for p in parts) == pytest.approx(signal.impulse(), abs=size)
    assert parts[1].impulse() == pytest.approx(signal.impulse(a, b), abs=size)
    assert (parts[1].start, parts[1].end) == (a, b)
    cutoff = 0.9 * 0.5 / float(np.diff(np.append(signal.start, time)).max())
    if cutoff * length >= 1:
        filtered = signal.low_pass(cutoff, order=3)
        assert filtered.impulse() == pytest.approx(signal.impulse(), abs=size)


def test_resampling_averages() -> None:
    even = Signal([1.0, 2.0, 3.0, 4.0], [1.0, 4.0, 2.0, 6.0], sampling="mean", start=0.0)
    np.testing.assert_allclose(even.resampled().value, even.value, rtol=1e-14)
    half = even.resampled(2.0)
    np.testing.assert_allclose(half.value, [2.5, 4.0])
    np.testing.assert_allclose(half.time, [2.0, 4.0])
    np.testing.assert_allclose(even.resampled(3.9).value, [2.5, 4.0])  # not longer than asked
    line = Signal([0.0, 1.0, 4.0], [0.0, 1.0, 4.0])
    np.testing.assert_allclose(line.resampled(1.0).value, [0.5, 1.5, 2.5, 3.5])


def test_arias_intensity_and_duration() -> None:
    pulse = Signal([1.0, 3.0, 5.0], [0.0, 6.0, 0.0], sampling="mean", start=0.0)
    arias = math.pi / (2 * 9.81) * (6.0 / 4.0) ** 2 * 2
    assert pulse.arias_intensity(4.0) == pytest.approx(arias)
    assert pulse.arias_intensity(4.0, gravity=1.62) == pytest.approx(arias * 9.81 / 1.62)
    curve = pulse.cumulative_arias(4.0)
    np.testing.assert_allclose(curve.value, [0, 0, arias, arias])
    assert curve.unit == "m/s"
    assert pulse.significant_interval() == pytest.approx((1.2, 2.8))
    assert pulse.significant_duration() == pytest.approx(1.6)
    assert pulse.significant_duration(low=0.25, high=0.75) == pytest.approx(1.0)
    # ∫ (a + b t)² over a straight line
    line = Signal([0.0, 3.0], [1.0, 4.0])
    assert line.arias_intensity(1.0) == pytest.approx(math.pi / (2 * 9.81) * (64 - 1) / 3)


def test_duration_of_a_half_sine_and_of_any_mass() -> None:
    from scipy.optimize import brentq

    def share(t: float) -> float:
        return t - math.sin(2 * math.pi * t) / (2 * math.pi)

    ends = [brentq(lambda t, s=s: share(t) - s, 0, 1) for s in (0.1, 0.9)]
    signal = sampled(half_sine, spaced(500, 0.2), "point")
    assert signal.significant_interval() == pytest.approx(ends, abs=2e-4)
    assert signal.normalised(123.0).significant_duration() == pytest.approx(
        signal.significant_duration(), rel=1e-12
    )


def test_arrival() -> None:
    ramp = Signal([0.0, 2.0, 3.0], [0.0, 10.0, 0.0])
    peak = ramp.largest_peak().value
    assert ramp.arrival() == pytest.approx(2.0 * 0.05 * peak / 10)
    assert ramp.arrival(level=5.0) == pytest.approx(1.0)
    assert ramp.arrival(share=1.0) == pytest.approx(2.0)
    assert math.isnan(ramp.arrival(level=11.0))
    assert Signal([0.5, 1.0], [3.0, 3.0]).arrival() == 0.5


# Filter ------------------------------------------------------------------------------------


def test_gain_of_the_filter() -> None:
    """Cosines that the ends of the record mirror are scaled, at the cut-off by one half."""
    n, h, order = 400, 1e-3, 3
    ends = h * np.arange(n + 1)
    for k in (0, 3, 40, 41, 200):
        value = np.cos(np.pi * k * (np.arange(n) + 0.5) / n)
        signal = Signal(ends[1:], value, sampling="mean", start=0.0)
        result = signal.low_pass(50.0, order=order)  # k = 40 is 50 Hz
        tangent = math.tan(math.pi * k / (2 * n)) / math.tan(math.pi * 50.0 * h)
        np.testing.assert_allclose(
            result.value, value / (1 + tangent ** (2 * order)), rtol=0, atol=1e-12
        )
        assert (result.filtered_at, result.filter_order) == (50.0, order)


def test_filter_is_that_of_scipy() -> None:
    from scipy.signal import butter, sosfiltfilt

    value = np.random.default_rng(3).standard_normal(2000)
    signal = Signal(1e-3 * np.arange(1, 2001), value, sampling="mean", start=0.0)
    expected = sosfiltfilt(butter(4, 30.0, fs=1e3, output="sos"), value)
    inside = slice(300, -300)
    np.testing.assert_allclose(signal.low_pass(30.0).value[inside], expected[inside], atol=1e-6)


@pytest.mark.parametrize("sampling", ["point", "mean"])
def test_filtered_peaks_do_not_depend_on_the_sample_rate(sampling: str) -> None:
    """An impact shorter than the filter, whose peak is the filter's and not the samples'."""

    def pulse(t: Any) -> Any:
        return np.where((t > 0.5) & (t < 0.58), 100.0, 0.0)

    found = []
    for rate in (200.0, 2000.0):
        ends = spaced(rate, 0.4)
        if sampling == "point":
            signal = Signal(ends, pulse(ends))
        else:
            mean = np.diff(100.0 * np.clip(ends - 0.5, 0, 0.08)) * rate
            signal = Signal(ends[1:], mean, sampling="mean", start=ends[0])
        found.append(signal.low_pass(5.0))
    # Points know an edge to a sample only, means know the impulse.
    bound = 1 / (0.08 * 200) if sampling == "point" else 1e-3
    peaks = [signal.largest_peak() for signal in found]
    assert peaks[0].value == pytest.approx(peaks[1].value, rel=bound)
    assert peaks[0].time == pytest.approx(peaks[1].time, abs=0.5 / 200)
    # Without delay, the middle of the pulse stays where it is.
    assert peaks[1].time == pytest.approx(0.54, abs=5e-4)
    assert found[0].impulse() == pytest.approx(found[1].impulse(), rel=bound)


def test_filter_of_filter_states_the_lower_cut_off() -> None:
    signal = Signal(np.arange(1, 101) * 0.01, np.ones(100), sampling="mean")
    assert signal.filtered_at is None
    assert signal.low_pass(10.0, order=2).low_pass(20.0).filtered_at == 10.0
    assert signal.low_pass(10.0, order=2).low_pass(20.0).filter_order == 2
    both = signal.low_pass(20.0).low_pass(10.0, order=2)
    assert (both.filtered_at, both.filter_order) == (10.0, 2)
    assert "below 10 Hz" in repr(both)
    assert both.window(0.2, 0.8).filtered_at == (-both).filtered_at == 10.0


def test_cut_offs_that_a_record_cannot_carry() -> None:
    signal = Signal([0.0, 0.01, 0.02, 0.0625, 0.085], np.ones(5))
    assert refused(lambda: signal.low_pass(12.0)) == [
        "analysis.Signal.low_pass: cutoff is 12 Hz; expected < 11.7647 Hz, half the sample rate in "
        "the longest interval, 0.0425 s after 0.02 s; sample more often or lower the cut-off"
    ]
    assert refused(lambda: signal.low_pass(11.0)) == [
        "analysis.Signal.low_pass: the record is 0.085 s long; expected at least one period of the "
        "cut-off, 0.0909091 s; record longer or raise the cut-off"
    ]
    both = refused(lambda: signal.low_pass(-1.0, order=0))
    assert len(both) == 2 and "cutoff is -1" in both[0] and "order is 0" in both[1]
    alone = Signal([1.0], [2.0])
    for call in (lambda: alone.low_pass(1.0), lambda: alone.resampled()):
        assert "the record is the value at one time" in refused(call)[0]


# Edge cases --------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [[0.0, 0.0, 0.0], [-1.0, -3.0, -2.0]], ids=["zero", "negative"])
def test_without_positive_values_there_is_no_peak(value: list[float]) -> None:
    signal = Signal([0.0, 1.0, 2.0], value)
    assert signal.peaks() == []
    for peak in (signal.first_peak(), signal.largest_peak()):
        assert math.isnan(peak.time) and peak.value == 0.0
    assert math.isnan(signal.arrival()) and math.isnan(signal.arrival(level=1.0))
    found = analysis.responses(signal)
    assert found["f_max"] == found["f_first"] == 0.0
    assert math.isnan(found["t_max"])
    assert found["impulse"] == pytest.approx(np.trapezoid(value))
    assert math.isnan(found["duration"]) == (value[0] == 0.0)


def test_the_other_direction() -> None:
    signal = Signal([0.0, 1.0, 2.0, 3.0], [0.0, -4.0, 1.0, 0.0], name="wall", unit="N/m")
    other = -signal
    assert other.largest_peak().value >= 4.0
    assert (other.name, other.unit) == ("wall", "N/m")
    assert other.impulse() == -signal.impulse()


def test_one_sample() -> None:
    point = Signal([2.0], [3.0])
    assert point.peaks() == [(2.0, 3.0)]
    assert (point.impulse(), point.arrival()) == (0.0, 2.0)
    assert math.isnan(point.interval) and math.isnan(point.significant_duration())
    mean = Signal([2.0], [3.0], sampling="mean", start=1.5)
    assert mean.impulse() == pytest.approx(1.5)
    assert mean.significant_duration() == pytest.approx(0.4)
    assert mean.arrival() == 1.75


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([], []), "analysis.Signal: there are no samples; expected at least one; run longer"),
        (([0, 1], [1, 2, 3]), "time has 2 samples and value 3; expected as many"),
        (([0, 1, 1, 0.5], [0] * 4), "time does not increase at samples 2, 3;"),
        (([0, math.inf], [0, 0]), "time is not finite at samples 1;"),
        (([0, 1, 2], [0, math.nan, math.inf]), "value is not a finite number at samples 1, 2;"),
        ((["a", "b"], [0, 0]), "time is ['a', 'b']; expected numbers (n,)"),
        (([0, 1], [[1, 2]]), "value has shape (1, 2); expected (n,)"),
    ],
)
def test_samples_that_are_refused(arguments: Any, words: str) -> None:
    (problem,) = refused(lambda: Signal(*arguments))
    assert words in problem


def test_options_that_are_refused() -> None:
    one: Any = ([1.0, 2.0], [1.0, 2.0])
    assert refused(lambda: Signal(*one, sampling="means")) == [
        "analysis.Signal: sampling is 'means'; did you mean 'mean'?"
    ]
    assert refused(lambda: Signal(*one, start=0.0)) == [
        'analysis.Signal: start is for sampling="mean"; leave it out'
    ]
    assert refused(lambda: Signal(*one, sampling="mean", start=1.0)) == [
        "analysis.Signal: start is 1; expected < 1 s; it is where the first mean begins"
    ]
    assert refused(lambda: Signal([1.0], [1.0], sampling="mean", name="wall")) == [
        "analysis.Signal 'wall': start is missing for a single mean; expected where it begins, in s"
    ]
    assert (
        "unknown argument 'units'; did you mean 'unit'?"
        in refused(
            lambda: Signal(*one, units="N")  # type: ignore[call-arg]
        )[0]
    )
    signal = Signal(*one)
    assert (
        "threshold is 1.5; expected ≥ 0 and ≤ 1" in refused(lambda: signal.peaks(threshold=1.5))[0]
    )
    assert refused(lambda: signal.impulse(0.0, 3.0)) == [
        "analysis.Signal.impulse: start is 0; expected a time in the record, 1 to 2 s",
        "analysis.Signal.impulse: end is 3; expected a time in the record, 1 to 2 s",
    ]
    assert (
        "start is 1.5 and end 1.5; expected start < end"
        in refused(lambda: signal.window(1.5, 1.5))[0]
    )
    assert (
        "low is 0.9 and high 0.1; expected low < high"
        in refused(lambda: signal.significant_duration(low=0.9, high=0.1))[0]
    )
    assert "reference_mass is 0; expected > 0 kg" in refused(lambda: signal.arias_intensity(0))[0]
    assert "by is 0; expected > 0 N" in refused(lambda: signal.normalised(0))[0]
    assert "share is 0; expected > 0" in refused(lambda: signal.arrival(share=0))[0]
    assert "interval is 2; expected > 0 and ≤ 1 s" in refused(lambda: signal.resampled(2.0))[0]


def test_missing_values() -> None:
    gauge = Signal([0.0, 1.0, 2.0], [math.nan, math.nan, 0.3], unit="m", missing=0.1)
    np.testing.assert_array_equal(gauge.value, [0.1, 0.1, 0.3])
    assert "expected numbers" in refused(lambda: Signal([0.0], [math.inf], missing=0.0))[0]


def test_signals_are_immutable_and_pickle() -> None:
    time = np.array([0.0, 1.0])
    signal = Signal(time, [1.0, 2.0], name="wall")
    time[0] = -5.0
    assert signal.time[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        signal.value[0] = 3.0
    with pytest.raises(AttributeError):
        signal.unit = "m"  # type: ignore[misc]
    again = pickle.loads(pickle.dumps(signal))
    np.testing.assert_array_equal(again.value, signal.value)
    assert repr(again) == repr(signal) == "<analysis.Signal 'wall': 2 values in N from 0 to 1 s>"


# Sensors -----------------------------------------------------------------------------------


def load_series(force: Any, kind: str = "load-cell") -> Series:
    series = Series("wall", ("force_x", "force_y"), ("N", "N"), {"kind": kind, "interval": 0.5})
    rows = np.asarray(force, dtype=float)
    series.append(0.5 * np.arange(1, len(rows) + 1), rows)
    return series


def test_components_of_a_load_cell() -> None:
    series = load_series([[0, 1], [-4, 1], [-2, 1], [0, 1]])
    signal = Signal.from_series(series)
    assert (signal.name, signal.sampling, signal.start) == ("wall -force_x", "mean", 0.0)
    assert signal.impulse() == pytest.approx(3.0)
    assert Signal.from_series(series, "force_x").impulse() == pytest.approx(-3.0)
    assert Signal.from_series(series, "-force_x").impulse() == pytest.approx(3.0)
    assert Signal.from_series(series, "force_y", start=0.25).impulse() == pytest.approx(1.75)
    assert refused(lambda: Signal.from_series(series, "force_z")) == [
        "analysis.Signal: sensor 'wall': component is 'force_z'; did you mean 'force_y'?"
    ]


def test_a_load_cell_measures_from_the_beginning_of_the_run() -> None:
    series = Series("wall", ("force_x",), ("N",), {"kind": "load-cell", "interval": 0.0})
    series.append(np.array([0.8, 1.0]), np.array([[1.0], [5.0]]))
    assert Signal.from_series(series).impulse() == pytest.approx(0.8 + 1.0)


def test_components_of_other_sensors() -> None:
    probe = load_series([[1, 2], [3, 4]], "velocity-probe")
    signal = Signal.from_series(probe, "force_y")
    assert (signal.sampling, signal.start) == ("point", 0.5)
    assert (
        "component is missing; expected one of force_x, force_y"
        in refused(lambda: Signal.from_series(probe))[0]
    )
    gauge = Series("gauge", ("elevation",), ("m",), {"kind": "wave-gauge"})
    assert "sensor 'gauge': there are no samples" in refused(lambda: Signal.from_series(gauge))[0]
    gauge.append(np.array([0.0, 1.0]), np.array([[math.nan], [0.4]]))
    assert "missing=" in refused(lambda: Signal.from_series(gauge))[0]
    assert Signal.from_series(gauge, missing=0.2).value.tolist() == [0.2, 0.4]
    wrong: Any = np.zeros(3)
    assert "expected that of a sensor" in refused(lambda: Signal.from_series(wrong))[0]


def test_responses() -> None:
    series = load_series([[0, 0], [-4, 0], [-2, 0], [0, 0], [0, 0], [0, 0]])
    found = analysis.responses(series, prefix="wall_", reference_mass=2.0)
    assert list(found) == [
        f"wall_{key}"
        for key in ("f_max", "t_max", "f_first", "t_first", "impulse", "duration", "arrival",
                    "cutoff", "interval", "arias")
    ]  # fmt: skip
    assert all(type(value) is float for value in found.values())
    json.dumps(found)
    assert found["wall_impulse"] == pytest.approx(3.0)
    assert found["wall_arias"] == pytest.approx(math.pi / (2 * 9.81) * (16 + 4) / 4 * 0.5)
    assert math.isnan(found["wall_cutoff"]) and found["wall_interval"] == 0.5
    filtered = analysis.responses(series, component="-force_x", cutoff=0.5, order=2)
    assert (filtered["cutoff"], filtered["interval"]) == (0.5, 0.5)
    assert filtered["impulse"] == pytest.approx(3.0)
    assert 0 < filtered["f_max"] < found["wall_f_max"]
    signal = Signal.from_series(series).low_pass(0.5, order=2)
    assert analysis.responses(signal)["f_max"] == pytest.approx(filtered["f_max"], rel=1e-12)
    assert "leave it out" in refused(lambda: analysis.responses(signal, component="force_x"))[0]


def test_impact_of_a_bar_in_a_simulation() -> None:
    """The load cell's impulse is the momentum that the bar lost; its plateau is v A √(ρE)."""
    density, modulus, speed, height = 1000.0, 1e6, 1.0, 0.08
    scene = libmpm.Scene(dimension=2, cell_size=0.02, lower=(0, 0), upper=(0.8, 0.2))
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(0.12, 0.06), upper=(0.52, 0.06 + height)),
        material=materials.FixedCorotated(
            density=density, youngs_modulus=modulus, poissons_ratio=0.0
        ),
        velocity=(-speed, 0.0),
    )
    scene.add_boundary(
        name="wall",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(0.1, 0.2)),
        response=boundaries.Separable(),
    )
    scene.add_sensor(name="wall", sensor=sensors.LoadCell(boundary="wall"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        sim = libmpm.Simulation(scene, device="cpu", threads=1)
        sim.run(until=0.06, progress=False)
    mass = density * 0.4 * height
    velocity = sim.particles["bar"]["velocity"][:, 0]
    signal = Signal.from_series(sim.sensors["wall"], "-force_x")
    assert signal.unit == "N/m"
    assert signal.impulse() == pytest.approx(mass * (speed + velocity.mean()), rel=2e-3)
    force = speed * height * math.sqrt(density * modulus)
    found = analysis.responses(signal, cutoff=200.0)
    middle = 0.5 * (found["arrival"] + 2 * 0.4 * math.sqrt(density / modulus))
    assert signal.plateau(middle - 0.005, middle + 0.005) == pytest.approx(force, rel=0.1)
    assert found["f_max"] == pytest.approx(force, rel=0.25)
    assert found["t_first"] <= found["t_max"]


# Pictures and packages ---------------------------------------------------------------------


def test_plots() -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    points = Signal([0.0, 1.0], [2.0, 3.0], unit="m")
    ax = points.plot(color="k")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time (s)", "m")
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [2, 3])
    means = Signal([1.0, 2.0], [2.0, 3.0], sampling="mean", name="wall")
    assert means.plot(ax) is ax
    np.testing.assert_array_equal(ax.patches[0].get_data().edges, [0, 1, 2])
    assert ax.patches[0].get_label() == "wall"
    plt.close("all")


def test_packages_are_loaded_when_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    code = (
        "import sys, libmpm.analysis\n"
        "print([m for m in ('scipy', 'pandas', 'statsmodels', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
    monkeypatch.setitem(sys.modules, "scipy.signal", None)
    assert "pip install libmpm[studies]" in refused(Signal([0.0, 1.0], [1.0, 2.0]).peaks)[0]
