"""How a study stands, for terminals."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from libmpm._src.studies.study.case import StudyCase

__all__ = ["StudyStatus"]

_STATUSES = ("planned", "running", "interrupted", "finished", "failed")


@dataclass(frozen=True, repr=False)
class StudyStatus:
    """How the rows of a study stand; prints as text. Made by `Study.status`."""

    folder: Path
    """The study's folder."""
    cases: tuple[StudyCase, ...]
    """One case a row."""
    trunks: tuple[StudyCase, ...] = ()
    """What the cases share, of the same form."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of rows that are planned, running, interrupted, finished and failed."""
        found = Counter(case.status for case in self.cases)
        return {status: found[status] for status in _STATUSES}

    def __repr__(self) -> str:
        """Return the counts, what runs, and why what failed did."""
        counted = ", ".join(f"{n} {status}" for status, n in self.counts.items() if n)
        lines = [f"{self.folder}: {len(self.cases)} rows" + (f": {counted}" if counted else "")]
        lines += [f"trunk {_running(case)}" for case in self.trunks if case.status == "running"]
        shown: set[str] = set()
        for case in self.cases:
            if case.hash and case.hash in shown:
                continue
            shown.add(case.hash)
            if case.status == "running":
                lines.append(_running(case))
            elif case.status == "failed":
                lines.append(f"failed {case.hash or 'without a folder'}: {case.error}")
        return "\n".join(lines)


def _running(case: StudyCase) -> str:
    record = case.record
    time, until = (record.get(name) or 0.0 for name in ("time", "until"))
    device, host, pid, beat = (
        record.get(name) or "?" for name in ("device", "host", "pid", "heartbeat")
    )
    return (
        f"running {case.hash}: {time:.4g} of {until:.4g} s on {device} of {host}, process {pid}, "
        f"last heard of {beat}"
    )
