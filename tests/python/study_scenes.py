"""Scenes, responses and whole scripts that the tests of studies share."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import libmpm
from libmpm import materials, sensors, shapes

#: Steps of `block` until its default end.
UNTIL, DENSITY, SIDE = 0.01, 1000.0, 0.2


def block(gravity=10.0, velocity=0.0, interval=0.0, name="block"):
    """A block of 16 particles that falls freely for 0.3 s and more."""
    scene = libmpm.Scene(
        dimension=2,
        cell_size=0.1,
        lower=(0, 0),
        upper=(1, 2),
        gravity=(0, -gravity),
        name=name,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(0.4, 1.4), upper=(0.4 + SIDE, 1.4 + SIDE)),
        material=materials.FixedCorotated(density=DENSITY, youngs_modulus=1e6),
        velocity=(velocity, 0.0),
    )
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=libmpm.boundaries.Slip())
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=interval))
    return scene


def long_block(number=0):
    """A block that falls and rests for as long as a test wants, sampled now and then."""
    return block(gravity=1.0, interval=1.0, velocity=0.001 * number)


#: End of `long_block`, s, at which half a second or more of wall time has gone by.
LONG = 100.0


def kinetic(case):
    """The last kinetic energy, J/m, and the time, s, of its velocity: that of the coming step."""
    energy = case.sensors["energy"]
    return {"kinetic": energy.values[-1, 0], "end": 2 * energy.time[-1] - energy.time[-2]}


def fallen(row):
    """The kinetic energy, J/m, of a block in free fall at a time, s."""
    mass = DENSITY * SIDE**2
    return 0.5 * mass * (row["gravity"] * row["end"]) ** 2


def status(folder):
    """The content of a ``status.json``; empty while there is none."""
    try:
        return json.loads((folder / "status.json").read_text())
    except (OSError, ValueError):
        return {}


def wait_for(condition, seconds=30.0):
    """Return what `condition` returns once it is true."""
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        if found := condition():
            return found
        time.sleep(0.01)
    raise AssertionError("waited in vain")


def running(folder, number=1):
    """Return the statuses of `number` cases that run at this moment, or nothing."""
    found = [status(path) for path in (folder / "cases").glob("*")]
    found = [s for s in found if s.get("status") == "running"]
    return found if len(found) >= number else []


def start(script, *arguments, before=(sys.executable,)):
    """Start a Python script in a process of its own, with the paths of this one."""
    return subprocess.Popen(
        [*map(str, before), str(script), *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(child, seconds=60):
    """Return exit code, output and errors of a started script."""
    out, err = child.communicate(timeout=seconds)
    return child.returncode, out, err
