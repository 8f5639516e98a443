"""Kills (-9) of a study and of its workers: every case is finished, and only once."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from attack.base import Attack, Defect
from attack.kills import _same
from libmpm._src.output.sensor_file import read_sensors

__all__ = ["Studies"]

_SCRIPT = Path(__file__).with_name("study_script.py")
#: Kills of one study at most.
_MOST = 12


class Studies(Attack):
    """Studies of which the process or its workers are killed."""

    name = "studies"
    what = "kills (-9) of studies and of their workers"
    unit = "kills"
    share = 1.5
    limit = 900.0

    def prepare(self) -> None:
        """Run the study undisturbed."""
        began = time.monotonic()
        child = _start(self.folder / "whole", self.folder / "said.txt")
        if child.wait():
            raise Defect((self.folder / "said.txt").read_text())
        (self.folder / "seconds").write_text(str(time.monotonic() - began))

    def open(self) -> None:
        """Read how long the study takes."""
        self.seconds = float((self.folder / "seconds").read_text())

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Kill the study or a worker now and then until all is finished."""
        rng = self.rng(seed, number)
        folder = room / "study"
        workers = studies = 0
        finished: dict[str, str] = {}
        for kill in range(_MOST + 1):
            child = _start(folder, room / "said.txt")
            with (room / "processes").open("a") as file:
                file.write(f"{child.pid}\n")
            while child.poll() is None and kill < _MOST:
                end = time.monotonic() + rng.uniform(0.0, self.seconds / 2)
                while child.poll() is None and time.monotonic() < end:
                    time.sleep(0.02)
                    _watch(folder, finished)
                if child.poll() is not None:
                    break
                victim = _victim(folder, rng)
                if victim is None:
                    child.kill()
                    studies += 1
                    break
                with contextlib.suppress(ProcessLookupError):
                    os.kill(victim, signal.SIGKILL)
                    workers += 1
            code = child.wait()
            _watch(folder, finished)
            if code == 0:
                break
            if code != -signal.SIGKILL:
                raise Defect(f"exit code {code}: {(room / 'said.txt').read_text()[-3000:]}")
        else:
            raise Defect("it does not end when nobody kills it")
        self._compare(folder)
        return {"workers killed": workers, "studies killed": studies, "studies finished": 1}

    def _compare(self, folder: Path) -> None:
        whole = self.folder / "whole" / "cases"
        names = sorted(p.name for p in whole.iterdir())
        if sorted(p.name for p in (folder / "cases").iterdir()) != names:
            raise Defect("the cases are other ones")
        for name in names:
            here = folder / "cases" / name
            if _status(here).get("status") != "finished":
                raise Defect(f"case {name} is {_status(here)}")
            first, second = (read_sensors(p / "sensors.h5") for p in (here, whole / name))
            for key, series in second.items():
                _same(first[key].time, series.time, f"{name}: times of '{key}'")
                _same(first[key].values, series.values, f"{name}: values of '{key}'")
            answers = [json.loads((p / "response.json").read_text()) for p in (here, whole / name)]
            if answers[0] != answers[1]:
                raise Defect(f"{name}: the response is {answers[0]}")
        left = [*folder.rglob("lock"), *folder.rglob("*.lock"), *folder.rglob("*.part")]
        if left:
            raise Defect(f"left behind: {left}")


def _start(folder: Path, said: Path) -> subprocess.Popen[bytes]:
    with said.open("ab") as file:
        return subprocess.Popen(
            [sys.executable, _SCRIPT, folder], stdout=file, stderr=file, start_new_session=True
        )


def _status(folder: Path) -> dict[str, Any]:
    with contextlib.suppress(OSError, ValueError):
        return dict(json.loads((folder / "status.json").read_text()))
    return {}


def _watch(folder: Path, finished: dict[str, str]) -> None:
    """Note what has finished; it may not be run again."""
    for case in folder.glob("cases/*"):
        found = _status(case)
        token = finished.get(case.name)
        if token is not None and found.get("token") != token:
            raise Defect(f"case {case.name} had finished and was run again")
        if found.get("status") == "finished":
            finished[case.name] = found["token"]


def _victim(folder: Path, rng: random.Random) -> int | None:
    """Return the process of a worker that runs a case, or None for the study itself."""
    found = [_status(p) for p in folder.glob("cases/*")]
    running = [s["pid"] for s in found if s.get("status") == "running"]
    return rng.choice(running) if running and rng.random() < 0.6 else None
