"""Particles that cross the seam in pieces, from functions, and what the engine says of wrong ones.

Expected duration: 2 s.
"""
# ruff: noqa: F811  the fixture `device` is imported

import sys

import numpy as np
import pytest

import libmpm
from libmpm._src.run.engine_spec import lower
from support import scenes
from support.devices import device  # noqa: F401


def tank():
    return scenes.tank(cells=(12, 8), cell_size=0.1, modulus=1e6, at_rest=True)


@pytest.mark.parametrize("make", [tank, lambda: scenes.crowded(2), lambda: scenes.crowded(3)])
def test_functions_and_arrays_give_the_same_bits(make, device):
    states = []
    for spec in (lower(make(), threads=1), scenes.with_arrays(lower(make(), threads=1))):
        machine = scenes.engine(spec, device)
        scenes.advance(machine, 5)
        states.append(machine.save())
    one, two = states
    assert one.keys() == two.keys()
    for name, value in one.items():
        np.testing.assert_array_equal(value, two[name], err_msg=name)


def test_arrays_of_any_layout(device):
    spec = scenes.specification(tank())
    expected = scenes.by_id(scenes.engine(spec, device), 0, "position")
    body = spec["bodies"][0]
    for other in (np.asfortranarray, lambda a: np.repeat(a, 2, axis=0)[::2], np.ndarray.tolist):
        changed = {name: other(body[name]) for name in ("position", "pressure")}
        machine = scenes.engine(spec | {"bodies": [body | changed]}, device)
        np.testing.assert_array_equal(scenes.by_id(machine, 0, "position"), expected)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("position", lambda rows: rows(0, 383), r"position has the shape \(383, 2\)"),
        ("position", lambda rows: rows(0, 384).ravel(), r".*expected the shape \(384, 2\)"),
        ("pressure", lambda rows: rows(0, 1), r"pressure has the shape \(1,\).*\(384,\)"),
        ("position", lambda rows: "text", "position is no array of numbers but of .*str"),
        ("position", lambda rows: lambda a, b: rows(a, b)[:, :1], r"position\(\d+, \d+\) has the"),
        ("pressure", lambda rows: lambda a, b: rows(a, b)[1:], r"pressure\(\d+, \d+\) has the"),
        ("pressure", lambda rows: lambda a, b: {}, r"pressure\(\d+, \d+\) is no array of numbers"),
    ],
)
def test_wrong_shapes_are_refused(name, change, message, device):
    spec = lower(tank())
    body = spec["bodies"][0]
    assert body["count"] == 384
    body[name] = change(body[name])
    with pytest.raises(libmpm.SceneError, match=f"body 'water': {message}"):
        scenes.engine(spec, device)


@pytest.mark.parametrize("kind", [ZeroDivisionError, KeyboardInterrupt])
@pytest.mark.parametrize("name", ["position", "pressure"])
def test_what_a_function_raises_arrives_as_itself(name, kind, device):
    def fail(first, last):
        raise kind("mine")

    spec = lower(tank())
    spec["bodies"][0][name] = fail
    with pytest.raises(kind, match="mine"):
        scenes.engine(spec, device)


def test_nothing_is_kept_after_construction(device):
    """Neither the array nor the function lives as long as the engine."""
    spec = scenes.specification(tank())
    body = spec["bodies"][0]
    array = body["position"]
    pressure = body["pressure"].copy()

    def rows(first, last):
        return pressure[first:last]

    body["pressure"] = rows
    before = sys.getrefcount(array), sys.getrefcount(rows)
    machine = scenes.engine(spec, device)
    assert (sys.getrefcount(array), sys.getrefcount(rows)) == before
    assert machine.particle_count(0) == body["count"]
