"""Viscous flow between plates by transfer and wall: what is warned of, and what it is worth.

A slug four gaps long between two plates, as in `test_channel_flow`, driven along them until it is
steady; the peak of its profile over that of the law. `Scene.validate` says before the run what a
linear system of one dimension predicts of it (`scene/checks_viscous.py`).

Expected duration: 150 s.
"""

import warnings

import numpy as np
import pytest
from validation.test_channel_flow import shear_rate

import libmpm
from libmpm import Method, boundaries, materials, shapes
from libmpm._src.scene.checks_time_steps import step_of
from libmpm._src.scene.checks_viscous import peak_share, smeared_flows
from libmpm.methods import Transfer

pytestmark = pytest.mark.validation

GAP, LENGTH, AIR, DENSITY, NU = 1.0, 4, 12, 1000.0, 1.0
TRANSFERS = {"APIC": "APIC", "FLIP": "FLIP", "AFLIP": Transfer(scheme="AFLIP", flip=0.99)}
WALLS = {"sticky": boundaries.Sticky(), "mirror": boundaries.Mirror(slip=False)}
#: Largest error without a warning (specified), and what the linear system may be off by.
WARNED, PREDICTED = 0.05, 0.02
#: Profile of the good setting, root mean square over the peak (specified).
GOOD = 0.06


def slug(cells, transfer, wall, material, pull):
    dx = GAP / cells
    far = (LENGTH * cells + cells + 2 * AIR) * dx
    room = 2 * dx if wall in ("boxes", "surfaces") else 0.0
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, -room), gravity=(pull, 0.0),
        upper=(far, GAP + room),
        method=Method(transfer=TRANSFERS[transfer]),
    )  # fmt: skip
    scene.add_body(
        name="fluid",
        shape=shapes.Box(lower=(AIR * dx, 0.0), upper=(AIR * dx + LENGTH * GAP, GAP)),
        material=material,
    )
    if wall == "boxes":
        for name, low in (("floor", -room), ("lid", GAP)):
            box = shapes.Box(lower=(0.0, low), upper=(far, low + room))
            scene.add_boundary(name=name, shape=box, response=WALLS["sticky"])
    elif wall == "surfaces":
        floor = shapes.HeightField(x=(0.0, far), z=(0.0, 0.0))
        scene.add_boundary(name="floor", shape=floor, response=WALLS["sticky"])
        lid = shapes.HalfSpace(point=(0.0, GAP), normal=(0.0, -1.0))
        scene.add_boundary(name="lid", shape=lid, response=WALLS["sticky"])
    else:
        faces = shapes.DomainWalls(faces=("y-", "y+"))
        scene.add_boundary(name="plates", shape=faces, response=WALLS[wall])
    return scene


def newtonian(cells, transfer, wall):
    fluid = materials.TaitFluid(density=DENSITY, bulk_modulus=DENSITY * 50.0**2,
                                viscosity=DENSITY * NU)  # fmt: skip
    return slug(cells, transfer, wall, fluid, 8 * NU * (NU / GAP) / GAP**2), 0.6


def bingham(cells, transfer, wall):
    mud = materials.HerschelBulkleyFluid(
        density=DENSITY, bulk_modulus=DENSITY * 200.0**2, yield_stress=0.5 * DENSITY * 10,
        consistency=DENSITY * NU, index=1.0, largest_viscosity=10 * DENSITY * NU,
    )  # fmt: skip
    return slug(cells, transfer, wall, mud, 2 * 10.0 / GAP), 0.4


def profile(scene, until):
    """Rows of the middle: y, speed, and the pull that is felt there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
        sim.run(until=until, progress=False)
    found = sim.particles["fluid"].read(["position", "velocity", "pressure"])
    x, y = found["position"].T
    near = np.abs(x - x.mean()) < GAP / 2
    slope = np.polyfit(x[near], found["pressure"][near], 1)[0] / DENSITY
    near = np.abs(x - x.mean()) < GAP / 4
    row = np.floor(2 * y[near] / scene.cell_size).astype(int)
    count = np.bincount(row)
    mean = [np.bincount(row, q[near]) / count for q in (y, found["velocity"][:, 0])]
    return *mean, scene.gravity[0] - slope


def law(y, pull, mud):
    """Speed of a plane Poiseuille flow, m/s: of mud as it is regularised; else a parabola."""
    if mud is None:
        return pull / (2 * NU) * y * (GAP - y)
    r = np.linspace(0, GAP / 2, 2001)
    rate = shear_rate(DENSITY * pull * r, mud)
    drop = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(r) * (rate[1:] + rate[:-1]))])
    return drop[-1] - np.interp(np.abs(y - GAP / 2), r, drop)


def check(scene, until, mud=None):
    doubts = smeared_flows(scene)
    y, u, pull = profile(scene, until)
    exact = law(y, pull, mud)
    share = u.max() / exact.max()
    error = float(np.sqrt(np.mean(np.square(u / exact.max() - exact / exact.max()))))
    print(f"peak {share:.3f}, profile {error:.3f}, warned {bool(doubts)}: {doubts}")
    return share, error, doubts


@pytest.mark.parametrize("cells", [8, 16])
@pytest.mark.parametrize("wall", [*WALLS, "boxes", "surfaces"])
@pytest.mark.parametrize("transfer", TRANSFERS)
def test_newtonian(transfer, wall, cells):
    scene, until = newtonian(cells, transfer, wall)
    share, error, doubts = check(scene, until)
    s = 4 * NU * step_of(scene) / scene.cell_size**2
    told = peak_share(cells, s, scene.transfer, wall == "mirror")
    print(f"told {told:.3f}")
    assert share == pytest.approx(told, abs=PREDICTED)
    assert bool(doubts) == (abs(1 - share) > WARNED)
    if wall == "mirror" and transfer != "APIC" and cells == 16:
        assert error <= GOOD


@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("transfer", TRANSFERS)
def test_bingham(transfer, wall):
    scene, until = bingham(16, transfer, wall)
    share, error, doubts = check(scene, until, scene.bodies[0].material)
    assert bool(doubts) == (abs(1 - share) > WARNED)
    if wall == "mirror" and transfer != "APIC":
        assert error <= GOOD
