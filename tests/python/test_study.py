"""Studies in this process: names of cases, what is run and what is not, trunks, tables."""

from __future__ import annotations

import csv
import json
import re
import shutil
import threading
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest
from python.study_scenes import LONG, UNTIL, block, fallen, kinetic, long_block, status, wait_for

import libmpm
from libmpm import studies
from libmpm._src.cli.commands import main
from libmpm._src.studies.study import worker
from libmpm._src.studies.study.plan import _replaced

ROWS = [{"gravity": 5.0}, {"gravity": 10.0}]


def make(folder, rows=ROWS, factory=block, **arguments):
    arguments = {"until": UNTIL, "response": kinetic} | arguments
    return libmpm.Study(folder, factory, rows, **arguments)


def run(study, **arguments):
    return study.run(workers=0, device="cpu", progress=False, **arguments)


# Names and plans --------------------------------------------------------------------------------


def test_a_case_is_named_by_what_decides_its_results(tmp_path):
    def name(**changes):
        study = make(tmp_path, [{"gravity": 5.0}], **changes)
        (case,) = study.cases
        assert len(case.hash) == 16
        assert case.folder == tmp_path / "cases" / case.hash
        return case.hash

    first = name()
    assert name(options={"device": "cuda:3", "threads": 7}) == first
    assert name(options={"precision": "single"}) == first  # what "auto" stands for
    assert name(frame_interval=0.1, checkpoint_interval=1.0, response=None) == first
    others = {
        name(until=2 * UNTIL),
        name(options={"precision": "double"}),
        name(options={"time_step": 1e-5}),
        name(options={"pipeline": "two-pass"}),
        name(factory=lambda gravity: block(gravity=gravity + 1)),
    }
    assert len(others | {first}) == 6
    assert not any(tmp_path.iterdir())  # looking at cases writes nothing


def test_rows_may_carry_options_of_the_run(tmp_path):
    rows = studies.full_factorial(
        {"gravity": [5.0], "precision": ["single", "double"], "threads": [1, 2]}
    )
    study = make(tmp_path, rows, run_axes=("precision", "threads"))
    assert len({case.hash for case in study.cases}) == 4
    result = run(study)
    assert result["precision"].tolist() == ["single", "single", "double", "double"]
    assert result["threads"].tolist() == [1, 2, 1, 2]
    assert result.columns.count("precision") == 1
    # Threads change no bit, precision does.
    energy = result["kinetic"]
    assert energy[0] == energy[1] != energy[2] == energy[3]
    records = [status(tmp_path / "cases" / name) for name in result["case"]]
    assert [r["threads"] for r in records] == [1, 2, 1, 2]


def test_end_and_options_may_depend_on_the_row(tmp_path):
    study = make(
        tmp_path,
        until=lambda gravity: 0.05 / gravity,
        options=lambda gravity: {"time_step": 1e-4 * gravity},
    )
    result = run(study)
    records = [status(tmp_path / "cases" / name) for name in result["case"]]
    assert [r["until"] for r in records] == [0.01, 0.005]
    assert [r["time_step"] for r in records] == pytest.approx([5e-4, 1e-3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rows": [{"gravty": 1}]}, "the factory: takes no argument 'gravty'.*'gravity'"),
        ({"rows": [{"steps": 1}], "factory": lambda **row: block()}, "'steps' is the name of a"),
        ({"rows": [{"device": "cpu"}], "factory": lambda **row: block()}, "list it in run_axes"),
        ({"until": -1.0}, "until is -1; expected > 0"),
        ({"factory": 3}, "factory is 3"),
        ({"response": 3}, "response is 3"),
        ({"trunk": 3}, "trunk is 3"),
        ({"run_axes": ("precison",)}, "run_axes has 'precison'; did you mean 'precision'"),
        ({"options": {"thread": 1}}, "options has 'thread'; did you mean 'threads'"),
        ({"checkpoint_interval": -1.0}, "checkpoint_interval is -1.0"),
        ({"untill": 3}, "unknown argument 'untill'"),
        (
            {"factory": lambda gravity, side: block(), "rows": [{"gravity": 1, "side": 2}, *ROWS]},
            "the factory has no default for 'side', which row 1 lacks",
        ),
        ({"until": lambda end: end}, "until has no default for 'end', which row 0 lacks"),
        ({"trunk": libmpm.studies.Trunk(block, 1.0)}, "the factory takes no argument 'checkpoint'"),
        (
            {
                "factory": lambda **row: 0,
                "trunk": libmpm.studies.Trunk(lambda depth: 0, lambda end: 0),
            },
            "trunk's factory has no default for 'depth'(.|\n)*trunk's until has no.*'end'",
        ),
    ],
)
def test_bad_requests_are_refused_before_anything_starts(tmp_path, arguments, message):
    with pytest.raises(libmpm.SceneError, match=message):
        make(tmp_path, **arguments)


def test_bad_runs_are_refused_before_anything_starts(tmp_path):
    study = make(tmp_path / "study")
    with pytest.raises(libmpm.SceneError) as caught:
        study.run(3, attempts=0, threads=-1)
    said = "\n".join(caught.value.problems)
    for part in ("executor is 3", "attempts is 0", "threads is -1"):
        assert part in said
    with ThreadPoolExecutor(1) as executor, pytest.raises(libmpm.SceneError, match="workers is"):
        study.run(executor, workers=2)
    with pytest.raises(libmpm.DeviceError, match="cuda:9"):
        study.run(device="cuda:9")
    assert not (tmp_path / "study" / "cases").exists()


# What is run ------------------------------------------------------------------------------------


def test_blocks_fall_as_gravity_says(tmp_path):
    result = run(make(tmp_path))
    assert result.parameters == ("gravity",)
    assert result.responses == ("kinetic", "end")
    assert result["status"].tolist() == ["finished", "finished"]
    assert not result.failed
    for row in result.rows:
        assert row["kinetic"] == pytest.approx(fallen(row), rel=1e-5)
        assert row["particles"] == 16
        assert row["steps"] > 0
        assert row["device"] == "cpu"
        assert row["version"] == libmpm.build_info()["version"]
    assert result["end"] == pytest.approx(UNTIL, rel=0.2)
    assert result["wall_time"].min() > 0


def test_a_case_has_its_files(tmp_path):
    study = make(tmp_path, [{"gravity": 5.0}])
    run(study)
    (case,) = study.cases
    assert case.status == "finished"
    assert case.parameters == {"gravity": 5.0}
    assert case.scene == block(gravity=5.0)
    record = case.record
    assert record["hash"] == case.hash
    assert record["attempt"] == 1
    written = {path.name for path in case.folder.iterdir()}
    assert {"scene.json", "parameters.json", "response.json", "sensors.h5", "log.json"} <= written
    assert "lock" not in written
    # The scene file runs alone, to the same end.
    out = tmp_path / "alone"
    command = ["run", str(case.folder / "scene.json"), "-o", str(out), "--device", "cpu"]
    assert main([*command, "--threads", "1", "--quiet", "--no-picture"]) == 0
    with h5py.File(out / "sensors.h5") as alone, h5py.File(case.folder / "sensors.h5") as mine:
        assert np.array_equal(alone["energy/values"][:], mine["energy/values"][:])


def test_finished_cases_are_skipped_and_a_study_grows(tmp_path, counted):
    run(make(tmp_path))
    assert len(counted) == 2
    study = make(tmp_path)
    run(study)
    assert len(counted) == 2
    study.add([{"gravity": 1.0}])
    result = run(study)
    assert len(counted) == 3
    assert result["gravity"].tolist() == [5.0, 10.0, 1.0]
    assert [case.status for case in study.cases] == ["finished"] * 3
    # The folder knows all rows, those too that this script no longer asks for.
    assert len(run(make(tmp_path, [{"gravity": 2.0}]))) == 1
    assert studies.Study.open(tmp_path).collect()["gravity"].tolist() == [5.0, 10.0, 1.0, 2.0]


def test_rows_that_come_to_the_same_case_share_it(tmp_path, counted):
    def factory(gravity, threshold):
        return block(gravity=gravity)

    def response(case):
        above = case.sensors["energy"].values[-1, 0] > case.parameters["threshold"]
        return {"above": bool(above)}

    rows = studies.full_factorial({"gravity": [5.0], "threshold": [0.0, 1e9, 0]})
    result = run(make(tmp_path, rows, factory, response=response))
    assert len(counted) == 1
    assert len(set(result["case"])) == 1
    assert result["above"].tolist() == [True, False, True]
    assert studies.Study.open(tmp_path).collect()["above"].tolist() == [True, False, True]


def test_a_failed_case_is_recorded_and_does_not_stop_the_rest(tmp_path, counted):
    def factory(gravity):
        if gravity == 3.0:
            raise ValueError("no such planet")
        return block(gravity=gravity)

    def options(gravity):
        # The engine refuses a step above the stable one.
        return {"time_step": 1.0} if gravity == 2.0 else {}

    rows = [{"gravity": g} for g in (1.0, 2.0, 3.0, 4.0)]
    study = make(tmp_path, rows, factory, options=options)
    result = run(study)
    assert result["status"].tolist() == ["finished", "failed", "failed", "finished"]
    assert np.isnan(result["kinetic"][1:3]).all()
    first, second = result.failed
    assert "time_step" in first["error"]
    assert re.fullmatch(
        r"ValueError: no such planet \(test_study.py:\d+ in factory\)", second["error"]
    )
    folder = tmp_path / "cases" / first["case"]
    assert "SceneError" in (folder / "traceback.txt").read_text()
    assert "2 finished, 2 failed" in repr(result)
    assert "run again with run(retry_failed=True)" in repr(result)
    assert "no such planet" in repr(result)
    assert len(counted) == 3
    # It is not tried again unless asked for.
    run(make(tmp_path, rows, factory, options=options))
    assert len(counted) == 3
    again = run(make(tmp_path, rows, factory, options=options), retry_failed=True)
    assert len(counted) == 4
    assert again["status"].tolist() == result["status"].tolist()


def test_a_retry_may_go_well(tmp_path, monkeypatch):
    monkeypatch.setattr(libmpm.Simulation, "run", lambda *a, **k: 1 / 0)
    rows = [{"gravity": 5.0}]
    (failed,) = run(make(tmp_path, rows)).failed
    assert failed["error"].startswith("ZeroDivisionError: division by zero (test_study.py:")
    monkeypatch.undo()
    assert run(make(tmp_path, rows)).failed
    result = run(make(tmp_path, rows), retry_failed=True)
    assert not result.failed
    assert result.rows[0]["kinetic"] == pytest.approx(fallen(result.rows[0]), rel=1e-5)
    assert not (tmp_path / "cases" / result.rows[0]["case"] / "traceback.txt").exists()


def test_an_interrupt_is_recorded_and_handed_on(tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(libmpm.Simulation, "run", interrupted)
    study = make(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        run(study)
    assert [case.status for case in study.cases] == ["interrupted", "planned"]
    assert not list(tmp_path.glob("**/lock"))
    assert not list(tmp_path.glob(".stop*"))
    monkeypatch.undo()
    assert not run(study).failed


def test_a_running_case_tells_how_far_it_is(tmp_path, monkeypatch):
    monkeypatch.setattr(worker.locks, "HEARTBEAT", 0.02)
    said = []

    def look():
        (case,) = study.cases
        wait_for(lambda: status(case.folder).get("time", 0.0) > 0)
        said.append(repr(libmpm.Study.open(tmp_path).status()))

    study = make(tmp_path, [{}], long_block, until=2 * LONG)
    watcher = threading.Thread(target=look)
    watcher.start()
    assert not run(study).failed
    watcher.join()
    assert "1 rows: 1 running" in said[0]
    assert f"of {2 * LONG:g} s on cpu of " in said[0]


def test_a_case_that_another_process_took_over_is_left_to_it(tmp_path, monkeypatch):
    monkeypatch.setattr(worker.locks, "HEARTBEAT", 0.02)
    study = make(tmp_path, [{}], long_block, until=LONG)
    (case,) = study.cases

    def take_over():
        found = wait_for(lambda: status(case.folder))
        lock = case.folder / "lock"
        lock.write_text(json.dumps(json.loads(lock.read_text()) | {"token": "another"}))
        wait_for(lambda: not [t for t in threading.enumerate() if "heartbeat" in t.name])
        done = {"status": "finished", "token": "another", "steps": 3}
        (case.folder / "status.json").write_text(json.dumps(found | done))
        lock.unlink()

    other = threading.Thread(target=take_over)
    other.start()
    result = run(study)
    other.join()
    assert result["steps"].tolist() == [3]
    assert study.cases[0].record["token"] == "another"


def test_a_case_whose_run_notices_first_is_left_to_who_took_it_over(tmp_path, monkeypatch):
    """Before a beat does: the run failed, and its record replaced the one of the other process."""

    def noticed(self):
        lock = self._folder / "lock"
        lock.write_text(json.dumps(json.loads(lock.read_text()) | {"token": "another"}))
        done = {"status": "finished", "token": "another", "steps": 3}
        (self._folder / "status.json").write_text(json.dumps(self._record | done))
        assert not self._lock.beat()
        lock.unlink()
        raise libmpm.OutputError("the folder is no longer this run's")

    monkeypatch.setattr(worker._Attempt, "_simulate", noticed)
    study = make(tmp_path, [{}], long_block, until=LONG)
    result = run(study)
    assert result["steps"].tolist() == [3]
    assert study.cases[0].record["token"] == "another"
    assert not (study.cases[0].folder / worker.TRACEBACK).exists()


def test_a_full_disk_fails_the_case_and_not_the_study(tmp_path, monkeypatch):
    study = make(tmp_path)
    real = worker.write_json

    def full(path, content):
        if path.parent.name == study.cases[0].hash and content.get("status") == "finished":
            raise libmpm.OutputError("the disk is full")
        real(path, content)

    monkeypatch.setattr(worker, "write_json", full)
    result = run(study)
    assert result["status"].tolist() == ["failed", "finished"]
    assert result.rows[0]["error"] == "OutputError: the disk is full"
    monkeypatch.undo()
    assert not run(study).failed


def test_the_lock_of_a_killed_worker_and_its_half_files_are_no_hindrance(tmp_path):
    study = make(tmp_path, [{"gravity": 5.0}])
    (case,) = study.cases
    case.folder.mkdir(parents=True)
    dead = {"token": "a", "place": worker.locks._place(), "pid": 2**22 + 1, "started": "1"}
    (case.folder / "lock").write_text(json.dumps(dead))
    (case.folder / "status.json").write_text('{"status": "running", "token": "a"}')
    (case.folder / "sensors.h5").write_bytes(b"half")
    (case.folder / "response.json").write_text('{"rows": [')
    assert [c.status for c in study.cases] == ["interrupted"]
    assert not run(study).failed


def test_cases_in_threads_run_side_by_side(tmp_path):
    rows = [{"gravity": float(g)} for g in range(1, 9)]
    with ThreadPoolExecutor(4) as executor:
        result = make(tmp_path, rows).run(executor, progress=False, device="cpu")
    for row in result.rows:
        assert row["kinetic"] == pytest.approx(fallen(row), rel=1e-5)


def test_two_studies_on_one_folder_run_no_case_twice(tmp_path, counted):
    rows = [{"gravity": float(g)} for g in range(1, 13)]
    results = []
    threads = [
        threading.Thread(target=lambda order: results.append(run(make(tmp_path, order))), args=(o,))
        for o in (rows, rows[::-1], rows)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(counted) == len(set(counted)) == 12
    for result in results:
        assert not result.failed
        assert np.isfinite(result["kinetic"]).all()
    assert len(studies.Study.open(tmp_path).collect()) == 12


def test_progress_is_told_to_a_callable(tmp_path):
    states = []
    study = make(tmp_path)
    study.run(workers=0, device="cpu", progress=states.append)
    assert states[-1].total == states[-1].done == 2
    assert states[-1].failed == 0
    assert states[-1].rate > 0
    assert [s.done for s in states] == sorted(s.done for s in states)


def test_a_bar_counts_cases(tmp_path, capsys):
    make(tmp_path, name="blocks").run(workers=0, device="cpu")
    said = capsys.readouterr().err
    assert "blocks: 100%" in said
    assert "2/2" in said


def test_warnings_of_cases_are_kept_and_told_once(tmp_path):
    def factory(gravity):
        data = block(gravity=gravity, velocity=100.0).to_dict()
        data["boundaries"] = []
        data["method"]["leaving"] = "delete"
        return libmpm.Scene.from_dict(data)

    with pytest.warns(libmpm.ModelWarning, match=r"2 of 2 simulations gave.*first:.*removed"):
        result = run(make(tmp_path, factory=factory))
    assert all(status(tmp_path / "cases" / name)["warnings"] for name in result["case"])


# Responses and tables ---------------------------------------------------------------------------


def test_a_response_can_be_changed_without_running(tmp_path, counted):
    run(make(tmp_path))
    study = make(tmp_path, response=lambda case: {"count": len(case.sensors["energy"])})
    result = study.collect()
    assert result.responses == ("count",)
    assert result["count"].min() > 0
    assert len(counted) == 2
    # What a folder shows without its script is what was last computed.
    opened = studies.Study.open(tmp_path)
    assert opened.collect()["count"].tolist() == result["count"].tolist()
    with pytest.raises(libmpm.SceneError, match="make the study from its factory"):
        opened.run()


@pytest.mark.parametrize(
    ("response", "message"),
    [
        (lambda case: {"gravity": 1.0}, "'gravity' is the name of a parameter too"),
        (lambda case: {"steps": 1.0}, "'steps' is the name of another column"),
        (lambda case: {"a": "x"}, "'a' is 'x'; expected a name and a number"),
        (lambda case: 3, "returned 3; expected a mapping"),
        (lambda case: {"a": case.sensors["gauge"]}, "KeyError: 'gauge'"),
    ],
)
def test_a_wrong_response_is_an_error_of_its_row_and_costs_no_run(
    tmp_path, counted, response, message
):
    study = make(tmp_path, response=response)
    result = run(study)
    assert result["status"].tolist() == ["finished", "finished"]
    assert len(result.failed) == 2
    assert all(message in row["error"] for row in result.failed)
    assert "2 finished; 2 responses failed" in repr(result)
    assert message in studies.Study.open(tmp_path).collect().rows[0]["error"]
    assert not run(make(tmp_path)).failed
    assert len(counted) == 2


def test_responses_that_are_not_finite_are_kept(tmp_path):
    values = {"none": float("nan"), "all": float("inf"), "n": np.int64(3), "good": np.float32(0.5)}
    run(make(tmp_path, response=lambda case: values))
    result = studies.Study.open(tmp_path).collect()
    assert np.isnan(result["none"]).all()
    assert (result["all"] == np.inf).all()
    assert result["n"].tolist() == [3, 3]
    assert result["good"].tolist() == [0.5, 0.5]
    json.loads(
        (tmp_path / "cases" / result.rows[0]["case"] / "response.json").read_text(),
        parse_constant=lambda text: pytest.fail(f"{text} is not JSON"),
    )


def test_tables_say_the_same_in_every_form(tmp_path):
    pandas = pytest.importorskip("pandas")
    rows = [{"gravity": 5.0, "name": "å, b"}, {"gravity": 1 / 3}]
    result = run(make(tmp_path, rows))
    records = result.to_records()
    assert records.dtype.names == result.columns
    assert records["kinetic"].tolist() == [row["kinetic"] for row in result.rows]
    frame = result.to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == list(result.columns)
    assert frame["gravity"].tolist() == [5.0, 1 / 3]
    with (tmp_path / "table.csv").open(encoding="utf-8", newline="") as file:
        head, *lines = csv.reader(file)
    assert tuple(head) == result.columns
    assert [float(line[0]) for line in lines] == [5.0, 1 / 3]
    assert [line[1] for line in lines] == ["å, b", ""]
    assert [float(line[2]) for line in lines] == result["kinetic"].tolist()
    with h5py.File(tmp_path / "table.h5") as file:
        assert tuple(file.attrs["columns"]) == result.columns
        assert list(file.attrs["versions"]) == [libmpm.build_info()["version"]]
        assert file["gravity"][:].tolist() == [5.0, 1 / 3]
        assert file["name"].asstr()[:].tolist() == ["å, b", ""]
        assert file["steps"].dtype.kind == "i"
    assert "å, b" in repr(result)
    assert "<td>finished</td>" in result._repr_html_()
    with pytest.raises(KeyError, match="did you mean 'kinetic'"):
        result["kinetics"]


def test_lists_and_values_of_libmpm_are_parameters_too(tmp_path):
    def factory(gravity, material, at):
        scene = block(gravity=gravity)
        low = tuple(at)
        scene.add_body(
            name="other",
            shape=libmpm.shapes.Box(lower=low, upper=tuple(x + 0.2 for x in low)),
            material=material,
        )
        return scene

    water = libmpm.materials.TaitFluid(bulk_modulus=1e6)
    result = run(make(tmp_path, [{"gravity": 5.0, "material": water, "at": (0.4, 0.2)}], factory))
    assert not result.failed
    assert result["at"].tolist() == ["[0.4,0.2]"]
    assert '"bulk_modulus":1000000.0' in result["material"][0]
    assert studies.Study.open(tmp_path).rows[0]["at"] == [0.4, 0.2]


def test_whole_numbers_keep_their_digits(tmp_path):
    rows = [{"gravity": 1, "seed": 2**70 + i, "small": i} for i in range(2)]
    study = make(tmp_path, rows, lambda gravity, seed, small: block(gravity=gravity))
    result = study.collect()
    assert result["seed"].tolist() == [str(2**70), str(2**70 + 1)]
    assert result["small"].dtype.kind == "i"


def test_a_long_table_is_cut_in_print(tmp_path):
    study = make(tmp_path, [{"gravity": 1.0 + i} for i in range(30)])
    text = repr(study.collect())
    assert "... 10 more rows" in text
    assert "30 rows: 30 planned" in text
    assert repr(make(tmp_path, []).collect()).endswith("0 rows")


# Trunks -----------------------------------------------------------------------------------------


def test_rows_with_equal_trunks_share_one_run(tmp_path, counted):
    seen = []

    def factory(checkpoint, gravity, velocity):
        seen.append(checkpoint)
        assert checkpoint.is_file()
        return block(gravity=gravity, velocity=velocity)

    trunk = libmpm.studies.Trunk(lambda gravity: block(gravity=gravity), until=2 * UNTIL)
    rows = studies.full_factorial({"gravity": [5.0, 10.0], "velocity": [0.1, 0.2, 0.3]})

    def fresh(folder):
        return make(folder, rows, factory, trunk=trunk)

    first = tmp_path / "first"
    study = fresh(first)
    assert [case.hash for case in study.cases] == [""] * 6
    assert study.status().counts["planned"] == 6
    result = run(study)
    assert not result.failed
    assert len(counted) == 2 + 6
    assert len(set(seen)) == 2
    assert all(case.hash for case in study.cases)
    assert set(result["trunk"]) == {path.name for path in (first / "trunks").iterdir()}
    costs = [status(path)["wall_time"] for path in (first / "trunks").iterdir()]
    assert result.trunk_wall_time == pytest.approx(sum(costs))
    assert result.time_saved == pytest.approx(2 * sum(costs))
    assert "shared by 3 cases" in repr(result)
    for path in (first / "trunks").iterdir():
        header = libmpm.Simulation.resume(path / "trunk.npz", device="cpu")
        assert header.time >= 2 * UNTIL
    # Everything is found again, elsewhere too.
    shutil.move(first, tmp_path / "second")
    again = run(fresh(tmp_path / "second"))
    assert again["case"].tolist() == result["case"].tolist()
    assert len(counted) == 8
    opened = studies.Study.open(tmp_path / "second").collect()
    assert opened.time_saved == pytest.approx(result.time_saved)


def test_a_path_of_a_checkpoint_does_not_name_the_case(tmp_path):
    path = tmp_path / "trunks" / "abc" / "trunk.npz"
    content = {"scene": {"start": [str(path), 3, "trunk.npz", "x"]}}
    assert _replaced(content, path, "trunk abc") == {
        "scene": {"start": ["trunk abc", 3, "trunk.npz", "x"]}
    }


def test_a_failed_trunk_fails_its_rows_only(tmp_path):
    def water(gravity):
        if gravity == 2.0:
            return block(gravity=gravity, interval=-1.0)
        return block(gravity=gravity)

    def factory(gravity, velocity, **_):
        return block(gravity=gravity, velocity=velocity)

    def options(gravity):
        return {"time_step": 1.0} if gravity == 3.0 else {}

    rows = studies.full_factorial({"gravity": [1.0, 2.0, 3.0], "velocity": [0.1, 0.2]})
    trunk = libmpm.studies.Trunk(water, until=UNTIL)
    result = run(make(tmp_path, rows, factory, trunk=trunk, options=options))
    assert result["status"].tolist() == ["finished"] * 2 + ["failed"] * 4
    assert "interval" in result.rows[2]["error"]
    assert "its trunk" in result.rows[4]["error"]
    assert "time_step" in result.rows[4]["error"]
    study = make(tmp_path, rows, factory, trunk=trunk)
    assert run(study)["status"].tolist() == ["finished"] * 2 + ["failed"] * 2 + ["finished"] * 2
    assert "failed without a folder" in repr(study.status())


def test_a_trunk_is_checked():
    with pytest.raises(libmpm.SceneError) as caught:
        libmpm.studies.Trunk(3, until=0)
    assert len(caught.value.problems) == 2
    with pytest.raises(libmpm.SceneError, match="'checkpoint' is what the trunk hands"):
        make(
            "nowhere",
            [{"checkpoint": "a"}],
            lambda **r: block(),
            trunk=libmpm.studies.Trunk(block, 1.0),
        )


@pytest.mark.skipif(
    not hasattr(libmpm.Scene, "from_checkpoint"), reason="no scenes from checkpoints"
)
def test_cases_go_on_from_the_trunk(tmp_path):
    def factory(checkpoint, height):
        scene = libmpm.Scene.from_checkpoint(checkpoint)
        scene.add_body(
            name="debris",
            shape=libmpm.shapes.Box(lower=(0.1, height), upper=(0.3, height + 0.2)),
            material=libmpm.materials.FixedCorotated(density=1000.0, youngs_modulus=1e6),
        )
        return scene

    rows = [{"height": 0.5}, {"height": 0.8}]
    trunk = libmpm.studies.Trunk(block, until=UNTIL)
    study = make(tmp_path, rows, factory, trunk=trunk, response=None, until=2 * UNTIL)
    result = run(study)
    assert not result.failed
    assert result["particles"].tolist() == [32, 32]
    assert len(set(result["case"])) == 2
    (folder,) = (tmp_path / "trunks").iterdir()
    for case in study.cases:
        assert case.record["first_step"] == status(folder)["steps"] > 0
        assert case.record["time"] >= 2 * UNTIL
        assert 0 < case.record["steps"] <= status(folder)["steps"] + 1


# The command line -------------------------------------------------------------------------------

FILE = """
import libmpm
from python.study_scenes import UNTIL, block, kinetic

def study(folder):
    rows = [{"gravity": 5.0}, {"gravity": 10.0, "velocity": SPEED}]
    return libmpm.Study(folder, block, rows, until=UNTIL, response=kinetic)
"""


def test_the_command_line_runs_looks_and_collects(tmp_path, capsys):
    script, folder = tmp_path / "blocks.py", tmp_path / "out"
    script.write_text(FILE.replace("SPEED", "0.1"))
    command = ["study", "run", str(script), "-o", str(folder), "--workers", "0", "--quiet"]
    assert main([*command, "--device", "cpu"]) == 0
    assert "2 rows: 2 finished" in capsys.readouterr().out
    assert main(["study", "status", str(folder)]) == 0
    assert "2 rows: 2 finished" in capsys.readouterr().out
    assert main(["study", "collect", str(folder), "-o", str(tmp_path / "t.csv")]) == 0
    assert (tmp_path / "t.csv").read_text() == (folder / "table.csv").read_text()
    assert main(["study", "collect", str(folder), "-o", str(tmp_path / "t.h5")]) == 0
    assert main(["study", "collect", str(folder), "-o", str(tmp_path / "t.txt")]) == 2
    assert ".csv, .h5" in capsys.readouterr().err
    # A horizontal speed beyond what the grid can follow.
    script.write_text(FILE.replace("SPEED", "1e9"))
    assert main(command) == 3
    assert "1 finished, 1 failed" in capsys.readouterr().out
    assert main(["study", "status", str(folder)]) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "defines no function 'study'"),
        ("study = 3", "defines no function 'study'"),
        ("def study(folder): return 3", "returned 3; expected a libmpm.Study"),
    ],
)
def test_files_without_a_study_exit_with_2(tmp_path, capsys, text, message):
    (tmp_path / "a.py").write_text(text)
    command = ["study", "run", str(tmp_path / "a.py"), "-o", str(tmp_path / "out")]
    assert main(command) == 2
    assert message in capsys.readouterr().err


def test_folders_without_a_study_exit_with_2(tmp_path, capsys):
    assert main(["study", "run", str(tmp_path / "none.py"), "-o", str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err
    for action in ("status", "collect"):
        assert main(["study", action, str(tmp_path)]) == 2
        assert "no whole study.json" in capsys.readouterr().err
