"""Rows of `benchmarks/contact.py` and `rigid.py` that take a second, with their bounds by theory.

Expected duration: 8 s, most of it two boxes and two discs.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"

pytestmark = [
    pytest.mark.validation,
    pytest.mark.skipif(not (FOLDER / "contact.py").exists(), reason="needs the source tree"),
]
if (FOLDER / "contact.py").exists():
    sys.path.insert(0, str(FOLDER))
    import contact as rows
    import contact_heave
    import rigid


def test_added_mass_of_half_a_square_in_a_wide_tank() -> None:
    """π/8 · 1.51 B² (DNV-RP-H103, table A-1), which a tank of 12 B by 6 B raises a little."""
    assert 1.0 < contact_heave.added_mass(0.5, tank=12.0, depth=6.0) / 0.5930 < 1.02


def test_theory_of_heave_keeps_within_a_fall_without_waves() -> None:
    """Rest is a quarter of the lift up in a tank of 4 B: it falls by 3/4 to it, by less beyond."""
    found = contact_heave.heave(0.5, 0.25)
    assert 0 < found["overshoot"] < 0.75
    assert found["half_period"] < found["simple"]


@pytest.mark.parametrize("stiff", [None, 1e6])
def test_heave_of_a_box_afloat(stiff: float | None) -> None:
    """Half the density of water, 12 cells: half period by linear potential flow in the tank."""
    assert abs(rigid.heave(500.0, stiff, cells=12, lift=3.0)["error"]) < 0.15


def test_block_on_a_slope_turned_against_the_grid() -> None:
    assert abs(rows.slope(0.3, 15.0)["error"]) < 0.03


def test_discs_head_on() -> None:
    found = rows.head_on()
    assert 0.93 < found["restitution"] < 1
    assert found["momentum"] < 1e-12
