#!/usr/bin/env python3
"""Run tests with the oldest versions of the packages that pyproject.toml allows, or the newest.

    python tools/check_dependencies.py floor|newest [--package FOLDER] [--tests FILE...]

Makes an environment in build/deps-<which>, with every `name>=version` of the dependencies and of
the extras triangular, studies and mesh at that version (floor: the last patch of it), and runs the
tests there on a copy of the package in FOLDER, such as `.venv/lib/python3.11/site-packages`;
without it on the modules of this tree, which `cmake --preset cpu-release` has built in place.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
EXTRAS = ("triangular", "studies", "mesh")
TESTS = ("pytest>=8", "pytest-timeout>=2.3", "hypothesis>=6.100", "jsonschema>=4.20")
#: What touches the packages most: files, pictures, meshes, statistics.
FILES = (
    "checkpoint", "pictures", "sensor_file", "series", "mesh", "analysis", "demand", "export",
    "frames", "kill", "attack_findings",
)  # fmt: skip


def requirements(which: str) -> list[str]:
    """Return what is to be installed, in the words of pip."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = [*project["dependencies"], *TESTS]
    for extra in EXTRAS:
        stated += project["optional-dependencies"][extra]
    if which == "newest":
        return sorted(set(stated))
    lowest: dict[str, tuple[int, ...]] = {}
    for text in stated:
        found = re.fullmatch(r"([A-Za-z0-9_-]+)>=([0-9.]+)", text)
        if found is None:
            raise SystemExit(f"pyproject.toml has {text!r}; expected name>=version")
        version = tuple(map(int, found[2].split(".")))
        lowest[found[1]] = max(version, lowest.get(found[1], (0,)))
    return [f"{name}=={'.'.join(map(str, v))}.*" for name, v in sorted(lowest.items())]


def main() -> int:
    """Run the tool; returns the exit status of the tests."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("which", choices=("floor", "newest"))
    parser.add_argument("--tests", nargs="+", help="files of tests")
    parser.add_argument("--package", type=Path, help="where libmpm is installed")
    options = parser.parse_args()
    folder = ROOT / "build" / f"deps-{options.which}"
    venv.create(folder, clear=True, with_pip=True)
    python = str(folder / "bin/python")
    wanted = requirements(options.which)
    print(*wanted, sep="\n", flush=True)
    install = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *wanted]
    subprocess.run(install, check=True)
    tests = options.tests or [f"tests/python/test_{name}.py" for name in FILES]
    package = ROOT / "python"
    if options.package is not None:  # a copy, without the packages that lie beside it
        package = folder / "package"
        shutil.copytree(options.package / "libmpm", package / "libmpm")
    environment = os.environ | {"PYTHONPATH": str(package), "MPLBACKEND": "Agg"}
    run = [python, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    return subprocess.run(run, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
