"""Faces of a surface that another boundary covers: no water sees what stands on a wall.

A body of any shape holds the nodes around it along the normal of its nearest face. Where that face
lies on a wall, the nodes beside it would be held along the wall's normal, which the wall does
already, and material would pass the body's front along the wall. So distances near a covered face
are those of the nearest face that is not covered, continued straight through the wall.

What is for some bodies alone may lie in the place of a wall for all, as the friction of a bed does:
a face that looks as the wall's own does there is not covered by it.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable, constant
from libmpm._src.boundaries.responses import Displacement, Mirror, Prescribed, Travel
from libmpm._src.shapes.boxes import FACES, Box, DomainWalls, OrientedBox
from libmpm._src.shapes.primitives import HalfSpace
from libmpm._src.shapes.solid import Solid, box_distance

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["Covers", "covers_of", "distances_of", "motion_of", "moves", "uncovered_by_motion"]

#: Part of a cell by which a face may lie before the wall that covers it.
CLOSE = 0.01

#: Rows of a motion that are looked at besides its extremes.
_ROWS = 16

#: Part of the lattice's spacing over which a slope is taken, and what a unit slope may miss: where
#: two faces are equally near there is none, so many such parts beside it there is.
_STEP, _UNIT, _PROBE = 1e-3, 0.01, 4

#: How far off a cover a face is looked for, in spacings, by how much steps grow, and how often the
#: last one is halved. A bed of slope s is nearest from 2/s up for each cell before its toe: with
#: 1:100 it is found before its plane is a cell below.
_FAR, _GROWTH, _TURNS, _HALVINGS = 2e4, 0.5, 30, 6

#: What is reported where all of a surface is covered, and how far off an edge its faces are
#: asked for, in spacings.
_NOWHERE, _BESIDE, _OFF = 32.0, 0.01, 0.1

#: Cosine from which on two faces look alike.
_ALIKE = 0.99

Array = npt.NDArray[np.float64]


def motion_of(boundary: Boundary) -> tuple[TimeTable | None, bool]:
    """Return the table by which a shape moves and whether it holds places; None at rest."""
    motion = boundary.motion
    if isinstance(motion, Displacement):
        return motion.table, True
    if isinstance(motion, Travel):
        given = motion.velocity
        return (given if isinstance(given, TimeTable) else constant(given)), False
    return None, False


def moves(boundary: Boundary) -> bool:
    """Return whether a shape is ever elsewhere than stated."""
    return motion_of(boundary)[0] is not None or boundary.rotation is not None


@dataclass(frozen=True, eq=False)
class Covers:
    """What covers a surface wherever it is: distances from it, and the surface's places (n, d).

    `beside`: a face that looks as the cover's own does, in its plane, is not covered. It is that of
    a boundary for some bodies, such as the friction of a bed that holds all of them.
    """

    key: str
    distances: tuple[Callable[[Array], Array], ...]
    places: Array
    close: float
    beside: bool = False

    def nothing(self) -> Covers:
        """Return what covers no face."""
        return Covers("[]", (), self.places, self.close, self.beside)

    def clear(self, which: int, points: Array) -> Array:
        """Return by how much points of the surface stand off a cover, at worst, m (n,)."""
        worst = np.full(len(points), -np.inf)
        for place in self.places:
            worst = np.maximum(worst, self.distances[which](points + place))
        return worst

    def may_cover(
        self, distance: Callable[[Array], Array], points: Array, radius: float
    ) -> npt.NDArray[np.bool_]:
        """Return beside which points (n,) covers may be nearer than a surface within a radius."""
        found = np.zeros(len(points), dtype=bool)
        reach = np.abs(distance(points)) + self.close + 2 * radius if self.distances else 0.0
        for k in range(len(self.distances)):
            found |= self.clear(k, points) <= reach
        return found

    def seen(self, distance: Callable[[Array], Array], points: Array, spacing: float,
             depth: float) -> Array:  # fmt: skip
        """Return the distances (n,) of points from what is not covered of a surface, m."""
        away = distance(points)
        if not self.distances:
            return away
        reach = np.abs(away) + self.close
        near = np.zeros(len(points), dtype=bool)
        for k in range(len(self.distances)):
            near |= self.clear(k, points) <= reach
        left = np.flatnonzero(near)
        start = self._before(points[left], spacing)  # material is on that side
        x, last = start.copy(), start.copy()
        walked = np.zeros(len(left))
        heading = np.zeros_like(x)
        # Off what covers, along each axis in turn, in steps that grow: low above a floor the bed
        # that rises from it is nearest only far up, where it is flat.
        for turn in range(_TURNS * points.shape[1]):
            if len(left) == 0:
                break
            here = distance(x)
            slope = _slope(distance, x, _STEP * spacing)
            direction = self._hiding(x - here[:, None] * slope, slope, spacing)
            hidden = np.any(direction != 0, axis=1)
            unsure = np.abs(np.linalg.norm(slope, axis=1) - 1) > _UNIT
            found = ~hidden & ~unsure
            rows = np.flatnonzero(found)
            if turn:
                far, size, incline = self._first_seen(distance, x[rows], last[rows], spacing)
            else:  # seen from where it began: there is nothing between
                far, size, incline = x[rows], here[rows], slope[rows]
            away[left[rows]] = self._beyond(
                distance, far, size, incline, start[rows], points[left[rows]], spacing
            )
            deep = ~found & (here < -depth)
            away[left[deep]] = np.minimum(away[left[deep]], here[deep])
            # Where two faces are equally near, neither is known: a step on along what covers.
            lost = ~found & ~deep & ~hidden
            direction[lost] = self._off_nearest(x[lost], spacing)
            # The middle between two faces that are seen stays one all the way, and a corner of two
            # that follow what covers: its distance is known.
            away[left[lost]] = here[lost]
            settled = lost & (np.abs(np.sum(slope * direction, axis=1)) <= _UNIT)
            settled[settled] = self._all_seen(distance, x[settled], spacing)
            walked = np.where(np.sum(direction * heading, axis=1) > 0.5, walked, 0.0)
            step = np.maximum(spacing, _GROWTH * walked)
            ended = (walked > _FAR * spacing) | (turn == _TURNS * points.shape[1] - 1)
            away[left[ended & hidden & ~deep]] = _NOWHERE * spacing
            go_on = ~found & ~deep & ~ended & ~settled
            left, start, heading = left[go_on], start[go_on], direction[go_on]
            walked, last = (walked + step)[go_on], x[go_on]
            x = (x + step[:, None] * direction)[go_on]
        return away

    def _before(self, points: Array, spacing: float) -> Array:
        """Return the points (n, d), those behind covers moved straight to before them."""
        out = points.copy()
        for k in range(len(self.distances)):
            behind = np.flatnonzero(self.clear(k, out) < 2 * self.close)
            lift = 2 * self.close - self.clear(k, out[behind])
            out[behind] += lift[:, None] * self._off(k, out[behind], spacing)
        return out

    def _hiding(self, places: Array, facing: Array, spacing: float) -> Array:
        """Return the direction (n, d) off what covers each place of a surface; 0 in the open.

        `facing` (n, d): where the surface looks there.
        """
        direction = np.zeros_like(places)
        for k in range(len(self.distances)):
            clear = self.clear(k, places)
            hid = clear <= self.close
            if self.beside:
                rows = np.flatnonzero(np.abs(clear) <= self.close)
                alike = np.sum(self._off(k, places[rows], spacing) * facing[rows], axis=1)
                hid[rows] = alike < _ALIKE
            which = np.flatnonzero(hid & ~np.any(direction != 0, axis=1))
            if len(which):
                direction[which] = self._off(k, places[which], spacing)
        return direction

    def _all_seen(
        self, distance: Callable[[Array], Array], x: Array, spacing: float
    ) -> npt.NDArray[np.bool_]:
        """Return at which points (n, d), of no face more than of others, all these are seen."""
        seen = np.ones(len(x), dtype=bool)
        for a in range(x.shape[1]):
            for side in (-1, 1):
                beside = x.copy()
                beside[:, a] += side * _PROBE * _STEP * spacing
                slope = _slope(distance, beside, _STEP * spacing)
                sure = np.abs(np.linalg.norm(slope, axis=1) - 1) <= _UNIT
                places = beside - distance(beside)[:, None] * slope
                seen &= ~(sure & np.any(self._hiding(places, slope, spacing) != 0, axis=1))
        return seen

    def _first_seen(self, distance: Callable[[Array], Array], x: Array, last: Array,
                    spacing: float) -> tuple[Array, Array, Array]:  # fmt: skip
        """Return the places (n, d) from which a face is first seen on the way from `last`, from
        which a covered face was nearest, to x, and the distances and their slopes there."""
        far, near = x.copy(), last.copy()
        for _ in range(_HALVINGS if len(x) else 0):
            middle = 0.5 * (near + far)
            slope = _slope(distance, middle, _STEP * spacing)
            nearest = middle - distance(middle)[:, None] * slope
            seen = ~np.any(self._hiding(nearest, slope, spacing) != 0, axis=1)
            seen &= np.abs(np.linalg.norm(slope, axis=1) - 1) <= _UNIT
            far[seen], near[~seen] = middle[seen], middle[~seen]
        # Slopes are taken off the middle between both faces.
        way = far - near
        size = np.linalg.norm(way, axis=1, keepdims=True)
        far += way * np.maximum(1, _OFF * spacing / np.where(size > 0, size, np.inf))
        return far, distance(far), _slope(distance, far, _STEP * spacing)

    def _beyond(self, distance: Callable[[Array], Array], far: Array, here: Array, slope: Array,
                start: Array, points: Array, spacing: float) -> Array:  # fmt: skip
        """Return the distances (n,) of points from the face that is nearest to `far`, continued.

        `here` and `slope` are the distance there and its slope; points stand behind `start`.
        """
        slope = slope.copy()
        foot = far - here[:, None] * slope
        # Of an edge the face on the side of the point counts.
        way = start - foot
        size = np.linalg.norm(way, axis=1, keepdims=True)
        beside = foot + _BESIDE * spacing * way / np.where(size > 0, size, 1)
        turned = _slope(distance, beside, _STEP * spacing)
        whole = np.abs(np.linalg.norm(turned, axis=1) - 1) <= _UNIT
        at = beside - distance(beside)[:, None] * turned
        whole &= ~np.any(self._hiding(at, turned, spacing) != 0, axis=1)
        whole &= size[:, 0] > _BESIDE * spacing
        slope[whole] = turned[whole]
        # A face that goes on above a place in the open does not bound it.
        outside = distance(start) > 0
        over = outside & (np.sum(slope * (start - foot), axis=1) < -self.close)
        return np.where(over, _NOWHERE * spacing, np.sum(slope * (points - foot), axis=1))

    def _off(self, which: int, points: Array, spacing: float) -> Array:
        """Return the direction (n, d) off a cover at each point."""
        slope = _slope(functools.partial(self.clear, which), points, _STEP * spacing)
        size = np.linalg.norm(slope, axis=1, keepdims=True)
        return np.asarray(slope / np.where(size > 0, size, 1))

    def _off_nearest(self, points: Array, spacing: float) -> Array:
        """Return the direction (n, d) off the cover that is nearest to each point."""
        clear = np.stack([self.clear(k, points) for k in range(len(self.distances))])
        nearest = np.argmin(np.abs(clear), axis=0)
        out = np.zeros_like(points)
        for k in range(len(self.distances)):
            rows = np.flatnonzero(nearest == k)
            if len(rows):
                out[rows] = self._off(k, points[rows], spacing)
        return out


def _slope(distance: Callable[[Array], Array], points: Array, step: float) -> Array:
    """Return the gradient (n, d) of a distance."""
    out = np.empty_like(points)
    for a in range(points.shape[1]):
        ahead, behind = points.copy(), points.copy()
        ahead[:, a] += step
        behind[:, a] -= step
        out[:, a] = (distance(ahead) - distance(behind)) / (2 * step)
    return out


def places_of(scene: SceneData, boundary: Boundary) -> Array:
    """Return places (n, d) that a moving shape takes, m from where it is stated: its extremes on
    each axis and rows between; far ones for what never stops."""
    table, of_places = motion_of(boundary)
    if table is None:
        return np.zeros((1, scene.dimension))
    time, value = table.arrays()
    value = value.reshape(len(time), -1)
    if of_places:
        way = value
    else:
        means = 0.5 * (value[1:] + value[:-1]) * np.diff(time)[:, None]
        way = np.concatenate([[value[0] * max(time[0], 0.0)], means]).cumsum(axis=0)
        on = {"hold": value[-1], "zero": 0 * value[-1], "repeat": way[-1] - way[0]}[table.end]
        size = np.linalg.norm(on)
        length = sum(u - x for x, u in zip(scene.lower, scene.upper, strict=True))
        way = np.concatenate([np.zeros_like(way[:1]), way])
        if size > 0:
            way = np.concatenate([way, way[-1:] + 10 * length * on / size])
    rows = {int(f(way[:, a])) for a in range(way.shape[1]) for f in (np.argmin, np.argmax)}
    rows |= set(np.linspace(0, len(way) - 1, min(_ROWS, len(way))).astype(int).tolist())
    return np.unique(way[sorted(rows)], axis=0)


def _wall(axis: int, sign: float, plane: float) -> Callable[[Array], Array]:
    return lambda p: sign * (p[:, axis] - plane)


def _box(low: tuple[float, ...], high: tuple[float, ...]) -> Callable[[Array], Array]:
    return lambda p: box_distance(p, low, high)


def _faces(scene: SceneData, walls: Boundary) -> list[tuple[int, float, float]]:
    """Return axis, direction into the domain and plane of the walls of a boundary."""
    assert isinstance(walls.shape, DomainWalls)
    known = [f for f in FACES if "xyz".index(f[0]) < scene.dimension]
    present = known if walls.shape.faces == "all" else [f for f in known if f in walls.shape.faces]
    ends = {"-": (1.0, scene.lower), "+": (-1.0, scene.upper)}
    out = []
    for face in present:
        axis, (sign, corner) = "xyz".index(face[0]), ends[face[1]]
        out.append((axis, sign, float(corner[axis])))
    return out


def distances_of(scene: SceneData, boundary: Boundary) -> list[Callable[[Array], Array]]:
    """Return distances (n,) of points (n, d) from the faces of a boundary where it is stated."""
    if isinstance(boundary.shape, DomainWalls):
        return [_wall(*face) for face in _faces(scene, boundary)]
    return [boundary.shape.distance] if isinstance(boundary.shape, Solid) else []


def _always(boundary: Boundary, cover: Boundary) -> bool:
    """Return whether one boundary acts wherever and whenever the other does."""
    if cover.within is not None or any(isinstance(r, Prescribed) for r in cover.responses):
        return False
    if cover.bodies and not (boundary.bodies and set(boundary.bodies) <= set(cover.bodies)):
        return False
    return cover.window[0] <= boundary.window[0] and cover.window[1] >= boundary.window[1]


def covers_of(scene: SceneData, boundary: Boundary) -> Covers:
    """Return the walls, boxes and planes at rest that may cover faces of a surface."""
    found: list[Callable[[Array], Array]] = []
    keys: list[object] = []
    turns = boundary.rotation is not None
    for cover in () if turns else scene.boundaries:
        if cover.name == boundary.name or not _always(boundary, cover) or moves(cover):
            continue
        shape = cover.shape
        if isinstance(shape, DomainWalls):
            for face in _faces(scene, cover):
                found.append(_wall(*face))
                keys.append(face)
        elif isinstance(shape, Solid) and shape.dimension != scene.dimension:
            continue
        elif isinstance(shape, Box) and not cover.is_surface:
            from libmpm._src.scene.places import snap

            ends = snap(scene, shape)
            low, high = (
                tuple(x + n * scene.cell_size for x, n in zip(scene.lower, cells, strict=True))
                for cells in ends
            )
            found.append(_box(low, high))
            keys.append((low, high))
        elif isinstance(shape, Box | HalfSpace | OrientedBox):
            found.append(shape.distance)
            keys.append(shape.to_dict())
    places = places_of(scene, boundary) if found else np.zeros((1, scene.dimension))
    beside = bool(boundary.bodies)
    key = json.dumps([keys, places.tolist() if found else [], beside], sort_keys=True)
    return Covers(key, tuple(found), places, CLOSE * scene.cell_size, beside)


def uncovered_by_motion(scene: SceneData, boundary: Boundary) -> list[str]:
    """Return the domain walls on which a face of a surface stands that its motion takes off them.

    Its distances cannot count that face as covered, and until it has left the wall material passes
    along it.
    """
    shape = boundary.shape
    if not isinstance(shape, Solid) or not moves(boundary):
        return []
    ends = dict(zip("-+", shape.bounds(), strict=True))
    places = places_of(scene, boundary)
    close = CLOSE * scene.cell_size
    faces = []
    for walls in scene.boundaries:
        if not isinstance(walls.shape, DomainWalls) or not _always(boundary, walls):
            continue
        if any(isinstance(r, Mirror) for r in walls.responses):
            continue
        for axis, sign, plane in _faces(scene, walls):
            end = "-" if sign > 0 else "+"
            on = abs(ends[end][axis] - plane) <= close
            lifts = float((sign * places[:, axis]).max()) > close or boundary.rotation is not None
            if on and lifts:
                faces.append(f"{'xyz'[axis]}{end}")
    return faces
