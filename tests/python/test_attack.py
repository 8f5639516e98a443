"""A few cases of every attack of `python -m tests.attack`. Expected duration: 20 s."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from attack.base import Attack, Defect, run_cases
from attack.catalogue import ATTACKS

#: Attack -> cases; those that take tens of seconds each are marked slow.
FEW = {
    "inputs": 12,
    "values": 300,
    "forged": 5,
    "folders": 2,
    "kills": 1,
    "studies": 1,
    "messages": 1,
}
SLOW = ("studies", "messages")
#: What is known to show defects is run here only to see that the attack itself works.
OPEN = ("forged", "inputs", "values", "folders", "kills")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n in SLOW else n for n in FEW]
)
def test_a_few_cases_of_every_attack(name, tmp_path):
    folder = tmp_path / "attack"
    call = [sys.executable, "-m", "tests.attack", "--minutes", "4", "--only", name]
    call += ["--cases", str(FEW[name]), "--folder", str(folder)]
    found = subprocess.run(
        call, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=False
    )
    if "left out" in found.stdout:
        pytest.skip(found.stdout)
    said = found.stdout + found.stderr
    assert f"{name}: {FEW[name]} cases" in said, said
    assert found.returncode == 0 or (name in OPEN and "defect:" in said), said


class _Bad(Attack):
    """Every way in which a case may go wrong."""

    name = "bad"
    limit = 1.0
    batch = 10

    def case(self, seed, number, room):
        import os
        import time

        if number == 1:
            raise Defect("a wrong bit")
        if number == 2:
            raise KeyError("raw")
        if number == 3:
            os.abort()
        if number == 4:
            time.sleep(30)
        return {"well": 1}


def test_crashes_hangs_and_raw_errors_are_seen_and_kept(tmp_path):
    attack, kept, found = _Bad(tmp_path), tmp_path / "kept", []
    for first in ((0, 1, 2, 3), (4,), (5,)):
        found += run_cases(attack, "s", iter(first), tmp_path / "room", kept)
    assert [r.defect.splitlines()[0] if r.defect else "" for r in found] == [
        "", "a wrong bit", "KeyError: 'raw'", "crash: SIGABRT", "hang: no answer in 1 s", "",
    ]  # fmt: skip
    assert sorted(p.name for p in kept.iterdir()) == [f"bad-s-{n}" for n in (1, 2, 3, 4)]
    assert list(ATTACKS) == [
        "kills",
        "studies",
        "inputs",
        "values",
        "forged",
        "messages",
        "folders",
    ]
