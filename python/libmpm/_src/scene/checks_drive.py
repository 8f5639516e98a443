"""Warns of water that nothing drives: no gravity, no velocity, nothing that moves or flows in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Prescribed

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["undriven"]


def undriven(scene: SceneData) -> list[str]:
    """Return a doubt for a scene of fluids in which all would stay as it is; else nothing."""
    gravity = scene.gravity.value if isinstance(scene.gravity, TimeTable) else scene.gravity
    fluids = [b.name for b in scene.bodies if b.material.table.needs == "volume"]
    if not fluids or np.any(gravity) or scene.flows or any(map(_moves, scene.bodies)):
        return []
    for boundary in scene.boundaries:
        if not boundary.at_rest:
            return []
        if any(isinstance(response, Prescribed) for response in boundary.responses):
            return []
    down = ", ".join(["0"] * (scene.dimension - 1) + ["-9.81"])
    return [
        f"body '{fluids[0]}': gravity is zero, and neither a velocity nor a boundary, a flow or a "
        f"force moves anything: it would stay as it is; expected one of them; use "
        f"Scene(gravity=({down}))"
    ]


def _moves(body: Body) -> bool:
    """Tell whether a body has a velocity, or something that gives it one."""
    given = body.velocity
    still = isinstance(given, list | tuple | np.ndarray) and not np.any(given)
    return not still or bool(body.tractions) or body.force is not None or body.stress is not None
