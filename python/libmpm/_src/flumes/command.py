"""`libmpm flume`: a facility at a level, run on from where it stands, and compared."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from libmpm._src.flumes.facility import Facility

__all__ = ["add_arguments", "facility_of", "report"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what says which facility, at which level."""
    parser.add_argument("name", help="lwf, dwb, waseda, usgs or wasirf")
    parser.add_argument("--level", default="laptop", help="reduced, quick, laptop or full")
    parser.add_argument("--cell-size", type=float, help="m; default: the level's")
    parser.add_argument("--debris", help="name of a layout; default: the level's")
    parser.add_argument(
        "-o", "--output", type=Path, help="folder; a run that was interrupted there continues"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace earlier results")
    parser.add_argument(
        "--table", action="store_true",
        help="run nothing: print all rows, of the run in the folder where one is named",
    )  # fmt: skip


def facility_of(arguments: argparse.Namespace) -> Facility:
    """Return the facility that was asked for; raises `SceneError`."""
    from libmpm.flumes import named

    changes = {"cell_size": arguments.cell_size, "debris": arguments.debris}
    changes = {name: item for name, item in changes.items() if item is not None}
    made: Facility = named(arguments.name).at_level(arguments.level, **changes)
    return made


def report(facility: Facility, folder: Path | None) -> str:
    """Return the table of a run; write comparison.csv and comparison.png beside it."""
    from libmpm._src.flumes.comparison import blank
    from libmpm._src.output.atomic_files import replacing

    if folder is None:
        return str(blank(facility))
    found = facility.compare(folder)
    found.to_csv(folder / "comparison.csv")
    with replacing(folder / "comparison.png") as part:
        found.figure().savefig(part, format="png", dpi=130)
    return f"{found}\nwritten: {folder / 'comparison.csv'}, {folder / 'comparison.png'}"
