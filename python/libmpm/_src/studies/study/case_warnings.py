"""What a study says once of its cases: their warnings, and frames that they lack."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

from libmpm._src.errors import ModelWarning
from libmpm._src.studies.study.shared_files import CASES

__all__ = ["tell_frames", "tell_warnings"]


def tell_warnings(records: Mapping[str, Mapping[str, Any]]) -> None:
    """Say once what the simulations of a study warned of."""
    texts = [text for record in records.values() for text in record.get("warnings") or ()]
    if texts:
        number = sum(bool(record.get("warnings")) for record in records.values())
        warnings.warn(
            f"{number} of {len(records)} simulations gave warnings, which their status.json keeps; "
            f"the first: {texts[0]}",
            ModelWarning,
            stacklevel=4,
        )


def tell_frames(records: Mapping[str, Mapping[str, Any]], interval: float | None) -> None:
    """Say that cases which had finished before lack the frames that are asked for now."""
    lacking = [
        key
        for key, record in records.items()
        if key.startswith(CASES)
        and record["status"] == "finished"
        and record.get("frame_interval") != interval
    ]
    if interval is not None and lacking:
        warnings.warn(
            f"{len(lacking)} cases had finished without frames every {interval:g} s, and are not "
            "run again for them; delete their folders, or choose another folder for the study",
            ModelWarning,
            stacklevel=4,
        )
