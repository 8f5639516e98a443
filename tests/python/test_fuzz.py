"""Whatever a file holds, the answer is a scene or a named error: broken scenes, arrays, files.

`pytest tests/python/test_fuzz.py --fuzz 20000 --fuzz-seed 7` tries more, and other ones. A failure
says which case of which seed it is, and what was fed in. Expected duration: 30 s.
"""

from __future__ import annotations

import functools
import io
import json
import random
import zipfile
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, shapes
from libmpm._src.checks import body_counts
from libmpm._src.cli import ExitCode, main
from libmpm.compat import claymore
from support import fuzz_scenes, fuzzing
from support.fuzz_scenes import SOLID, WATER

#: Scenes with no more particles and bytes than these are also run, for two steps.
SMALL = 2_000, 1 << 28

CLAYMORE = Path(__file__).parents[1] / "data" / "claymore"

#: Of the cases asked for, the parts (1 = all) that go to each kind of input.
SHARES = {"json": 0.5, "python": 0.2, "file": 0.1, "claymore": 0.08, "mesh": 0.06, "state": 0.06}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the files of scenes lie."""
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def documents(folder):
    """Name -> a valid scene file."""
    return fuzz_scenes.documents(folder)


@pytest.fixture
def cases(request):
    """A function that judges its share of the cases, and reports the first defect."""

    def run(kind, judge, make):
        count = max(1, round(SHARES[kind] * request.config.getoption("--fuzz")))
        seed = request.config.getoption("--fuzz-seed")
        found = {}
        for case in range(count):
            broken = make(f"{kind} {seed}", case)
            try:
                outcome = judge(broken)
            except (Exception, fuzzing.Hang) as error:
                small = fuzzing.smaller(broken, judge, type(error))
                raise AssertionError(
                    f"case {case} of {kind} inputs, --fuzz-seed {seed}: {type(error).__name__}: "
                    f"{error}\ndone: {'; '.join(small.said)}\n"
                    f"input: {fuzzing.shown(small.document)}"
                ) from error
            found[outcome] = found.get(outcome, 0) + 1
        return found

    return run


# What is judged ------------------------------------------------------------------------------


def judge_scene(broken):
    """Feed a document to `Scene.from_dict`, and use what comes out as far as it is accepted."""
    scene = fuzzing.answer(lambda: libmpm.Scene.from_dict(broken.document))
    if isinstance(scene, libmpm.Error):
        if broken.named:
            named = any(name in str(scene) for name in broken.named)
            assert named, f"{str(scene)!r} names none of {broken.named}"
        return "refused"
    assert not broken.refuse, "a number that is not finite was accepted"
    stored = fuzzing.answer(lambda: json.dumps(scene.to_dict(), allow_nan=False))
    again = fuzzing.answer(lambda: libmpm.Scene.from_dict(json.loads(stored)))
    assert again == scene, "the scene is another one when it is read again"
    if isinstance(fuzzing.answer(scene.validate), libmpm.Error):
        return "invalid"
    plan = fuzzing.answer(lambda: scene.plan(device="cpu", until=1.0, threads=1))
    if isinstance(plan, libmpm.Error):
        return "no plan"
    assert str(plan)
    if sum(body_counts(scene)) > SMALL[0] or plan.memory_total > SMALL[1]:
        return "too large to run"
    return judge_run(scene)


def _ones(count, frame):
    return [1.0] * count


def judge_run(scene):
    """Two steps give finite positions, or an error with a name."""
    own = [s for s in scene.sensors if isinstance(s.sensor, libmpm.sensors.Custom)]
    functions = {s.name: functools.partial(_ones, len(s.sensor.columns)) for s in own}

    def run():
        sim = libmpm.Simulation(scene, device="cpu", threads=1, functions=functions)
        sim.step(2)
        return {name: sim.particles[name]["position"] for name in sim.particles}

    found = fuzzing.answer(run)
    if isinstance(found, libmpm.Error):
        return "stopped"
    for name, position in found.items():
        assert np.isfinite(position).all(), f"body '{name}' has positions that are not finite"
    return "ran"


def judge_file(broken):
    """`Scene.load` and `libmpm check` agree on a file, and say whose fault it is."""
    path = broken.path
    scene = fuzzing.answer(lambda: libmpm.Scene.load(path))
    code = fuzzing.answer(lambda: main(["check", str(path)]))
    assert code in (ExitCode.DONE, ExitCode.INPUT)
    if isinstance(scene, libmpm.Error):
        assert code == ExitCode.INPUT
        return "refused"
    fuzzing.answer(lambda: json.dumps(scene.to_dict(), allow_nan=False))
    return "accepted"


def judge_claymore(broken):
    """A scene of ClaymoreUW is taken over as something that can be checked and written."""
    found = fuzzing.answer(lambda: claymore.load(broken.path, motion_folder=CLAYMORE))
    if isinstance(found, libmpm.Error):
        return "refused"
    assert fuzzing.answer(found.report)
    fuzzing.answer(lambda: json.dumps(found.run_file().to_dict(), allow_nan=False))
    return "accepted"


def judge_geometry(broken):
    """A file of triangles or points becomes a body, or a problem with its name."""

    def build():
        points = broken.path.suffix in fuzz_scenes.point_texts()
        d = 2 if points else 3
        scene = libmpm.Scene(dimension=d, cell_size=0.1, lower=(-1,) * d, upper=(1,) * d)
        file = str(broken.path)
        shape = shapes.PointFile(file=file, volume=0.1) if points else shapes.Mesh(file=file)
        law = libmpm.materials.FixedCorotated(**SOLID)
        scene.add_body(name="b", shape=shape, material=law)
        scene.validate()
        return scene

    found = fuzzing.answer(build)
    if isinstance(found, libmpm.Error):
        assert broken.path.name in str(found) or "body 'b'" in str(found)
        return "refused"
    return judge_run(found)


def judge_state(broken):
    """A checkpoint that is damaged is refused, or goes on with finite numbers."""

    def go_on():
        sim = libmpm.Simulation.resume(broken.path, device="cpu")
        sim.step(1)
        return sim.particles["w"]["position"]

    found = fuzzing.answer(go_on)
    if isinstance(found, libmpm.Error):
        return "refused"
    assert np.isfinite(found).all()
    fuzzing.answer(lambda: libmpm.Scene.from_checkpoint(broken.path))
    return "went on"


# What is fed in ------------------------------------------------------------------------------


def test_documents_have_every_kind_of_value_and_run(documents):
    """What the fuzzer breaks is whole, and no kind of value of the schema is missing from it."""
    schema = json.loads(
        (Path(__file__).parents[2] / "docs" / "schema" / "scene.schema.json").read_text()
    )
    named = {k for k, v in schema["$defs"].items() if "type" in v.get("properties", {})}
    assert named <= set().union(*map(fuzz_scenes.kinds_in, documents.values()))
    for document in documents.values():
        assert judge_scene(fuzzing.Broken(document, [])) == "ran"


@pytest.mark.parametrize("kind", ["json", "python"])
def test_scenes(kind, cases, documents):
    """Documents as files hold them, and as programs make them."""
    found = cases(
        kind,
        judge_scene,
        lambda seed, case: fuzzing.Breaker(documents, seed, case, kind == "json").broken(),
    )
    # A fuzzer whose every case is refused has stopped looking behind the first check.
    assert found["refused"] > found["ran"] > 0


def test_scene_files(cases, documents, tmp_path, capsys):
    def make(seed, case):
        rng = random.Random(f"{seed}:{case}")
        name = rng.choice(sorted(documents))
        document = documents[name] | {"run": {"until": 0.5, "debris": ["block"]}}
        if rng.random() < 0.3:
            document = fuzzing.Breaker({name: document}, seed, case, True).broken().document
        raw, said = fuzzing.broken_text(fuzzing.shown(document, 10**7), rng)
        return fuzzing.stored(raw, tmp_path / "scene.json", [f"document '{name}'", said])

    found = cases("file", judge_file, make)
    assert found["refused"] > 0
    out, err = capsys.readouterr()
    assert "Traceback" not in out + err


def test_scenes_of_claymore(cases, tmp_path):
    files = {p.name: json.loads(p.read_text()) for p in sorted(CLAYMORE.glob("*.json"))}

    def make(seed, case):
        rng = random.Random(f"{seed}:{case}")
        if rng.random() < 0.2:
            name = rng.choice(sorted(files))
            raw, said = fuzzing.broken_text(json.dumps(files[name]), rng)
            return fuzzing.stored(raw, tmp_path / "scene.json", [name, said])
        broken = fuzzing.Breaker(files, seed, case, True).broken()
        text = fuzzing.shown(broken.document, 10**7).encode()
        return fuzzing.stored(text, tmp_path / "scene.json", broken.said)

    cases("claymore", judge_claymore, make)


def test_meshes_and_points(cases, tmp_path):
    texts = fuzz_scenes.mesh_texts() | fuzz_scenes.point_texts()

    def make(seed, case):
        rng = random.Random(f"{seed}:{case}")
        ending = rng.choice(sorted(texts))
        raw, said = fuzzing.broken_text(texts[ending], rng)
        return fuzzing.stored(raw, tmp_path / f"shape{case}{ending}", [ending, said])

    cases("mesh", judge_geometry, make)


def small_tank():
    """Water of 20 particles between walls that let it slip."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81))
    scene.add_body(name="w", shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.1)), material=WATER)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="walls"))
    return scene


def test_checkpoints(cases, tmp_path):
    sim = libmpm.Simulation(small_tank(), device="cpu", threads=1)
    sim.step(3)
    sim.save_checkpoint(tmp_path / "whole.npz")
    whole = (tmp_path / "whole.npz").read_bytes()
    with np.load(io.BytesIO(whole)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays["header"].tobytes())
    # What a guard remembers is state like the arrays, which a checksum keeps whole.
    remembered = {key: header.pop(key) for key in ("watch", "arrays", "numbers") if key in header}

    def make(seed, case):
        rng = random.Random(f"{seed}:{case}")
        path = tmp_path / "state.npz"
        if rng.random() < 0.5:
            raw, said = fuzzing.broken_bytes(whole, rng)
            return fuzzing.stored(raw, path, [said])
        changed = dict(arrays)
        if rng.random() < 0.5:
            broken = fuzzing.Breaker({"header": header}, seed, case, True).broken()
            text = fuzzing.shown(broken.document | remembered, 10**7).encode()
            changed["header"] = np.frombuffer(text, np.uint8)
            said = broken.said
        else:
            said = [fuzzing.spoil(changed, rng)]
        file = io.BytesIO()
        np.savez(file, **changed)
        return fuzzing.stored(file.getvalue(), path, said)

    found = cases("state", judge_state, make)
    assert found["refused"] > 0
    assert zipfile.is_zipfile(tmp_path / "whole.npz")


@pytest.mark.parametrize("name", fuzz_scenes.given_arrays())
def test_initial_arrays(name):
    """An array is taken with its values, or refused by a message that names it."""
    array = fuzz_scenes.given_arrays()[name]
    sim = libmpm.Simulation(small_tank(), device="cpu", threads=1)

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
