"""Forked processes: refused where they would hang for want of their parent's threads.

The threads of OpenMP do not come along, and a child that asks for them waits for ever.
"""

from __future__ import annotations

import os
import threading

from libmpm._src.errors import DeviceError

__all__ = ["check_fork", "forked"]


class _Threads:
    """Whether an engine of this process was made for several threads, or of its parent."""

    used = False
    lost = False


def _in_child() -> None:
    _Threads.lost = _Threads.lost or _Threads.used
    _Threads.used = False


os.register_at_fork(after_in_child=_in_child)


def forked(name: str) -> DeviceError:
    """Return what is raised where a forked child continues with its parent's engine."""
    return DeviceError(
        f"simulation {name!r}: this process is a fork of the one that made the engine, whose "
        "threads it does not have; make the Simulation in the child, or start processes with "
        "multiprocessing.get_context('spawn')"
    )


def _try(name: str, threads: int) -> None:
    """Start and end as many threads as are asked for, which is more than there are processors."""
    over, started = threading.Event(), []
    try:
        for _ in range(threads):
            one = threading.Thread(target=over.wait, daemon=True)
            one.start()
            started.append(one)
    except (RuntimeError, MemoryError) as error:
        raise DeviceError(
            f"simulation {name!r}: the system starts {len(started)} of {threads} threads "
            f"({error}); give as many as there are processors, {os.cpu_count()}, or 0"
        ) from error
    finally:
        over.set()
        for one in started:
            one.join()


def check_fork(name: str, threads: int) -> None:
    """Raise `DeviceError` where an engine for several threads could only hang; note this one.

    `threads`: as of a `Simulation`, 0 = the default, several. Also raised where the system does not
    start as many: OpenMP would end the process.
    """
    if threads == 1:
        return
    if threads > (os.cpu_count() or 1):
        _try(name, threads)
    if _Threads.lost:
        raise DeviceError(
            f"simulation {name!r}: this process was forked after a simulation had run on several "
            "threads, which a fork loses; run it with threads=1, or start processes with "
            "multiprocessing.get_context('spawn')"
        )
    _Threads.used = True
