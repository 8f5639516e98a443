"""Studies beside what goes wrong: limits of time, workers that hang or die early, damaged files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from python.study_scenes import LONG, UNTIL, block, kinetic, long_block, status, wait_for

import libmpm
from libmpm import studies
from libmpm._src.output.locks import Lock, this_process
from libmpm._src.run import loop
from libmpm._src.studies.study import dispatch, pool, record, worker


def make(folder, rows=({"gravity": 1.0}, {"gravity": 2.0}), factory=block, **arguments):
    arguments = {"until": UNTIL, "response": kinetic} | arguments
    return libmpm.Study(folder, factory, rows, **arguments)


def run(study, **arguments):
    return study.run(**{"workers": 0, "device": "cpu", "progress": False} | arguments)


# Limits of time ---------------------------------------------------------------------------------


class Counted:
    """Clocks of which one advances by a second each time it is read: no busy machine is slow."""

    def __init__(self):
        self.seconds = 0.0

    def __getattr__(self, name):
        return getattr(time, name)

    def monotonic(self):
        self.seconds += 1.0
        return self.seconds


def test_a_case_over_its_limit_of_time_fails_and_goes_on_with_a_larger_one(tmp_path, monkeypatch):
    study = make(tmp_path / "limited", [{}], long_block, until=LONG)
    with monkeypatch.context() as patch:
        # A second is over after each slice, and so short are slices that the case needs hundreds.
        counted = Counted()
        patch.setattr(loop, "clock", counted)
        patch.setattr(worker, "clock", counted)
        patch.setattr(loop, "SLICE", 1e-3)
        result = run(study, time_limit=20)
        (failed,) = result.failed
        assert "its time limit, 20 s, was reached at " in failed["error"]
        assert "raise time_limit and run with retry_failed=True" in failed["error"]
        reached = study.cases[0].record["time"]
        assert 0 < reached < LONG
        # What it has used counts, so the same limit is over at once.
        again = run(make(tmp_path / "limited", [{}], long_block, until=LONG),
                    time_limit=20, retry_failed=True)  # fmt: skip
        assert f"was reached at {reached:g} of" in again.failed[0]["error"]
    study = make(tmp_path / "limited", [{}], long_block, until=LONG)
    result = run(study, time_limit=600, retry_failed=True)
    assert not result.failed
    assert study.cases[0].record["resumed_at"] >= reached
    whole = run(make(tmp_path / "whole", [{}], long_block, until=LONG))
    assert result["kinetic"].tolist() == whole["kinetic"].tolist()


def test_a_worker_that_hangs_beyond_the_limit_is_ended(tmp_path, monkeypatch):
    """A stopped process stands for one that no longer answers; the grace is over once it is."""
    limit = 600.0
    study = make(tmp_path, [{"number": 0}, {"number": 1}], long_block, until=LONG)
    victim = study.cases[0].folder
    stopped = []
    real = pool.SpawnPool.kill

    def stop():
        found = wait_for(lambda: status(victim).get("status") == "running" and status(victim))
        os.kill(found["pid"], signal.SIGSTOP)
        stopped.append(found["pid"])
        monkeypatch.setattr(dispatch, "_GRACE_SHARE", -1.0)
        monkeypatch.setattr(dispatch, "_GRACE", -limit)

    def kill(self, future):
        monkeypatch.setattr(dispatch, "_GRACE", 600.0)
        real(self, future)

    monkeypatch.setattr(pool.SpawnPool, "kill", kill)
    stopper = threading.Thread(target=stop)
    stopper.start()
    result = run(study, workers=1, time_limit=limit)
    stopper.join()
    assert result["status"].tolist() == ["failed", "finished"]
    assert "its time limit is 600 s: its worker was ended" in result.rows[0]["error"]
    assert status(victim)["attempt"] == 1
    with pytest.raises(ProcessLookupError):
        os.kill(stopped[0], 0)


@pytest.mark.parametrize("wrong", [0, -1, "x", float("nan"), float("inf"), True])
def test_a_limit_of_time_is_seconds(tmp_path, wrong):
    with pytest.raises(libmpm.SceneError, match="time_limit"):
        run(make(tmp_path), time_limit=wrong)


# Workers ----------------------------------------------------------------------------------------


def test_a_worker_killed_before_its_first_case_does_not_end_the_study(tmp_path, monkeypatch):
    """The hint on scripts without a guard is for workers that cannot start, not for killed ones."""
    real, killed = pool.SpawnPool.submit, []

    def submit(self, *arguments):
        future = real(self, *arguments)
        if not killed:
            killed.append(future)
            self.kill(future)
        return future

    monkeypatch.setattr(pool.SpawnPool, "submit", submit)
    study = make(tmp_path)
    assert not run(study, workers=1).failed
    assert killed
    assert sorted(case.record["attempt"] for case in study.cases) == [1, 2]


def test_a_study_that_waits_for_others_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(dispatch, "_SILENCE", 0.5)
    study = make(tmp_path)
    (first, _) = [case.folder for case in study.cases]
    first.mkdir(parents=True)
    lock = Lock.acquire(first / "lock")
    timer = threading.Timer(2.5, lock.release)
    timer.start()
    with pytest.warns(UserWarning, match=f"waiting for 1 cases .*held by process {os.getpid()}"):
        result = run(study)
    timer.join()
    assert not result.failed


# Damaged files ----------------------------------------------------------------------------------

#: What may have become of a study.json: key -> its content, or a change of the whole one.
LEDGERS = {
    "no rows": lambda found: found.pop("rows"),
    "rows": lambda found: found.update(rows={"a": 1}),
    "a row": lambda found: found["rows"].append([1]),
    "parameters": lambda found: found["rows"][0].update(parameters=None),
    "a case": lambda found: found["rows"][0].update(case="../../elsewhere"),
    "a trunk": lambda found: found["rows"][0].update(trunk=3),
    "an error": lambda found: found["rows"][0].pop("error"),
    "not finite": lambda found: found["rows"][0]["parameters"].update(gravity=float("nan")),
    "axes": lambda found: found.update(run_axes=[1]),
    "name": lambda found: found.update(name=None),
    "format": lambda found: found.update(study=[1]),
    "no format": lambda found: found.pop("study"),
}


@pytest.mark.parametrize("damage", [*LEDGERS, "empty", "deep", "cut", "a folder"])
def test_a_damaged_ledger_is_named_and_kept(tmp_path, damage, counted):
    run(make(tmp_path))
    path = tmp_path / "study.json"
    text = path.read_text()
    if damage == "a folder":
        path.unlink()
        path.mkdir()
    elif damage in LEDGERS:
        found = json.loads(text)
        LEDGERS[damage](found)
        path.write_text(json.dumps(found))
    else:
        path.write_text({"empty": "", "deep": "[" * 100_000, "cut": text[:40]}[damage])
    damaged = None if damage == "a folder" else path.read_text()
    for attempt in (lambda: studies.Study.open(tmp_path), lambda: run(make(tmp_path))):
        with pytest.raises(libmpm.Error, match=r"study\.json"):
            attempt()
    assert damaged is None or path.read_text() == damaged
    # The remedy: away with it, and nothing is run again.
    path.rename(tmp_path / "old.json")
    assert not run(make(tmp_path)).failed
    assert len(counted) == 2


RECORDS = [
    "", "{", "[]", "[" * 100_000, '{"status": 3}', '{"status": "done"}', "{}", "\x00\x00",
    '{"status": "finished", "steps": "many"}', '{"status": "finished", "wall_time": NaN}',
    '{"status": "finished", "particles": [1]}', '{"status": "failed", "error": {}}',
    '{"status": "running", "until": 1e999}', '{"status": "finished", "warnings": {"a": 1}}',
]  # fmt: skip


def test_what_a_killed_writer_left_behind_is_swept_and_nothing_of_the_living(tmp_path, counted):
    run(make(tmp_path))
    child = subprocess.Popen(
        [sys.executable, "-c", "from libmpm._src.output import locks; print(locks.this_process())"],
        stdout=subprocess.PIPE,
        text=True,
    )
    dead = child.communicate()[0].strip()
    case = next((tmp_path / "cases").iterdir())
    left, living = [], []
    for folder, name in ((tmp_path, "study.json"), (case, "response.json")):
        left.append(folder / f".{name}.{dead}-0123.part")
        living.append(folder / f".{name}.{this_process()}-0123.part")
    for path in (*left, *living):
        path.write_text("{")
    run(make(tmp_path))
    assert [path.exists() for path in left] == [False, False]
    assert [path.exists() for path in living] == [True, True]


@pytest.mark.parametrize("text", RECORDS)
def test_a_damaged_record_counts_as_none_and_the_case_runs_again(tmp_path, text, counted):
    study = make(tmp_path)
    whole = run(study)["kinetic"].tolist()
    (tmp_path / "cases" / study.cases[0].hash / "status.json").write_text(text)
    opened = studies.Study.open(tmp_path)
    assert "planned" in str(opened.status())
    assert opened.collect()["status"].tolist() == ["planned", "finished"]
    assert run(make(tmp_path))["kinetic"].tolist() == whole
    assert len(counted) == 3


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", '{"rows": 3}', '{"rows": [3, {}, {"parameters": {}, "response": [1]}]}',
        '{"rows": [{"parameters": {"gravity": 1.0}, "response": {"kinetic": "much"}}]}',
        '{"rows": [{"parameters": {"gravity": NaN}, "response": {"kinetic": 1}}]}',
    ],
)  # fmt: skip
def test_damaged_responses_are_computed_again(tmp_path, text, counted):
    study = make(tmp_path)
    whole = run(study)["kinetic"].tolist()
    path = tmp_path / "cases" / study.cases[0].hash / "response.json"
    path.write_text(text)
    assert studies.Study.open(tmp_path).collect()["status"].tolist() == ["finished", "finished"]
    assert run(make(tmp_path))["kinetic"].tolist() == whole
    assert studies.Study.open(tmp_path).collect()["kinetic"].tolist() == whole
    assert len(counted) == 2


def test_what_a_run_writes_is_a_record(tmp_path):
    """No field that is written is refused when it is read: a finished case stays finished."""
    study = make(tmp_path)
    run(study)
    for case in study.cases:
        written = json.loads((case.folder / "status.json").read_text())
        assert record.read_record(case.folder) == written
        assert set(written) - {"status"} <= set(record._RECORD)


def test_rows_without_a_bottom_are_refused(tmp_path):
    row = []
    for _ in range(5000):
        row = [row]
    with pytest.raises(libmpm.SceneError, match="row 0 is nested too deep"):
        make(tmp_path, [{"gravity": row}])


def test_a_damaged_checkpoint_of_a_trunk_is_named_with_its_remedy(tmp_path, counted):
    def branch(checkpoint, gravity):
        return libmpm.Scene.from_checkpoint(checkpoint)

    def made():
        trunk = libmpm.studies.Trunk(block, until=UNTIL / 2)
        return make(tmp_path, factory=branch, trunk=trunk, rows=[{"gravity": 3.0}])

    assert not run(made()).failed
    (trunk,) = (tmp_path / "trunks").iterdir()
    (trunk / "trunk.npz").write_bytes(b"half")
    (failed,) = run(made()).failed
    assert f"delete {trunk / 'trunk.npz'}: the trunk runs again" in failed["error"]
    (trunk / "trunk.npz").unlink()
    assert not run(made()).failed
