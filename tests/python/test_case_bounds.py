"""Bounds of reference cases that follow from a derivation of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from libmpm import cases
from libmpm._src.advice.cases.coupled import _EDGE, _WATER, _falls
from libmpm._src.advice.cases.fluids import swing


@pytest.mark.parametrize(("density", "bound"), [(1500.0, 0.17), (3000.0, 0.13)])
def test_buoyancy_allows_what_added_mass_makes_of_the_authors_model(density, bound):
    """True volume with a square's added mass, 1.51 π a² ρ, against the model without, over 2 s."""
    times = np.linspace(0.0, 2.0, 21)[1:]
    wide = _EDGE + 2 * 0.0125
    author = _falls(density, times, wide**2, wide**2 * _EDGE, 0.0)
    added = 1.51 * math.pi * (_EDGE / 2) ** 2 * _EDGE * _WATER
    model = _falls(density, times, _EDGE**2, _EDGE**3, added)
    away = np.abs(model - author).max()
    assert away <= bound < away + 0.01
    stated = cases.case("buoyancy").bounds["full"][f"author_{density:g}"]
    assert stated.upper == bound


@pytest.mark.parametrize(("until", "period", "amplitude"), [(5.6, 2.0, 0.6), (3.0, 2.0, np.nan)])
def test_what_a_history_does_not_show_is_no_number(until, period, amplitude):
    """A swing that has lost 0.4 after five half cycles, as long as there are samples of it."""
    t = np.arange(0.0, until + 1e-9, 0.02)
    found = swing(t, 0.6 ** (t / 5) * np.cos(np.pi * t))
    assert found["period"] == pytest.approx(period, rel=2e-3)
    assert found["amplitude"] == pytest.approx(amplitude, rel=0.02, nan_ok=True)


def test_a_slant_that_only_creeps_has_no_period():
    t = np.arange(0.0, 5.6, 0.02)
    assert np.isnan(swing(t, np.exp(-0.01 * t))["period"])
