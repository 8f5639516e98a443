"""Structures and debris at their surfaces: edges of boxes, friction of a bed on solids alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Literal

from libmpm._src.base.values import nearest, shown
from libmpm._src.boundaries.contact_laws import Fluid, Friction
from libmpm._src.boundaries.responses import Separable
from libmpm._src.errors import SceneError
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.combined import Intersection
from libmpm._src.shapes.primitives import HalfSpace
from libmpm._src.shapes.solid import Solid

__all__ = [
    "BETWEEN_PIECES", "CONTACT_TEXT", "EDGES", "EDGE_TEXT", "FRICTION", "UPLIFT_TEXT", "Edges",
    "add_bed_friction", "add_contacts", "add_structure", "bevelled", "friction",
    "structure_solid",
]  # fmt: skip

Edges = Literal["free", "bevel"]
EDGES = ("free", "bevel")

#: What a field `edges` means, for the facilities that have one.
EDGE_TEXT = (
    '"free": a box on faces of cells, whose faces hold the nodes beside them while nodes that '
    'touch an edge or a corner alone are free; "bevel": edges cut at 45° by one cell, a surface'
)

#: What a field `contact` means, for the facilities that have one.
CONTACT_TEXT = (
    "μ between pieces of debris, which then have velocities of their own, touch each other and are "
    "pushed by water; None = all bodies share one velocity at a node"
)

#: What a field `uplift` means, for the facilities that have one.
UPLIFT_TEXT = (
    "whether water in the gap below debris on the bed takes its part of the weight "
    "(`Scene.add_boundary`); False: bases are sealed"
)

#: Coulomb friction μ of debris on a bed, with its source: (debris, bed, state) -> (μ, source).
FRICTION: Mapping[tuple[str, str, str], tuple[float, str]] = {
    ("hdpe", "concrete", "dry"): (0.66, "Bonus (2023) chapter 8, after Park et al. (2021)"),
    ("hdpe", "concrete", "wet"): (0.38, "Bonus (2023) chapter 8, after Park et al. (2021)"),
    ("wood", "concrete", "dry"): (1.28, "Bonus (2023) chapter 8, after Park et al. (2021)"),
    ("wood", "concrete", "wet"): (0.71, "Bonus (2023) chapter 8, after Park et al. (2021)"),
    ("hdpe", "plywood", "dry"): (0.4, "example hdro-0004 of HydroUQ, HDPE on plywood"),
    ("hdpe", "plywood", "claymore"): (0.25, "public ClaymoreUW scene of the Waseda basin"),
}


#: μ between pieces of debris in set-ups that were measured; nothing is documented.
BETWEEN_PIECES = 0.3


def friction(debris: str, bed: str, state: str = "wet") -> float:
    """Return a documented μ of debris on a bed, such as ("hdpe", "concrete", "wet"): 0.38.

    `FRICTION` has all of them with their sources. Raises `SceneError`.
    """
    key = (debris, bed, state)
    if key not in FRICTION:
        names = [", ".join(one) for one in FRICTION]
        raise SceneError(f"flumes.friction: there is no value of {shown(', '.join(key))}; "
                         f"{nearest(', '.join(key), names)}")  # fmt: skip
    return FRICTION[key][0]


def add_bed_friction(
    scene: Scene,
    shape: Solid,
    by_body: Mapping[str, float],
    name: str = "bed-friction",
    *,
    uplift: bool = False,
) -> tuple[str, ...]:
    """Add friction of a bed on some bodies alone, and return the names of the boundaries.

    ========  ====  =====  ====================================================================
    argument  unit  range  meaning
    ========  ====  =====  ====================================================================
    scene     -     -      the scene, whose bed is another boundary, which does not rub
    shape     m     -      the bed's shape
    by_body   1     ≥ 0    μ by name of the body, static and dynamic alike
    name      -     -      of the boundary; with several it is numbered
    uplift    -     -      water below the bodies takes its part of their weight; see
                           `Scene.add_boundary`
    ========  ====  =====  ====================================================================

    Friction holds debris and not water, so it is a second boundary in the bed's place, of held
    nodes, that acts on the share of a node's mass that is of those bodies: bodies of one μ, and
    with uplift of one density, have one. It rubs with what presses on both, to 1 % where the bed's
    nodes are held, as under solids that have contact; beside lines of linear cells, in bodies that
    share the water's velocities, it is 8 to 30 % too strong. The bed should let solids go
    (`boundaries.Separable`). Raises `SceneError`.
    """
    density = {b.name: float(b.material.parameters()["density"]) for b in scene.bodies}
    alike = {body: (mu, density.get(body, 0.0) if uplift else 0.0) for body, mu in by_body.items()}
    kinds = sorted(set(alike.values()))
    made = []
    for k, kind in enumerate(kinds, 1):
        mu, bodies = kind[0], tuple(b for b, one in alike.items() if one == kind)
        made.append(scene.add_boundary(
            name=name if len(kinds) == 1 else f"{name}-{k}", shape=shape, bodies=bodies,
            response=Separable(static_friction=mu, dynamic_friction=mu), uplift=uplift,
        ))  # fmt: skip
    return tuple(made)


def bevelled(box: Box, cut: float) -> Solid:
    """Return a box whose edges are cut at 45° by `cut` m of each face beside them.

    Raises `SceneError` where an edge is shorter than two cuts.
    """
    edges = [b - a for a, b in zip(box.lower, box.upper, strict=True)]
    if not 0 < cut < 0.5 * min(edges):
        raise SceneError(f"flumes.bevelled: cut is {cut:g} m of a box with an edge of "
                         f"{min(edges):g} m; expected > 0 and less than half of it; use smaller "
                         "cells, or edges='free'")  # fmt: skip
    planes = []
    sides = (box.lower, box.upper)
    for a, b in itertools.combinations(range(len(edges)), 2):
        for i, j in itertools.product((0, 1), repeat=2):
            normal = [0.0] * len(edges)
            normal[a], normal[b] = (1.0 if i else -1.0), (1.0 if j else -1.0)
            point = [0.5 * (u + v) for u, v in zip(*sides, strict=True)]
            point[a] = sides[i][a] - normal[a] * cut
            point[b] = sides[j][b]
            planes.append(HalfSpace(point=tuple(point), normal=tuple(normal)))
    return Intersection(parts=(box, *planes))


def structure_solid(box: Box, edges: Edges, cell_size: float, half: bool = False) -> Solid:
    """Return a box with free edges as it is, or a surface whose edges are cut by one cell.

    With `half` the box lies against the plane of symmetry y = 0, and the surface is that of all
    of it. Raises `SceneError`.
    """
    if edges == "free":
        return box
    lower = list(box.lower)
    if half and abs(lower[1]) < 1e-9:
        lower[1] = -box.upper[1]
    return bevelled(Box(lower=tuple(lower), upper=tuple(box.upper)), cell_size)


def add_structure(
    scene: Scene, name: str, box: Box, edges: Edges, *, half: bool = False, contact: bool = False
) -> str:
    """Add a rigid box that lets water go as a boundary; see `structure_solid`.

    Its cells are linear by name; with `contact` they are the scene's own choice, which holds debris
    there (`docs/contact.md`).
    """
    shape = structure_solid(box, edges, scene.cell_size, half)
    response = Separable(cell="auto" if contact else "linear")
    return scene.add_boundary(name=name, shape=shape, response=response)


def add_contacts(scene: Scene, friction: float | None, *, water: bool = True) -> None:
    """Let bodies "debris..." touch with Coulomb friction, and fluids without; None adds nothing.

    Contacts are "debris", where there are two pieces or more, and "afloat" for each fluid, the
    second and later ones numbered. `water` False leaves out fluids, where an inflow feeds them.
    """
    if friction is None:
        return
    pieces = [b for b in scene.bodies if b.name.startswith("debris")]
    fluids = [b.name for b in scene.bodies if b.material.table.stores_volume] if water else []
    if len(pieces) > 1:
        scene.add_contact(name="debris", between=("debris*", "debris*"),
                          law=Friction(static=friction))  # fmt: skip
    for k, name in enumerate(fluids, 1):
        scene.add_contact(name="afloat" if k == 1 else f"afloat-{k}", between=("debris*", name),
                          law=Fluid())  # fmt: skip
