"""What the engine is told of a body of elements besides what it is told of particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.run.hydrostatic import at_hand
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.scene.parts import Body
    from libmpm._src.shapes.lattices import Rows

__all__ = ["mesh_part"]


def mesh_part(body: Body, points: Rows) -> dict[str, Any]:
    """Return elements and vertices, in the mesh's order; nothing of a body of particles.

    Masses of vertices are the engine's to work out: m_v = Σ ρ V / (d + 1) over a vertex' elements,
    so that `particle_mass` is their mean.
    """
    mesh = body.shape
    if not isinstance(mesh, ElementMesh):
        return {}
    ratio = body.material.parameters().get("poissons_ratio")
    return {
        "elements": np.ascontiguousarray(mesh.elements, dtype=np.int32),
        "element_volumes": mesh.volumes_for(ratio),
        "position": at_hand(points),
    }
