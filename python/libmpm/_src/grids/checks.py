"""Rules of scenes on a grid of triangles or splines, in the manner of `scene/checks.py`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from libmpm._src.base.values import Checker, shown
from libmpm._src.boundaries.responses import Response, Separable
from libmpm._src.errors import SceneError
from libmpm._src.grids.grid import TriangularGrid
from libmpm._src.grids.placing import chosen_triangles, place
from libmpm._src.grids.shapes import Cells, Outline, Points
from libmpm._src.methods.method import FBar
from libmpm._src.methods.transfer import Kernel, Transfer
from libmpm._src.sensors.engine_sensors import VelocityProbe, WaveGauge
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary

#: Particles of a body, whose positions and volumes are kept in memory as a whole.
MOST_PARTICLES = 2**27

__all__ = ["check_body", "check_boundary", "check_grid", "check_overlaps", "check_square_cells"]


def check_grid(scene: SceneData, problems: list[str], doubts: list[str]) -> None:
    """Check what concerns the scene as a whole."""
    assert scene.grid is not None
    if scene.method.leaving == "freeze":
        problems.append(
            "Method: leaving is 'freeze', which is not built for grids of functions; expected "
            "'stop' or 'delete'"
        )
    if scene.transfer != Transfer() or scene.method.kernel_choice != Kernel():
        problems.append(
            "Method: transfer and kernel are choices of square cells; a grid of functions has its "
            "own functions and update; leave both out"
        )
    for placed in scene.sensors:
        if isinstance(placed.sensor, WaveGauge):
            problems.append(
                f"sensor '{placed.name}': a WaveGauge is not built for grids of functions; use "
                "ParticleTracker or VelocityProbe"
            )
        elif isinstance(placed.sensor, VelocityProbe) and isinstance(scene.grid, TriangularGrid):
            place = placed.sensor.position
            if len(place) == 2 and not scene.grid.mesh.contains([place])[0]:
                problems.append(
                    f"sensor '{placed.name}': position ({place[0]:g}, {place[1]:g}) m lies outside "
                    "of the mesh; expected inside; move it"
                )
    doubts += scene.grid.doubts()


def _expected(scene: SceneData, body: Body) -> float:
    """Return how many particles a body will have at most, without placing them."""
    if isinstance(body.shape, Cells) and isinstance(scene.grid, TriangularGrid):
        return float(len(scene.grid.mesh.triangles)) * body.particles_per_cell
    if not isinstance(body.shape, Box):
        return 0.0
    if body.lattice is not None:
        return math.prod(map(float, body.lattice))
    across = math.sqrt(body.particles_per_cell) / scene.cell_size
    return math.prod(1.0 + size * across for size in body.shape.size)


def check_overlaps(scene: SceneData, bodies: Sequence[Body], problems: list[str]) -> None:
    """Refuse triangles that two bodies fill, and more material than the mesh has room for."""
    if not isinstance(scene.grid, TriangularGrid):
        return
    mesh = scene.grid.mesh
    filled = [(b, set(chosen_triangles(mesh, b.shape.within).tolist()))
              for b in bodies if isinstance(b.shape, Cells)]  # fmt: skip
    for i, (one, first) in enumerate(filled):
        for two, second in filled[i + 1 :]:
            shared = len(first & second)
            if shared:
                problems.append(
                    f"body '{one.name}': with body '{two.name}': both fill {shared} triangles; "
                    "expected apart; give shapes.Cells(within=...) that do not meet"
                )
    volume = sum(float(place(scene, b).volume.sum()) for b in bodies)
    if volume > mesh.area * (1 + 1e-6):
        problems.append(
            f"Scene: the bodies have {volume:g} m² in all, the mesh {mesh.area:g} m²; expected no "
            "more than it has room for; bodies overlap, or volumes of shapes.Points are too large"
        )


def check_body(scene: SceneData, body: Body, problems: list[str]) -> bool:
    """Check one body; returns whether it can be filled with particles."""
    check = Checker(f"body '{body.name}'")
    fits = True
    shape = body.shape
    count = _expected(scene, body)
    if not count <= MOST_PARTICLES:
        check.fail(
            f"{count:.3g} particles; expected ≤ {MOST_PARTICLES:.3g} on a grid of functions; give "
            "fewer particles_per_cell or a coarser grid"
        )
        problems += check.problems
        return False
    if isinstance(body.fbar, FBar):
        check.fail(
            f"fbar is {shown(body.fbar)} on a grid of functions, which has no volume smoothing; "
            "remove fbar"
        )
    if any((body.smoothing, body.assumed, body.damping, body.force)):
        check.fail(
            "smoothing, assumed, damping and force work on square cells; a grid of functions has "
            "none of them; remove them"
        )
    if body.subtract_from:
        check.fail("subtract_from is not built for grids of functions; shape the bodies apart")
    if isinstance(shape, Cells | Points) and not isinstance(scene.grid, TriangularGrid):
        check.fail(f"{shape.label} needs a grid of triangles; use shapes.Box with lattice=(nx, ny)")
        fits = False
    if isinstance(shape, Cells) and math.isqrt(body.particles_per_cell) ** 2 != (
        body.particles_per_cell
    ):
        check.fail(
            f"particles_per_cell is {body.particles_per_cell}; expected a square number for "
            "shapes.Cells, such as 4, 9 or 16"
        )
        fits = False
    if fits and isinstance(shape, Cells):
        assert isinstance(scene.grid, TriangularGrid)
        if not len(chosen_triangles(scene.grid.mesh, shape.within)):
            check.fail("within holds the centre of no triangle; expected some; move its corners")
            fits = False
    if fits and isinstance(shape, Points) and shape.within is not None:
        assert isinstance(scene.grid, TriangularGrid)
        if not len(chosen_triangles(scene.grid.mesh, shape.within)):
            check.fail("within holds the centre of no triangle; expected some; move its corners")
            fits = False
    if isinstance(shape, Points) and fits and shape.volume is None:
        try:
            place(scene, body)
        except SceneError as error:
            check.problems += [f"body '{body.name}': {p}" for p in error.problems]
            fits = False
    if fits and isinstance(scene.grid, TriangularGrid) and not isinstance(shape, Cells):
        fits = _check_inside(check, scene, body)
    if body.lattice is not None and len(body.lattice) != 2:
        check.fail(f"lattice has {len(body.lattice)} numbers; expected 2")
        fits = False
    if body.pins:
        check.fail("pins hold vertices of elements; expected none on a grid; remove them")
    if body.tractions and not isinstance(shape, Box):
        check.fail("tractions act on faces of a shapes.Box; expected one; or remove them")
    for k, traction in enumerate(body.tractions):
        wrong = traction._misfits(2)
        if traction.face is None or traction.within is not None:
            wrong.append("within is of bodies of elements; name a face, and leave it out")
        for what in wrong:
            check.fail(f"tractions[{k}]: {what}")
            fits = False
    stores = body.material.table.needs == "stress"
    if body.stress is not None and not stores:
        check.fail(
            f"stress is given for {body.material.table.name}, which stores none; expected a "
            "material such as Hypoelastic; remove stress"
        )
    if body.stress is not None and len(body.stress) != 4:
        check.fail(f"stress has {len(body.stress)} components; expected 4: xx, yy, xy, zz")
    problems += check.problems
    return fits


def _check_inside(check: Checker, scene: SceneData, body: Body) -> bool:
    assert isinstance(scene.grid, TriangularGrid)
    if isinstance(body.shape, Box) and body.shape.dimension != 2:
        return False
    if body.lattice is not None and len(body.lattice) != 2:
        return True  # refused elsewhere
    position = place(scene, body).position
    outside = position[~scene.grid.mesh.contains(position)]
    if len(outside):
        x, y = outside[0]
        check.fail(
            f"{len(outside)} of its {len(position)} particles lie outside of the mesh, the first "
            f"at ({x:g}, {y:g}) m; expected inside; enlarge the mesh, or shape the body by its "
            "triangles with shapes.Cells"
        )
    return not len(outside)


def check_boundary(scene: SceneData, boundary: Boundary, problems: list[str]) -> None:
    """Check one boundary."""
    check = Checker(f"boundary '{boundary.name}'")
    if isinstance(boundary.shape, Box):
        check.fail(
            "a Box cannot lie in a grid of functions; leave it out of the mesh, and hold that "
            "part of its outline with shapes.Outline"
        )
    given = boundary.response
    if isinstance(boundary.shape, Outline) and isinstance(given, Mapping):
        check.fail("response is given by face; expected one for the whole of a shapes.Outline")
    if isinstance(boundary.shape, Outline) and not isinstance(scene.grid, TriangularGrid):
        check.fail("shapes.Outline needs a grid of triangles; use shapes.DomainWalls")
    for response in boundary.responses:
        if isinstance(response, Separable):
            check.fail(
                f"response is {shown(response)}, which is not built for grids of functions; use "
                "Sticky() or Slip()"
            )
        elif isinstance(response, Response) and any(response.friction):
            check.fail(
                f"response is {shown(response)} with friction, which is not built for grids of "
                "functions; leave the friction out"
            )
    problems += check.problems


def check_square_cells(scene: SceneData, problems: list[str]) -> bool:
    """Refuse what only grids of functions have; returns whether the rest can be checked."""
    fine = True
    remedy = "expected a grid of libmpm.grids for it: Scene(grid=...)"
    pinned = "expected a body of elements: shapes.Tetrahedra, shapes.Triangles"
    loaded = f"{remedy}, or a body of elements: shapes.Tetrahedra, shapes.Triangles"
    for body in scene.bodies:
        wrong = []
        if isinstance(body.shape, Cells | Points):
            wrong.append(body.shape.label)
            fine = False
        if body.tractions and not isinstance(body.shape, ElementMesh):
            wrong.append("tractions")
        if body.pins and not isinstance(body.shape, ElementMesh):
            wrong.append("pins")
        for what in wrong:
            what_else = {"tractions": loaded, "pins": pinned}.get(what, remedy)
            problems.append(f"body '{body.name}': {what} on a grid of square cells; {what_else}")
        if body.lattice is not None and len(body.lattice) != scene.dimension:
            problems.append(
                f"body '{body.name}': lattice has {len(body.lattice)} numbers; expected "
                f"{scene.dimension}, the dimension of the scene"
            )
            fine = False
    for boundary in scene.boundaries:
        if isinstance(boundary.shape, Outline):
            problems.append(
                f"boundary '{boundary.name}': shapes.Outline on a grid of square cells; {remedy}"
            )
            fine = False
    return fine
