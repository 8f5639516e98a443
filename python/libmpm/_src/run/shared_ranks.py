"""`SharedRanks`: what processes that share a simulation agree upon; alone it agrees with itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from libmpm._src import errors
from libmpm._src.errors import Error, NumericalError
from libmpm._src.run.backends import Backend

__all__ = ["SharedRanks"]


class SharedRanks:
    """The ranks of one simulation, seen from this process."""

    def __init__(self, backend: Backend, bodies: int) -> None:
        """Take the ranks of a backend, for a scene of so many `bodies`."""
        #: How many ranks share the scene.
        self.ranks = backend.ranks
        #: Which of them this process is; 0 where they are not processes.
        self.rank = 0 if backend.link is None else backend.link.rank
        #: The link to the other processes; None where there are none.
        self.link = backend.link if backend.ranks > 1 else None
        self._bodies = range(bodies)
        self._totals: Sequence[int] = ()

    def totals(self, count: Callable[[int], int]) -> list[int]:
        """Return the particles of each body on all ranks, at the last halt; `count` is this one's.

        It takes the number of a body.
        """
        return [count(i) for i in self._bodies] if self.link is None else list(self._totals)

    def count(self, engine: Any) -> None:
        """Add up the particles of all ranks; all of them call this together."""
        if self.link is not None:
            self._totals = self.link.add([int(engine.particle_count(i)) for i in self._bodies])

    def meet(self) -> None:
        """Return when all ranks have come here."""
        if self.link is not None:
            self.link.tell(None)

    @contextmanager
    def together(self) -> Iterator[None]:
        """What fails on one rank ends all; what all have agreed upon leaves them at work.

        That is an interrupt, what `alike` raises, and a `NumericalError`: the engine's faults and
        what the guard finds are joined before anyone raises them.
        """
        try:
            yield
        except (KeyboardInterrupt, NumericalError):
            raise
        except BaseException as error:
            if self.link is not None and not vars(error).get("alike", False):
                self.link.stop(error)
            raise

    @contextmanager
    def alike(self) -> Iterator[None]:
        """What one rank refuses all refuse, each by an `Error` of that class: work may continue."""
        own: Error | None = None
        try:
            yield
        except Error as error:
            if self.link is None:
                raise
            own = error
        if self.link is None:
            return
        told = self.link.tell(None if own is None else [type(own).__name__, str(own)])
        if own is None:
            refused = [(r, *word) for r, word in enumerate(told) if word is not None]
            if not refused:
                return
            rank, name, text = refused[0]
            kind = getattr(errors, str(name), Error)
            if not (isinstance(kind, type) and issubclass(kind, Error)):
                kind = Error
            own = kind(f"rank {rank}: {text}")
        vars(own)["alike"] = True
        raise own

    def agreed(self, word: str) -> str:
        """Return why to stop, the same on all ranks."""
        return word if self.link is None else self.link.first_word(word)
