"""A study of a few cases for `attack.studies`: ``python study_script.py FOLDER``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import libmpm
from attack.kills import SCENES

UNTIL = 0.3
ROWS = [{"gravity": 9.0 + i} for i in range(4)]


def puddle(gravity: float) -> libmpm.Scene:
    """Return the puddle of the kills under another gravity."""
    document = SCENES["puddle"][0]().to_dict()
    return libmpm.Scene.from_dict(document | {"gravity": [0.0, -gravity]})


def largest(case: Any) -> dict[str, float]:
    """Return a number that depends on every bit of a run."""
    return {"sum": float(case.sensors["energy"].values.sum())}


def study(folder: Path) -> libmpm.Study:
    """Return the study of a folder."""
    return libmpm.Study(
        folder, puddle, ROWS, until=UNTIL, response=largest, checkpoint_interval=UNTIL / 8
    )


if __name__ == "__main__":
    made = study(Path(sys.argv[1]))
    result = made.run(workers=2, device="cpu", progress=False, attempts=1000)
    sys.exit(1 if result.failed else 0)
