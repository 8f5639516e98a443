"""The aims of the attacks, and how workers are dealt so that all are reached together.

``python -m tests.attack --bars --workers 16 --minutes 9 --results FOLDER`` runs to the aims, writes
`attacks.json` there every few seconds, so that whatever ends the call leaves its counts, and goes
on from the folder of the attacks when it is called again.
"""

from __future__ import annotations

import json
import os
import signal
import tarfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

__all__ = ["AIMS", "GOALS", "choose", "done", "save", "stopped_by_signals"]

#: Attack -> how many of its units are aimed at.
GOALS = {"inputs": 50_000, "values": 20_000, "forged": 5_000, "messages": 1_000_000, "kills": 2_000}
#: Those that the page promises.
AIMS = ("inputs", "forged", "kills", "messages")
#: Seconds of a worker that a unit takes, before any were counted.
_GUESS = {"inputs": 0.06, "values": 5e-3, "forged": 0.1, "messages": 4e-4, "kills": 0.5}
#: Of the workers, those that may run kills while other aims are open: kills fill what is left.
_KILLS = 0.4
#: Bytes of kept cases that go to the results.
_MOST = 12 << 20


def done(found: list[dict[str, Any]]) -> dict[str, int]:
    """Return attack -> units counted; messages count where the sanitizers watched."""
    units = dict.fromkeys(GOALS, 0)
    for one in found:
        name, outcomes = one["attack"], one["outcomes"]
        if name == "kills":
            units[name] += outcomes.get("kills", 0)
        elif name == "messages":
            units[name] += outcomes.get("messages under the sanitizers", 0)
        elif name in units:
            units[name] += one["cases"]
    return units


def choose(
    names: list[str],
    found: list[dict[str, Any]],
    running: Mapping[str, int],
    workers: int,
    ready: Mapping[str, bool],
) -> str:
    """Return the attack whose aim is furthest away for those who work at it; empty if none is.

    Until an attack's shared files are `ready`, one worker makes them and others would wait.
    """
    units = done(found)
    due = [n for n in names if units[n] < GOALS[n] and (ready[n] or not running.get(n))]
    others = [n for n in due if n != "kills"]
    if others and running.get("kills", 0) >= max(1, round(_KILLS * workers)):
        due = others
    rates = {}
    for name in due:
        spent = sum(one["seconds"] for one in found if one["attack"] == name)
        each = spent / units[name] if units[name] else _GUESS[name]
        rates[name] = (GOALS[name] - units[name]) * each / (1 + running.get(name, 0))
    return max(rates, key=rates.__getitem__) if rates else ""


def save(found: list[dict[str, Any]], results: Path, kept: Path | None = None) -> None:
    """Write all records to `attacks.json`; at the end also the kept cases, as many as fit."""
    results.mkdir(parents=True, exist_ok=True)
    part = results / "attacks.json.part"
    part.write_text(json.dumps(found) + "\n")
    part.replace(results / "attacks.json")
    if kept is None or not kept.is_dir():
        return
    size = 0
    with tarfile.open(results / "kept.tar.gz", "w:gz", compresslevel=1) as archive:
        for case in sorted(kept.iterdir()):
            size += sum(p.stat().st_size for p in case.rglob("*") if p.is_file())
            if size > _MOST:
                break
            archive.add(case, case.name)


def stopped_by_signals() -> None:
    """Make SIGTERM end the call as Ctrl-C does: counts are written, and workers ended."""

    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)


class Saver:
    """Writes the records now and then."""

    def __init__(self, results: Path | None, every: float = 5.0) -> None:
        """Take where to write; nowhere if None."""
        self.results, self.every = results, every
        self._next = 0.0

    def __call__(self, found: list[dict[str, Any]]) -> None:
        """Write if it is time to."""
        if self.results is not None and time.monotonic() >= self._next:
            save(found, self.results)
            self._next = time.monotonic() + self.every


def ready(names: list[str], folder: Path) -> dict[str, bool]:
    """Return attack -> whether its shared files have been made since this call began."""
    return {n: os.path.exists(folder / "shared" / n / "ready") for n in names}
