"""Compiles every header alone with a plain C++ compiler (.cuh files are left out).

usage: check_headers.py [TREE] [--compiler g++] [--isystem DIR] [--include DIR]
"""

import argparse
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FLAGS = ["-std=c++20", "-fsyntax-only", "-fopenmp", "-Wall", "-Wextra", "-Werror", "-Wno-psabi"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tree", nargs="?", type=Path, default=Path(__file__).parents[1])
    parser.add_argument("--compiler", default="g++")
    parser.add_argument("--isystem", action="append", default=[], help="where Eigen lies")
    parser.add_argument("--include", action="append", default=[])
    options = parser.parse_args()
    include = options.tree / "include"
    headers = sorted(include.rglob("*.hpp"))
    if not headers:
        sys.exit(f"no headers under {include}")
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
    print(f"{len(headers) - len(failures)} of {len(headers)} headers compile alone")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
