"""Broken messages between rank processes: the C++ fuzzers, under the sanitizers where built so."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

from attack.base import Attack, Defect

__all__ = ["Messages"]

_ROOT = Path(__file__).parents[2]
#: Programs of the C++ tests; the first build that has one is taken.
_PROGRAM = "test_solver_rank_fuzz"
_BUILDS = ("build/asan", "build/cp3*", "build/cpu-release", "build/*")
#: Messages of a case.
_MANY = 20_000


class Messages(Attack):
    """Real messages of a run with ranks, changed."""

    name = "messages"
    what = "changed messages between ranks, read and used"
    unit = "messages"
    share = 1.0
    limit = 600.0

    def absent(self) -> str:
        """Return why there is no program to run."""
        return "" if _program() else f"{_PROGRAM} is not built (cmake --preset asan, mpm_tests)"

    def case(self, seed: str, number: int, room: Path) -> Mapping[str, int]:
        """Run the program with a seed that follows from the case."""
        program = _program()
        assert program is not None
        chosen = self.rng(seed, number).randrange(1, 2**31)
        self.note(room, seed_of_program=chosen, program=str(program))
        environment = os.environ | {
            "LIBMPM_FUZZ_MESSAGES": str(_MANY), "LIBMPM_FUZZ_SEED": str(chosen),
            "ASAN_OPTIONS": "detect_stack_use_after_return=1:strict_init_order=1",
            "UBSAN_OPTIONS": "print_stacktrace=1",
        }  # fmt: skip
        found = subprocess.run(
            [program], env=environment, cwd=room, capture_output=True, text=True, check=False,
            errors="replace",
        )  # fmt: skip
        if found.returncode:
            raise Defect(f"exit code {found.returncode}\n{(found.stdout + found.stderr)[-4000:]}")
        sanitized = "under the sanitizers" if "asan" in program.parts else "without sanitizers"
        counts = re.findall(r"(\d+) refused +(\d+) read", found.stdout)
        counted = sum(int(refused) + int(read) for refused, read in counts)
        return {f"messages {sanitized}": counted}


def _program() -> Path | None:
    for build in _BUILDS:
        for path in sorted(_ROOT.glob(f"{build}/**/{_PROGRAM}")):
            if os.access(path, os.X_OK):
                return path
    return None
