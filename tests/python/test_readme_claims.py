"""What the README says things take is compared with what they took.

Expected duration: 1 s.
"""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def said(*rows):
    command = [sys.executable, ROOT / "tools/readme_claims.py", *rows]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_every_row_that_ci_measures_is_in_the_readme():
    script = (ROOT / ".ci/run").read_text(encoding="utf-8")
    rows = [line.split('claims+=("')[1].split("=")[0] for line in script.splitlines()
            if 'claims+=("' in line]  # fmt: skip
    assert len(rows) == 3
    done = said(*(f"{row}=60" for row in rows))
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("README") >= 3


def test_a_row_that_is_not_there_fails_and_a_far_time_is_marked():
    assert said("make coffee=60").returncode == 1
    assert "correct the README" in said("pytest=60000").stdout
    assert "correct the README" not in said("pytest=600").stdout
