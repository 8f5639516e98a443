"""From rows to cases: which scene, how long, with which options, and under which name."""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import Checker, nearest, plain, shown
from libmpm._src.errors import CheckpointError, SceneError
from libmpm._src.run.choices import check_options, choose_precision
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.custom_functions import check_storable
from libmpm._src.studies.study.record import glance_record
from libmpm._src.studies.study.rows import accepts, call_with, describe, digest, lacking
from libmpm._src.studies.study.shared_files import CHECKPOINT, TRUNKS

__all__ = ["OPTIONS", "Plan", "Planner", "Resolved", "Trunk"]

#: Options of a run that a row, `options` or `Study.run` may set, and their defaults.
OPTIONS: Mapping[str, Any] = {
    "device": None,
    "precision": "auto",
    "pipeline": "auto",
    "threads": None,
    "shared_device": False,
    "time_step": None,
    "partition": None,
}
#: The options that change results; the others tell cases apart only where a row varies them.
_PHYSICAL = ("precision", "pipeline", "shared_device", "time_step")

Seconds = float | Callable[..., float]


class Trunk:
    """The part of a simulation that many cases share: water once, debris many times.

    =========  ====  =================  ====================================================
    parameter  unit  type               meaning
    =========  ====  =================  ====================================================
    factory    -     callable           returns the trunk's `Scene`; called with those
                                        parameters of a row that it names
    until      s     number, callable   end of the trunk; a callable is called like `factory`
    =========  ====  =================  ====================================================

    Rows with equal trunk scenes share one run, which leaves a checkpoint; the factory of the study
    is called with its path as ``factory(checkpoint=path, **row)``. Raises `SceneError`.
    """

    @keywords_only("studies.Trunk", 2)
    def __init__(self, factory: Callable[..., Scene], until: Seconds) -> None:
        """See the class."""
        check = Checker("Trunk")
        if not callable(factory):
            check.fail(f"factory is {shown(factory, 60)}; expected a function that returns a Scene")
        if not callable(until):
            until = check.number("until", until, lower=0, lower_open=True, unit="s")
        check.finish()
        self.factory = factory
        self.until = until

    def __repr__(self) -> str:
        """Return an expression like the one that made it."""
        name = getattr(self.factory, "__name__", repr(self.factory))
        return f"Trunk({name}, until={self.until!r})"


@dataclass(frozen=True)
class Resolved:
    """A simulation: what it is called, its scene, end in s, and options of `Simulation`."""

    hash: str
    scene: Scene
    until: float
    options: dict[str, Any]
    trunk: str = ""


@dataclass
class Plan:
    """What is known of one row: `hash` and `trunk` name its folders, empty if not known or none.

    `case` and `root` are the simulations themselves, as far as this process has resolved them.
    """

    row: dict[str, Any]
    hash: str = ""
    trunk: str = ""
    error: str = ""
    case: Resolved | None = None
    root: Resolved | None = None


@dataclass
class Planner:
    """Turns rows into simulations; see `Study` for the fields."""

    folder: Path
    factory: Callable[..., Scene]
    until: Seconds
    options: Mapping[str, Any] | Callable[..., Mapping[str, Any]] | None
    run_axes: Sequence[str]
    trunk: Trunk | None
    label: str = "Study"
    _trunks: dict[str, Resolved] = field(default_factory=dict)

    def check_rows(self, rows: Sequence[Mapping[str, Any]], taken: Sequence[str]) -> None:
        """Refuse rows with names that the factory does not take, or that the table uses."""
        problems: dict[str, None] = {}
        handed = [] if self.trunk is None else ["checkpoint"]
        if accepts(self.factory, handed, ""):
            problems[
                f"{self.label}: the factory takes no argument 'checkpoint', the file that its "
                "trunk hands to it; write factory(checkpoint, ...)"
            ] = None
        callables = {"the factory": self.factory, "until": self.until, "options": self.options}
        if self.trunk is not None:
            callables["the trunk's factory"] = self.trunk.factory
            callables["the trunk's until"] = self.trunk.until
        lacked: dict[tuple[str, str], int] = {}
        for number, row in enumerate(rows):
            names = [name for name in row if name not in self.run_axes]
            for what, function in callables.items():
                known = {*names, *handed} if what == "the factory" else {*names}
                for name in lacking(function, known) if callable(function) else ():
                    lacked.setdefault((what, name), number)
            problems |= dict.fromkeys(accepts(self.factory, names, f"{self.label}: the factory"))
            for name in names:
                if name in taken:
                    problems[
                        f"{self.label}: the parameter '{name}' is the name of a column of the "
                        "table; give it another name, or list it in run_axes if it is an option"
                    ] = None
                if name == "checkpoint" and self.trunk is not None:
                    problems[
                        f"{self.label}: the parameter 'checkpoint' is what the trunk hands to the "
                        "factory; give it another name"
                    ] = None
        for (what, name), number in lacked.items():
            problems[
                f"{self.label}: {what} has no default for '{name}', which row {number} lacks; give "
                "every row a value, or the argument a default"
            ] = None
        if problems:
            raise SceneError(list(problems))

    def start(self, row: Mapping[str, Any]) -> Plan:
        """Return the plan of a row: its case, or its trunk if that has not run yet."""
        plan = Plan(dict(row))
        with _noting(plan):
            if self.trunk is None:
                self._settle(plan)
            else:
                plan.root = self._resolve_trunk(row)
                plan.trunk = plan.root.hash
                self.go_on(plan)
        return plan

    def go_on(self, plan: Plan) -> None:
        """Resolve the case of a row, if its trunk has finished."""
        folder = self.folder / TRUNKS / plan.trunk
        there = (folder / CHECKPOINT).is_file()
        if plan.case is None and there and glance_record(folder).get("status") == "finished":
            with _noting(plan):
                try:
                    self._settle(plan)
                except CheckpointError as error:
                    raise CheckpointError(
                        f"{error}. Where it is that of the trunk, delete {folder / CHECKPOINT}: "
                        "the trunk runs again"
                    ) from error

    def _settle(self, plan: Plan) -> None:
        plan.case = self._resolve(plan.row, plan.trunk)
        plan.hash = plan.case.hash

    def _parameters(self, row: Mapping[str, Any]) -> dict[str, Any]:
        # A factory that changes a list it was given must not change the row.
        return {k: copy.deepcopy(v) for k, v in row.items() if k not in self.run_axes}

    def _resolve(self, row: Mapping[str, Any], trunk: str = "") -> Resolved:
        parameters = self._parameters(row)
        handed: dict[str, Any] = {}
        if trunk:
            handed = {"checkpoint": self.folder / TRUNKS / trunk / CHECKPOINT}
        scene = _scene(self.factory(**handed, **parameters), "the factory")
        options = self._options(row, scene)
        axes = {k: plain(row[k]) for k in self.run_axes if k in row and k not in _PHYSICAL}
        until = _seconds(self.until, parameters)
        _check_end(scene, until, "trunk" if trunk else "checkpoint")
        content = _content(scene, until, options) | {"axes": axes, "trunk": trunk}
        if trunk:
            # A study that is moved to another folder keeps its names.
            word = f"trunk {trunk}"
            content = _replaced(content, handed["checkpoint"], word)
            start = content["scene"].get("start")
            if start is not None and start["checkpoint"] == word:
                # Folder, device and threads are in the file, and decide nothing.
                start["digest"] = ""
        return Resolved(digest(content, "the case"), scene, until, options, trunk)

    def _resolve_trunk(self, row: Mapping[str, Any]) -> Resolved:
        assert self.trunk is not None
        parameters = self._parameters(row)
        scene = _scene(call_with(self.trunk.factory, parameters), "the trunk's factory")
        options = self._options(row, scene)
        until = _seconds(self.trunk.until, parameters)
        _check_end(scene, until, "checkpoint")
        made = Resolved(digest(_content(scene, until, options), "the trunk"), scene, until, options)
        return self._trunks.setdefault(made.hash, made)

    def _options(self, row: Mapping[str, Any], scene: Scene) -> dict[str, Any]:
        """Return the options of one run: of the row, else of `options`, else the defaults."""
        given = self.options
        if callable(given):
            given = call_with(given, self._parameters(row))
        chosen = dict(given or {})
        for name in chosen:
            if name not in OPTIONS:
                raise SceneError(f"options has '{name}'; {nearest(name, OPTIONS)}")
        chosen = {**OPTIONS, **chosen, **{k: row[k] for k in self.run_axes if k in row}}
        chosen["precision"] = choose_precision(scene, chosen["precision"])
        problems = check_options(
            chosen["precision"],
            chosen["pipeline"],
            time_step=chosen["time_step"],
            threads=chosen["threads"] or 0,
        )
        if problems:
            raise SceneError(problems)
        if chosen["time_step"] is not None:
            chosen["time_step"] = float(chosen["time_step"])
        return chosen


@contextlib.contextmanager
def _noting(plan: Plan) -> Iterator[None]:
    """Note a failure in the plan of its row: a factory may raise anything, the others continue."""
    try:
        yield
    except Exception as error:
        plan.error = describe(error)


def _scene(found: Any, what: str) -> Scene:
    if not isinstance(found, Scene):
        raise SceneError(f"{what} returned {shown(found, 60)}; expected a libmpm.Scene")
    return found


def _seconds(until: Seconds, parameters: Mapping[str, Any]) -> float:
    found = call_with(until, parameters) if callable(until) else until
    check = Checker("Study")
    seconds = check.number("until", found, lower=0, lower_open=True, unit="s")
    check.finish()
    return seconds


def _check_end(scene: Scene, until: float, what: str) -> None:
    """Refuse an end that is over before the scene begins."""
    if scene.start is not None and until <= scene.start.time:
        raise SceneError(
            f"until is {until:g} s; the {what} ends at {scene.start.time:g} s; expected later"
        )


def _content(scene: Scene, until: float, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what decides the results of a simulation."""
    physical = {name: options[name] for name in _PHYSICAL}
    check_storable(scene)
    return {"scene": scene.to_dict(), "until": until, "options": physical}


def _replaced(item: Any, path: Path, word: str) -> Any:
    """Return `item` with `word` in place of every text that names the file `path`."""
    if isinstance(item, Mapping):
        return {k: _replaced(v, path, word) for k, v in item.items()}
    if isinstance(item, list | tuple):
        return [_replaced(v, path, word) for v in item]
    if isinstance(item, str) and item.endswith(path.name) and Path(item).resolve() == path:
        return word
    return item
