"""Loads and pressures of flows that the cells of a scene do not resolve, before they are run.

What is said rests on measurements: a piston that drives a bore and decks in bores, by cells,
transfer and wall (docs/boundaries.md, docs/bridges.md), and the box of the Large Wave Flume.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.advice.facts import Facts
from libmpm._src.boundaries.responses import Mirror, Prescribed
from libmpm._src.scene.places import initial_gravity, linear_all_round
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.sensors.python_sensors import PressureProbe
from libmpm._src.shapes.boxes import Box, DomainWalls, faces_of
from libmpm._src.shapes.solid import Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["doubtful_loads", "narrow_gap", "weighed"]

Floats = npt.NDArray[np.float64]

#: Structures up to so many cells thick were seen to take loads from what a transfer loses.
_THIN = 4.0
#: Transfers that lose something of a flow's shear in every step.
_LOSING = ("PIC", "APIC", "PIC-FLIP")
#: Cells in a gap below which the load of a structure is a multiple: with 2.5 and 5 cells below the
#: box of the Large Wave Flume it was 2.4 to 6.7 and 2.8 to 4.3 times the measured one.
_GAP = 10.0
#: Cells across a depth with which the force of a bore was within 8 % and 0.2 %: 16 where walls hold
#: nodes (34 % too much with 8), 8 with linear cells.
_DEEP = {False: 16.0, True: 8.0}
#: Cells from a held wall within which pressure is wrong, and what a load cell on one face of a box
#: lacks in still water, cells.
_NEAR, _LACKS = 2.0, 0.4
#: K over ρgH from which a slot of two cells lets less than 0.18 through, one of four 0.78.
_STIFF = 2000.0
#: Part of a load that may be missing without a word.
_ERROR = 0.05
_SLACK = 1.01


def doubtful_loads(scene: SceneData) -> list[str]:
    """Return what of load cells and probes at walls is not to be trusted, and the remedies."""
    facts = Facts(scene, frozenset())
    if not facts.water or not facts.gravity > 0:
        return []
    flows = not facts.at_rest or len(facts.water) < len(scene.bodies)
    found = _soft(facts)
    if flows:
        found += _stiff(facts)
    for boundary in weighed(scene):
        if flows:
            found += _of_flow(facts, boundary)
        else:
            found += _at_rest(scene, boundary)
    for placed in scene.sensors:
        if isinstance(placed.sensor, PressureProbe):
            found += _of_probe(facts, placed.name, placed.sensor, flows)
    return found


def _soft(facts: Facts) -> list[str]:
    """Return which water is so soft that a load is off by more than 5 % by that alone.

    The side force of a tank is off by (2/3) ρ g H/K, what is stopped by (v/c)²/2.
    """
    scene = facts.scene
    if not weighed(scene):
        return []
    found = []
    for body in facts.water:
        modulus = body.material.parameters()["bulk_modulus"]
        own, mach = facts.compression(body), facts.mach(body)
        worst = max(own / (1.5 * _ERROR), mach * mach / (2 * _ERROR))
        if _SLACK < worst < math.inf:
            found.append(
                f"body '{body.name}': bulk_modulus is {modulus:.3g} Pa, ρgH/K = {own:.3g} and v/c "
                f"= {mach:.3g}: forces on walls are off by 2/3 ρgH/K where it stands and (v/c)²/2 "
                f"where it is stopped; expected within {_ERROR:.0%}; use bulk_modulus ≥ "
                f"{modulus * worst:.2g}"
            )
    return found


def _stiff(facts: Facts) -> list[str]:
    """Return which water is so stiff that it hardly flows through a gap of few cells.

    It locks there, and the transfer takes its share in more steps (docs/tradeoff.md).
    """
    if not narrow_gap(facts):
        return []
    found = []
    for body in facts.water:
        modulus, own = body.material.parameters()["bulk_modulus"], facts.compression(body)
        if own > 0 and _STIFF * own < 1:
            found.append(
                f"body '{body.name}': bulk_modulus is {modulus:.3g} Pa, ρgH/K = {own:.2g}, beside "
                "a structure with a load cell and a gap of few cells: water so stiff is choked "
                "there; of what it should, 0.54, 0.18 and 0.05 went through two cells with 200, "
                "2,000 and 20,000 ρgH (docs/tradeoff.md); expected at most 2,000 ρgH; use "
                f"bulk_modulus ≤ {modulus * _STIFF * own:.2g}, or cells of a tenth of the gap"
            )
    return found


def weighed(scene: SceneData) -> list[Boundary]:
    """Return the boundaries that carry a load cell."""
    names = {s.sensor.boundary for s in scene.sensors if isinstance(s.sensor, LoadCell)}
    return [b for b in scene.boundaries if b.name in names]


def narrow_gap(facts: Facts) -> bool:
    """Return whether a structure with a load cell has a gap of few cells beside or under it."""
    for boundary in weighed(facts.scene):
        if not isinstance(boundary.shape, Solid) or boundary.motion is not None:
            continue
        low, high = _inside(facts.scene, boundary.shape)
        if np.all(low < high) and _gap(facts, boundary, low, high)[0] < _GAP:
            return True
    return False


def _of_flow(facts: Facts, boundary: Boundary) -> list[str]:
    """Return what is doubtful about the load of a flow on a boundary."""
    scene, name = facts.scene, boundary.name
    found = []
    if isinstance(boundary.shape, Solid) and boundary.motion is None and not boundary.rotation:
        low, high = _inside(scene, boundary.shape)
        across = _across(scene, low, high)
        scheme = scene.transfer.scheme
        if 0 < across <= _THIN * _SLACK and scheme in _LOSING:
            found.append(
                f"boundary '{name}' carries a load cell and is {across:.3g} cells thick: {scheme} "
                "over-predicts the load of a flow round 2 to 4 cells 3 to 10 times (its "
                "dissipation grows with the bulk modulus); expected more cells; use transfer "
                "'FLIP' (docs/bridges.md) or refine"
            )
        elif 0 < across < _THIN:
            found.append(
                f"boundary '{name}' carries a load cell and is {across:.3g} cells thick: the load "
                f"of a flow on fewer than {_THIN:g} cells was measured to change by a quarter with "
                f"the water's stiffness; expected {_THIN:g} cells or more; use cell_size ≤ "
                f"{across * scene.cell_size / _THIN:.3g} m"
            )
        gap, face = _gap(facts, boundary, low, high)
        if gap < _GAP:
            found.append(
                f"boundary '{name}' carries a load cell, and the gap at its face '{face}' is "
                f"{gap:.3g} cells wide: a flow through 2.5 and 5 cells below a box was choked, "
                "the load 2.4 to 6.7 and 2.8 to 4.3 times the measured one; "
                f"expected {_GAP:g} cells or more; "
                f"use cell_size ≤ {gap * scene.cell_size / _GAP:.3g} m, or take the load for an "
                "upper bound"
            )
    deep = _depth(facts, boundary) / scene.cell_size
    linear = linear_all_round(scene, boundary)
    if 0 < deep < _DEEP[linear] / _SLACK:
        word = "linear cells" if linear else "held nodes"
        remedy = "" if linear else ', or response cell="linear", with which 8 cells do'
        found.append(
            f"boundary '{name}' carries a load cell in water up to {deep:.3g} cells deep: with "
            f"{word} the force of a bore was within 8 % from {_DEEP[linear]:g} cells on"
            f"{'' if linear else ' (34 % too much with 8)'}; expected that many; use cell_size ≤ "
            f"{deep * scene.cell_size / _DEEP[linear]:.3g} m{remedy}"
        )
    return found


def _at_rest(scene: SceneData, boundary: Boundary) -> list[str]:
    """Return what a load cell on single faces of a box lacks in still water."""
    linear = linear_all_round(scene, boundary)
    if not isinstance(boundary.shape, Box) or linear:
        return []
    some = [
        s.name
        for s in scene.sensors
        if isinstance(s.sensor, LoadCell)
        and s.sensor.boundary == boundary.name
        and s.sensor.faces != "all"
    ]
    low, high = _inside(scene, boundary.shape)
    across = _across(scene, low, high)
    if not some or not 0 < across < _LACKS / _ERROR:
        return []
    return [
        f"sensor '{some[0]}': load cells on single faces of a box of held nodes lack "
        f"{_LACKS:g} cells of its length, {_LACKS / across:.0%} of the {across:.3g} cells of "
        f"boundary '{boundary.name}'; expected {_LACKS / _ERROR:g} cells or more; use response "
        'cell="linear", or measure all faces'
    ]


def _of_probe(facts: Facts, name: str, probe: PressureProbe, flows: bool) -> list[str]:
    """Return what is doubtful about a pressure beside a wall that holds nodes."""
    scene = facts.scene
    at = np.asarray([probe.position], dtype=np.float64)
    for boundary in scene.boundaries:
        if isinstance(boundary.response, Prescribed) or boundary.time is not None:
            continue
        mirrors = all(isinstance(r, Mirror) for r in boundary.responses)
        if mirrors or linear_all_round(scene, boundary):
            continue
        if isinstance(boundary.shape, DomainWalls):
            if not flows or _to_walls(scene, boundary, at[0]) >= _NEAR * scene.cell_size:
                continue
        elif not isinstance(boundary.shape, Solid) or (
            float(boundary.shape.distance(at)[0]) >= _NEAR * scene.cell_size
        ):
            continue
        what = (
            "pressure there was wrong by 2 to 13 times in flows, with either sign" if flows
            else "pressure on a face of a box in still water was 1.2 to 1.3 times too large"
        )  # fmt: skip
        return [
            f"sensor '{name}' is a pressure probe within {_NEAR:g} cells of boundary "
            f"'{boundary.name}', whose nodes are held: {what}; expected response cell=\"linear\", "
            "a probe two cells off, or the force of a load cell over its area"
        ]
    return []


def _to_walls(scene: SceneData, boundary: Boundary, at: Floats) -> float:
    """Return the distance of a point from the faces of domain walls, m."""
    away = [math.inf]
    for face in _faces(scene, boundary):
        a = "xyz".index(face[0])
        away.append(at[a] - scene.lower[a] if face[1] == "-" else scene.upper[a] - at[a])
    return float(min(away))


def _faces(scene: SceneData, boundary: Boundary) -> list[str]:
    """Return the faces of the domain that a boundary of domain walls has."""
    assert isinstance(boundary.shape, DomainWalls)
    every = faces_of(scene.dimension)
    return [f for f in every if boundary.shape.faces == "all" or f in boundary.shape.faces]


def _inside(scene: SceneData, shape: Solid) -> tuple[Floats, Floats]:
    """Return the corners of what of a shape lies in the domain, m."""
    low, high = (np.asarray(x, dtype=np.float64) for x in shape.bounds())
    return np.maximum(low, scene.lower), np.minimum(high, scene.upper)


def _spans(scene: SceneData, low: Floats, high: Floats) -> npt.NDArray[np.bool_]:
    """Return the axes on which corners reach from end to end of the domain."""
    near = 0.01 * scene.cell_size
    return (low <= np.asarray(scene.lower) + near) & (high >= np.asarray(scene.upper) - near)


def _across(scene: SceneData, low: Floats, high: Floats) -> float:
    """Return the cells across the thinnest axis of a structure; 0 of one that is a bed or wall."""
    free = ~_spans(scene, low, high)
    size = (high - low)[free]
    # What reaches along all axes but one is a floor, a wall or a piston of the domain.
    if free.sum() <= (1 if scene.dimension == 3 else 0) or not len(size):
        return 0.0
    return float(size.min() / scene.cell_size)


def _blocked(scene: SceneData, own: Boundary, points: Floats) -> npt.NDArray[np.bool_]:
    """Return which points lie within another boundary that stays, or beyond a wall, (n,)."""
    found = np.zeros(len(points), dtype=bool)
    for boundary in scene.boundaries:
        if boundary is own or boundary.time is not None or boundary.bodies:
            continue
        if isinstance(boundary.response, Prescribed):
            continue
        if isinstance(boundary.shape, DomainWalls):
            for face in _faces(scene, boundary):
                a = "xyz".index(face[0])
                x = points[:, a]
                beyond = x < scene.lower[a] if face[1] == "-" else x > scene.upper[a]
                found |= beyond
        elif isinstance(boundary.shape, Solid) and boundary.motion is None:
            found |= np.asarray(boundary.shape.distance(points)) <= 0
    return found


def _gap(facts: Facts, boundary: Boundary, low: Floats, high: Floats) -> tuple[float, str]:
    """Return the narrowest gap beside or under a structure, cells, and at which face it is.

    Along rays from a quarter, the middle and three quarters of every face but the upper one, to
    what stands first in their way; a face that touches what is beside it has no gap.
    """
    scene, dx = facts.scene, facts.scene.cell_size
    v = facts.vertical
    up = "+" if initial_gravity(scene)[v] <= 0 else "-"
    spans = _spans(scene, low, high)
    shares = np.array([0.25, 0.5, 0.75])
    ahead = (np.arange(4 * int(_GAP)) + 0.5) * 0.25 * dx
    best = (math.inf, "")
    for face in faces_of(scene.dimension):
        a = "xyz".index(face[0])
        if spans[a] or face == f"{'xyz'[v]}{up}":
            continue
        grids = [low[b] + shares * (high[b] - low[b]) for b in range(len(low))]
        grids[a] = np.array([low[a] if face[1] == "-" else high[a]])
        starts = np.stack(np.meshgrid(*grids, indexing="ij"), axis=-1).reshape(-1, len(low))
        points = np.repeat(starts[:, None, :], len(ahead), axis=1)
        points[:, :, a] += (-1 if face[1] == "-" else 1) * ahead
        hit = _blocked(scene, boundary, points.reshape(-1, len(low))).reshape(points.shape[:2])
        way = np.where(hit.any(axis=1), ahead[hit.argmax(axis=1)] / dx - 0.125, np.inf)
        if np.median(way) > 0.5:
            best = min(best, (float(way[way > 0.5].min()), face))
    return best


def _depth(facts: Facts, boundary: Boundary) -> float:
    """Return how deep water may stand at a boundary, m; 0 where it lies above all water.

    From the bed below the middle of a structure to the top of the water; of walls of the domain and
    of what reaches across it, the depth of the water.
    """
    scene, v = facts.scene, facts.vertical
    if not isinstance(boundary.shape, Solid) or boundary.motion is not None:
        return facts.depth
    low, high = _inside(scene, boundary.shape)
    if initial_gravity(scene)[v] > 0 or not _across(scene, low, high):
        return facts.depth
    down = np.arange(scene.lower[v], low[v] + 1e-9, 0.25 * scene.cell_size)
    points = np.tile(0.5 * (low + high), (len(down), 1))
    points[:, v] = down
    solid = np.flatnonzero(_blocked(scene, boundary, points)) if len(down) else np.array([])
    bed = float(down[solid[-1]]) if len(solid) else scene.lower[v]
    levels = [b.hydrostatic for b in facts.water if b.hydrostatic is not None]
    return max(0.0, max([facts.extent[1][v], *levels]) - bed)
