"""What runs ahead of a wave: strains that fall through the smallest numbers there are."""

import numpy as np
import pytest

import libmpm
from libmpm import Field, materials, shapes
from libmpm._src.run.fault_messages import describe_fault

CELLS, DX = 128, 0.01

LAWS = {
    "Hencky": materials.StVenantKirchhoffHencky(
        density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3
    ),
    "VonMises": materials.VonMises(
        density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3, yield_stress=1e5
    ),
    "DruckerPrager": materials.DruckerPrager(
        density=1000.0, youngs_modulus=1e6, poissons_ratio=0.3, friction_angle=30.0, cohesion=1e5
    ),
}


def struck_bar(law):
    """A bar at rest whose first two cells move along it."""
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=((CELLS + 8) * DX, 10 * DX),
        gravity=(0.0, 0.0),
    )  # fmt: skip
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(4 * DX, 4 * DX), upper=((4 + CELLS) * DX, 6 * DX)),
        material=LAWS[law],
        velocity=Field(components=(f"where(x < {6 * DX}, 0.5, 0)", "0")),
    )
    return scene


@pytest.mark.parametrize("law", LAWS)
def test_a_wave_decays_through_the_smallest_numbers_of_single_precision(law):
    """Each step carries it two cells on, weaker by orders, down to 1e-45."""
    found = []
    for precision in ("single", "double"):
        sim = libmpm.Simulation(struck_bar(law), device="cpu", precision=precision)
        sim.step(90)
        body = sim.particles["bar"]
        order = np.argsort(body["id"])
        found.append((body["position"][order], body["velocity"][order]))
    (x, v), (x_double, v_double) = found
    assert np.isfinite(v).all()
    # The forerunner has been everywhere, and where it is faint it has moved nothing.
    faint = np.abs(v[:, 0])
    assert np.any((faint > 0) & (faint < 1e-30)), "no velocity was as small as the test is about"
    assert np.abs(x - x_double).max() < 1e-5 * DX
    assert np.abs(v - v_double).max() < 1e-5


def test_what_was_never_fast_is_not_told_to_lower_cfl():
    fault = {
        "code": "non-finite", "body": "bar", "ids": [316], "step": 18, "time": 2e-3,
        "message": "its position or state is not finite", "grew_since": 0,
    }  # fmt: skip
    slow = describe_fault(fault | {"speed": 0.24}, 1e-4, DX)
    assert "precision='double'" in slow
    assert "cfl" not in slow
    assert "bulk modulus" not in slow
    for fast in (40.0, 1e300, float("inf"), float("nan")):
        assert "lower Method.cfl" in describe_fault(fault | {"speed": fast}, 1e-4, DX)
