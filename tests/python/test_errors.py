"""The exceptions, as scripts and the compiled modules use them."""

from __future__ import annotations

import pickle

import pytest

import libmpm


def test_one_problem_is_the_message() -> None:
    error = libmpm.SceneError("body 'a': wrong")
    assert error.problems == ["body 'a': wrong"]
    assert str(error) == "body 'a': wrong"


def test_several_problems_are_numbered() -> None:
    error = libmpm.SceneError(["first", "second"])
    assert str(error) == "2 problems:\n  1. first\n  2. second"


def test_problems_survive_pickling() -> None:
    error = libmpm.SceneError(["first", "second"])
    assert pickle.loads(pickle.dumps(error)).problems == error.problems


KINDS = ["SceneError", "DeviceError", "CapacityError", "NumericalError"]


@pytest.mark.parametrize("name", [*KINDS, "OutputError", "CheckpointError"])
def test_one_base_and_plain_text(name: str) -> None:
    kind = getattr(libmpm, name)
    assert issubclass(kind, libmpm.Error)
    assert str(kind("some text")) == "some text"


def test_standard_bases() -> None:
    assert issubclass(libmpm.OutputError, OSError)
    assert issubclass(libmpm.SceneError, ValueError)
    assert issubclass(libmpm.CapacityError, MemoryError)
