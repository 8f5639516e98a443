"""Who runs a case: a file that one process at a time can make, with a heartbeat.

A lock is free when its file is gone. It is stale when its process is gone, which a process of the
same machine can tell at once, or when its heartbeat, the time stamp of the file, stood still for
`STALE` seconds while somebody watched: clocks of two machines are never compared.
"""

from __future__ import annotations

import contextlib
import functools
import json
import os
import socket
import time as clock
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from libmpm._src.output.atomic import writing

__all__ = ["HEARTBEAT", "STALE", "Lock", "Observer", "is_held", "locked"]

#: Seconds between heartbeats.
HEARTBEAT = 5.0
#: Seconds without a heartbeat after which another process may take over.
STALE = 120.0


@functools.cache
def _place() -> str:
    """Return what tells apart places whose process numbers mean different processes."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {os.readlink('/proc/self/ns/pid')}"
    except OSError:
        return socket.gethostname()


def _started(pid: int) -> str:
    """Return when a process began, in ticks since the start of the system; empty if unknown."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    # The name of the program, in brackets, may hold spaces and brackets.
    state, *fields = text.rpartition(")")[2].split()
    return "" if state in "ZX" else fields[18]


def _runs(pid: int, started: str) -> bool:
    """Tell whether a process of this place still runs."""
    if Path("/proc/self/stat").exists():
        return bool(started) and _started(pid) == started
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True


@dataclass(frozen=True)
class _Owner:
    """What a lock file says; all empty while it is being written."""

    token: str = ""
    place: str = ""
    pid: int = 0
    started: str = ""
    beat: int = 0

    @property
    def stamp(self) -> str:
        """What changes with every owner and every heartbeat."""
        return f"{self.token} {self.beat}"

    @property
    def gone(self) -> bool:
        """Whether the process is known to be gone."""
        return self.place == _place() and not _runs(self.pid, self.started)


def _owner(path: Path) -> _Owner | None:
    """Return the owner of a lock, or None if there is none."""
    beat = 0
    try:
        beat = path.stat().st_mtime_ns
        return _Owner(**json.loads(path.read_text(encoding="utf-8")), beat=beat)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError):
        return _Owner(beat=beat)


class Lock:
    """A lock that this process holds; made by `Lock.acquire`."""

    def __init__(self, path: Path, token: str) -> None:
        """Take the file that was made."""
        self.path = path
        self.token = token

    @classmethod
    def acquire(cls, path: Path, *, dead: str = "") -> Lock | None:
        """Return the lock at `path`, or None while another process holds it.

        `dead` is the stamp of an owner that an `Observer` has found to be dead.
        """
        pid = os.getpid()
        token = uuid.uuid4().hex
        content = {"token": token, "place": _place(), "pid": pid, "started": _started(pid)}
        # A stale lock is taken away and then contended for like a free one.
        for _ in range(4):
            with writing(path):
                try:
                    handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
                except FileExistsError:
                    handle = -1
                if handle >= 0:
                    try:
                        os.write(handle, json.dumps(content).encode())
                    finally:
                        os.close(handle)
                    return cls(path, token)
                held = _owner(path)
                if held is None:
                    continue
                if not (held.gone or (dead and held.stamp == dead)):
                    return None
                _take_away(path, held.token)
        return None

    def beat(self) -> bool:
        """Show that the owner lives; False if another process has taken over."""
        held = _owner(self.path)
        if held is None or held.token != self.token:
            return False
        with contextlib.suppress(OSError):
            os.utime(self.path)
        return True

    def release(self) -> None:
        """Give the lock back, unless another process has taken it over."""
        held = _owner(self.path)
        if held is not None and held.token == self.token:
            self.path.unlink(missing_ok=True)


def _take_away(path: Path, token: str) -> None:
    """Remove the lock of a dead owner, and never that of its successor."""
    grave = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        # Only one of several processes can rename the file.
        os.rename(path, grave)
    except FileNotFoundError:
        return
    found = _owner(grave)
    if found is not None and found.token != token:
        # Somebody else was faster and has made the lock anew: it is put back.
        with contextlib.suppress(FileExistsError):
            os.link(grave, path)
    grave.unlink(missing_ok=True)


class Observer:
    """Watches a lock that another process holds."""

    def __init__(self, path: Path) -> None:
        """Begin to watch."""
        self._path = path
        self._seen = clock.monotonic()
        #: What the owner's lock was like when last looked at.
        self.stamp = ""

    def is_free(self) -> bool:
        """Tell whether the lock may be taken: `Lock.acquire(path, dead=observer.stamp)`."""
        held = _owner(self._path)
        if held is None or held.gone:
            return True
        if held.stamp != self.stamp:
            self.stamp, self._seen = held.stamp, clock.monotonic()
            return False
        return clock.monotonic() - self._seen > STALE


def is_held(path: Path) -> bool:
    """Tell at a glance whether a living process holds a lock, for display only.

    Where its process cannot be asked, the time stamp is compared with this machine's clock.
    """
    held = _owner(path)
    if held is None or held.gone:
        return False
    return held.place == _place() or clock.time() - held.beat * 1e-9 < STALE


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock for a moment's work on shared files; waits for others."""
    observer = Observer(path)
    while (lock := Lock.acquire(path, dead=observer.stamp if observer.is_free() else "")) is None:
        clock.sleep(0.02)
    try:
        yield
    finally:
        lock.release()
