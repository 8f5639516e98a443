"""Tables that become rows, digests that name cases, samples, and locks."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest

import libmpm
from libmpm import studies
from libmpm._src.output import locks
from libmpm._src.output.locks import Lock, Observer, is_held, locked
from libmpm._src.studies.study.rows import call_with, canonical, digest, take_rows


def test_rows_come_from_mappings_arrays_and_frames():
    pandas = pytest.importorskip("pandas")
    wanted = [{"depth": 1.5, "count": 2}, {"depth": 2.0, "count": 3}]
    kinds = np.array([(1.5, 2), (2.0, 3)], dtype=[("depth", "f8"), ("count", "i4")])
    for table in (wanted, iter(wanted), kinds, kinds.view(np.recarray), pandas.DataFrame(wanted)):
        taken = take_rows("Study", table)
        assert taken == wanted
        assert [type(v) for v in taken[0].values()] == [float, int]
    made = take_rows("Study", [{"at": np.array([1.0, 2.0]), "on": np.bool_(True), "kind": "a"}])
    assert made == [{"at": [1.0, 2.0], "on": True, "kind": "a"}]
    assert made[0]["on"] is True


def test_every_wrong_entry_is_named():
    with pytest.raises(libmpm.SceneError) as caught:
        take_rows("Study", [{"a": float("nan")}, {"a": object()}, 3, {4: 1}, {"a": [1, np.inf]}])
    said = caught.value.problems
    assert len(said) == 5
    assert "row 0: a is nan; expected a finite number" in said[0]
    assert "row 1: a is <object" in said[1]
    assert "row 2 is 3; expected a mapping" in said[2]
    assert "row 3 has the name 4; expected a text" in said[3]
    assert "row 4: a[1] is inf" in said[4]
    with pytest.raises(
        libmpm.SceneError, match=r"one mapping.*write \[row\].*studies.full_factorial"
    ):
        take_rows("Study", {"a": [1, 2]})
    for wrong in ("depth", 3):
        with pytest.raises(libmpm.SceneError, match="expected mappings"):
            take_rows("Study", wrong)


def test_a_digest_is_that_of_the_content_and_not_of_its_order():
    one = {"b": (1, 2.5), "a": {"x": None, "y": "µ"}}
    assert canonical(one) == '{"a":{"x":null,"y":"\\u00b5"},"b":[1,2.5]}'
    # The first 64 bits of SHA-256 of the text above, from `sha256sum`.
    found = subprocess.run(
        ["sha256sum"], input=canonical(one).encode(), capture_output=True, check=True
    )
    assert digest(one) == found.stdout[:16].decode()
    assert digest({"a": {"y": "µ", "x": None}, "b": [1, 2.5]}) == digest(one)
    assert digest(one | {"c": 0}) != digest(one)


def test_what_no_file_can_hold_is_refused_by_name():
    with pytest.raises(libmpm.SceneError, match=r"the case: bodies\[1\]: velocity is <function"):
        digest({"bodies": [{}, {"velocity": lambda x: x}]})
    with pytest.raises(libmpm.SceneError, match="the case: until is nan; expected a finite"):
        digest({"until": float("nan")})


def test_callables_get_the_parameters_they_name():
    row = {"a": 1, "b": 2}
    assert call_with(lambda b: b, row) == 2
    assert call_with(lambda **all: all, row) == row
    with pytest.raises(TypeError, match="'c'"):
        call_with(lambda c: c, row)


def test_a_latin_hypercube_visits_every_part_of_every_range_once():
    rows = studies.latin_hypercube({"depth": (1.0, 3.0), "angle": (-10, 10)}, 20, seed=5)
    assert len(rows) == 20
    for name, (low, high) in {"depth": (1.0, 3.0), "angle": (-10, 10)}.items():
        parts = [int(20 * (row[name] - low) / (high - low)) for row in rows]
        assert sorted(parts) == list(range(20))
        assert all(type(row[name]) is float for row in rows)
    assert studies.latin_hypercube({"depth": (1.0, 3.0), "angle": (-10, 10)}, 20, seed=5) == rows
    assert studies.latin_hypercube({"depth": (1.0, 3.0), "angle": (-10, 10)}, 20, seed=6) != rows


def test_a_sobol_sequence_is_balanced_and_wants_a_power_of_two():
    rows = studies.sobol({"x": (0, 1), "y": (0, 2)}, 16, seed=1)
    # A net of 16 points in base 2: every one of the 4 × 4 boxes holds exactly one.
    boxes = {(int(4 * row["x"]), int(2 * row["y"])) for row in rows}
    assert len(boxes) == 16
    with pytest.raises(libmpm.SceneError, match=r"n is 12; expected a power of two.*use 8 or 16"):
        studies.sobol({"x": (0, 1)}, 12, seed=1)


def test_a_grid_has_every_combination():
    rows = studies.full_factorial({"a": [1, 2], "b": np.array([0.5, 1.5]), "c": ["x"]})
    assert rows == [
        {"a": 1, "b": 0.5, "c": "x"},
        {"a": 1, "b": 1.5, "c": "x"},
        {"a": 2, "b": 0.5, "c": "x"},
        {"a": 2, "b": 1.5, "c": "x"},
    ]


def test_wrong_ranges_are_named():
    with pytest.raises(libmpm.SceneError) as caught:
        studies.latin_hypercube({"a": (2, 1), "b": (0, "x"), "c": 4}, 0, seed=1)
    said = "\n".join(caught.value.problems)
    for part in ("n is 0", "'a' is (2, 1); expected (low, high)", "'b'[1] is 'x'", "'c' is 4"):
        assert part in said
    with pytest.raises(libmpm.SceneError, match="'a' is 3; expected a list"):
        studies.full_factorial({"a": 3})
    for wrong in ({}, 3):
        with pytest.raises(libmpm.SceneError, match="expected names"):
            studies.sobol(wrong, 2, seed=1)
        with pytest.raises(libmpm.SceneError, match="expected names"):
            studies.full_factorial(wrong)


# Locks ----------------------------------------------------------------------------------------


def test_only_one_holds_a_lock(tmp_path):
    path = tmp_path / "lock"
    first = Lock.acquire(path)
    assert first is not None
    assert Lock.acquire(path) is None
    assert is_held(path)
    assert first.beat()
    first.release()
    assert not path.exists()
    assert not is_held(path)
    assert Lock.acquire(path) is not None


def test_many_threads_get_a_lock_one_at_a_time(tmp_path):
    inside, most = [], []

    def work():
        for _ in range(10):
            with locked(tmp_path / "lock"):
                inside.append(1)
                most.append(len(inside))
                inside.pop()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(most) == 40
    assert max(most) == 1
    assert list(tmp_path.iterdir()) == []


def test_the_lock_of_a_dead_process_is_taken_over_at_once(tmp_path):
    path = tmp_path / "lock"
    code = f"from libmpm._src.output.locks import *; import pathlib; print(Lock.acquire(pathlib.Path({str(path)!r})).token)"  # noqa: E501
    child = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert json.loads(path.read_text())["token"] == child.stdout.strip()
    assert not is_held(path)
    assert Observer(path).is_free()
    lock = Lock.acquire(path)
    assert lock is not None
    assert lock.beat()


def test_a_number_that_another_process_got_since_is_no_owner(tmp_path):
    path = tmp_path / "lock"
    lock = Lock.acquire(path)
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"started": "1"}))
    assert Observer(path).is_free()
    path.write_text(json.dumps(content))
    assert not Observer(path).is_free()
    lock.release()


def test_a_lock_from_elsewhere_is_stale_when_its_heartbeat_stood_still(tmp_path, monkeypatch):
    path = tmp_path / "lock"
    lock = Lock.acquire(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"place": "another machine"}))
    now = 1000.0
    monkeypatch.setattr(locks.clock, "monotonic", lambda: now)
    observer = Observer(path)
    for beat in range(3):
        assert not observer.is_free()
        now += 0.9 * locks.STALE
        os.utime(path, (beat, beat))
        assert not observer.is_free()
    now += 1.1 * locks.STALE
    assert observer.is_free()
    # A beat since the judgement saves it.
    os.utime(path, (50, 50))
    assert Lock.acquire(path, dead=observer.stamp) is None
    assert not observer.is_free()
    taken = Lock.acquire(path, dead=observer.stamp)
    assert taken is not None
    assert taken.token != lock.token
    assert not lock.beat()
    lock.release()
    assert taken.beat()


@pytest.mark.parametrize(
    "damaged", ["", '{"token": "a", "pla', "[]", '{"token": 3}', '{"pid": "x"}', "[" * 100_000]
)
def test_a_lock_that_names_nobody_is_stale_soon(tmp_path, monkeypatch, damaged):
    """What a crash of the machine leaves of a lock holds nobody up for two minutes."""
    path = tmp_path / "lock"
    path.write_text(damaged)
    now = 1000.0
    monkeypatch.setattr(locks.clock, "monotonic", lambda: now)
    observer = Observer(path)
    assert not observer.is_free()
    assert Lock.acquire(path) is None
    now += 1.1 * locks.UNSIGNED
    assert observer.is_free()
    lock = Lock.acquire(path, dead=observer.stamp)
    assert lock is not None
    assert lock.beat()


def test_a_full_disk_leaves_no_empty_lock(tmp_path):
    """The file that cannot be signed is taken back; the error names path and remedy."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
        with pytest.raises(libmpm.OutputError, match="lock: the file size limit"):
            Lock.acquire(tmp_path / "lock")
        resource.setrlimit(resource.RLIMIT_FSIZE, (10, before[1]))  # room for a part of it
        with pytest.raises(libmpm.OutputError, match="lock: the file size limit"):
            Lock.acquire(tmp_path / "lock")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []
    assert Lock.acquire(tmp_path / "lock") is not None


def test_who_waits_long_for_a_lock_says_for_whom(tmp_path, monkeypatch):
    monkeypatch.setattr(locks, "_PATIENCE", 0.05)
    lock = Lock.acquire(tmp_path / "lock")
    timer = threading.Timer(0.3, lock.release)
    timer.start()
    with (
        pytest.warns(UserWarning, match=f"waiting for .*lock, held by process {os.getpid()};"),
        locked(tmp_path / "lock"),
    ):
        pass
    timer.join()


def test_a_lock_that_was_taken_over_meanwhile_is_put_back(tmp_path):
    path = tmp_path / "lock"
    lock = Lock.acquire(path)
    locks._take_away(path, "the token of its dead predecessor")
    assert lock.beat()
    assert [p.name for p in tmp_path.iterdir()] == ["lock"]
