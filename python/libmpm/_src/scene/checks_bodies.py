"""Rules about bodies: where they are, and what they may ask for."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.base.axes import AXES
from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.grids import checks as grid_checks
from libmpm._src.grids import placing
from libmpm._src.materials.initial_stress import check_stress
from libmpm._src.materials.material import wave_speed
from libmpm._src.materials.rigid import Rigid
from libmpm._src.methods.method import PACKING, FBar
from libmpm._src.methods.transfer import SHIFTS
from libmpm._src.scene.checks_elements import check_elements, check_mesh_overlaps
from libmpm._src.scene.checks_rigid import check_rigid
from libmpm._src.scene.places import initial_gravity
from libmpm._src.shapes.boxes import Box, OrientedBox
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.filling import BOXES, fill, geometry_of
from libmpm._src.shapes.oriented_boxes import close_pairs, reach
from libmpm._src.shapes.particle_placement import Columns, Jitter
from libmpm._src.shapes.point_file import PointFile
from libmpm._src.shapes.solid import Bounds, GivenPoints, Solid
from libmpm._src.shapes.volume import overlap_depth, shared_bounds

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = [
    "check_body",
    "check_cfl",
    "check_overlaps",
    "outside",
    "reaches_into",
]
__all__ += ["wrong_dimension"]

#: Part of a cell that rounding of coordinates may make.
_ROUNDING = 1e-6


#: Points of the lattice around a solid that is no box: one body has at most half as many particles.
_MOST_POINTS = 2**33

#: Particles looked at together.
_PIECE = 1 << 18

#: Share of their own velocity that particles keep, and with which they move where they are pressed,
#: above which discs that collide tear (docs/method-tables.md).
_KEPT, _SHIFTED = 0.9, 0.05


def wrong_dimension(check: Checker, name: str, have: int, want: int) -> bool:
    if have != want:
        check.fail(f"{name} has {have} numbers; expected {want}, the dimension of the scene")
    return have != want


def outside(
    check: Checker,
    scene: SceneData,
    what: str,
    low: Iterable[float],
    high: Iterable[float],
    more: str = "",
) -> None:
    slack = _ROUNDING * scene.cell_size
    for a, (x, y) in enumerate(zip(low, high, strict=True)):
        if x < scene.lower[a] - slack or y > scene.upper[a] + slack:
            span = f"{x:g}" if x == y else f"{x:g} to {y:g}"
            check.fail(
                f"{what} spans {span} m{more} on axis {a}; expected inside the domain, "
                f"{scene.lower[a]:g} to {scene.upper[a]:g} m; move it or enlarge the domain"
            )


def check_cfl(scene: SceneData, doubts: list[str]) -> None:
    """Doubt a Courant number at which fluid that comes apart into particles is unstable.

    A particle of fluid alone in its cells breathes with ω² = 4 d K / (ρ Δx²), and an explicit step
    is stable for ω Δt < 2; many in a cell are stable beyond 1.
    """
    cfl, d = scene.method.cfl, scene.dimension
    fluids = [b for b in scene.bodies if b.material.table.stores_volume]
    if scene.grid is None and fluids and scene.method.time_step is None and cfl * cfl * d >= 1:
        doubts.append(
            f"Method: cfl is {cfl:g} in {d}D; a particle of fluid alone, as in spray, is stable "
            f"below 1/√{d} = {d**-0.5:.3f}; lower cfl, 0.4 is a safe start"
        )


def check_body(scene: SceneData, body: Body, problems: list[str], doubts: list[str]) -> bool:
    """Check one body; returns whether its box can be compared with others."""
    check = Checker(f"body '{body.name}'")
    d = scene.dimension
    wrong_dimension(check, "velocity", len(body.velocity), d)  # of a vector or a Field
    fits = not wrong_dimension(check, "shape", body.shape.dimension, d)
    on_cells = isinstance(body.shape, Solid | GivenPoints)
    _check_shift(scene, body, doubts)
    if scene.grid is not None and body.sampling is not None:
        check.fail(
            f"{body.sampling.label} is not built for grids of functions; expected sampling=None; "
            "leave it out"
        )
    if scene.grid is not None and on_cells and not isinstance(body.shape, Box):
        check.fail(
            f"{body.shape.label} is not built for grids of functions; expected a shapes.Box, or "
            "shapes.Cells or Points on triangles"
        )
        fits = False
    elif scene.grid is not None:
        if fits and isinstance(body.shape, Box):
            outside(check, scene, "the body", body.shape.lower, body.shape.upper)
        fits = grid_checks.check_body(scene, body, check.problems) and fits
    elif fits and on_cells:
        if isinstance(body.shape, ElementMesh):
            check_elements(check, scene, body, doubts)
        before = len(check.problems)
        _check_holes(check, scene, body)
        fits = len(check.problems) == before and _check_lattice(check, scene, body)
        fits = fits and _check_place(check, scene, body)
        where = "on its own axis" if isinstance(body.shape, OrientedBox) else "on axis"
        for a, size in enumerate(_size(body) if fits else ()):
            cells = size / scene.cell_size
            if 0 < cells < 2 * (1 - _ROUNDING):  # of a single point no thickness is known
                doubts.append(
                    f"body '{body.name}': {size:g} m thick {where} {a}, that is {cells:.3g} cells; "
                    f"expected two or more; contact begins about half a cell early on either "
                    f"side, an error of about {100 / cells:.0f} % of the thickness; use "
                    f"cell_size ≤ {size / 2:g} m or a thicker body"
                )
    _check_material(check, scene, body)
    if fits and isinstance(body.velocity, Field) and len(body.velocity) == d:
        check.problems += _check_field(scene, body)
    if fits and isinstance(body.stress, Field) and on_cells and not check.problems:
        check.problems += _at_the_middle(body, body.stress, "stress")
    names = [b.name for b in scene.bodies]
    for other in body.subtract_from:
        if other == body.name:
            check.fail("subtract_from has the body itself; expected names of other bodies")
        elif other not in names:
            others = [n for n in names if n != body.name]
            check.fail(f"subtract_from has unknown body '{other}'; {nearest(other, others)}")
    problems += check.problems
    return fits


def _check_field(scene: SceneData, body: Body) -> list[str]:
    """Evaluate a body's fields where it can be done before the particles are placed."""
    assert isinstance(body.velocity, Field)
    where = f"body '{body.name}': velocity"
    try:
        if scene.grid is not None:
            position = placing.place(scene, body).position
            body.velocity.at(position, where)
            if isinstance(body.stress, Field) and len(body.stress) == 4:
                body.stress.at(position, f"body '{body.name}': stress")
    except SceneError as error:
        return list(error.problems)
    return _at_the_middle(body, body.velocity, "velocity") if scene.grid is None else []


def _at_the_middle(body: Body, field: Field, name: str) -> list[str]:
    """Evaluate a field at the middle of a shape's bounds."""
    if not isinstance(body.shape, Solid | GivenPoints):
        return []
    corners = np.array(body.shape.bounds(), dtype=np.float64)
    try:
        field.at(corners.mean(axis=0, keepdims=True), f"body '{body.name}': {name}")
    except SceneError as error:
        return list(error.problems)
    return []


def _check_material(check: Checker, scene: SceneData, body: Body) -> None:
    table = body.material.table
    if isinstance(body.material, Rigid):
        check_rigid(check, scene, body)
        return
    speed = wave_speed(body.material)
    if speed is not None and not 0 < speed < math.inf:
        check.fail(
            f"the wave speed of its {table.name} is {speed:g} m/s; expected above 0 and finite; "
            "correct density and modulus"
        )
        return
    if body.hydrostatic is not None:
        if not np.any(initial_gravity(scene) != 0):
            check.fail(
                f"hydrostatic is {body.hydrostatic:g} without gravity at time 0; expected "
                "gravity; give Scene(gravity=...) or remove hydrostatic"
            )
        if not table.stores_volume:
            check.fail(
                f"hydrostatic is {body.hydrostatic:g} for {table.name}, which stores no volume "
                "ratio to start from; expected a fluid; remove hydrostatic"
            )
    if scene.grid is None:
        check_stress(scene, body, check)
    _check_transfer(scene, body, check)
    _check_smoothing(scene, body, check)
    if isinstance(body.fbar, FBar) and not table.fbar:
        check.fail(
            f"fbar is {shown(body.fbar)} for {table.name}, which has no volume smoothing; expected "
            'None or "default"; remove fbar'
        )
        return
    for option in PACKING:
        if isinstance(body.fbar, FBar) and getattr(body.fbar, option) and not table.stores_volume:
            check.fail(
                f"FBar({option}=True) for {table.name}, whose particles are no fluid's; expected a "
                f"fluid; leave {option} out"
            )
    by_default = body.fbar == "default" and table.stores_volume and body.smoothing is None
    choice = FBar() if by_default else body.fbar
    if not isinstance(choice, FBar) or wave_speed(body.material) is not None:
        return
    if choice.time is None and choice.ratio is None and choice.length is None:
        check.fail(
            f"fbar needs a time, since the wave speed of {table.name} is not known; "
            "give FBar(time=...) in s"
        )


def _check_smoothing(scene: SceneData, body: Body, check: Checker) -> None:
    """Refuse smoothing over cells of what a material does not store, and beside F-bar."""
    smoothing, table = body.smoothing, body.material.table
    force, dimension = body.force, scene.dimension
    if force is not None and (
        len(force.value[0]) != dimension or "xyz".index(force.axis) >= dimension
    ):
        check.fail(
            f"force is along '{force.axis}' with {len(force.value[0])} components in a scene of "
            f"{dimension} axes; give one component an axis"
        )
    if smoothing is None:
        return
    if isinstance(body.fbar, FBar):
        check.fail("fbar and smoothing are both given; expected at most one; remove one of them")
    has = "volume" if table.stores_volume else "strain" if table.name == "LinearElastic" else None
    if has is None or smoothing.field not in (None, has):
        why = "which does not store it"
        if has is None and table.needs == "elastic_strain":
            why = "which stores its elastic strain, from which the total one does not follow"
        check.fail(
            f"smoothing of field '{smoothing.field or 'strain'}' for {table.name}, {why}; expected "
            "'volume' of a fluid or 'strain' of LinearElastic; remove smoothing"
        )


def _check_transfer(scene: SceneData, body: Body, check: Checker) -> None:
    """Refuse a scheme of a body's own: the scheme is the scene's, its numbers are not."""
    of_scene, own = scene.transfer, body.transfer
    if own is not None and (own.scheme, own.order, own.every) != (
        of_scene.scheme,
        of_scene.order,
        of_scene.every,
    ):
        check.fail(
            f"transfer is '{own.scheme}' in a scene with '{of_scene.scheme}'; bodies share one "
            "grid and with it the scheme; give it the scene's scheme, with its own flip and shift"
        )


def _check_shift(scene: SceneData, body: Body, doubts: list[str]) -> None:
    """Say where particles of a solid move by what the grid cannot see though they are pressed."""
    transfer = body.transfer or scene.transfer
    kept = 1.0 if transfer.flip is None else transfer.flip
    least = 1.0 if transfer.scheme == "NFLIP" else transfer.shift_min
    moves = transfer.scheme == "NFLIP" or (transfer.scheme in SHIFTS and transfer.below == "min")
    if body.material.table.stores_volume or not moves or kept <= _KEPT or least <= _SHIFTED:
        return
    doubts.append(
        f"body '{body.name}': transfer '{transfer.scheme}' with β = {least:g} and flip {kept:g} "
        "moves particles of a solid by what the grid cannot see, also where it is pressed, and "
        "nothing brings them back: in a collision of two elastic discs they tear, and a quarter to "
        "two thirds of the energy is lost (FLIP 6 to 13 %) without an error; expected "
        f"β ≤ {_SHIFTED:g} or flip ≤ {_KEPT:g}; use 'FLIP', 'AFLIP', or 'ASFLIP' with "
        "shift_min=0, which moves so where the solid is stretched alone"
    )


def _size(body: Body) -> tuple[float, ...]:
    """Return how thick a body is on each axis, m; of a turned box, on its own axes."""
    if isinstance(body.shape, BOXES):
        return tuple(body.shape.size)
    assert isinstance(body.shape, Solid | GivenPoints)
    return tuple(b - a for a, b in zip(*body.shape.bounds(), strict=True))


def _check_holes(check: Checker, scene: SceneData, body: Body) -> None:
    """Refuse what has no inside, or no lattice, where one is needed."""
    if body.subtract_from and isinstance(body.shape, PointFile):
        check.fail(
            "subtract_from with shapes.PointFile, which has no inside; expected a solid; shape "
            "the other body without it"
        )
    if body.sampling is not None and isinstance(body.shape, PointFile):
        check.fail(
            f"sampling is {shown(body.sampling)} with shapes.PointFile, whose particles are given; "
            "expected None; leave it out"
        )
    upright = body.sampling.axis if isinstance(body.sampling, Columns) else None
    if upright is not None and AXES.index(upright) >= scene.dimension:
        check.fail(
            f"sampling has columns along '{upright}' in {scene.dimension}D; expected one of its "
            "axes; leave axis out"
        )
    if body.lattice is not None and not isinstance(body.sampling, Jitter | None):
        check.fail(
            f"lattice is {shown(body.lattice)} with {shown(body.sampling)}, which has none; "
            "expected "
            "one of the two; give particles_per_cell instead"
        )


def _check_lattice(check: Checker, scene: SceneData, body: Body) -> bool:
    """Refuse solids whose lattice has more points than can be looked at one by one."""
    shape = body.shape
    if isinstance(shape, BOXES) or not isinstance(shape, Solid):
        return True
    shared = shared_bounds(shape.bounds(), (scene.lower, scene.upper))
    if shared is None:
        return True
    points = math.prod((b - a) / scene.cell_size for a, b in zip(*shared, strict=True))
    points *= body.particles_per_cell
    if not points <= _MOST_POINTS:
        check.fail(
            f"its lattice has {points:.3g} points in the box around it; expected ≤ "
            f"{_MOST_POINTS:.3g}; use a larger cell_size, fewer particles_per_cell, or several "
            "bodies"
        )
        return False
    return True


def _check_place(check: Checker, scene: SceneData, body: Body) -> bool:
    """Check that a body is inside the domain; returns whether it can be filled."""
    shape = body.shape
    if isinstance(shape, BOXES):
        outside(check, scene, "the body", shape.lower, shape.upper)
        return True
    assert isinstance(shape, Solid | GivenPoints)
    low, high = shape.bounds()
    endless = [a for a, x in enumerate(zip(low, high, strict=True)) if not np.all(np.isfinite(x))]
    if endless:
        check.fail(
            f"the body has no end on axis {', '.join(map(str, endless))}; expected one inside the "
            "domain; cut it with `& shapes.Box(lower=..., upper=...)`"
        )
        return False
    slack = _ROUNDING * scene.cell_size
    ends = list(zip(low, high, scene.lower, scene.upper, strict=True))
    if all(a >= c - slack and b <= e + slack for a, b, c, e in ends):
        return True
    if (
        isinstance(shape, GivenPoints)
        or shared_bounds((low, high), (scene.lower, scene.upper)) is None
    ):
        outside(check, scene, "the body", low, high)
        return False
    # The box around a turned or cut solid may be wider than the solid: its particles decide.
    points = fill(scene, body).points
    corner = np.asarray(scene.lower)
    first, last = np.full(len(low), np.inf), np.full(len(low), -np.inf)
    for i in range(0, points.count, _PIECE):
        p = points.rows(i, min(points.count, i + _PIECE)) + corner
        first, last = np.minimum(first, p.min(axis=0)), np.maximum(last, p.max(axis=0))
    if points.count:
        outside(check, scene, "the body", first.tolist(), last.tolist(), " or more")
    return True


def reaches_into(scene: SceneData, body: Body, box: Bounds) -> tuple[float, str]:
    """Return how far a body reaches into a straight box, m, ≤ 0 if apart, and that in words."""
    if isinstance(body.shape, BOXES):
        return reach(geometry_of(body.shape), box)
    return _depth(scene, body, Box(lower=box[0], upper=box[1]), body.particles_per_cell)


def _depth(scene: SceneData, body: Body, other: Solid, per_cell: int) -> tuple[float, str]:
    """Return how deep a lattice, or given particles, of a body lie in a solid, m, and in words."""
    shape = body.shape
    if isinstance(shape, GivenPoints):
        deep = -float(other.distance(shape.positions()).min())
        return deep, f"{deep:.3g}"
    assert isinstance(shape, Solid)
    shared = shared_bounds(shape.bounds(), other.bounds())
    if shared is None:
        return -math.inf, ""
    spacing = scene.cell_size / per_cell ** (1.0 / scene.dimension)
    deep = overlap_depth(shape, other, shared, spacing)
    return deep, f"{deep:.3g}, or more,"


def check_overlaps(scene: SceneData, bodies: list[Body], problems: list[str]) -> None:
    slack = _ROUNDING * scene.cell_size
    check_mesh_overlaps(bodies, slack, problems)
    boxes = [(b, b.shape) for b in bodies if isinstance(b.shape, Solid | GivenPoints)]
    earlier: dict[str, Body] = {}
    for two, _ in boxes:
        for name in two.subtract_from:
            if name in earlier and two.name in earlier[name].subtract_from:
                problems.append(
                    f"body '{name}': with body '{two.name}': each is subtracted from the other; "
                    "expected one order; remove one of the two names from subtract_from"
                )
        earlier[two.name] = two
    for i, j in close_pairs([shape.bounds() for _, shape in boxes]):
        (one, first), (two, second) = boxes[i], boxes[j]
        if two.name in one.subtract_from or one.name in two.subtract_from:
            continue
        if isinstance(first, BOXES) and isinstance(second, BOXES):
            deep, size = reach(geometry_of(first), geometry_of(second))
        elif isinstance(second, Solid):
            per_cell = max(one.particles_per_cell, two.particles_per_cell)
            deep, size = _depth(scene, one, second, per_cell)
        elif isinstance(first, Solid):
            deep, size = _depth(scene, two, first, two.particles_per_cell)
        else:
            continue  # both are no more than points
        if deep > slack:
            problems.append(
                f"body '{one.name}': with body '{two.name}': the bodies overlap by {size} m; "
                "expected apart"
                + (
                    f", or an order: subtract_from=('{one.name}',) on '{two.name}' keeps "
                    f"'{two.name}' whole"
                    if scene.grid is None
                    else "; shape them apart"
                )
            )
