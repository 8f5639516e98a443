"""Strokes of wave makers, by formula and from files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from libmpm import SceneError
from libmpm.boundaries import piston_stroke, stroke_from_file


def paddle(count: int = 2400, rate: float = 1200.0) -> np.ndarray:
    """Rows of time, position and velocity of an error-function stroke."""
    t = np.arange(count) / rate
    z = 4.0 * (t - 1.0)
    x = 0.5 * (1 + np.array([math.erf(a) for a in z]))
    return np.stack([t, x, 4.0 / math.sqrt(math.pi) * np.exp(-z * z)], axis=1)


def write(path: Path, rows: np.ndarray, head: str = "") -> Path:
    np.savetxt(path, rows, delimiter=",", header=head, comments="")
    return path


def test_stroke_of_the_large_flume() -> None:
    """Places and the greatest speed, 0.4514 m/s, as published for A = 4 m, k = 0.2 1/s."""
    table = piston_stroke(4.0, 0.2, 9.9303, until=40.0)
    time, place = table.arrays()
    assert time[-1] == pytest.approx(40.0)
    assert place[:, 1].tolist() == [0.0] * len(time)
    assert place[0, 0] == pytest.approx(0.00995, abs=5e-6)
    assert table.at(9.9303)[0] == pytest.approx(2.0, abs=1e-6)
    assert np.diff(place[:, 0]).max() / np.diff(time).max() == pytest.approx(0.4514, rel=1e-3)


def test_stroke_goes_along_its_direction() -> None:
    table = piston_stroke(1.0, 2.0, 1.0, 3.0, dt=0.01, direction=(0, -3, 4))
    assert table.at(3.0) == pytest.approx([0, -0.6, 0.8], abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 0.0}, "rate is 0"),
        ({"amplitude": math.nan}, "amplitude is nan"),
        ({"direction": (0, 0)}, "direction has no length"),
        ({"dt": 0.0}, "dt is 0"),
    ],
)
def test_strokes_that_are_none(change: dict, message: str) -> None:
    arguments = {"amplitude": 1.0, "rate": 1.0, "delay": 1.0, "until": 2.0}
    with pytest.raises(SceneError, match=message):
        piston_stroke(**(arguments | change))


def test_file_is_read_in_its_order(tmp_path: Path) -> None:
    rows = paddle()
    for given, head in ((rows, ""), (rows, "time,x,v"), (rows[:, :2], "")):
        time, place = stroke_from_file(write(tmp_path / "a.csv", given, head)).arrays()
        assert np.array_equal(time, rows[:, 0])
        assert np.array_equal(place[:, 0], rows[:, 1])
    swapped = write(tmp_path / "b.csv", rows[:, [0, 2, 1]])
    table = stroke_from_file(swapped, columns=("time", "velocity", "position"))
    assert np.array_equal(table.arrays()[1][:, 0], rows[:, 1])


def test_run_may_begin_and_end_within_the_file(tmp_path: Path) -> None:
    rows = paddle()
    table = stroke_from_file(write(tmp_path / "a.csv", rows), start=0.75, until=0.5)
    time, place = table.arrays()
    assert time[0] <= 0 < time[1]
    assert time[-2] < 0.5 <= time[-1]
    for t in (0.0, 0.25, 0.5):
        assert table.at(t)[0] == pytest.approx(np.interp(t + 0.75, rows[:, 0], rows[:, 1]))
    assert place.shape == (len(time), 2)


def test_columns_the_other_way_about_are_found_out(tmp_path: Path) -> None:
    rows = paddle()
    with pytest.raises(SceneError, match="columns are swapped"):
        stroke_from_file(write(tmp_path / "a.csv", rows[:, [0, 2, 1]]))
    wrong = rows * (1, 1, 1.2)
    with pytest.raises(SceneError, match="misses the velocities by 1"):
        stroke_from_file(write(tmp_path / "b.csv", wrong))


def test_files_that_are_no_strokes(tmp_path: Path) -> None:
    rows = paddle(20)
    with pytest.raises(SceneError, match="cannot be read"):
        stroke_from_file(tmp_path / "none.csv")
    with pytest.raises(SceneError, match="expected two rows or more"):
        stroke_from_file(write(tmp_path / "a.csv", rows[:, :1]))
    rows[7, 0] = rows[6, 0]
    with pytest.raises(SceneError, match="the time of row 8"):
        stroke_from_file(write(tmp_path / "b.csv", rows))
    rows[7] = np.nan
    with pytest.raises(SceneError, match="row 8 has gaps"):
        stroke_from_file(write(tmp_path / "c.csv", rows))
    with pytest.raises(SceneError, match="before start"):
        stroke_from_file(write(tmp_path / "d.csv", paddle(20)), start=5.0, until=1.0)
