"""A few cases of every attack of `python -m tests.attack`. Expected duration: 40 s."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from attack import bars, base, report
from attack.base import Attack, Defect, run_cases
from attack.catalogue import ATTACKS
from attack.serve import Server

from support import fuzzing, patience

#: Attack -> cases; those that take tens of seconds each are marked slow.
FEW = {
    "inputs": 12,
    "values": 300,
    "forged": 5,
    "folders": 2,
    "kills": 1,
    "studies": 1,
    "messages": 1,
}
SLOW = ("studies", "messages")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in FEW]
)
def test_a_few_cases_of_every_attack(name, tmp_path):
    folder = tmp_path / "attack"
    call = [sys.executable, "-m", "tests.attack", "--minutes", "4", "--only", name]
    call += ["--cases", str(FEW[name]), "--folder", str(folder)]
    found = subprocess.run(
        call, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    if "left out" in found.stdout:
        pytest.skip(found.stdout)
    said = found.stdout + found.stderr
    assert f"{name}: {FEW[name]} cases" in said, said
    assert found.returncode == 0, said


class _Bad(Attack):
    """Every way in which a case may go wrong."""

    name = "bad"
    limit = 1.0
    batch = 10

    def case(self, seed, number, room):
        import os
        import time

        if number == 1:
            raise Defect("a wrong bit")
        if number == 2:
            raise KeyError("raw")
        if number == 3:
            os.abort()
        if number == 4:
            time.sleep(30)
        return {"well": 1}


def test_crashes_hangs_and_raw_errors_are_seen_and_kept(tmp_path):
    attack, kept, found = _Bad(tmp_path), tmp_path / "kept", []
    for first in ((0, 1, 2, 3), (4,), (5,)):
        found += run_cases(attack, "s", iter(first), tmp_path / "room", kept)
    assert [r.defect.splitlines()[0] if r.defect else "" for r in found] == [
        "", "a wrong bit", "KeyError: 'raw'", "crash: SIGABRT", "hang: no answer in 1 s", "",
    ]  # fmt: skip
    assert sorted(p.name for p in kept.iterdir()) == [f"bad-s-{n}" for n in (1, 2, 3, 4)]
    assert list(ATTACKS) == [
        "kills",
        "studies",
        "inputs",
        "values",
        "forged",
        "messages",
        "folders",
    ]


class _Slow(Attack):
    """A case that is ready to run for longer than the limit, and one that sleeps."""

    name = "slow"
    limit = 1.0

    def case(self, seed, number, room):
        import time

        time.sleep(2.5 if number == 0 else 30)
        return {"well": 1}


def test_waiting_for_a_processor_is_no_hang(tmp_path, monkeypatch):
    """Of a machine that does something else for 2 s: nothing hangs; what sleeps does."""
    monkeypatch.setattr(base, "_LOOK", 0.1)
    queue = iter([k * 1.0 for k in range(100)])
    monkeypatch.setattr(patience, "_queued_in", lambda group: {group: next(queue)})
    attack, kept = _Slow(tmp_path), tmp_path / "kept"
    (found,) = run_cases(attack, "s", iter([0]), tmp_path / "room", kept)
    assert not found.defect
    monkeypatch.setattr(patience, "_queued_in", lambda group: {group: 0.0})
    (found,) = run_cases(attack, "s", iter([1]), tmp_path / "room", kept)
    assert found.defect.startswith("hang: no answer in 1 s")


def test_an_alarm_counts_the_time_that_the_process_had(monkeypatch):
    monkeypatch.setattr(fuzzing, "BUSY", 1.0)
    with pytest.raises(fuzzing.Hang), fuzzing.bounded(0.2):
        time.sleep(5)
    began = time.monotonic()
    # All but half of the time went into waiting for a processor.
    monkeypatch.setattr(fuzzing, "queued", lambda: 0.5 * (time.monotonic() - began))
    with fuzzing.bounded(0.4):
        time.sleep(0.6)
    with pytest.raises(fuzzing.Hang), fuzzing.bounded(0.4):
        time.sleep(5)


def test_the_system_says_who_waits_for_a_processor():
    mine = patience._queued_in(os.getpgid(0))
    assert os.getpid() in mine
    if Path("/proc/self/schedstat").exists():
        assert patience.queued() > 0.0
    assert patience.queued(10**9) == 0.0


def test_turns_are_forks_of_one_process(tmp_path):
    """Python starts and imports once, not for every turn."""
    root = Path(__file__).parents[2]
    call = [sys.executable, "-m", "tests.attack", "--folder", str(tmp_path), "--serve"]
    server = Server(call, root, os.environ | {"ATTACK_COMMIT": "c"})
    try:
        for seed in ("0", "1", "2"):
            turn, ended = server.start("values", 60.0, 20, seed), []
            while not ended:
                ended = server.ended(1.0)
            assert ended == [(turn, 0)]
    finally:
        server.close()
    found = report.counted(tmp_path)
    assert [(one["seed"], one["cases"]) for one in found] == [("0", 20), ("1", 20), ("2", 20)]
    assert {one["parent"] for one in found} == {server._process.pid}


def _record(name, units, seconds):
    outcomes = {"kills": units} if name == "kills" else {"messages under the sanitizers": units}
    return {
        "attack": name, "seed": "1", "commit": "c", "cases": units, "outcomes": outcomes,
        "defects": [], "seconds": seconds, "file": f"{name}-1-1",
    }  # fmt: skip


def test_workers_are_dealt_to_the_aim_that_is_furthest_away():
    names, ready = list(bars.GOALS), dict.fromkeys(bars.GOALS, True)
    met = [_record(n, bars.GOALS[n], 10.0) for n in names]
    assert bars.choose(names, met, {}, 16, ready) == ""
    open_ = [r for r in met if r["attack"] != "forged"]
    assert bars.choose(names, open_, {"inputs": 3}, 16, ready) == "forged"
    # Others would wait for the one that makes what its cases share.
    assert bars.choose(names, open_, {"forged": 1}, 16, ready | {"forged": False}) == ""
    slow = [_record("kills", 1, 1000.0)]
    assert bars.choose(["kills", "inputs"], slow, {"kills": 1}, 16, ready) == "kills"
    assert bars.choose(["kills", "inputs"], slow, {"kills": 6}, 16, ready) == "inputs"


def test_counts_of_another_machine_join_the_page_once(tmp_path, monkeypatch):
    lines, page = tmp_path / "lines.jsonl", tmp_path / "page.md"
    page.write_text(f"before {report._BEGIN} old {report._END} after")
    monkeypatch.setattr(report, "LINES", lines)
    monkeypatch.setattr(report, "LONG", tmp_path / "long.jsonl")
    monkeypatch.setattr(report, "PAGE", page)
    bars.save([_record("kills", 2000, 9.0), _record("inputs", 50_000, 9.0)], tmp_path / "there")
    there = [tmp_path / "there" / "attacks.json", tmp_path / "there" / "long_run.json"]
    there[1].write_text('{"kills": 5}')
    for _ in range(2):
        report.write(tmp_path / "nothing", there)
    assert (tmp_path / "long.jsonl").read_text() == '{"kills": 5}\n'
    found = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [(f["attack"], f["cases"]) for f in found] == [("kills", 2000), ("inputs", 50_000)]
    assert "| 2,000 kills | 2,000 | 0 | 2,000 (c) | 0 |" in page.read_text()
    assert "| 1,000,000 messages | 0 | 0 | 0 | 0 |" in page.read_text()
    assert "50,000" in page.read_text() and "old" not in page.read_text()
