"""A process that has imported everything once, and forks a worker for every turn.

To start Python and to import what cases need takes seconds, a fork takes milliseconds. The command
asks by lines of JSON on the standard input; the answers are lines on the standard output. No engine
runs in this process, nor in a worker: cases are run in forks of workers (`attack.base.run_cases`),
so that whatever a case does to its process, the next one begins in a sound one.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from attack.base import Attack, import_all
from attack.catalogue import ATTACKS
from attack.work import work

__all__ = ["Server", "serve"]

#: Seconds between two looks for workers that have ended.
_LOOK = 0.02


class Server:
    """The command's end: asks for turns and hears of their ends."""

    def __init__(self, call: list[str], root: Path, environment: Mapping[str, str]) -> None:
        """Start the process."""
        self._process = subprocess.Popen(
            call, cwd=root, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        self._before = b""
        self._count = 0

    def start(self, name: str, seconds: float, most: int, seed: str) -> int:
        """Begin a turn of an attack; returns its number."""
        assert self._process.stdin is not None
        self._count += 1
        line = json.dumps([self._count, name, seconds, most, seed]) + "\n"
        self._process.stdin.write(line.encode())
        self._process.stdin.flush()
        return self._count

    def ended(self, seconds: float) -> list[tuple[int, int]]:
        """Return number and exit code of turns that have ended, waiting up to so many seconds."""
        assert self._process.stdout is not None
        if not select.select([self._process.stdout], [], [], seconds)[0]:
            return []
        part = os.read(self._process.stdout.fileno(), 1 << 16)
        if not part:
            raise SystemExit(f"the workers' process has ended with code {self._process.wait()}")
        *lines, self._before = (self._before + part).split(b"\n")
        return [tuple(json.loads(line)) for line in lines]

    def close(self) -> None:
        """End the process and its workers."""
        assert self._process.stdin is not None
        with contextlib.suppress(OSError):
            self._process.stdin.close()
        self._process.wait()


def serve(folder: Path) -> int:
    """Fork workers as they are asked for, until the standard input ends."""
    answers = os.dup(1)
    os.dup2(2, 1)  # what is printed is no answer
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command hears Ctrl-C, and ends the input
    import_all()
    opened: dict[str, Attack] = {}
    busy: dict[int, int] = {}
    before = b""
    while True:
        for pid in list(busy):
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                answer = [busy.pop(pid), os.waitstatus_to_exitcode(status)]
                os.write(answers, (json.dumps(answer) + "\n").encode())
        if not select.select([0], [], [], _LOOK if busy else None)[0]:
            continue
        part = os.read(0, 1 << 16)
        if not part:
            break
        *lines, before = (before + part).split(b"\n")
        for line in lines:
            number, name, seconds, most, seed = json.loads(line)
            attack = _opened(opened, name, folder)
            sys.stdout.flush()
            sys.stderr.flush()
            pid = os.fork()
            if pid == 0:
                _worker(answers, attack, name, seed, seconds, most, folder)
            busy[pid] = number
    for pid in busy:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGTERM)
    for pid in busy:
        os.waitpid(pid, 0)
    return 0


def _opened(opened: dict[str, Attack], name: str, folder: Path) -> Attack:
    """Return an attack, opened here for all its workers as soon as one has made its files."""
    if name not in opened:
        attack = ATTACKS[name](folder / "shared" / name)
        if not attack.is_ready():
            return attack
        attack.begin()
        opened[name] = attack
    return opened[name]


def _worker(answers: int, attack: Attack, name: str, seed: str, seconds: float, most: int,
            folder: Path) -> None:  # fmt: skip
    code = 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.close(answers)
        os.close(0)
        os.open(os.devnull, os.O_RDONLY)
        code = work(attack, seed, seconds, most, folder)
    except KeyboardInterrupt:
        code = 0
    except BaseException as error:
        print(f"{name}: {type(error).__name__}: {error}", file=sys.stderr)
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)
