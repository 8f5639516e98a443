"""What water would lift and does not: light bodies on faces that hold them, or on a sealed base."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.boundaries.responses import Mirror, Response, Separable, Slip, Sticky
from libmpm._src.errors import SceneError
from libmpm._src.grids.shapes import Outline
from libmpm._src.materials.rigid import Rigid
from libmpm._src.scene.places import faces_present, initial_gravity
from libmpm._src.shapes.boxes import DomainWalls, faces_of
from libmpm._src.shapes.solid import GivenPoints, Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary

__all__ = ["held_down"]

#: Off their faces nothing comes.
_HOLD: tuple[type[Response], ...] = (Slip, Sticky, Mirror)
#: Cells above a face within which its nodes hold what lies there.
_REACH = 1.0


def held_down(scene: SceneData) -> list[str]:
    """Return which solids lighter than a fluid lie on a face off which nothing comes.

    Also which stand on one that lets go with a sealed base, as all do that share the velocity of
    the water at nodes, but for those with uplift.
    """
    gravity = initial_gravity(scene)
    if not np.any(gravity):
        return []
    axis = int(np.argmax(np.abs(gravity)))
    down = float(np.sign(gravity[axis]))
    density = {b.name: float(b.material.parameters()["density"]) for b in scene.bodies}
    fluids = [b for b in scene.bodies if b.material.table.stores_volume]
    if not fluids:
        return []
    heaviest = max(fluids, key=lambda b: density[b.name])
    # Walls push rigid bodies and never pull them.
    light = [b for b in scene.bodies
             if not b.material.table.stores_volume and not isinstance(b.material, Rigid)
             and not b.pins and density[b.name] < density[heaviest.name]]  # fmt: skip
    # Of these nothing is to be said of a sealed base: not of one with uplift, of others once.
    told = {name for b in scene.boundaries if b.uplift for name in b.bodies}
    found = []
    for boundary in scene.boundaries:
        if not boundary.at_rest or boundary.time is not None or boundary.within is not None:
            continue
        here = [b for b in light if not boundary.bodies or b.name in boundary.bodies]
        on = [b for b in here if _lies_on(scene, b, boundary, axis, down, _HOLD)]
        sealed = [b for b in here
                  if not scene.contacts and b.name not in told
                  and _lies_on(scene, b, boundary, axis, down, (Separable,))]  # fmt: skip
        told |= {b.name for b in sealed}
        if not on and not sealed:
            continue
        first, more = (on or sealed)[0].name, len(on or sealed) - 1
        who = f"body '{first}'" + (f" (and {more} more)" if more else "")
        weights = (f"is lighter than '{heaviest.name}' ({density[first]:g} of "
                   f"{density[heaviest.name]:g} kg/m³)")  # fmt: skip
        found.append(
            f"{who}: lies on boundary '{boundary.name}', off whose face nothing comes, and "
            f"{weights}: water that reaches it does not lift it; expected a face that lets go; use "
            "boundaries.Separable there"
            if on else
            f"{who}: stands on boundary '{boundary.name}' and {weights}, whose velocity it shares "
            "at nodes: its base is sealed, so that it rubs with all of its weight and does not "
            "float off; expected uplift=True of a boundary for it, or a contact with the fluid"
        )  # fmt: skip
    return found


def _lies_on(
    scene: SceneData,
    body: Body,
    boundary: Boundary,
    axis: int,
    down: float,
    responses: tuple[type[Response], ...],
) -> bool:
    """Return whether a body begins within a cell above a face with one of the responses."""
    shape, solid = body.shape, boundary.shape
    if not isinstance(shape, Solid | GivenPoints) or isinstance(solid, Outline):
        return False
    try:
        bounds = np.asarray(shape.bounds(), dtype=np.float64)
    except SceneError:
        return False
    side = 0 if down < 0 else 1
    reach = _REACH * scene.cell_size
    walls = isinstance(solid, DomainWalls)
    # The domain's lowest face; of a box the one that looks up.
    face = faces_of(scene.dimension)[2 * axis + (side if walls else 1 - side)]
    if walls and face not in faces_present(scene, boundary):
        return False
    if not isinstance(boundary.response_at(face), responses):
        return False
    if isinstance(solid, DomainWalls):
        wall = (scene.lower, scene.upper)[side][axis]
        return bool(abs(bounds[side][axis] - wall) < reach)
    foot = [np.linspace(bounds[0][a], bounds[1][a], 5)[1:-1] for a in range(scene.dimension)]
    foot[axis] = bounds[side][axis : axis + 1]
    points = np.array(list(itertools.product(*foot)))
    return bool(np.any(solid.distance(points) < reach))
