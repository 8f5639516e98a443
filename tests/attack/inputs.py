"""Broken inputs for every reader: each is taken, or refused by a `libmpm.Error`."""

from __future__ import annotations

import base64
import contextlib
import functools
import json
import math
import os
import pickle
import random
import shutil
import warnings
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

import libmpm
from attack.base import Attack
from libmpm import studies
from libmpm._src.cli.commands import ExitCode, main
from libmpm._src.output.export import FORMATS
from libmpm._src.output.locks import Lock, Observer, held_by, is_held
from support import fuzz_readers, fuzz_scenes, fuzzing
from support.fuzz_readers import KINDS, Kind
from support.fuzzing import Broken, broken_bytes, broken_text, stored

__all__ = ["Inputs", "small_run"]

#: Intervals of what a small run writes, s.
SETTINGS = {"frame_interval": 0.01, "checkpoint_interval": 0.02}

#: Of so many damaged folders one is also used by the commands and run on in; on the way to the aims
#: fewer are, and the outcomes tell them apart.
_DEAR = int(os.environ.get("ATTACK_DEAR", "1"))


def small_run(folder: Path, **changes: Any) -> None:
    """Leave the folder of a small run, with frames, checkpoints and samples."""
    output = libmpm.Output(folder, **(SETTINGS | changes))
    scene = fuzz_readers.small_tank()
    with libmpm.Simulation(scene, device="cpu", threads=1, output=output) as sim:
        sim.run(until=0.05, progress=False)


def _tank(gravity: float) -> libmpm.Scene:
    document = fuzz_readers.small_tank().to_dict()
    return libmpm.Scene.from_dict(document | {"gravity": [0.0, -gravity]})


def small_study(folder: Path, rows: int = 2) -> libmpm.Study:
    """Return a study of small cases with a response."""
    return libmpm.Study(
        folder, _tank, [{"gravity": 1.0 + i} for i in range(rows)], until=0.01,
        response=lambda case: {"samples": len(case.sensors["load"])},
    )  # fmt: skip


def command(*arguments: Any) -> int:
    """Run the command line; anything but an exit code it promises is a defect."""
    code = fuzzing.answer(lambda: main([str(a) for a in arguments]), also=(SystemExit,))
    assert isinstance(code, int), f"ended by {code!r}"
    assert code != ExitCode.UNEXPECTED, "ended by an error that has no exit code"
    return int(code)


class Inputs(Attack):
    """Broken files and values for every reader of the package."""

    name = "inputs"
    what = "broken files and values for every reader"
    unit = "inputs"
    share = 3.0
    limit = 200.0
    batch = 100

    #: Reader -> its part of the cases.
    PARTS: ClassVar[dict[str, float]] = {
        "json": 6, "python": 3, "file": 1, "claymore": 1, "motion": 0.5, "mesh": 1, "state": 1,
        "frame": 1, "sensors": 1, "study": 1, "lock": 0.5, "log": 1, "scene": 0.5,
    }  # fmt: skip

    def prepare(self) -> None:
        """Make documents, a checkpoint, a run and a study."""
        folder = self.folder
        (folder / "documents.json").write_text(json.dumps(fuzz_scenes.documents(folder)))
        fuzz_readers.save_small_tank(folder / "whole.npz")
        small_run(folder / "run")
        study = small_study(folder / "study").run(workers=0, device="cpu", progress=False)
        assert not study.failed, str(study)

    def open(self) -> None:
        """Read the documents, and name the kinds of input."""
        folder = self.folder
        self.documents = json.loads((folder / "documents.json").read_text())
        _warm(self.documents)
        runs = {
            "frame": ("run/frames/*.vtkhdf*", self._judge_run),
            "sensors": ("run/sensors.h5", self._judge_run),
            "log": ("run/log.json", self._judge_run),
            "scene": ("run/scene.json", self._judge_run),
            "study": ("study/**/*.json", self._judge_study),
        }
        self.kinds = KINDS | {
            "state": Kind(self._make_state, fuzz_readers.judge_state),
            "lock": Kind(_make_lock, _judge_lock),
        }
        for name, (pattern, judge) in runs.items():
            self.kinds[name] = Kind(functools.partial(self._make_damage, pattern=pattern), judge)

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Break one input, keep it, and judge what libmpm makes of it."""
        rng = self.rng(seed, number)
        name = rng.choices(list(self.PARTS), list(self.PARTS.values()))[0]
        broken = self.kinds[name].make(self.documents, f"{name} {seed}", number, room)
        self.note(room, kind=name, **_kept(broken, room))
        return {f"{name}: {self.kinds[name].judge(broken)}": 1}

    def replay(self, kept: Mapping[str, Any], room: Path) -> Mapping[str, int]:
        """Judge the input that was kept, not one that is made again."""
        if "input" not in kept:  # the attack had failed before there was one
            (room / "again").mkdir()
            return self.case(kept["seed"], kept["number"], room / "again")
        broken: Broken = pickle.loads(base64.b64decode(kept["input"]))
        if broken.path != Path():
            broken.path = room / broken.path
        return {f"{kept['kind']}: {self.kinds[kept['kind']].judge(broken)}": 1}

    # Files of a run or study --------------------------------------------------------------------

    def _make_state(self, _: Any, seed: str, case: int, room: Path) -> Broken:
        return fuzz_readers.make_state(self.folder / "whole.npz", seed, case, room)

    def _make_damage(self, _: Any, seed: str, case: int, room: Path, pattern: str) -> Broken:
        """Break one file of a copy of a folder."""
        rng = random.Random(f"{seed}:{case}")
        root = pattern.split("/")[0]
        shutil.copytree(self.folder / root, room / root)
        files = sorted(p for p in room.glob(pattern) if p.is_file())
        path = rng.choice(files)
        said = [str(path.relative_to(room))]
        raw = path.read_bytes()
        text = path.suffix in (".json", ".series")
        if text and rng.random() < 0.6:
            document = {path.name: json.loads(raw)}
            broken = fuzzing.Breaker(document, seed, case, True).broken()
            raw, done = fuzzing.shown(broken.document, 10**7).encode(), "; ".join(broken.said)
        elif text:
            raw, done = broken_text(raw.decode(), rng)
        else:
            raw, done = broken_bytes(raw, rng)
        stored(raw, path, [])
        return Broken(None, [*said, done], path=room / root)

    def _judge_run(self, broken: Broken) -> str:
        """Everything that reads the folder of a run ends well, and a run goes on in it or not."""
        folder = broken.path
        dear, codes = _dear(broken), []
        if dear:
            codes.append(command("info", folder))
            made = folder.with_name("exported")
            to = FORMATS[len("".join(broken.said)) % len(FORMATS)]
            codes.append(command("export", folder, "--to", to, "-o", made))
        found = fuzzing.answer(lambda: libmpm.load(folder))
        if not isinstance(found, libmpm.Error):
            for series in _tried(lambda: dict(found.sensors)).values():
                assert np.ndim(series.time) == 1
            for frames in _tried(lambda: dict(found.frames)).values():
                _tried(lambda one=frames: [f["position"] for f in one])
        if not dear:
            return "refused" if isinstance(found, libmpm.Error) else "read"
        again = fuzzing.answer(lambda: _go_on(folder))
        return f"{codes.count(ExitCode.DONE)} of 2 read, " + (
            "refused to go on" if isinstance(again, libmpm.Error) else "went on"
        )

    def _judge_study(self, broken: Broken) -> str:
        """Status, table and another run of a study with a damaged file."""
        folder = broken.path
        opened = fuzzing.answer(lambda: studies.Study.open(folder))
        if isinstance(opened, libmpm.Error):
            assert "study.json" in str(opened)
        else:
            fuzzing.answer(lambda: str(opened.status()))
            fuzzing.answer(lambda: str(opened.collect()))
        if not _dear(broken):
            return "refused" if isinstance(opened, libmpm.Error) else "read"
        run = fuzzing.answer(
            lambda: small_study(folder, 1).run(workers=0, device="cpu", progress=False)
        )
        if isinstance(run, libmpm.Error):
            return "refused"
        assert run["status"].tolist() == ["finished"], str(run)
        return "read" if not isinstance(opened, libmpm.Error) else "run again"


def _warm(documents: Mapping[str, Any]) -> None:
    """Judge the whole documents, so that forks have what is kept of shapes that a case leaves."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for document in documents.values():
            with contextlib.suppress(libmpm.Error):
                libmpm.Scene.from_dict(document).validate()


def _dear(broken: Broken) -> bool:
    """Tell whether a case also runs commands and goes on: seconds, where reading takes little."""
    return zlib.crc32("".join(broken.said).encode(errors="replace")) % _DEAR == 0


def _go_on(folder: Path) -> None:
    output = libmpm.Output(folder, **SETTINGS)
    with libmpm.Simulation.resume(folder, output=output) as sim:
        sim.run(until=0.06, progress=False)
        for view in sim.particles.values():
            assert np.isfinite(view["position"]).all()


def _tried(call: Callable[[], Any]) -> Any:
    """Return what a reader gives; nothing where it refuses by name."""
    found = fuzzing.answer(call)
    return {} if isinstance(found, libmpm.Error) else found


def _kept(broken: Broken, room: Path) -> dict[str, Any]:
    """Return what `Inputs.replay` and people need of an input."""
    path = broken.path
    if path != Path():
        broken.path = path.relative_to(room)
    kept: dict[str, Any] = {"said": broken.said}
    # Iterators and the like have no copy: such a case is made again from its number.
    with contextlib.suppress(Exception):
        kept["input"] = base64.b64encode(pickle.dumps(broken)).decode()
    broken.path = path
    if broken.document is not None and not broken.deep:
        (room / "document.json").write_text(fuzzing.shown(broken.document, 10**6), errors="replace")
    return kept


_LOCK = {"token": "a" * 32, "place": "elsewhere", "pid": 1, "started": "1", "host": "other"}


def _make_lock(_: Any, seed: str, case: int, room: Path) -> Broken:
    """A lock file of another process, or what a crash has left of one."""
    rng = random.Random(f"{seed}:{case}")
    document = _LOCK | {"pid": rng.choice((1, os.getpid(), 10**9, -1))}
    if rng.random() < 0.5:
        broken = fuzzing.Breaker({"lock": document}, seed, case, True).broken()
        raw, said = fuzzing.shown(broken.document, 10**7).encode(), broken.said
    else:
        raw, done = broken_text(json.dumps(document), rng)
        said = [done]
    return stored(raw, room / "lock", said)


def _judge_lock(broken: Broken) -> str:
    """A damaged lock is held or free, and is taken over once it is known to be dead."""
    path = broken.path
    observer = Observer(path)
    free = fuzzing.answer(observer.is_free)
    assert isinstance(free, bool)
    assert isinstance(fuzzing.answer(lambda: is_held(path)), bool)
    assert isinstance(fuzzing.answer(lambda: held_by(path)), str)
    observer._seen = -math.inf
    assert fuzzing.answer(observer.is_free), "it is never free"
    lock = fuzzing.answer(lambda: Lock.acquire(path, dead=observer.stamp))
    assert isinstance(lock, Lock), f"it cannot be taken over: {lock!r}"
    assert lock.beat()
    lock.release()
    assert not path.exists()
    return "free" if free else "held, taken over"
