"""Rules about the motion of boundaries and about those that are surfaces."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from libmpm._src.boundaries import Displacement, Mirror, Prescribed, Travel
from libmpm._src.errors import SceneError
from libmpm._src.geometry.solid import Solid
from libmpm._src.sensors import LoadCell
from libmpm._src.shapes import Box, DomainWalls
from libmpm._src.surfaces import distance_field
from libmpm._src.timetable import TimeTable, check_vector_table
from libmpm._src.values import Checker, nearest

if TYPE_CHECKING:
    from libmpm._src.parts import Boundary, PlacedSensor
    from libmpm._src.scene import Scene

__all__ = ["check_motion", "check_reaction", "check_responses", "check_surface"]

#: Schemes whose filters pass over the grid between the sums and the boundaries.
_FILTERS = ("XPIC", "FMPM")


def check_motion(check: Checker, scene: Scene, boundary: Boundary) -> None:
    """Check the motion of a boundary and where it acts."""
    d = scene.dimension
    motion = boundary.motion
    if isinstance(motion, TimeTable):
        check_vector_table(check, "motion", motion, d, "m/s")
    elif isinstance(motion, Displacement):
        check_vector_table(check, "motion", motion.table, d, "m")
    elif isinstance(motion, Travel):
        given = motion.velocity
        if isinstance(given, TimeTable):
            check_vector_table(check, "motion", given, d, "m/s")
        elif len(given) != d:
            check.fail(f"motion has {len(given)} numbers; expected {d} in m/s")
    within = boundary.within
    if within is not None and within.dimension != d:
        check.fail(f"within has {within.dimension} axes; expected {d}, those of the scene")
    turning = boundary.rotation
    if turning is not None and len(turning.about) != d:
        check.fail(f"rotation: about has {len(turning.about)} numbers; expected {d}")
    names = [b.name for b in scene.bodies]
    for name in boundary.bodies:
        if name not in names:
            check.fail(f"bodies has unknown body '{name}'; {nearest(name, names)}")
    if scene.grid is not None and (boundary.bodies or within is not None):
        check.fail("bodies and within are for square cells; expected neither on a grid")
    check_responses(check, scene, boundary)


def check_responses(check: Checker, scene: Scene, boundary: Boundary) -> None:
    """Refuse responses where they mean nothing."""
    given = boundary.response
    if any(isinstance(r, Mirror) for r in boundary.responses):
        _check_mirror(check, scene, boundary)
    if any(isinstance(r, Prescribed) for r in boundary.responses):
        if scene.grid is not None or not isinstance(boundary.shape, Solid):
            check.fail(
                f"response is {given!r} with {type(boundary.shape).__name__}; expected the region "
                "as a Solid of shapes on square cells"
            )
        elif isinstance(given, Mapping):
            check.fail("response is Prescribed on faces; expected one for the whole region")
        if boundary.motion is None and boundary.rotation is None:
            check.fail(
                "response is Prescribed without motion; expected the velocity of the region; give "
                "motion=TimeTable(...) in m/s, or boundaries.Sticky() for a body at rest"
            )


def _check_mirror(check: Checker, scene: Scene, boundary: Boundary) -> None:
    if scene.grid is not None:
        check.fail("response is Mirror on a grid of functions; expected Slip or Sticky")
        return
    if not isinstance(boundary.shape, DomainWalls):
        check.fail(
            f"response is Mirror with {type(boundary.shape).__name__}; expected DomainWalls; use "
            "Slip, or end the domain at the plane"
        )
    if boundary.motion is not None:
        check.fail("motion is given for a Mirror, which rests; expected None; use Slip")
    if boundary.within is not None or boundary.bodies:
        check.fail(
            "within or bodies is given for a Mirror, a plane of the whole scene; expected neither; "
            "use Slip"
        )
    method = scene.method
    if method.transfer_choice.scheme in _FILTERS:
        check.fail(
            f"response is Mirror with transfer '{method.transfer_choice.scheme}', whose filter "
            "knows no mirrored nodes; expected another transfer, or Slip"
        )
    if method.kernel_choice.boundary:
        check.fail(
            "response is Mirror with a kernel whose functions end at the wall; expected another "
            "kernel, or Slip or Sticky"
        )
    if any(getattr(b.fbar, "form", "") == "split" for b in scene.bodies):
        check.fail(
            "response is Mirror with FBar(form='split'), whose average is made anew without "
            "mirrored nodes; expected another form, or Slip"
        )
    if method.transfer_choice.stores_velocity and any(b.force is not None for b in scene.bodies):
        check.fail(
            "response is Mirror beside a PlacedForce with transfer "
            f"'{method.transfer_choice.scheme}': what particles keep counts the force at mirrored "
            "nodes again, and speeds grow without bound; expected 'APIC' or 'PIC', or Slip"
        )


def check_surface(check: Checker, scene: Scene, boundary: Boundary) -> bool:
    """Check a boundary of any shape; returns whether it can be looked at further."""
    shape = boundary.shape
    assert isinstance(shape, Solid)
    d = scene.dimension
    if shape.dimension != d:
        check.fail(f"shape has {shape.dimension} axes; expected {d}, the dimension of the scene")
        return False
    spacing = boundary.spacing
    if spacing is not None and spacing > 2 * scene.cell_size:
        check.fail(
            f"spacing is {spacing:g} m with cells of {scene.cell_size:g} m; expected ≤ 2 cells, or "
            "the layer would fall between the points"
        )
    if check.problems:
        return False
    if not isinstance(shape, Box) or isinstance(boundary.response, Prescribed):
        thin = min(b - a for a, b in zip(*shape.bounds(), strict=True))
        if thin < scene.cell_size and not isinstance(boundary.response, Prescribed):
            check.fail(
                f"the shape is {thin:g} m thick; expected one cell or more, {scene.cell_size:g} m, "
                "or material would pass through it; thicken it or use a smaller cell_size"
            )
    try:
        distance_field(scene, boundary)
    except SceneError as error:
        check.problems += error.problems
        return False
    return True


def check_reaction(scene: Scene, placed: PlacedSensor, doubts: list[str]) -> None:
    """Say where a load cell counts more or less momentum than the particles lose."""
    cell = placed.sensor
    if not isinstance(cell, LoadCell):
        return
    boundary = next((b for b in scene.boundaries if b.name == cell.boundary), None)
    if boundary is None:
        return
    transfer = scene.method.transfer_choice
    if transfer.scheme == "FMPM":
        why = "passes over what walls have changed"
    elif transfer.stores_velocity and any(isinstance(r, Mirror) for r in boundary.responses):
        why = "gives particles only a share of what a mirror turns round"
    else:
        return
    doubts.append(
        f"sensor '{placed.name}': the force on boundary '{boundary.name}' with transfer "
        f"'{transfer.scheme}', which {why}; the momentum of the particles and that which the cell "
        "counts differ, by 2 to 30 % in small scenes; expected 'APIC', or Slip walls with the "
        "FLIP family"
    )
