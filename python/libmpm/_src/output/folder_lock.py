"""The lock of an output folder: one run at a time writes into it, on whatever host.

A run holds the lock of its folder from its first step until `run` returns or the simulation is
closed. Between calls of `step` the lock stays, and only another simulation of the same process may
have it: a notebook that makes its simulation again has forgotten the one before.
"""

from __future__ import annotations

import contextlib
import os
import threading
import time as clock
import warnings
import weakref
from collections.abc import Iterator
from pathlib import Path

from libmpm._src.base.interrupts import asked_to_stop, interrupt_noted
from libmpm._src.errors import ModelWarning, OutputError
from libmpm._src.output import locks
from libmpm._src.output.locks import Lock, Observer, owner_of

__all__ = ["LOCK", "Hold", "held_folder", "lent"]

#: The lock in the folder of a run.
LOCK = "lock"

#: Seconds between looks at a lock of another host.
_LOOK = 0.5

#: Lock files that this process holds for runs that it will begin.
_LENT: dict[Path, Lock] = {}
#: Lock file -> who holds it in this process.
_HOLDS: weakref.WeakValueDictionary[Path, Hold] = weakref.WeakValueDictionary()
_GUARD = threading.RLock()


class Hold:
    """The hold of one run on its folder, taken and given back as often as it likes."""

    def __init__(self, folder: Path) -> None:
        """Name the folder, which need not exist; nothing is taken yet."""
        self.folder = folder
        self._path = folder.resolve() / LOCK
        self._lock: Lock | None = None
        self._busy = False
        self._end: weakref.finalize[[Lock, threading.Event], Hold] | None = None

    @property
    def held(self) -> bool:
        """Whether the folder is this run's now."""
        return self._lock is not None

    def take(self) -> bool:
        """Take the folder, which exists, if it is not held; tell whether it was not.

        A lock of another host, whose process cannot be asked, is watched: taken over where it
        shows no heartbeat for `locks.STALE` seconds. Raises `OutputError` where another run writes.
        """
        with _GUARD:
            self._busy = True
            if self._lock is not None:
                return False
            lent = _LENT.get(self._path)
            if lent is not None:
                self._lock = lent
                return True
        try:
            lock = _wait(self._path, self.folder)
        except BaseException:
            self._busy = False
            raise
        over = threading.Event()
        threading.Thread(
            target=_beat, args=(lock, over), name="libmpm folder heartbeat", daemon=True
        ).start()
        with _GUARD:
            self._lock = lock
            _HOLDS[self._path] = self
            self._end = weakref.finalize(self, _let_go, lock, over)
        return True

    def require(self) -> None:
        """Raise `OutputError` unless the folder is still this run's."""
        if self._lock is None or not self._lock.holds():
            raise OutputError(
                f"{self.folder} is no longer this run's: {_why(self._path)}; nothing more is "
                "written; continue from its newest checkpoint when no other run does "
                "(libmpm resume)"
            )

    def rest(self) -> None:
        """Keep the folder, but leave it to another simulation of this process that asks."""
        self._busy = False

    def release(self) -> None:
        """Give the folder back."""
        with _GUARD:
            self._busy = False
            self._lock = None
            if self._end is not None:
                self._end()
                self._end = None
                _HOLDS.pop(self._path, None)

    def leave(self) -> bool:
        """Give the folder back if it is not being written; tell whether it was given."""
        with _GUARD:
            if self._busy:
                return False
            self.release()
            return True


def _beat(lock: Lock, over: threading.Event) -> None:
    while not over.wait(locks.HEARTBEAT):
        if not lock.beat():
            return


def _let_go(lock: Lock, over: threading.Event) -> None:
    over.set()
    with contextlib.suppress(OSError):
        lock.release()


def _why(path: Path) -> str:
    """Return in words what has become of a lock that this process had."""
    found = owner_of(path)
    if found is None:
        return f"its lock {path.name} was removed"
    return f"{found} has taken it over"


def _wait(path: Path, folder: Path) -> Lock:
    """Return the lock of a folder; raises `OutputError` where its owner lives."""
    observer = Observer(path)
    seen = ""
    while True:
        # Two looks at least: the first one only learns what the lock is like.
        lock = Lock.acquire(path, dead=observer.stamp if observer.is_free() else "")
        if lock is not None:
            return lock
        found = owner_of(path)
        if found is None:
            continue
        if found.here and found.pid == os.getpid():
            with _GUARD:
                other = _HOLDS.get(path)
                if other is not None and other.leave():
                    continue
            if other is None and path not in _LENT:
                # What this process was before it became another program (exec) has left the lock.
                lock = Lock.acquire(path, dead=found.stamp)
                if lock is not None:
                    return lock
            raise OutputError(
                f"{folder} is being written by another simulation of this process; close it, or "
                "choose another folder"
            )
        if found.here or (seen and found.stamp != seen):
            raise OutputError(
                f"{folder} is being written by {found}; a second run would spoil its results: "
                "wait for it, stop it, or choose another folder"
            )
        if not seen:
            seen = found.stamp
            warnings.warn(
                f"{folder} has the lock of {found}, which cannot be asked from here: it is taken "
                f"over if it shows no heartbeat for {locks.STALE:g} s; delete {path} if that "
                "process is known to be gone",
                ModelWarning, stacklevel=2,
            )  # fmt: skip
        if asked_to_stop():
            raise OutputError(
                f"stopped by {asked_to_stop()} while waiting for {folder}, which has the lock of "
                f"{found}; run the same command again"
            )
        if interrupt_noted():
            raise KeyboardInterrupt
        clock.sleep(_LOOK)


@contextlib.contextmanager
def lent(lock: Lock) -> Iterator[None]:
    """Let runs that begin meanwhile write into the folder whose lock this process holds."""
    path = lock.path.resolve()
    with _GUARD:
        _LENT[path] = lock
    try:
        yield
    finally:
        with _GUARD:
            _LENT.pop(path, None)


@contextlib.contextmanager
def held_folder(folder: Path) -> Iterator[None]:
    """Hold a folder from before its state is read until a run has gone on from it."""
    if not folder.is_dir():
        yield
        return
    hold = Hold(folder)
    hold.take()
    assert hold._lock is not None
    try:
        with lent(hold._lock):
            yield
    finally:
        hold.release()
