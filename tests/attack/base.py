"""What an attack is, and how one of its cases is run: in a process of its own, under a limit."""

from __future__ import annotations

import contextlib
import faulthandler
import fcntl
import functools
import importlib
import json
import os
import pkgutil
import random
import select
import shutil
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from support.patience import Patience

__all__ = ["CASE", "PRINTED", "Attack", "Defect", "Result", "import_all", "isolated", "run_cases"]

#: In the room of a case: what it is, for people and for `--replay`; what it printed.
CASE, PRINTED = "case.json", "printed.txt"
#: Characters of what a case printed that are kept with a defect.
_MOST = 4000
#: Seconds for what all cases of an attack share, and between two looks at what takes long.
_PREPARATION, _LOOK = 300.0, 1.0


class Defect(Exception):
    """What libmpm must not do."""


@dataclass
class Result:
    """What came of a case: outcome -> number, and what was wrong if anything was."""

    outcomes: Counter[str] = field(default_factory=Counter)
    defect: str = ""
    number: int = 0


class Attack:
    """Cases that follow from a seed and a number; each is accepted by libmpm or refused by name.

    A subclass says what it does (`what`), what its cases count (`unit`), which part of the time
    it gets (`share`), after how many seconds that it had a case is ended (`limit`), and how many
    cases one process runs (`batch`).
    """

    name: ClassVar[str]
    what: ClassVar[str]
    unit: ClassVar[str] = "cases"
    share: ClassVar[float] = 1.0
    limit: ClassVar[float] = 150.0
    batch: ClassVar[int] = 1

    def __init__(self, folder: Path) -> None:
        """Take the folder of what all cases share."""
        self.folder = folder
        self._begun = False

    def absent(self) -> str:
        """Return why the attack cannot be run here; empty if it can."""
        return ""

    def prepare(self) -> None:
        """Make the files that all cases share; in a process of its own, once for all workers."""

    def open(self) -> None:
        """Read what all cases share. No engine may run in this process, which is forked later."""

    def is_ready(self) -> bool:
        """Return whether the folder has been prepared for the sources as they are."""
        ready = self.folder / "ready"
        return ready.exists() and ready.read_text() == _sources()

    def begin(self) -> None:
        """Prepare the folder if nobody has done it for this attack's sources, and open it, once."""
        if self._begun:
            return
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        with (self.folder.parent / f"{self.name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not self.is_ready():
                shutil.rmtree(self.folder, ignore_errors=True)
                self.folder.mkdir()
                isolated(self.prepare, _PREPARATION, self.folder / PRINTED)
                (self.folder / "ready").write_text(_sources())
        import_all()
        self.open()
        self._begun = True

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Run a case in an empty folder; returns outcome -> number, raises for a defect."""
        raise NotImplementedError

    def replay(self, kept: Mapping[str, Any], room: Path) -> Mapping[str, int]:
        """Run a case that was kept again, from its files in `room` where it has any."""
        return self.case(kept["seed"], kept["number"], room)

    def rng(self, seed: str, number: int) -> random.Random:
        """Return what decides all of a case."""
        return random.Random(f"{self.name} {seed}:{number}")

    def note(self, room: Path, **content: Any) -> None:
        """Add to what is kept of a case, before it is tried: it may end this process."""
        path = room / CASE
        before = json.loads(path.read_text()) if path.exists() else {}
        path.write_text(json.dumps(before | content, indent=1, default=repr) + "\n")


@functools.cache
def import_all() -> None:
    """Import what cases need once, before this process is forked for them."""
    import libmpm

    for found in pkgutil.walk_packages(libmpm.__path__, "libmpm."):
        if not found.name.endswith(("__main__", "_cuda")):
            with contextlib.suppress(Exception):
                importlib.import_module(found.name)
    for name in (
        "encodings.ascii",
        "encodings.latin_1",
        "scipy.spatial",
        "scipy.stats.qmc",
        "meshio",
        "trimesh",
        "matplotlib.pyplot",
    ):
        with contextlib.suppress(Exception):
            importlib.import_module(name)


def _sources() -> str:
    """Return what changes with the sources of libmpm and of the attacks."""
    import libmpm

    folders = Path(libmpm.__file__).parent, Path(__file__).parents[1]
    return max(f"{p.stat().st_mtime_ns} {p}" for f in folders for p in f.rglob("*.[ps]*[yo]"))


def isolated(call: Callable[[], Any], seconds: float, printed: Path | None = None) -> Any:
    """Return what `call` returns in a fork of this process, as JSON can hold it.

    Raises `Defect` where it raises, crashes, or does not answer in time. What it prints goes to a
    file.
    """
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        _child(call, writing, printed)
    os.close(writing)
    text, late = _read(reading, seconds, pid)
    os.close(reading)
    if late:
        os.kill(pid, signal.SIGKILL)
    _, status = os.waitpid(pid, 0)
    if late:
        raise Defect(f"hang: no answer in {seconds:g} s{_tail(printed)}")
    if os.WIFSIGNALED(status):
        name = signal.Signals(os.WTERMSIG(status)).name
        raise Defect(f"crash: {name}{_tail(printed)}")
    answer = json.loads(text) if text else {"error": f"exit code {os.WEXITSTATUS(status)}"}
    if "error" in answer:
        raise Defect(answer["error"] + _tail(printed) * (not text))
    return answer["value"]


def _child(call: Callable[[], Any], writing: int, printed: Path | None) -> None:
    code = 1
    try:
        os.setpgid(0, 0)
        target = os.open(printed or os.devnull, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        for number in (1, 2):
            os.dup2(target, number)
        faulthandler.enable()
        try:
            answer = {"value": call()}
        except BaseException as error:
            answer = {"error": _described(error)}
        os.write(writing, json.dumps(answer, default=repr).encode())
        code = 0
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _described(error: BaseException) -> str:
    if isinstance(error, Defect):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)[-6:]
    way = " < ".join(f"{Path(f.filename).name}:{f.lineno} {f.name}" for f in reversed(frames))
    text = str(error)
    return f"{type(error).__name__}: {text[:_MOST]}\n  at {way}"


def _read(handle: int, seconds: float, group: int) -> tuple[str, bool]:
    """Return all that comes through a pipe of a process, and whether that took too long."""
    parts = []
    for part in _parts(handle, seconds, group, again=False):
        if part is None:
            return "", True
        parts.append(part)
    return b"".join(parts).decode(errors="replace"), False


def _parts(handle: int, seconds: float, group: int, *, again: bool) -> Iterator[bytes | None]:
    """Yield what comes through a pipe from a group of processes; None where it takes too long.

    The limit is of the time that they had; with `again` it is one of each part.
    """
    patience: Patience | None = None if again else Patience(seconds, group)
    while True:
        wait = _LOOK if patience is None else min(_LOOK, patience.left())
        if wait <= 0:
            yield None
            return
        if select.select([handle], [], [], min(wait, seconds))[0]:
            part = os.read(handle, 1 << 16)
            if not part:
                return
            yield part
            patience = None if again else patience
        elif patience is None:  # begun only where something takes long: it looks at all processes
            patience = Patience(seconds - min(_LOOK, seconds), group)


def _tail(printed: Path | None) -> str:
    if printed is None or not printed.exists():
        return ""
    text = printed.read_text(errors="replace")[-_MOST:].strip()
    return f"\n{text}" if text else ""


def run_cases(
    attack: Attack, seed: str, numbers: Iterator[int], room: Path, kept: Path
) -> Iterator[Result]:
    """Run cases in one fork of this process until one ends it; a case with a defect is kept.

    `numbers` is drawn from in the fork, so it must be one that forks share.
    """
    shutil.rmtree(room, ignore_errors=True)
    room.mkdir(parents=True)
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(reading)
        with open(writing, "w", encoding="utf-8", errors="replace") as pipe:
            _cases(attack, seed, numbers, room, pipe)
    os.close(writing)
    number, said = None, ""
    with contextlib.closing(_lines(reading, attack.limit, pid)) as lines:
        for line in lines:
            if line is None:
                said = f"hang: no answer in {attack.limit:g} s"
                os.kill(pid, signal.SIGKILL)
                break
            answer = json.loads(line)
            if "begun" in answer:
                number = answer["begun"]
            elif "error" in answer:
                yield _defect(attack, seed, number, room, kept, answer["error"])
                number = None
            else:
                _end_strays(room / str(number))
                shutil.rmtree(room / str(number), ignore_errors=True)
                yield Result(Counter(answer["value"]))
                number = None
    _, status = os.waitpid(pid, 0)
    if number is None:
        return
    if not said and os.WIFSIGNALED(status):
        said = f"crash: {signal.Signals(os.WTERMSIG(status)).name}"
    elif not said:
        said = f"crash: exit code {os.WEXITSTATUS(status)}"
    said += _tail(room / str(number) / PRINTED)
    yield _defect(attack, seed, number, room, kept, said)


def _cases(attack: Attack, seed: str, numbers: Iterator[int], room: Path, pipe: Any) -> None:
    """Run cases in a fork, and end it."""
    code = 1
    try:
        os.setpgid(0, 0)
        faulthandler.enable()
        for number in numbers:
            mine = room / str(number)
            mine.mkdir()
            attack.note(mine, attack=attack.name, seed=seed, number=number)
            print(json.dumps({"begun": number}), file=pipe, flush=True)
            with (mine / PRINTED).open("w") as printed:
                for handle in (1, 2):
                    os.dup2(printed.fileno(), handle)
            try:
                answer = {"value": attack.case(seed, number, mine)}
            except BaseException as error:
                answer = {"error": _described(error)}
            sys.stdout.flush()
            print(json.dumps(answer, default=repr), file=pipe, flush=True)
        code = 0
    finally:
        os._exit(code)


def _lines(handle: int, seconds: float, group: int) -> Iterator[str | None]:
    """Yield the lines that come through a pipe; None where the next one takes too long."""
    before = b""
    try:
        for part in _parts(handle, seconds, group, again=True):
            if part is None:
                yield None
                return
            *whole, before = (before + part).split(b"\n")
            yield from (line.decode(errors="replace") for line in whole)
    finally:
        os.close(handle)


def _defect(
    attack: Attack, seed: str, number: int | None, room: Path, kept: Path, said: str
) -> Result:
    """Keep the files of a case that shows a defect."""
    mine = room / str(number)
    _end_strays(mine)
    attack.note(mine, defect=said)
    target = kept / f"{attack.name}-{seed}-{number}"
    shutil.rmtree(target, ignore_errors=True)
    kept.mkdir(parents=True, exist_ok=True)
    shutil.move(mine, target)
    return Result(Counter({f"defect: {said.splitlines()[0][:60]}": 1}), said, number or 0)


def _end_strays(room: Path) -> None:
    """End what a case has started and not waited for; it names them in a file of its room."""
    path = room / "processes"
    for text in path.read_text().split() if path.exists() else ():
        with contextlib.suppress(OSError):
            os.kill(int(text), signal.SIGKILL)
