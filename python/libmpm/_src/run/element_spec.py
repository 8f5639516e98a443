"""What the engine is told of a body of elements besides what it is told of particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable, constant, engine_table
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import flows_at_constant_volume
from libmpm._src.run.hydrostatic import at_hand
from libmpm._src.scene.checks_elements import LARGEST_STRESS
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.element_surface import chosen_faces, chosen_vertices, shares

if TYPE_CHECKING:
    from libmpm._src.grids.shapes import Traction
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
    told = {
        "elements": np.ascontiguousarray(mesh.elements, dtype=np.int32),
        "element_volumes": mesh.volumes_for(ratio, flows=flows_at_constant_volume(body.material)),
        "position": at_hand(points),
    }
    if body.stress is not None:
        told["element_stress"] = _stress(body, mesh, ratio or 0.0).ravel()
    if body.tractions:
        told["tractions"] = [_traction(mesh, t) for t in body.tractions]
    if body.pins:
        told["pins"] = [
            {
                "vertices": chosen_vertices(mesh, pin.face, pin.within).tolist(),
                "axes": list(pin.axes(mesh.dimension)),
                "displacement": None if pin.motion is None else engine_table(pin.motion.table),
            }
            for pin in body.pins
        ]
    return told


def _stress(body: Body, mesh: ElementMesh, ratio: float) -> npt.NDArray[np.float64]:
    """Return Cauchy stresses at rest by element, (m, 4 or 6) Pa; in 2D zz follows, last."""
    assert body.stress is not None
    if isinstance(body.stress, Field):
        middle = mesh.positions()[mesh.elements].mean(axis=1)
        stress = body.stress.at(middle, f"body '{body.name}': stress")
        largest = np.abs(stress).max(axis=1)
        most = LARGEST_STRESS * body.material.parameters()["youngs_modulus"]
        if (beyond := np.flatnonzero(largest > most)).size:
            first = beyond[0]
            at = ", ".join(f"{x:g}" for x in middle[first])
            raise SceneError(
                f"body '{body.name}': stress is beyond {LARGEST_STRESS:g} of Young's modulus, "
                f"{most:g} Pa, in {beyond.size} elements, the first {first} at ({at}) m with "
                f"{largest[first]:g} Pa; time steps are those of the law alone; give less"
            )
    else:
        stress = np.tile(np.asarray(body.stress, dtype=np.float64), (len(mesh.elements), 1))
    if mesh.dimension == 2:
        stress = np.column_stack([stress, ratio * (stress[:, 0] + stress[:, 1])])
    return stress


def _traction(mesh: ElementMesh, traction: Traction) -> dict[str, Any]:
    """Return the vertices that a traction acts on, and the area of each."""
    which, area = shares(mesh, chosen_faces(mesh, traction.face, traction.within))
    value = traction.value
    table = value if isinstance(value, TimeTable) else constant(value)
    return {"particles": which.tolist(), "area": area.tolist(), "value": engine_table(table)}
