"""The command: ``python -m tests.attack --minutes N --seed S``."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from attack import bars, report
from attack.base import CASE, Defect, isolated
from attack.catalogue import ATTACKS
from attack.serve import Server, serve
from attack.work import commit

__all__ = ["main"]

ROOT = Path(__file__).parents[2]
#: Where counts, and the inputs of defects, are kept.
FOLDER = ROOT / "build" / "attack"
#: Seconds of a turn: a worker runs one attack for so long.
_TURN = 90.0
#: The same towards the aims, where a worker is dealt anew more often.
_BAR_TURN = 20.0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description=__doc__)
    parser.add_argument("--minutes", type=float, default=5.0, help="wall time of all attacks")
    parser.add_argument("--seed", default="0", help="what cases are made from; continues where "
                        "an earlier call with the same seed and folder stopped")  # fmt: skip
    parser.add_argument("--workers", type=int, default=1, help="cases at a time")
    parser.add_argument("--only", nargs="+", choices=ATTACKS, help="these attacks alone")
    parser.add_argument("--cases", type=int, help="so many of each attack at most")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="counts and kept inputs")
    parser.add_argument("--replay", type=Path, help="run a kept case again, or print its defect")
    parser.add_argument("--bars", action="store_true", help="run to the aims of all attacks that "
                        "have one, see attack.bars")  # fmt: skip
    parser.add_argument("--results", type=Path, help="also write attacks.json to this folder, "
                        "every few seconds")  # fmt: skip
    parser.add_argument("--write", action="store_true", help="write docs/reliability.md")
    parser.add_argument("--collect", type=Path, nargs="+", default=[], metavar="FILE",
                        help="with --write: attacks.json, long_run.json of others")  # fmt: skip
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run attacks, or one kept case; returns 1 where there is a defect."""
    given = _parser().parse_args(arguments)
    given.folder = given.folder.resolve()
    if given.serve:
        return serve(given.folder)
    if given.replay:
        return _replay(given.replay)
    if given.write:
        report.write(given.folder, given.collect)
        return 0
    before = report.counted(given.folder)
    bars.stopped_by_signals()
    try:
        _run(given)
    except KeyboardInterrupt:
        print("stopped; what was counted is kept")
    found = report.counted(given.folder)
    if given.results:
        bars.save(found, given.results, given.folder / "kept")
    print(report.table(found), flush=True)
    if given.bars:
        for name, units in bars.done(found).items():
            print(f"{name}: {units:,} of {bars.GOALS[name]:,} {ATTACKS[name].unit}")
    fresh = report.defects(found)[len(report.defects(before)) :]
    for defect in fresh:
        print(f"\n{defect}")
    return 1 if fresh else 0


def _run(given: argparse.Namespace) -> None:
    """Deal turns to workers until the time is over."""
    folder = given.folder
    folder.mkdir(parents=True, exist_ok=True)
    names = [n for n in given.only or (bars.GOALS if given.bars else ATTACKS)
             if not _absent(n, folder)]  # fmt: skip
    save = bars.Saver(given.results)
    shares = {n: ATTACKS[n].share for n in names}
    end = time.monotonic() + 60 * given.minutes
    total = 60 * given.minutes * given.workers
    spent = dict.fromkeys(names, 0.0)
    busy: dict[int, tuple[str, float]] = {}  # turn -> attack and when it began
    environment = os.environ | {
        "OMP_NUM_THREADS": "1", "ATTACK_COMMIT": commit(), "MALLOC_PERTURB_": "165",
        "OPENBLAS_NUM_THREADS": "1", "ATTACK_DEAR": "50" if given.bars else "1",
    }  # fmt: skip
    left = dict.fromkeys(names, given.cases if given.cases is not None else sys.maxsize)
    call = [sys.executable, "-m", "tests.attack", "--folder", str(folder), "--serve"]
    server = Server(call, ROOT, environment)
    try:
        while True:
            remaining = end - time.monotonic()
            found = report.counted(folder) if given.bars or given.results else []
            save(found)
            due = [n for n in names if left[n] > 0]
            if given.bars:
                counts = Counter(name for name, _ in busy.values())
                first = bars.choose(due, found, counts, given.workers, bars.ready(names, folder))
                due = [first] if first else []
            if (remaining <= 0 or not due) and not busy:
                return
            full = len(busy) >= given.workers
            if not full and remaining > 0 and due:
                running = {n: sum(time.monotonic() - began for name, began in busy.values()
                                  if name == n) for n in due}  # fmt: skip
                name = min(due, key=lambda n: (spent[n] + running[n]) / shares[n])
                fair = total * shares[name] / sum(shares.values()) / given.workers
                seconds = min(*((_BAR_TURN,) if given.bars else (_TURN, fair)), remaining)
                turn = server.start(name, seconds, left[name], given.seed)
                if given.cases is not None:
                    left[name] = 0
                busy[turn] = name, time.monotonic()
                full = len(busy) >= given.workers
            for turn, code in server.ended(0.2 if full else 0.02):
                name, began = busy.pop(turn)
                if code:
                    raise SystemExit(f"{name} cannot begin, see above")
                spent[name] += time.monotonic() - began
    finally:
        server.close()
        for stray in folder.glob("worker-*"):
            if not Path(f"/proc/{stray.name.removeprefix('worker-')}").exists():
                shutil.rmtree(stray, ignore_errors=True)


def _absent(name: str, folder: Path) -> bool:
    why = ATTACKS[name](folder).absent()
    if why:
        print(f"{name}: left out: {why}")
    return bool(why)


def _replay(kept: Path) -> int:
    """Run a kept case again from its files."""
    said = json.loads((kept / CASE).read_text())
    print(f"{said.get('kind', said['attack'])}: {said.get('said')}\nthen: {said.get('defect')}")
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder) / "room"
        shutil.copytree(kept, room)
        attack = ATTACKS[said["attack"]](kept.parents[1] / "shared" / said["attack"])
        attack.begin()
        printed = Path(folder) / "printed.txt"
        try:
            found = isolated(lambda: attack.replay(said, room), attack.limit, printed)
        except Defect as defect:
            print(f"now: {defect}")
            return 1
        print(f"now: {', '.join(found)}")
    return 0
