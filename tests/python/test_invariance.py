"""What may not matter does not: order, place, orientation, origin, and how a run is split.

Expected duration: 10 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

import libmpm
from support import scenes
from support.devices import device  # noqa: F401

TOLERANCE = {"single": 2e-4, "double": 1e-11}
STEPS = 60
PRECISIONS = pytest.mark.parametrize("precision", ["single", "double"])


def result(spec, device, steps=STEPS):
    """Positions and velocities of all bodies by id, relative to the scene's corner."""
    machine = scenes.engine(spec, device)
    scenes.advance(machine, steps)
    bodies = range(len(spec["bodies"]))
    return [
        (scenes.by_id(machine, k, "position"), scenes.by_id(machine, k, "velocity")) for k in bodies
    ]


def close(found, expected, tolerance, cell_size=0.1):
    for (x, v), (y, w) in zip(found, expected, strict=True):
        assert np.abs(x - y).max() < tolerance * cell_size
        assert np.abs(v - w).max() < tolerance * np.abs(w).max()


@PRECISIONS
@pytest.mark.parametrize("dimension", [2, 3])
def test_permutation(dimension, precision, device):
    """The order in which particles are given changes sums by rounding only."""
    spec = scenes.specification(scenes.crowded(dimension), precision=precision)
    expected = result(spec, device)
    random = np.random.default_rng(5)
    orders = []
    for body in spec["bodies"]:
        order = random.permutation(body["count"])
        orders.append(order)
        body["position"] = body["position"][order]
        if body["pressure"] is not None:
            body["pressure"] = body["pressure"][order]
    expected = [(x[o], v[o]) for (x, v), o in zip(expected, orders, strict=True)]
    close(result(spec, device), expected, TOLERANCE[precision])


@PRECISIONS
def test_translation_by_whole_cells(precision, device):
    """Three cells to the right, two down, in an empty domain, blocks cut elsewhere."""
    spec = scenes.specification(
        scenes.free_body(2, velocity=(0.7, 0.4), gravity=2.0), precision=precision
    )
    expected = result(spec, device)
    shift = np.array([3, -2]) * spec["cell_size"]
    for body in spec["bodies"]:
        body["position"] = body["position"] + shift
        body["bounds"] = body["bounds"] + shift
    close(result(spec, device), [(x + shift, v) for x, v in expected], TOLERANCE[precision])


def quarter_turn(spec):
    """The specification turned by 90 degrees to the left: (x, y) -> (width - y, x)."""
    n = spec["cells"]
    assert n[0] == n[1]
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    offset = np.array([n[1] * spec["cell_size"], 0.0])
    spec["gravity"]["value"] = spec["gravity"]["value"] @ turn.T
    for body in spec["bodies"]:
        body["position"] = body["position"] @ turn.T + offset
        body["velocity"] = body["velocity"] @ turn.T
        corners = body["bounds"] @ turn.T + offset
        body["bounds"] = np.array([corners.min(axis=0), corners.max(axis=0)])
    for boundary in spec["boundaries"]:
        assert len({repr(r) for r in boundary["faces"].values()}) == 1
        if boundary["kind"] == "box":
            low, high = boundary["lower"], boundary["upper"]
            boundary["lower"] = [n[1] - high[1], low[0]]
            boundary["upper"] = [n[1] - low[1], high[0]]
    spec["sensors"] = []
    return turn, offset


@PRECISIONS
def test_quarter_turn(precision, device):
    """Bodies, walls, box and gravity turned together give the turned result.

    Without friction: where two faces act on a node, friction depends on their order, and that
    order does not turn.
    """
    spec = scenes.specification(scenes.crowded(2), precision=precision)
    for boundary in spec["boundaries"]:
        for response in boundary["faces"].values():
            response |= {"static_friction": 0.0, "dynamic_friction": 0.0}
    expected = result(spec, device)
    turn, offset = quarter_turn(spec)
    expected = [(x @ turn.T + offset, v @ turn.T) for x, v in expected]
    close(result(spec, device), expected, TOLERANCE[precision])


@PRECISIONS
def test_origin_moved_ten_kilometres(precision, device):
    """The origin enters output only: relative to it the bits are the same."""
    found = []
    for origin in ((0.0, 0.0), (1e4, -1e4)):
        scene = scenes.bar(1000.0, cell_size=0.05, origin=origin)
        sim = libmpm.Simulation(scene, device=device, precision=precision, threads=1)
        sim.step(100)
        body = sim.particles["bar"].read(["position", "velocity", "deformation_gradient"])
        found.append((sim.time, body))
    (time, near), (other, far) = found
    assert time == other
    np.testing.assert_array_equal(far["velocity"], near["velocity"])
    np.testing.assert_array_equal(far["deformation_gradient"], near["deformation_gradient"])
    np.testing.assert_array_equal(far["position"], near["position"] + np.array([1e4, -1e4]))


def test_looking_and_splitting_change_no_bit(device):
    """One run of 60 steps, and the same in pieces with every reader called in between."""
    found = []
    for pieces in ((60,), (1, 7, 22, 30)):
        sim = libmpm.Simulation(scenes.crowded(2), device=device, precision="single", threads=1)
        for steps in pieces:
            sim.step(steps)
            if len(pieces) > 1:
                sim.particles["water"].read(["position", "velocity", "pressure"])
                assert len(sim.grid["mass"]) == len(sim.grid["velocity"])
                assert len(sim.sensors["walls"].time)
        found.append(sim.particles["water"].read(["position", "volume_ratio"]))
    for name, values in found[0].items():
        np.testing.assert_array_equal(found[1][name], values)
