"""Viscous flows between held walls that transfer and walls smear, before they are run.

A steady flow between two plates is, row by row of particles, a linear system: what the transfer and
the viscosity take from each node in a step is what drives it. Its peak over that of the law says
what is lost. It agrees with runs of the engine to 2 % (tests/validation/test_viscous_walls.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from libmpm._src.boundaries.responses import Mirror, Sticky
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.checks_time_steps import step_of
from libmpm._src.scene.places import faces_present
from libmpm._src.shapes.boxes import Box, DomainWalls, Solid
from libmpm._src.shapes.filling import bounds_of

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body

__all__ = ["peak_share", "smeared_flows"]

#: Share of the peak by which a flow may be wrong without a word.
_ERROR = 0.05
#: Sound times cell over viscosity, c Δx / ν, from which on viscosity is not what a scene is
#: about: a flow of a tenth of that speed has boundary layers thinner than a cell.
_VISCOUS = 400.0
#: Between mirrors runs come out slower than the system by so much over the square of the cells,
#: measured at 8 and 16 cells with APIC, FLIP and AFLIP.
_MIRRORED = 1.2
#: Cells between the plates beyond which the error is taken to fall as one over their number.
_CELLS = 64
#: Places of a body along each axis at which a wall beside it is looked for.
_LOOKED_AT = 24


def peak_share(cells: int, share: float, transfer: Transfer, mirrored: bool) -> float:
    """Return the peak of a steady flow between two plates over that of the law.

    `cells` ≥ 3 lie between the plates, quadratic functions, two particles a cell and axis; `share`
    is 4 ν Δt / Δx². Node 0 is held, half a cell from its plate, or the plate is a mirror without
    slip.
    """
    y = (np.arange(2 * cells) + 0.5) / 2
    row, cell = np.arange(len(y)), np.floor(y).astype(int)
    xi = y - cell - 0.5
    weight, slope = np.zeros((2, len(y), cells + 2))  # nodes -1, 0, ..., cells
    for k, n in ((-1, 0.5 * (0.5 - xi) ** 2), (0, 0.75 - xi**2), (1, 0.5 * (0.5 + xi) ** 2)):
        weight[row, cell + k + 1] = n
        slope[row, cell + k + 1] = 4 * n * (k - xi)

    def inside(of_nodes: NDArray[np.float64], sign: float) -> NDArray[np.float64]:
        """Nodes 0 to cells - 1; those beyond the plates are their images, or held."""
        out = of_nodes[:, 1:-1].copy()
        if mirrored:
            out[:, 0] += sign * of_nodes[:, 0]
            out[:, -1] += sign * of_nodes[:, -1]
        return out

    mass = inside(weight, 1).sum(axis=0)
    w, b = inside(weight, -1), inside(slope, -1)
    keep = min(_kept(transfer), 0.9999)  # of 1 what no node sees is undetermined
    back, stiff = w.T / mass[:, None], (b.T @ b) / (4 * mass[:, None])
    affine = stiff * transfer.affine
    # Unknowns: velocities of the rows, v = W u + keep (v - W ū), and of the nodes,
    # u = ū - share stiff u + g Δt, ū = back v + affine u.
    rows, nodes = len(y), cells
    system = np.zeros((rows + nodes, rows + nodes))
    system[:rows, :rows] = (1 - keep) * np.eye(rows) + keep * w @ back
    system[:rows, rows:] = keep * w @ affine - w
    system[rows:, :rows] = -back
    system[rows:, rows:] = np.eye(nodes) - affine + share * stiff
    push = np.concatenate([np.zeros(rows), np.ones(nodes)])
    if not mirrored:
        for end in (rows, rows + nodes - 1):
            system[end] = 0
            system[end, end] = 1
            push[end] = 0
    found = np.linalg.lstsq(system, push, rcond=None)[0]
    peak = float(found[:rows].max() / (cells**2 / (2 * share)))
    return peak - _MIRRORED / cells**2 if mirrored else peak


def _kept(transfer: Transfer) -> float:
    """Share of what the grid cannot see that stays in a particle."""
    return transfer.kept if transfer.scheme not in ("PIC", "APIC") else 0.0


def _viscosities(body: Body) -> tuple[float, bool]:
    """Kinematic viscosity at which a body flows, m²/s, and whether it is a law of its own."""
    told = body.material.parameters()
    if "consistency" in told:
        return float(told["consistency"] / told["density"]), True
    return float(told.get("viscosity", 0.0) / told["density"]), False


@dataclass(frozen=True)
class _Plate:
    """A plane that holds a body along it, at the body's lower ("-") or upper side of an axis."""

    side: str  # "y-"
    label: str
    mirrored: bool


def _held(scene: SceneData, body: Body, bounds: NDArray[np.float64]) -> dict[str, _Plate]:
    """Return by side what holds a body along it, no further away than a cell.

    `bounds` are those of the body, m, lower and upper. Faces of the domain count, and surfaces of
    `Sticky` solids at rest that lie along the grid, between which flows are as between those faces.
    """
    out: dict[str, _Plate] = {}
    domain = (np.asarray(scene.lower, dtype=float), np.asarray(scene.upper, dtype=float))
    for boundary in scene.boundaries:
        if boundary.bodies and body.name not in boundary.bodies:
            continue
        shape = boundary.shape
        moves = any(x is not None for x in (boundary.motion, boundary.rotation, boundary.within))
        if isinstance(shape, DomainWalls):
            given = boundary.response
            for face in faces_present(scene, boundary):
                response = given.get(face) if isinstance(given, Mapping) else given
                axis, upper = "xyz".index(face[0]), face[1] == "+"
                mirrored = isinstance(response, Mirror) and not response.slip
                end = int(upper)
                near = abs(bounds[end, axis] - domain[end][axis]) <= scene.cell_size
                if near and (mirrored or isinstance(response, Sticky)):
                    out[face] = _Plate(face, f"face '{face}'", mirrored)
        elif isinstance(shape, Solid) and isinstance(boundary.response, Sticky) and not moves:
            for side in _sides_at(shape, bounds, scene.cell_size):
                out[side] = _Plate(side, f"boundary '{boundary.name}'", False)
    return out


def _sides_at(solid: Solid, bounds: NDArray[np.float64], cell: float) -> Iterator[str]:
    """Give the sides of a body's box, most of which lies along a solid's surface.

    Along: at most a cell before it and a quarter of one within. A flow along a slope is not meant.
    """
    dimension = bounds.shape[1]
    if solid.dimension != dimension:
        return
    shares = np.array([1, 3, 5]) / 6
    for axis, end in product(range(dimension), (0, 1)):
        axes = [low + shares * (high - low) for low, high in bounds.T]
        axes[axis] = bounds[end, axis : axis + 1]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
        away = solid.distance(points) / cell
        if np.mean((away >= -0.25) & (away <= 1)) > 0.5:
            yield "xyz"[axis] + "-+"[end]


def smeared_flows(scene: SceneData) -> list[str]:
    """Return which viscous flows along held walls come out wrong by more than 5 %, and the cure."""
    step, doubts = step_of(scene), []
    if not step > 0 or scene.grid is not None:
        return []
    for body in scene.bodies:
        nu, own = _viscosities(body)
        transfer = body.transfer or scene.transfer
        sound = wave_speed(body.material) or np.inf
        if not nu > 0 or not (own or sound * scene.cell_size <= _VISCOUS * nu):
            continue
        if transfer.scheme in ("XPIC", "FMPM"):
            continue
        if unmeasured := _unmeasured(scene, body):
            doubts.append(unmeasured)
            continue
        found = _worst(scene, body, transfer, 4 * nu * step / scene.cell_size**2)
        if found is None:
            continue
        plate, gap, peak, better = found
        wall = "Mirror(slip=False)" if plate.mirrored else "Sticky()"
        at = "" if plate.label.startswith("face") else " on a face of the domain"
        doubts.append(
            f"body '{body.name}': a flow of it along {plate.label} would have {peak:.0%} of its "
            f"speed, {gap} cells between the plates: transfer '{transfer.scheme}' and {wall} take "
            f"more than its viscosity of {nu:.3g} m²/s in steps of {step:.3g} s; expected within "
            f"{_ERROR:.0%}; use 'FLIP' or 'AFLIP' with boundaries.Mirror(slip=False){at}, "
            f"{better:.0%} here, or finer cells"
        )
    return doubts


def _unmeasured(scene: SceneData, body: Body) -> str | None:
    """Say which held wall of a viscous body is of a kind whose error nobody has measured."""
    bounds = _bounds(scene, body)
    expected = (
        "expected plates along the grid and quadratic functions, for which the error is known"
    )
    kernel = scene.method.kernel_choice
    if kernel.name != "quadratic" or kernel.boundary:
        held = _held(scene, body, bounds)
        if not held:
            return None
        return (
            f"body '{body.name}': a viscous flow along {next(iter(held.values())).label} with "
            f"kernel '{kernel.name}': what held nodes take has not been measured; {expected}"
        )
    axes = [np.linspace(low, high, _LOOKED_AT) for low, high in bounds.T]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, bounds.shape[1])
    if isinstance(body.shape, Solid):
        points = points[body.shape.distance(points) < scene.cell_size]
    for boundary in scene.boundaries:
        shape = boundary.shape
        if not isinstance(boundary.response, Sticky) or not isinstance(shape, Solid):
            continue
        if boundary.bodies and body.name not in boundary.bodies:
            continue
        if isinstance(shape, Box) or shape.dimension != bounds.shape[1]:
            continue
        near = np.abs(shape.distance(points)) <= scene.cell_size
        if near.any() and not any(_sides_at(shape, bounds, scene.cell_size)):
            return (
                f"body '{body.name}': a viscous flow along boundary '{boundary.name}', which leans "
                f"or is round: what held nodes take has not been measured; {expected}: turn "
                "gravity in place of a slope"
            )
    return None


def _bounds(scene: SceneData, body: Body) -> NDArray[np.float64]:
    corner: NDArray[np.float64] = np.asarray(scene.lower, dtype=np.float64)
    return corner + np.asarray(bounds_of(scene, body), dtype=np.float64)


def _worst(
    scene: SceneData, body: Body, transfer: Transfer, share: float
) -> tuple[_Plate, int, float, float] | None:
    """Return the plate at which most is lost, if too much, cells between plates, and peaks."""
    worst = None
    bounds = _bounds(scene, body)
    held = _held(scene, body, bounds)
    for side, plate in held.items():
        axis = "xyz".index(side[0])
        # One plate alone is half of a channel.
        both = side[0] + "-" in held and side[0] + "+" in held
        gap = (bounds[1, axis] - bounds[0, axis]) / scene.cell_size * (1 if both else 2)
        cells = round(gap)
        if cells < 3:
            continue
        fewer = min(cells, _CELLS)
        lost = (1 - peak_share(fewer, share, transfer, plate.mirrored)) * fewer / cells
        if abs(lost) > _ERROR and (worst is None or abs(lost) > abs(1 - worst[2])):
            flip = Transfer(scheme="FLIP")
            better = 1 - (1 - peak_share(fewer, share, flip, True)) * fewer / cells
            worst = plate, cells, 1 - lost, better
    return worst
