"""What a guard finds of bodies that friction keeps apart and that lie in each other all the same.

Contact measures gaps by the density at rest (`design/contact.md`), so a body that is crushed counts
as thicker than it is: normals turn at its edges, and these enter its neighbours. A look reads
nothing of a particle unless a body is crushed.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from libmpm._src.boundaries.contact_laws import Friction
from libmpm._src.scene.contact_fields import Groups
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData

__all__ = ["CRUSHED", "Entered", "crushed_bodies", "deepest_entry", "entered"]

Numbers = NDArray[np.float64]

#: Mean volume ratio of a body below which it is looked at.
CRUSHED = 0.4

#: Bodies that are crushed, and others beside them, that one look reads at most: more come in turn,
#: so that a look takes no longer the more bodies there are.
MOST = 100

#: Signed distance of a node from a flat face, cells, inside above 0, by the volume fraction of the
#: body there: the inverse of `filled_at` in physics/contact.hpp.
_AT = np.linspace(-1.5, 1.5, 3001)
_FRACTION = np.where(
    np.abs(_AT) <= 0.5,
    0.5 + 0.75 * _AT - _AT**3 / 3,
    np.where(_AT < 0, (_AT + 1.5) ** 3 / 6, 1 - (1.5 - _AT) ** 3 / 6),
)


class Entered(NamedTuple):
    """The particle of `body` whose middle lies deepest in `other`; bodies by their numbers."""

    #: Of the middle below the face, cells.
    depth: float
    body: int
    other: int
    #: Which of the two is crushed.
    crushed: int
    #: The contact that keeps them apart.
    contact: int
    #: Of the particle, and its place in the world, m.
    id: int
    position: tuple[float, ...]


class _Particles(NamedTuple):
    """Those of one body in the order of ids; lengths in cells, from the domain's corner."""

    id: NDArray[Any]
    position: Numbers
    volume: Numbers


def crushed_bodies(scene: SceneData, ratios: Sequence[float]) -> list[int]:
    """Return the bodies of particles that friction meets and that have lost most of their volume.

    `ratios`: mean volume ratio of each body; not a number where one has no particles.
    """
    few = [i for i, ratio in enumerate(ratios) if ratio < CRUSHED and _watched(scene, i)]
    if not few or not any(isinstance(contact.law, Friction) for contact in scene.contacts):
        return []
    return few


def _watched(scene: SceneData, body: int) -> bool:
    """Whether a body is a solid of particles: vertices of elements fill no cells around them."""
    found = scene.bodies[body]
    return not (found.material.table.stores_volume or isinstance(found.shape, ElementMesh))


def deepest_entry(x: Numbers, other: Numbers, volume: Numbers) -> tuple[float, int]:
    """Return how deep the deepest of the points x lies in a body, cells, and its row.

    other, volume: middles of the body's particles, cells, and their volumes as they are now,
    cells^d. The depth is that below a flat face with the volume fractions of the nodes around the
    point; points of a body that touches it, 2^d a cell, have -0.25. (-1.5, -1) where none is near.
    """
    d = x.shape[1]
    low = np.maximum(x.min(axis=0), other.min(axis=0)) - 1.5
    high = np.minimum(x.max(axis=0), other.max(axis=0)) + 1.5
    near = np.flatnonzero(((x >= low) & (x <= high)).all(axis=1))
    by = np.flatnonzero(((other >= low - 3) & (other <= high + 3)).all(axis=1))
    if not len(near) or not len(by):
        return -1.5, -1
    # Numbers of nodes in a box that has room for all that follow.
    origin = np.floor(low).astype(np.int64) - 6
    extent = np.ceil(high).astype(np.int64) + 7 - origin
    step = np.array([int(np.prod(extent[a + 1 :])) for a in range(d)], dtype=np.int64)

    cell = np.floor(x[near])
    inside = x[near] - cell
    corner = (cell.astype(np.int64) - origin) @ step
    corners = list(itertools.product((0, 1), repeat=d))
    nodes = np.unique(np.concatenate([corner + np.dot(k, step) for k in corners]))

    first = np.floor(other[by] - 0.5)
    off = other[by] - first
    weights = np.stack([0.5 * (1.5 - off) ** 2, 0.75 - (off - 1) ** 2, 0.5 * (off - 0.5) ** 2])
    lowest = (first.astype(np.int64) - origin) @ step
    fraction = np.zeros(len(nodes))
    for k in itertools.product(range(3), repeat=d):
        key = lowest + np.dot(k, step)
        at = np.minimum(np.searchsorted(nodes, key), len(nodes) - 1)
        share = volume[by] * np.prod([weights[k[a], :, a] for a in range(d)], axis=0)
        fraction += np.bincount(at, np.where(nodes[at] == key, share, 0.0), len(nodes))
    distance = np.interp(fraction, _FRACTION, _AT)

    depth = np.zeros(len(near))
    for k in corners:
        part = np.prod(np.where(np.array(k) == 1, inside, 1 - inside), axis=1)
        depth += part * distance[np.searchsorted(nodes, corner + np.dot(k, step))]
    i = int(np.argmax(depth))
    return float(depth[i]), int(near[i])


def entered(simulation: Running, ratios: Sequence[float], look: int) -> Entered | None:
    """Return the deepest entry into the bodies that are crushed, and of them into others.

    None where none is crushed or near another. `look` is the number of this look: of more than
    `MOST` bodies it decides whose turn it is. Ranks call this together, with the same `ratios`
    (of all of them), and are all told the same.
    """
    scene, link = simulation.scene, simulation._shared.link
    found = crushed_bodies(scene, ratios)
    if not found:
        return None
    groups = Groups(scene)
    crushed = _in_turn(found, look)
    beside = _beside(scene, groups, crushed)
    others = _in_turn(beside, look // _turns(found))
    read = {i: _particles(simulation, i) for i in sorted({*crushed, *others})}
    best: Entered | None = None
    for i, j, contact in _near(scene, groups, crushed, read):
        for a, b in ((i, j), (j, i)):
            depth, k = deepest_entry(read[a].position, read[b].position, read[b].volume)
            if k >= 0 and (best is None or depth > best.depth):
                place = read[a].position[k] * scene.cell_size + simulation.offset
                where = tuple(float(p) for p in place)
                best = Entered(depth, a, b, i, contact, int(read[a].id[k]), where)
    if link is None:
        return best
    told = link.tell(best)[0]  # only the first has particles to look at
    return None if told is None else Entered(*told)._replace(position=tuple(told[-1]))


def _turns(bodies: Sequence[int]) -> int:
    return -(-len(bodies) // MOST)


def _in_turn(bodies: Sequence[int], look: int) -> Sequence[int]:
    turns = _turns(bodies)
    return bodies[look % turns :: turns] if turns > 1 else bodies


def _beside(scene: SceneData, groups: Groups, crushed: Sequence[int]) -> list[int]:
    """Return the bodies that friction keeps apart from one of those that are crushed."""
    few, found = set(crushed), set[int]()
    for n, contact in enumerate(scene.contacts):
        if not isinstance(contact.law, Friction):
            continue
        for *_, g, h in groups.pairs(n):
            for one, others in ((g, h), (h, g)):
                if few.intersection(groups.members[one]):
                    found.update(groups.members[others])
    return sorted(i for i in found if _watched(scene, i))


def _near(
    scene: SceneData,
    groups: Groups,
    crushed: Sequence[int],
    read: Mapping[int, _Particles],
) -> Iterator[tuple[int, int, int]]:
    """Yield (crushed body, other body, contact) of the pairs whose boxes meet, in this order."""
    there = [i for i in read if len(read[i].id)]
    if not there:
        return
    # Half a cell is more than any face lies beyond the middles of its particles.
    low = np.array([read[i].position.min(axis=0) for i in there]) - 0.5
    high = np.array([read[i].position.max(axis=0) for i in there]) + 0.5
    laws = [n for n, contact in enumerate(scene.contacts) if isinstance(contact.law, Friction)]
    done: set[tuple[int, int]] = set()
    for row, i in enumerate(there):
        if i not in crushed:
            continue
        for other in np.flatnonzero(((low <= high[row]) & (high >= low[row])).all(axis=1)):
            j = there[int(other)]
            contact = next((n for n in laws if groups.meet(n, i, j)), None)
            if contact is not None and (j, i) not in done:
                done.add((i, j))
                yield i, j, contact


def _particles(simulation: Running, body: int) -> _Particles:
    """Return the particles of a body; of several processes all on the first, none on the others."""
    names = ["id", "position", "volume"]
    frozen = simulation.scene.method.leaving == "freeze"
    read = simulation.engine.attributes(body, [*names, "frozen"] if frozen else names)
    link = simulation._shared.link
    rows = {name: np.asarray(array) for name, array in read.items()}
    every = rows if link is None else link.gather(rows)
    if every is None:
        every = {name: array[:0] for name, array in rows.items()}
    # In one order, so that sums have the same bits on any number of ranks.
    order = np.argsort(every["id"], kind="stable")
    if frozen:
        order = order[every["frozen"][order] == 0]  # where it left the domain, and part of nothing
    dx, d = simulation.scene.cell_size, simulation.scene.dimension
    position = np.asarray(every["position"][order], dtype=np.float64) / dx
    return _Particles(every["id"][order], position, every["volume"][order] / dx**d)
