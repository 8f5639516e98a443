"""A simulation that several processes share: which part is here, what all must agree upon."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

from libmpm._src import errors
from libmpm._src.errors import Error, NumericalError, SceneError
from libmpm._src.run import backends
from libmpm._src.run.engine_spec import choose_device
from libmpm._src.run.rank_messages import Link
from libmpm._src.scene.data import SceneData
from libmpm._src.sensors.python_sensors import Sampled

if TYPE_CHECKING:
    from libmpm._src.run.simulation import Simulation

__all__ = ["Sharing"]


class Sharing:
    """The part of a `Simulation` that knows of other processes."""

    _totals: Sequence[int] = ()

    def _simulation(self) -> Simulation:
        return cast("Simulation", self)

    def _select(
        self, scene: SceneData, device: str | Sequence[str], threads: int, ranks: str | None
    ) -> tuple[backends.Backend, int]:
        """Return the backend, and the threads of this process."""
        if ranks is None:
            return backends.select(choose_device(scene, device)), threads
        if ranks != "processes":
            raise SceneError(f"ranks is {ranks!r}; expected 'processes' or None")
        backend = backends.select_process(choose_device(scene, device))
        assert backend.link is not None
        for placed in scene.sensors:
            if backend.ranks > 1 and isinstance(placed.sensor, Sampled):
                raise SceneError(
                    f"sensor '{placed.name}' is evaluated in Python, which is not built for ranks "
                    "as processes; take ranks of one process, device=['cpu', 'cpu'], or a sensor "
                    "of the engine"
                )
        return backend, backend.link.threads(threads)

    @property
    def rank(self) -> int:
        """Which of the ranks this process is, from 0; 0 where they are not processes."""
        link = self._simulation()._backend.link
        return 0 if link is None else link.rank

    @property
    def _link(self) -> Link | None:
        """The link to the other processes; None where there are none."""
        run = self._simulation()
        return run._backend.link if run.ranks > 1 else None

    def totals(self) -> list[int]:
        """Return the number of particles of each body, on all ranks, at the last halt."""
        if self._link is not None:
            return list(self._totals)
        run = self._simulation()
        return [run.particle_count(i) for i in range(len(run.particles))]

    def _count_together(self, engine: Any) -> None:
        if self._link is not None:
            bodies = range(len(self._simulation()._scene.bodies))
            self._totals = self._link.add([int(engine.particle_count(i)) for i in bodies])

    @contextmanager
    def _together(self) -> Iterator[None]:
        """What fails on one rank ends all; what all have agreed upon leaves them at work.

        That is an interrupt, what `_alike` raises, and a `NumericalError`: the engine's faults and
        what the guard finds are joined before anyone raises them.
        """
        try:
            yield
        except (KeyboardInterrupt, NumericalError):
            raise
        except BaseException as error:
            if self._link is not None and not vars(error).get("alike", False):
                self._link.stop(error)
            raise

    @contextmanager
    def _alike(self) -> Iterator[None]:
        """What one rank refuses all refuse, each by an `Error` of that class: work may go on."""
        own: Error | None = None
        try:
            yield
        except Error as error:
            if self._link is None:
                raise
            own = error
        if self._link is None:
            return
        told = self._link.tell(None if own is None else [type(own).__name__, str(own)])
        if own is None:
            refused = [(r, *word) for r, word in enumerate(told) if word is not None]
            if not refused:
                return
            rank, name, text = refused[0]
            kind = getattr(errors, str(name), Error)
            if not (isinstance(kind, type) and issubclass(kind, Error)):
                kind = Error
            own = cast("Error", kind(f"rank {rank}: {text}"))
        vars(own)["alike"] = True
        raise own

    def _agreed(self, word: str) -> str:
        """Return why to stop, the same on all ranks."""
        return word if self._link is None else self._link.first_word(word)
