"""Rules that refuse a scene as a whole: names, places and times of its parts.

A problem makes the scene unusable; a doubt lets it run with an error that is stated.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.values import Checker, nearest, shown, warn
from libmpm._src.boundaries.checks import (
    check_edges,
    check_motion,
    check_reaction,
    check_surface,
    doubts_of_linear,
)
from libmpm._src.boundaries.contradictions import contradictions
from libmpm._src.boundaries.responses import Prescribed, Sticky
from libmpm._src.errors import SceneError
from libmpm._src.grids import checks as grid_checks
from libmpm._src.grids.shapes import Outline
from libmpm._src.scene.checks_afloat import held_down
from libmpm._src.scene.checks_bodies import (
    check_body,
    check_cfl,
    check_overlaps,
    outside,
    reaches_into,
    wrong_dimension,
)
from libmpm._src.scene.checks_drive import undriven
from libmpm._src.scene.checks_elements import check_continued
from libmpm._src.scene.checks_loads import doubtful_loads
from libmpm._src.scene.checks_rigid import check_rigid_step
from libmpm._src.scene.checks_sizes import check_range
from libmpm._src.scene.checks_viscous import smeared_flows
from libmpm._src.scene.contact_fields import (
    check_contact_load,
    check_contacts,
    doubtful_contacts,
    rigid_bodies,
)
from libmpm._src.scene.places import (
    body_counts,
    faces_present,
    new_bodies,
    snap,
    vertical_axis,
)
from libmpm._src.sensors.engine_sensors import (
    ContactLoad,
    Energy,
    LoadCell,
    ParticleTracker,
    PinForce,
    RigidMotion,
    VelocityProbe,
    WaveGauge,
)
from libmpm._src.sensors.python_sensors import Sampled
from libmpm._src.shapes.boxes import Box, DomainWalls, OrientedBox, Solid, faces_of

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary, PlacedSensor

__all__ = ["check_scene", "validate"]


#: Part of a cell by which a shift of a face matters.
_SHIFT = 0.01
#: Cells by which a body may reach into a turned box and into any other surface, whose layers of
#: cells a lattice of particles does not follow.
_DEEP, _DEEPER = 0.25, 0.75
#: Points at most along an axis, and in all, at which bodies are looked for in surfaces.
_LOOKED_AT, _LOOKED_AT_IN_ALL = 16, 50_000


def validate(scene: SceneData, *, strict: bool = False) -> None:
    """Check a scene; see `Scene.validate`. Raises `SceneError`, warns of doubts."""
    if not isinstance(strict, bool | np.bool_):
        raise SceneError(f"Scene.validate: strict is {shown(strict)}; expected True or False")
    problems, doubts = check_scene(scene)
    if strict:
        problems, doubts = problems + doubts, []
    if problems:
        raise SceneError(problems)
    warn(doubts)


def check_scene(scene: SceneData) -> tuple[list[str], list[str]]:
    """Return (problems, doubts) of a scene."""
    problems: list[str] = []
    doubts: list[str] = []
    if not scene.bodies:
        problems.append("Scene: there is no body; expected at least one; use add_body")
    if scene.grid is not None:
        grid_checks.check_grid(scene, problems, doubts)
    elif not (
        grid_checks.check_square_cells(scene, problems) and check_range(scene, problems, doubts)
    ):
        return problems, doubts
    # Restored bodies are no longer where their shapes say; `snapshot` compares their particles.
    to_place = scene.bodies if scene.start is None else new_bodies(scene)
    fitting = [b for b in to_place if check_body(scene, b, problems, doubts)]
    check_cfl(scene, doubts)
    check_continued(scene, problems)
    check_overlaps(scene, fitting, problems)
    if scene.grid is not None and len(fitting) == len(to_place) and not problems:
        grid_checks.check_overlaps(scene, fitting, problems)
    solid = [b for b in scene.boundaries if _check_boundary(scene, b, problems, doubts)]
    _check_walls(scene, solid, problems)
    _check_blocked(scene, fitting, solid, problems)
    _check_overlapped(scene, fitting, solid, problems, doubts)
    if scene.grid is None and len(solid) == len(scene.boundaries) and not problems:
        doubts += contradictions(scene)
        doubts += doubts_of_linear(scene)
    counts: Mapping[str, int] = {}
    if len(fitting) == len(to_place):
        counts = dict(zip([b.name for b in scene.bodies], body_counts(scene), strict=True))
        for name, n in counts.items():
            if n == 0:
                problems.append(
                    f"body '{name}': no particle is left after the subtractions; expected some; "
                    "remove the body, or correct subtract_from of the others"
                )
    if scene.flows:
        from libmpm._src.boundaries.flow_layers import check_flows, ids_kept

        check_flows(scene, problems, doubts)
        counts = ids_kept(scene, counts)
    check_contacts(scene, problems)
    check_rigid_step(scene, problems)
    for sensor in scene.sensors:
        _check_sensor(scene, sensor, counts, problems)
        check_reaction(scene, sensor, doubts)
    if not problems and scene.grid is None and scene.start is None:
        doubts += doubtful_contacts(scene)
        doubts += held_down(scene)
        doubts += smeared_flows(scene)
        doubts += doubtful_loads(scene)
        doubts += undriven(scene)
    return problems, doubts


def _check_boundary(
    scene: SceneData, boundary: Boundary, problems: list[str], doubts: list[str]
) -> bool:
    """Check one boundary; returns whether its shape can be compared with others."""
    check = Checker(f"boundary '{boundary.name}'")
    d = scene.dimension
    shape = boundary.shape
    everything = faces_of(d)
    fits = True
    check_motion(check, scene, boundary)
    if scene.grid is not None:
        grid_checks.check_boundary(scene, boundary, check.problems)
        fits = not isinstance(shape, Solid)
    elif boundary.is_surface:
        fits = check_surface(check, scene, boundary, doubts)
        if fits:
            check_edges(scene, boundary, doubts)
    elif isinstance(shape, Box):
        fits = not wrong_dimension(check, "shape", shape.dimension, d)
        if fits:
            doubts += _check_box(check, scene, boundary.name, shape)
    if isinstance(shape, DomainWalls) and shape.faces != "all":
        for face in shape.faces:
            if face not in everything:
                check.fail(f"faces has '{face}' in {d}D; expected some of {', '.join(everything)}")
    if isinstance(boundary.response, Mapping) and faces_present(scene, boundary):
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


def _check_box(check: Checker, scene: SceneData, name: str, box: Box) -> list[str]:
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


def _check_walls(scene: SceneData, boundaries: list[Boundary], problems: list[str]) -> None:
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
    scene: SceneData, bodies: list[Body], boundaries: list[Boundary], problems: list[str]
) -> None:
    base = np.asarray(scene.lower)
    now = 0.0 if scene.start is None else scene.start.time
    for boundary in boundaries:
        first, last = boundary.window
        if not isinstance(boundary.shape, Box) or not first <= now < last:
            continue
        if boundary.is_surface or isinstance(boundary.response, Prescribed):
            continue
        corners = snap(scene, boundary.shape)
        low, high = ((base + np.array(c) * scene.cell_size).tolist() for c in corners)
        for body in bodies:
            if boundary.bodies and body.name not in boundary.bodies:
                continue  # it does not meet this boundary
            deep, size = reaches_into(scene, body, (low, high))
            if deep > _SHIFT * scene.cell_size:
                planes = ", ".join(f"{x:g} to {y:g}" for x, y in zip(low, high, strict=True))
                problems.append(
                    f"body '{body.name}': reaches {size} m into boundary '{boundary.name}', which "
                    f"blocks {planes} m; expected to end at its faces; shorten or split the body"
                )


def _check_overlapped(
    scene: SceneData,
    bodies: list[Body],
    boundaries: list[Boundary],
    problems: list[str],
    doubts: list[str],
) -> None:
    """Refuse bodies in a turned box that stays, as in a box, and doubt those in other surfaces.

    What is deep inside of any of them is held by no node of its layer, and never gets out.
    """
    now = 0.0 if scene.start is None else scene.start.time
    pairs: list[tuple[Body, Boundary, Solid, Solid]] = []
    for boundary in boundaries:
        first, last = boundary.window
        own = boundary.shape
        if not boundary.is_surface or not isinstance(own, Solid) or not first <= now < last:
            continue
        if boundary.motion is not None or boundary.rotation or boundary.within is not None:
            continue
        if isinstance(boundary.response, Prescribed):
            continue
        for body in bodies:
            if not isinstance(body.shape, Solid) or own.dimension != body.shape.dimension:
                continue
            if boundary.bodies and body.name not in boundary.bodies:
                continue
            # A solid in a surface that holds it is clamped, which may be meant.
            clamped = (
                isinstance(boundary.response, Sticky) and body.material.table.needs != "volume"
            )
            if clamped and not isinstance(own, OrientedBox):
                continue
            if _common(own, body.shape) is not None:
                pairs.append((body, boundary, own, body.shape))
    many = (_LOOKED_AT_IN_ALL / max(len(pairs), 1)) ** (1 / scene.dimension)
    points = int(min(max(many, 3), _LOOKED_AT))
    for body, boundary, own, shape in pairs:
        turned = isinstance(own, OrientedBox)
        deep = _overlap(own, shape, _LOOKED_AT if turned else points, turned) / scene.cell_size
        if deep > (_DEEP if turned else _DEEPER):
            kind = type(own).__name__
            said = (
                f"body '{body.name}': reaches {deep:.3g} cells deep into boundary "
                f"'{boundary.name}', {'an' if kind[0] in 'AEIO' else 'a'} {kind} that blocks it"
            )
            if turned:
                problems.append(
                    f"{said}; expected to end at its faces; take it out of the body: shape - "
                    "shapes.OrientedBox(...)"
                )
            else:
                doubts.append(
                    f"{said}: what is inside stays there; expected to end at its surface; take it "
                    "out of the body: shape - the shape of the boundary"
                )


def _common(one: Solid, two: Solid) -> tuple[Any, Any] | None:
    """Return the corners of what the boxes around two solids have in common, m; None: nothing."""
    ends = [np.asarray(s.bounds(), dtype=np.float64) for s in (one, two)]
    low, high = np.maximum(ends[0][0], ends[1][0]), np.minimum(ends[0][1], ends[1][1])
    return None if np.any(low >= high) else (low, high)


def _overlap(one: Solid, two: Solid, each: int, both: bool) -> float:
    """Return how deep the deepest of a lattice of points in both solids lies in the first, m.

    `each` is the number of points along an axis; with `both` the lesser of its depths counts.
    """
    common = _common(one, two)
    if common is None:
        return 0.0
    low, high = common
    shares = (np.arange(each) + 0.5) / each
    axes = [a + shares * (b - a) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(low))
    inside, within = -one.distance(points), -two.distance(points)
    return float(np.minimum(inside, within if both else np.where(within > 0, inside, 0.0)).max())


def _check_sensor(
    scene: SceneData, placed: PlacedSensor, counts: Mapping[str, int], problems: list[str]
) -> None:
    check = Checker(f"sensor '{placed.name}'")
    sensor = placed.sensor
    d = scene.dimension
    if isinstance(sensor, WaveGauge | ParticleTracker | Energy) and sensor.body is not None:
        names = [b.name for b in scene.bodies]
        if sensor.body not in names:
            check.fail(f"body '{sensor.body}' is unknown; {nearest(sensor.body, names)}")
    if isinstance(sensor, RigidMotion):
        rigid = rigid_bodies(scene)
        if sensor.body not in rigid:
            known = nearest(sensor.body, rigid) if rigid else "the scene has no rigid body"
            check.fail(f"body '{sensor.body}' is no rigid body; {known}")
    if isinstance(sensor, PinForce):
        pins = {b.name: len(b.pins) for b in scene.bodies if b.pins}
        if sensor.body not in pins:
            known = nearest(sensor.body, pins) if pins else "no body of the scene has pins"
            check.fail(f"body '{sensor.body}' has no pins; {known}")
        elif sensor.pin >= pins[sensor.body]:
            check.fail(
                f"pin is {sensor.pin}; expected a number below {pins[sensor.body]}, of the pins of "
                f"body '{sensor.body}'"
            )
    if isinstance(sensor, Sampled):
        from libmpm._src.sensors.checks import check_sampled

        check_sampled(check, scene, sensor, counts)
    elif isinstance(sensor, LoadCell):
        _check_load_cell(check, scene, sensor)
    elif isinstance(sensor, ContactLoad):
        check_contact_load(check, scene, sensor)
    elif isinstance(sensor, VelocityProbe):
        if not wrong_dimension(check, "position", len(sensor.position), d):
            outside(check, scene, "the probe", sensor.position, sensor.position)
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
            outside(check, scene, "the gauge", place, place)
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


def _check_load_cell(check: Checker, scene: SceneData, cell: LoadCell) -> None:
    if cell.reference is not None:
        wrong_dimension(check, "reference", len(cell.reference), scene.dimension)
    names = [b.name for b in scene.boundaries]
    if cell.boundary not in names:
        check.fail(f"boundary '{cell.boundary}' is unknown; {nearest(cell.boundary, names)}")
        return
    if cell.faces == "all":
        return
    boundary = scene.boundaries[names.index(cell.boundary)]
    if isinstance(boundary.shape, Outline) or boundary.is_surface:
        shape = type(boundary.shape).__name__
        kind = "an Outline" if shape == "Outline" else f"a surface ({shape})"
        check.fail(
            f"faces is {shown(cell.faces)}; boundary '{cell.boundary}' is {kind}, which has "
            "none; leave "
            "faces out"
        )
        return
    present = faces_present(scene, boundary)
    for face in cell.faces:
        if face not in present:
            check.fail(f"faces has '{face}'; boundary '{cell.boundary}' has {', '.join(present)}")
