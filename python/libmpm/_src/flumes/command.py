"""`libmpm flume`: a facility at a level, continued from where its run stands, and compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from libmpm._src.base.arguments import path_option
from libmpm._src.errors import SceneError

if TYPE_CHECKING:
    from libmpm._src.flumes.facility import Facility

__all__ = ["add_arguments", "facility_of", "keep", "report", "table"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what says which facility, in which set-up, at which level."""
    parser.add_argument("name", help="lwf, dwb, waseda, usgs or wasirf")
    parser.add_argument(
        "--case", help="set-up that was measured, such as box or hdpe; default: the level's own"
    )
    parser.add_argument(
        "--level", help="reduced, quick, laptop or full; default: that of the case, or laptop"
    )
    parser.add_argument("--cell-size", type=float, help="m; default: the level's")
    parser.add_argument("--debris", help="name of a layout; default: the level's")
    parser.add_argument(
        "--seed", type=int, help="of small shifts of the debris: repeats of one set-up"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=path_option,
        help="folder; a run that was interrupted there continues",
    )
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results")
    parser.add_argument(
        "--table", action="store_true",
        help="run nothing: print all rows of all set-ups, with the numbers of the run in the "
        "folder, or of the runs in its folders",
    )  # fmt: skip


def facility_of(arguments: argparse.Namespace) -> Facility:
    """Return the facility that was asked for; raises `SceneError`."""
    from libmpm.flumes import named

    names = ("cell_size", "debris", "seed")
    changes = {name: getattr(arguments, name) for name in names}
    changes = {name: item for name, item in changes.items() if item is not None}
    kind = named(arguments.name)
    if arguments.case is not None:
        made: Facility = kind.of_case(arguments.case, arguments.level, **changes)
        return made
    made = kind.at_level("laptop" if arguments.level is None else arguments.level, **changes)
    return made


def keep(facility: Facility, folder: Path, case: str, overwrite: bool) -> None:
    """Write into a folder which flume is run there; raises `SceneError` where it is another."""
    from libmpm._src.flumes.collection import RECORD, recall, remember

    if not overwrite and (folder / RECORD).is_file():
        found = recall(folder)
        if found is not None and found[0] != facility:
            raise SceneError(
                f"{folder} holds a run of another set-up or level of {found[0].title}; expected "
                "the one asked for; choose another folder, or pass --overwrite"
            )
    remember(facility, folder, case)


def table(name: str, folder: Path | None) -> str:
    """Return all rows of all set-ups of a facility, with the numbers of the runs in a folder.

    Writes table.csv and table.png there.
    """
    from libmpm._src.output.atomic_files import replacing
    from libmpm.flumes import collect, named

    kind = named(name)
    if folder is None:
        return str(collect(kind))
    found = collect(kind, [folder])
    found.to_csv(folder / "table.csv")
    with replacing(folder / "table.png") as part:
        found.figure().savefig(part, format="png", dpi=130)
    return f"{found}\nwritten: {folder / 'table.csv'}, {folder / 'table.png'}"


def report(facility: Facility, folder: Path, case: str) -> str:
    """Return the table of a run; write comparison.csv and comparison.png beside it."""
    from libmpm._src.output.atomic_files import replacing

    found = facility.compare(folder, case=case)
    found.to_csv(folder / "comparison.csv")
    with replacing(folder / "comparison.png") as part:
        found.figure().savefig(part, format="png", dpi=130)
    return f"{found}\nwritten: {folder / 'comparison.csv'}, {folder / 'comparison.png'}"
