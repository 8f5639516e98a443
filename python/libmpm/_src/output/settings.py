"""`Output`: where a run writes, which frames and checkpoints, how often."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from libmpm._src.base.arguments import file_path, keywords_only, shown
from libmpm._src.errors import SceneError
from libmpm._src.sensors.engine_sensors import LEAST_INTERVAL

__all__ = ["Output"]

#: Attributes of a frame where none are chosen.
DEFAULT_ATTRIBUTES = ("velocity", "pressure")
#: And of a body of elements.
OF_ELEMENTS = ("element_stress", "element_volume_ratio")


@dataclass(frozen=True, kw_only=True)
class _Settings:
    path: str
    frame_interval: float | None
    attributes: dict[str, list[str]] | list[str] | None
    checkpoint_interval: float | None
    overwrite: bool


def _seconds(value: object) -> float:
    """Return a number as float; not a number for anything else."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _chosen(attributes: object) -> dict[str, list[str]] | list[str] | None:
    """Return names, or those of each body, as they were given; None where they are no names."""
    if isinstance(attributes, Mapping):
        of_bodies = {body: _names(names) for body, names in attributes.items()}
        found = {body: names for body, names in of_bodies.items() if names is not None}
        whole = len(found) == len(of_bodies) and all(isinstance(body, str) for body in found)
        return found if whole else None
    return _names(attributes)


def _names(given: object) -> list[str] | None:
    """Return names as a list; None where they are something else, or one text."""
    if isinstance(given, str | bytes | Mapping):
        return None
    try:
        names = list(given)  # type: ignore[call-overload]
    except TypeError:  # an array without a length says so only when it is walked
        return None
    return [str(name) for name in names] if all(isinstance(x, str) for x in names) else None


class Output:
    """Where and how often a simulation writes.

    Parameters
    ----------
    path
        Folder; made if absent. It receives ``scene.json``, ``plan.txt``, ``log.json``,
        ``sensors.h5``, ``csv/<sensor>.csv``, ``frames/<body>_<index>.vtkhdf``, ``removed.csv``
        and ``checkpoints/`` (two generations).
    frame_interval
        Simulated seconds between frames; frame k is taken at the first step boundary with
        time >= k * frame_interval. None: no frames.
    attributes
        Names to store in frames besides the position: one list for all bodies or
        {body: list}. A body that the mapping leaves out has no frames. Default: velocity and
        pressure, of bodies of elements their elements' stress and volume ratio too.
    checkpoint_interval
        Simulated seconds between checkpoints. None: none.
    overwrite
        Replace the results of an earlier run in the same folder instead of refusing.
    """

    @keywords_only("Output", 1)
    def __init__(
        self,
        path: str | Path,
        *,
        frame_interval: float | None = None,
        attributes: Mapping[str, Sequence[str]] | Sequence[str] | None = None,
        checkpoint_interval: float | None = None,
        overwrite: bool = False,
    ) -> None:
        """Check and keep the settings; nothing is written before the run starts."""
        problems = []
        intervals = {"frame_interval": frame_interval, "checkpoint_interval": checkpoint_interval}
        seconds = {name: _seconds(value) for name, value in intervals.items()}
        for name, value in intervals.items():
            if value is not None and not LEAST_INTERVAL <= seconds[name] < math.inf:
                problems.append(
                    f"Output: {name} is {shown(value)}; expected seconds above 0 "
                    f"(≥ {LEAST_INTERVAL:g}), or None"
                )
        chosen: dict[str, list[str]] | list[str] | None = None
        if isinstance(attributes, str):
            problems.append(f"Output: attributes is the text '{attributes}'; expected a list")
        elif attributes is not None:
            chosen = _chosen(attributes)
            if chosen is None:
                problems.append(
                    f"Output: attributes is {shown(attributes)}; expected a list of names, or one "
                    "for each body"
                )
        if not isinstance(overwrite, bool):
            problems.append(f"Output: overwrite is {shown(overwrite)}; expected True or False")
        try:
            path = file_path(path, "Output")
        except SceneError as error:
            problems += error.problems
        if problems:
            raise SceneError(problems)
        self._settings = _Settings(
            path=str(path),
            frame_interval=None if frame_interval is None else seconds["frame_interval"],
            attributes=chosen,
            checkpoint_interval=(
                None if checkpoint_interval is None else seconds["checkpoint_interval"]
            ),
            overwrite=overwrite,
        )

    @property
    def path(self) -> Path:
        """The folder."""
        return Path(self._settings.path)

    @property
    def frame_interval(self) -> float | None:
        """Simulated seconds between frames, or None."""
        return self._settings.frame_interval

    @property
    def checkpoint_interval(self) -> float | None:
        """Simulated seconds between checkpoints, or None."""
        return self._settings.checkpoint_interval

    @property
    def overwrite(self) -> bool:
        """Whether earlier results in the folder are replaced."""
        return self._settings.overwrite

    def attributes_of(self, body: str, *, meshed: bool = False) -> list[str] | None:
        """Return the names stored in frames of `body`, `meshed` of elements; None for no frames."""
        chosen = self._settings.attributes
        if chosen is None:
            return [*DEFAULT_ATTRIBUTES, *(OF_ELEMENTS if meshed else ())]
        if isinstance(chosen, dict):
            return chosen.get(body)
        return chosen

    @property
    def bodies(self) -> list[str]:
        """Bodies that the attributes name; empty where one list serves all."""
        chosen = self._settings.attributes
        return list(chosen) if isinstance(chosen, dict) else []

    def to_dict(self) -> dict[str, Any]:
        """Return the arguments of the constructor."""
        return asdict(self._settings)

    def __eq__(self, other: object) -> bool:
        """Compare the settings."""
        return isinstance(other, Output) and self._settings == other._settings

    def __hash__(self) -> int:
        """Hash the folder."""
        return hash(self._settings.path)

    def __repr__(self) -> str:
        """Return an expression that makes an equal value."""
        given = {k: v for k, v in self.to_dict().items() if v is not None and v is not False}
        arguments = {k: v for k, v in given.items() if k != "path"}
        listed = "".join(f", {k}={v!r}" for k, v in arguments.items())
        return f"Output({self._settings.path!r}{listed})"
