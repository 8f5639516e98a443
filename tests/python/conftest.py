"""Scenes that several tests describe."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes


def pytest_addoption(parser: pytest.Parser) -> None:
    """Let more inputs be tried than in CI: `test_fuzz.py`, `test_random_scenes.py`."""
    group = parser.getgroup("fuzz", "random and broken scenes")
    group.addoption("--fuzz", type=int, default=500, help="broken inputs, of all kinds together")
    group.addoption("--fuzz-seed", type=int, default=0, help="what they are made from")
    group.addoption("--scenes", type=int, default=60, help="random scenes")


def make_scene(**changes: Any) -> libmpm.Scene:
    """Return a small valid 3D scene with one of everything."""
    base = (0.0, 0.0, 0.0)
    arguments: dict[str, Any] = {
        "dimension": 3,
        "cell_size": 0.1,
        "lower": base,
        "upper": (3.2, 0.8, 1.0),
        "gravity": (0.0, 0.0, -9.81),
        "name": "small surge",
    }
    arguments.update(changes)
    scene = libmpm.Scene(**arguments)
    low = scene.lower

    def at(*point: float) -> tuple[float, ...]:
        return tuple(a + b for a, b in zip(low, point, strict=True))

    scene.add_body(
        name="water",
        shape=shapes.Box(lower=at(0, 0, 0), upper=at(1.2, 0.8, 0.4)),
        material=materials.TaitFluid(bulk_modulus=1.6e6),
        hydrostatic=low[2] + 0.4,
    )
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=at(0.5, 0.3, 0.25), upper=at(0.8, 0.5, 0.45)),
        material=materials.FixedCorotated(density=600.0, youngs_modulus=1e6),
        velocity=(0.5, 0.0, 0.0),
        subtract_from=("water",),
    )
    scene.add_boundary(
        name="walls",
        shape=shapes.DomainWalls(),
        response={
            "x-": boundaries.Slip(),
            "x+": boundaries.Slip(),
            "y-": boundaries.Slip(),
            "y+": boundaries.Slip(),
            "z-": boundaries.Sticky(),
            "z+": boundaries.Separable(),
        },
    )
    scene.add_boundary(
        name="pier",
        shape=shapes.Box(lower=at(2.0, 0.2, 0.0), upper=at(2.4, 0.6, 0.8)),
        response=boundaries.Separable(static_friction=0.3, dynamic_friction=0.2),
        motion=libmpm.TimeTable([0.0, 1.0], [[0.0] * 3, [0.1, 0.0, 0.0]]),
        time=(0.0, 2.0),
    )
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", faces=("x-",)))
    scene.add_sensor(name="gauge", sensor=sensors.WaveGauge(position=at(1.5, 0.4, 0)[:2]))
    scene.add_sensor(name="probe", sensor=sensors.VelocityProbe(position=at(1.5, 0.4, 0.1)))
    scene.add_sensor(name="track", sensor=sensors.ParticleTracker(body="water", ids=(3, 1)))
    scene.add_sensor(name="energy", sensor=sensors.Energy(body="block", interval=0.01))
    return scene


@pytest.fixture
def scene() -> libmpm.Scene:
    """A small valid 3D scene with one of everything."""
    return make_scene()


@pytest.fixture
def new_scene() -> Callable[..., libmpm.Scene]:
    """The function behind `scene`; keywords replace arguments of `Scene`."""
    return make_scene


@pytest.fixture
def tank() -> Callable[..., libmpm.Scene]:
    """A function that returns an empty 2D scene, 1 m × 1 m, cells of 0.1 m."""

    def make(**changes: Any) -> libmpm.Scene:
        arguments: dict[str, Any] = {
            "dimension": 2,
            "cell_size": 0.1,
            "lower": (0.0, 0.0),
            "upper": (1.0, 1.0),
            "gravity": (0.0, -9.81),
        }
        return libmpm.Scene(**(arguments | changes))

    return make


@pytest.fixture
def counted(monkeypatch):
    """The folders of the cases of studies that were really run, in order."""
    from libmpm._src.studies.study import worker

    names = []
    real = worker._Attempt.run

    def counting(attempt):
        names.append(attempt._folder.name)
        return real(attempt)

    monkeypatch.setattr(worker._Attempt, "run", counting)
    return names
