"""Reading scenes from dictionaries, with every problem reported at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from libmpm._src.checks import check_scene
from libmpm._src.errors import SceneError
from libmpm._src.scene import HEAD, SCHEMA, Scene
from libmpm._src.values import from_plain, nearest

__all__ = ["SceneReader"]


class SceneReader:
    """Reads a dictionary into a scene and collects every problem on the way."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        """Take what a scene file holds."""
        self.data = data
        self.problems: list[str] = []
        self.broken = False

    def read(self) -> Scene:
        """Return the scene; raises `SceneError` with all problems."""
        data = self.data
        if not isinstance(data, Mapping) or "libmpm" not in data:
            raise SceneError('scene file: key "libmpm" is missing; expected a file of Scene.save')
        if data["libmpm"] != SCHEMA:
            raise SceneError(
                f'scene file: "libmpm" is {data["libmpm"]!r}; this libmpm reads version {SCHEMA}; '
                "save the scene again with a matching version"
            )
        kinds = ("bodies", "boundaries", "sensors", "flows")
        # "run" says how `libmpm run` treats the scene, "$schema" which editor's help the file has;
        # they describe no part of it.
        known = ("libmpm", *HEAD, *kinds, "run", "$schema")
        for key in data:
            if key not in known:
                self.problems.append(f"scene file: unknown key '{key}'; {nearest(key, known)}")
        scene = self._head({k: v for k, v in data.items() if k in HEAD})
        target = scene or _stand_in(data)
        for kind, singular in zip(kinds, ("body", "boundary", "sensor", "flow"), strict=True):
            entries = data.get(kind, [])
            if not isinstance(entries, list | tuple):
                self.problems.append(f"scene file: {kind} is {entries!r:.60}; expected a list")
                continue
            for i, entry in enumerate(entries):
                self._entry(getattr(target, f"add_{singular}"), f"{singular}", i, entry)
        if self.problems and scene is not None and not self.broken:
            self.problems += check_scene(scene)[0]
        if self.problems or scene is None:
            raise SceneError(self.problems)
        return scene

    def _head(self, head: Mapping[str, Any]) -> Scene | None:
        try:
            return Scene(**from_plain(head))
        except SceneError as error:
            self.problems += error.problems
            return None

    def _entry(self, add: Any, kind: str, index: int, entry: Any) -> None:
        name = entry.get("name", index) if isinstance(entry, Mapping) else index
        prefix = f"{kind} '{name}'"
        if not isinstance(entry, Mapping):
            self.problems.append(f"{prefix}: {entry!r:.60} is not an object; expected names")
            return
        try:
            add(**from_plain(entry))
        except SceneError as error:
            # An object that cannot be built would make every reference to it look wrong.
            self.broken = True
            for problem in error.problems:
                own = problem.startswith(prefix)
                self.problems.append(problem if own else f"{prefix}: {problem}")


def _stand_in(data: Mapping[str, Any]) -> Scene:
    """Return an empty scene in which the parts of a broken one can still be checked."""
    d = 2 if data.get("dimension") == 2 or "grid" in data else 3
    return Scene(dimension=d, cell_size=1.0, lower=(0.0,) * d, upper=(1.0,) * d)
