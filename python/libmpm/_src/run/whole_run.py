"""`WholeRun`: a simulation of several processes as each of them reads it whole.

Whoever reads from it does so on all ranks, in the same order: each read brings the rows of all
ranks to every one. So what is worked out from them is the same everywhere, as in one process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import SceneError
from libmpm._src.run.rank_messages import Link
from libmpm._src.run.views import GridView, ParticlesView
from libmpm._src.sensors import attributes

if TYPE_CHECKING:
    from libmpm._src.run.running import Running

__all__ = ["WholeRun"]

Boxes = Sequence[tuple[Sequence[float], Sequence[float]]]


class _Reads:
    """What is read of an engine, of all ranks; a node counts on one of them."""

    def __init__(self, engine: Any, link: Link) -> None:
        self._engine, self._link = engine, link

    def __getattr__(self, name: str) -> Any:
        """Return what is the same on all ranks."""
        return getattr(self._engine, name)

    def attributes(
        self, body: int, names: Sequence[str], within: Boxes = ()
    ) -> dict[str, NDArray[Any]]:
        """Return the attributes of the particles in boxes, or of all."""
        read: Mapping[str, Any] = self._engine.attributes(body, names, within)
        arrays = {name: np.asarray(value) for name, value in read.items()}
        return self._link.share(arrays, [n for n in arrays if attributes.of_elements(n)])

    def sums(self, within: Boxes = ()) -> dict[str, NDArray[Any]]:
        """Return cells and sums of the nodes in boxes, or of all."""
        read = {name: np.asarray(value) for name, value in self._engine.sums(within).items()}
        # A rank without nodes there has no channels.
        channels = sorted({name for one in self._link.tell(sorted(read)) for name in one})
        empty = np.zeros((0, *read["cell"].shape[1:])), np.zeros(0)
        return self._link.share({n: read.get(n, empty[n != "cell"]) for n in channels})

    def grid(self, name: str, within: Boxes = ()) -> NDArray[Any]:
        """Return an array of the nodes in boxes, or of all."""
        return self._link.share({name: np.asarray(self._engine.grid(name, within))})[name]


#: What a simulation says alike on all ranks.
_ALIKE = frozenset({
    "_shared", "device", "dimension", "dt", "first_step", "flow_series", "guard", "inflow",
    "offset", "outflow", "output", "partition", "pipeline", "plan", "precision", "ranks",
    "scene", "sensors", "series", "smoothing", "statistics", "steps", "stopped", "threads", "time",
    "timings", "totals", "version",
})  # fmt: skip


class WholeRun:
    """A simulation to read: particles and nodes of all ranks, and what these say alike."""

    def __init__(self, simulation: Running, link: Link) -> None:
        """Take the simulation of this process."""
        self._own, self._link = simulation, link
        self.particles = ParticlesView(self)
        self.grid = GridView(self)

    @property
    def engine(self) -> _Reads:
        """What reads from the engines of all ranks."""
        return _Reads(self._own.engine, self._link)

    def particle_count(self, body: int) -> int:
        """Return the number of particles of body number `body`, on all ranks."""
        return int(self._link.add([int(self._own.particle_count(body))])[0])

    def gather(self, body: str, *names: str) -> dict[str, NDArray[Any]]:
        """Return attributes of all particles of a body in the order of ids, on every rank."""
        return self.particles[body].read(["id", *names])

    def __getattr__(self, name: str) -> Any:
        """Return what the simulation has by that name, if it is the same on all ranks."""
        if name not in _ALIKE:
            raise SceneError(
                f"'{name}' of the simulation is asked for while ranks are processes, where it is "
                "each one's own or goes on with the run; expected particles, grid, gather or what "
                "is the same on all ranks, such as time and sensors; use ranks of one process"
            )
        return getattr(self._own, name)
