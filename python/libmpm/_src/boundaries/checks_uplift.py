"""Where water in the gap below solids (`uplift` of a boundary) is not known, or would be twice."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker
from libmpm._src.boundaries.covered_faces import distances_of
from libmpm._src.boundaries.distance_field import FIELD_EDGE, distance_field
from libmpm._src.boundaries.responses import Mirror, Sticky
from libmpm._src.boundaries.wall_cells import linear_by_default, strains_linearly
from libmpm._src.errors import SceneError
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.solid import Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["check_uplift"]

#: Points near two surfaces that are asked whether these are one.
_POINTS_ASKED = 20000


def check_uplift(check: Checker, scene: SceneData, boundary: Boundary) -> None:
    """Refuse water in a gap where there is none, or where it is not known."""
    named = [b for b in scene.bodies if b.name in boundary.bodies]
    if not boundary.bodies:
        check.fail("uplift is True for all bodies; expected solids alone; give bodies=('block',)")
    for body in named:
        if body.material.table.stores_volume:
            check.fail(f"uplift is True with body '{body.name}', a fluid; expected solids alone")
    densities = sorted({float(body.material.parameters()["density"]) for body in named})
    if len(densities) > 1:
        check.fail(
            f"uplift is True for bodies of {densities[0]:g} to {densities[-1]:g} kg/m³; expected "
            "one density; give a boundary for each"
        )
    fluids = [b for b in scene.bodies if b.material.table.stores_volume]
    if not fluids or any(b.fbar is None for b in fluids):
        check.fail("uplift is True without fluids whose volumes are averaged; expected them, since "
                   "others count as solids; leave fbar='default'")  # fmt: skip
    if isinstance(scene.gravity, TimeTable) or not any(scene.gravity):
        check.fail("uplift is True without gravity that stays as it is; expected it, since water "
                   "presses against it; give gravity in m/s²")  # fmt: skip
    if any(isinstance(r, Sticky) for r in boundary.responses):
        check.fail("uplift is True of a Sticky boundary; expected one that bodies slide on and "
                   "come off; use Separable")  # fmt: skip
    if boundary.layer is not None:
        check.fail("uplift is True with a layer; expected layer=None, since a layer holds nodes by "
                   "parts")  # fmt: skip
    by_default = linear_by_default(scene)
    for other in scene.boundaries:
        lined = other.is_surface and strains_linearly(scene, other, "", by_default)
        layered = other.layer is not None and other is not boundary
        if not (lined or layered) or not other.at_rest:
            continue
        if other is not boundary and not _in_one_place(scene, boundary, other):
            continue
        if lined:
            check.fail(
                f"uplift is True beside boundary '{other.name}', a surface in its place, or that "
                "goes on from it, whose cells are linear and nodes move as lines; expected held "
                "nodes; give its response cell='held'"
            )
        else:
            check.fail(f"uplift is True beside boundary '{other.name}', a surface in its place "
                       "whose layer holds nodes by parts; expected layer=None of it")  # fmt: skip
    for other in scene.boundaries:
        both = sorted(set(boundary.bodies) & set(other.bodies))
        apart = other.window[0] >= boundary.window[1] or boundary.window[0] >= other.window[1]
        if other is not boundary and other.uplift and both and not apart:
            check.fail(
                f"uplift is True for body '{both[0]}', which boundary '{other.name}' lifts too; "
                "expected one boundary with uplift for a body; join their shapes (a | b)"
            )
    if not boundary.at_rest:
        check.fail("uplift is True of a boundary that moves; expected one at rest")
    kernel = scene.method.kernel_choice
    if kernel.name != "quadratic" or kernel.boundary:
        check.fail(f"uplift is True with {kernel.text()}; expected plain quadratic splines")
    if any(isinstance(r, Mirror) for b in scene.boundaries for r in b.responses):
        check.fail("uplift is True beside a Mirror; expected other walls; use Slip")


def _in_one_place(scene: SceneData, boundary: Boundary, other: Boundary) -> bool:
    """Return whether a surface lies in the place of a boundary anywhere, by distance and normal."""
    cell, d = scene.cell_size, scene.dimension
    shapes = [s for s in (boundary.shape, other.shape) if not isinstance(s, DomainWalls)]
    if any(not isinstance(s, Solid) or s.dimension != d for s in shapes):
        return False  # which is said elsewhere
    try:
        field = distance_field(scene, other)
    except SceneError:
        return False
    near = np.abs(field.values) * field.spacing <= 1.5 * cell
    block, corner = np.nonzero(near)
    shown = field.keys[field.place >= 0][np.argsort(field.place[field.place >= 0])]
    corners = np.array(list(itertools.product(range(FIELD_EDGE + 1), repeat=d)))
    points = (shown[block] * FIELD_EDGE + corners[corner]) * field.spacing
    points += np.asarray(scene.lower)
    assert isinstance(other.shape, Solid)
    for distance in distances_of(scene, boundary):
        there = points[np.abs(distance(points)) <= 2 * cell]
        there = there[:: max(1, len(there) // _POINTS_ASKED)]
        same = np.ones(len(there), dtype=bool)
        for step in np.vstack([np.zeros(d), 0.5 * cell * np.eye(d)]):
            same &= (
                np.abs(distance(there + step) - other.shape.distance(there + step)) < 0.05 * cell
            )
        if same.any():
            return True
    return False
