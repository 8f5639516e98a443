"""What is read from the sensors of a case: results to compare, and the drift of its energy."""

from __future__ import annotations

import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.output.series import Series
from libmpm._src.run.guard import opened_by
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import Energy
from libmpm._src.studies.study.case import StudyCase

__all__ = ["Metrics", "energy_drift", "take_metrics", "with_energy"]

Array = NDArray[np.float64]
#: Name -> number.
Numbers = dict[str, float]

#: Samples of the energy in a run whose scene does not take any itself.
_SAMPLES = 100
#: The part of a series, at its end, that counts as settled.
_SETTLED = 0.1


def _tail(values: Array) -> Array:
    return values[-max(1, math.ceil(_SETTLED * len(values))) :]


def _there(values: Array) -> Array:
    """Return the samples that have a value: a probe outside of the material has none."""
    found = values[np.isfinite(values)]
    return found if len(found) else np.array([math.nan])


#: Name -> one number from a column (n,) of samples.
_KNOWN: Mapping[str, Callable[[Array], float]] = {
    "last": lambda v: float(v[-1]),
    "peak": lambda v: float(_there(v)[np.argmax(np.abs(_there(v)))]),
    "largest": lambda v: float(np.max(_there(v))),
    "least": lambda v: float(np.min(_there(v))),
    "mean": lambda v: float(np.mean(_there(v))),
    "rms": lambda v: float(np.sqrt(np.mean(_there(v) ** 2))),
    "settled": lambda v: float(np.mean(_there(_tail(v)))),
}


class Metrics:
    """The results that rows are compared by; made by `take_metrics`."""

    def __init__(self, functions: Mapping[str, Callable[[StudyCase], Any]]) -> None:
        """Take functions of a case, each with the name of its number."""
        self._functions = dict(functions)

    def of(self, case: StudyCase, taken: Sequence[str]) -> Numbers:
        """Return the numbers of a finished case, all finite; raises `SceneError` otherwise.

        `taken` are names that a result may not have.
        """
        found: Numbers = {}
        problems = []
        for name, function in self._functions.items():
            answer = function(case)
            many = isinstance(answer, Mapping)
            for key, item in answer.items() if many else [(name, answer)]:
                number = _number(item)
                if not isinstance(key, str) or number is None or not math.isfinite(number):
                    problems.append(
                        f"metric '{name}' gave {item!r:.60}{f' for {key!r}' if many else ''}; "
                        "expected a finite number, or a mapping of names to such"
                    )
                elif key in found or key in taken:
                    what = "another metric" if key in found else "another column of the table"
                    problems.append(f"metric '{key}' has the name of {what}; give it another one")
                else:
                    found[key] = number
        if not found and not problems:
            problems.append("the metrics gave no number; expected one or more to compare")
        if problems:
            raise SceneError(problems)
        return found


def _number(item: Any) -> float | None:
    if hasattr(item, "item") and getattr(item, "size", 1) == 1:
        item = item.item()
    return float(item) if isinstance(item, numbers.Real) else None


def take_metrics(check: Checker, given: Any, scene: Scene | None) -> Metrics:
    """Return metrics from a callable or name, several of them, or a mapping of names to such.

    `scene` is that of all rows, if there is one before they run: sensors are looked up in it.
    """
    if isinstance(given, str) or callable(given):
        given = [given]
    functions: dict[str, Callable[[StudyCase], Any]] = {}
    if isinstance(given, Mapping):
        pairs = list(given.items())
    elif isinstance(given, list | tuple):
        plain = [m for m in given if callable(m) and _name_of(m) == "metric"]
        pairs = []
        for item in given:
            name = item if isinstance(item, str) else _name_of(item)
            if name == "metric" and len(plain) > 1:
                name = f"metric_{1 + next(i for i, m in enumerate(plain) if m is item)}"
            pairs.append((name, item))
    else:
        pairs = []
    if not pairs:
        check.fail(
            f"metrics is {shown(given)}; expected functions of a case, names such as "
            "'load/force_x/peak', or a mapping of names to such"
        )
    for name, item in pairs:
        if not isinstance(name, str) or not name:
            check.fail(f"metrics has the name {shown(name)}; expected a text")
        elif name in functions:
            check.fail(f"metrics has '{name}' twice; give a mapping of distinct names to them")
        elif isinstance(item, str):
            functions[name] = _column(check, item, scene)
        elif callable(item):
            functions[name] = item
        else:
            check.fail(
                f"metrics has {shown(item)}; expected a function of a case, or a name such as "
                "'load/force_x/peak'"
            )
    return Metrics(functions)


def _name_of(item: Any) -> str:
    name = getattr(item, "__name__", "")
    return name if name and name != "<lambda>" else "metric"


def _column(check: Checker, text: str, scene: Scene | None) -> Callable[[StudyCase], float]:
    """Return what reads ``sensor/component/how``, or ``sensor/how`` of a single component."""
    sensor, *middle, how = text.split("/")
    if not sensor or len(middle) > 1 or how not in _KNOWN:
        hint = nearest(how, _KNOWN) if sensor != text else f"how is one of {', '.join(_KNOWN)}"
        check.fail(f"metrics has '{text}'; expected 'sensor/component/how'; {hint}")
    if scene is not None and sensor not in [s.name for s in scene.sensors]:
        known = [s.name for s in scene.sensors]
        check.fail(f"metrics has '{text}': no sensor '{sensor}'; {nearest(sensor, known)}")

    def read(case: StudyCase) -> float:
        series = case.sensors.get(sensor)
        if series is None:
            raise SceneError(
                f"metric '{text}': no sensor '{sensor}'; {nearest(sensor, case.sensors)}"
            )
        column = middle[0] if middle else None
        if column is None and len(series.components) == 1:
            column = series.components[0]
        if column not in series.components:
            raise SceneError(
                f"metric '{text}': sensor '{sensor}' has no component '{column or ''}'; "
                f"{nearest(column or '', series.components)}"
            )
        values = series[column]
        if not len(values):
            raise SceneError(
                f"metric '{text}': sensor '{sensor}' took no sample until the end of the run; "
                "make its interval shorter"
            )
        return _KNOWN[how](values)

    return read


# Energy -----------------------------------------------------------------------------------------


def _is_closed(scene: Scene) -> bool:
    """Tell whether no energy can come into a scene while it runs."""
    # What begins to act pushes out the material that is in its way.
    return not opened_by(scene) and all(b.window[0] <= 0 for b in scene.boundaries)


def _energy_of(scene: Scene) -> str | None:
    """Return the name of the sensor of a scene that sums the energy of all bodies."""
    for placed in scene.sensors:
        if isinstance(placed.sensor, Energy) and placed.sensor.body is None:
            return placed.name
    return None


def with_energy(scene: Scene, until: float) -> Scene:
    """Return a scene that measures its energy, where that says how well it is kept."""
    if not _is_closed(scene) or _energy_of(scene) is not None:
        return scene
    name = "energy"
    while name in [s.name for s in scene.sensors]:
        name += "_of_all"
    begun = 0.0 if scene.start is None else scene.start.time
    made = Scene.from_dict(scene.to_dict())
    made.add_sensor(name=name, sensor=Energy(interval=(until - begun) / _SAMPLES))
    return made


def energy_drift(case: StudyCase) -> float | None:
    """Return the change of the energy of a finished case, as a part of its largest energy.

    The change is that of kinetic + elastic + potential energy from the first sample to the mean of
    the last tenth of them, the potential one taken from the lower corner of the domain. Friction,
    viscosity and plastic flow count as loss. None where energy comes in: through flows, moving or
    prescribed boundaries, tractions, or gravity that changes.
    """
    name = _energy_of(case.scene)
    series: Series | None = None if name is None else case.sensors.get(name)
    if not _is_closed(case.scene) or series is None or not len(series):
        return None
    kinetic, elastic, potential = series.values[:, :3].T
    scale = float(np.max(kinetic + elastic + np.abs(potential)))
    if not (scale > 0 and math.isfinite(scale)):
        return None
    total = kinetic + elastic + potential
    return float((np.mean(_tail(total)) - total[0]) / scale)
