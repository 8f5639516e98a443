"""How the cells beside walls strain: what `cell="auto"` of `Slip` and `Separable` stands for.

Held nodes strain the cell beside a wall by half, and the pressure and the load of a flow there are
wrong by several times; linear cells have both right (`design/walls.md`, 7). They are what a scene
with water gets wherever they have been measured to hold, and held nodes everywhere else.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from libmpm._src.boundaries.responses import Mirror
from libmpm._src.materials.rigid import Rigid
from libmpm._src.shapes.boxes import DomainWalls

if TYPE_CHECKING:
    from libmpm._src.methods.transfer import Transfer
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["FILTERS", "KEPT", "by_caution", "keeps_whole_velocity", "linear_by_default"]
__all__ += ["strains_linearly", "with_held_cells"]

#: Transfers that filter velocities over the grid and do not know lines of nodes.
FILTERS = ("XPIC", "FMPM")
#: Share of its velocity that a particle may keep beside linear cells by default: with those that
#: keep more one flume alone has been run.
KEPT = 0.99


def keeps_whole_velocity(scene: SceneData) -> Transfer | None:
    """Return a transfer of which particles keep (nearly) their whole velocity, if there is one."""
    every = [scene.transfer, *(b.transfer for b in scene.bodies if b.transfer)]
    return next((t for t in every if t.stores_velocity and t.kept > KEPT), None)


def linear_by_default(scene: SceneData) -> bool:
    """Whether "auto" is "linear" at walls and surfaces that rest in this scene.

    There is a fluid, functions are plain quadratic splines, and neither method nor other walls know
    nothing of lines of nodes.
    """
    method = scene.method
    return (
        scene.grid is None
        and not any(isinstance(body.material, Rigid) for body in scene.bodies)
        and method.kernel_choice.name == "quadratic"
        and not method.kernel_choice.boundary
        and scene.transfer.scheme not in FILTERS
        and keeps_whole_velocity(scene) is None
        and any(body.material.table.stores_volume for body in scene.bodies)
        and not any(getattr(body.fbar, "form", "") == "split" for body in scene.bodies)
        and not any(isinstance(r, Mirror) for b in scene.boundaries for r in b.responses)
    )


def strains_linearly(
    scene: SceneData, boundary: Boundary, face: str, by_default: bool | None = None
) -> bool:
    """Whether the cells beside a face ("" where there is none) of a boundary strain linearly.

    Where "auto" stands for that (`by_caution`), the engine still holds nodes beside surfaces that
    are round or steep, in corners of a slope and a wall, and where something that moves may come
    within three cells: drops creep between the two there. Walls of a domain one cell across are
    held: between linear ones water on a slope went from rest to 250 m/s in 0.1 s.
    `by_default` is `linear_by_default(scene)` where it is known already.
    """
    cell = getattr(boundary.response_at(face), "cell", "held")
    if cell != "auto":
        return bool(cell == "linear")
    plain = boundary.layer is None and boundary.within is None and not boundary.bodies
    if not boundary.at_rest or not plain or not (face or boundary.is_surface):
        return False
    if not (linear_by_default(scene) if by_default is None else by_default):
        return False
    walls = isinstance(boundary.shape, DomainWalls)
    return not walls or scene.cells["xyz".index(face[0])] > 1


def by_caution(boundary: Boundary, face: str) -> bool:
    """Whether linear cells beside a face are by default, not by name."""
    return getattr(boundary.response_at(face), "cell", "held") == "auto"


def with_held_cells(scene: Mapping[str, Any], *, auto: bool = False) -> dict[str, Any]:
    """Return the scene of a run whose walls name no cell, as until 0.1, with the held nodes it had.

    Runs that continue keep their walls; a scene file that names none asks for "auto". With `auto`
    those that say so are held too, for comparisons with what was measured so.
    """
    given = scene.get("boundaries", ())
    if not isinstance(given, list | tuple):  # as the scene's own reader will say
        return dict(scene)
    boundaries = []
    for boundary in given:
        if isinstance(boundary, Mapping) and "response" in boundary:
            boundary = dict(boundary) | {"response": _held(boundary["response"], auto)}
        boundaries.append(boundary)
    return dict(scene) | {"boundaries": boundaries}


def _held(response: Any, auto: bool) -> Any:
    if not isinstance(response, Mapping):
        return response
    if "type" not in response:  # by face
        return {face: _held(one, auto) for face, one in response.items()}
    if response["type"] not in ("Slip", "Separable"):
        return response
    named = response.get("cell", "held")
    return dict(response) | {"cell": "held" if auto and named == "auto" else named}
