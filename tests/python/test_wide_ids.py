"""Ids beyond 2^32: stored as 32 bits from a body's first, read as 64."""

from __future__ import annotations

import numpy as np
import pytest

from support import scenes
from support.devices import device  # noqa: F401 (a fixture)

FIRST = 2**32 - 40


def test_ids_across_2_to_the_32(device: str) -> None:  # noqa: F811
    scene = scenes.free_body(3, velocity=(0.3, 0.2, 0.1))
    near, far = (scenes.specification(scene, precision="single") | {"device": 0} for _ in range(2))
    far["bodies"][0]["first_id"] = FIRST
    machines = [scenes.engine(spec, device) for spec in (near, far)]
    for machine in machines:
        scenes.advance(machine, 200)
    count = near["bodies"][0]["count"]
    assert FIRST + count > 2**32
    low, high = (machine.attribute(0, "id") for machine in machines)
    assert high.dtype == np.uint64
    np.testing.assert_array_equal(np.sort(high), np.arange(FIRST, FIRST + count, dtype=np.uint64))
    # Nothing but the number differs, the order of storage included.
    np.testing.assert_array_equal(high - np.uint64(FIRST), low)
    np.testing.assert_array_equal(
        machines[1].attribute(0, "position"), machines[0].attribute(0, "position")
    )
    again = scenes.engine(far, device)
    again.load(machines[1].save())
    np.testing.assert_array_equal(again.attribute(0, "id"), high)


def test_a_tracker_follows_an_id_beyond_2_to_the_32(device: str) -> None:  # noqa: F811
    scene = scenes.free_body(2, velocity=(0.5, 0.0))
    spec = scenes.specification(scene, precision="double")
    body = spec["bodies"][0]
    body["first_id"] = FIRST
    wanted = FIRST + body["count"] - 1
    spec["sensors"] = [
        {"name": "one", "kind": "tracker", "interval": 0.0, "body": 0,
         "ids": np.array([wanted], dtype=np.uint64)},
    ]  # fmt: skip
    machine = scenes.engine(spec, device)
    scenes.advance(machine, 50)
    _, values = machine.drain()[0]
    row = int(np.flatnonzero(machine.attribute(0, "id") == wanted)[0])
    assert values[-1][:2] == pytest.approx(machine.attribute(0, "position")[row], abs=1e-12)
    assert values[-1][2:] == pytest.approx(machine.attribute(0, "velocity")[row], abs=1e-12)
