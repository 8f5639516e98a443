"""Rules about rigid bodies: what they are not built for, and the step of a scene of them alone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from libmpm._src.base.values import Checker, shown
from libmpm._src.materials.rigid import Rigid
from libmpm._src.methods.method import FBar

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["check_rigid", "check_rigid_step"]


def check_rigid(check: Checker, scene: SceneData, body: Body) -> None:
    """Refuse what a rigid body does not have."""
    material = body.material
    assert isinstance(material, Rigid)
    for what in material.misfits(scene.dimension):
        check.fail(what)
    if scene.grid is not None:
        check.fail("Rigid on a grid of functions; expected square or cubic cells; leave grid out")
    for boundary in scene.boundaries:
        if any(r.asks_for_linear for r in boundary.responses):
            check.fail(
                f"Rigid beside boundary '{boundary.name}' with cell=\"linear\", of which its "
                'points know nothing; expected held nodes; use cell="auto", or "held"'
            )
    given = {
        "fbar": (isinstance(body.fbar, FBar), body.fbar),
        "smoothing": (body.smoothing is not None, body.smoothing),
        "assumed": (body.assumed is not None, body.assumed),
        "stress": (body.stress is not None, body.stress),
        "damping": (body.damping > 0, body.damping),
        "force": (body.force is not None, body.force),
        "transfer": (body.transfer is not None, body.transfer),
    }
    for name, (is_given, item) in given.items():
        if is_given:
            check.fail(
                f"{name} is {shown(item, 80)} for Rigid, which has no strain and moves as a whole; "
                "expected none; leave it out"
            )


def check_rigid_step(scene: SceneData, problems: list[str]) -> None:
    """Refuse a scene of rigid bodies alone without a time step."""
    every = scene.bodies
    alone = bool(every) and all(isinstance(b.material, Rigid) for b in every)
    if alone and scene.method.time_step is None:
        problems.append(
            f"body '{every[0].name}': rigid, as all bodies of the scene are, so that there is no "
            "wave from which a time step could follow; expected a given one; use "
            "Method(time_step=) in s, in which no body crosses half a cell"
        )
