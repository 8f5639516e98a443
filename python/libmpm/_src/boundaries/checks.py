"""Rules about boundaries: their motion, their responses, and those that are surfaces."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.time_tables import TimeTable, check_vector_table
from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.boundaries.checks_uplift import check_uplift
from libmpm._src.boundaries.covered_faces import uncovered_by_motion
from libmpm._src.boundaries.distance_field import FIELD_EDGE, distance_field, layer_of
from libmpm._src.boundaries.responses import Displacement, Mirror, Prescribed, Travel
from libmpm._src.boundaries.wall_cells import FILTERS, keeps_whole_velocity
from libmpm._src.errors import SceneError
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.combined import Difference, Intersection
from libmpm._src.shapes.solid import Array, Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary, PlacedSensor

__all__ = [
    "check_edges",
    "check_motion",
    "check_reaction",
    "check_responses",
    "check_surface",
    "doubts_of_linear",
]

#: Cells beyond its layer in which a boundary may hold nodes ahead of an edge; 0.4 at right angles.
_AHEAD = 1.0

#: Nodes that are looked at, and steps towards the surface from each.
_NODES = 1 << 14
_STEPS = 50

#: Schemes whose filters pass over the grid between the sums and the boundaries.


def check_motion(check: Checker, scene: SceneData, boundary: Boundary) -> None:
    """Check the motion of a boundary and where it acts."""
    d = scene.dimension
    motion = boundary.motion
    if isinstance(motion, TimeTable):
        check_vector_table(check, "motion", motion, d, "m/s")
    elif isinstance(motion, Displacement):
        check_vector_table(check, "motion", motion.table, d, "m")
    elif isinstance(motion, Travel):
        given = motion.velocity
        if isinstance(given, TimeTable):
            check_vector_table(check, "motion", given, d, "m/s")
        elif len(given) != d:
            check.fail(f"motion has {len(given)} numbers; expected {d} in m/s")
    within = boundary.within
    if within is not None and within.dimension != d:
        check.fail(f"within has {within.dimension} axes; expected {d}, those of the scene")
    turning = boundary.rotation
    if turning is not None and len(turning.about) != d:
        check.fail(f"rotation: about has {len(turning.about)} numbers; expected {d}")
    names = [b.name for b in scene.bodies]
    for name in boundary.bodies:
        if name not in names:
            check.fail(f"bodies has unknown body '{name}'; {nearest(name, names)}")
    if scene.grid is not None and (boundary.bodies or within is not None):
        check.fail("bodies and within are for square cells; expected neither on a grid")
    check_responses(check, scene, boundary)
    if boundary.uplift:
        check_uplift(check, scene, boundary)


def check_responses(check: Checker, scene: SceneData, boundary: Boundary) -> None:
    """Refuse responses where they mean nothing."""
    given = boundary.response
    if any(isinstance(r, Mirror) for r in boundary.responses):
        _check_mirror(check, scene, boundary)
    if any(r.asks_for_linear for r in boundary.responses):
        _check_linear(check, scene, boundary)
    if any(isinstance(r, Prescribed) for r in boundary.responses):
        if scene.grid is not None or not isinstance(boundary.shape, Solid):
            check.fail(
                f"response is {shown(given)} with {type(boundary.shape).__name__}; expected "
                "the region "
                "as a Solid of shapes on square cells"
            )
        elif isinstance(given, Mapping):
            check.fail("response is Prescribed on faces; expected one for the whole region")
        if boundary.at_rest:
            check.fail(
                "response is Prescribed without motion; expected the velocity of the region; give "
                "motion=TimeTable(...) in m/s, or boundaries.Sticky() for a body at rest"
            )


def _check_mirror(check: Checker, scene: SceneData, boundary: Boundary) -> None:
    if scene.grid is not None:
        check.fail("response is Mirror on a grid of functions; expected Slip or Sticky")
        return
    if not isinstance(boundary.shape, DomainWalls):
        check.fail(
            f"response is Mirror with {type(boundary.shape).__name__}; expected DomainWalls; use "
            "Slip, or end the domain at the plane"
        )
    if boundary.motion is not None:
        check.fail("motion is given for a Mirror, which rests; expected None; use Slip")
    if boundary.within is not None or boundary.bodies:
        check.fail(
            "within or bodies is given for a Mirror, a plane of the whole scene; expected neither; "
            "use Slip"
        )
    method = scene.method
    if scene.transfer.scheme in FILTERS:
        check.fail(
            f"response is Mirror with transfer '{scene.transfer.scheme}', whose filter "
            "knows no mirrored nodes; expected another transfer, or Slip"
        )
    if method.kernel_choice.boundary:
        check.fail(
            "response is Mirror with a kernel whose functions end at the wall; expected another "
            "kernel, or Slip or Sticky"
        )
    if any(getattr(b.fbar, "form", "") == "split" for b in scene.bodies):
        check.fail(
            "response is Mirror with FBar(form='split'), whose average is made again without "
            "mirrored nodes; expected another form, or Slip"
        )
    if scene.transfer.stores_velocity and any(b.force is not None for b in scene.bodies):
        check.fail(
            "response is Mirror with a PlacedForce and transfer "
            f"'{scene.transfer.scheme}': what particles keep counts the force at mirrored "
            "nodes again, and speeds grow without bound; expected 'APIC' or 'PIC', or Slip"
        )


def _check_linear(check: Checker, scene: SceneData, boundary: Boundary) -> None:
    held = 'expected cell="held" here'
    if scene.grid is not None:
        check.fail(f'cell is "linear" on a grid of functions; {held}')
        return
    if boundary.layer is not None:
        check.fail(
            f'cell is "linear" with a layer, which would hold nodes by shares; {held}, or None'
        )
    if boundary.within is not None or boundary.bodies:
        check.fail(f'cell is "linear" within a region or for some bodies; {held}')
    method = scene.method
    if method.kernel_choice.name != "quadratic" or method.kernel_choice.boundary:
        check.fail(
            f'cell is "linear" with kernel "{method.kernel_choice.name}"; {held}, or the '
            'kernel "quadratic", whose functions the lines are made for'
        )
    if scene.transfer.scheme in FILTERS:
        check.fail(
            f"cell is \"linear\" with transfer '{scene.transfer.scheme}', whose filter "
            f"does not know the lines; {held}, or another transfer"
        )
    if any(isinstance(r, Mirror) for b in scene.boundaries for r in b.responses):
        check.fail(
            f'cell is "linear" in a scene with Mirror walls; {held}, or Slip(cell="linear") '
            "in place of the mirrors"
        )


def doubts_of_linear(scene: SceneData) -> list[str]:
    """Say where linear cells have been seen to fail in a long flow (`docs/boundaries.md`)."""
    by_name = [b for b in scene.boundaries if any(r.asks_for_linear for r in b.responses)]
    linear = [b.name for b in by_name]
    if not linear:
        return []
    found = []
    surfaces = [b.name for b in by_name if b.is_surface and not isinstance(b.shape, Box)]
    if surfaces and scene.contacts:
        found.append(
            f"boundary '{surfaces[0]}': cell is \"linear\" by name beside contacts: where a "
            "surface leans, bodies pushed along it gained energy in 2 of 8 scenes; expected "
            '"auto", which holds slopes there and has linear cells where it is level'
        )
    if transfer := keeps_whole_velocity(scene):
        found.append(
            f"boundary '{linear[0]}': linear cells with transfer '{transfer.scheme}', of which "
            "particles keep their whole velocity: one flume of 70 m has run to its end with it, in "
            "cells of 0.1 m, and earlier releases lost particles at a step of its bed; expected "
            "'APIC', or 'AFLIP' with flip=0.95, or Guard(...) to watch it"
        )
    return found


def check_surface(check: Checker, scene: SceneData, boundary: Boundary, doubts: list[str]) -> bool:
    """Check a boundary of any shape; returns whether it can be looked at further."""
    shape = boundary.shape
    assert isinstance(shape, Solid)
    d = scene.dimension
    if shape.dimension != d:
        check.fail(f"shape has {shape.dimension} axes; expected {d}, the dimension of the scene")
        return False
    spacing = boundary.spacing
    if spacing is not None and spacing > 2 * scene.cell_size:
        check.fail(
            f"spacing is {spacing:g} m with cells of {scene.cell_size:g} m; expected ≤ 2 cells, or "
            "the layer would fall between the points"
        )
    if check.problems:
        return False
    if not isinstance(shape, Box) or isinstance(boundary.response, Prescribed):
        thin = min(b - a for a, b in zip(*shape.bounds(), strict=True))
        if thin < scene.cell_size and not isinstance(boundary.response, Prescribed):
            check.fail(
                f"the shape is {thin:g} m thick; expected one cell or more, {scene.cell_size:g} m, "
                "or material would pass through it; thicken it or use a smaller cell_size"
            )
    try:
        distance_field(scene, boundary)
    except SceneError as error:
        check.problems += error.problems
        return False
    if faces := uncovered_by_motion(scene, boundary):
        doubts.append(
            f"boundary '{boundary.name}': stands on the wall {', '.join(faces)} and turns or moves "
            "off it, so that material within a cell of the wall passes along it; expected to reach "
            f"beyond the wall; make the shape {2 * scene.cell_size:g} m longer there"
        )
    return True


def check_edges(scene: SceneData, boundary: Boundary, doubts: list[str]) -> None:
    """Say where a boundary holds nodes far ahead of a sharp edge.

    Of intersections and differences the distance is a lower bound of the true one: ahead of an edge
    of angle α it is sin(α / 2) of that, and the layer so much longer.
    """
    if not isinstance(boundary.shape, Solid) or not _is_cut(boundary.shape):
        return
    if isinstance(boundary.response, Prescribed) or layer_of(boundary).function == "free":
        return
    reach = layer_of(boundary).thickness * scene.cell_size
    p, far = _layer(scene, boundary, reach)
    if len(p) == 0:
        return
    place = p.copy()
    for _ in range(_STEPS):
        away = boundary.shape.distance(place)
        if np.all(away < 1e-3 * scene.cell_size):
            break
        place -= np.maximum(away, 0.0)[:, None] * _direction(boundary.shape, place, scene.cell_size)
    way = np.sqrt(((place - p) ** 2).sum(axis=1))
    ahead = float((np.maximum(way, far) - reach).max()) / scene.cell_size
    if ahead > _AHEAD:
        doubts.append(
            f"boundary '{boundary.name}': ahead of a sharp edge it holds nodes up to "
            f"{ahead + reach / scene.cell_size:.1f} cells off, with a layer of "
            f"{reach / scene.cell_size:g}: the distance from an intersection or difference is a "
            "lower bound; expected edges of 60 degrees or more; draw the section as one Extrusion, "
            "or blunt the edge"
        )


def _is_cut(item: Any) -> bool:
    """Return whether a solid is made of an intersection or a difference."""
    if isinstance(item, Intersection | Difference):
        return True
    if isinstance(item, Solid):
        item = tuple(item.__getstate__().values())
    return isinstance(item, tuple) and any(_is_cut(x) for x in item if isinstance(x, Solid | tuple))


def _layer(scene: SceneData, boundary: Boundary, reach: float) -> tuple[Array, Array]:
    """Return points of the lattice in front of a surface that it holds, and their distances, m."""
    field = distance_field(scene, boundary)
    d = scene.dimension
    corners = np.array(list(itertools.product(range(FIELD_EDGE + 1), repeat=d)))
    keys = np.empty((len(field.values), d))
    shown = field.place >= 0
    keys[field.place[shown]] = field.keys[shown]
    far = field.values.astype(np.float64) * field.spacing
    row, corner = np.nonzero((far > 0.5 * reach) & (far <= reach))
    some = slice(None, None, max(1, len(row) // _NODES))
    row, corner = row[some], corner[some]
    lattice = keys[row] * FIELD_EDGE + corners[corner]
    points = lattice * field.spacing + np.asarray(scene.lower, dtype=np.float64)
    # Beyond walls distances are those of what the walls do not cover.
    inside = np.all((points >= scene.lower) & (points <= scene.upper), axis=1)
    return points[inside], far[row, corner][inside]


def _direction(shape: Solid, p: Array, scale: float) -> Array:
    """Return the direction (n, d) in which the distance grows."""
    moves = 1e-6 * scale * np.eye(p.shape[1])
    slope = np.stack([shape.distance(p + m) - shape.distance(p - m) for m in moves], axis=1)
    size = np.sqrt((slope * slope).sum(axis=1))
    return np.asarray(slope / np.where(size > 0, size, 1.0)[:, None])


def check_reaction(scene: SceneData, placed: PlacedSensor, doubts: list[str]) -> None:
    """Say where a load cell counts more or less momentum than the particles lose."""
    cell = placed.sensor
    if not isinstance(cell, LoadCell):
        return
    boundary = next((b for b in scene.boundaries if b.name == cell.boundary), None)
    if boundary is None:
        return
    transfer = scene.transfer
    if transfer.scheme == "FMPM":
        why = "passes over what walls have changed"
    elif transfer.stores_velocity and any(isinstance(r, Mirror) for r in boundary.responses):
        why = "gives particles only a share of what a mirror turns round"
    else:
        return
    doubts.append(
        f"sensor '{placed.name}': the force on boundary '{boundary.name}' with transfer "
        f"'{transfer.scheme}', which {why}; the momentum of the particles and that which the cell "
        "counts differ, by 2 to 30 % in small scenes; expected 'APIC', or Slip walls with the "
        "FLIP family"
    )
