"""Who works on a folder or file: a lock that one process at a time can make, with a heartbeat.

A lock is free when its file is gone. It is stale when its process is gone, which a process of the
same machine can tell at once, or when its heartbeat, the time stamp of the file, stood still for
`STALE` seconds while somebody watched: clocks of two machines are never compared. A file that does
not say whose it is, cut short by a crash of the machine, is stale after `UNSIGNED` seconds.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import os
import socket
import time as clock
import uuid
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from libmpm._src.output.atomic_files import writing

__all__ = [
    "HEARTBEAT",
    "STALE",
    "UNSIGNED",
    "Lock",
    "Observer",
    "held_by",
    "is_gone",
    "is_held",
    "locked",
    "owner_of",
    "this_process",
]

#: Seconds between heartbeats.
HEARTBEAT = 5.0
#: Seconds without a heartbeat after which another process may take over.
STALE = 120.0
#: The same for a file that names no owner: who makes it writes its name within the same moment.
UNSIGNED = 10.0
#: Seconds after which a process that waits for a short lock reports it.
_PATIENCE = 5.0


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


def this_process() -> str:
    """Return a name of this process, for names of files: `is_gone` tells when it has ended."""
    place = hashlib.sha256(_place().encode()).hexdigest()[:12]
    return f"{place}-{os.getpid()}-{_started(os.getpid())}"


def is_gone(name: str) -> bool:
    """Tell whether `name` begins with that of a process of this machine that has ended."""
    place, pid, started = [*name.split("-"), "", ""][:3]
    if not pid.isdecimal() or len(pid) > 10:
        return False
    return this_process().startswith(f"{place}-") and not _runs(int(pid), started)


def _now() -> float:
    """Return seconds of a clock that, where there is one, runs while the machine sleeps too."""
    if hasattr(clock, "CLOCK_BOOTTIME"):
        return clock.clock_gettime(clock.CLOCK_BOOTTIME)
    return clock.monotonic()


@dataclass(frozen=True)
class Owner:
    """What a lock file says; all empty while it is being written."""

    token: str = ""
    place: str = ""
    pid: int = 0
    started: str = ""
    host: str = ""
    beat: int = 0

    @property
    def stamp(self) -> str:
        """What changes with every owner and every heartbeat."""
        return f"{self.token} {self.beat}"

    @property
    def here(self) -> bool:
        """Whether it is a process of this machine, which can be asked."""
        return self.place == _place()

    @property
    def gone(self) -> bool:
        """Whether the process is known to be gone."""
        return self.here and not _runs(self.pid, self.started)

    def __str__(self) -> str:
        """Return who it is, in words."""
        if not self.token:
            return "nobody, by what it says: it is damaged"
        where = "" if self.here else f" of {self.host or 'another machine'}"
        return f"process {self.pid}{where}"


def owner_of(path: Path) -> Owner | None:
    """Return the owner of a lock, or None if there is none."""
    beat = 0
    try:
        beat = path.stat().st_mtime_ns
        content = json.loads(path.read_text(encoding="utf-8"))
        found = Owner(**{k: content[k] for k in Owner.__annotations__ if k in content}, beat=beat)
    except FileNotFoundError:
        return None
    except (OSError, ValueError, TypeError, RecursionError):
        return Owner(beat=beat)
    texts = found.token, found.place, found.started, found.host
    whole = all(isinstance(text, str) for text in texts) and type(found.pid) is int
    return found if whole else Owner(beat=beat)


class Lock:
    """A lock that this process holds; made by `Lock.acquire`."""

    def __init__(self, path: Path, token: str) -> None:
        """Take the file that was made."""
        self.path = path
        self.token = token
        #: Whether another process has been seen to have taken it over.
        self.lost = False
        self._pid = os.getpid()
        self._looked = _now()

    @classmethod
    def acquire(cls, path: Path, *, dead: str = "") -> Lock | None:
        """Return the lock at `path`, or None while another process holds it.

        `dead` is the stamp of an owner that an `Observer` has found to be dead.
        """
        pid = os.getpid()
        token = uuid.uuid4().hex
        content = {
            "token": token, "place": _place(), "pid": pid, "started": _started(pid),
            "host": socket.gethostname(),
        }  # fmt: skip
        # A stale lock is taken away and then contended for like a free one.
        for _ in range(4):
            with writing(path):
                try:
                    handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
                except FileExistsError:
                    handle = -1
                if handle >= 0:
                    _sign(path, handle, json.dumps(content).encode())
                    return cls(path, token)
                held = owner_of(path)
                if held is None:
                    continue
                if not (held.gone or (dead and held.stamp == dead)):
                    return None
                _take_away(path, held.token)
        return None

    def beat(self) -> bool:
        """Show that the owner lives; False if another process has taken over."""
        if self.lost or os.getpid() != self._pid:
            return False
        held = owner_of(self.path)
        # What cannot be read names no other owner: a disk may fail for a moment.
        if held is None or held.token not in ("", self.token):
            self.lost = True
            return False
        with contextlib.suppress(OSError):
            os.utime(self.path)
        self._looked = _now()
        return True

    def holds(self) -> bool:
        """Tell whether the lock is still of this process; looks at the file only now and then.

        Who takes over has watched for `STALE` seconds, so a look within a heartbeat is enough. A
        process that has slept since its last look looks again.
        """
        if self.lost or os.getpid() != self._pid:
            return False
        return 0 <= _now() - self._looked < HEARTBEAT or self.beat()

    def release(self) -> None:
        """Give the lock back, unless another process has taken it over."""
        if os.getpid() != self._pid:
            # A fork has only a copy of the lock.
            return
        held = owner_of(self.path)
        if held is not None and held.token == self.token:
            # One that cannot be taken away is stale when this process is gone.
            with contextlib.suppress(OSError):
                self.path.unlink()


def _sign(path: Path, handle: int, text: bytes) -> None:
    """Write into a lock whose it is; take it back where that fails, for instance on a full disk."""
    try:
        with open(handle, "wb", buffering=0) as file:
            while text:
                text = text[file.write(text) :]
    except BaseException:
        with contextlib.suppress(OSError):
            path.unlink()
        raise


def _take_away(path: Path, token: str) -> None:
    """Remove the lock of a dead owner, and never that of its successor."""
    grave = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        # Only one of several processes can rename the file.
        os.rename(path, grave)
    except FileNotFoundError:
        return
    found = owner_of(grave)
    if found is not None and found.token != token:
        # Somebody else was faster and has made the lock again: it is put back.
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
        held = owner_of(self._path)
        if held is None or held.gone:
            return True
        if held.stamp != self.stamp:
            self.stamp, self._seen = held.stamp, clock.monotonic()
            return False
        return clock.monotonic() - self._seen > (STALE if held.token else UNSIGNED)


def held_by(path: Path) -> str:
    """Return in words who holds a lock; empty if nobody does."""
    held = owner_of(path)
    return "" if held is None else str(held)


def is_held(path: Path) -> bool:
    """Tell at a glance whether a living process holds a lock, for display only.

    Where its process cannot be asked, the time stamp is compared with this machine's clock.
    """
    held = owner_of(path)
    if held is None or held.gone:
        return False
    return held.place == _place() or clock.time() - held.beat * 1e-9 < STALE


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold a lock for a moment's work on shared files; waits for others."""
    observer = Observer(path)
    began, patient = clock.monotonic(), True
    while (lock := Lock.acquire(path, dead=observer.stamp if observer.is_free() else "")) is None:
        if patient and clock.monotonic() - began > _PATIENCE:
            patient = False
            warnings.warn(
                f"waiting for {path}, held by {held_by(path) or 'others in turn'}; a lock is taken "
                f"over {STALE:g} s after its last heartbeat, at once where its process is known to "
                "be gone; it may be deleted if no study runs on this folder",
                stacklevel=3,
            )
        clock.sleep(0.02)
    try:
        yield
    finally:
        lock.release()
