"""Fails when a file includes something from a floor that its own floor may not see, or when a
function that is a call on a device does not begin with what keeps its warp together.

usage: check_floors.py [TREE]
"""

import argparse
import posixpath
import re
import sys
from pathlib import Path

# Each floor and the floors it sees besides itself.
SEES = {
    "core": set(),
    "physics": {"core"},
    "exec": {"core"},
    "data": {"core", "exec"},
    "kernels": {"core", "physics", "exec", "data"},
    "triangular": {"core", "physics", "exec", "data"},
    "io": {"core", "data"},
    "solver": {"core", "physics", "exec", "data", "kernels", "triangular", "io"},
    "bindings": {"core", "physics", "exec", "data", "kernels", "triangular", "io", "solver"},
}
BACKEND = re.compile(
    r"(?:cuda[\w/]*(?:\.h|\.hpp)?|cuda/.*|driver_types\.h|device_launch_parameters\.h|curand.*"
    r"|cooperative_groups.*|cub/.*|thrust/.*|nvtx3/.*|nccl\.h|omp\.h)$"
)
BINDING = re.compile(r"(?:pybind11/.*|Python\.h)$")
PURE = {"core", "physics"}  # compile with a plain C++ compiler and know no backend
INCLUDE = re.compile(r"^\s*#\s*include\s*[<\"]([^>\"]+)[>\"]")
# An MPM_CALL function up to its body and its first line: core/config.hpp says why.
CALLED = re.compile(r"^ *MPM_CALL\b[^;{]*\{\s*(?!const Reconverge at_return;)\S.*$", re.MULTILINE)
SUFFIXES = {".hpp", ".h", ".cuh", ".cpp", ".cu", ".inc", ".in"}


def floor_of(path: str) -> str | None:
    """The floor that a path inside the tree belongs to, or None when it belongs to none."""
    parts = path.split("/")
    if parts[:2] == ["python", "bindings"]:
        return "bindings"
    if parts[:2] == ["include", "mpm"]:
        return parts[2] if len(parts) > 3 else ""
    if parts[0] == "src":
        return parts[1] if len(parts) > 2 else ""
    return None


def included_floor(name: str, includer: str) -> str | None:
    """The floor of an included name: `mpm/...`, or a path relative to the including file."""
    if name.startswith("mpm/"):
        return floor_of("include/" + name)
    if "/" in name and name.split("/")[0] in SEES and name.split("/")[0] != "io":
        return name.split("/")[0]
    return floor_of(posixpath.normpath(posixpath.join(posixpath.dirname(includer), name)))


def objection(name: str, includer: str) -> str | None:
    """Why `includer` may not include `name`, or None when it may."""
    floor = floor_of(includer)
    target = included_floor(name, includer)
    if target is not None and target != floor and target not in SEES[floor]:
        allowed = ", ".join(sorted(SEES[floor])) or "nothing else"
        return f"{floor} may not see {target or 'files outside the floors'}; it sees {allowed}"
    if floor in PURE and BACKEND.match(name):
        return f"{floor} knows no backend"
    if floor != "bindings" and BINDING.match(name):
        return "pybind11 stays in python/bindings"
    return None


def check(tree: Path) -> list[str]:
    """One line for each offence in the tree."""
    offences = []
    for top in ("include/mpm", "src", "python/bindings"):
        for file in sorted((tree / top).rglob("*")):
            if file.suffix not in SUFFIXES or not file.is_file():
                continue
            path = file.relative_to(tree).as_posix()
            if floor_of(path) not in SEES:
                offences.append(f"{path}: lies in no floor ({', '.join(SEES)})")
                continue
            text = file.read_text(encoding="utf-8")
            for call in CALLED.finditer(text):
                number = text.count("\n", 0, call.start()) + 1
                offences.append(f"{path}:{number}: begins without `const Reconverge at_return;`")
            for number, line in enumerate(text.splitlines(), 1):
                found = INCLUDE.match(line)
                why = found and objection(found[1], path)
                if why:
                    offences.append(f"{path}:{number}: includes {found[1]}: {why}")
    return offences


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=Path(__file__).parents[1])
    offences = check(parser.parse_args().tree)
    print("\n".join(offences), file=sys.stderr, end="\n" if offences else "")
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main())
