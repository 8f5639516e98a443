"""Messages between ranks that are processes, all of them in the same order."""

from __future__ import annotations

import functools
import io
import json
import os
from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.errors import DeviceError

__all__ = ["Link"]

#: What launchers call the number of a process among those of its host.
LOCAL = {
    "torchrun": "LOCAL_RANK",
    "Open MPI": "OMPI_COMM_WORLD_LOCAL_RANK",
    "MPICH": "MPI_LOCALRANKID",
    "Slurm": "SLURM_LOCALID",
}

#: Seconds that processes wait for each other at the start.
MEETING = 120.0


class Link:
    """This process among those of its job. Every method but `stop` is called by all together."""

    def __init__(self, module: Any, seconds: float) -> None:
        """Find the others. Raises `DeviceError` where some do not come in `seconds`."""
        self.process = module.Processes(seconds)

    @classmethod
    def of_job(cls, module: Any) -> Link:
        """Return the one link of this process; it is made when first asked for."""
        return _of_job(module)

    @property
    def rank(self) -> int:
        """Number of this process, from 0."""
        return int(self.process.rank)

    @property
    def ranks(self) -> int:
        """How many there are."""
        return int(self.process.ranks)

    @property
    def local_rank(self) -> int:
        """Number of this process on its host: as its launcher has it, else by the hosts' names."""
        text = os.environ.get(LOCAL.get(str(self.process.launcher), ""), "")
        return int(text) if text.isdecimal() else int(self.process.local_rank)

    @property
    def first(self) -> bool:
        """Whether this is rank 0, which writes what is written once."""
        return self.rank == 0

    def threads(self, asked: int) -> int:
        """Return the threads of this process; of 0, its share of the processors that it may use.

        Processes that their launcher has bound to processors of their own share nothing.
        """
        if asked or "OMP_NUM_THREADS" in os.environ:
            return asked
        mine = len(os.sched_getaffinity(0))
        bound = mine < (os.cpu_count() or 1)
        return mine if bound else max(1, mine // int(self.process.local_ranks))

    def tell(self, value: Any) -> list[Any]:
        """Return the plain values that all give, by rank."""
        texts = self.process.tell_all(json.dumps(value).encode())
        return [_read(rank, "a value", json.loads, text) for rank, text in enumerate(texts)]

    def first_word(self, word: str) -> str:
        """Return the text of the lowest rank that has one; "" where none has."""
        return next((str(w) for w in self.tell(word) if w), "")

    def add(self, counts: list[int]) -> list[int]:
        """Return the sums over all ranks."""
        return [sum(column) for column in zip(*self.tell(counts), strict=True)]

    def gather(
        self, arrays: Mapping[str, NDArray[Any]], everywhere: Collection[str] = ()
    ) -> dict[str, NDArray[Any]] | None:
        """Return the rows of all ranks one behind the other on rank 0; None on the others.

        Of those named in `everywhere` all ranks have all rows, and each is a number on one of them.
        """
        told = self.process.tell_first(_packed(arrays))
        return None if told is None else _rows_of_all(told, arrays, everywhere)

    def share(
        self, arrays: Mapping[str, NDArray[Any]], everywhere: Collection[str] = ()
    ) -> dict[str, NDArray[Any]]:
        """Return what `gather` has on rank 0, on every rank."""
        return _rows_of_all(self.process.tell_all(_packed(arrays)), arrays, everywhere)

    def stop(self, error: BaseException) -> None:
        """End the work of all: whoever waits, or will, gets this rank's error by name."""
        self.process.stop(f"rank {self.rank}: {type(error).__name__}: {error}")


def _packed(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    buffer = io.BytesIO()
    given: dict[str, Any] = dict(arrays)
    np.savez(buffer, **given)
    return buffer.getvalue()


def _rows_of_all(
    told: list[bytes], names: Collection[str], everywhere: Collection[str]
) -> dict[str, NDArray[Any]]:
    def rows(text: bytes) -> dict[str, NDArray[Any]]:
        part = np.load(io.BytesIO(text), allow_pickle=False)
        return {name: part[name] for name in names}

    parts = [_read(rank, "arrays", rows, text) for rank, text in enumerate(told)]
    return {
        name: _joined([part[name] for part in parts], everywhere=name in everywhere)
        for name in names
    }


def _joined(parts: list[NDArray[Any]], *, everywhere: bool) -> NDArray[Any]:
    if not everywhere:
        return np.concatenate(parts)
    whole = parts[0]
    for part in parts[1:]:
        whole = np.where(np.isnan(whole), part, whole)
    return whole


def _read(rank: int, what: str, reader: Callable[[bytes], Any], text: bytes) -> Any:
    """Return what a rank has sent; raises `DeviceError` that names it where it cannot be read."""
    try:
        return reader(text)
    # NumPy's reader of archives raises whatever a damaged one makes it come upon.
    except Exception as error:
        raise DeviceError(
            f"rank {rank} has sent {what} that cannot be read ({error}); all ranks must run the "
            "same version of libmpm with the same script"
        ) from error


@functools.cache
def _of_job(module: Any) -> Link:
    text = os.environ.get("LIBMPM_MEETING_SECONDS", "")
    try:
        seconds = float(text) if text else MEETING
    except ValueError:
        seconds = -1.0
    if not 0 < seconds < 1e6:
        raise DeviceError(
            f"LIBMPM_MEETING_SECONDS is {text!r}; expected seconds above 0 that processes wait "
            "for each other at the start"
        )
    return Link(module, seconds)
