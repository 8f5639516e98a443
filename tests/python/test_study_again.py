"""Studies that are moved, cleaned up, half unreadable, or asked again for something else."""

from __future__ import annotations

import io
import json
import shutil
import threading
from concurrent.futures import Future

import numpy as np
import pytest
from python.study_scenes import LONG, UNTIL, block, kinetic, long_block, status, wait_for

import libmpm
from libmpm import studies
from libmpm._src.base.values import keywords_only
from libmpm._src.studies.study import case as case_module
from libmpm._src.studies.study import pool, progress, worker
from libmpm._src.studies.study import study as study_module
from libmpm._src.studies.study.rows import describe

ROWS = [{"gravity": 5.0}, {"gravity": 10.0}]


def make(folder, rows=ROWS, factory=block, **arguments):
    arguments = {"until": UNTIL, "response": kinetic} | arguments
    return libmpm.Study(folder, factory, rows, **arguments)


def run(study, **arguments):
    return study.run(workers=0, progress=False, **{"device": "cpu"} | arguments)


def debris(checkpoint, height):
    """The trunk's scene with a second block in it."""
    scene = libmpm.Scene.from_checkpoint(checkpoint)
    scene.add_body(
        name="debris",
        shape=libmpm.shapes.Box(lower=(0.4, height), upper=(0.6, height + 0.2)),
        material=libmpm.materials.FixedCorotated(density=1000.0, youngs_modulus=1e6),
        subtract_from=["block"],
    )
    return scene


def make_branches(folder, heights=(0.5, 0.8), **arguments):
    arguments = {"until": 2 * UNTIL, "response": None} | arguments
    rows = [{"height": height} for height in heights]
    return make(folder, rows, debris, trunk=libmpm.studies.Trunk(block, until=UNTIL), **arguments)


# Trunks -----------------------------------------------------------------------------------------


def test_neither_folder_nor_threads_of_a_trunk_name_its_cases(tmp_path, counted):
    # The lower half of the trunk's 16 particles lies where the second debris is put.
    heights = (0.5, 1.3)
    one = run(make_branches(tmp_path / "one", heights), threads=1)
    two = run(make_branches(tmp_path / "two", heights), threads=2)
    assert one["case"].tolist() == two["case"].tolist()
    assert len(set(one["case"])) == 2
    assert one["displaced"].tolist() == [0, 8]
    # A trunk that was run again, its file with other bytes, has the cases it had.
    (trunk,) = (tmp_path / "one" / "trunks").iterdir()
    before = (trunk / "trunk.npz").read_bytes()
    shutil.rmtree(trunk)
    del counted[:]
    again = run(make_branches(tmp_path / "one", heights), threads=2)
    assert counted == [trunk.name]
    assert (trunk / "trunk.npz").read_bytes() != before
    assert again["case"].tolist() == one["case"].tolist()
    assert not again.failed


def test_a_deleted_checkpoint_costs_its_trunk_and_no_case(tmp_path, counted):
    names = run(make_branches(tmp_path))["case"].tolist()
    (trunk,) = (tmp_path / "trunks").iterdir()
    (trunk / "trunk.npz").unlink()
    opened = studies.Study.open(tmp_path)
    assert opened.status().counts["finished"] == 2
    del counted[:]
    study = make_branches(tmp_path, (0.5, 0.8, 0.2))
    assert [c.status for c in study.cases] == ["planned"] * 3
    result = run(study)
    assert not result.failed
    assert result["case"].tolist()[:2] == names
    assert counted == [trunk.name, result["case"][2]]


def test_an_end_before_that_of_the_trunk_is_refused(tmp_path):
    result = run(make_branches(tmp_path, until=UNTIL / 2))
    assert result["status"].tolist() == ["failed", "failed"]
    assert "until is 0.005 s; the trunk ends at 0.01" in result.rows[0]["error"]
    assert "expected later" in result.rows[0]["error"]
    assert not (tmp_path / "cases").exists()


def test_a_trunk_without_its_checkpoint_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(libmpm.Simulation, "save_checkpoint", lambda *_: None)
    result = run(make_branches(tmp_path))
    assert result["status"].tolist() == ["failed", "failed"]
    assert "its trunk.npz is not seen here" in result.rows[0]["error"]
    monkeypatch.undo()
    assert not run(make_branches(tmp_path)).failed


def test_a_shell_sees_trunks_and_the_cases_they_bring(tmp_path, monkeypatch):
    monkeypatch.setattr(worker.locks, "HEARTBEAT", 0.02)
    said, known = [], []

    def look():
        folder = wait_for(lambda: list(tmp_path.glob("trunks/*")))[0]
        wait_for(lambda: status(folder).get("time", 0.0) > 0)
        said.append(repr(studies.Study.open(tmp_path).status()))

    def response(case):
        known.append([c.hash for c in studies.Study.open(tmp_path).cases])
        return {}

    rows = [{"velocity": 0.1}, {"velocity": 0.2}]
    trunk = libmpm.studies.Trunk(long_block, until=LONG)

    def factory(checkpoint, velocity):
        return block(velocity=velocity)

    watcher = threading.Thread(target=look)
    watcher.start()
    study = make(tmp_path, rows, factory, trunk=trunk, response=response)
    assert not run(study).failed
    watcher.join()
    assert "2 rows: 2 planned\ntrunk running " in said[0]
    assert f"of {LONG:g} s on cpu" in said[0]
    assert known[0] == [c.hash for c in study.cases]


# Folders ----------------------------------------------------------------------------------------


def test_a_case_whose_folder_cannot_be_made_fails_alone(tmp_path):
    study = make(tmp_path)
    (tmp_path / "cases").mkdir()
    blocked = study.cases[0].folder
    blocked.write_text("a file where a folder is needed")
    result = run(study)
    assert result["status"].tolist() == ["failed", "finished"]
    assert "OutputError: cannot write" in result.rows[0]["error"]
    assert blocked.name in result.rows[0]["error"]
    blocked.unlink()
    assert not run(make(tmp_path)).failed


@pytest.mark.parametrize("content", ['{"study": 99, "rows": []}', '{"study": 1, "ro', "[]"])
def test_a_ledger_of_another_kind_is_not_replaced(tmp_path, content):
    (tmp_path / "study.json").write_text(content)
    with pytest.raises(libmpm.OutputError, match=r"study\.json (has format 99|is no whole)") as got:
        run(make(tmp_path))
    assert "choose another folder" in str(got.value)
    assert (tmp_path / "study.json").read_text() == content
    assert not (tmp_path / "cases").exists()


def test_a_ledger_that_cannot_be_read_is_not_replaced(tmp_path):
    (tmp_path / "study.json").mkdir()
    with pytest.raises(libmpm.OutputError, match=r"cannot read .*study\.json"):
        run(make(tmp_path))


def test_frames_asked_for_too_late_are_told(tmp_path):
    run(make(tmp_path))
    wanted = [{"gravity": 5.0}, {"gravity": 10.0}, {"gravity": 2.0}]
    with pytest.warns(libmpm.ModelWarning, match=r"2 cases had finished without frames every 0.01"):
        run(make(tmp_path, wanted, frame_interval=0.01))


# Responses --------------------------------------------------------------------------------------


def test_a_response_may_have_no_value(tmp_path):
    def response(case):
        light = case.parameters["gravity"] == 5.0
        return {"peak": None if light else 2.0, "never": None}

    result = run(make(tmp_path, response=response))
    assert not result.failed
    for table in (result, studies.Study.open(tmp_path).collect()):
        assert np.array_equal(table["peak"], [np.nan, 2.0], equal_nan=True)
        assert np.isnan(table["never"]).all()
        assert table.rows[0]["peak"] is None
    lines = (tmp_path / "table.csv").read_text().splitlines()
    assert [line.split(",")[1] for line in lines] == ["peak", "", "2.0"]


def test_rows_of_one_case_are_written_at_once(tmp_path, monkeypatch):
    written = []
    real = case_module.write_shared

    def counting(path, content):
        written.append(len(content["rows"]))
        real(path, content)

    monkeypatch.setattr(case_module, "write_shared", counting)

    def factory(mark):
        return block()

    rows = studies.full_factorial({"mark": range(30)})
    assert rows[7] == {"mark": 7}
    study = make(
        tmp_path, rows, factory, response=lambda case: {"twice": 2 * case.parameters["mark"]}
    )
    assert run(study)["twice"].tolist() == list(range(0, 60, 2))
    assert written == [30]
    assert studies.Study.open(tmp_path).collect()["twice"].tolist() == list(range(0, 60, 2))


class Pool(pool.SpawnPool):
    """A pool of one worker that is this process, and tells `submitted` of every case."""

    submitted = staticmethod(lambda: None)

    def idle(self):
        return 0

    def submit(self, function, *arguments):
        future = Future()
        try:
            self.submitted()
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def close(self, *, wait):
        pass


def test_the_next_case_does_not_wait_for_a_response(tmp_path, monkeypatch):
    events = []
    monkeypatch.setattr(Pool, "submitted", lambda _: events.append("case"))
    monkeypatch.setattr(study_module, "_new_pool", Pool)

    def response(case):
        events.append("response")
        return {}

    make(tmp_path, response=response).run(workers=1, device="cpu", progress=False)
    assert events == ["case", "case", "response", "response"]


def test_an_error_on_the_way_to_a_worker_is_that_of_its_case(tmp_path, monkeypatch):
    lost = [ValueError("a message got lost")] * 2

    def lose(_):
        if lost:
            raise lost.pop()

    monkeypatch.setattr(Pool, "submitted", lose)
    monkeypatch.setattr(study_module, "_new_pool", Pool)
    rows = [{"gravity": 5.0}]
    (failed,) = make(tmp_path, rows).run(workers=1, device="cpu", progress=False).failed
    assert "died 2 time(s) (ValueError: a message got lost)" in failed["error"]


def test_rows_are_safe_from_those_who_see_them(tmp_path):
    def factory(at):
        at.append(3.0)
        return block(gravity=at[0])

    study = make(tmp_path, [{"at": [1.0, 2.0]}], factory)
    study.rows[0]["at"].clear()
    study.cases[0].parameters["at"].clear()
    assert study.rows == [{"at": [1.0, 2.0]}]
    assert studies.Study.open(run(study) and tmp_path).rows == [{"at": [1.0, 2.0]}]


# Texts ------------------------------------------------------------------------------------------


def test_errors_name_the_line_of_the_user_and_not_of_the_library():
    def wrong():
        return block(interval=-1.0)

    with pytest.raises(libmpm.SceneError) as caught:
        wrong()
    first, *_ = describe(caught.value).splitlines()
    assert "study_scenes.py:" in first
    assert first.endswith("in block)")
    assert describe(ValueError("a")) == "ValueError: a"
    with pytest.raises(json.JSONDecodeError) as parsed:
        json.loads("{")
    assert "(test_study_again.py:" in describe(parsed.value)


def test_a_keyword_after_optional_positions_may_be_required():
    class Thing:
        @keywords_only("Thing", 2)
        def __init__(self, a, b=1, *, c):
            self.all = (a, b, c)

    assert Thing(1, 2, c=3).all == (1, 2, 3)
    assert Thing(a=1, c=3).all == (1, 1, 3)
    with pytest.raises(libmpm.SceneError, match="'c' is missing"):
        Thing(1, 2)
    with pytest.raises(libmpm.SceneError, match="'a' is missing"):
        Thing(c=3)


def test_a_bar_in_a_file_adds_lines_when_numbers_change(monkeypatch):
    now = 100.0
    monkeypatch.setattr(progress.sys, "stderr", io.StringIO())
    state = studies.StudyState(total=3, done=0, failed=0, running=1, rate=0.0)
    bar = progress.reporter(True, "blocks", state)
    monkeypatch.setattr(progress.clock, "monotonic", lambda: now)
    bar._shown = now
    drawn = []
    monkeypatch.setattr(bar, "_show", lambda s: drawn.append(now) or setattr(bar, "_last_shown", s))
    for _ in range(30):
        now += 0.5
        done = int(now >= 103.0)
        bar.update(studies.StudyState(total=3, done=done, failed=0, running=1, rate=now))
    assert drawn == [103.0, 113.0]
