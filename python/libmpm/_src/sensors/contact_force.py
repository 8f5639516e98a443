"""The force between two bodies that share one field of velocities.

At a node each body b has a mass m_b and a velocity u_b of its own, momentum and the impulse of its
own stress over m_b; the node takes V = Σ m_b u_b / m. What b gets there from c is the impulse
m_b m_c / m (u_c - u_b): opposite for the two of a pair, and over all c the whole exchange
m_b (V - u_b). The grid keeps sums over all bodies, so u_b is worked out again: particles take
velocity and slope from the nodes of one step (APIC, quadratic splines) and leave them with their
stress at the nodes of the next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.scene.data import SceneData
from libmpm._src.sensors.python_sensors import ContactForce
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import Sampler, axes_of, bodies_of
from libmpm._src.sensors.step_readings import Moment, Nodes

__all__ = ["OfContact"]


@dataclass(frozen=True)
class _Moved:
    """What the nodes of a step gave the particles of a body: velocity (n, d), slope (n, d, d)."""

    ids: NDArray[np.int64]
    velocity: Array
    slope: Array


def _gathered(nodes: Nodes, ids: NDArray[np.int64], place: Array, cell_size: float) -> _Moved:
    """Return v = Σ N v_i and C = 4/Δx² Σ N v_i (x_i - x)ᵀ at places (n, d) m."""
    d = place.shape[1]
    home = np.floor(place / cell_size).astype(np.int64)
    xi = place / cell_size - (home + 0.5)
    weights = (0.5 * (0.5 - xi) ** 2, 0.75 - xi**2, 0.5 * (0.5 + xi) ** 2)
    velocity, slope = np.zeros((len(place), d)), np.zeros((len(place), d, d))
    for shift in np.ndindex(*(3,) * d):
        step = np.asarray(shift) - 1
        row = nodes.find(home + step)
        weight = np.where(row >= 0, weights[shift[0]][:, 0], 0.0)
        for a in range(1, d):
            weight = weight * weights[shift[a]][:, a]
        part = weight[:, None] * nodes.velocity[np.maximum(row, 0)]
        velocity += part
        slope += part[:, :, None] * ((step - xi) * (4.0 / cell_size))[:, None, :]
    return _Moved(ids, velocity, slope)


class OfContact(Sampler):
    """Gives the force of one body on another in the step after a sample is due."""

    def __init__(self, scene: SceneData, sensor: ContactForce) -> None:
        """Take a sensor that has been checked."""
        self._pair = tuple(bodies_of(scene, name)[0] for name in (sensor.body, sensor.by))
        self._every = sensor.interval == 0
        unit = "N" if scene.dimension == 3 else "N/m"
        self.columns = tuple(f"force_{a}" for a in axes_of(scene))
        self.units = (unit,) * scene.dimension
        self._begun: tuple[int, tuple[_Moved, ...]] | None = None

    def announce(self, moment: Moment) -> None:
        """Ask for what a deposit is made of."""
        for body in self._pair:
            moment.want(body, ("mass", "position", "volume", "stress"))

    def row(self, moment: Moment) -> Array | None:
        """Return the force in the step that begins now, or None where the step before is needed."""
        step = moment.simulation.steps
        places = [moment.relative(moment.arrays(body)["position"]) for body in self._pair]
        nodes = moment.nodes_about(*places)
        begun = self._begun
        found = None
        if begun is not None and begun[0] == step - 1:
            found = self._force(moment, nodes, begun[1])
        self._begun, self.again_after = None, None
        if found is None or self._every:
            moved = tuple(self._moved(moment, nodes, body) for body in self._pair)
            self._begun, self.again_after = (step, moved), moment.time
        return found

    def _moved(self, moment: Moment, nodes: Nodes, body: int) -> _Moved:
        arrays = moment.arrays(body)
        place = moment.relative(arrays["position"])
        ids = arrays["id"].astype(np.int64)
        return _gathered(nodes, ids, place, moment.scene.cell_size)

    def _force(self, moment: Moment, nodes: Nodes, moved: tuple[_Moved, ...]) -> Array:
        d = moment.scene.dimension
        (mass, own), (other, its) = (
            self._left(moment, nodes, body, before)
            for body, before in zip(self._pair, moved, strict=True)
        )
        both = (mass > 0) & (other > 0)
        share = 1.0 / nodes.mass[both]
        # m_b m_c / m (u_c - u_b) without the quotients of light nodes.
        exchanged = (mass[both] * share) @ its[both] - (other[both] * share) @ own[both]
        return np.asarray(exchanged / moment.dt).reshape(d)

    def _left(self, moment: Moment, nodes: Nodes, body: int, before: _Moved) -> tuple[Array, Array]:
        """Return mass (n,) and momentum with stress (n, d) that a body has left at the nodes."""
        arrays = moment.arrays(body)
        d = moment.scene.dimension
        _, now, then = np.intersect1d(
            arrays["id"].astype(np.int64), before.ids, assume_unique=True, return_indices=True
        )
        place = moment.relative(arrays["position"])[now]
        mass, volume = arrays["mass"][now], arrays["volume"][now]
        rate = 4.0 * moment.dt / moment.scene.cell_size**2
        affine = mass[:, None, None] * before.slope[then]
        affine = affine - rate * volume[:, None, None] * arrays["stress"][now]
        # Σ N (m v + A (x_i - x)) = Σ N (m v - A x) + (Σ N A) x_i
        fixed = mass[:, None] * before.velocity[then] - np.einsum("nij,nj->ni", affine, place)
        values = [mass, *fixed.T, *affine.reshape(len(now), d * d).T]
        sums = nodes.spread(place, values)
        at = (nodes.cell + 0.5) * moment.scene.cell_size
        turned = np.stack(sums[1 + d :], axis=1).reshape(-1, d, d)
        return sums[0], np.stack(sums[1 : 1 + d], axis=1) + np.einsum("nij,nj->ni", turned, at)

    def state(self) -> dict[str, NDArray[Any]]:
        """Return what the step that has begun gave the particles."""
        if self._begun is None:
            return {}
        found: dict[str, NDArray[Any]] = {
            "step": np.array(self._begun[0]), "after": np.array(self.again_after)
        }  # fmt: skip
        for k, moved in enumerate(self._begun[1]):
            found |= {f"ids{k}": moved.ids, f"v{k}": moved.velocity, f"c{k}": moved.slope}
        return found

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Take up a step that had begun."""
        if "step" in state:
            moved = tuple(_Moved(state[f"ids{k}"], state[f"v{k}"], state[f"c{k}"]) for k in (0, 1))
            self._begun, self.again_after = (int(state["step"]), moved), float(state["after"])
