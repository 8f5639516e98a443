"""Mirrored walls: what lies beyond is the image of what lies before, but for the pressure's slope.

F-bar's averages of a node and its image are shared across planes along gravity alone: pressure
grows towards one that gravity presses on (design/walls.md, 3).
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes

DX = 0.05


def scene(width, depth, gravity, response, air=2, **body):
    """Return water on the floor of its domain, which `gravity` presses on along one axis."""
    axis = int(np.flatnonzero(gravity)[0])
    upper, top = [width] * 2, [width] * 2
    upper[axis], top[axis] = depth + air * DX, depth
    made = libmpm.Scene(
        dimension=2, lower=(0, 0), upper=upper, cell_size=DX, gravity=gravity,
    )  # fmt: skip
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    made.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=top), hydrostatic=depth,
        **{"material": materials.TaitFluid(density=1000.0, bulk_modulus=2e4)} | body,
    )  # fmt: skip
    return made


def middle(made, axis, steps):
    """Return the height of the middle of the water after so many steps, parts of the depth."""
    sim = libmpm.Simulation(made, device="cpu", threads=1, precision="double")
    sim.step(steps)
    return float(sim.particles["water"]["position"][:, axis].mean()) / (4 * DX)


@pytest.mark.parametrize(("slip", "axis"), [(True, 0), (False, 1)])
def test_water_at_rest_does_not_sink(slip, axis):
    """It settles by what its weight does to the fill, as without F-bar, which forgets nothing.

    With averages shared across the bed it had sunk by a further 1.5e-3 after 4000 steps, and went
    on at 0.3e-3 in every 1000.
    """
    gravity = [0.0, 0.0]
    gravity[axis] = -9.81
    walls = boundaries.Mirror(slip=slip)
    heights = [
        middle(scene(2 * DX, 4 * DX, gravity, walls, fbar=fbar), axis, 4000)
        for fbar in ("default", None)
    ]
    assert heights[0] == pytest.approx(heights[1], abs=2e-4)


@pytest.mark.parametrize("form", ["one-volume-gradient", "one-volume", "two-volume"])
def test_half_of_a_column_that_falls_apart_is_the_whole(form):
    """Across a plane that gravity runs along averages stay shared: the half knows the other."""
    fbar = libmpm.FBar(form=form, length=DX) if form == "two-volume" else libmpm.FBar(form=form)
    found = []
    for low in (0.0, -0.4):
        made = libmpm.Scene(
            dimension=2, lower=(low, 0), upper=(0.4, 0.6), cell_size=DX, gravity=(0.0, -9.81)
        )
        walls = {"x-": boundaries.Mirror() if low == 0 else boundaries.Slip(cell="held")}
        walls |= {face: boundaries.Slip(cell="held") for face in ("x+", "y-", "y+")}
        made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
        made.add_body(
            name="water", shape=shapes.Box(lower=(low / 2, 0), upper=(0.2, 0.4)), fbar=fbar,
            material=materials.TaitFluid(density=1000.0, bulk_modulus=4e5),
        )  # fmt: skip
        sim = libmpm.Simulation(made, device="cpu", threads=1, precision="double")
        sim.step(400)
        read = sim.particles["water"].read(["position", "volume_ratio"])
        kept = read["position"][:, 0] > 0
        rows = np.column_stack([read["position"], read["volume_ratio"]])[kept]
        found.append(rows[np.lexsort(rows.T)])
    assert found[0].shape == found[1].shape
    assert found[0][:, 0].max() > 0.3, "it has moved"
    assert np.sort(found[0], axis=0) == pytest.approx(np.sort(found[1], axis=0), abs=1e-9)


@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
def test_what_particles_keep_does_not_go_with_placed_forces(transfer):
    """A force that presses on a mirrored bed is gravity with APIC; what FLIP keeps runs away."""
    found = []
    for gravity, force in ((-9.81, None), (0.0, -9.81)):
        made = libmpm.Scene(
            dimension=2, lower=(0, 0), upper=(0.4, 0.6), cell_size=DX, gravity=(0, gravity),
            method=libmpm.Method(transfer=transfer),
        )  # fmt: skip
        made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Mirror())
        placed = force and libmpm.boundaries.PlacedForce(axis="y", place=(0,), value=((0, force),))
        made.add_body(
            name="water", shape=shapes.Box(lower=(0, 0), upper=(0.4, 0.4)), fbar=None, force=placed,
            material=materials.TaitFluid(density=1000.0, bulk_modulus=4e5),
        )  # fmt: skip
        if transfer == "FLIP" and placed:
            with pytest.raises(libmpm.SceneError, match=r"Mirror with a PlacedForce.*'APIC'"):
                made.validate()
            return
        sim = libmpm.Simulation(made, device="cpu", threads=1, precision="double")
        sim.step(500)
        found.append(sim.particles["water"]["position"])
    assert found[0] == pytest.approx(found[1], abs=1e-9)
