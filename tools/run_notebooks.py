#!/usr/bin/env python3
"""Run notebooks of the documentation and keep their outputs, for readers without a build.

    python tools/run_notebooks.py [NOTEBOOK...]    all of docs/ without names

What differs from run to run (counts of executions, times, identities of objects) is left out. Pages
built by `.ci/run` show these outputs; `.ci/run deep` runs the notebooks again, and decides.
"""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[1]
#: Widgets and pages of their own are left to the build.
KEPT = ("text/plain", "text/html", "image/png")


def run(path: Path) -> None:
    """Run one notebook in its folder, and write it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    resources = {"metadata": {"path": str(path.parent)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)
        if cell.cell_type != "code":
            continue
        cell.execution_count = None
        kept = []
        for output in cell.outputs:
            if output.output_type == "stream" and output.name == "stderr":
                continue
            if "execution_count" in output:
                output.execution_count = None
            if "data" in output:
                output.data = {k: v for k, v in output.data.items() if k in KEPT}
                text = output.data.get("text/plain", "")
                output.data["text/plain"] = re.sub(r" at 0x[0-9a-f]+", "", text)
            kept.append(output)
        cell.outputs = kept
    notebook.metadata.get("language_info", {}).pop("version", None)
    info = notebook.metadata.get("language_info", {})
    notebook.metadata["language_info"] = {"name": info.get("name", "python")}
    nbformat.write(notebook, path)
    print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1024:.0f} kB")


def main(names: list[str]) -> int:
    """Run those that are named, or all."""
    os.environ.pop("MPLBACKEND", None)
    os.environ["PYTHONPATH"] = str(ROOT / "python")
    paths = [Path(name).resolve() for name in names] or sorted(ROOT.glob("docs/**/*.ipynb"))
    for path in paths:
        run(path)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
