"""Rules about bodies of elements: edges against cells, laws, and what they are not built for."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker, shown
from libmpm._src.materials.initial_stress import PLANE, SPACE
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.method import FBar
from libmpm._src.scene.places import initial_gravity
from libmpm._src.shapes.element_mesh import ElementMesh
from libmpm._src.shapes.element_surface import chosen_faces, chosen_vertices
from libmpm._src.shapes.mesh_inside import MeshInside
from libmpm._src.shapes.oriented_boxes import close_pairs

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = [
    "LAWS",
    "LONGEST",
    "check_continued",
    "check_elements",
    "check_mesh_overlaps",
    "faint_strains",
]

#: Laws that follow from the deformation gradient of an element alone, and that flow.
LAWS = (
    "FixedCorotated", "NeoHookean", "StVenantKirchhoffHencky", "VonMises", "DruckerPrager",
)  # fmt: skip
#: Those of them that flow.
FLOWING = ("VonMises", "DruckerPrager")
#: Largest part of Young's modulus that a stress at rest may have: it makes waves faster.
LARGEST_STRESS = 0.25
#: Longest edge over √d, in cells: beyond it nodes between vertices are empty, and a pressed block
#: of 2 went through what it lay on.
LONGEST = 1.05
#: Edges, in cells, that a thin part needs shorter ones than, and (cells of thickness, error of a
#: cantilever's frequency in % with h = Δx).
_COARSE = 0.75
_STIFF = ((2.0, 25), (4.0, 6), (6.0, 2))
#: Part of the wave speed of a body below which edges as long as cells lose the force of an impact.
_SLOW = 0.01
#: Strain that single precision resolves.
_RESOLVED = 1e-7


def check_elements(check: Checker, scene: SceneData, body: Body, doubts: list[str]) -> None:
    """Check a body of elements in a scene of its dimension."""
    mesh = body.shape
    assert isinstance(mesh, ElementMesh)
    d, dx = scene.dimension, scene.cell_size
    if mesh.edge > LONGEST * dx * (1 + 1e-9):
        need = mesh.edge / LONGEST
        check.fail(
            f"longest edge {mesh.longest_edge:.4g} m, that is {mesh.edge / dx:.3g} cells by √{d}; "
            f"expected ≤ {LONGEST:g}, beyond which other bodies pass between its vertices; use a "
            f"cell_size ≥ {need:.4g} m, or mesh with edge ≤ {LONGEST * dx:.4g} m"
        )
    _check_unbuilt(check, scene, body)
    _check_tractions(check, scene, body)
    _check_pins(check, scene, body)
    _check_stress(check, scene, body)
    _doubt_thin(scene, body, mesh, doubts)
    _doubt_slow(scene, body, mesh, doubts)


def check_continued(scene: SceneData, problems: list[str]) -> None:
    """Refuse scenes that continue from a run whose own bodies are of elements."""
    if scene.start is None:
        return
    for body in scene.bodies:
        if isinstance(body.shape, ElementMesh) and scene.start.restored(body.name) is not None:
            problems.append(
                f"body '{body.name}': {body.shape.label} of the run that the scene continues from; "
                "expected bodies of particles there; resume the run itself, or begin afresh"
            )


def _check_unbuilt(check: Checker, scene: SceneData, body: Body) -> None:
    """Refuse what bodies of elements do not have."""
    law = body.material.table.name
    if law not in LAWS or body.material.added:
        check.fail(
            f"material is {law} for elements; expected one of {', '.join(LAWS)}; make it of "
            "particles, or choose one of these"
        )
    elif law == "DruckerPrager":
        _check_dilatant(check, body)
    per_cell = 2**scene.dimension
    holes = [b.name for b in scene.bodies if body.name in b.subtract_from]
    given = {
        "particles_per_cell": (body.particles_per_cell != per_cell, body.particles_per_cell,
                               "the vertices are the particles; leave it out"),
        "sampling": (body.sampling is not None, body.sampling,
                     "the vertices are given; leave it out"),
        "fbar": (isinstance(body.fbar, FBar), body.fbar,
                 "volumes='vertex' of the mesh serves in its place; leave it out"),
        "smoothing": (body.smoothing is not None, body.smoothing, "leave it out"),
        "assumed": (body.assumed is not None, body.assumed, "leave it out"),
        "force": (body.force is not None, body.force, "leave it out"),
    }  # fmt: skip
    for name, (is_given, item, why) in given.items():
        if is_given:
            check.fail(f"{name} is {shown(item, 80)} for a body of elements; {why}")
    if holes:
        check.fail(
            f"it is named by subtract_from of {', '.join(repr(n) for n in holes)}; expected a body "
            "of particles, since elements cannot be taken out of a mesh; mesh it with the hole"
        )


def _check_dilatant(check: Checker, body: Body) -> None:
    """Refuse volumes of vertices where a law's own volume flows."""
    mesh = body.shape
    assert isinstance(mesh, ElementMesh)
    if mesh.volumes_for(body.material.parameters().get("poissons_ratio")) == "vertex":
        check.fail(
            "volumes are the vertices', of DruckerPrager, whose volume flows; expected "
            "volumes='element' of the mesh (the default takes the vertices' where Poisson's ratio "
            "is 0.4 or more)"
        )


def _check_tractions(check: Checker, scene: SceneData, body: Body) -> None:
    mesh = body.shape
    assert isinstance(mesh, ElementMesh)
    for k, traction in enumerate(body.tractions):
        wrong = traction._misfits(scene.dimension)
        for what in wrong:
            check.fail(f"tractions[{k}]: {what}")
        if wrong or len(chosen_faces(mesh, traction.face, traction.within)):
            continue
        check.fail(
            f"tractions[{k}]: no outer face of the mesh has all its vertices there (face "
            f"{traction.face!r}, within {shown(traction.within, 80)}); expected some; "
            f"{_reach(mesh)}"
        )


def _check_pins(check: Checker, scene: SceneData, body: Body) -> None:
    mesh = body.shape
    assert isinstance(mesh, ElementMesh)
    owner = np.full(mesh.count, -1)
    for k, pin in enumerate(body.pins):
        wrong = pin._misfits(scene.dimension)
        for what in wrong:
            check.fail(f"pins[{k}]: {what}")
        if wrong:
            continue
        chosen = chosen_vertices(mesh, pin.face, pin.within)
        if not len(chosen):
            check.fail(
                f"pins[{k}]: no vertex of the mesh lies there (face {pin.face!r}, within "
                f"{shown(pin.within, 80)}); expected some; {_reach(mesh)}"
            )
        twice = chosen[owner[chosen] >= 0]
        if len(twice):
            check.fail(
                f"pins[{k}]: {len(twice)} of its vertices, the first {twice[0]}, are pins"
                f"[{owner[twice[0]]}]'s too; expected each in one pin; make `within` smaller"
            )
        owner[chosen] = k


def _check_stress(check: Checker, scene: SceneData, body: Body) -> None:
    """Check a stress at rest, of a body that elements' laws have."""
    stress, have = body.stress, body.material.parameters()
    if stress is None or body.material.table.name not in LAWS:
        return
    if body.material.table.name in FLOWING:
        check.fail(
            f"stress is given for {body.material.table.name}, which would have to say whether it "
            "flows with it; expected a law without flow; use NeoHookean, or load it step by step"
        )
    names = PLANE if scene.dimension == 2 else SPACE
    if len(stress) != len(names):
        check.fail(
            f"stress has {len(stress)} components; expected {len(names)}: {', '.join(names)}"
            + ("; zz follows as ν (xx + yy)" if scene.dimension == 2 else "")
        )
        return
    if isinstance(stress, Field):
        return
    largest, most = max(map(abs, stress)), LARGEST_STRESS * have["youngs_modulus"]
    if largest > most:
        check.fail(
            f"stress is up to {largest:g} Pa; expected at most {LARGEST_STRESS:g} of Young's "
            f"modulus, {most:g} Pa, since time steps are those of the law alone; give less"
        )


def _reach(mesh: ElementMesh) -> str:
    ends = " to ".join("(" + ", ".join(f"{x:g}" for x in end) + ") m" for end in mesh.bounds())
    return f"the mesh reaches from {ends}, and has edges up to {mesh.longest_edge:.4g} m"


def _doubt_slow(scene: SceneData, body: Body, mesh: ElementMesh, doubts: list[str]) -> None:
    """Say what a slow impact loses with edges as long as cells.

    The grid slows a vertex down for a cell and a half before what it meets, in every step, and the
    slower it comes the more steps there are; particles and short elements are strained meanwhile
    and give it back.
    """
    given = [b.velocity for b in scene.bodies if not isinstance(b.velocity, Field)]
    if mesh.edge <= _COARSE * scene.cell_size or len(given) < len(scene.bodies):
        return
    pull = initial_gravity(scene)
    room = np.asarray(scene.upper, dtype=np.float64) - np.asarray(scene.lower, dtype=np.float64)
    fall = math.sqrt(2 * float(np.abs(pull) @ room))
    speed = max(fall, *(float(np.linalg.norm(velocity)) for velocity in given))
    wave = wave_speed(body.material)
    if wave is None or not 0 < speed < _SLOW * wave:
        return
    doubts.append(
        f"body '{body.name}': edges of {mesh.edge / scene.cell_size:.3g} cells, and nothing is "
        f"faster than {speed:.3g} m/s, {speed / wave:.1g} of its wave speed: a bar of 4 cells had "
        "0.63 of the force of its impact on a wall at 0.005 of the wave speed and 0.07 at 0.0014; "
        "expected edges of half a cell, with which it had 0.84 and 0.40 (particles 0.92 and 0.55); "
        f"use elements of edge ≤ {0.5 * scene.cell_size:.4g} m where it strikes"
    )


def _doubt_thin(scene: SceneData, body: Body, mesh: ElementMesh, doubts: list[str]) -> None:
    """Say how stiff a thin part bends with edges as long as cells."""
    dx = scene.cell_size
    if mesh.edge <= _COARSE * dx:
        return
    low, high = mesh.bounds()
    thick = min(b - a for a, b in zip(low, high, strict=True)) / dx
    if not 0 < thick < _STIFF[-1][0] * (1 - 1e-6):
        return
    cells, errors = zip(*_STIFF, strict=True)
    error = float(np.interp(thick, cells, errors))
    doubts.append(
        f"body '{body.name}': {thick:.3g} cells thick with edges of {mesh.edge / dx:.3g} cells; "
        f"bending parts so thin vibrate about {error:.0f} % too fast with edges of a cell, about "
        "1 to 3 % with half a cell; use elements of edge "
        f"{0.5 * dx:g} m where it bends"
    )


def check_mesh_overlaps(bodies: list[Body], slack: float, problems: list[str]) -> None:
    """Refuse meshes with vertices inside others, deeper than `slack`, m."""
    meshes = [(b, b.shape) for b in bodies if isinstance(b.shape, ElementMesh)]
    for i, j in close_pairs([mesh.bounds() for _, mesh in meshes]):
        for (one, first), (two, second) in ((meshes[i], meshes[j]), (meshes[j], meshes[i])):
            low, high = (np.asarray(end) for end in second.bounds())
            p = first.positions()
            near = np.flatnonzero(((p > low) & (p < high)).all(axis=1))
            if not len(near):
                continue
            caught = near[MeshInside(second).distance(p[near]) < -slack]
            if len(caught):
                problems.append(
                    f"body '{one.name}': with body '{two.name}': {len(caught)} of its vertices, "
                    f"the first {caught[0]}, lie inside elements of the other; expected apart; "
                    "move one of them"
                )
                break


def faint_strains(scene: SceneData, precision: str) -> list[str]:
    """Say where single precision cannot resolve the stresses of stiff elements.

    What is expected follows from speeds, ρ c v, and weight, ρ g L: a body of E resolves E·1e-7.
    """
    if precision != "single":
        return []
    gravity = float(np.linalg.norm(initial_gravity(scene)))
    low, high = np.asarray(scene.lower), np.asarray(scene.upper)
    fast = [0.0]
    for body in scene.bodies:
        if isinstance(body.velocity, tuple):
            fast.append(math.hypot(*body.velocity))
        if body.material.table.stores_volume and hasattr(body.shape, "bounds"):
            bottom, top = body.shape.bounds()
            deep = np.minimum(np.asarray(top), high) - np.maximum(np.asarray(bottom), low)
            fast.append(math.sqrt(2 * gravity * max(0.0, float(deep.max()))))
    doubts = []
    for body in scene.bodies:
        have = body.material.parameters()
        if not isinstance(body.shape, ElementMesh) or "youngs_modulus" not in have:
            continue
        speed = wave_speed(body.material)
        assert speed is not None
        bottom, top = body.shape.bounds()
        long = max(b - a for a, b in zip(bottom, top, strict=True))
        expected = have["density"] * max(speed * max(fast), gravity * long)
        resolved = _RESOLVED * have["youngs_modulus"]
        if 0 < expected < 10 * resolved:
            doubts.append(
                f"body '{body.name}': stresses are resolved to about E·1e-7 = {resolved:.3g} Pa in "
                f"single precision, where speeds and weight let expect {expected:.3g} Pa; "
                "expected a tenth of that or less; use precision='double'"
            )
    return doubts
