"""`Collection`: all rows of a facility: of its set-ups, and of several runs of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import from_plain, shown
from libmpm._src.errors import Error, SceneError
from libmpm._src.flumes.comparison import HEAD, Comparison, Row, Table, blank, compare, median_of
from libmpm._src.output.atomic_files import write_json, writing

if TYPE_CHECKING:
    from libmpm._src.flumes.facility import Facility
    from libmpm._src.flumes.records import Curve
    from libmpm._src.output.results import Results
    from libmpm._src.pictures.figures import Picture

__all__ = ["RECORD", "Collection", "collect", "recall", "remember", "runs_in"]

#: File in a run's folder that says which facility was run.
RECORD = "flume.json"

_HEAD = ("set-up", *HEAD)


def remember(facility: Facility, folder: Path, case: str) -> None:
    """Write which facility and set-up a folder holds. Raises `OutputError`."""
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RECORD, {"case": case, "facility": facility.to_dict()})


def recall(folder: Path) -> tuple[Facility, str] | None:
    """Return the facility and the name of the set-up of a run's folder; None where it has none."""
    import json

    from libmpm._src.flumes.facility import Facility

    path = folder / RECORD
    if not path.is_file():
        return None
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        facility, case = from_plain(found["facility"]), found["case"]
    except (OSError, ValueError, LookupError, TypeError, Error) as error:
        raise SceneError(f"{path}: does not say which flume was run: {error}; expected what "
                         "`libmpm flume` has written") from error  # fmt: skip
    if not isinstance(facility, Facility) or not isinstance(case, str):
        raise SceneError(f"{path}: is about {shown(facility)}; expected a facility and the name of "
                         "a set-up, as `libmpm flume` has written them")  # fmt: skip
    return facility, case


def runs_in(folder: Path) -> list[Path]:
    """Return the folder if it is that of a run, else the runs in it, by name."""
    if (folder / RECORD).is_file():
        return [folder]
    found = sorted(p.parent for p in folder.glob(f"*/{RECORD}"))
    if not found:
        raise SceneError(f"{folder}: holds no run of a flume; expected the folder of one, or a "
                         "folder of such folders")  # fmt: skip
    return found


@dataclass(frozen=True, eq=False)
class Collection(Table):
    """All rows of a facility: of every set-up that was measured, run or not; prints as a table."""

    kind: type[Facility]
    rows: tuple[Row, ...]
    comparisons: tuple[Comparison, ...]

    def _texts(self) -> list[tuple[str, ...]]:
        return [(row.case, *row.texts()) for row in self.rows]

    def _head(self) -> tuple[str, ...]:
        return _HEAD

    def __str__(self) -> str:
        """Return facility, table and how many rows have which verdict."""
        verdicts = [row.verdict for row in self.rows]
        counts = [f"{verdicts.count(v)} {v}" for v in dict.fromkeys(verdicts)]
        return f"{self.kind.title}\n{self.table()}\n{len(verdicts)} rows: {', '.join(counts)}"

    def figure(self) -> Picture:
        """Return what was simulated over what was measured, with the line of equality.

        One point a row that has both numbers, in parts of the measured one: bars are tolerances
        and the spread of several runs.
        """
        from libmpm._src.pictures.flume_drawings import ratios

        return ratios(self)


def _load(folder: Path) -> Results:
    from libmpm._src.output.results import load

    return load(folder)


@keywords_only("flumes.collect", 2, method=False)
def collect(
    kind: type[Facility],
    folders: Sequence[str | Path] = (),
    *,
    curves: Mapping[str, Curve] | None = None,
) -> Collection:
    """Return all rows of a facility, of the runs in folders and "not run" of what was not.

    Each folder is that of a run of `libmpm flume`, or holds such folders. Several runs of one
    set-up that differ in `seed` alone are one row with median and spread. `curves` are measured
    curves by instrument, as of `Facility.compare`. Raises `SceneError` where a folder holds another
    facility's run.
    """
    groups: dict[str, list[Comparison]] = {}
    cases: dict[str, str] = {}
    for folder in [run for one in folders for run in runs_in(Path(one))]:
        found = recall(folder)
        assert found is not None
        facility, case = found
        if type(facility) is not kind:
            raise SceneError(f"{folder}: holds a run of {facility.title}; expected {kind.title}")
        plain = {k: v for k, v in facility.to_dict().items() if k != "seed"}
        key = repr(plain)
        known = {i.name for i in facility.instruments()}
        given = {k: v for k, v in (curves or {}).items() if k in known}
        one = compare(facility, _load(folder), given, case, strict=False)
        groups.setdefault(key, []).append(one)
        cases[key] = case
    comparisons = tuple(median_of(group) for group in groups.values())
    rows = [row for one in comparisons for row in one.rows]
    done = {(row.id, row.quantity) for row in rows if row.simulated is not None}
    rows = [row for row in rows if row.simulated is not None or (row.id, row.quantity) not in done]
    seen = {(row.id, row.quantity) for row in rows}
    ran = set(cases.values())
    for case in kind.cases:
        for row in blank(kind.of_case(case), case).rows:
            key2 = (row.id, row.quantity)
            if key2 not in seen and case not in ran:
                rows.append(row)
                seen.add(key2)
    rows += kind.joint_rows(comparisons)
    rows.sort(key=lambda r: (r.id[:1], int(r.id[1:]) if r.id[1:].isdigit() else 0))
    return Collection(kind, tuple(rows), comparisons)
