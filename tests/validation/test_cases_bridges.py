"""Reference cases of debris against bridges (Yang 2016): T7 and T8 of the digest's section 10.

Expected duration: 10 s.
"""

import math

import numpy as np
import pytest

import libmpm
import libmpm.cases
from libmpm import design
from libmpm._src.advice.cases.bridges import CASES as BLOCKS
from libmpm._src.advice.cases.bridges import block_impact, block_pulse
from libmpm._src.advice.cases.decks import CASES as DECKS

pytestmark = pytest.mark.validation
CASES = (*BLOCKS, *DECKS)


def on_built_devices(name, device):
    """The deck's modified linear functions are built for the CPU alone."""
    if name == "debris-at-deck" and device == "cuda":
        pytest.skip("modified linear functions are not built for CUDA")


@pytest.mark.parametrize("name", [c.name for c in CASES])
def test_reduced(name, device):
    on_built_devices(name, device)
    result = libmpm.cases.run(name, device=device, precision="double")
    assert not result.failures, result.failures


@pytest.mark.parametrize("name", [c.name for c in CASES])
def test_full(name, full, device):
    on_built_devices(name, device)
    result = libmpm.cases.run(name, "full", device=device, precision="double")
    assert not result.failures, result.failures


#: Corners and a middle of the source's ranges of v, ρ, E and ν.
MATRIX = [
    (3.0, 200.0, 10e9, 0.1),
    (15.0, 1000.0, 0.1e9, 0.3),
    (15.0, 200.0, 0.1e9, 0.1),
    (3.0, 1000.0, 0.3e9, 0.3),
    (9.0, 600.0, 1e9, 0.2),
]


@pytest.mark.parametrize(("v", "rho", "modulus", "nu"), MATRIX)
def test_blocks_over_the_range_of_the_source(v, rho, modulus, nu, device):
    """T7: plateau within 10 % of (6.9) for L ≥ 6 m, 20 % for L = 3 m."""
    p = {
        "velocity": v, "density": rho, "youngs_modulus": modulus, "poissons_ratio": nu,
        "cell_size": 0.5,
    }  # fmt: skip
    lengths = (3.0, 6.0, 15.0)
    sim = libmpm.Simulation(block_impact(p, lengths), device=device, precision="double", threads=1)
    wave = math.sqrt(modulus / (1 - nu**2) / rho)
    sim.run(until=4 * 15.0 / wave, progress=False)
    for length, bound in zip(lengths, (0.2, 0.1, 0.1), strict=True):
        found = block_pulse(sim, p, length)
        assert found["plateau"] == pytest.approx(1, abs=bound), length
        assert 0.75 <= found["impulse"] <= 1.0


def test_partial_contact_is_weaker_and_less_so_for_long_blocks(device):
    """V12: h_c < h_d lowers the force, long blocks less; where the contact lies matters little.

    The heights of a load that spreads by 1 in 5 (design.spread_height) are within 7 % of h_d.
    """
    p = {
        "velocity": 3.0, "density": 1000.0, "youngs_modulus": 10e9, "poissons_ratio": 0.2,
        "cell_size": 0.25,
    }  # fmt: skip
    lengths = (3.0, 9.0)

    def plateau(contact, eccentricity=0.0):
        scene = block_impact(p, lengths, None, contact, eccentricity)
        sim = libmpm.Simulation(scene, device=device, precision="double", threads=1)
        sim.run(until=0.01, progress=False)
        found = np.array([block_pulse(sim, p, length)["plateau"] for length in lengths])
        spread = design.spread_height(
            contact=contact, height=3.0, length=np.array(lengths), eccentricity=eccentricity
        )
        np.testing.assert_allclose(found, spread / 3.0, rtol=0, atol=0.07)
        return found

    whole, half, third = plateau(3.0), plateau(1.5), plateau(1.0)
    off = plateau(1.5, 0.75)
    assert third[0] < 0.9 * half[0]
    assert half[0] < 0.95 * whole[0]
    for part in (half, third, off):
        assert part[1] / whole[1] > 1.05 * part[0] / whole[0]
    assert abs(off[1] / half[1] - 1) < 0.05 < abs(off[0] / half[0] - 1) < 0.2


def test_blocks_at_a_deck_are_in_the_sources_band_in_six_of_nine_cases():
    """V13 in the source's set-up: 1.25 to 1.35 times (6.10); long light blocks have more."""
    found = {
        (length, density): libmpm.cases.run(
            "debris-at-deck", length=length, density=density, threads=1
        ).values["ratio"]
        for length in (3.0, 6.0, 9.0)
        for density in (200.0, 400.0, 600.0)
    }
    inside = [key for key, ratio in found.items() if 1.25 <= ratio <= 1.35]
    assert len(inside) == 6, found
    outside = sorted(set(found) - set(inside))
    assert outside == [(3.0, 400.0), (9.0, 200.0), (9.0, 400.0)]
    assert 1.2 < min(found.values()) < max(found.values()) < 1.6
