"""What the axes of a trade-off mean: rows, and the scene of each."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from libmpm._src.advice.tradeoff import choices
from libmpm._src.advice.tradeoff.metrics import with_energy
from libmpm._src.advice.tradeoff.result import COLUMNS
from libmpm._src.base.values import Checker, sequence, shown
from libmpm._src.errors import SceneError
from libmpm._src.scene.scene import Scene
from libmpm._src.studies.study.plan import OPTIONS
from libmpm._src.studies.study.rows import accepts, call_with, lacking

__all__ = ["Planned", "one_at_a_time", "take_axes"]


def take_axes(check: Checker, axes: Any) -> dict[str, list[Any]]:
    """Return name -> values; raises `SceneError` where that is none."""
    if not isinstance(axes, Mapping) or not axes:
        check.fail(f"axes is {shown(axes)}; expected names with lists of values")
        check.finish()
    found = {}
    for name, items in axes.items():
        values = list(items) if isinstance(items, range) else sequence(items)
        if not isinstance(name, str) or not values:
            check.fail(
                f"axes has {shown(name)} with {shown(items)}; expected a name and a list of values"
            )
            continue
        for i, item in enumerate(values):
            if item in values[:i]:
                check.fail(f"axes has {shown(item)} twice in '{name}'; expected each value once")
        found[name] = values
    check.finish()
    return found


def one_at_a_time(axes: Mapping[str, Sequence[Any]]) -> list[dict[str, Any]]:
    """Return the first values, and each other value beside the first ones of all other axes."""
    base = {name: values[0] for name, values in axes.items()}
    return [base, *(base | {n: v} for n, values in axes.items() for v in values[1:])]


class Planned:
    """What makes the scene of a row: its factory, and the choices that are put into the scene."""

    def __init__(
        self, check: Checker, scene: Any, axes: Mapping[str, Sequence[Any]], until: Any
    ) -> None:
        """Tell parameters of the factory from choices of a scene and options of a run."""
        self.scene = scene if isinstance(scene, Scene) else None
        self._factory: Callable[..., Scene] = (lambda: scene) if self.scene is not None else scene
        if not callable(self._factory):
            check.fail(f"scene is {shown(scene)}; expected a Scene or a function that returns one")
            check.finish()
        self.until = until
        if not callable(until):
            self.until = check.number("until", until, lower=0, lower_open=True, unit="s")
        own = [n for n in axes if not accepts(self._factory, [n], "") and not self._is_open(n)]
        self._put = [n for n in axes if n not in own and n in choices.CHOICES]
        self.run_axes = [n for n in axes if n not in own and n in OPTIONS]
        for name in lacking(self._factory, own):
            check.fail(
                f"the factory has no default for '{name}', which is no axis; give it one, or make "
                "it an axis"
            )
        for axis, values in axes.items():
            if axis in own:
                if axis in COLUMNS:
                    check.fail(
                        f"the axis '{axis}' is the name of a column of the table; give the "
                        "factory's parameter another name"
                    )
                continue
            if axis not in self._put and axis not in self.run_axes:
                if not self._takes_all():
                    check.fail(choices.unknown(axis, self._names()))
                continue
            why = ""
            if axis in self._put and self.scene is not None:
                why = choices.refusal(axis, self.scene)
            if why:
                check.fail(why)
            for value in values:
                choices.check_value(check, axis, value)

    def _takes_all(self) -> bool:
        return not accepts(self._factory, ["any name at all"], "")

    def _is_open(self, name: str) -> bool:
        """Tell whether the factory takes a name only as one of ``**others``."""
        return self._takes_all() and name not in self._names()

    def _names(self) -> tuple[str, ...]:
        try:
            found = inspect.signature(self._factory).parameters.values()
        except (TypeError, ValueError):
            return ()
        return tuple(p.name for p in found if p.kind is not p.VAR_KEYWORD)

    def build(self, **row: Any) -> Scene:
        """Return the scene of a row, with what measures its energy."""
        given = {k: v for k, v in row.items() if k not in self._put}
        made = self._factory(**given)
        if not isinstance(made, Scene):
            raise SceneError(f"the factory returned {made!r:.60}; expected a libmpm.Scene")
        made = choices.apply_choices(made, {k: row[k] for k in self._put})
        until = call_with(self.until, row) if callable(self.until) else self.until
        return with_energy(made, float(until))
