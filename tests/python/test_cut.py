"""Near fields: a run cut to a box continues as the whole, behind a piston that moves as it did."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, flumes, materials, sensors, shapes

H = 0.05
STATIONS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0)


def tank(dimension=2, length=8.0, stroke=0.4):
    """A piston that sends a long wave into 0.5 m of water."""
    deep = ((0, 0), (length, 0.5)) if dimension == 2 else ((0, 0, 0), (length, H, 0.5))
    up = (0.0,) * (dimension - 1)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=H, gravity=(*up, -9.81),
        lower=(-0.5, *up), upper=(length, 1.0) if dimension == 2 else (length, H, 1.0),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=deep[0], upper=deep[1]), hydrostatic=0.5,
        material=materials.TaitFluid(bulk_modulus=2e5),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    time = np.linspace(0.0, 2.0, 41)
    rows = [(float(x), *up) for x in stroke * 0.5 * (1 - np.cos(np.pi * time / 2.0))]
    low = (-3.0, -1.0) if dimension == 2 else (-3.0, -1.0, -1.0)
    high = (0.0, 2.0) if dimension == 2 else (0.0, 2.0, 2.0)
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=low, upper=high), response=boundaries.Slip(),
        motion=boundaries.Displacement(libmpm.TimeTable(time, rows)),
    )  # fmt: skip
    across = () if dimension == 2 else (0.5 * H,)
    for name, x in (("far", 1.0), ("gauge", 0.7 * length - 0.55)):
        scene.add_sensor(name=name, sensor=sensors.WaveGauge(position=(x, *across), interval=0.05))
    return scene


def recorded(scene):
    for k, x in enumerate(STATIONS):
        low, high = [*scene.lower], [*scene.upper]
        low[0], high[0] = x - H, x + H
        scene.add_sensor(
            name=f"flow-{k}",
            sensor=sensors.ParticleSensor(
                attribute="velocity", operation="mean", direction="x", interval=0.05,
                region=shapes.Box(lower=tuple(low), upper=tuple(high)),
            ),
        )  # fmt: skip
    return scene


def run(scene, until):
    sim = libmpm.Simulation(scene, device="cpu", threads=1)
    sim.run(until=until, progress=False)
    return sim


def cut(path, low=2.0, **given):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        return libmpm.Scene.from_checkpoint(
            path, within=shapes.Box(lower=(low, -1), upper=(9, 2)), **given
        )


def test_a_cut_holds_its_water_and_its_motion(tmp_path):
    whole = run(tank(), 1.5)
    path = tmp_path / "trunk.npz"
    whole.save_checkpoint(path)
    with pytest.warns(libmpm.ModelWarning, match="boundary 'piston', sensor 'far'"):
        near = libmpm.Scene.from_checkpoint(path, within=shapes.Box(lower=(2.04, -1), upper=(9, 2)))
    assert (near.lower, near.upper) == (pytest.approx((2.0, 0.0)), pytest.approx((8.0, 1.0)))
    assert [b.name for b in near.boundaries] == ["walls"]
    assert libmpm.Scene.from_dict(json.loads(json.dumps(near.to_dict()))) == near
    part = libmpm.Simulation(near, device="cpu", threads=1)
    mine, theirs = part.particles["water"], whole.particles["water"]
    ids, every = np.asarray(mine["id"]), np.asarray(theirs["id"])
    inside = np.asarray(theirs["position"])[:, 0] >= 2.0
    assert set(ids) == set(every[inside]) and 0 < len(ids) < len(every)
    assert near.plan(device="cpu").particles == len(ids)
    order, rows = np.argsort(ids), np.searchsorted(np.sort(every), np.sort(ids))
    placed = np.asarray(theirs["position"])[np.argsort(every)][rows]
    assert np.allclose(np.asarray(mine["position"])[order], placed, atol=1e-12)
    # Where no sound of the cut has come yet everything moves as in the whole run.
    part.run(until=1.52, progress=False)
    whole.run(until=1.52, progress=False)
    far = placed[:, 0] > 4.0
    for name, limit in (("position", 5e-8), ("velocity", 1e-6)):
        a = np.asarray(part.particles["water"][name])
        b = np.asarray(whole.particles["water"][name])
        a = a[np.argsort(np.asarray(part.particles["water"]["id"]))]
        b = b[np.argsort(np.asarray(whole.particles["water"]["id"]))][rows]
        assert np.abs(a - b)[far].max() < limit


def test_a_near_field_gets_the_wave_of_the_whole_run(tmp_path):
    whole = run(recorded(tank()), 1.0)
    path = tmp_path / "trunk.npz"
    whole.save_checkpoint(path)
    whole.run(until=3.6, progress=False)
    series = [whole.sensors[f"flow-{k}"] for k in range(len(STATIONS))]
    u = np.array([np.asarray(s[s.components[0]]) for s in series]).T
    stroke = flumes.piston_of_flow(series[0].time, STATIONS, u, begin=1.0, at=2.0)
    time, place = stroke.arrays()
    assert place[0] == 0 and time[-1] == pytest.approx(3.6, abs=0.06)
    assert 0.3 < place[-1] < 0.4
    still, near = cut(path), cut(path)
    rows = [(float(x), 0.0) for x in place]
    near.add_boundary(
        name="face", shape=shapes.Box(lower=(-2.0, -1.0), upper=(2.0, 2.0)),
        response=boundaries.Slip(),
        motion=boundaries.Displacement(libmpm.TimeTable(time, rows)),
    )  # fmt: skip
    wanted = whole.sensors["gauge"]

    def off(scene):
        sensor = run(scene, 3.6).sensors["gauge"]
        level = np.interp(sensor.time, wanted.time, np.asarray(wanted["elevation"]))
        return np.abs(np.asarray(sensor["elevation"]) - level).max()

    rise = np.asarray(wanted["elevation"]).max() - 0.5
    assert rise > 0.05
    # 0.137 of it; 0.28 in cells of 0.1 m.
    assert off(near) < 0.15 * rise
    # Behind a wall that stands there is no such wave: the number above can fail.
    assert off(still) > 0.5 * rise


def test_a_slice_is_cut_and_tiled_in_one_call(tmp_path):
    whole = run(tank(3, length=4.0), 0.6)
    path = tmp_path / "trunk.npz"
    whole.save_checkpoint(path)
    box = shapes.Box(lower=(2.0, 0.0, 0.0), upper=(4.0, H, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        near = libmpm.Scene.from_checkpoint(path, within=box, tiles=4, axis="y")
    near.add_body(
        name="block", shape=shapes.Box(lower=(3.0, 0.05, 0.6), upper=(3.3, 0.15, 0.8)),
        material=materials.FixedCorotated(density=500.0, youngs_modulus=1e5),
    )  # fmt: skip
    assert near.upper == pytest.approx((4.0, 4 * H, 1.0))
    # Sides of a slice one cell thick are held for that; those of the tiles are wide apart.
    cells = [{p.face: p.cell for p in s.plan(device="cpu").boundaries if p.boundary == "walls"}
             for s in (whole.scene, near)]  # fmt: skip
    assert cells[0] == cells[1] | {"y-": "held", "y+": "held"}
    assert set(cells[1].values()) == {"linear"}
    inside = np.asarray(whole.particles["water"]["position"])[:, 0] >= 2.0
    branch = libmpm.Simulation(near, device="cpu", threads=1)
    assert len(branch.particles["water"]) == 4 * np.count_nonzero(inside)
    branch.step(20)
    assert branch.time > 0.6
    branch.save_checkpoint(tmp_path / "branch.npz")
    path.unlink()
    again = libmpm.Simulation.resume(tmp_path / "branch.npz")
    again.step(5)
    branch.step(5)
    a, b = (np.asarray(s.particles["water"]["position"]) for s in (again, branch))
    assert np.array_equal(a, b)


def test_a_cut_that_cannot_be_is_refused(tmp_path):
    path = tmp_path / "trunk.npz"
    run(tank(), 0.02).save_checkpoint(path)
    for box, said in (
        (shapes.Box(lower=(9, 0), upper=(10, 1)), "expected a part of the domain, -0.5 to 8 m"),
        (shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1)), "within has 3 axes; expected 2"),
        (shapes.Box(lower=(2, 0.8), upper=(4, 1)), "body 'water' has no particle within the cut"),
    ):
        with pytest.raises(libmpm.SceneError) as caught:
            libmpm.Scene.from_checkpoint(path, within=box)
        assert said in str(caught.value)


def test_a_plane_that_leaves_its_stations_is_refused():
    time, fast = [0.0, 1.0, 2.0], np.full((3, 2), 2.0)
    found = flumes.piston_of_flow(time, [0, 4], 0.5 * fast, begin=0.5, at=1.0)
    assert found.arrays()[1][-1] == pytest.approx(1.5)
    for given, said in (
        ((time, [0, 2], fast), "goes to 4 m by 2 s"),
        ((time, [0, 2], fast[:2]), "velocity has shape (2, 2)"),
        ((time, [0, 2], fast * np.nan), "velocity has gaps"),
    ):
        with pytest.raises(libmpm.SceneError) as caught:
            flumes.piston_of_flow(*given, begin=0.5, at=1.0)
        assert said in str(caught.value)
