"""Rules about sizes: what the engine can number, what its number types can hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable, largest
from libmpm._src.base.values import Checker, shown
from libmpm._src.boundaries.distance_field import motion_of
from libmpm._src.boundaries.responses import Mirror, Prescribed, Response
from libmpm._src.shapes.boxes import DomainWalls, Solid
from libmpm._src.shapes.filling import BOXES, body_lattice

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["block_edge", "check_numbers", "check_range", "check_sweeps"]

#: Cells are numbered with 32 bits along each axis; what boundaries reach beyond is taken off.
_MOST_CELLS = 2**31 - 1024

#: Blocks of the grid are numbered with 64 bits, a rim of two around the domain included.
_MOST_BLOCKS = 2**63
_EDGE = {2: 8, 3: 4}
_RIM = 2

#: Particles of a body are numbered with 32 bits, from its first.
_MOST_PARTICLES = 2**32 - 257

#: Part of a cell that the coordinates of a scene must resolve.
_RESOLVED = 1e-3

#: (least, largest) size of what goes into products and quotients in each number type: a node's
#: mass may be 1e-10 of a particle's (1e-18 in double) and must still have all its digits.
_HELD = {"single": (1e-24, 1e30), "mixed": (1e-24, 1e30), "double": (1e-250, 1e250)}


def check_range(scene: SceneData, problems: list[str], doubts: list[str]) -> bool:
    """Refuse domains and bodies beyond what can be numbered; returns whether all can be."""
    if scene.grid is not None:
        return True
    before = len(problems)
    _check_cells(scene, problems)
    _check_coordinates(scene, problems)
    for body in scene.bodies:
        if not isinstance(body.shape, BOXES) or body.shape.dimension != scene.dimension:
            continue
        if body.lattice is not None and len(body.lattice) != scene.dimension:
            continue
        count = body_lattice(scene, body).count
        if count > _MOST_PARTICLES:
            problems.append(
                f"body '{body.name}': {shown(count, 20)} particles; "
                f"expected ≤ {_MOST_PARTICLES} in one body; "
                "split it into several bodies"
            )
    _check_narrow(scene, doubts)
    return len(problems) == before


def block_edge(dimension: int) -> int:
    """Return the cells along an edge of a block of the grid, of 64 cells in all."""
    return _EDGE[dimension]


def _check_cells(scene: SceneData, problems: list[str]) -> None:
    for a, n in enumerate(scene.cells):
        if n > _MOST_CELLS:
            problems.append(
                f"Scene: the domain has {n} cells on axis {a}; expected ≤ {_MOST_CELLS}, which 32 "
                "bits can number; use a larger cell_size or a smaller domain"
            )
    edge = _EDGE[scene.dimension]
    blocks = math.prod(float(-(-n // edge) + 2 * _RIM) for n in scene.cells)
    if blocks >= _MOST_BLOCKS:
        problems.append(
            f"Scene: the domain has {math.prod(map(float, scene.cells)):.3g} cells in "
            f"{blocks:.3g} blocks; expected < {_MOST_BLOCKS:.3g} blocks of {edge} cells an edge, "
            "which 64 bits can number; use a larger cell_size or a smaller domain"
        )


def _check_coordinates(scene: SceneData, problems: list[str]) -> None:
    """Refuse coordinates so large that their last digit is a noticeable part of a cell."""
    for a, (low, high, zero) in enumerate(zip(scene.lower, scene.upper, scene.origin, strict=True)):
        own = max(abs(low), abs(high))
        for what, size, remedy in (
            ("coordinates", own, "state them relative to Scene(origin=...)"),
            ("world positions", own + abs(zero), "use an origin nearer to the scene"),
        ):
            unit = float(np.spacing(size))
            if not unit <= _RESOLVED * scene.cell_size:
                problems.append(
                    f"Scene: {what} of {size:g} m on axis {a} are resolved to {unit:.3g} m, "
                    f"{unit / scene.cell_size:.3g} of a cell; expected ≤ {_RESOLVED:g} of a cell; "
                    f"{remedy}, or a larger cell_size"
                )
                break


def _check_narrow(scene: SceneData, doubts: list[str]) -> None:
    """Say where every node of an axis lies beside a wall, and something would move along it."""
    gravity = scene.gravity
    pulls = gravity.arrays()[1] if isinstance(gravity, TimeTable) else np.array([gravity])
    held: dict[str, str] = {}
    for boundary in scene.boundaries:
        if isinstance(boundary.shape, DomainWalls):
            held |= dict.fromkeys(_held_faces(scene, boundary), boundary.name)
    for a, n in enumerate(scene.cells):
        low, high = (held.get(f"{'xyz'[a]}{end}") for end in "-+")
        if n > 2 or low is None or high is None:
            continue
        moving = [
            f"body '{b.name}' moves"
            for b in scene.bodies
            if not isinstance(b.velocity, Field) and any(b.velocity[a : a + 1])
        ]
        if pulls.shape[-1] == scene.dimension and np.any(pulls[:, a] != 0):
            moving.append("gravity acts")
        if moving:
            cells = "one cell" if n == 1 else f"{n} cells"
            doubts.append(
                f"Scene: the domain is {cells} wide on axis {a} between walls of boundary "
                f"'{low}', which hold every node of it, and {' and '.join(moving)} along it; "
                "nothing will move there; expected three cells or more, or boundaries.Mirror()"
            )


def _held_faces(scene: SceneData, boundary: Boundary) -> list[str]:
    """Return the faces of domain walls that hold the nodes beside them at rest."""
    shape = boundary.shape
    assert isinstance(shape, DomainWalls)
    if boundary.motion is not None or boundary.time is not None:
        return []
    names = [f"{axis}{end}" for axis in "xyz"[: scene.dimension] for end in "-+"]
    present = names if shape.faces == "all" else [f for f in shape.faces if f in names]
    given = boundary.response
    return [
        f
        for f in present
        if not isinstance(given if isinstance(given, Response) else given.get(f), Mirror)
    ]


def check_numbers(
    scene: SceneData, precision: str, bodies: Sequence[Mapping[str, Any]]
) -> list[str]:
    """Return what of the lowered `bodies` the number types of a precision cannot hold."""
    if scene.grid is not None:
        return []
    most = _HELD[precision][1]
    problems: list[str] = []
    for body, lowered in zip(scene.bodies, bodies, strict=True):
        check = Checker(f"body '{body.name}'")
        _number(check, "particle mass", float(lowered["particle_mass"]), "kg", precision, True)
        for p in body.material.table.parameters:
            value = float(getattr(body.material, p.name))
            if p.name != "density" and math.isfinite(value):
                positive = p.lower == 0 and p.lower_open
                _number(check, p.name, value, p.unit, precision, positive)
        velocity = np.abs(np.asarray(lowered["velocity"], dtype=np.float64))
        speed = float(velocity.max()) if velocity.size else 0.0
        if not speed <= most:
            check.fail(
                f"velocity has {speed:g} m/s; {precision} precision holds ≤ {most:g} here; "
                "expected less"
            )
        problems += check.problems
    return problems


def _number(
    check: Checker, name: str, value: float, unit: str, precision: str, positive: bool
) -> None:
    least, most = _HELD[precision]
    if abs(value) > most or (positive and value < least):
        remedy = "choose other units" if precision == "double" else "use precision='double'"
        check.fail(
            f"{name} is {value:g} {unit}; {precision} precision holds {least:g} to {most:g} here; "
            f"{remedy}, or expected values within them"
        )


def check_sweeps(scene: SceneData, time_step: float) -> list[str]:
    """Return which moving shapes would pass a cell in one step, and material with it, unseen."""
    problems = []
    for boundary in scene.boundaries:
        if not boundary.is_surface or isinstance(boundary.response, Prescribed):
            continue
        speed = _fastest(boundary)
        cells = speed * time_step / scene.cell_size
        if not cells <= 1:
            problems.append(
                f"boundary '{boundary.name}': moves at up to {speed:.4g} m/s, {cells:.4g} cells in "
                f"a step of {time_step:.4g} s; expected ≤ 1, or it would pass through material; "
                f"slow it down or give Method(time_step={0.5 * scene.cell_size / speed:.3g})"
            )
    return problems


def _fastest(boundary: Boundary) -> float:
    """Return the largest speed of any point of a moving shape, m/s."""
    speed = 0.0
    table, of_places = motion_of(boundary)
    if table is not None:
        speed = largest(table, of_places)
    turning = boundary.rotation
    if turning is None:
        return speed
    angles = turning.radians()
    if angles is not None:
        rate = largest(angles, True)
    elif isinstance(turning.rate, TimeTable):
        rate = largest(turning.rate)
    else:
        rate = abs(float(turning.rate or 0.0))
    assert isinstance(boundary.shape, Solid)
    low, high = (np.asarray(x, dtype=np.float64) for x in boundary.shape.bounds())
    about = np.asarray(turning.about, dtype=np.float64)
    arm = np.maximum(np.abs(low - about), np.abs(high - about))
    # In 3D the axis takes a part of it away; which one is left to the axis.
    axis = turning.axis
    if len(about) == 3 and (axis is None or isinstance(axis, str)):
        arm[2 if axis is None else "xyz".index(axis)] = 0.0
    return speed + rate * float(np.linalg.norm(arm)) if rate else speed
