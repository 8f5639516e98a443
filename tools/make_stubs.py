"""Writes the type stubs of the compiled modules, or checks that the committed ones are current.

usage: make_stubs.py [--check] [MODULE...]

The modules must be importable. `_core` alone is written unless others are named.
"""

import argparse
import difflib
import subprocess
import sys
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "python" / "libmpm"


def generate(module: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pybind11_stubgen", f"libmpm.{module}", "-o", folder]
        subprocess.run([*command, "--numpy-array-use-type-var", "--exit-code"], check=True)
        text = (Path(folder) / "libmpm" / f"{module}.pyi").read_text()
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    parser.add_argument("modules", nargs="*", default=["_core"])
    options = parser.parse_args()
    stale = 0
    for module in options.modules:
        target = PACKAGE / f"{module}.pyi"
        text = generate(module)
        if not options.check:
            target.write_text(text)
            continue
        committed = target.read_text() if target.exists() else ""
        if committed != text:
            stale += 1
            lines = committed.splitlines(), text.splitlines()
            difference = difflib.unified_diff(*lines, str(target), "the built module", lineterm="")
            print("\n".join(difference), file=sys.stderr)
            print(f"{target} is stale: run tools/make_stubs.py", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
