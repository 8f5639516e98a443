"""The laws of docs/laws.md on their quickest points; other tests check them transfer by transfer.

Bounds are what the next terms of each law leave. Expected duration: 5 s.
"""

import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPT = FOLDER / "laws.py"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="needs the source tree")
if SCRIPT.exists():
    sys.path.insert(0, str(FOLDER))
    import laws as page
    import laws_measured as laws


def off(found, name="refined"):
    return found["measured"] / found[name] - 1


def test_smoothing_length_does_not_know_the_time_step():
    chosen = {"form": "two-volume", "ratio": 0.9, "wave": 16}
    whole, quarter = (laws.smoothing({**chosen, "step": step}) for step in (1.0, 0.25))
    assert abs(off(whole, "predicted")) < 0.01
    assert abs(off(whole)) < 1e-4
    assert quarter["measured"] == pytest.approx(whole["measured"], rel=1e-6)


@pytest.mark.parametrize(("form", "bound"), [("one-volume", 1e-4), ("one-volume-gradient", 5e-3)])
def test_one_volume_is_a_diffusion_per_step(form, bound):
    found = laws.smoothing({"form": form, "ratio": 0.2, "wave": 16, "step": 0.25})
    assert abs(off(found)) < bound


@pytest.mark.parametrize("particles", [1, 4, 9])
@pytest.mark.parametrize("scheme", ["PIC", "APIC"])
def test_loss_is_the_sum_over_the_lattice(scheme, particles):
    found = laws.loss({"scheme": scheme, "wave": 16, "particles": particles})
    assert abs(off(found)) < 2e-3


def test_loss_of_apic_has_the_coefficient_of_its_images():
    """(1/40 - 0.0012) (kΔx)⁴ for long waves and many particles, by the sums themselves."""
    for theta in (0.2, 0.1):
        lost = laws.lost_by_sums("APIC", theta, 0.0, 8)
        assert lost / theta**4 == pytest.approx(0.025 - 9 * 1.0173 / (8 * 3.14159265**6), rel=0.02)


@pytest.mark.parametrize("scheme", ["PIC", "APIC"])
def test_stiffer_water_loses_more_a_second(scheme):
    chosen = {"scheme": scheme, "wave": 16, "cell_size": 0.0125, "cfl": 0.45}
    soft, stiff = (laws.loss({**chosen, "modulus": k}) for k in (2.2e7, 2.2e9))
    assert stiff["measured"] / soft["measured"] == pytest.approx(10, rel=1e-3)
    assert abs(off(stiff)) < 2e-3


def test_side_force_at_equilibrium():
    """The law's next term is (3/8) (γ + 1) ρgH/K of it, 6 %; all of them together leave 0.5 %."""
    found = laws.equilibrium(
        {"cells": 8, "compression": 0.02, "walls": "mirrored", "transfer": "PIC", "fbar": False}
    )
    assert found["ringing"] < 1e-4
    assert abs(off(found)) < 0.005
    assert abs(off(found, "predicted")) < 0.08


@pytest.mark.parametrize("walls", ["mirrored", "held"])
def test_acoustic_stage(walls):
    """Period to 0.3 %, force to 0.03, of a column 16 cells deep; a quarter of it at 32."""
    coarse, fine = (laws.acoustic({"cells": n, "modulus": 2.2e8, "walls": walls}) for n in (16, 32))
    assert abs(off(coarse)) < 3e-3
    assert abs(off(fine)) < 1e-3
    assert coarse["error_refined"] < 0.03
    assert fine["error_refined"] < 0.5 * coarse["error_refined"]


def test_ringing_column_presses_less_than_a_settled_one():
    """Half as much again is missing while it rings freely."""
    found = laws.equilibrium(
        {"cells": 16, "compression": 0.02, "walls": "mirrored", "transfer": "APIC", "fbar": False,
         "periods": 4, "over": 24}
    )  # fmt: skip
    assert found["ringing"] > 0.9
    assert abs(off(found)) < 0.05


def test_file_and_page_have_every_point():
    lines = page.load(page.RESULTS)
    assert [(p.law, p.chosen) for p in laws.POINTS] == [(x["law"], x["chosen"]) for x in lines]
    assert page.page(lines) == page.PAGE.read_text(encoding="utf-8")
