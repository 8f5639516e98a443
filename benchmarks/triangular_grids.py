"""Grids of triangles and splines: the figures of de Koster (2018) redrawn, and what they cost.

    python benchmarks/triangular_grids.py figures --output FOLDER
    python benchmarks/triangular_grids.py figures --output FOLDER --from FOLDER/curves.jsonl
    python benchmarks/triangular_grids.py cost --results benchmarks/results/triangular_grids.jsonl
    python benchmarks/triangular_grids.py cost --table benchmarks/results/triangular_grids.jsonl

`figures` runs the cases of chapters 4 and 5 and draws one picture for each figure, named by what it
shows, with the exact solution of small waves or the same law in one dimension as reference. The
curves go to --data, one JSON line each, from which --from draws again without running. `cost`
appends one JSON line for every measurement; `--table` prints tables of the lines in a file. The
cases are so small that threads would mostly wait for each other, so it measures one thread; set
OMP_NUM_THREADS=1 too, as the solvers' own products look at nothing else.
"""

import argparse
import json
import sys
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

import triangular_cost as cost
import triangular_drawing as drawing
import triangular_figures as figures


def _lines(path):
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _figures(arguments):
    arguments.output.mkdir(parents=True, exist_ok=True)
    wanted = [f for f in figures.FIGURES if not arguments.only or f.name in arguments.only]
    if arguments.from_file:
        curves = _lines(arguments.from_file)
    else:
        curves = []
        data = arguments.data or arguments.output / "curves.jsonl"
        data.parent.mkdir(parents=True, exist_ok=True)
        with data.open("w", encoding="utf-8") as file:
            for figure in wanted:
                for curve in figure.curves():
                    curves.append({"figure": figure.name, **curve})
                    file.write(json.dumps(curves[-1]) + "\n")
    for figure in wanted:
        own = [c for c in curves if c["figure"] == figure.name]
        if own:
            path = arguments.output / f"{figure.name}.png"
            drawing.draw(figure, own, path)
            print(path, flush=True)


def _cost(arguments):
    if arguments.table:
        print(cost.tables(_lines(arguments.table)))
        return
    arguments.results.parent.mkdir(parents=True, exist_ok=True)
    about = cost.about(arguments.threads)
    about["command"] = " ".join(["python benchmarks/triangular_grids.py", *sys.argv[1:]])
    with arguments.results.open("a", encoding="utf-8") as file:
        for job in cost.jobs(arguments):
            line = json.dumps({**job(), **about})
            file.write(line + "\n")
            file.flush()
            print(line, flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="what", required=True)
    part = commands.add_parser("figures", help="redraw chapters 4 and 5")
    part.add_argument("--output", type=Path, required=True, help="folder of the pictures")
    part.add_argument("--data", type=Path, help="curves; curves.jsonl in OUTPUT when left out")
    part.add_argument("--from", type=Path, dest="from_file", help="draw these curves, run nothing")
    names = [f.name for f in figures.FIGURES]
    part.add_argument("--only", nargs="+", choices=names, metavar="NAME", help=", ".join(names))
    part = commands.add_parser("cost", help="measure, or print tables")
    part.add_argument("--results", type=Path, default=Path("triangular_grids.jsonl"))
    part.add_argument("--table", type=Path, help="print the tables of this file and stop")
    part.add_argument("--only", nargs="+", choices=cost.PARTS, help="parts; all when left out")
    part.add_argument("--bases", nargs="+", help="names of the trade-off's bases; all")
    part.add_argument("--masses", nargs="+", choices=cost.MASSES, help="of the trade-off; all")
    part.add_argument("--steps", nargs="+", choices=["own", "fixed"], help="of the trade-off; both")
    part.add_argument("--repeats", type=int, default=3, help="the fastest counts")
    part.add_argument("--threads", type=int, default=1, help="0: the default of the library")
    arguments = parser.parse_args()
    # One or two blocks for a whole bar have small angles on purpose.
    warnings.filterwarnings("ignore", message="grids.Mesh: the smallest angle")
    {"figures": _figures, "cost": _cost}[arguments.what](arguments)


if __name__ == "__main__":
    main()
