"""Tables of time."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import libmpm
from libmpm import TimeTable


def test_linear_between_rows_and_first_value_before() -> None:
    table = TimeTable([1.0, 2.0], [[0.0, 10.0], [4.0, 20.0]])
    np.testing.assert_array_equal(table.at(1.25), [1.0, 12.5])
    np.testing.assert_array_equal(table.at(-5.0), [0.0, 10.0])


@pytest.mark.parametrize(("end", "value"), [("hold", 4.0), ("repeat", 1.0), ("zero", 0.0)])
def test_end_policies(end: str, value: float) -> None:
    assert TimeTable([0.0, 2.0], [0.0, 4.0], end=end).at(2.5) == value


def test_repeat_has_period_of_the_table() -> None:
    table = TimeTable([1.0, 3.0], [0.0, 2.0], "repeat")
    assert table.at(1.5 + 7 * 2.0) == pytest.approx(0.5)


def test_sample_reaches_until() -> None:
    table = TimeTable.sample(math.sin, 0.1, 0.3)
    assert len(table.time) == 4
    assert table.time[-1] == pytest.approx(0.3)
    assert table.value[2] == math.sin(0.2)
    vectors = TimeTable.sample(lambda t: (t, 2 * t), dt=0.5, until=1.2)
    assert vectors.components == 2
    assert vectors.time == (0.0, 0.5, 1.0, 1.5)


def test_value_semantics() -> None:
    a = TimeTable(np.array([0.0, 1.0]), np.array([[1.0, 2.0], [3.0, 4.0]]))
    b = TimeTable(time=[0, 1], value=[(1, 2), (3, 4)])
    assert a == b
    assert hash(a) == hash(b)
    assert pickle.loads(pickle.dumps(a)) == a
    assert TimeTable.from_dict(a.to_dict()) == a
    with pytest.raises(AttributeError):
        a.end = "zero"


@pytest.mark.parametrize(
    ("time", "value", "end", "words"),
    [
        ([0.0, 0.0], [1.0, 2.0], "hold", "time[1] is 0 after 0; expected strictly increasing"),
        ([0.0, 1.0], [1.0], "hold", "value has 1 rows, time has 2"),
        ([0.0], [1.0], "repeat", "end is 'repeat' with one row"),
        ([0.0, math.nan], [1.0, 2.0], "hold", "not finite"),
        ([], [], "hold", "n ≥ 1"),
        ([0.0, 1.0], [[1.0], [1.0, 2.0]], "hold", "regular table"),
        ([0.0], [1.0], "hodl", "did you mean 'hold'?"),
    ],
)
def test_refuses(time: list[float], value: list[float], end: str, words: str) -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        TimeTable(time, value, end)
    assert any(words in p for p in caught.value.problems)


def test_all_problems_at_once() -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        TimeTable([1.0, 0.0], [1.0], "never")
    assert len(caught.value.problems) == 3


@pytest.mark.parametrize("function", [len, lambda t: "x", lambda t: 1 / t, lambda t: {1: 2}])
def test_functions_that_give_no_numbers_are_named(function):
    with pytest.raises(libmpm.SceneError, match=r"TimeTable.sample: function\(0\) gives"):
        TimeTable.sample(function, dt=0.1, until=1.0)
