"""Odd arguments for every public constructor and function, and damaged files for small readers."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import libmpm
from attack.base import Attack
from libmpm import boundaries, debris, grids, shapes
from libmpm._src.advice.atlas import parse, read_atlas
from libmpm._src.advice.tradeoff.result import TradeOff
from libmpm._src.studies.study.command import load_study
from support import fuzz_scenes, fuzz_values, fuzzing

__all__ = ["Values"]

#: Part of the cases that are calls with odd arguments.
_CALLS = 0.7

_ESRI = (
    "ncols 3\nnrows 2\nxllcorner 0.0\nyllcorner 0.0\ncellsize 0.5\nNODATA_value -9999\n"
    "1 2 3\n4 5 6\n"
)
_STROKE = "time,position,velocity\n" + "".join(
    f"{0.1 * i:.1f},{0.02 * i:.2f},0.2\n" for i in range(20)
)
_OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"
_SCRIPT = """import libmpm

def make(a):
    pass

def study(folder):
    return libmpm.Study(folder, make, [{'a': 1}], until=1)
"""


def _field() -> str:
    law = libmpm.materials.FixedCorotated(**fuzz_scenes.SOLID)
    kind = debris.Prototype(name="box", length=0.2, width=0.1, height=0.1, material=law)
    made = debris.ordered(kind, rows=2, columns=2, clearance=0.1)
    return json.dumps(made.to_dict())


class Values(Attack):
    """Odd arguments and damaged small files, thousands a minute."""

    name = "values"
    what = "odd arguments of public calls, damaged grids, strokes, meshes, fields, atlases, scripts"
    unit = "values"
    share = 2.0
    limit = 150.0
    batch = 500

    def prepare(self) -> None:
        """Write what arguments are found in."""
        documents = fuzz_scenes.documents(self.folder)
        (self.folder / "documents.json").write_text(json.dumps(documents))

    def open(self) -> None:
        """Find arguments that every call takes, and make one whole file of every kind."""
        self.calls = fuzz_values.calls(json.loads((self.folder / "documents.json").read_text()))
        atlas = Path(libmpm.__file__).with_name("data") / "atlas.json"
        whole = json.loads(atlas.read_text(encoding="utf-8"))
        whole["lines"] = whole["lines"][:3]
        texts = {"grid.asc": _ESRI, "stroke.csv": _STROKE, "mesh.off": _OFF, "study.py": _SCRIPT,
                 "atlas.json": json.dumps(whole)}  # fmt: skip
        texts["field.json"] = _field()
        self.texts = texts

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Call one thing with odd arguments, or damage one file and read it."""
        rng = self.rng(seed, number)
        os.chdir(self.folder)  # a call may write to a name that it was given
        if rng.random() < _CALLS:
            call, arguments, said = fuzz_values.some(self.calls, rng)
            self.note(room, said=said)
            return {f"call: {fuzz_values.judge(call, arguments)}": 1}
        name = rng.choice(sorted(self.texts))
        path = room / name
        self.note(room, said=[name, _damage(self.texts[name], path, rng)])
        return {f"{name}: {_judge_file(path)}": 1}

    def replay(self, kept: Mapping[str, Any], room: Path) -> Mapping[str, int]:
        """Read the file that was kept; make the call again."""
        if len(kept["said"]) == 2 and (room / kept["said"][0]).exists():
            return {f"{kept['said'][0]}: {_judge_file(room / kept['said'][0])}": 1}
        return self.case(kept["seed"], kept["number"], room)


def _damage(text: str, path: Path, rng: random.Random) -> str:
    if path.suffix == ".json" and rng.random() < 0.6:
        made = fuzzing.Breaker({path.name: json.loads(text)}, rng.random(), 0, True).broken()
        path.write_bytes(fuzzing.shown(made.document, 10**7).encode(errors="replace"))
        return "; ".join(made.said)
    raw, said = fuzzing.broken_text(text, rng)
    path.write_bytes(raw)
    return said


def _script(path: Path) -> Any:
    """Load a script; what runs and raises is its author's own, and told as such."""
    try:
        return load_study(path, path.parent / "out")
    except libmpm.Error:
        raise
    except (NameError, AttributeError, ImportError, TypeError, ValueError) as error:
        assert error.__traceback__ is not None
        return None


_READERS: dict[str, Callable[[Path], Any]] = {
    "grid.asc": lambda path: shapes.HeightField.from_esri(path),
    "stroke.csv": lambda path: boundaries.stroke_from_file(path),
    "mesh.off": lambda path: grids.Mesh.load(path),
    "study.py": _script,
    "field.json": lambda path: debris.DebrisField.load(path),
    "atlas.json": lambda path: read_atlas(path),
}
#: Beside the readers that the library uses: whoever hands over what was read already.
_MORE: dict[str, Callable[[Path], Any]] = {
    "atlas.json": lambda path: parse(json.loads(path.read_text(encoding="utf-8"))),
    "field.json": lambda path: TradeOff.load(path),
}


def _judge_file(path: Path) -> str:
    found = fuzzing.answer(lambda: _READERS[path.name](path))
    if path.name == "field.json":
        fuzzing.answer(lambda: _MORE[path.name](path))
    if isinstance(found, libmpm.Error):
        assert path.name in str(found) or path.suffix not in (".asc", ".csv")
        return "refused"
    fuzzing.answer(lambda: repr(found))
    return "read"
