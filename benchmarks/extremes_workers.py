"""Processes that probe the extremes one value after another, and what becomes of those that fail.

A crash or a hang ends a worker and is that probe's outcome; the next probe finds a new worker. So
does what follows a message of the device, whose state it may have spoilt. Between probes nothing is
kept but the process and its device context: starting these costs more than most probes.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import re
import time
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from typing import Any

from extremes_axis import Axis, Outcome, probe

__all__ = ["DeviceLostError", "Task", "Worker", "together"]

#: Probes of one process: whatever may grow in it ends with it.
PROBES_EACH = 200

#: Messages after which a device context is not used again.
OF_DEVICE = re.compile(r"cudaError|device memory|device '[^']*' is not available|no CUDA device")
#: Of those, what says nothing of the probe; pauses before it is tried again, s.
LOST = re.compile(r"device '[^']*' is not available|no CUDA device")
PAUSES = (2.0, 8.0)

#: What is asked of a worker: axis, value, options of `Simulation`, seconds to wait before.
Request = tuple[str, float, dict[str, Any], float]


class DeviceLostError(Exception):
    """The device cannot be used at all: no outcome of a probe."""


def _serve(axes: Mapping[str, Axis], pipe: Connection, parent: int) -> None:
    """Answer requests until there are no more, or nobody is left to ask."""
    while os.getppid() == parent:
        if not pipe.poll(5.0):
            continue
        try:
            name, value, options, pause = pipe.recv()
        except (EOFError, OSError):
            return
        time.sleep(pause)
        outcome = probe(axes[name], value, **options)
        gc.collect()  # what its simulation holds on the device
        pipe.send(outcome)


class Worker:
    """A process that probes values of `axes`, by name; started when it is first asked."""

    def __init__(self, axes: Mapping[str, Axis]) -> None:
        self._axes = axes
        self._process: Any = None
        self._pipe: Connection | None = None
        self._request: Request | None = None
        self._limit = self._begun = 0.0
        self._answered = self._lost = 0

    def ask(
        self, name: str, value: float, options: dict[str, Any], limit: float, pause: float = 0.0
    ) -> None:
        """Start a probe that has `limit` seconds; `answer` returns its outcome."""
        if self._process is None:
            self._start()
        assert self._pipe is not None
        self._request, self._limit = (name, value, options, pause), limit
        self._begun = time.monotonic() + pause
        # A worker that has ended since is found out by `answer`.
        with suppress(OSError):
            self._pipe.send(self._request)

    @property
    def pipe(self) -> Connection:
        """What can be read as soon as there is an answer."""
        assert self._pipe is not None
        return self._pipe

    @property
    def remaining(self) -> float:
        """Seconds until the probe hangs."""
        return self._begun + self._limit - time.monotonic()

    def answer(self) -> Outcome | None:
        """Return the outcome of the probe, or None while it is not known.

        Raises `DeviceLostError` if the device cannot be used, again and again.
        """
        if not self.pipe.poll():
            if self.remaining > 0:
                return None
            self.stop()
            return Outcome("hang", f"not done after {self._limit:g} s", wall_s=self._limit)
        try:
            outcome: Outcome = self.pipe.recv()
        except (EOFError, OSError):
            wall = time.monotonic() - self._begun
            return Outcome("crash", f"the process ended with code {self.stop()}", wall_s=wall)
        self._answered += 1
        used = self._answered > 1
        spoilt = OF_DEVICE.search(outcome.message) is not None
        if spoilt or self._answered >= PROBES_EACH:
            self.stop()
        if LOST.search(outcome.message):
            if self._lost == len(PAUSES):
                raise DeviceLostError(outcome.message)
            self._lost += 1
            return self._repeat(PAUSES[self._lost - 1])
        if spoilt and used:  # perhaps by a probe before this one
            return self._repeat()
        self._lost = 0
        return outcome

    def _repeat(self, pause: float = 0.0) -> None:
        assert self._request is not None
        name, value, options, _ = self._request
        self.ask(name, value, options, self._limit, pause)

    def probe(self, name: str, value: float, limit: float, **options: Any) -> Outcome:
        """Probe one value and wait for its outcome."""
        self.ask(name, value, options, limit)
        while True:
            wait([self.pipe], max(self.remaining, 0.0))
            if (outcome := self.answer()) is not None:
                return outcome

    def _start(self) -> None:
        # This process never steps a scene, so a fork of it finds threads and devices untouched.
        context = multiprocessing.get_context("fork")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(self._axes, theirs, os.getpid()), daemon=True
        )
        self._process.start()
        theirs.close()
        self._answered = 0

    def stop(self) -> int:
        """End the process whatever it does, and return its exit code."""
        if self._process is None:
            return 0
        self._process.join(0.1)  # what has ended by itself keeps its code
        self._process.kill()
        self._process.join()
        code = int(self._process.exitcode)
        self.pipe.close()
        self._process = self._pipe = None
        return code


@dataclass
class Task:
    """Values of one axis that are tried one after another, each by what came before."""

    axis: str
    search: Generator[float, Outcome, dict[str, Any]]  # yields values, gets outcomes
    limit: float
    options: dict[str, Any]
    head: dict[str, Any] = field(default_factory=dict)


def together(tasks: Iterator[Task], workers: list[Worker]) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Yield tasks with what their searches return, as they are done; each worker has one."""
    busy: dict[Worker, Task] = {}

    def go_on(worker: Worker, task: Task, step: Callable[[], float]) -> dict[str, Any] | None:
        try:
            worker.ask(task.axis, step(), task.options, task.limit)
        except StopIteration as end:
            busy.pop(worker, None)
            return end.value  # type: ignore[no-any-return]
        busy[worker] = task
        return None

    try:
        while True:
            for worker in [w for w in workers if w not in busy]:
                while worker not in busy and (task := next(tasks, None)) is not None:
                    if (found := go_on(worker, task, lambda t=task: next(t.search))) is not None:
                        yield task, found
            if not busy:
                return
            wait([w.pipe for w in busy], max(0.0, min(w.remaining for w in busy)))
            for worker, task in list(busy.items()):
                if (outcome := worker.answer()) is None:
                    continue
                found = go_on(worker, task, lambda t=task, o=outcome: t.search.send(o))
                if found is not None:
                    yield task, found
    finally:
        for worker in workers:
            worker.stop()
