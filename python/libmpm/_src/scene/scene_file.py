"""Reading scene files (JSON), with every problem reported at once."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from libmpm._src.base.values import from_plain, nearest, shown, warn
from libmpm._src.errors import SceneError
from libmpm._src.materials.friction import cone_warning
from libmpm._src.scene.checks import check_scene
from libmpm._src.scene.data import HEAD, SCHEMA, SceneData

__all__ = ["SceneReader", "read_json"]

S = TypeVar("S", bound=SceneData)

#: One of each kind of part.
_SINGULAR = ("body", "boundary", "sensor", "flow", "contact")


def read_json(path: Path) -> Any:
    """Return what a JSON file holds; raises `SceneError` naming the file.

    A key that an object has twice is refused, of which Python's own reader drops the first. A byte
    order mark is ignored.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            keys = [key for key, _ in pairs]
            twice = next(key for key in keys if keys.count(key) > 1)
            raise SceneError(f"{path}: an object has the key '{twice}' twice; remove one of them")
        return found

    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=unique)
    except SceneError:
        raise
    except OSError as error:
        raise SceneError(
            f"{path} cannot be read: {error.strerror or error}; expected a scene file, as "
            "Scene.save writes it"
        ) from error
    except RecursionError as error:
        raise SceneError(f"{path}: not a scene file: nested too deep to be read") from error
    except ValueError as error:
        # Text that is not UTF-8, text that is not JSON, and numbers of more than 4300 digits.
        raise SceneError(f"{path}: not JSON: {error}; write it with Scene.save") from error


class SceneReader(Generic[S]):
    """Reads a dictionary into a scene and collects every problem on the way."""

    def __init__(self, kind: type[S], data: Mapping[str, Any]) -> None:
        """Take what a scene file holds, to be read as a scene of class `kind`."""
        self.kind = kind
        self.data = data
        self.problems: list[str] = []
        self.broken = False

    def read(self) -> S:
        """Return the scene; raises `SceneError` with all problems."""
        data = self.data
        if not isinstance(data, Mapping) or "libmpm" not in data:
            raise SceneError('scene file: key "libmpm" is missing; expected a file of Scene.save')
        version = data["libmpm"]
        if not isinstance(version, int) or version != SCHEMA:
            raise SceneError(
                f'scene file: "libmpm" is {shown(version)}; this libmpm reads version {SCHEMA}; '
                "save the scene again with a matching version"
            )
        kinds = ("bodies", "boundaries", "sensors", "flows", "contacts")
        # "run" says how `libmpm run` treats the scene, "$schema" which editor's help the file has;
        # they describe no part of it.
        known = ("libmpm", *HEAD, *kinds, "run", "$schema")
        for key in data:
            if key not in known:
                self.problems.append(f"scene file: unknown key '{key}'; {nearest(key, known)}")
        scene = self._head({k: v for k, v in data.items() if k in HEAD})
        target: SceneData = scene or _stand_in(data)
        for kind, singular in zip(kinds, _SINGULAR, strict=True):
            entries = data.get(kind, [])
            if not isinstance(entries, list | tuple):
                self.problems.append(f"scene file: {kind} is {shown(entries, 60)}; expected a list")
                continue
            for i, entry in enumerate(entries):
                self._entry(getattr(target, f"add_{singular}"), f"{singular}", i, entry)
        if self.problems and scene is not None and not self.broken:
            self.problems += check_scene(scene)[0]
        if self.problems or scene is None:
            raise SceneError(self.problems)
        found = [cone_warning(body, scene.dimension) for body in data.get("bodies", ())]
        warn(text for text in found if text is not None)
        return scene

    def _head(self, head: Mapping[str, Any]) -> S | None:
        try:
            return self.kind(**from_plain(head))
        except SceneError as error:
            self.problems += error.problems
            return None

    def _entry(self, add: Any, kind: str, index: int, entry: Any) -> None:
        name = entry.get("name", index) if isinstance(entry, Mapping) else index
        name = name if isinstance(name, str) else index
        prefix = f"{kind} '{name}'"
        if not isinstance(entry, Mapping):
            self.problems.append(f"{prefix}: {shown(entry, 60)} is not an object; expected names")
            return
        if "type" in entry:
            self.problems.append(
                f'{prefix}: "type" is {shown(entry["type"], 60)}; entries of this list have no '
                "type; leave it out"
            )
            return
        try:
            add(**from_plain(entry))
        except SceneError as error:
            # An object that cannot be built would make every reference to it look wrong.
            self.broken = True
            for problem in error.problems:
                own = problem.startswith(prefix)
                self.problems.append(problem if own else f"{prefix}: {problem}")


def _stand_in(data: Mapping[str, Any]) -> SceneData:
    """Return an empty scene in which the parts of a broken one can still be checked."""
    stated = data.get("dimension")
    d = 2 if "grid" in data or (isinstance(stated, int) and stated == 2) else 3
    return SceneData(dimension=d, cell_size=1.0, lower=(0.0,) * d, upper=(1.0,) * d)
