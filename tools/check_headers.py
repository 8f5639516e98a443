"""Compiles every header alone with a plain C++ compiler (.cuh files are left out).

usage: check_headers.py [TREE] [--compiler g++] [--isystem DIR] [--include DIR] [--all]

A header that a unit of the build includes first has been compiled alone there, with the same
warnings: without `--all` it is not compiled again. An installation compiles some units together
(LIBMPM_TOGETHER); the build with sanitizers has each alone.
"""

import argparse
import os
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FLAGS = ["-std=c++20", "-fsyntax-only", "-fopenmp", "-Wall", "-Wextra", "-Werror", "-Wno-psabi"]
UNITS = ("src", "tests/cpp", "python/bindings")


def first_includes(tree: Path) -> set[str]:
    """What the units of the host begin with."""
    units = [unit for folder in UNITS for unit in (tree / folder).rglob("*.cpp")]
    found = (re.search(r"^#include (.*)", unit.read_text("utf-8"), re.M) for unit in units)
    return {line[1].strip('<>"') for line in found if line}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--compiler", default="g++")
    parser.add_argument("--isystem", action="append", default=[], help="where Eigen lies")
    parser.add_argument("--include", action="append", default=[])
    parser.add_argument("--all", action="store_true", help="also those that units include first")
    options = parser.parse_args()
    include = options.tree / "include"
    headers = sorted(include.rglob("*.hpp"))
    if not headers:
        sys.exit(f"no headers under {include}")
    known = set() if options.all else first_includes(options.tree)
    found = len(headers)
    headers = [h for h in headers if h.relative_to(include).as_posix() not in known]
    # As cmake/MpmFlags.cmake has them for every unit; no header depends on the value.
    definitions = ["-DEIGEN_MAX_STATIC_ALIGN_BYTES=16", '-DLIBMPM_VERSION="0"']
    command = [options.compiler, *FLAGS, *definitions, f"-I{include}"]
    command += [f"-I{folder}" for folder in options.include]
    command += [flag for folder in options.isystem for flag in ("-isystem", folder)]

    def compiles(header: Path) -> str:
        text = f'#include "{header.relative_to(include).as_posix()}"\n'
        done = subprocess.run(
            [*command, "-x", "c++", "-"], input=text, capture_output=True, text=True, check=False
        )
        return "" if done.returncode == 0 else f"{header}: does not compile alone\n{done.stderr}"

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        failures = [text for text in pool.map(compiles, headers) if text]
    print("".join(failures), file=sys.stderr, end="")
    print(
        f"{len(headers) - len(failures)} of {len(headers)} headers compile alone"
        + (f"; units begin with the other {found - len(headers)}" if known else "")
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
