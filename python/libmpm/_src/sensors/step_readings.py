"""What sensors read at one step boundary, each array once."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.sensors import attributes
from libmpm._src.sensors.reductions import Array
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.methods.transfer import Kernel
    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData

__all__ = ["REACH", "SPREADS", "Box", "Moment", "Nodes", "gravity_at", "stores_velocity"]

#: Kernels with which a body's share of a node follows from the places of its particles.
SPREADS = ("linear", "ddmp", "quadratic", "cubic")

#: Lower and upper corner, (d,) m in the scene; sides may be infinite.
Box = tuple[Sequence[float] | Array, Sequence[float] | Array]

#: Corners of boxes, m from the lower corner of the domain, as the engine takes them.
Boxes = Sequence[tuple[list[float], list[float]]]

#: Cells from a particle within which all nodes are that it takes from or leaves at.
REACH = 3

#: Cells of a table from places to nodes, 8 bytes each.
_LARGEST_TABLE = 1 << 25


def stores_velocity(scene: SceneData) -> bool:
    """Return whether particles keep a velocity of their own, which then is that of the last step.

    Otherwise velocities are read from the grid, with gravity and boundaries of the coming step.
    """
    if scene.grid is not None:
        return True
    transfer = scene.transfer
    plain = transfer.scheme in ("PIC", "APIC")
    return not plain and not (transfer.scheme == "FMPM" and transfer.every == 1)


def gravity_at(scene: SceneData, time: float) -> Array:
    """Return gravity at a time, (d,), m/s²."""
    gravity = scene.gravity
    return gravity.at(time) if isinstance(gravity, TimeTable) else np.asarray(gravity, np.float64)


class Nodes:
    """Nodes with mass: `cell` (n, d) int64, `mass` (n,) kg, `velocity` (n, d) m/s.

    `momentum` (n, d) kg·m/s is what particles have left there, stress included, before gravity and
    boundaries; `position` (n, d) m is that of the scene.
    """

    def __init__(self, simulation: Running, within: Boxes = ()) -> None:
        """Read the grid of a simulation: the blocks that boxes touch, or without any all."""
        scene, engine = simulation.scene, simulation.engine
        d = scene.dimension
        sums = engine.sums(within)
        cell = np.asarray(sums["cell"], dtype=np.int64).reshape(-1, d)
        place = np.asarray(engine.grid("position", within)).reshape(-1, d)
        seen = np.floor(place / scene.cell_size).astype(np.int64)
        velocity = np.asarray(engine.grid("velocity", within)).reshape(-1, d)
        # Without particles there are no sums.
        none = np.zeros(len(cell))
        # The sums also have nodes whose mass is rounding; both lists are sorted alike.
        low = np.minimum(cell.min(axis=0, initial=0), seen.min(axis=0, initial=0))
        high = np.maximum(cell.max(axis=0, initial=0), seen.max(axis=0, initial=0))
        self._kernel = scene.method.kernel_choice
        #: Cells from its home in which a particle has nodes.
        self._reach = 2 if self._kernel.name == "cubic" else 1
        # Room for the stencils of particles whose home is beside a node.
        room = 2 * self._reach
        self._low, self._shape = low - room, high - low + 2 * room + 1
        keys, wanted = self._key(cell), self._key(seen)
        order, by = np.argsort(keys), np.argsort(wanted)
        rows = order[np.searchsorted(keys, wanted[by], sorter=order)]
        self.key = wanted[by]
        self.cell = cell[rows]
        self.mass = np.asarray(sums.get("mass", none))[rows]
        self.velocity = velocity[by]
        momentum = [np.asarray(sums.get(f"momentum_{a}", none))[rows] for a in "xyz"[:d]]
        self.momentum = np.stack(momentum, axis=1)
        self.position = (self.cell + 0.5) * scene.cell_size + np.asarray(scene.lower)
        self._cell_size = scene.cell_size

    def _key(self, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return one number per cell that sorts as its coordinates; -1 outside."""
        at = cell - self._low
        fits = np.all((at >= 0) & (at < self._shape), axis=1)
        key = np.zeros(len(cell), dtype=np.int64)
        for a, n in enumerate(self._shape.tolist()):
            key = key * n + at[:, a]
        return np.where(fits, key, -1)

    @cached_property
    def _table(self) -> NDArray[np.int64] | None:
        """Row by key, -1 where there is none; None where the nodes lie too far apart for one."""
        if math.prod(self._shape.tolist()) > _LARGEST_TABLE:
            return None
        table = np.full(math.prod(self._shape.tolist()), -1, dtype=np.int64)
        table[self.key] = np.arange(len(self.key))
        return table

    def _rows(self, key: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows of keys, -1 where there is none; there is at least one node."""
        if self._table is not None:
            return np.where(key >= 0, self._table[key], -1)
        row = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return np.where(self.key[row] == key, row, -1)

    def find(self, cell: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows of cells (k, d), -1 where a cell is none of these nodes."""
        if len(self.key) == 0:
            return np.full(len(cell), -1, dtype=np.int64)
        return self._rows(self._key(cell))

    def spread(self, position: Array, values: list[Array]) -> list[Array]:
        """Return Σ N_ip value_p at each node, (n,) each, with the functions of a deposit.

        `position` (m, d) m is relative to the lower corner of the domain. Of kernels that are not
        of `SPREADS`, with quadratic splines.
        """
        found = [np.zeros(len(self.key)) for _ in values]
        if len(self.key) == 0 or len(position) == 0:
            return found
        home = np.floor(position / self._cell_size).astype(np.int64)
        reach = self._reach
        near = np.all(
            (home >= self.cell.min(axis=0) - reach) & (home <= self.cell.max(axis=0) + reach),
            axis=1,
        )
        home, values = home[near], [v[near] for v in values]
        xi = position[near] / self._cell_size - (home + 0.5)
        key = self._key(home)
        strides = np.append(np.cumprod(self._shape[:0:-1])[::-1], 1)
        weights = _weights(self._kernel, xi)
        d = position.shape[1]
        for shift in np.ndindex(*(len(weights),) * d):
            row = self._rows(key + int((np.asarray(shift) - reach) @ strides))
            weight = weights[shift[0]][:, 0]
            for a in range(1, d):
                weight = weight * weights[shift[a]][:, a]
            kept = row >= 0
            for total, value in zip(found, values, strict=True):
                share = (weight * value)[kept]
                total += np.bincount(row[kept], weights=share, minlength=len(total))
        return found


def _weights(kernel: Kernel, xi: Array) -> list[Array]:
    """Return weights (m, d) of a particle's nodes by axis, from offsets of its home's centre.

    Quadratic ones for kernels that are not of `SPREADS`.
    """
    if kernel.name == "quadratic" or kernel.name not in SPREADS:
        return [0.5 * (0.5 - xi) ** 2, 0.75 - xi**2, 0.5 * (0.5 + xi) ** 2]
    if kernel.name == "cubic":
        away = [np.abs(xi - n) for n in range(-2, 3)]
        return [
            np.where(r <= 1, 2 / 3 - r * r + 0.5 * r**3, np.maximum(2.0 - r, 0.0) ** 3 / 6)
            for r in away
        ]
    weights = [np.maximum(1.0 - np.abs(xi - n), 0.0) for n in (-1, 0, 1)]
    if not kernel.modified:
        return weights
    # The two nodes of the span that the particle is in: the lower one, or the upper.
    lower = xi < 0
    held = [np.clip(w, 0.001, 0.999) for w in weights]
    return [np.where(lower, held[0], 0.0), held[1], np.where(lower, 0.0, held[2])]


class _Window:
    """Boxes in which something is read; everywhere as soon as one asks for that."""

    def __init__(self) -> None:
        self._everywhere = False
        self._boxes: list[tuple[list[float], list[float]]] = []

    def add(self, scene: SceneData, within: Box | None) -> None:
        """Look into a box of the scene as well, or everywhere."""
        if within is None:
            self._everywhere = True
            return
        corner = np.asarray(scene.lower, dtype=np.float64)
        spare = 1e-3 * scene.cell_size  # rounding of coordinates
        low, high = (np.asarray(side, dtype=np.float64) - corner for side in within)
        self._boxes.append(((low - spare).tolist(), (high + spare).tolist()))

    @property
    def boxes(self) -> Boxes:
        """Return them, none for everywhere."""
        return () if self._everywhere else tuple(self._boxes)


class Moment:
    """A simulation at a step boundary; arrays are read when first asked for and kept.

    Who announces what it will read, and where, gets that and whatever others announced: at least
    what lies in its box. What nobody announced is read everywhere.
    """

    def __init__(self, simulation: Running) -> None:
        """Look at a simulation; nothing is read yet."""
        self.simulation = simulation
        self.scene = simulation.scene
        self.time = simulation.time
        self._wanted: dict[int, set[str]] = {}
        self._windows: dict[int, _Window] = {}
        self._of_nodes = _Window()
        self._arrays: dict[int, tuple[Boxes, dict[str, NDArray[Any]]]] = {}

    @cached_property
    def dt(self) -> float:
        """The coming time step, s."""
        return float(self.simulation.engine.time_step)

    @cached_property
    def velocity_time(self) -> float:
        """The time of the velocities, s: until then gravity and boundaries are in them."""
        return self.time + (0.0 if stores_velocity(self.scene) else self.dt)

    @cached_property
    def nodes(self) -> Nodes:
        """The nodes with mass."""
        return Nodes(self.simulation, self._of_nodes.boxes)

    def nodes_about(self, *relative: Array) -> Nodes:
        """Return the nodes that particles (n, d), m from the domain's corner, reach."""
        if not sum(map(len, relative)):
            return self.nodes
        places = np.concatenate(relative)
        spare = REACH * self.scene.cell_size
        box = (places.min(axis=0) - spare).tolist(), (places.max(axis=0) + spare).tolist()
        return Nodes(self.simulation, [box])

    @cached_property
    def stored(self) -> dict[int, list[str]]:
        """Names that the engine has, by body."""
        engine = self.simulation.engine
        return {i: list(engine.attribute_names(i)) for i in range(len(self.scene.bodies))}

    def want(self, body: int, names: Iterable[str], within: Box | None = None) -> None:
        """Announce attributes of a body in a box, so that all are read in one pass."""
        self._windows.setdefault(body, _Window()).add(self.scene, within)
        self._name(body, names)

    def want_nodes(self, within: Box | None = None) -> None:
        """Announce the nodes in a box."""
        self._of_nodes.add(self.scene, within)

    def _name(self, body: int, names: Iterable[str]) -> None:
        known = self._wanted.setdefault(body, {"id"})
        for name in names:
            known.update(attributes.reads(name, self.scene.bodies[body], self.stored[body]))

    def arrays(self, body: int) -> dict[str, NDArray[Any]]:
        """Return the engine's arrays that were announced, rows by id, without what has left.

        Positions are in the world, m.
        """
        wanted = self._wanted.setdefault(body, {"id"})
        boxes = self._windows[body].boxes if body in self._windows else ()
        where, have = self._arrays.get(body, ((), {}))
        if wanted <= set(have) and where == boxes:
            return have
        asked = sorted(wanted)
        frozen = self.scene.grid is None and self.scene.method.leaving == "freeze"
        if frozen:
            asked.append("frozen")
        read = self.simulation.engine.attributes(body, asked, boxes)
        order = np.argsort(read["id"], kind="stable")
        if frozen:
            order = order[np.asarray(read["frozen"])[order] == 0]
        found = {
            name: np.asarray(read[name])[... if attributes.of_elements(name) else order]
            for name in wanted
        }
        if "position" in found:
            found["position"] = found["position"] + self.simulation.offset
        self._arrays[body] = boxes, found
        return found

    def attribute(self, body: int, name: str) -> NDArray[Any]:
        """Return an attribute of a body's particles by library or engine name, rows by id."""
        self._name(body, (name,))
        source = attributes.Source(
            self.arrays(body), self.scene.bodies[body], attributes.upward(self.scene)
        )
        return attributes.compute(name, source)

    def places(self, body: int, name: str) -> NDArray[Any]:
        """Return where the rows of an attribute are, m in the scene: of elements their middles."""
        place = self.in_scene(self.attribute(body, "position"))
        mesh = self.scene.bodies[body].shape
        if isinstance(mesh, ElementMesh) and attributes.of_elements(name):
            return np.asarray(place[mesh.rows()].mean(axis=1))
        return place

    def in_scene(self, world: Array) -> Array:
        """Return points of the world in coordinates of the scene, m."""
        found: Array = world - np.asarray(self.scene.origin)
        return found

    def relative(self, world: Array) -> Array:
        """Return points of the world relative to the domain's lower corner, m."""
        return world - self.simulation.offset
