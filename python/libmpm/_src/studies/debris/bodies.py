"""From the pieces of a field to the bodies of a scene."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from libmpm._src.base.values import Checker
from libmpm._src.scene.places import vertical_axis
from libmpm._src.shapes.boxes import OrientedBox
from libmpm._src.shapes.element_mesh import Tetrahedra, Triangles

if TYPE_CHECKING:
    from libmpm._src.scene.scene import Scene
    from libmpm._src.studies.debris.field import DebrisField

__all__ = ["add_to"]


def add_to(
    field: DebrisField,
    scene: Scene,
    *,
    elevation: float,
    name: str,
    edge: float | None,
    **options: Any,
) -> tuple[str, ...]:
    """Add a body for every piece; see `DebrisField.add_to`."""
    check = Checker(f"{field.label}.add_to")
    elevation = check.number("elevation", elevation, unit="m")
    check.text("name", name)
    if edge is not None:
        edge = check.number("edge", edge, lower=0, lower_open=True, unit="m")
    if not field.pieces:
        check.fail("there are no pieces; expected some to add")
    if scene.dimension == 2:
        if elevation:
            check.fail(
                f"elevation is {elevation:g} in 2D, where the scene is the plan itself; leave it "
                "out"
            )
        if len({p.elevation for p in field.pieces}) > 1:
            check.fail("the field has several layers; expected one in 2D, where none is above")
    elif vertical_axis(scene) != 2:
        check.fail(
            f"gravity points along {'xyz'[vertical_axis(scene)]}; expected z, which the debris "
            "stands on; turn the scene"
        )
    digits = len(str(len(field)))
    names = [f"{name}-{i:0{digits}}" for i in range(1, len(field) + 1)]
    taken = [n for n in names if n in {b.name for b in scene.bodies}]
    if taken:
        check.fail(f"body '{taken[0]}' is there already; expected new names; give another name")
    check.finish()
    for body, piece in zip(names, field.pieces, strict=True):
        kind = field.prototypes[piece.prototype]
        centre = [piece.x, piece.y, elevation + piece.elevation + 0.5 * kind.height]
        size = [kind.length, kind.width, kind.height]
        d = scene.dimension
        shape: Any = OrientedBox(centre=centre[:d], size=size[:d], angle=piece.angle)
        per_cell: int | None = kind.particles_per_cell
        if edge is not None:
            shape = (Triangles if d == 2 else Tetrahedra).fill(solid=shape, edge=edge)
            per_cell = None
        scene.add_body(
            name=body,
            shape=shape,
            material=kind.material,
            particles_per_cell=per_cell,
            **options,
        )
    return tuple(names)
