"""Scene files with a "run" key: how long to run, what to write, what to report."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from libmpm._src.base.declarations import TEXT, Given, about, declared, filled
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.output.settings import Output
from libmpm._src.scene.scaling import Scaling
from libmpm._src.scene.scene import Scene
from libmpm._src.scene.scene_file import read_json

__all__ = ["RunFile", "RunSettings", "read_run_file", "scale_run_file", "without_debris"]


#: Largest floating-point number, s.
_LONGEST = sys.float_info.max


def _are_names(given: Any) -> bool:
    return isinstance(given, list | tuple) and all(isinstance(name, str) for name in given)


@dataclass(frozen=True)
class RunSettings:
    """The "run" key of a scene file.

    {fields}
    """

    until: float | None = field(default=None, metadata=about(Given("end", unit="s", low=0)))
    frame_interval: float | None = field(
        default=None, metadata=about(Given("between frames; None = none", unit="s", low=0))
    )
    checkpoint_interval: float | None = field(
        default=None, metadata=about(Given("between checkpoints; None = none", unit="s", low=0))
    )
    attributes: dict[str, list[str]] | list[str] | None = field(
        default=None, metadata=about(Given("what frames have besides positions, as in `Output`"))
    )
    filter: float = field(
        default=0.0,
        metadata=about(Given("length of the moving mean behind printed peaks", unit="s", low=0)),
    )
    debris: list[str] = field(
        default_factory=list,
        metadata=about(Given("names of the bodies that `--without-debris` leaves out")),
    )

    @classmethod
    def from_dict(cls, data: Any) -> RunSettings:
        """Check and take the key's content; raises `SceneError` with all problems."""
        if not isinstance(data, Mapping):
            raise SceneError(f'scene file: "run" is {shown(data, 60)}; expected an object')
        known = list(cls.__dataclass_fields__)
        problems = [
            f"scene file: \"run\" has the unknown key '{key}'; {nearest(key, known)}"
            for key in data
            if key not in known
        ]
        for key in ("until", "frame_interval", "checkpoint_interval", "filter"):
            value = data.get(key)
            if value is None:
                continue
            number = isinstance(value, int | float) and not isinstance(value, bool)
            # The bound instead of isfinite, which fails for whole numbers of any length.
            if not number or not 0 <= value <= _LONGEST:
                problems.append(
                    f'scene file: "run" has {key} = {shown(value)}; expected seconds, ≥ 0'
                )
        attributes = data.get("attributes")
        by_body = attributes if isinstance(attributes, Mapping) else {"all": attributes}
        if attributes is not None and not all(_are_names(names) for names in by_body.values()):
            problems.append(
                f'scene file: "run" has attributes = {shown(attributes)}; expected names, or for '
                "each body a list of names"
            )
        if not _are_names(data.get("debris", [])):
            problems.append(
                f'scene file: "run" has debris = {shown(data["debris"])}; expected names of bodies'
            )
        if problems:
            raise SceneError(problems)
        return cls(**data)

    def to_dict(self) -> dict[str, Any]:
        """Return what differs from the defaults, in terms of JSON."""
        default = RunSettings()
        return {k: v for k, v in vars(self).items() if v != getattr(default, k)}

    def output(self, folder: Path, *, overwrite: bool = False) -> Output:
        """Return the output settings for `folder`."""
        return Output(
            folder,
            frame_interval=self.frame_interval,
            attributes=self.attributes,
            checkpoint_interval=self.checkpoint_interval,
            overwrite=overwrite,
        )


RunSettings.__doc__ = filled(RunSettings.__doc__, declared(RunSettings))


@dataclass(frozen=True)
class RunFile:
    """A scene and how to run it."""

    scene: Scene
    settings: RunSettings

    def to_dict(self) -> dict[str, Any]:
        """Return the content of the file."""
        return self.scene.to_dict() | {"run": self.settings.to_dict()}


def read_run_file(path: Path) -> RunFile:
    """Read a scene file; raises `SceneError` with all problems."""
    try:
        data = read_json(path)
    except FileNotFoundError as error:
        raise SceneError(f"{path}: no such file; give the path of a scene file") from error
    except OSError as error:
        raise SceneError(f"{path}: cannot be read as JSON: {error}") from error
    if not isinstance(data, dict):
        raise SceneError(f"{path}: holds no JSON object; write it with Scene.save")
    settings = RunSettings.from_dict(data.pop("run", {}))
    return RunFile(Scene.from_dict(data), settings)


def without_debris(source: RunFile) -> RunFile:
    """Return the same run without the bodies that its settings call debris."""
    gone = set(source.settings.debris)
    data = source.scene.to_dict()
    data["bodies"] = [b for b in data["bodies"] if b["name"] not in gone]
    settings = source.settings
    attributes = settings.attributes
    if isinstance(attributes, dict):
        attributes = {b: names for b, names in attributes.items() if b not in gone}
    settings = replace(settings, debris=[], attributes=attributes)
    return RunFile(Scene.from_dict(data), settings)


def scale_run_file(source: RunFile, scaling: Scaling) -> RunFile:
    """Return scene and "run" settings in similitude."""
    known = declared(RunSettings)
    settings = {
        name: item
        if (unit := known[name].unit) == TEXT
        else scaling.item(item, unit, f"run.{name}")
        for name, item in vars(source.settings).items()
    }
    return RunFile(scaling.scene(source.scene), RunSettings(**settings))
