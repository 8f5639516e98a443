"""What runs ahead of a wave: strains that fall through the smallest numbers there are."""

import numpy as np
import pytest

import libmpm
from libmpm import Field, Method, boundaries, materials, shapes
from libmpm._src.run.fault_messages import describe_fault
from libmpm.methods import FBar, Transfer

CELLS, DX = 128, 0.01

SOLID = {"density": 1000.0, "youngs_modulus": 1e6, "poissons_ratio": 0.3}
LAWS = {
    "Hencky": materials.StVenantKirchhoffHencky(**SOLID),
    "VonMises": materials.VonMises(**SOLID, yield_stress=1e5),
    "DruckerPrager": materials.DruckerPrager(**SOLID, friction_angle=30.0, cohesion=1e5),
}
#: The others: none of them may divide by what is nearly nothing either.
OTHERS = {
    "FixedCorotated": materials.FixedCorotated(**SOLID),
    "NeoHookean": materials.NeoHookean(**SOLID),
    "LinearElastic": materials.LinearElastic(**SOLID),
    "Hypoelastic": materials.Hypoelastic(**SOLID),
    "CamClay": materials.CamClay(
        **SOLID, friction_angle=30.0, log_plastic_volume=-0.3, hardening_factor=1.0,
        cohesion_ratio=0.5,
    ),
    "TaitFluid": materials.TaitFluid(density=1000.0, bulk_modulus=1e6, viscosity=1.0),
    "HerschelBulkleyFluid": materials.HerschelBulkleyFluid(
        density=1000.0, bulk_modulus=1e6, yield_stress=10.0, consistency=1.0, index=0.5,
        largest_viscosity=10.0,
    ),
}  # fmt: skip


def struck_bar(law, dimension=2, *, method=None, wall=None, elements=False, **body):
    """A bar at rest whose first two cells move along it, above a `wall` slowly on to it too."""
    across = dimension - 1
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=((CELLS + 8) * DX, *(10 * DX,) * across), gravity=(0.0,) * dimension,
        method=method or Method(),
    )  # fmt: skip
    low, up = (4 * DX,) * dimension, [(4 + CELLS) * DX, *(6 * DX,) * across]
    rest = ["0"] * across
    if wall is not None:
        low, up[1] = (low[0], 0.0, *low[2:]), 2 * DX
        rest[0] = f"where(x < {6 * DX}, -0.1, 0)"
        floor = shapes.DomainWalls(faces=("y-",))
        scene.add_boundary(name="floor", shape=floor, response=wall)
    shape = shapes.Box(lower=low, upper=tuple(up))
    if elements:
        mesh = shapes.Triangles if dimension == 2 else shapes.Tetrahedra
        shape = mesh.box(lower=low, upper=tuple(up), edge=DX)
    scene.add_body(
        name="bar", shape=shape, material=(LAWS | OTHERS)[law],
        velocity=Field(components=(f"where(x < {6 * DX}, 0.5, 0)", *rest)), **body,
    )  # fmt: skip
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


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("law", [*LAWS, *OTHERS])
def test_no_law_gives_nan_ahead_of_a_wave(law, dimension):
    """Until the forerunner is at the far end, in single precision, which has the fewest of them."""
    sim = libmpm.Simulation(struck_bar(law, dimension), device="cpu", precision="single")
    sim.step(CELLS // 2 + 6)
    body = sim.particles["bar"]
    speed, stress = np.abs(body["velocity"][:, 0]), np.abs(body["stress"])
    assert np.isfinite(stress).all()
    assert np.isfinite(speed).all()
    assert np.any((speed > 0) & (speed < 1e-20)), "no velocity was as small as the test is about"
    assert speed.max() < 1.0


ROUGH = {"static_friction": 0.3, "dynamic_friction": 0.2}
#: Other places that divide by what may be nearly nothing: speeds along walls, weights, volumes.
PLACES = {
    "FLIP": {"method": Method(transfer="FLIP")},
    "ASFLIP": {"method": Method(transfer=Transfer(scheme="ASFLIP", flip=0.95, shift_max=0.02))},
    "XPIC": {"method": Method(transfer="XPIC")},
    "FMPM": {"method": Method(transfer="FMPM")},
    "cubic": {"method": Method(kernel="cubic")},
    "cpdi": {"method": Method(kernel="cpdi")},
    "ddmp": {"method": Method(kernel="ddmp", transfer="FLIP")},
    "F-bar": {"fbar": FBar(form="two-volume", ratio=0.5)},
    "split F-bar": {"fbar": FBar(form="split", ratio=0.5)},
    "friction": {"wall": boundaries.Separable(**ROUGH, cell="held")},
    "friction, linear cells": {"wall": boundaries.Separable(**ROUGH, cell="linear")},
    "plates": {"wall": boundaries.Mirror(slip=False)},
    "elements": {"elements": True},
    "elements in space": {"elements": True, "dimension": 3},
}


@pytest.mark.parametrize("place", PLACES)
def test_no_other_place_gives_nan_ahead_of_a_wave(place):
    sim = libmpm.Simulation(
        struck_bar("Hencky", **PLACES[place]), device="cpu", precision="single", threads=1
    )
    sim.step(CELLS // 2 + 20)
    speed = np.abs(sim.particles["bar"]["velocity"][:, 0])
    assert np.isfinite(speed).all()
    assert np.any((speed > 0) & (speed < 1e-20)), "no velocity was as small as the test is about"
    assert speed.max() < 1.0


def test_every_law_is_among_them():
    built = {getattr(materials, name) for name in materials.__all__ if name[0].isupper()}
    assert {type(law) for law in (LAWS | OTHERS).values()} == {
        kind for kind in built - {materials.Material, materials.Rigid} if isinstance(kind, type)
    }


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
