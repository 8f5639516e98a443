"""What the fuzzers feed to the readers of scenes, shapes and checkpoints, and how they judge them.

A case is made by `make(seed, case, folder)` and judged by `judge(broken)`, which returns the
outcome in a word and raises for a defect.
"""

from __future__ import annotations

import functools
import io
import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import libmpm
from libmpm import boundaries, shapes
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.scene.places import body_counts
from libmpm.compat import claymore
from support import fuzz_scenes, fuzzing
from support.fuzz_scenes import SOLID, WATER
from support.fuzzing import Broken

__all__ = ["KINDS", "Kind", "judge_run", "judge_scene", "save_small_tank", "small_tank"]

#: Scenes with no more particles and bytes than these are also run, for two steps.
SMALL = 2_000, 1 << 28

CLAYMORE = Path(__file__).parents[1] / "data" / "claymore"


@dataclass(frozen=True)
class Kind:
    """One reader: how its inputs are made and judged.

    `make` takes the documents of valid scenes, a seed, the number of the case, and a folder.
    """

    make: Callable[[dict[str, Any], str, int, Path], Broken]
    judge: Callable[[Broken], str]


# Scenes as documents ------------------------------------------------------------------------------


def _make_document(
    documents: dict[str, Any], seed: str, case: int, folder: Path, *, plain: bool
) -> Broken:
    return fuzzing.Breaker(documents, seed, case, plain).broken()


def judge_scene(broken: Broken) -> str:
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


def _ones(count: int, frame: Any) -> list[float]:
    return [1.0] * count


def judge_run(scene: libmpm.Scene) -> str:
    """Two steps give finite positions, or an error with a name."""
    own = [s for s in scene.sensors if isinstance(s.sensor, libmpm.sensors.Custom)]
    functions = {s.name: functools.partial(_ones, len(s.sensor.columns)) for s in own}

    def run() -> dict[str, Any]:
        sim = libmpm.Simulation(scene, device="cpu", threads=1, functions=functions)
        sim.step(2)
        return {name: sim.particles[name]["position"] for name in sim.particles}

    found = fuzzing.answer(run)
    if isinstance(found, libmpm.Error):
        return "stopped"
    for name, position in found.items():
        assert np.isfinite(position).all(), f"body '{name}' has positions that are not finite"
    return "ran"


# Files of scenes ----------------------------------------------------------------------------------


def _make_file(documents: dict[str, Any], seed: str, case: int, folder: Path) -> Broken:
    rng = random.Random(f"{seed}:{case}")
    name = rng.choice(sorted(documents))
    document = documents[name] | {"run": {"until": 0.5, "debris": ["block"]}}
    if rng.random() < 0.3:
        document = fuzzing.Breaker({name: document}, seed, case, True).broken().document
    raw, said = fuzzing.broken_text(fuzzing.shown(document, 10**7), rng)
    return fuzzing.stored(raw, folder / "scene.json", [f"document '{name}'", said])


def _judge_file(broken: Broken) -> str:
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


@functools.lru_cache(maxsize=1)
def _claymore_documents() -> dict[str, Any]:
    return {p.name: json.loads(p.read_text()) for p in sorted(CLAYMORE.glob("*.json"))}


def _make_claymore(documents: dict[str, Any], seed: str, case: int, folder: Path) -> Broken:
    files = _claymore_documents()
    rng = random.Random(f"{seed}:{case}")
    if rng.random() < 0.2:
        name = rng.choice(sorted(files))
        raw, said = fuzzing.broken_text(json.dumps(files[name]), rng)
        return fuzzing.stored(raw, folder / "scene.json", [name, said])
    broken = fuzzing.Breaker(files, seed, case, True).broken()
    text = fuzzing.shown(broken.document, 10**7).encode()
    return fuzzing.stored(text, folder / "scene.json", broken.said)


def _judge_claymore(broken: Broken, motions: Path = CLAYMORE) -> str:
    """A scene of ClaymoreUW is taken over as something that can be checked and written."""
    found = fuzzing.answer(lambda: claymore.load(broken.path, motion_folder=motions))
    if isinstance(found, libmpm.Error):
        return "refused"
    assert fuzzing.answer(found.report)
    fuzzing.answer(lambda: json.dumps(found.run_file().to_dict(), allow_nan=False))
    return "accepted"


def _make_motion(documents: dict[str, Any], seed: str, case: int, folder: Path) -> Broken:
    rng = random.Random(f"{seed}:{case}")
    raw, said = fuzzing.broken_text((CLAYMORE / "stroke.csv").read_text(), rng)
    return fuzzing.stored(raw, folder / "stroke.csv", ["motion of a wave maker", said])


def _judge_motion(broken: Broken) -> str:
    """The table of a paddle's motion, in the folder that a whole scene names."""
    whole = fuzzing.Broken(None, [], path=CLAYMORE / "workflow.json")
    return _judge_claymore(whole, broken.path.parent)


# Shapes -------------------------------------------------------------------------------------------


def _make_shape(documents: dict[str, Any], seed: str, case: int, folder: Path) -> Broken:
    texts = fuzz_scenes.mesh_texts() | fuzz_scenes.point_texts()
    rng = random.Random(f"{seed}:{case}")
    ending = rng.choice(sorted(texts))
    raw, said = fuzzing.broken_text(texts[ending], rng)
    return fuzzing.stored(raw, folder / f"shape{case}{ending}", [ending, said])


def _judge_shape(broken: Broken) -> str:
    """A file of triangles or points becomes a body, or a problem with its name."""

    def build() -> libmpm.Scene:
        points = broken.path.suffix in fuzz_scenes.point_texts()
        d = 2 if points else 3
        scene = libmpm.Scene(dimension=d, cell_size=0.1, lower=(-1,) * d, upper=(1,) * d)
        file = str(broken.path)
        shape = shapes.PointFile(file=file, volume=0.1) if points else shapes.SurfaceMesh(file=file)
        law = libmpm.materials.FixedCorotated(**SOLID)
        scene.add_body(name="b", shape=shape, material=law)
        scene.validate()
        return scene

    found = fuzzing.answer(build)
    if isinstance(found, libmpm.Error):
        assert broken.path.name in str(found) or "body 'b'" in str(found)
        return "refused"
    return judge_run(found)


# Checkpoints --------------------------------------------------------------------------------------


def small_tank() -> libmpm.Scene:
    """Water of 20 particles between walls that let it slip."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81))
    scene.add_body(name="w", shape=shapes.Box(lower=(0, 0), upper=(0.5, 0.1)), material=WATER)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    scene.add_sensor(name="load", sensor=libmpm.sensors.LoadCell(boundary="walls"))
    return scene


def save_small_tank(path: Path) -> None:
    """Write the checkpoint that cases of the kind "state" break."""
    sim = libmpm.Simulation(small_tank(), device="cpu", threads=1)
    sim.step(3)
    sim.save_checkpoint(path)


@functools.lru_cache(maxsize=2)
def _checkpoint(path: Path) -> tuple[bytes, dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return a checkpoint's bytes, arrays, header, and what of the header is left as it is."""
    whole = path.read_bytes()
    with np.load(io.BytesIO(whole)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays["header"].tobytes())
    # What a guard remembers is state like the arrays, which a checksum keeps whole.
    kept = {key: header.pop(key) for key in ("watch", "arrays", "numbers") if key in header}
    return whole, arrays, header, kept


def make_state(whole: Path, seed: str, case: int, folder: Path) -> Broken:
    """Break a checkpoint: its bytes, its header, or the shapes of its arrays."""
    raw, arrays, header, kept = _checkpoint(whole)
    rng = random.Random(f"{seed}:{case}")
    path = folder / "state.npz"
    if rng.random() < 0.5:
        raw, said = fuzzing.broken_bytes(raw, rng)
        return fuzzing.stored(raw, path, [said])
    changed = dict(arrays)
    if rng.random() < 0.5:
        broken = fuzzing.Breaker({"header": header}, seed, case, True).broken()
        text = fuzzing.shown(broken.document | kept, 10**7).encode()
        changed["header"] = np.frombuffer(text, np.uint8)
        done = broken.said
    else:
        done = [fuzzing.spoil(changed, rng)]
    file = io.BytesIO()
    np.savez(file, **changed)
    return fuzzing.stored(file.getvalue(), path, done)


def judge_state(broken: Broken) -> str:
    """A checkpoint that is damaged is refused, or goes on with finite numbers."""

    def go_on() -> Any:
        sim = libmpm.Simulation.resume(broken.path, device="cpu")
        sim.step(1)
        # The scene's own names: one that was changed may be another good one.
        return [np.asarray(view["position"]) for view in sim.particles.values()]

    found = fuzzing.answer(go_on)
    if isinstance(found, libmpm.Error):
        return "refused"
    assert all(np.isfinite(position).all() for position in found)
    fuzzing.answer(lambda: libmpm.Scene.from_checkpoint(broken.path))
    return "went on"


#: Name of a reader -> its kind of input.
KINDS = {
    "json": Kind(functools.partial(_make_document, plain=True), judge_scene),
    "python": Kind(functools.partial(_make_document, plain=False), judge_scene),
    "file": Kind(_make_file, _judge_file),
    "claymore": Kind(_make_claymore, _judge_claymore),
    "motion": Kind(_make_motion, _judge_motion),
    "mesh": Kind(_make_shape, _judge_shape),
}
