"""What results are compared with: known values, or the finest of the runs."""

from __future__ import annotations

import copy
import math
import numbers
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.errors import SceneError
from libmpm._src.studies.study.case import StudyCase

__all__ = ["Finest", "Known", "errors_of", "finest", "take_reference"]

#: From the finest to the coarsest.
_PRECISIONS = ("double", "mixed", "single")


@dataclass(frozen=True)
class Finest:
    """The finest of the runs; of those whose parameters are as in `row`, which may be empty."""

    row: Mapping[str, Any]


@dataclass(frozen=True)
class Known:
    """Known values: a number, numbers by metric, or a function of a row that returns either."""

    value: Any

    def of(self, row: Mapping[str, Any], metrics: Mapping[str, float]) -> dict[str, float]:
        """Return the known value of each metric that has one; raises `SceneError`."""
        made = self.value(copy.deepcopy(dict(row))) if callable(self.value) else self.value
        if isinstance(made, Mapping):
            return _checked(made, metrics)
        if len(metrics) != 1:
            raise SceneError(
                f"reference is one number for the metrics {', '.join(metrics)}; expected a mapping "
                "of their names to numbers"
            )
        return _checked(dict.fromkeys(metrics, made), metrics)


def _checked(values: Mapping[Any, Any], metrics: Mapping[str, float]) -> dict[str, float]:
    problems = []
    for name, item in values.items():
        if name not in metrics:
            hint = nearest(str(name), metrics)
            problems.append(f"reference has '{name}', which no metric gives; {hint}")
        elif (
            isinstance(item, bool) or not isinstance(item, numbers.Real) or not math.isfinite(item)
        ):
            problems.append(f"reference of '{name}' is {shown(item)}; expected a finite number")
    if problems:
        raise SceneError(problems)
    return {name: float(item) for name, item in values.items()}


def take_reference(
    check: Checker, given: Any, axes: Mapping[str, Sequence[Any]]
) -> Finest | Known | None:
    """Return the reference; a mapping whose names are those of axes means a row."""
    if isinstance(given, str):
        check.choice("reference", given, ("finest",))
        return Finest({})
    if isinstance(given, Mapping) and given and all(name in axes for name in given):
        for name, item in given.items():
            if item not in axes[name]:
                listed = ", ".join(map(repr, axes[name]))
                check.fail(f"reference has {name}={item!r}, which no row has; choose from {listed}")
        return Finest(dict(given))
    if isinstance(given, Mapping) and given:
        for name, item in given.items():
            if name in axes:
                check.fail(
                    f"reference has the axis '{name}' besides metrics; expected names of axes "
                    "alone, which mean a row, or of metrics alone"
                )
            check.number(f"reference of '{name}'", item)
        return Known(dict(given))
    if callable(given):
        return Known(given)
    if isinstance(given, numbers.Real) and not isinstance(given, bool):
        return Known(check.number("reference", given))
    check.fail(
        f"reference is {shown(given)}; expected 'finest', a number, a mapping of metrics to "
        "numbers "
        "or of axes to values, or a function of a row"
    )
    return None


def finest(cases: Sequence[StudyCase], numbers_: Sequence[int], reference: Finest) -> int | None:
    """Return which of the cases `numbers_` is the finest, or None if there is none.

    The smallest cell; then most particles, the finest precision, the largest bulk modulus among the
    parameters, the smallest time step, and the place in the table.
    """
    wanted = [
        i
        for i in numbers_
        if all(cases[i].parameters.get(k) == v for k, v in reference.row.items())
    ]
    return min(wanted, key=lambda i: (*fineness(cases[i]), i), default=None)


def fineness(case: StudyCase) -> tuple[float, ...]:
    """Return what orders cases from the finest on."""
    modulus = case.parameters.get("bulk_modulus")
    stiff = float(modulus) if isinstance(modulus, numbers.Real) else 0.0
    record = case.record
    precision = str(record.get("precision"))
    return (
        case.scene.cell_size,
        -float(record.get("particles") or 0),
        float(_PRECISIONS.index(precision)) if precision in _PRECISIONS else math.inf,
        -stiff,
        float(record.get("time_step") or math.inf),
    )


def errors_of(found: Mapping[str, float], expected: Mapping[str, float]) -> dict[str, float]:
    """Return metric -> found / expected - 1, or found - expected where that is 0."""
    return {
        name: found[name] / value - 1 if value else found[name]
        for name, value in expected.items()
        if name in found
    }
