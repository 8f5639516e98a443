"""Rules about time steps and speeds that a precision cannot resolve."""

from __future__ import annotations

import itertools
import math
import sys
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import wave_speed
from libmpm._src.scene.places import initial_gravity
from libmpm._src.shapes.solid import Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["check_intervals", "check_step", "duration", "faster_than_flow", "faster_than_water"]
__all__ += ["many_steps", "shorter_than_step", "step_of", "too_slow"]

#: Samples that may fall due in one step; each is counted.
_DUE = 1e5

#: Sound as fast as so many times the flow is enough; more steps than that in parts are named.
_FLOWS, _DEAR = 10.0, 4.0

#: Steps beyond which a run is named before it begins; the longest sensible ones take 1e7.
_MANY = 3e7


def _least_way(precision: str) -> float:
    """Return the way, cells a step, of which rounding takes a twentieth at most.

    A place is stored as a fraction of a cell, at most 1/2, and rounds by an eighth of the unit of 1
    or less. A steady motion rounds to the same side in step after step.
    """
    return 2.5 * float(np.finfo(np.float32 if precision == "single" else np.float64).eps)


def _viscosity(body: Body) -> float:
    """Return the largest kinematic viscosity of a body, m²/s."""
    told = body.material.parameters()
    return float(max(told.get("viscosity", 0), told.get("largest_viscosity", 0)) / told["density"])


def _viscous_step(scene: SceneData, nu: float) -> float:
    """Return the time step that a kinematic viscosity allows, s."""
    part = min(0.5, max(1 - scene.dimension * scene.method.cfl**2, 0.1))  # step_limit of src/solver
    return float(part * scene.cell_size**2 / (4 * nu)) if nu > 0 else np.inf


def _step(scene: SceneData, fixed: float | None) -> float:
    """Return the time step that waves and viscosity allow, s; 0 if it is not known here."""
    fastest = max((wave_speed(b.material) or 0.0 for b in scene.bodies), default=0.0)
    if fixed or not fastest > 0:
        return fixed or 0.0
    viscous = _viscous_step(scene, max(_viscosity(b) for b in scene.bodies))
    return min(scene.method.cfl * scene.cell_size / fastest, viscous)


def step_of(scene: SceneData) -> float:
    """Return the time step that a scene is going to take, s; 0 if it is not known here."""
    return _step(scene, scene.method.time_step)


def check_intervals(scene: SceneData, fixed: float | None) -> None:
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


def too_slow(scene: SceneData, fixed: float | None, precision: str) -> list[str]:
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


def faster_than_water(scene: SceneData) -> list[str]:
    """Return which solids have waves faster than every fluid of the scene, and what that costs.

    The fastest wave sets the time step of all; a body's stiffness beyond the water's is seldom what
    a scene is about. Source: Yang (2016) 6.2, where debris is chosen slower than water.
    """
    speeds = {b.name: wave_speed(b.material) or 0.0 for b in scene.bodies}
    fluids = {b.name for b in scene.bodies if b.material.table.needs == "volume"}
    water = max((speeds[name] for name in fluids), default=0.0)
    return [
        f"body '{name}': its wave speed of {speed:.3g} m/s shortens the time step "
        f"{speed / water:.2g}-fold against water's {water:.3g} m/s; "
        f"youngs_modulus × {(water / speed) ** 2:.2g} would not"
        for name, speed in speeds.items()
        if name not in fluids and 0 < water < speed
    ]


def faster_than_flow(scene: SceneData) -> list[str]:
    """Return which water is much stiffer than its flow needs, and what that costs.

    Ten times the fastest flow keeps the volume within a percent (M² / 2 at M = 0.1). The flow is
    that of a fall through the depth of water, or of a body at the start.
    """
    if scene.grid is not None or scene.method.time_step or isinstance(scene.gravity, TimeTable):
        return []
    pull = np.abs(initial_gravity(scene))
    up = int(np.argmax(pull))
    speeds = {b.name: wave_speed(b.material) or 0.0 for b in scene.bodies}
    water = [
        b for b in scene.bodies if b.material.table.needs == "volume" and isinstance(b.shape, Solid)
    ]
    if not water:
        return []
    stiffest = max(water, key=lambda b: speeds[b.name])
    ends = [end[up] for b in water if isinstance(b.shape, Solid) for end in b.shape.bounds()]
    fall = math.sqrt(2 * float(pull[up]) * (max(ends) - min(ends)))
    flow = max(fall, *(_first_speed(b) for b in scene.bodies))
    speed = speeds[stiffest.name]
    modulus = getattr(stiffest.material, "bulk_modulus", None)
    # Steps that another body, or viscosity, asks for are not the water's.
    if modulus is None or not 0 < flow < math.inf or speed < max(speeds.values()):
        return []
    times = speed / (_FLOWS * flow)
    # Of what hardly moves at all, no modulus is soft enough.
    softer = modulus / max(times, 1.0) / max(times, 1.0)
    if (
        times < _DEAR
        or softer < sys.float_info.min
        or _viscous_step(scene, max(map(_viscosity, scene.bodies)))
        < (scene.method.cfl * scene.cell_size / speed)
    ):
        return []
    return [
        f"body '{stiffest.name}': bulk_modulus is {modulus:.3g} Pa, whose sound of {speed:.4g} m/s "
        f"is {speed / flow:.3g} times the flow expected ({flow:.3g} m/s); {softer:.2g} "
        f"Pa, ten times the flow, takes {times:.2g} times fewer steps; keep it only where the "
        "water's own compression counts"
    ]


def shorter_than_step(scene: SceneData, step: float) -> list[str]:
    """Return which boundaries act for less than a step, which may pass them over."""
    return [
        f"boundary '{b.name}': time is ({b.window[0]:g}, {b.window[1]:g}), {width:.3g} s, with "
        f"steps of {step:.3g} s: it acts in one step or in none; expected ≥ {step:.3g} s; use a "
        "longer time or a smaller cfl"
        for b in scene.boundaries
        if 0 < (width := b.window[1] - b.window[0]) < step
    ]


def many_steps(until: float, step: float, limited_by: str, seconds: float) -> list[str]:
    """Return that a run would take very many steps, with the estimate; nothing if it would not."""
    if not step > 0 or not until / step > _MANY:
        return []
    return [
        f"the time step of {step:.3g} s, limited by {limited_by}, is {step / until:.1g} of the "
        f"{until:g} s to run: {until / step:.2g} steps, about {duration(seconds)}; expected ≤ "
        f"{_MANY:.0g} steps; use softer or less viscous bodies, larger cells, or a shorter run"
    ]


def duration(seconds: float) -> str:
    """Return a time in readable units."""
    for limit, unit, name in ((120, 1, "s"), (7200, 60, "min"), (172800, 3600, "h")):
        if seconds < limit:
            return f"{seconds / unit:.2g} {name}"
    return f"{seconds / 86400:.2g} days" if seconds < 6.3e7 else f"{seconds / 3.156e7:.2g} years"


def check_step(scene: SceneData, fixed: float | None, precision: str) -> None:
    """Refuse a step, given or chosen, in which slow material would not move as it should.

    The speed that must survive is a hundredth of the wave speed, the usual flow; beside a step that
    is chosen also that at the start, if it is larger.
    """
    step = _step(scene, fixed)
    if not 0 < step < np.inf:
        return
    resolved = _least_way(precision)
    cause = "time_step is" if fixed else f"{_chosen_by(scene)}; the time step of all would be"
    problems = []
    for body in scene.bodies:
        speed = wave_speed(body.material)
        if speed is None:
            continue
        usual = 0.01 * speed if fixed else max(0.01 * speed, _first_speed(body))
        least = resolved * scene.cell_size / usual
        if step < least:
            remedy = "use precision='double' or " if precision == "single" else ""
            other = "softer or less viscous bodies, a larger cfl"
            remedy += "a longer time step" if fixed else other
            problems.append(
                f"body '{body.name}': {cause} {step:.3g} s; at {usual:.3g} m/s a particle "
                f"moves less than {precision} precision resolves and would stand still; expected "
                f"≥ {least:.3g} s; {remedy}"
            )
    if problems:
        raise SceneError(problems)


def _first_speed(body: Body) -> float:
    """Return the speed of a body at the start, m/s; of a field that at the corners of its box."""
    if not isinstance(body.velocity, Field):
        return math.hypot(*body.velocity)
    if not isinstance(body.shape, Solid):
        return 0.0
    corners = list(itertools.product(*zip(*body.shape.bounds(), strict=True)))
    try:
        return max(math.hypot(*v) for v in body.velocity.at(corners).tolist())
    except SceneError:  # a field need not exist outside of the body
        return 0.0


def _chosen_by(scene: SceneData) -> str:
    """Return what limits the step that the plan chooses, in words."""
    waves = {b.name: wave_speed(b.material) or 0.0 for b in scene.bodies}
    fastest = max(waves, key=lambda name: waves[name])
    viscous = {b.name: _viscosity(b) for b in scene.bodies}
    thickest = max(viscous, key=lambda name: viscous[name])
    cfl, dx = scene.method.cfl, scene.cell_size
    if _viscous_step(scene, viscous[thickest]) < cfl * dx / waves[fastest]:
        nu = viscous[thickest]
        return f"body '{thickest}' has a viscosity of {nu:.3g} m²/s"
    return f"body '{fastest}' has waves of {waves[fastest]:.3g} m/s, and cfl is {cfl:g}"
