"""From scene to engine specification."""

from __future__ import annotations

import math
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import FBar, Scene, TimeTable, boundaries, materials, sensors, shapes
from libmpm._src.run.engine_spec import lower, world_offset
from support.scenes import with_arrays

Make = Callable[..., Scene]


def same(a: Any, b: Any) -> bool:
    """Compare nested dictionaries, lists and arrays bit for bit."""
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    return bool(a == b)


def test_head(scene: Scene) -> None:
    spec = lower(scene, precision="double", pipeline="fused", device_index=2, threads=3)
    assert spec["dimension"] == 3
    assert spec["precision"] == "double"
    assert spec["pipeline"] == "fused"
    assert (spec["device"], spec["threads"]) == (2, 3)
    assert spec["cells"] == [32, 8, 10]
    assert (spec["cell_size"], spec["cfl"], spec["leaving"]) == (0.1, 0.4, "stop")
    assert spec["time_step"] is None
    np.testing.assert_array_equal(spec["gravity"]["value"], [[0, 0, -9.81]])
    assert spec["gravity"]["end"] == "hold"
    assert set(spec) == {
        *("dimension", "precision", "device", "pipeline", "threads", "shared_device"),
        *(
            "cell_size",
            "cells",
            "gravity",
            "cfl",
            "time_step",
            "leaving",
            "transfer",
            "kernel",
            "bodies",
            "boundaries",
            "sensors",
        ),
    }


def test_bodies(scene: Scene) -> None:
    water, block = with_arrays(lower(scene))["bodies"]
    # The block takes 6 × 4 × 3 points (0.3 × 0.2 × 0.15 m, spacing 0.05 m) from the water.
    assert water["count"] == 24 * 16 * 8 - 6 * 4 * 3
    assert water["position"].shape == (water["count"], 3)
    assert water["position"].dtype == np.float64
    assert water["position"].flags.c_contiguous
    assert water["particle_mass"] == pytest.approx(1000 * 0.05**3)
    assert (water["first_id"], block["first_id"]) == (0, water["count"])
    assert block["particle_mass"] * block["count"] == pytest.approx(600 * 0.3 * 0.2 * 0.2)
    np.testing.assert_allclose(block["bounds"], [[0.5, 0.3, 0.25], [0.8, 0.5, 0.45]])
    np.testing.assert_array_equal(block["velocity"], [0.5, 0, 0])
    assert water["material"] == "TaitFluid"
    assert water["parameters"] == {
        "density": 1000.0,
        "bulk_modulus": 1.6e6,
        "exponent": 7.15,
        "viscosity": 0.001,
    }
    assert block["fbar"] == {"form": "none", "time": 0.0, "ratio": 0.0}
    assert block["pressure"] is None


@pytest.mark.parametrize("per_cell", [1, 4, 5, 8, 9, 27, 64])
@pytest.mark.parametrize("width", [0.2, 0.33, 0.5])
def test_total_mass_is_exact(tank: Make, per_cell: int, width: float) -> None:
    scene = tank()
    scene.add_body(
        name="w",
        shape=shapes.Box(lower=(0.1, 0.1), upper=(0.1 + width, 0.4)),
        material=materials.TaitFluid(),
        particles_per_cell=per_cell,
    )
    (body,) = lower(scene)["bodies"]
    assert body["particle_mass"] * body["count"] == pytest.approx(1000 * width * 0.3, rel=1e-14)


def test_origin_changes_no_bit(new_scene: Make) -> None:
    near = new_scene()
    far = new_scene(origin=(1e4, -1e4, 1e4))
    assert same(with_arrays(lower(near)), with_arrays(lower(far)))
    np.testing.assert_array_equal(world_offset(far), [1e4, -1e4, 1e4])


def test_absolute_coordinates_agree_closely(new_scene: Make) -> None:
    near = with_arrays(lower(new_scene()))
    base = (1e4, 1e4, 1e4)
    far = new_scene(lower=base, upper=(1e4 + 3.2, 1e4 + 0.8, 1e4 + 1.0))
    spec = with_arrays(lower(far))
    np.testing.assert_array_equal(world_offset(far), base)
    for a, b in zip(near["bodies"], spec["bodies"], strict=True):
        assert a["count"] == b["count"]
        np.testing.assert_allclose(a["position"], b["position"], atol=1e-11)
    np.testing.assert_allclose(
        near["bodies"][0]["pressure"], spec["bodies"][0]["pressure"], atol=1e-6
    )
    assert near["boundaries"][1]["lower"] == spec["boundaries"][1]["lower"]
    np.testing.assert_allclose(near["sensors"][1]["position"], spec["sensors"][1]["position"])


def test_hydrostatic_pressure(scene: Scene) -> None:
    water = with_arrays(lower(scene))["bodies"][0]
    z = water["position"][:, 2]
    np.testing.assert_allclose(water["pressure"], 1000 * 9.81 * (0.4 - z), rtol=1e-12)


def test_hydrostatic_above_level_and_slanted(tank: Make) -> None:
    scene = tank(gravity=(3.0, -4.0))
    scene.add_body(
        name="w",
        shape=shapes.Box(lower=(0, 0), upper=(1, 1)),
        material=materials.TaitFluid(density=2.0),
        hydrostatic=0.1,
    )
    (body,) = with_arrays(lower(scene))["bodies"]
    height = body["position"] @ np.array([-0.6, 0.8])
    np.testing.assert_allclose(body["pressure"], 10.0 * np.maximum(0.1 - height, 0), atol=1e-12)
    assert body["pressure"].min() == 0.0


@pytest.mark.parametrize("gravity", [(0.0, 0.0, -9.81), (1.1, -2.2, -9.3)])
def test_rows_do_not_depend_on_the_piece(new_scene: Make, gravity: tuple[float, ...]) -> None:
    """Positions and pressures, in pieces of any size, are those of the whole to the bit."""
    water = lower(new_scene(gravity=gravity))["bodies"][0]
    n = water["count"]
    for name in ("position", "pressure"):
        rows = water[name]
        whole = rows(0, n)
        assert len(whole) == n
        for size in (1, 5, 128, 1000):
            pieces = [rows(k, min(k + size, n)) for k in range(0, n, size)]
            assert same(np.concatenate(pieces), whole)
        assert rows(7, 7).shape == (0, *whole.shape[1:])


def test_two_billion_particles() -> None:
    """Lowering allocates nothing of the particles' size, nor do the rows that are asked for."""
    low, high = (0.0, 0.0, 0.0), (63.0, 63.0, 63.0)
    scene = Scene(dimension=3, cell_size=0.1, lower=low, upper=high, gravity=(0, 0, -9.81))
    fluid = materials.TaitFluid()
    solid = materials.FixedCorotated(density=600.0, youngs_modulus=1e6)
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=high), material=fluid, hydrostatic=63.0
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(1, 1, 50), upper=(3, 3, 52)),
        material=solid,
        subtract_from=("water",),
    )
    tracemalloc.start()
    water = lower(scene)["bodies"][0]
    n = water["count"]
    assert n == 1260**3 - 40**3
    pressure = water["pressure"](n - 1000, n)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_allclose(pressure[[0, -1]], 9810.0 * np.array([49.975, 0.025]), rtol=1e-9)
    assert peak < 1e6


def test_without_particles(scene: Scene) -> None:
    full, light = lower(scene), lower(scene, with_particles=False)
    for a, b in zip(full["bodies"], light["bodies"], strict=True):
        assert b["position"] is None
        assert b["pressure"] is None
        assert a["count"] == b["count"]
        assert a["first_id"] == b["first_id"]


def fbar_of(tank: Make, fbar: Any) -> dict[str, Any]:
    scene = tank()
    scene.add_body(
        name="w",
        shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)),
        material=materials.TaitFluid(bulk_modulus=1e5),
        fbar=fbar,
    )
    result: dict[str, Any] = lower(scene)["bodies"][0]["fbar"]
    return result


def test_fbar(tank: Make) -> None:
    crossings = pytest.approx(35 * 0.1 / 10.0)
    still = {"shifting": False, "density": False}
    default = {"form": "one-volume-gradient", "time": crossings, "ratio": 0.0} | still
    assert fbar_of(tank, "default") == default
    assert fbar_of(tank, FBar()) == default
    assert fbar_of(tank, None) == {"form": "none", "time": 0.0, "ratio": 0.0}
    assert fbar_of(tank, FBar(form="one-volume", time=0.2))["time"] == 0.2
    ratio = fbar_of(tank, FBar(form="stress-only", ratio=0.9))
    assert ratio == {"form": "stress-only", "time": 0.0, "ratio": 0.9} | still
    two = fbar_of(tank, FBar(form="two-volume", length=0.05))
    assert two == {"form": "two-volume", "time": 0.0, "ratio": pytest.approx(0.5)} | still
    assert fbar_of(tank, FBar(shifting=True)) == default | {"shifting": True}
    assert fbar_of(tank, FBar(density=True)) == default | {"density": True}


def test_boundaries(scene: Scene) -> None:
    walls, pier = lower(scene)["boundaries"]
    assert walls["kind"] == "domain"
    assert list(walls["faces"]) == ["x-", "x+", "y-", "y+", "z-", "z+"]
    assert walls["faces"]["z-"]["kind"] == "sticky"
    assert walls["velocity"] is None
    assert (walls["start"], walls["end"]) == (0.0, math.inf)
    assert pier["kind"] == "box"
    assert (pier["lower"], pier["upper"]) == ([20, 2, 0], [24, 6, 8])
    assert pier["faces"]["y+"] == {
        "kind": "separable",
        "static_friction": 0.3,
        "dynamic_friction": 0.2,
        "linear": False,
        "cautious": True,
    }
    assert (pier["start"], pier["end"]) == (0.0, 2.0)
    assert pier["velocity"]["value"].shape == (2, 3)


def test_box_far_beyond_the_domain(tank: Make) -> None:
    scene = tank()
    scene.add_body(
        name="w",
        shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
        material=materials.TaitFluid(),
    )
    scene.add_boundary(
        name="b",
        shape=shapes.Box(lower=(0.6, -1e12), upper=(1e12, 1.0)),
        response=boundaries.Slip(),
    )
    (box,) = lower(scene)["boundaries"]
    assert (box["lower"], box["upper"]) == ([6, -64], [74, 10])


def test_sensors(scene: Scene) -> None:
    load, gauge, probe, track, energy = lower(scene)["sensors"]
    assert (load["kind"], load["boundary"], load["faces"]) == ("load-cell", 1, ["x-"])
    np.testing.assert_allclose(load["reference"], [2.2, 0.4, 0.4])
    assert (gauge["kind"], gauge["axis"], gauge["body"]) == ("wave-gauge", 2, -1)
    np.testing.assert_allclose(gauge["position"], [1.5, 0.4, 0.0])
    np.testing.assert_allclose(probe["position"], [1.5, 0.4, 0.1])
    assert track["ids"].dtype == np.uint64
    assert track["ids"].tolist() == [3, 1]
    assert (energy["kind"], energy["body"], energy["interval"]) == ("energy", 1, 0.01)


def test_tracking_everything(scene: Scene) -> None:
    scene.add_sensor(name="all", sensor=sensors.ParticleTracker(body="block", ids="all"))
    spec = lower(scene, with_particles=False)
    block = spec["bodies"][1]
    ids = spec["sensors"][-1]["ids"]
    assert ids[0] == block["first_id"]
    assert len(ids) == block["count"]


def test_gauge_follows_gravity(tank: Make) -> None:
    scene = tank(gravity=(-9.81, 0.0))
    scene.add_body(
        name="w",
        shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.5)),
        material=materials.TaitFluid(),
    )
    scene.add_sensor(name="g", sensor=sensors.WaveGauge(position=(0.3,)))
    (gauge,) = lower(scene)["sensors"]
    assert gauge["axis"] == 0
    np.testing.assert_array_equal(gauge["position"], [0.0, 0.3])


def test_gravity_table(new_scene: Make) -> None:
    table = TimeTable([0.0, 2.0], [[0.0, 0.0, -9.81], [0.0, 0.0, -1.0]], "zero")
    spec = lower(new_scene(gravity=table))
    assert spec["gravity"]["end"] == "zero"
    assert spec["gravity"]["time"].tolist() == [0.0, 2.0]


def test_time_step(new_scene: Make) -> None:
    scene = new_scene(method=libmpm.Method(time_step=2e-4))
    assert lower(scene)["time_step"] == 2e-4
    assert lower(scene, time_step=1e-4)["time_step"] == 1e-4
    with pytest.raises(libmpm.SceneError, match="moves less than single precision resolves"):
        lower(scene, time_step=1e-9)
    assert lower(scene, time_step=1e-9, precision="double")["time_step"] == 1e-9


def test_options(scene: Scene) -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        lower(scene, precision="half", pipeline="split", time_step=-1.0, threads=-1)
    assert len(caught.value.problems) == 4
    assert "precision is 'half'" in caught.value.problems[0]
    with pytest.raises(libmpm.SceneError, match="did you mean 'double'"):
        lower(scene, precision="duble")


def test_invalid_scene_is_refused(tank: Make) -> None:
    with pytest.raises(libmpm.SceneError, match="no body"):
        lower(tank())
