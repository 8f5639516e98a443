"""Rules about time steps and speeds that a precision cannot resolve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.checks_bodies import initial_gravity
from libmpm._src.errors import SceneError
from libmpm._src.field import Field
from libmpm._src.parameters import wave_speed
from libmpm._src.timetable import TimeTable

if TYPE_CHECKING:
    from libmpm._src.scene import Scene

__all__ = ["check_intervals", "check_step", "faster_than_water", "too_slow"]

#: Samples that may fall due in one step; each is counted.
_DUE = 1e5


def _least_way(precision: str) -> float:
    """Return the way, cells a step, of which rounding takes a twentieth at most.

    A place is stored as a fraction of a cell, at most 1/2, and rounds by an eighth of the unit of 1
    or less. A steady motion rounds to the same side in step after step.
    """
    return 2.5 * float(np.finfo(np.float32 if precision == "single" else np.float64).eps)


def _step(scene: Scene, fixed: float | None) -> float:
    """Return the time step that waves and viscosity allow, s; 0 if it is not known here."""
    fastest = max((wave_speed(b.material) or 0.0 for b in scene.bodies), default=0.0)
    if fixed or not fastest > 0:
        return fixed or 0.0
    cfl, dx = scene.method.cfl, scene.cell_size
    told = [body.material.parameters() for body in scene.bodies]
    nu = max(max(p.get("viscosity", 0), p.get("largest_viscosity", 0)) / p["density"] for p in told)
    part = min(0.5, max(1 - scene.dimension * cfl**2, 0.1))  # step_limit of src/solver
    return min(cfl * dx / fastest, part * dx**2 / (4 * nu) if nu > 0 else np.inf)


def check_intervals(scene: Scene, fixed: float | None) -> None:
    """Refuse sensors of which too many samples would fall due in one step."""
    step = _step(scene, fixed)
    problems = [
        f"sensor '{s.name}': interval is {s.sensor.interval:g} s, {s.sensor.interval / step:.2g} "
        f"of a time step of {step:.3g} s; expected ≥ {step / _DUE:.3g} s or 0; 0 samples every step"
        for s in scene.sensors
        if 0 < s.sensor.interval * _DUE < step < np.inf
    ]
    if problems:
        raise SceneError(problems)


def too_slow(scene: Scene, fixed: float | None, precision: str) -> list[str]:
    """Return which bodies begin so slowly that rounding changes their speed, where nothing else
    moves them."""
    if isinstance(scene.gravity, TimeTable) or np.any(initial_gravity(scene) != 0):
        return []
    step = _step(scene, fixed)
    doubts = []
    for body in scene.bodies:
        speed = 0.0 if isinstance(body.velocity, Field) else float(np.linalg.norm(body.velocity))
        way = speed * step / scene.cell_size
        if 0 < way < _least_way(precision):
            remedy = "precision='double' or " if precision == "single" else ""
            doubts.append(
                f"body '{body.name}': velocity is {speed:g} m/s, in a step {way:.2g} of a cell; "
                f"{precision} precision resolves {_least_way(precision):.2g}; it will drift off "
                f"or stand still; use {remedy}a lower wave speed"
            )
    return doubts


def faster_than_water(scene: Scene) -> list[str]:
    """Return which solids have waves faster than every fluid of the scene, and what that costs.

    The fastest wave sets the time step of all; a body's stiffness beyond the water's is seldom what
    a scene is about. Source: Yang (2016) 6.2, where debris is chosen slower than water.
    """
    speeds = {b.name: wave_speed(b.material) or 0.0 for b in scene.bodies}
    fluids = {b.name for b in scene.bodies if b.material.table.needs == "volume"}
    water = max((speeds[name] for name in fluids), default=0.0)
    return [
        f"body '{name}': its waves ({speed:.3g} m/s, water {water:.3g}) cost "
        f"{speed / water:.2g} times the steps; "
        f"youngs_modulus × {(water / speed) ** 2:.2g} costs none"
        for name, speed in speeds.items()
        if name not in fluids and 0 < water < speed
    ]


def check_step(scene: Scene, step: float, precision: str) -> None:
    """Refuse a step in which slow material would not move as it should in this precision.

    The speed that must survive is a hundredth of the wave speed, the usual flow.
    """
    resolved = _least_way(precision)
    problems = []
    for body in scene.bodies:
        speed = wave_speed(body.material)
        if speed is None:
            continue
        least = resolved * scene.cell_size / (0.01 * speed)
        if step < least:
            remedy = "; use precision='double'" if precision == "single" else ""
            problems.append(
                f"body '{body.name}': time_step is {step:g} s; at {0.01 * speed:g} m/s a particle "
                f"moves less than {precision} precision resolves; expected ≥ {least:.3g} s{remedy} "
                "or a longer time step"
            )
    if problems:
        raise SceneError(problems)
