"""``status.json`` and ``response.json`` of a case, as far as they can be believed.

Nothing in them is worth more than the run that they speak of: a damaged one counts as none, and the
case runs again, to the same results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from libmpm._src.base.values import deeper_than
from libmpm._src.studies.study.shared_files import RESPONSE, STATUS, glance, read_object

__all__ = ["glance_record", "glance_responses", "is_row", "read_record", "read_responses"]

#: Levels of lists in the values of a row.
_DEPTH = 50


def _text(x: Any) -> bool:
    return isinstance(x, str)


def _number(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and -1e300 < x < 1e300


def _count(x: Any) -> bool:
    return isinstance(x, int) and not isinstance(x, bool) and 0 <= x < 1 << 63


def _texts(x: Any) -> bool:
    return isinstance(x, list) and all(isinstance(text, str) for text in x)


def is_row(x: Any) -> bool:
    """Tell whether `x` may be the parameters of a row."""
    return isinstance(x, dict) and not deeper_than(x, _DEPTH)


def _fields(kind: Callable[[Any], bool], names: str) -> dict[str, Callable[[Any], bool]]:
    return dict.fromkeys(names.split(), kind)


#: Field -> what its value must be; None stands for one that is not known.
_RECORD = (
    _fields(_text, "error hash token study_run began ended heartbeat host device precision version")
    | _fields(_text, "pipeline")
    | _fields(_count, "attempt pid first_step threads steps particles displaced")
    | _fields(_number, "resumed_at until frame_interval wall_time engine_time processor_time")
    | _fields(_number, "time_step time particle_steps_per_s")
    | _fields(_texts, "warnings")
)
_STATUSES = ("running", "interrupted", "finished", "failed")


def _whole_record(found: Mapping[str, Any]) -> bool:
    """Tell whether this is what a case or trunk writes."""
    if not _text(found.get("status")) or found["status"] not in _STATUSES:
        return False
    known = ((kind, found.get(name)) for name, kind in _RECORD.items())
    return all(x is None or kind(x) for kind, x in known)


def read_record(folder: Path) -> dict[str, Any]:
    """Return the content of ``status.json``; empty if there is none, or none that is whole.

    Raises `OutputError` where it cannot be read.
    """
    found = read_object(folder / STATUS)
    return found if _whole_record(found) else {}


def glance_record(folder: Path) -> dict[str, Any]:
    """Return the same for what only looks; empty where it cannot be read."""
    found = glance(folder / STATUS)
    return found if _whole_record(found) else {}


def read_responses(folder: Path) -> list[dict[str, Any]]:
    """Return the rows of ``response.json`` that are whole; raises `OutputError`."""
    return list(_rows(read_object(folder / RESPONSE)))


def glance_responses(folder: Path) -> list[dict[str, Any]]:
    """Return the same for what only looks."""
    return list(_rows(glance(folder / RESPONSE)))


def _rows(found: Mapping[str, Any]) -> Iterable[dict[str, Any]]:
    rows = found.get("rows")
    for row in rows if isinstance(rows, list) else ():
        if not isinstance(row, dict) or not is_row(row.get("parameters")):
            continue
        values = row.get("response")
        if isinstance(values, dict) and all(map(_answer, values.values())):
            yield row


def _answer(x: Any) -> bool:
    """Tell whether `x` is a number of a response, or the word for one that is not finite."""
    if isinstance(x, str):
        return x in ("inf", "-inf", "nan")
    finite = not isinstance(x, float) or math.isfinite(x)
    return x is None or (isinstance(x, bool | int | float) and finite)
