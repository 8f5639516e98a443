"""Rules that concern a scene as a whole: names, places and times of its parts.

A problem makes the scene unusable; a doubt lets it run with an error that is stated.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src import sampling
from libmpm._src.errors import SceneError
from libmpm._src.field import Field
from libmpm._src.method import FBar
from libmpm._src.parameters import wave_speed
from libmpm._src.sensors import Energy, LoadCell, ParticleTracker, VelocityProbe, WaveGauge
from libmpm._src.shapes import Box, DomainWalls, OrientedBox, faces_of
from libmpm._src.timetable import TimeTable, check_vector_table
from libmpm._src.triangular import placing, rules
from libmpm._src.triangular.shapes import Outline
from libmpm._src.turned import Extent, TurnedBox, close_pairs, reach
from libmpm._src.values import Checker, nearest

if TYPE_CHECKING:
    from libmpm._src.parts import Body, Boundary, PlacedSensor
    from libmpm._src.scene import Scene

__all__ = ["Plane", "body_counts", "body_lattice", "check_scene", "faces_present", "holes_of"]
__all__ += ["new_bodies", "place_of"]
__all__ += ["initial_gravity", "planes", "relative", "snap", "vertical_axis"]

#: Parts of a cell: rounding of coordinates; a shift of a face that matters.
_ROUNDING = 1e-6
_SHIFT = 0.01

#: Shapes that a lattice fills.
_BOXES = (Box, OrientedBox)


@dataclass(frozen=True)
class Plane:
    """An impermeable plane: where the scene states it and where the grid has it, in m.

    Coordinates are those of the scene. `shift` is effective - stated, in cells.
    """

    boundary: str
    face: str
    stated: float
    effective: float
    shift: float


def relative(scene: Scene, point: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return a point of the scene relative to its lower corner, float64 (d,), m."""
    return np.asarray(point, dtype=np.float64) - np.asarray(scene.lower, dtype=np.float64)


def initial_gravity(scene: Scene) -> npt.NDArray[np.float64]:
    """Return gravity at time 0, (d,), m/s²."""
    if isinstance(scene.gravity, TimeTable):
        return scene.gravity.at(0.0)
    return np.asarray(scene.gravity, dtype=np.float64)


def vertical_axis(scene: Scene) -> int:
    """Return the axis closest to gravity at time 0; the last one without gravity."""
    gravity = np.abs(initial_gravity(scene))
    return int(np.argmax(gravity)) if np.any(gravity > 0) else scene.dimension - 1


def snap(scene: Scene, box: Box) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the cells that a box boundary blocks, lower ≤ i < upper: the nearest cell faces."""
    ends = []
    for corner in (box.lower, box.upper):
        # The allowance decides a face in the middle of a cell alike for every rounding.
        cells = relative(scene, corner) / scene.cell_size + 0.5 + _ROUNDING
        ends.append(tuple(math.floor(x) for x in cells.tolist()))
    return ends[0], ends[1]


def faces_present(scene: Scene, boundary: Boundary) -> tuple[str, ...]:
    """Return the faces that a boundary has in this scene."""
    everything = faces_of(scene.dimension)
    shape = boundary.shape
    if isinstance(shape, Outline):
        return ()
    if isinstance(shape, DomainWalls) and shape.faces != "all":
        return tuple(f for f in everything if f in shape.faces)
    return everything


def planes(scene: Scene) -> list[Plane]:
    """Return stated and effective plane of every wall and box face."""
    found: list[Plane] = []
    if scene.grid is not None:
        return found  # boundaries lie on edges of the grid, exactly
    for boundary in scene.boundaries:
        if isinstance(boundary.shape, Box):
            stated = (boundary.shape.lower, boundary.shape.upper)
            cells = snap(scene, boundary.shape)
        else:
            stated = (scene.lower, scene.upper)
            cells = ((0,) * scene.dimension, scene.cells)
        for face in faces_present(scene, boundary):
            axis, end = "xyz".index(face[0]), int(face[1] == "+")
            effective = scene.lower[axis] + cells[end][axis] * scene.cell_size
            shift = (effective - stated[end][axis]) / scene.cell_size
            found.append(Plane(boundary.name, face, stated[end][axis], effective, shift))
    return found


def body_lattice(scene: Scene, body: Body) -> sampling.Lattice:
    """Return the lattice that fills a body, relative to the scene's lower corner."""
    place = place_of(scene, body)
    if isinstance(place, TurnedBox):
        return sampling.turned_lattice(
            place, scene.cell_size, body.particles_per_cell, body.lattice
        )
    return sampling.lattice(*place, scene.cell_size, body.particles_per_cell, body.lattice)


def holes_of(scene: Scene, body: Body) -> list[Extent]:
    """Return the boxes, relative, of the bodies that are subtracted from this one."""
    return [
        place_of(scene, b)
        for b in scene.bodies
        if body.name in b.subtract_from and b is not body and isinstance(b.shape, _BOXES)
    ]


def _geometry(shape: Box | OrientedBox) -> Extent:
    """Return the corners of a straight box, or the geometry of a turned one; m of the scene."""
    return shape.turned() if isinstance(shape, OrientedBox) else (shape.lower, shape.upper)


def new_bodies(scene: Scene) -> list[Body]:
    """Return the bodies that the run which the scene goes on from did not have."""
    return [b for b in scene.bodies if scene.start is None or not scene.start.restored(b.name)]


def place_of(scene: Scene, body: Body) -> Extent:
    """Return where the box of a body is, relative to the scene's lower corner."""
    assert isinstance(body.shape, _BOXES)
    place = _geometry(body.shape)
    if isinstance(place, TurnedBox):
        return place.moved([-x for x in scene.lower])
    low, high = (relative(scene, corner).tolist() for corner in place)
    return low, high


def body_counts(scene: Scene) -> list[int]:
    """Return the number of particles of every body; of a restored one no fewer than it has."""
    if scene.grid is not None:
        return [placing.place(scene, b).count for b in scene.bodies]
    counts = []
    for b in scene.bodies:
        before = None if scene.start is None else scene.start.restored(b.name)
        if before is not None:
            counts.append(before.ids)
            continue
        lattice = body_lattice(scene, b)
        counts.append(sampling.points(lattice, holes_of(scene, b), scene.cell_size).count)
    return counts


def check_scene(scene: Scene) -> tuple[list[str], list[str]]:
    """Return (problems, doubts) of a scene."""
    problems: list[str] = []
    doubts: list[str] = []
    if not scene.bodies:
        problems.append("Scene: there is no body; expected at least one; use add_body")
    if scene.grid is not None:
        rules.check_grid(scene, problems, doubts)
    elif not rules.check_square_cells(scene, problems):
        return problems, doubts
    # Restored bodies are no longer where their shapes say; `snapshot` compares their particles.
    to_place = scene.bodies if scene.start is None else new_bodies(scene)
    fitting = [b for b in to_place if _check_body(scene, b, problems, doubts)]
    _check_overlaps(scene, fitting, problems)
    if scene.grid is not None and len(fitting) == len(to_place) and not problems:
        rules.check_overlaps(scene, fitting, problems)
    solid = [b for b in scene.boundaries if _check_boundary(scene, b, problems, doubts)]
    _check_walls(scene, solid, problems)
    _check_blocked(scene, fitting, solid, problems)
    counts: Mapping[str, int] = {}
    if len(fitting) == len(to_place):
        counts = dict(zip([b.name for b in scene.bodies], body_counts(scene), strict=True))
        for name, n in counts.items():
            if n == 0:
                problems.append(
                    f"body '{name}': no particle is left after the subtractions; expected some; "
                    "remove the body, or correct subtract_from of the others"
                )
    for sensor in scene.sensors:
        _check_sensor(scene, sensor, counts, problems)
    return problems, doubts


def _wrong_dimension(check: Checker, name: str, have: int, want: int) -> bool:
    if have != want:
        check.fail(f"{name} has {have} numbers; expected {want}, the dimension of the scene")
    return have != want


def _outside(
    check: Checker, scene: Scene, what: str, low: Iterable[float], high: Iterable[float]
) -> None:
    slack = _ROUNDING * scene.cell_size
    for a, (x, y) in enumerate(zip(low, high, strict=True)):
        if x < scene.lower[a] - slack or y > scene.upper[a] + slack:
            span = f"{x:g}" if x == y else f"{x:g} to {y:g}"
            check.fail(
                f"{what} spans {span} m on axis {a}; expected inside the domain, "
                f"{scene.lower[a]:g} to {scene.upper[a]:g} m; move it or enlarge the domain"
            )


def _check_body(scene: Scene, body: Body, problems: list[str], doubts: list[str]) -> bool:
    """Check one body; returns whether its box can be compared with others."""
    check = Checker(f"body '{body.name}'")
    d = scene.dimension
    _wrong_dimension(check, "velocity", len(body.velocity), d)  # of a vector or a Field
    fits = not _wrong_dimension(check, "shape", body.shape.dimension, d)
    if fits and isinstance(body.shape, _BOXES):
        _outside(check, scene, "the body", body.shape.lower, body.shape.upper)
    if scene.grid is not None and isinstance(body.shape, OrientedBox):
        check.fail(
            "shapes.OrientedBox is not built for grids of functions; expected a shapes.Box, or "
            "shapes.Cells or Points on triangles"
        )
        fits = False
    elif scene.grid is not None:
        fits = rules.check_body(scene, body, check.problems) and fits
    elif fits and isinstance(body.shape, _BOXES):
        where = "on its own axis" if isinstance(body.shape, OrientedBox) else "on axis"
        for a, size in enumerate(body.shape.size):
            cells = size / scene.cell_size
            if cells < 2 * (1 - _ROUNDING):
                doubts.append(
                    f"body '{body.name}': {size:g} m thick {where} {a}, that is {cells:.3g} cells; "
                    f"expected two or more; contact begins about half a cell early on either "
                    f"side, an error of about {100 / cells:.0f} % of the thickness; use "
                    f"cell_size ≤ {size / 2:g} m or a thicker body"
                )
    _check_material(check, scene, body)
    if fits and isinstance(body.velocity, Field) and len(body.velocity) == d:
        check.problems += _check_field(scene, body)
    names = [b.name for b in scene.bodies]
    for other in body.subtract_from:
        if other == body.name:
            check.fail("subtract_from has the body itself; expected names of other bodies")
        elif other not in names:
            others = [n for n in names if n != body.name]
            check.fail(f"subtract_from has unknown body '{other}'; {nearest(other, others)}")
    problems += check.problems
    return fits


def _check_field(scene: Scene, body: Body) -> list[str]:
    """Evaluate a body's fields where it can be done before the particles are placed."""
    assert isinstance(body.velocity, Field)
    where = f"body '{body.name}': velocity"
    try:
        if scene.grid is not None:
            position = placing.place(scene, body).position
            body.velocity.at(position, where)
            if isinstance(body.stress, Field) and len(body.stress) == 4:
                body.stress.at(position, f"body '{body.name}': stress")
        elif isinstance(body.shape, _BOXES):
            corners = np.array([body.shape.lower, body.shape.upper], dtype=np.float64)
            body.velocity.at(corners.mean(axis=0, keepdims=True), where)
    except SceneError as error:
        return list(error.problems)
    return []


def _check_material(check: Checker, scene: Scene, body: Body) -> None:
    table = body.material.table
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
    _check_transfer(scene, body, check)
    if isinstance(body.fbar, FBar) and not table.fbar:
        check.fail(
            f"fbar is {body.fbar!r} for {table.name}, which has no volume smoothing; expected "
            'None or "default"; remove fbar'
        )
        return
    choice = FBar() if body.fbar == "default" and table.stores_volume else body.fbar
    if not isinstance(choice, FBar) or wave_speed(body.material) is not None:
        return
    if choice.time is None and choice.ratio is None and choice.length is None:
        check.fail(
            f"fbar needs a time, since the wave speed of {table.name} is not known; "
            "give FBar(time=...) in s"
        )


def _check_transfer(scene: Scene, body: Body, check: Checker) -> None:
    """Refuse a scheme of a body's own: the scheme is the scene's, its numbers are not."""
    of_scene, own = scene.method.transfer_choice, body.transfer
    if own is not None and (own.scheme, own.order, own.every) != (
        of_scene.scheme,
        of_scene.order,
        of_scene.every,
    ):
        check.fail(
            f"transfer is '{own.scheme}' in a scene with '{of_scene.scheme}'; bodies share one "
            "grid and with it the scheme; give it the scene's scheme, with its own flip and shift"
        )


def _check_overlaps(scene: Scene, bodies: list[Body], problems: list[str]) -> None:
    slack = _ROUNDING * scene.cell_size
    boxes = [(b, b.shape) for b in bodies if isinstance(b.shape, _BOXES)]
    earlier: dict[str, Body] = {}
    for two, _ in boxes:
        for name in two.subtract_from:
            if name in earlier and two.name in earlier[name].subtract_from:
                problems.append(
                    f"body '{name}': with body '{two.name}': each is subtracted from the other; "
                    "expected one order; remove one of the two names from subtract_from"
                )
        earlier[two.name] = two
    for i, j in close_pairs([(shape.lower, shape.upper) for _, shape in boxes]):
        (one, first), (two, second) = boxes[i], boxes[j]
        if two.name in one.subtract_from or one.name in two.subtract_from:
            continue
        deep, size = reach(_geometry(first), _geometry(second))
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


def _check_boundary(
    scene: Scene, boundary: Boundary, problems: list[str], doubts: list[str]
) -> bool:
    """Check one boundary; returns whether its shape can be compared with others."""
    check = Checker(f"boundary '{boundary.name}'")
    d = scene.dimension
    shape = boundary.shape
    everything = faces_of(d)
    fits = True
    if boundary.motion is not None:
        check_vector_table(check, "motion", boundary.motion, d, "m/s")
    if scene.grid is not None:
        rules.check_boundary(scene, boundary, check.problems)
        fits = not isinstance(shape, Box)
    elif isinstance(shape, Box):
        fits = not _wrong_dimension(check, "shape", shape.dimension, d)
        if fits:
            doubts += _check_box(check, scene, boundary.name, shape)
    if isinstance(shape, DomainWalls) and shape.faces != "all":
        for face in shape.faces:
            if face not in everything:
                check.fail(f"faces has '{face}' in {d}D; expected some of {', '.join(everything)}")
    if isinstance(boundary.response, Mapping) and not isinstance(shape, Outline):
        present = faces_present(scene, boundary)
        for face in boundary.response:
            if face not in present:
                check.fail(f"response has face '{face}'; the boundary has {', '.join(present)}")
        missing = [f for f in present if f not in boundary.response]
        if missing:
            check.fail(
                f"response has no entry for {', '.join(missing)}; expected one for every face "
                "of the boundary; add them, or name fewer walls with DomainWalls(faces=...)"
            )
    problems += check.problems
    return fits


def _check_box(check: Checker, scene: Scene, name: str, box: Box) -> list[str]:
    low, high = snap(scene, box)
    doubts = []
    for a in range(scene.dimension):
        width = high[a] - low[a]
        stated = box.size[a]
        if width < 1:
            check.fail(
                f"{stated:g} m wide on axis {a}, less than a cell face apart after moving to the "
                f"grid; expected one cell or more; widen it or use cell_size ≤ {stated:g} m"
            )
        if high[a] <= 0 or low[a] >= scene.cells[a]:
            check.fail(
                f"the box spans {box.lower[a]:g} to {box.upper[a]:g} m on axis {a}, outside the "
                f"domain; expected to reach into {scene.lower[a]:g} to {scene.upper[a]:g} m"
            )
        for end, cells, x in (("lower", low[a], box.lower[a]), ("upper", high[a], box.upper[a])):
            effective = scene.lower[a] + cells * scene.cell_size
            shift = (effective - x) / scene.cell_size
            if abs(shift) > _SHIFT:
                doubts.append(
                    f"boundary '{name}': {end}[{a}] is {x:g} m, its effective plane {effective:g} "
                    f"m, {shift:+.2f} cells away; expected within {_SHIFT:g} cell; put the face "
                    "on a cell face"
                )
    return doubts


def _check_walls(scene: Scene, boundaries: list[Boundary], problems: list[str]) -> None:
    walls = [b for b in boundaries if isinstance(b.shape, DomainWalls)]
    for i, one in enumerate(walls):
        for two in walls[i + 1 :]:
            second = faces_present(scene, two)
            shared = [f for f in faces_present(scene, one) if f in second]
            together = max(one.window[0], two.window[0]) < min(one.window[1], two.window[1])
            if shared and together:
                problems.append(
                    f"boundary '{two.name}': {', '.join(shared)} is also a wall of boundary "
                    f"'{one.name}' at the same time; expected one response per wall; use "
                    "DomainWalls(faces=...) or time windows that do not meet"
                )


def _check_blocked(
    scene: Scene, bodies: list[Body], boundaries: list[Boundary], problems: list[str]
) -> None:
    base = np.asarray(scene.lower)
    now = 0.0 if scene.start is None else scene.start.time
    for boundary in boundaries:
        first, last = boundary.window
        if not isinstance(boundary.shape, Box) or not first <= now < last:
            continue
        corners = snap(scene, boundary.shape)
        low, high = ((base + np.array(c) * scene.cell_size).tolist() for c in corners)
        for body in bodies:
            assert isinstance(body.shape, _BOXES)
            deep, size = reach(_geometry(body.shape), (low, high))
            if deep > _SHIFT * scene.cell_size:
                planes = ", ".join(f"{x:g} to {y:g}" for x, y in zip(low, high, strict=True))
                problems.append(
                    f"body '{body.name}': reaches {size} m into boundary '{boundary.name}', which "
                    f"blocks {planes} m; expected to end at its faces; shorten or split the body"
                )


def _check_sensor(
    scene: Scene, placed: PlacedSensor, counts: Mapping[str, int], problems: list[str]
) -> None:
    check = Checker(f"sensor '{placed.name}'")
    sensor = placed.sensor
    d = scene.dimension
    if isinstance(sensor, WaveGauge | ParticleTracker | Energy) and sensor.body is not None:
        names = [b.name for b in scene.bodies]
        if sensor.body not in names:
            check.fail(f"body '{sensor.body}' is unknown; {nearest(sensor.body, names)}")
    if isinstance(sensor, LoadCell):
        _check_load_cell(check, scene, sensor)
    elif isinstance(sensor, VelocityProbe):
        if not _wrong_dimension(check, "position", len(sensor.position), d):
            _outside(check, scene, "the probe", sensor.position, sensor.position)
    elif isinstance(sensor, WaveGauge):
        axes = [a for a in range(d) if a != vertical_axis(scene)]
        if len(sensor.position) != d - 1:
            check.fail(
                f"position has {len(sensor.position)} numbers; expected {d - 1}, the horizontal "
                f"place on axes {', '.join(map(str, axes))}; leave out the vertical"
            )
        else:
            place = list(scene.lower)
            for a, x in zip(axes, sensor.position, strict=True):
                place[a] = x
            _outside(check, scene, "the gauge", place, place)
    elif isinstance(sensor, ParticleTracker) and sensor.body in counts and sensor.ids != "all":
        first = 0
        for name, n in counts.items():
            if name == sensor.body:
                break
            first += n
        last = first + counts[sensor.body] - 1
        wrong = [i for i in sensor.ids if not first <= i <= last]
        if wrong:
            check.fail(
                f"ids has {', '.join(map(str, wrong[:5]))}; expected ids of body "
                f"'{sensor.body}', {first} to {last}"
            )
    problems += check.problems


def _check_load_cell(check: Checker, scene: Scene, cell: LoadCell) -> None:
    if cell.reference is not None:
        _wrong_dimension(check, "reference", len(cell.reference), scene.dimension)
    names = [b.name for b in scene.boundaries]
    if cell.boundary not in names:
        check.fail(f"boundary '{cell.boundary}' is unknown; {nearest(cell.boundary, names)}")
        return
    if cell.faces == "all":
        return
    boundary = scene.boundaries[names.index(cell.boundary)]
    if isinstance(boundary.shape, Outline):
        check.fail(f"faces is {cell.faces!r}; boundary '{cell.boundary}' is an Outline, which has "
                   "none; leave faces out")  # fmt: skip
        return
    present = faces_present(scene, boundary)
    for face in cell.faces:
        if face not in present:
            check.fail(f"faces has '{face}'; boundary '{cell.boundary}' has {', '.join(present)}")
