"""Handing cases to an executor until each has finished, failed, or been left to somebody else.

Of an executor nothing is asked but `submit(function, *arguments)`, and of what that returns
`done()`, `exception()` and `result()`.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import math
import threading
import time as clock
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from libmpm._src.base.values import plain
from libmpm._src.errors import Error, OutputError
from libmpm._src.output.atomic_files import writing
from libmpm._src.output.locks import STALE, Observer, held_by
from libmpm._src.studies.study.plan import Resolved
from libmpm._src.studies.study.pool import Inline, SpawnPool
from libmpm._src.studies.study.progress import StudyProgress, StudyState
from libmpm._src.studies.study.record import glance_record
from libmpm._src.studies.study.shared_files import CASES, LOCK, TRUNKS
from libmpm._src.studies.study.worker import is_over, record_death, run_case

__all__ = ["Item", "Runner"]

#: Seconds between looks at futures, at first and at most, where they do not call back.
_FIRST_PAUSE, _LONGEST_PAUSE = 0.01, 0.5
#: Seconds between two reports of where the cases of somebody else's executor stand.
_TELL = 0.1
#: Seconds between looks at cases that others run.
_WATCH = 0.5
#: Seconds beyond its limit of time, and share of it, after which a worker that hangs is ended.
_GRACE, _GRACE_SHARE = 60.0, 0.1
#: Seconds after which a study that only waits for others reports it.
_SILENCE = 10.0
#: Seconds that an interrupted study waits for cases in an executor that cannot take them back.
_PATIENCE = 30.0


@dataclass(eq=False)
class Item:
    """One simulation of a study: a case or a trunk."""

    what: Resolved
    folder: Path
    trunk: bool
    parameters: Mapping[str, Any]
    retry: str = ""
    dead: str = ""
    deaths: int = 0
    error: str = ""
    began: float = 0.0
    over_limit: bool = False
    record: dict[str, Any] = field(default_factory=dict)

    @property
    def key(self) -> str:
        """What tells it from every other item."""
        return f"{TRUNKS if self.trunk else CASES}/{self.what.hash}"

    def is_over(self, found: Mapping[str, Any]) -> bool:
        """Tell whether nothing is left to run, by the content of its ``status.json``."""
        return is_over(self.folder, found, trunk=self.trunk, retry=self.retry)


class Runner:
    """Runs the items of one call of `Study.run`.

    `finished` is told of every item that is over, and returns the items that can run because of
    it. `device` names the device of the item that is handed over next, if it names none itself;
    `threads` are those of such items; `output` holds the intervals of `Output`; `attempts` is how
    many workers an item may outlive, `time_limit` its wall time in s or None.
    """

    def __init__(
        self,
        executor: Any,
        folder: Path,
        *,
        device: Callable[[Item], str],
        threads: int,
        output: Mapping[str, Any],
        attempts: int,
        retry_failed: bool,
        time_limit: float | None,
        finished: Callable[[Item], list[Item]],
    ) -> None:
        """Take what the items have in common."""
        self._executor = executor
        self._folder = folder
        self._device = device
        self._threads = threads
        self._output = dict(output)
        self._attempts = attempts
        self._retry_failed = retry_failed
        self._time_limit = time_limit
        self._finished = finished
        own = isinstance(executor, Inline | SpawnPool)
        self._capacity = executor.capacity if own else None
        self._name = uuid.uuid4().hex
        self._stop = folder / f".stop-{self._name}"
        self._waiting: deque[Item] = deque()
        self._flying: list[tuple[Any, Item]] = []
        self._watched: dict[Item, Observer] = {}
        self._wake = threading.Event()
        self._looked = 0.0
        self._told = 0.0
        self._pause = _FIRST_PAUSE
        self._known: set[str] = set()
        self._over = {"finished": 0, "failed": 0}
        self._began = clock.monotonic()
        self._particle_steps = 0.0
        self._alive = False
        self._alone_since: float | None = None
        self._told_waiting = False

    def add(self, items: list[Item]) -> None:
        """Queue items; those that are over already, from an earlier run, are counted as such."""
        todo = deque(items)
        while todo:
            item = todo.popleft()
            if item.key in self._known:
                continue
            self._known.add(item.key)
            found = glance_record(item.folder)
            if self._retry_failed and found.get("status") == "failed":
                item.retry = str(found.get("token"))
            if item.is_over(found):
                item.record = found
                todo.extend(self._end(item))
            else:
                self._waiting.append(item)

    @property
    def state(self) -> StudyState:
        """Where the run stands."""
        flags = [getattr(future, "running", None) for future, _ in self._flying]
        known = all(callable(flag) for flag in flags)
        spent = clock.monotonic() - self._began
        return StudyState(
            total=len(self._known),
            done=self._over["finished"],
            failed=self._over["failed"],
            running=sum(bool(flag()) for flag in flags if flag) if known else None,
            rate=self._particle_steps / spent if spent > 0 else 0.0,
        )

    def run(self, report: StudyProgress) -> None:
        """Work until nothing is left; Ctrl-C lets the running cases write where they stand."""
        try:
            while self._waiting or self._flying or self._watched:
                self._submit()
                moved = self._collect()
                moved |= self._look()
                self._end_hanging()
                self._tell_waiting()
                # Other executors may hold all cases at once, and their states are asked one by one.
                if self._capacity is not None or clock.monotonic() - self._told >= _TELL:
                    report.update(self.state)
                    self._told = clock.monotonic()
                self._rest(moved)
            report.update(self.state)
        except BaseException:
            self._halt()
            raise
        finally:
            report.close()
            if not self._flying:
                self._stop.unlink(missing_ok=True)

    # One round --------------------------------------------------------------------------------

    def _submit(self) -> None:
        while self._waiting and (self._capacity is None or len(self._flying) < self._capacity):
            item = self._waiting[0]
            try:
                future = self._executor.submit(run_case, self._task(item))
            except Exception as error:
                raise Error(
                    f"the executor takes no more cases: {type(error).__name__}: {error}; what has "
                    "finished is kept: run the study again with a new one"
                ) from error
            self._waiting.popleft()
            item.began = clock.monotonic()
            self._flying.append((future, item))
            with contextlib.suppress(AttributeError):
                future.add_done_callback(lambda _: self._wake.set())

    def _task(self, item: Item, *, to_run: bool = True) -> dict[str, Any]:
        what = item.what
        options = dict(what.options)
        # Only who is about to run is dealt a device: there may be no idle worker to ask.
        if options["device"] is None and to_run:
            options["device"] = self._device(item)
        if options["threads"] is None:
            options["threads"] = self._threads
        return {
            "folder": str(item.folder),
            "hash": what.hash,
            "trunk": item.trunk,
            "scene": what.scene.to_dict(),
            "until": what.until,
            "options": options,
            "output": self._output,
            "parameters": {
                "parameters": plain(item.parameters),
                "until": what.until,
                "options": plain(options),
                "trunk": what.trunk,
            },
            "study_run": self._name,
            "attempt": item.deaths + 1,
            "stop": str(self._stop),
            "dead": item.dead,
            "retry": item.retry,
            "time_limit": self._time_limit,
        }

    def _collect(self) -> bool:
        """Take what has come back; tell whether anything has."""
        flying: list[tuple[Any, Item]] = []
        back: list[tuple[Any, Item]] = []
        for pair in self._flying:
            (back if pair[0].done() else flying).append(pair)
        self._flying = flying
        if not isinstance(self._executor, Inline):
            # Workers go on while the responses of this round are computed.
            self._submit()
        for future, item in back:
            try:
                error = future.exception()
            except (Exception, concurrent.futures.CancelledError) as raised:
                error = raised
            if error is None:
                self._take(item, future.result())
            else:
                self._died(item, future, error)
        return bool(back)

    def _take(self, item: Item, result: Mapping[str, Any]) -> None:
        self._alive = True
        if result["outcome"] == "done":
            item.record = result["record"]
            mine = item.record.get("study_run") == self._name
            if mine and item.record["status"] == "finished":
                done = (item.record.get(name) or 0 for name in ("particles", "steps"))
                self._particle_steps += math.prod(done)
            self.add(self._end(item))
        elif result["outcome"] == "busy":
            self._watched[item] = Observer(item.folder / LOCK)
        else:
            # Its worker was asked to end: another one goes on.
            self._waiting.append(item)

    def _died(self, item: Item, future: Any, error: BaseException) -> None:
        """Note that a worker did not come back with an answer."""
        began = glance_record(item.folder).get("study_run") == self._name
        broken = isinstance(error, BrokenExecutor) and isinstance(self._executor, SpawnPool)
        # A worker that was killed is no reason to give up, even if it is the first one.
        if broken and not (began or self._alive) and self._executor.failed_to_start(future):
            raise Error(
                f"the workers exit before their first case ({type(error).__name__}: {error}); "
                "their output is printed above. A script that runs a study must do so under "
                "`if __name__ == '__main__':`, because every worker imports it, and it must be a "
                "file, not text from a pipe; workers=0 needs no workers"
            ) from error
        item.deaths += 1
        item.error = (
            f"its worker died {item.deaths} time(s) ({type(error).__name__}: {error}); was it "
            "killed, or out of memory?"
        )
        if item.over_limit:
            item.deaths = self._attempts
            item.error = (
                f"it did not answer for {clock.monotonic() - item.began:.0f} s, its time limit "
                f"is {self._time_limit:g} s: its worker was ended; raise time_limit if it needs "
                "longer, and run with retry_failed=True"
            )
        self._watched[item] = Observer(item.folder / LOCK)
        self._looked = 0.0

    def _look(self) -> bool:
        """Look at the cases that others run, or whose worker died; tell whether any moved on."""
        if not self._watched or clock.monotonic() - self._looked < _WATCH:
            return False
        self._looked = clock.monotonic()
        moved = False
        for item, observer in list(self._watched.items()):
            found = glance_record(item.folder)
            if item.is_over(found):
                item.record = found
            elif not observer.is_free():
                continue
            elif item.deaths >= self._attempts:
                item.dead = observer.stamp
                item.record = self._give_up(item) or {}
                if not item.record:
                    continue
            else:
                item.dead = observer.stamp
                self._waiting.append(item)
            del self._watched[item]
            moved = True
            if item.record:
                self.add(self._end(item))
        return moved

    def _end_hanging(self) -> None:
        """End the workers of cases that do not stop by themselves at their limit of time."""
        if self._time_limit is None or not isinstance(self._executor, SpawnPool):
            return
        most = self._time_limit + max(_GRACE, _GRACE_SHARE * self._time_limit)
        for future, item in self._flying:
            if clock.monotonic() - item.began > most and not item.over_limit:
                item.over_limit = True
                self._executor.kill(future)

    def _tell_waiting(self) -> None:
        """Say once for whom a study waits that has nothing to run itself."""
        if self._flying or self._waiting or not self._watched:
            self._alone_since = None
            return
        if self._alone_since is None:
            self._alone_since = clock.monotonic()
        if not self._told_waiting and clock.monotonic() - self._alone_since > _SILENCE:
            self._told_waiting = True
            first = next(iter(self._watched))
            warnings.warn(
                f"waiting for {len(self._watched)} cases that others run; the first is "
                f"{first.folder}, held by {held_by(first.folder / LOCK) or 'no process'}. A "
                f"case is taken over {STALE:g} s after the last heartbeat of its lock, at once "
                "where its process is known to be gone",
                stacklevel=4,
            )

    def _give_up(self, item: Item) -> dict[str, Any] | None:
        try:
            return record_death(self._task(item, to_run=False), item.error)
        except OutputError as error:
            return {"status": "failed", "error": f"{item.error}; {error}"}

    def _end(self, item: Item) -> list[Item]:
        self._over[item.record["status"]] += 1
        return self._finished(item)

    def _rest(self, moved: bool) -> None:
        """Sleep until a future calls back, or for longer and longer."""
        self._pause = _FIRST_PAUSE if moved else min(1.5 * self._pause, _LONGEST_PAUSE)
        if not self._flying and not self._watched:
            return
        if self._wake.wait(self._pause):
            self._wake.clear()

    def _halt(self) -> None:
        """Ask the running cases to stop, and wait until they have written where they stand."""
        with contextlib.suppress(OutputError), writing(self._stop):
            self._stop.touch()
        for future, _ in self._flying:
            # Of other futures `cancel` may kill what runs; those in a queue see the file.
            if isinstance(future, concurrent.futures.Future):
                future.cancel()
        limit = clock.monotonic() + _PATIENCE
        while self._flying and clock.monotonic() < limit:
            self._flying = [pair for pair in self._flying if not pair[0].done()]
            self._wake.wait(0.05)
            self._wake.clear()
