"""The laws of the method beside what small scenes measure of them.

    python benchmarks/laws.py run --output benchmarks/results/laws.jsonl
    python benchmarks/laws.py table       prints the tables of the lines in --output
    python benchmarks/laws.py write       puts them into docs/laws.md
    python benchmarks/laws.py check       exit 1 if that page is out of date

One JSON line for every point of `laws_measured`: what was chosen, what the law predicts, what was
measured and, as `refined`, what the law says with its next terms. On a CPU in double precision with
one thread; two minutes. `run` begins the file anew.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
import warnings
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

from laws_measured import POINTS
from result_pages import Line, filled, load, markdown

import libmpm
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/laws.jsonl"
PAGE = ROOT / "docs/laws.md"
BEGIN, END = "<!-- tables: benchmarks/laws.py write -->", "<!-- end of tables -->"

Column = tuple[str, Callable[[Line], str]]


def run(arguments: argparse.Namespace) -> int:
    """Measure all points, or those of some laws, and write the file."""
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    common = {
        "device_kind": "cpu", "precision": "double", "threads": 1, "commit": bench.commit(),
        "version": libmpm.__version__,
        "command": shlex.join(["python", "benchmarks/laws.py", *sys.argv[1:]]),
    }  # fmt: skip
    kept = [line for line in load(arguments.output) if arguments.laws]
    lines = [line for line in kept if line["law"] not in arguments.laws]
    for point in POINTS:
        if arguments.laws and point.law not in arguments.laws:
            continue
        began = time.process_time()
        found = point.measure(point.chosen)
        line: Line = {"law": point.law, "chosen": point.chosen, **found}
        lines.append(line | {"processor_s": round(time.process_time() - began, 2)} | common)
        deviation = found["measured"] / found["predicted"] - 1
        print(f"{point.law}: {point.chosen}: {found['measured']:.4g}, {deviation:+.2%}", flush=True)
    order = list(dict.fromkeys(point.law for point in POINTS))
    lines.sort(key=lambda line: order.index(line["law"]))
    text = "".join(json.dumps(line) + "\n" for line in lines)
    arguments.output.parent.mkdir(parents=True, exist_ok=True)
    arguments.output.write_text(text, encoding="utf-8")
    return 0


# ---- tables -------------------------------------------------------------------------------------


def chosen(name: str, default: Any = "") -> Callable[[Line], str]:
    """Return a column of what was chosen."""

    def read(line: Line) -> str:
        value = line["chosen"].get(name, default)
        return f"{value:g}" if isinstance(value, float) else str(value)

    return read


def number(name: str, how: str = ".4g") -> Callable[[Line], str]:
    """Return a column of a number."""
    return lambda line: format(line[name], how) if name in line else "–"


def beside(name: str) -> Callable[[Line], str]:
    """Return a column of the deviation of what was measured from a number."""

    def read(line: Line) -> str:
        if name not in line:
            return "–"
        text = f"{line['measured'] / line[name] - 1:+.2%}"
        return text if any(c in "123456789" for c in text) else "0.00%"

    return read


def _method(line: Line) -> str:
    return f"{line['chosen']['transfer']}{', F-bar' if line['chosen']['fbar'] else ''}"


_DEVIATIONS: tuple[Column, ...] = (
    ("law", number("predicted")), ("measured", number("measured")), ("off", beside("predicted")),
)  # fmt: skip
_REFINED: tuple[Column, ...] = (
    ("with its next terms", number("refined")), ("off ", beside("refined")),
)  # fmt: skip

TABLES: tuple[tuple[str, Callable[[Line], bool], Sequence[Column]], ...] = (
    (
        "Smoothing length of two volumes, ℓ/Δx = ½ √(ψ/(1-ψ))",
        lambda line: line["law"] == "smoothing" and "one" not in line["chosen"]["form"],
        (
            ("form", chosen("form")), ("ψ", chosen("ratio")), ("wave, cells", chosen("wave")),
            ("cΔt/Δx, 1e-6", chosen("step")), *_DEVIATIONS, *_REFINED,
        ),
    ),
    (
        "One volume: part that a step takes, in (kΔx)², law ψ/4, and with the gradient in (kΔx)⁴, "
        "law ψ/40",
        lambda line: line["law"] == "smoothing" and "one" in line["chosen"]["form"],
        (
            ("form", chosen("form")), ("ψ", chosen("ratio")), ("wave, cells", chosen("wave")),
            ("cΔt/Δx, 1e-6", chosen("step")), *_DEVIATIONS, *_REFINED,
        ),
    ),
    (
        "Loss in one cycle: (kΔx)²/4 of PIC, (kΔx)⁴/40 of APIC, times 1 - α",
        lambda line: line["law"] == "loss" and "cell_size" not in line["chosen"],
        (
            ("transfer", chosen("scheme")), ("α", chosen("flip", 0)),
            ("wave, cells", chosen("wave")), ("particles a cell", chosen("particles")),
            ("off the lattice", chosen("jitter", 0)), *_DEVIATIONS, *_REFINED,
        ),
    ),
    (
        "Loss per second: viscosity cΔx/(4 CFL) of PIC, m²/s; rate (kΔx)⁴ c/(40 CFL Δx) of APIC, "
        "1/s",
        lambda line: line["law"] == "loss" and "cell_size" in line["chosen"],
        (
            ("transfer", chosen("scheme")), ("Δx, m", chosen("cell_size")),
            ("K, Pa", chosen("modulus")), ("wave, cells", chosen("wave")), *_DEVIATIONS, *_REFINED,
        ),
    ),
    (
        "Equilibrium: side force of a tank filled at rest density, F/(ρgH²/2) - 1 = -(2/3) ρgH/K",
        lambda line: line["law"] == "equilibrium",
        (
            ("ρgH/K", chosen("compression")), ("cells deep", chosen("cells")),
            ("walls", chosen("walls")), ("method", _method), *_DEVIATIONS, *_REFINED,
            ("ringing left", number("ringing", ".0e")),
        ),
    ),
    (
        "Acoustic stage: period 4H/c, s, and largest error of the force in it, parts of ρgH²/2",
        lambda line: line["law"] == "acoustic",
        (
            ("K, Pa", chosen("modulus")), ("cells deep", chosen("cells")),
            ("walls", chosen("walls")), *_DEVIATIONS, *_REFINED,
            ("force, error", number("error", ".4f")),
            ("with its next terms ", number("error_refined", ".4f")),
        ),
    ),
)  # fmt: skip


def tables(lines: Iterable[Line]) -> str:
    """Return the tables as Markdown."""
    lines = list(lines)
    text: list[str] = []
    for title, belongs, columns in TABLES:
        own = [line for line in lines if belongs(line)]
        rows = [[read(line) for _, read in columns] for line in own]
        head = [name.strip() for name, _ in columns]
        text += [f"### {title}", "", *markdown([head, *rows]), ""]
    return "\n".join(text).rstrip()


def page(lines: Iterable[Line]) -> str:
    """Return the documentation page with the tables of the lines in it."""
    return filled(PAGE, BEGIN, END, tables(lines))


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("what", choices=("run", "table", "write", "check"))
    parser.add_argument("--output", type=Path, default=RESULTS)
    laws = list(dict.fromkeys(point.law for point in POINTS))
    parser.add_argument("--laws", nargs="*", choices=laws, default=[], help="these alone")
    arguments = parser.parse_args()
    if arguments.what == "run":
        return run(arguments)
    lines = load(arguments.output)
    if arguments.what == "table":
        print(tables(lines))
        return 0
    text = page(lines)
    if arguments.what == "write":
        PAGE.write_text(text, encoding="utf-8")
    elif text != PAGE.read_text(encoding="utf-8"):
        print(f"{PAGE} is out of date; run python benchmarks/laws.py write")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
