"""What the rules of the advice look at in a scene: bodies by kind, sizes in cells, speeds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.formulas import Field
from libmpm._src.base.time_tables import TimeTable, largest
from libmpm._src.boundaries.distance_field import motion_of
from libmpm._src.boundaries.flows import Inflow, Outflow
from libmpm._src.boundaries.responses import DecayLayer, Mirror, Response, Slip, Sticky
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.method import FBar
from libmpm._src.scene.places import extent_of, initial_gravity, planes
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.filling import BOXES
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.shapes.solid import GivenPoints, Solid

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData
    from libmpm._src.scene.parts import Body, Boundary

__all__ = ["LOCKS", "Facts", "own_fbar"]

#: Poisson's ratio from which a solid counts as nearly incompressible.
LOCKS = 0.45
#: Parts of a cell by which levels or ends count as equal.
_SAME = 1e-6
#: Points on an axis at which a field of velocity is looked at.
_LOOKED_AT = 9


@dataclass(frozen=True)
class Facts:
    """The facts of one scene; `laws` are the solids that the atlas has."""

    scene: SceneData
    laws: frozenset[str]

    # ---- bodies -----------------------------------------------------------------------------

    @cached_property
    def water(self) -> tuple[Body, ...]:
        """Bodies of water."""
        return tuple(b for b in self.scene.bodies if b.material.table.name == "TaitFluid")

    @cached_property
    def solids(self) -> tuple[Body, ...]:
        """Bodies of a law in the atlas."""
        return tuple(b for b in self.scene.bodies if b.material.table.name in self.laws)

    @cached_property
    def others(self) -> tuple[Body, ...]:
        """Bodies of materials that the atlas has not."""
        known = {b.name for b in (*self.water, *self.solids)}
        return tuple(b for b in self.scene.bodies if b.name not in known)

    @cached_property
    def setups(self) -> tuple[tuple[str, FBar | None, float | None, int], ...]:
        """Which F-bar, wave speed in m/s and particles per cell there are, of water and solids.

        The first is where a row of the atlas has it, "fbar" or "solid_fbar".
        """
        found = {}
        for name, bodies in (("fbar", self.water), ("solid_fbar", self.solids)):
            for b in bodies:
                own = own_fbar(b), wave_speed(b.material), b.particles_per_cell
                found[name, *map(repr, own)] = (name, *own)
        return tuple(found.values())

    # ---- gravity and motion -----------------------------------------------------------------

    @cached_property
    def gravity(self) -> float:
        """Largest gravity, m/s²."""
        given = self.scene.gravity
        if isinstance(given, TimeTable):
            return float(np.abs(given.arrays()[1]).max())
        return math.hypot(*given)

    @cached_property
    def vertical(self) -> int:
        """Axis of gravity; the last one without any."""
        pull = np.abs(initial_gravity(self.scene))
        if isinstance(self.scene.gravity, TimeTable):
            pull = np.abs(self.scene.gravity.arrays()[1]).max(axis=0)
        return int(np.argmax(pull)) if np.any(pull > 0) else self.scene.dimension - 1

    def speed_of(self, body: Body) -> float:
        """Return the largest speed that a body starts with, m/s."""
        if not isinstance(body.velocity, Field):
            return math.hypot(*body.velocity)
        return float(np.linalg.norm(body.velocity.at(_points_in(body), "velocity"), axis=1).max())

    def turning(self, body: Body) -> float:
        """Return which part of a body's motion about its centre is a turn, of its energy, 0 to 1.

        The turn is the one that fits the velocities best in the box around the body.
        """
        if not isinstance(body.velocity, Field):
            return 0.0
        points = _points_in(body)
        velocity = body.velocity.at(points, "velocity")
        arm, about = points - points.mean(axis=0), velocity - velocity.mean(axis=0)
        energy = float(np.sum(about**2))
        if not energy > 0:
            return 0.0
        flat = np.zeros((len(arm), 3 - arm.shape[1]))
        arm, about = np.hstack([arm, flat]), np.hstack([about, flat])
        inertia = np.sum(arm**2) * np.eye(3) - arm.T @ arm
        spin = np.linalg.lstsq(inertia, np.cross(arm, about).sum(axis=0), rcond=None)[0]
        return float(np.sum(np.cross(spin, arm) ** 2)) / energy

    def submerged(self, body: Body) -> bool:
        """Whether a body lies deep in the water: a cell or more below its surface, among it."""
        if not self.water:
            return False
        (low, high), (first, last) = _ends(body), self.extent
        v = self.vertical
        down = initial_gravity(self.scene)[v] <= 0
        deep = last[v] - high[v] if down else low[v] - first[v]
        among = all(
            a >= c and b <= d
            for axis, (a, b, c, d) in enumerate(zip(low, high, first, last, strict=True))
            if axis != v
        )
        return among and deep >= self.scene.cell_size * (1 - _SAME)

    @cached_property
    def moving(self) -> tuple[str, ...]:
        """Names of boundaries whose shape or face moves, and of inflows and outflows."""
        own = [b.name for b in self.scene.boundaries if b.motion is not None or b.rotation]
        return (*own, *(f.name for f in self.scene.flows))

    @cached_property
    def driven(self) -> float:
        """Largest speed of boundaries that move and of flows, m/s."""
        found = [0.0, *(_speed(boundary) for boundary in self.scene.boundaries)]
        for placed in self.scene.flows:
            flow = placed.flow
            if isinstance(flow, Inflow | Outflow) and flow.velocity is not None:
                given = flow.velocity
                found.append(largest(given) if isinstance(given, TimeTable) else given)
        return max(found)

    @cached_property
    def rubs(self) -> bool:
        """Whether any boundary has friction."""
        return any(max(r.friction) > 0 for _, r in self._responses())

    @cached_property
    def holds(self) -> bool:
        """Whether any boundary holds material along itself."""
        return any(isinstance(r, Sticky) for _, r in self._responses())

    @cached_property
    def surfaces(self) -> tuple[str, ...]:
        """Names of boundaries that are surfaces of any shape."""
        return tuple(b.name for b in self.scene.boundaries if b.is_surface)

    @cached_property
    def mirrorable(self) -> tuple[str, ...]:
        """Names of domain walls at rest that let material glide: mirrors can stand for them."""
        return tuple(
            b.name
            for b in self.scene.boundaries
            if isinstance(b.shape, DomainWalls)
            and isinstance(b.response, Slip)
            and b.motion is None
            and b.time is None
            and not b.bodies
            and b.within is None
        )

    @cached_property
    def mirrored(self) -> bool:
        """Whether domain walls are mirrors already."""
        walls = [r for b, r in self._responses() if isinstance(b.shape, DomainWalls)]
        return any(isinstance(r, Mirror) for r in walls)

    @cached_property
    def linear(self) -> bool:
        """Whether the cells beside walls of the domain are linear already."""
        walls = [b.name for b in self.scene.boundaries if isinstance(b.shape, DomainWalls)]
        return any(p.cell == "linear" and p.boundary in walls for p in planes(self.scene))

    def takes_walls(self, kind: str | None) -> bool:
        """Return whether walls of this kind are there or can stand for those that are."""
        there = {"mirror": self.mirrored, "linear": self.linear}
        return kind is None or there[kind] or bool(self.mirrorable)

    @cached_property
    def layers(self) -> tuple[DecayLayer, ...]:
        """Decay layers of the surfaces."""
        return tuple(b.layer or DecayLayer() for b in self.scene.boundaries if b.is_surface)

    def _responses(self) -> Iterable[tuple[Boundary, Response]]:
        for boundary in self.scene.boundaries:
            for one in boundary.responses:
                yield boundary, one

    # ---- water ------------------------------------------------------------------------------

    @cached_property
    def extent(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Corners of the box around all water, m."""
        ends = [_ends(b) for b in self.water]
        low = tuple(min(x) for x in zip(*(e[0] for e in ends), strict=True))
        return low, tuple(max(x) for x in zip(*(e[1] for e in ends), strict=True))

    @cached_property
    def depth(self) -> float:
        """Height of the water from its lowest to its highest point, m."""
        low, high = self.extent
        return high[self.vertical] - low[self.vertical]

    @cached_property
    def head(self) -> float:
        """Height of water that presses on its lowest point, m: up to a level above it, too."""
        v = self.vertical
        down = -1 if initial_gravity(self.scene)[v] <= 0 else 1
        low, high = self.extent
        foot = low[v] if down < 0 else high[v]
        levels = [b.hydrostatic for b in self.water if b.hydrostatic is not None]
        return max([self.depth, *(-down * (level - foot) for level in levels)])

    @cached_property
    def fall(self) -> float:
        """Height from the domain's bottom to the water's top, m."""
        pull = initial_gravity(self.scene)[self.vertical]
        low, high = self.extent
        v = self.vertical
        return high[v] - self.scene.lower[v] if pull <= 0 else self.scene.upper[v] - low[v]

    @cached_property
    def levels(self) -> int:
        """Number of different surface levels that water starts in balance with."""
        unit = _SAME * self.scene.cell_size
        return len({round(b.hydrostatic / unit) for b in self.water if b.hydrostatic is not None})

    @cached_property
    def swell(self) -> float:
        """Half of what the levels that water starts in balance with differ by, m."""
        levels = [b.hydrostatic for b in self.water if b.hydrostatic is not None]
        return (max(levels) - min(levels)) / 2 if levels else 0.0

    @cached_property
    def balanced(self) -> bool:
        """Whether all water starts in balance, held at its sides, and nothing has run before."""
        started = self.scene.start is not None
        calm = all(b.hydrostatic is not None or self.gravity == 0 for b in self.water)
        return calm and self.held and not started

    @cached_property
    def held(self) -> bool:
        """Whether ends of the domain or boundaries are at all sides of the water, to a cell."""
        near = self.scene.cell_size * (1 + _SAME)
        low, high = self.extent
        # A gate that is gone at some time holds nothing.
        others = [extent_of(self.scene, b) for b in self.scene.boundaries if b.time is None]
        others = [e for e in others if e != (list(self.scene.lower), list(self.scene.upper))]
        for a in range(self.scene.dimension):
            ends = ((low[a], self.scene.lower[a]), (high[a], self.scene.upper[a]))
            beside = [(e[0][a] - near, e[1][a] + near) for e in self._beside(others, a)]
            for side, end in ends if a != self.vertical else ():
                if abs(side - end) > near and not any(x <= side <= y for x, y in beside):
                    return False
        return True

    def _beside(self, others: list[Any], axis: int) -> list[Any]:
        """Return the boundaries that lie beside the water on the other axes."""
        low, high = self.extent
        rest = [a for a in range(len(low)) if a != axis]
        return [
            (first, last)
            for first, last in others
            if all(first[a] < high[a] and last[a] > low[a] for a in rest)
        ]

    @cached_property
    def water_speed(self) -> float:
        """Largest speed that water starts with, m/s."""
        return max((self.speed_of(b) for b in self.water), default=0.0)

    @cached_property
    def at_rest(self) -> bool:
        """Whether the water is in balance and nothing will move it."""
        still = self.water_speed == 0 and not self.moving and self.levels <= 1
        return bool(self.water) and self.balanced and still and not self.solids

    @cached_property
    def ordered(self) -> bool:
        """Whether all water is on a lattice, at the same heights everywhere or in columns."""
        return all(
            isinstance(b.sampling, Columns | None)
            and b.lattice is None
            and not isinstance(b.shape, GivenPoints)
            for b in self.water
        )

    @cached_property
    def closed(self) -> bool:
        """Whether the water fills the domain from wall to wall."""
        slack = _SAME * self.scene.cell_size
        low, high = self.extent
        ends = zip(low, high, self.scene.lower, self.scene.upper, strict=True)
        return all(a <= c + slack and b >= d - slack for a, b, c, d in ends)

    @cached_property
    def fastest(self) -> float:
        """Speed that the water may come to, m/s: by its fall or waves, its start, what drives it.

        √(2 g H) of what falls by H; of waves on water h deep in balance a √(g/h), with half of what
        its levels differ by for a.
        """
        falls = 0.0 if self.closed else math.sqrt(2 * self.gravity * self.fall)
        if self.balanced:
            falls = self.swell * math.sqrt(self.gravity / self.depth)
        solids = max((self.speed_of(b) for b in self.solids), default=0.0)
        return max(falls, self.water_speed, self.driven, solids)

    # ---- sizes ------------------------------------------------------------------------------

    def cells(self, kind: str) -> float:
        """Return the cells across the thinnest extent of "water" or of "solid" bodies.

        Axes on which it reaches from wall to wall do not count, but for the vertical one and for
        what fills the domain.
        """
        return self._water_cells if kind == "water" else self._solid_cells

    @cached_property
    def _water_cells(self) -> float:
        return self._across([self.extent], self.vertical)

    @cached_property
    def _solid_cells(self) -> float:
        return self._across([_ends(b) for b in self.solids], None, self.solids)

    def _across(self, ends: list[Any], always: int | None, bodies: tuple[Body, ...] = ()) -> float:
        slack = _SAME * self.scene.cell_size
        domain = (self.scene.lower, self.scene.upper)
        found = []
        for k, (low, high) in enumerate(ends):
            size = [b - a for a, b in zip(low, high, strict=True)]
            shape = bodies[k].shape if bodies else None
            if isinstance(shape, BOXES):
                size = list(shape.size)
            free = [
                s
                for a, s in enumerate(size)
                if a == always or low[a] > domain[0][a] + slack or high[a] < domain[1][a] - slack
            ]
            walled = self.closed if always is not None else not free
            found.append(min(size if walled else free))
        made: float = min(found) / self.scene.cell_size
        return made

    def compression(self, body: Body) -> float:
        """Return ρ g H/K of a body of water: its loss of volume under the water's head H."""
        have = body.material.parameters()
        return have["density"] * self.gravity * self.head / have["bulk_modulus"]

    def mach(self, body: Body) -> float:
        """Return the largest speed expected in a body, parts of its wave speed."""
        speed = wave_speed(body.material)
        fast = self.fastest if body in self.water else self.speed_of(body)
        return fast / speed if speed else 0.0

    def slender(self, body: Body) -> tuple[int, float]:
        """Return the longest axis of a body and how much longer it is than the shortest."""
        low, high = _ends(body)
        size = [b - a for a, b in zip(low, high, strict=True)]
        return int(np.argmax(size)), max(size) / min(size)


def own_fbar(body: Body) -> FBar | None:
    """Return the F-bar that a body has, "default" in full."""
    if isinstance(body.fbar, FBar):
        return body.fbar
    return FBar() if body.fbar == "default" and body.material.table.stores_volume else None


def _ends(body: Body) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the corners of the box around a body, m."""
    assert isinstance(body.shape, Solid | GivenPoints)
    low, high = body.shape.bounds()
    return tuple(map(float, low)), tuple(map(float, high))


def _points_in(body: Body) -> npt.NDArray[np.float64]:
    """Return points all over the box around a body, (n, d) m."""
    low, high = _ends(body)
    axes = [np.linspace(a, b, _LOOKED_AT) for a, b in zip(low, high, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def _speed(boundary: Boundary) -> float:
    """Return the largest speed by which a boundary moves, m/s; of rotations none is known."""
    if isinstance(boundary.motion, TimeTable):
        return largest(boundary.motion)
    table, holds_places = motion_of(boundary)
    return 0.0 if table is None else largest(table, holds_places)
