"""Counts fused instances in the built libraries and compares them with a checked-in figure.

usage: count_kernels.py BUILD [--figure FILE] [--update]

Every instance costs compile time and library size, so raising the figure (`--update`) is a reviewed
act; no backend may exceed the limit.
"""

import argparse
import json
import re
import subprocess
import sys
from pathlib import Path

FIGURE = Path(__file__).with_name("kernel_counts.json")
CODE = set("TtWwiI")  # symbol types that are code, ifunc included


def template_id(text: str, start: int) -> str:
    """`name<...>` starting at `start`, with its brackets balanced."""
    depth = 0
    for i in range(text.index("<", start), len(text)):
        depth += {"<": 1, ">": -1}.get(text[i], 0) if text[i - 1] != "-" else 0
        if depth == 0:
            return text[start : i + 1]
    return text[start:]


def instances(symbols: str, name: str, where: str = "") -> set[str]:
    """The distinct instances of function templates called `name` in `nm -C` output.

    `name` and `where` are regular expressions, the second for the whole of `name<...>`.

    Clones per instruction set, OpenMP bodies and lambdas count as the instance they belong to.
    """
    pattern = re.compile(rf"\b(?:{name})<")
    found = set()
    for line in symbols.splitlines():
        kind, _, text = line[17:].partition(" ")
        if kind in CODE and (match := pattern.search(text)):
            found.add(template_id(text, match.start()))
    return {instance for instance in found if re.search(where, instance)}


def count(library: Path, function: dict[str, str]) -> int:
    done = subprocess.run(["nm", "-C", library], capture_output=True, text=True, check=True)
    return len(instances(done.stdout, **function))


def objections(counts: dict[str, int], figure: dict) -> list[str]:
    """What is wrong with these counts."""
    wrong = []
    for backend, number in counts.items():
        stated = figure["instances"][backend]
        if number == 0:
            wrong.append(f"{backend}: no instance of {figure['function'][backend]} found")
        elif number > figure["limit"]:
            wrong.append(f"{backend}: {number} instances, over the limit of {figure['limit']}")
        elif number != stated:
            wrong.append(f"{backend}: {number} instances, the figure says {stated} (--update?)")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=Path, help="build folder holding libmpm_cpu.a, libmpm_cuda.a")
    parser.add_argument("--figure", type=Path, default=FIGURE)
    parser.add_argument("--update", action="store_true", help="write the counts into the figure")
    options = parser.parse_args()
    figure = json.loads(options.figure.read_text())
    counts = {}
    for backend, function in figure["function"].items():
        for library in sorted(options.build.rglob(f"libmpm_{backend}.a"))[:1]:
            counts[backend] = count(library, function)
    if not counts:
        sys.exit(f"no libmpm_*.a under {options.build}")
    if options.update:
        figure["instances"].update(counts)
        options.figure.write_text(json.dumps(figure, indent=2) + "\n")
    wrong = objections(counts, figure)
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    for backend, number in counts.items():
        print(f"{backend}: {number} fused instances of at most {figure['limit']}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
