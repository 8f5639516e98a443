#!/usr/bin/env python3
"""Make the source distribution and compare its content with what git tracks.

    python tools/check_sdist.py [FOLDER]

Needs scikit-build-core, a checkout and no network. The file is left in FOLDER, by default `dist`.
It holds every tracked file except measurements (`benchmarks/results`), so that tests can be run and
documentation made from it, and nothing else but its metadata: what lies about in a working tree
fails the check.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = "benchmarks/results/"
MADE = {"PKG-INFO"}


def compare(packed: set[str], tracked: set[str]) -> list[str]:
    """Return what is wrong with the content, a line each."""
    wanted = {name for name in tracked if not name.startswith(LEFT_OUT)} | MADE
    return [
        *(f"the source distribution lacks {name}" for name in sorted(wanted - packed)),
        *(f"the source distribution holds {name}" for name in sorted(packed - wanted)),
    ]


def main(arguments: list[str]) -> int:
    """Run the tool; returns 1 where the content is not as it should be."""
    try:
        from scikit_build_core.build import build_sdist
    except ImportError:
        print("scikit-build-core is not installed; pip install 'scikit-build-core>=0.10'")
        return 1
    os.chdir(ROOT)  # where the builder and git look
    folder = ROOT / (arguments[0] if arguments else "dist")
    file = folder / build_sdist(str(folder))
    with tarfile.open(file) as archive:
        packed = {m.name.split("/", 1)[1] for m in archive.getmembers() if not m.isdir()}
    listing = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True, check=True)
    wrong = compare(packed, {name for name in listing.stdout.split("\0") if name})
    print("\n".join(wrong) or f"{file.name}: {len(packed)} files, {file.stat().st_size} bytes")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
