"""Whatever a file holds, the answer is a scene or a named error: broken scenes, arrays, files.

`pytest tests/python/test_fuzz.py --fuzz 20000 --fuzz-seed 7` tries more, and other ones. A failure
says which case of which seed it is, and what was fed in. Expected duration: 30 s.
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

import libmpm
from support import fuzz_readers, fuzz_scenes, fuzzing
from support.fuzz_readers import KINDS

#: Of the cases asked for, the parts (1 = all) that go to each kind of input.
SHARES = {
    "json": 0.5, "python": 0.2, "file": 0.1, "claymore": 0.06, "motion": 0.02, "mesh": 0.06,
    "state": 0.06,
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the files of scenes lie."""
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def documents(folder):
    """Name -> a valid scene file."""
    return fuzz_scenes.documents(folder)


@pytest.fixture
def cases(request, documents, tmp_path):
    """A function that judges its share of the cases, and reports the first defect."""

    def run(name, kind=None):
        kind = kind or KINDS[name]
        count = max(1, round(SHARES[name] * request.config.getoption("--fuzz")))
        seed = request.config.getoption("--fuzz-seed")
        found = {}
        for case in range(count):
            broken = kind.make(documents, f"{name} {seed}", case, tmp_path)
            try:
                outcome = kind.judge(broken)
            except (Exception, fuzzing.Hang) as error:
                small = fuzzing.smaller(broken, kind.judge, type(error))
                raise AssertionError(
                    f"case {case} of {name} inputs, --fuzz-seed {seed}: {type(error).__name__}: "
                    f"{error}\ndone: {'; '.join(small.said)}\n"
                    f"input: {fuzzing.shown(small.document)}"
                ) from error
            found[outcome] = found.get(outcome, 0) + 1
        return found

    return run


# What is fed in ------------------------------------------------------------------------------


def test_documents_have_every_kind_of_value_and_run(documents):
    """What the fuzzer breaks is whole, and no kind of value of the schema is missing from it."""
    schema = json.loads(
        (Path(__file__).parents[2] / "docs" / "schema" / "scene.schema.json").read_text()
    )
    named = {k for k, v in schema["$defs"].items() if "type" in v.get("properties", {})}
    assert named <= set().union(*map(fuzz_scenes.kinds_in, documents.values()))
    for document in documents.values():
        assert fuzz_readers.judge_scene(fuzzing.Broken(document, [])) == "ran"


@pytest.mark.parametrize("kind", ["json", "python"])
def test_scenes(kind, cases):
    """Documents as files hold them, and as programs make them."""
    found = cases(kind)
    # A fuzzer whose every case is refused has stopped looking behind the first check.
    assert found["refused"] > found["ran"] > 0


def test_scene_files(cases, capsys):
    assert cases("file")["refused"] > 0
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err


@pytest.mark.parametrize("kind", ["claymore", "motion", "mesh"])
def test_scenes_of_claymore_their_motions_and_meshes(kind, cases):
    assert cases(kind)["refused"] > 0


def test_checkpoints(cases, tmp_path):
    whole = tmp_path / "whole.npz"
    fuzz_readers.save_small_tank(whole)

    def make(_, seed, case, folder):
        return fuzz_readers.make_state(whole, seed, case, folder)

    found = cases("state", fuzz_readers.Kind(make, fuzz_readers.judge_state))
    assert found["refused"] > 0
    assert zipfile.is_zipfile(whole)


@pytest.mark.parametrize("name", fuzz_scenes.given_arrays())
def test_initial_arrays(name):
    """An array is taken with its values, or refused by a message that names it."""
    array = fuzz_scenes.given_arrays()[name]
    sim = libmpm.Simulation(fuzz_readers.small_tank(), device="cpu", threads=1)

    def give():
        sim.particles["w"]["velocity"] = array
        sim.step(2)
        return sim.particles["w"]["velocity"]

    found = fuzzing.answer(give)
    if isinstance(found, libmpm.Error):
        assert "velocity" in str(found)
    else:
        assert np.shape(array) == (20, 2)
        assert np.isfinite(np.asarray(array, dtype=float)).all()
        assert np.isfinite(found).all()
