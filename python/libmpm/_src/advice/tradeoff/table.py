"""From runs to rows: results, errors, costs, and which rows are best."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from libmpm._src.advice.tradeoff.front import front
from libmpm._src.advice.tradeoff.metrics import Metrics, energy_drift
from libmpm._src.advice.tradeoff.reference import Finest, Known, errors_of, fineness, finest
from libmpm._src.advice.tradeoff.result import COLUMNS, TradeOff
from libmpm._src.base.values import warned_already
from libmpm._src.errors import Error, ModelWarning, SceneError
from libmpm._src.studies.study.case import StudyCase
from libmpm._src.studies.study.rows import describe

__all__ = ["make_table"]

Row = dict[str, Any]


def make_table(
    cases: Sequence[Sequence[StudyCase]],
    metrics: Metrics,
    reference: Finest | Known,
    clock: str,
    parameters: tuple[str, ...],
    name: str,
) -> TradeOff:
    """Return the table of runs; `cases` holds a list of cases, one a row, for each repeat."""
    first = cases[0]
    taken = (*parameters, *COLUMNS)
    rows: list[Row] = []
    found: dict[int, dict[str, float]] = {}
    for number, case in enumerate(first):
        rows.append(dict.fromkeys(COLUMNS) | {"front": False, "reference": False, "failure": ""})
        rows[-1] |= case.parameters
        try:
            rows[-1] |= _costs(case, [repeat[number] for repeat in cases])
            if case.status != "finished":
                rows[-1]["failure"] = case.error or f"the run is {case.status}"
                continue
            found[number] = metrics.of(case, taken)
            rows[-1] |= found[number]
        except Exception as error:
            rows[-1]["failure"] = describe(error)
    which = finest(first, list(found), reference) if isinstance(reference, Finest) else None
    if which is not None:
        rows[which]["reference"] = True
        _tell_finer(first, which, found, reference)
    for number, numbers_ in found.items():
        if number == which:
            continue
        try:
            if isinstance(reference, Known):
                expected = reference.of(first[number].parameters, numbers_)
            elif which is None:
                raise SceneError("the reference has failed: no row with its values has finished")
            else:
                expected = found[which]
            errors = errors_of(numbers_, expected)
            rows[number] |= {f"{k}_error": v for k, v in errors.items()}
            rows[number]["error"] = max(map(abs, errors.values()))
        except Exception as error:
            rows[number]["failure"] = describe(error)
    used = _choose_clock(rows, clock)
    for row in rows:
        row["time"], row["spread"] = row[f"{used}_time"], row.pop(f"{used}_spread", None)
        row.pop("wall_spread", None)
        row.pop("processor_spread", None)
    for number in front(rows):
        rows[number]["front"] = True
    names = tuple(dict.fromkeys(name for numbers_ in found.values() for name in numbers_))
    words = "known values"
    if isinstance(reference, Finest):
        words = "the finest row, but none has finished"
        if which is not None:
            words = "the finest row: " + ", ".join(
                f"{k}={v!r}" for k, v in first[which].parameters.items()
            )
    return TradeOff(tuple(rows), parameters, names, used, words, name)


def _tell_finer(
    cases: Sequence[StudyCase], which: int, found: Mapping[int, Any], reference: Any
) -> None:
    """Warn where a finer row than the reference has failed."""
    for number, case in enumerate(cases):
        asked = all(case.parameters.get(k) == v for k, v in reference.row.items())
        if number in found or not asked or case.folder is None:
            continue
        with contextlib.suppress(Error, OSError):
            if (fineness(case)[0], fineness(case)[2]) < (
                fineness(cases[which])[0],
                fineness(cases[which])[2],
            ):
                warnings.warn(
                    f"a finer row than the reference has failed: {case.parameters}: {case.error}; "
                    f"the rows are compared with {cases[which].parameters}",
                    ModelWarning,
                    stacklevel=4,
                )


def _costs(case: StudyCase, repeats: Sequence[StudyCase]) -> Row:
    """Return what a case has cost, as far as its run has come."""
    if case.folder is None:
        return {}
    record = case.record
    made: Row = {k: record.get(k) for k in ("device", "precision", "pipeline", "threads")}
    made |= {k: record.get(k) for k in ("steps", "time_step", "particles")}
    made = {k: v for k, v in made.items() if v is not None and k not in case.parameters}
    made["case"] = case.hash
    if case.status != "finished":
        return made
    for clock, key in (("wall", "engine_time"), ("processor", "processor_time")):
        times = [t for t in (_per_second(c, key) for c in repeats) if t is not None]
        made[f"{clock}_time"] = min(times, default=None)
        if len(times) > 1 and min(times) > 0:
            made[f"{clock}_spread"] = max(times) / min(times) - 1
    with warned_already():
        plan = case.scene.plan(
            device=record["device"],
            precision=record["precision"],
            pipeline="auto" if case.scene.grid is not None else record["pipeline"],
        )
    made["memory"] = plan.memory_total
    made["bytes_per_particle"] = max(map(plan.bytes_per_particle, plan.bodies), default=None)
    made["energy_drift"] = energy_drift(case)
    return made


def _per_second(case: StudyCase, key: str) -> float | None:
    """Return seconds of a run's clock for a simulated second."""
    record = case.record
    spent, end = record.get(key), record.get("time")
    if case.status != "finished" or spent is None or end is None:
        return None
    start = case.scene.start
    begun = max(0.0 if start is None else start.time, float(record.get("resumed_at") or 0.0))
    return float(spent) / (end - begun) if end > begun else None


def _choose_clock(rows: Sequence[Row], clock: str) -> str:
    if clock != "auto":
        return clock
    ran = [row for row in rows if row["wall_time"] is not None]
    alone = all(row["device"] == "cpu" and row["threads"] == 1 for row in ran)
    timed = all(row["processor_time"] and math.isfinite(row["processor_time"]) for row in ran)
    return "processor" if ran and alone and timed else "wall"
