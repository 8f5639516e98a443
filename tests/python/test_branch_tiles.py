"""Slices side by side: the flume that a slice one cell thick becomes.

Expected duration: 2 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

from __future__ import annotations

import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, shapes
from support.branches import (
    BACKENDS,
    DX,
    FORMS,
    SOUND,
    THIN,
    WOOD,
    assert_close,
    flume,
    saved,
    simulate,
)
from support.devices import device  # noqa: F401
from support.tolerances import ROUNDING


def by_first_place(places: np.ndarray) -> np.ndarray:
    """An order that two fills of the same lattice share."""
    return np.lexsort(np.round(places / DX, 3).T)


@THIN
@BACKENDS
@pytest.mark.parametrize(
    ("form", "scheme"),
    [("none", "APIC"), ("one-volume", "FLIP"), ("one-volume-gradient", "APIC"),
     ("two-volume", "APIC")],
)  # fmt: skip
def test_a_tiled_slice_is_the_wide_flume(tmp_path, form, scheme, device, precision):
    if precision != "double" and form != "one-volume-gradient":
        pytest.skip("one form shows the rounding of the others")
    tiles = 4
    slice_ = flume(1, fbar=FORMS[form], tracked=288 + 7, transfer=scheme)
    first = {b: v["position"] for b, v in simulate(slice_).particles.items()}
    trunk = simulate(slice_, device, precision)
    wide = simulate(flume(tiles, fbar=FORMS[form], transfer=scheme), device, precision)
    full = {b: v["position"] for b, v in simulate(flume(tiles)).particles.items()}
    trunk.step(80)
    wide.step(80)
    scene = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path), tiles=tiles, axis="y")
    assert scene.cells == wide.scene.cells
    assert scene.boundaries[1].shape.upper[1] == pytest.approx(0.1 + tiles * DX)
    branch = simulate(scene, device, precision)
    for sim in (branch, wide):
        sim.step(60)
    assert branch.time == wide.time
    count = 0
    for body, places in first.items():
        n = len(places)
        ids = branch.particles[body]["id"].astype(int)
        np.testing.assert_array_equal(ids, count + np.arange(tiles * n))
        copies = np.tile(places, (tiles, 1))
        copies[:, 1] += np.repeat(np.arange(tiles), n) * DX
        i, j = by_first_place(copies), by_first_place(full[body])
        np.testing.assert_allclose(copies[i], full[body][j], atol=1e-9)
        for name in ("position", "velocity", "volume_ratio"):
            a, b = branch.particles[body][name][i], wide.particles[body][name][j]
            unit = (100 if device == "cpu" else 1000) * ROUNDING[precision]
            scale = SOUND / 10 if name == "velocity" else 1.0
            assert np.abs(a - b).max() < unit * scale, (body, name)
        count += tiles * n
    # The sensors begin at the branch; the load of a wall four cells wide, and the first copy's ids.
    old, new = wide.sensors["load"], branch.sensors["load"]
    keep = old.time > scene.start.time
    np.testing.assert_array_equal(new.time, old.time[keep])
    np.testing.assert_allclose(
        new.values[:, 0], old.values[keep, 0], atol=1e-4 * np.abs(old.values[:, 0]).max()
    )
    track = branch.sensors["track"]
    assert track.time[0] == scene.start.time
    chosen = tiles * 288 + 7
    assert scene.sensors[1].sensor.ids == (chosen, chosen + 1)
    at = branch.particles["sand"]["id"] == chosen
    branch.step(1)
    moved = branch.sensors["track"].values[-1, :3] - branch.particles["sand"]["position"][at][0]
    assert np.abs(moved).max() < 0.01 * DX


@THIN
def test_tiles_of_tiles_and_bodies_between_them(tmp_path):
    trunk = simulate(flume(1))
    trunk.step(40)
    two = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path), tiles=2, axis="y")
    between = simulate(two)
    between.step(40)
    four = libmpm.Scene.from_checkpoint(saved(between, tmp_path, "2.npz"), tiles=2, axis="y")
    at_once = libmpm.Scene.from_checkpoint(saved(trunk, tmp_path), tiles=4, axis="y")
    sims = [simulate(four), simulate(at_once)]
    sims[1].step(40)
    for sim in sims:
        sim.step(20)
    # Copies of copies have the ids that four copies have.
    assert_close(sims[1], sims[0], "cpu", "double", 60)
    scene = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz", tiles=4, axis="y")
    place = ((0.1, 0.12, 0.05), (0.2, 0.28, 0.15))
    water = simulate(at_once).particles["water"]["position"] - np.array(scene.origin)
    gone = int(np.all((water > place[0]) & (water < place[1]), axis=1).sum())
    shape = shapes.Box(lower=place[0], upper=place[1])
    scene.add_body(name="rock", shape=shape, material=WOOD, subtract_from=("water",))
    branch = simulate(scene)
    branch.step(5)
    assert branch.displaced == {"water": gone}
    ids = np.concatenate([v["id"] for v in branch.particles.values()])
    assert len(np.unique(ids)) == len(ids)
    assert branch.particles["rock"]["id"].min() == 4 * (288 + 48)


def test_what_does_not_go_through_the_slice_is_named(tmp_path):
    scene = flume(2)
    scene.add_boundary(
        name="pier",
        shape=shapes.Box(lower=(0.6, 0.1, 0.2), upper=(0.7, 0.15, 0.5)),
        response=boundaries.Slip(),
    )
    scene.add_body(
        name="log",
        shape=shapes.Box(lower=(0.4, 0.1, 0.3), upper=(0.55, 0.15, 0.4)),
        material=WOOD,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        trunk = simulate(scene)
    path = saved(trunk, tmp_path)
    with pytest.raises(libmpm.SceneError) as error:
        libmpm.Scene.from_checkpoint(path, tiles=3, axis="y")
    text = str(error.value)
    assert "boundary 'pier': its box spans 0.1 to 0.15 m on axis 1" in text
    assert "body 'log': its box spans 0.1 to 0.15 m on axis 1" in text
    assert "step" not in text
    for tiles, axis, rule in ((2, None, "axis"), (2, "w", "axis"), (0, "y", "tiles is 0")):
        with pytest.raises(libmpm.SceneError, match=rule):
            libmpm.Scene.from_checkpoint(path, tiles=tiles, axis=axis)


def test_a_bed_is_as_wide_as_the_tiles(tmp_path):
    def strip(more=None):
        scene = libmpm.Scene(
            dimension=3, cell_size=DX, lower=(0, 0, -0.2), upper=(2, DX, 0.6), gravity=(0, 0, -9.81)
        )
        profile = [(-1, -0.1), (3, 0.1), (3, -1), (-1, -1)]
        bed = shapes.Extrusion(profile=profile, axis="y", lower=-1.0, upper=DX + 0.01)
        pool = shapes.Box(lower=(0, 0, -0.2), upper=(2, DX, 0.4))
        water = libmpm.materials.TaitFluid(bulk_modulus=1e5)
        scene.add_body(name="water", shape=pool - bed, material=water, hydrostatic=0.4)
        scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
        if more is not None:
            scene.add_boundary(name="more", shape=more, response=boundaries.Slip())
        trunk = simulate(scene, "cpu", "single")
        trunk.step(1)
        return saved(trunk, tmp_path)

    tiled = libmpm.Scene.from_checkpoint(strip(), tiles=4, axis="y")
    branch = simulate(tiled, "cpu", "single")
    branch.run(until=branch.time + 0.3, progress=False)
    # At rest; beside the first tile water fell on the floor of the domain, at 0.55 m/s.
    assert np.abs(np.asarray(branch.particles["water"]["velocity"])).max() < 0.2
    ball = shapes.Sphere(centre=(1.0, 0.5 * DX, 0.5), radius=0.1)
    with pytest.raises(libmpm.SceneError, match=r"boundary 'more': its shape spans .* all of the"):
        libmpm.Scene.from_checkpoint(strip(ball), tiles=4, axis="y")
