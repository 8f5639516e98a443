"""What a run of version 0.1 had, where today's default is another, for runs that continue."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from libmpm._src.boundaries.wall_cells import with_held_cells
from libmpm._src.materials.friction import with_cones

__all__ = ["with_old_defaults"]


def with_old_defaults(scene: Mapping[str, Any]) -> dict[str, Any]:
    """Return the scene of a checkpoint with cones and cells of walls named, as they acted."""
    return with_held_cells(with_cones(scene))
