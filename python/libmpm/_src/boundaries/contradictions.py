"""Boundaries that cannot both be obeyed where they overlap: the one that is defined last wins.

Of nodes that two boundaries hold, and beside which there can be material, those are looked for at
which no velocity satisfies both, or at which both rub along the same plane by other rules. What two
of them share along an edge where they meet is a cell or two wide and no contradiction that matters.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.covered_faces import motion_of
from libmpm._src.boundaries.distance_field import layer_of
from libmpm._src.boundaries.responses import Mirror, Prescribed, Response, Separable, Sticky
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.solid import Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Boundary

__all__ = ["contradictions"]

#: Cells along which two boundaries share nodes where they do not only meet at an edge.
_WIDE = 3.5
#: Cosine beyond which two normals are those of one plane.
_ALONG = 0.9
#: Part of the speed by which two velocities may differ and count as one.
_SLACK = 0.05
#: Nodes of a block along an edge, blocks that are looked at first, and of which nodes are.
_EDGE, _BLOCKS, _NEAR = 8, 1 << 15, 1 << 8
#: Nodes around which is looked how far such nodes go.
_CENTRES = 64
#: Pairs of boundaries that are compared.
_PAIRS = 200

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Part:
    """A boundary, or one wall of the domain, with the response that it has there."""

    boundary: Boundary
    response: Response
    axis: int = -1
    side: float = 0.0
    plane: float = 0.0

    @property
    def is_region(self) -> bool:
        return isinstance(self.response, Prescribed)

    def distance(self, p: Array) -> Array:
        """Return the signed distance (n,), m."""
        if self.axis >= 0:
            return np.asarray(self.side * (p[:, self.axis] - self.plane))
        assert isinstance(self.boundary.shape, Solid)
        return self.boundary.shape.distance(p)

    def bounds(self, low: Array, high: Array) -> tuple[Array, Array]:
        """Return the corners of where it is, within a domain."""
        if self.axis < 0:
            assert isinstance(self.boundary.shape, Solid)
            ends = np.asarray(self.boundary.shape.bounds(), dtype=np.float64)
            return ends[0], ends[1]
        first, last = low.copy(), high.copy()
        first[self.axis] = last[self.axis] = self.plane
        return first, last

    def reach(self, cell: float) -> float:
        """Return how far before its surface it holds nodes, m."""
        return layer_of(self.boundary).thickness * cell if self.boundary.is_surface else 0.0


def contradictions(scene: SceneData) -> list[str]:
    """Return which pairs of boundaries contradict each other, where, and what to do about it."""
    parts = list(_parts(scene))
    doubts: list[str] = []
    told: set[tuple[str, str]] = set()
    compared = 0
    for one, two in itertools.combinations(parts, 2):
        names = (one.boundary.name, two.boundary.name)
        if names[0] == names[1] or names in told or not _may_differ(one, two):
            continue
        low, high = _shared(scene, one, two)
        if np.any(low > high):
            continue
        compared += 1
        if compared > _PAIRS:
            break
        where = _where(scene, one, two, low, high)
        if where:
            told.add(names)
            some = [b.name for b in (one.boundary, two.boundary) if b.bodies]
            decides = "the one defined last decides"
            if len(some) == 1:
                decides = f"'{some[0]}' has the last word, for its bodies"
            doubts.append(
                f"boundary '{names[1]}': overlaps boundary '{names[0]}' {where}, where "
                f"{_rule(one)} and {_rule(two)} contradict each other, so that {decides}; "
                "expected one rule at each place; end one where the other begins, or use time "
                "windows or bodies that do not meet"
            )
    return doubts


def _parts(scene: SceneData) -> Iterator[_Part]:
    """Yield the boundaries that rules can be compared of."""
    for boundary in scene.boundaries:
        shape, response = boundary.shape, boundary.response
        if isinstance(shape, DomainWalls):
            faces = "all" if shape.faces == "all" else tuple(shape.faces)
            for axis, end in itertools.product(range(scene.dimension), ("-", "+")):
                face = "xyz"[axis] + end
                if faces != "all" and face not in faces:
                    continue
                mine = response[face] if isinstance(response, Mapping) else response
                plane = scene.lower[axis] if end == "-" else scene.upper[axis]
                yield _Part(boundary, mine, axis, 1.0 if end == "-" else -1.0, plane)
        elif (
            isinstance(shape, Solid)
            and not isinstance(response, Mapping)
            and (not boundary.is_surface or layer_of(boundary).function != "free")
        ):
            yield _Part(boundary, response)


def _may_differ(one: _Part, two: _Part) -> bool:
    """Return whether the rules of two differ, at one time and for one body."""
    a, b = one.boundary, two.boundary
    if max(a.window[0], b.window[0]) >= min(a.window[1], b.window[1]):
        return False
    if a.bodies and b.bodies and not set(a.bodies) & set(b.bodies):
        return False
    motions = (a.motion, a.rotation), (b.motion, b.rotation)
    if motions[0] != motions[1]:
        return True
    if bool(a.bodies) != bool(b.bodies):
        return False  # one for some bodies adds to what the other takes
    if isinstance(one.response, Sticky | Prescribed) or isinstance(two.response, Sticky):
        return False
    found: bool = _rubs(one.response) != _rubs(two.response)
    return found


def _rule(part: _Part) -> str:
    """Return what a boundary asks for, in words."""
    moving = not part.boundary.at_rest
    return f"{part.response!r}, {'moving' if moving else 'at rest'},"


def _rubs(response: Response) -> object:
    return response.friction if isinstance(response, Separable) else None


def _shared(scene: SceneData, one: _Part, two: _Part) -> tuple[Array, Array]:
    """Return the corners between which both hold nodes."""
    cell = scene.cell_size
    low, high = (np.asarray(end, dtype=np.float64) for end in (scene.lower, scene.upper))
    first, last = low, high
    for part in (one, two):
        here = part.bounds(low, high)
        slack = part.reach(cell) + 1e-6 * cell
        first, last = np.maximum(first, here[0] - slack), np.minimum(last, here[1] + slack)
        within = part.boundary.within
        if within is not None:
            first, last = np.maximum(first, within.lower), np.minimum(last, within.upper)
    return first, last


def _where(scene: SceneData, one: _Part, two: _Part, low: Array, high: Array) -> str:
    """Return where two contradict each other, in words; nothing where they do not."""
    cell = scene.cell_size
    p = _nodes(scene, (one, two), low, high)
    for part in (one, two):
        if len(p) == 0:
            return ""
        away = part.distance(p)
        held = away <= part.reach(cell) + 1e-6 * cell
        if not part.is_region:
            held &= away >= -1.01 * cell
        p = p[held]
    p = p[_open(scene, (one, two), p)]
    if len(p) == 0:
        return ""
    found = p[_contradict(one, two, p, cell)]
    if not _wide(found, cell):
        return ""
    first, last = found.min(axis=0), found.max(axis=0)
    spans = ", ".join(f"{a:.4g} to {b:.4g} m" for a, b in zip(first, last, strict=True))
    return f"at ({spans})"


def _wide(p: Array, cell: float) -> bool:
    """Return whether some nodes lie close together on more than an edge, a cell or two across."""
    for k in np.linspace(0, len(p) - 1, min(len(p), _CENTRES)).astype(np.int64):
        near = p[np.all(np.abs(p - p[k]) < 2.5 * cell, axis=1)]
        # Along a plane all ways but that across it are wide; in 2D that is one.
        if np.sort(np.ptp(near, axis=0))[1] > _WIDE * cell:
            return True
    return False


def _nodes(scene: SceneData, parts: tuple[_Part, _Part], low: Array, high: Array) -> Array:
    """Return nodes between two corners that may be near both, all or some (n, d)."""
    cell, base = scene.cell_size, np.asarray(scene.lower, dtype=np.float64)
    d = scene.dimension
    first = np.ceil((low - base) / cell - 1e-3).astype(np.int64)
    last = np.floor((high - base) / cell + 1e-3).astype(np.int64)
    counts = (last - first) // _EDGE + 1
    if np.any(last < first) or counts.astype(np.float64).prod() > _BLOCKS:
        return np.empty((0, d))
    keys = np.stack(np.unravel_index(np.arange(int(counts.prod())), tuple(counts)), axis=1)
    middle = base + (first + keys * _EDGE + 0.5 * (_EDGE - 1)) * cell
    radius = 0.5 * (_EDGE - 1) * cell * np.sqrt(d)
    for part in parts:
        if part.axis < 0 and not part.boundary.shape.bounding:  # type: ignore[union-attr]
            continue
        away = part.distance(middle)
        near = away <= radius + part.reach(cell) + cell
        if not part.is_region:
            near &= away >= -(radius + 2 * cell)
        keys, middle = keys[near], middle[near]
    if len(keys) > _NEAR:
        keys = keys[np.linspace(0, len(keys) - 1, _NEAR).astype(np.int64)]
    inner = np.array(list(itertools.product(range(_EDGE), repeat=d)))
    index = (first + (keys * _EDGE)[:, None, :] + inner[None]).reshape(-1, d)
    index = index[np.all(index <= last, axis=1)]
    return np.asarray(base + index * cell)


def _open(scene: SceneData, parts: tuple[_Part, _Part], p: Array) -> npt.NDArray[np.bool_]:
    """Return which nodes (n,) have room for material beside them: outside of all solids there."""
    cell = scene.cell_size
    free = np.zeros(len(p), dtype=bool)
    for corner in itertools.product((-0.5, 0.5), repeat=scene.dimension):
        x = p + np.array(corner) * cell
        clear = np.all((x > scene.lower) & (x < scene.upper), axis=1)
        for boundary in scene.boundaries if len(p) else ():
            if isinstance(boundary.shape, Solid) and not isinstance(boundary.response, Prescribed):
                left = np.flatnonzero(clear & ~free)
                if len(left):
                    clear[left] = boundary.shape.distance(x[left]) > 0
        free |= clear
    return free


def _contradict(one: _Part, two: _Part, p: Array, cell: float) -> npt.NDArray[np.bool_]:
    """Return at which nodes (n,) no velocity satisfies both, or both rub along one plane."""
    normals = [_normal(part, p, cell) for part in (one, two)]
    known = np.all([np.linalg.norm(n, axis=1) > _ALONG for n in normals], axis=0)
    cosine = np.sum(normals[0] * normals[1], axis=1)
    out = np.zeros(len(p), dtype=bool)
    smooth = not isinstance(one.response, Sticky | Prescribed)
    smooth &= not isinstance(two.response, Sticky | Prescribed)
    if smooth and _rubs(one.response) != _rubs(two.response):
        out |= known & (cosine > _ALONG)
    for u, w in itertools.product(_velocities(one, p), _velocities(two, p)):
        speed = np.maximum(np.linalg.norm(u, axis=1), np.linalg.norm(w, axis=1))
        least = _SLACK * speed
        fixed = [_fixed(part, p.shape[1]) for part in (one, two)]
        if fixed[0].any() and fixed[1].any():
            both = fixed[0] & fixed[1]
            apart = np.any(np.abs(u - w)[:, both] > least[:, None], axis=1)
            out |= apart & (speed > 0)
        elif fixed[0].any() or fixed[1].any():
            # One says the velocity, or some of it; the other its component along its normal.
            k = 0 if fixed[0].any() else 1
            said, other = (u, w) if k == 0 else (w, u)
            n = normals[1 - k]
            told = np.all((np.abs(n) < 0.1) | fixed[k], axis=1)
            into = np.sum((said - other) * n, axis=1)
            off = (two, one)[k].response
            wrong = into < -least if isinstance(off, Separable) else np.abs(into) > least
            out |= known & told & wrong & (speed > 0)
        else:
            along = np.sum((u - w) * normals[0], axis=1)
            pair = isinstance(one.response, Separable), isinstance(two.response, Separable)
            same, opposite = cosine > _ALONG, cosine < -_ALONG
            if not any(pair):
                wrong = (same | opposite) & (np.abs(along) > least)
            elif all(pair):
                wrong = opposite & (along > least)
            else:
                # The one that holds must not enter the one that lets go.
                sign = 1.0 if pair[0] else -1.0
                wrong = (same & (sign * along > least)) | (opposite & (along > least))
            out |= known & wrong & (speed > 0)
    return out


def _fixed(part: _Part, d: int) -> npt.NDArray[np.bool_]:
    """Return of which components (d,) a boundary says the velocity."""
    if isinstance(part.response, Prescribed):
        mask = part.response.axes(d)
        return np.array([bool(mask >> a & 1) for a in range(d)])
    sticky = isinstance(part.response, Sticky)
    sticky |= isinstance(part.response, Mirror) and not part.response.slip
    return np.full(d, sticky)


def _normal(part: _Part, p: Array, cell: float) -> Array:
    """Return the normals (n, d) into the material; shorter than 1 where faces are equally near."""
    moves = 1e-3 * cell * np.eye(p.shape[1])
    slope = [part.distance(p + m) - part.distance(p - m) for m in moves]
    return np.stack(slope, axis=1) / (2e-3 * cell)


def _velocities(part: _Part, p: Array) -> list[Array]:
    """Return velocities (n, d) that a boundary has at nodes: the fastest, and the other way."""
    boundary = part.boundary
    given: Any = boundary.motion
    if not isinstance(given, TimeTable):
        given = motion_of(boundary)[0]
    d = p.shape[1]
    rows = np.zeros((1, d))
    if given is not None:
        time, rows = given.arrays()
        rows = rows.reshape(len(time), -1)
        if motion_of(boundary)[1]:
            slopes = np.diff(rows, axis=0) / np.diff(time)[:, None]
            rows = slopes if len(slopes) else np.zeros((1, d))
    fastest = rows[np.argmax(np.sum(rows * rows, axis=1))]
    back = rows[np.argmin(rows @ fastest)]
    found = [fastest] if np.allclose(fastest, back) else [fastest, back]
    out = [np.broadcast_to(v, p.shape) for v in found]
    turning = boundary.rotation
    if turning is None:
        return out
    rate = turning.rate if turning.rate is not None else 1.0
    if isinstance(rate, TimeTable):
        rate = float(np.abs(rate.arrays()[1]).max())
    arm = p - np.asarray(turning.about)
    axis = np.asarray(turning.direction()) * float(rate)
    full = np.zeros((len(p), 3))
    full[:, :d] = arm
    return [v + np.cross(axis, full)[:, :d] for v in out]
