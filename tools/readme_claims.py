#!/usr/bin/env python3
"""Print what the README says things take beside what they took.

    python tools/readme_claims.py "build and install, CPU and CUDA=812" "pytest=640"

Each argument is the beginning of a row of the README's table of times, with seconds. Rows are found
or the tool fails, so that the table and CI keep speaking of the same things; times that differ by
more than a factor of 2 are marked, and decide nothing. Rows that nobody measured are listed.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

README = Path(__file__).resolve().parents[1] / "README.md"
ROW = re.compile(r"^\| (.+?) \| (?:about )?([0-9.]+) min \|$", re.MULTILINE)


def claims() -> dict[str, float]:
    """Return the rows of the README's table, without marks of code, with their minutes."""
    text = README.read_text(encoding="utf-8")
    return {name.replace("`", ""): float(minutes) for name, minutes in ROW.findall(text)}


def main(arguments: list[str]) -> int:
    """Print the comparison; returns 1 for a row that the README does not have."""
    stated, missing = claims(), 0
    left = dict(stated)
    for argument in arguments:
        name, _, seconds = argument.rpartition("=")
        rows = [row for row in stated if row.startswith(name)]
        if len(rows) != 1:
            print(f"README has {len(rows)} rows that begin with {name!r}; there are {[*stated]}")
            missing = 1
            continue
        took, claimed = float(seconds) / 60, left.pop(rows[0], stated[rows[0]])
        mark = "" if 0.5 <= took / claimed <= 2 else "  <- correct the README"
        print(f"{took:6.1f} min, README {claimed:g} min: {rows[0]}{mark}")
    for row, claimed in left.items():
        print(f"not measured, README {claimed:g} min: {row}")
    return missing


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
