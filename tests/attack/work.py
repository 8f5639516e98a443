"""A worker of the command: runs cases of one attack one after another, and counts."""

from __future__ import annotations

import fcntl
import itertools
import json
import os
import shutil
import subprocess
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from attack.base import Attack, run_cases

__all__ = ["commit", "work"]

#: Seconds between two records of the counts.
_RECORD = 1.0


def commit() -> str:
    """Return the commit of the sources, with a mark where they differ from it; empty outside."""
    here = Path(__file__).parent
    call = ["git", "-C", str(here), "describe", "--always", "--abbrev=9", "--dirty=+"]
    found = subprocess.run(call, capture_output=True, text=True, check=False)
    return found.stdout.strip()


def work(attack: Attack, seed: str, seconds: float, most: int, folder: Path) -> int:
    """Run cases until the time is over or `most` are done; returns 1 where the attack is absent."""
    name = attack.name
    own = folder / f"worker-{os.getpid()}"
    path = folder / "counts" / f"{name}-{seed}-{time.time_ns()}.json"
    if attack.absent():
        return 1
    counts: Counter[str] = Counter()
    cases = 0
    defects: list[dict[str, object]] = []
    try:
        attack.begin()
        began, recorded = time.monotonic(), 0.0
        numbers = _numbers(folder / f"{name}-{seed}.next", began + seconds)
        while time.monotonic() - began < seconds and cases < most:
            batch = itertools.islice(numbers, min(attack.batch, most - cases))
            for result in run_cases(attack, seed, batch, own / "room", folder / "kept"):
                counts += result.outcomes
                cases += 1
                if result.defect:
                    defects.append({"number": result.number, "defect": result.defect})
            if time.monotonic() - recorded > _RECORD:
                recorded = time.monotonic()
                _record(path, attack, seed, counts, cases, defects, recorded - began)
        _record(path, attack, seed, counts, cases, defects, time.monotonic() - began)
    finally:
        shutil.rmtree(own, ignore_errors=True)
    return 0


def _numbers(path: Path, end: float) -> Iterator[int]:
    """Yield numbers of cases that nobody has taken, in whatever process, until a moment."""
    while time.monotonic() < end:
        with path.open("a+") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            text = file.read().strip()
            number = int(text) if text else 0
            file.truncate(0)
            file.write(str(number + 1))
        yield number


def _record(
    path: Path, attack: Attack, seed: str, counts: Counter[str], cases: int,
    defects: list[dict[str, object]], seconds: float,
) -> None:  # fmt: skip
    content = {
        "attack": attack.name, "seed": seed, "commit": os.environ.get("ATTACK_COMMIT", commit()),
        "cases": cases, "outcomes": dict(counts), "defects": defects, "seconds": round(seconds, 1),
        "parent": os.getppid(),
    }  # fmt: skip
    path.parent.mkdir(exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(json.dumps(content))
    part.replace(path)
