"""The executors that a study makes itself: a pool of spawned processes, and none at all."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Any

from libmpm._src.base.signals import ignore_broken_pipes
from libmpm._src.errors import SceneError
from libmpm._src.run import backends
from libmpm._src.studies.study import worker

__all__ = ["Inline", "SpawnPool", "choose_slots", "cores", "refuse_forks"]

#: Exit code of a worker that was asked to end: that of a shell's child after SIGTERM.
_ASKED = 128 + 15
#: Seconds in which a process that has closed its pipes has an exit code.
_REAPING = 2.0

#: Held while a worker process runs a case.
_busy = threading.Lock()


def cores() -> int:
    """Return the number of processors that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def choose_slots(device: str | Sequence[str], workers: int | None, threads: int) -> list[str]:
    """Return the device of each worker: one a CUDA device, or as many as the cores carry.

    Several names are dealt in turn. Raises `DeviceError` for a device that does not exist.
    """
    if isinstance(device, str):
        names = [device]
        if device == "auto":
            found = backends.cuda_status().devices
            names = [f"cuda:{i}" for i in range(len(found))] or ["cpu"]
    else:
        names = list(device)
        if not names:
            raise SceneError("Study.run: device is an empty list; expected names such as 'cuda:0'")
    for name in names:
        backends.select(name)
    if workers is None:
        cpu = all(backends.parse_device(name)[0] == "cpu" for name in names)
        # 0 threads are all of them.
        workers = max(1, cores() // (threads or cores())) if cpu else len(names)
    return [names[i % len(names)] for i in range(workers)]


def refuse_forks(executor: Any) -> None:
    """Refuse a process pool whose workers would be forks of this process."""
    context = getattr(executor, "_mp_context", None)
    if context is not None and context.get_start_method() == "fork":
        raise SceneError(
            "Study.run: the pool forks its workers, and a forked process hangs when it asks for "
            "threads of OpenMP; expected spawned ones: make it with "
            "ProcessPoolExecutor(mp_context=multiprocessing.get_context('spawn'))"
        )


class Inline:
    """Runs everything at once, in this process and thread."""

    #: Cases that may be handed over before the first is done.
    capacity = 1

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Run it and return a future that is done."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def close(self, *, wait: bool) -> None:
        """Nothing runs."""


class SpawnPool:
    """Processes of which each takes one case at a time.

    Every worker is a pool of its own: one that dies, by a kill or for want of memory, takes no
    other case with it.
    """

    def __init__(self, workers: int) -> None:
        """Start nothing yet."""
        ignore_broken_pipes()  # the queues of workers that die are such
        self.capacity = workers
        self._pools: list[ProcessPoolExecutor | None] = [None] * workers
        self._futures: list[Future[Any] | None] = [None] * workers
        self._processes: list[list[BaseProcess]] = [[] for _ in range(workers)]

    def idle(self) -> int:
        """Return the number of a worker that has nothing to do."""
        return next(i for i, f in enumerate(self._futures) if f is None or f.done())

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Hand a call to an idle worker; there must be one."""
        slot = self.idle()
        pool = self._pools[slot]
        if pool is not None:
            try:
                future = pool.submit(_call, function, *arguments)
            except BrokenExecutor:
                pool = None
        if pool is None:
            context = multiprocessing.get_context("spawn")
            pool = ProcessPoolExecutor(1, mp_context=context, initializer=_prepare)
            self._pools[slot] = pool
            future = pool.submit(_call, function, *arguments)
        self._futures[slot] = future
        # The standard library names the processes of a pool only here, and forgets them at its end.
        found = getattr(self._pools[slot], "_processes", None) or {}
        self._processes[slot] = list(found.values())
        return future

    def kill(self, future: Any) -> None:
        """End the worker of a call, which hangs; its future fails as at any other death."""
        for process in self._of(future):
            process.kill()

    def failed_to_start(self, future: Any) -> bool:
        """Tell whether the worker of a call ended by itself: it could not import the script."""
        codes = []
        limit = clock.monotonic() + _REAPING
        for process in self._of(future):
            while process.exitcode is None and clock.monotonic() < limit:
                clock.sleep(0.01)
            codes.append(process.exitcode)
        # A signal, the system's at want of memory too, shows as a negative code.
        return any(code is not None and code >= 0 and code != _ASKED for code in codes)

    def _of(self, future: Any) -> list[BaseProcess]:
        return next(
            (p for f, p in zip(self._futures, self._processes, strict=True) if f is future), []
        )

    def close(self, *, wait: bool) -> None:
        """End the workers, after what they run if `wait`."""
        for pool in self._pools:
            if pool is not None:
                pool.shutdown(wait=wait, cancel_futures=True)


def _prepare() -> None:
    """Make a new worker process deaf to Ctrl-C, which its parent answers, but not to its death."""
    with contextlib.suppress(ValueError):
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # Batch systems send this one to every process of a job some time before they kill it.
        signal.signal(signal.SIGTERM, lambda number, frame: _in_background(_leave))
    parent = multiprocessing.parent_process()
    if parent is not None:
        _in_background(_outlive, parent.sentinel)


def _in_background(function: Callable[..., None], *arguments: Any) -> None:
    threading.Thread(target=function, args=arguments, daemon=True).start()


def _outlive(sentinel: int) -> None:
    """End this process soon after its parent."""
    connection.wait([sentinel])
    _leave()


def _leave() -> None:
    """End this process; the case that it runs first writes where it stands."""
    worker.LEAVING.set()
    with _busy:
        os._exit(_ASKED)


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    with _busy:
        return function(*arguments)
