"""Bodies of elements against closed forms: spin, impact, vibration, locking, weight, Cook.

    python benchmarks/elements.py                 all cases, half an hour on two threads
    python benchmarks/elements.py --only bar      those whose names begin so
    python benchmarks/elements.py --write         and the table of docs/elements.md
    python benchmarks/elements.py --figures docs/figures      its figures, from lines of results

A case has bounds (design/elements.md says where they come from); one that is missed is marked.
One JSON line a case goes to benchmarks/results/elements.jsonl.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from element_figures import draw_beams, draw_columns
from result_pages import Line, append, chosen, filled, load, markdown

import libmpm
from libmpm._src.cli import bench
from support import element_cases as cases
from support import element_impacts as impacts
from support import element_load_cases as loads
from support import element_pins as pins

ROOT = Path(__file__).resolve().parents[1]
RESULTS = ROOT / "benchmarks/results/elements.jsonl"
PAGE = ROOT / "docs/elements.md"
MARKS = "<!-- table: benchmarks/elements.py --write -->", "<!-- end of elements -->"
BESIDE_MARKS = (
    "<!-- table: benchmarks/elements.py --write, beside particles -->",
    "<!-- end of beside particles -->",
)

#: Above or below a bound, or near to a value: (quantity, value, tolerance or None).
Bound = tuple[str, str, float, float]
AFLIP = libmpm.methods.Transfer(scheme="AFLIP", flip=0.99)


def near(name: str, value: float, share: float) -> Bound:
    """Return a bound: within a share of a value."""
    return name, "near", value, share


def over(name: str, value: float) -> Bound:
    """Return a bound: at least a value."""
    return name, "over", value, 0.0


def under(name: str, value: float) -> Bound:
    """Return a bound: at most a value."""
    return name, "under", value, 0.0


_SPIN = [near("momentum", 1, 1e-12), over("energy", 0.999)]
_FINE, _COARSE = [near("force", 1, 0.02), over("rebound", 0.93)], [
    near("force", 1, 0.04), over("rebound", 0.87)
]  # fmt: skip

#: Of the tip of a column in a dam break, in mm and s.
_COLUMN = [over("peak", 42), under("peak", 50), over("peak_time", 0.2), under("peak_time", 0.27),
           over("arrives", 0.12), under("arrives", 0.16)]  # fmt: skip

#: The printed bands of the bar of the WASIRF flume: force of both models, duration of each.
_WASIRF = [near("force", 1, 0.1), over("duration", round(impacts.DURATIONS[0], 2)),
           under("duration", round(impacts.DURATIONS[1], 2)), near("impulse", 1, 0.1)]  # fmt: skip

#: Name -> (case, its arguments, bounds).
CASES: dict[str, tuple[cases.Case, dict[str, Any], list[Bound]]] = {
    "spin, 3 turns, particles": (cases.spin, {"edge": math.inf}, []),
    "bar, particles": (cases.bar_impact, {"edge": math.inf}, []),
    "cantilever, 2 cells, particles": (cases.vibration, {"edge": math.inf, "cells": 2}, []),
    "cantilever, 2 cells, h = Δx": (cases.vibration, {"edge": 1.0, "cells": 2}, []),
    "cantilever, 4 cells, particles": (cases.vibration, {"edge": math.inf, "cells": 4}, []),
    "spin, 3 turns, h = Δx/2": (cases.spin, {"edge": 0.5}, _SPIN),
    "spin, 3 turns, h = Δx": (cases.spin, {"edge": 1.0}, _SPIN),
    "spin, 3 turns, h = Δx/2, 8 cells": (cases.spin, {"edge": 0.5, "cells": 8}, _SPIN),
    "spin in space, 1 turn, h = Δx, 8 cells": (
        cases.spin, {"edge": 1.0, "cells": 8, "turns": 1, "dimension": 3}, _SPIN,
    ),
    "spin, single precision, h = Δx/2": (
        cases.spin, {"edge": 0.5, "precision": "single"},
        [near("momentum", 1, 1e-3), over("energy", 0.995)],
    ),
    "bar, h = Δx/2": (cases.bar_impact, {"edge": 0.5}, _FINE),
    "bar, h = Δx": (cases.bar_impact, {"edge": 1.0}, _COARSE),
    "bar, h = Δx, half the cells": (cases.bar_impact, {"edge": 1.0, "dx": 0.02}, []),
    "bar, h = Δx/2, half the cells": (cases.bar_impact, {"edge": 0.5, "dx": 0.02}, []),
    "bar, h = Δx/2, twice the cells": (cases.bar_impact, {"edge": 0.5, "dx": 0.005}, _FINE),
    "bar, h = Δx/2, AFLIP 0.99": (cases.bar_impact, {"edge": 0.5, "transfer": AFLIP}, _FINE),
    "bar in space, h = Δx": (
        cases.bar_impact, {"edge": 1.0, "dimension": 3}, [near("force", 1, 0.04)],
    ),
    "cantilever, 4 cells, h = Δx/2": (
        cases.vibration, {"edge": 0.5, "cells": 4},
        [near("frequency", 1, 0.02), over("kept_per_cycle", 0.99)],
    ),
    "cantilever, 4 cells, h = Δx": (
        cases.vibration, {"edge": 1.0, "cells": 4},
        [near("frequency", 1, 0.08), over("kept_per_cycle", 0.95)],
    ),
    "cantilever, 6 cells, h = Δx/2": (
        cases.vibration, {"edge": 0.5, "cells": 6},
        [near("frequency", 1, 0.02), over("kept_per_cycle", 0.99)],
    ),
    "cantilever, 6 cells, h = Δx": (
        cases.vibration, {"edge": 1.0, "cells": 6},
        [near("frequency", 1, 0.04), over("kept_per_cycle", 0.97)],
    ),
    "cantilever, 2 cells, h = Δx/2": (cases.vibration, {"edge": 0.5, "cells": 2}, []),
    "cantilever in space, 2 cells, h = Δx/2, ν 0.3, vertex volumes": (
        cases.vibration,
        {"edge": 0.5, "cells": 2, "dimension": 3, "ratio": 0.3, "volumes": "vertex", "cycles": 2.2},
        [near("frequency", 1, 0.03)],
    ),
    "cantilever in space, 2 cells, h = Δx/2, ν 0.49, vertex volumes": (
        cases.vibration,
        {"edge": 0.5, "cells": 2, "dimension": 3, "ratio": 0.49, "volumes": "vertex",
         "cycles": 2.2},
        [near("frequency", 1, 0.13)],
    ),
    "cantilever in space, 2 cells, h = Δx/2, ν 0.49, element volumes": (
        cases.vibration,
        {"edge": 0.5, "cells": 2, "dimension": 3, "ratio": 0.49, "volumes": "element",
         "cycles": 2.2},
        [over("frequency", 1.5)],
    ),
    "weight of a cantilever, 4 cells, h = Δx/2": (
        cases.static_tip, {"edge": 0.5, "cells": 4}, [near("tip", 1, 0.04)],
    ),
    "weight of a cantilever, 8 cells, h = Δx/2": (
        cases.static_tip, {"edge": 0.5, "cells": 8}, [near("tip", 1, 0.04)],
    ),
    "cantilever, 2 cells, h = Δx/2, ν 0.49, vertex volumes": (
        cases.vibration,
        {"edge": 0.5, "cells": 2, "ratio": 0.49, "volumes": "vertex", "cycles": 2.2},
        [],
    ),
    "cantilever, 2 cells, h = Δx/2, ν 0.49, one-way, element volumes": (
        cases.vibration,
        {"edge": 0.5, "cells": 2, "ratio": 0.49, "volumes": "element", "pattern": "one-way",
         "cycles": 2.2},
        [],
    ),
    "Cook, ν 0.3, 8 cells, h = Δx/2": (
        cases.cook, {"cells": 8, "edge": 0.5, "ratio": 0.3}, [],
    ),
    "Cook, ν 0.4999, 8 cells, h = Δx/2, vertex volumes": (
        cases.cook, {"cells": 8, "edge": 0.5, "ratio": 0.4999, "volumes": "vertex"}, [],
    ),
    "Cook, ν 0.49, 8 cells, h = Δx/2, vertex volumes": (
        cases.cook, {"cells": 8, "edge": 0.5, "ratio": 0.49, "volumes": "vertex"}, [],
    ),
    "Cook, ν 0.49, 8 cells, h = Δx/2, element volumes": (
        cases.cook, {"cells": 8, "edge": 0.5, "ratio": 0.49, "volumes": "element"}, [],
    ),
    "Cook, ν 0.49, 16 cells, h = Δx/2, vertex volumes": (
        cases.cook, {"cells": 16, "edge": 0.5, "ratio": 0.49, "volumes": "vertex"}, [],
    ),
    "Cook, ν 0.3, 16 cells, h = Δx/2": (
        cases.cook, {"cells": 16, "edge": 0.5, "ratio": 0.3}, [near("lift", 21.94, 0.02)],
    ),
    "Cook, ν 0.4999, 16 cells, h = Δx/2, vertex volumes": (
        cases.cook, {"cells": 16, "edge": 0.5, "ratio": 0.4999, "volumes": "vertex"},
        [near("lift", 18.50, 0.03)],
    ),
    "Cook, ν 0.4999, 16 cells, h = Δx/2, one-way, element volumes": (
        cases.cook,
        {"cells": 16, "edge": 0.5, "ratio": 0.4999, "volumes": "element", "pattern": "one-way"},
        [under("lift", 8.0)],
    ),
} | {
    f"end load, {n} cells, h = Δx/2": (
        loads.end_load, {"edge": 0.5, "cells": n},
        [near("tip", 1, 0.04), near("reaction", 1, 0.01)] if n > 2 else [near("reaction", 1, 0.01)],
    )
    for n in (2, 4, 6)
} | {
    f"end pull, {n} cells, h = Δx/2": (
        loads.end_pull, {"edge": 0.5, "cells": n},
        [near("stretch", 1, 0.02), near("reaction", 1, 0.01)],
    )
    for n in (2, 4, 6)
} | {
    f"driven end, {n} cells, h = Δx/2": (
        loads.driven_bar, {"edge": 0.5, "cells": n},
        [near("give", 0.25, 0.2), near("force at clamp", 1, round(0.6 / (5 * n + 1), 3))],
    )
    for n in (2, 4, 6)
} | {
    f"pinned ends, {n} cells, {what}": (
        pins.stretched_bar, {"edge": edge, "cells": n},
        [near("force at held end", 1, 0.001), near("force at driven end", 1, 0.001)],
    )
    for n in (2, 4, 8) for what, edge in (("h = Δx/2", 0.5), ("h = Δx", 1.0))
} | {
    f"pinned cantilever, {n} cells, h = Δx/2": (
        pins.pinned_cantilever, {"edge": 0.5, "cells": n},
        [near("over the mesh alone", 1, {2: 0.04, 4: 0.012, 8: 0.005}[n])],
    )
    for n in (2, 4, 8)
} | {
    f"yielding bar in space, {n} cells, h = Δx, H = {h:g} E": (
        loads.yielding_bar, {"cells": n, "hardening": h},
        ([near("force", 1, 0.02)] if h or n > 2 else [])
        + ([near("plastic_strain", 1, 0.05)] if h else []),
    )
    for h in (0.0, 0.2) for n in (2, 4, 6)
} | {
    f"yielding bar in space, 4 cells, particles, H = {h:g} E": (
        loads.yielding_bar, {"cells": 4, "hardening": h, "edge": math.inf}, [],
    )
    for h in (0.0, 0.2)
} | {
    f"beam that yields at both ends, {n} cells, {what}": (
        loads.plastic_hinges, {"cells": n, "edge": edge, "volumes": volumes}, [],
    )
    for n, what, edge, volumes in (
        (4, "h = Δx/2, vertex volumes", 0.5, "vertex"),
        (4, "h = Δx/2, element volumes", 0.5, "element"),
        (4, "particles", math.inf, None),
        (8, "h = Δx, vertex volumes", 1.0, "vertex"),
        (8, "h = Δx, element volumes", 1.0, "element"),
        (8, "particles", math.inf, None),
    )
} | {
    f"beam under water, E = {e:g} Pa, {n} cells, {what}": (
        loads.beam_under_water, {"modulus": e, "cells": n, "edge": edge},
        # Softer, what the water gathers in the middle counts, and it has to get there.
        [near("sinks", 1, 0.06)] if n >= 4 and edge and e >= 5e7 else [],
    )
    for what, edge, n, moduli in (
        ("h = Δx/2", 0.5, 4, (2e5, 5e5, 1e6, 2e6, 5e6, 1e7, 2e7, 5e7, 1e8, 5e8)),
        ("h = Δx/2", 0.5, 2, (1e6, 5e6, 5e7)),
        ("h = Δx/2", 0.5, 8, (1e6, 5e6)),
        ("particles", None, 4, (2e5, 5e5, 1e6, 2e6, 5e6, 1e7, 2e7, 5e7, 1e8, 5e8)),
    )
    for e in moduli
} | {
    f"beam under water that runs along it, E = {e:g} Pa, {n} cells, h = Δx/2": (
        loads.beam_under_water, {"modulus": e, "cells": n, "contact": True},
        [near("under_level_water", 1, 0.06)] if n >= 4 else [],
    )
    for n, moduli in ((4, (2e5, 5e5, 1e6, 2e6, 5e6, 1e7, 5e7)), (8, (1e6,)))
    for e in moduli
} | {
    f"five dominoes, {n} cells thick, {what}": (
        loads.dominoes, {"cells": n, "edge": edge},
        [near("interval", 40.7, 0.12)] if edge <= 1 else [],
    )
    for n in (3, 4, 6) for what, edge in (
        ("particles", math.inf), ("h = Δx/2", 0.5), ("h = Δx", 1.0),
    ) if n < 6 or edge >= 1
} | {
    f"dam break on an elastic column, Δx = {1e3 * dx:g} mm, {what}": (
        loads.elastic_column, {"dx": dx, "edge": edge}, _COLUMN if edge else [],
    )
    for dx, what, edge in (
        (0.004, "h = Δx/2", 0.5), (0.004, "h = Δx", 1.0), (0.004, "particles", None),
        (0.003, "h = Δx/2", 0.5), (0.002, "h = Δx/2", 0.5),
    )
} | {
    f"the same, pinned by its foot, Δx = {1e3 * dx:g} mm, h = Δx/2": (
        loads.elastic_column, {"dx": dx, "pinned": True}, _COLUMN,
    )
    for dx in (0.004, 0.003, 0.002)
} | {
    f"WASIRF bar, {scheme} {flip:g}, {what}": (
        impacts.wasirf_bar, {"edge": edge, "scheme": scheme, "flip": flip}, _WASIRF,
    )
    for what, edge in (
        ("particles", math.inf), ("h = Δx", 1.0), ("h = 0.8 Δx", 0.8), ("h = Δx/2", 0.5),
    )
    for scheme in ("PIC-FLIP", "AFLIP") for flip in (0.0, 0.5, 0.9, 0.99, 0.999)
    if scheme == "PIC-FLIP" or flip in (0.0, 0.99)
} | {
    f"WASIRF bar, {scheme} {flip:g}, {what}, cells half as wide": (
        impacts.wasirf_bar, {"edge": edge, "scheme": scheme, "flip": flip, "cells": 16}, _WASIRF,
    )
    for scheme, flip, what, edge in (
        ("AFLIP", 0.0, "particles", math.inf), ("AFLIP", 0.99, "particles", math.inf),
        ("AFLIP", 0.99, "h = Δx/2", 0.5),
    )
}  # fmt: skip


_LENGTHS = "particles", "h = Δx/2", "h = Δx"
#: What is compared, over theory: (name, case before its kind of body, quantity).
BESIDE: list[tuple[str, str, str]] = [
    ("frequency of a cantilever, 2 cells", "cantilever, 2 cells, ", "frequency"),
    ("frequency of a cantilever, 4 cells", "cantilever, 4 cells, ", "frequency"),
    ("amplitude kept per cycle, 4 cells", "cantilever, 4 cells, ", "kept_per_cycle"),
    ("force of a bar on a wall, 10 cells thick", "bar, ", "force"),
    ("its speed afterwards", "bar, ", "rebound"),
    ("energy kept in 3 turns", "spin, 3 turns, ", "energy"),
    (
        "time between falls of dominoes 3 cells thick, ms",
        "five dominoes, 3 cells thick, ",
        "interval",
    ),
    ("tip of a column in a dam break, mm", "dam break on an elastic column, Δx = 4 mm, ", "peak"),
    ("its time, s", "dam break on an elastic column, Δx = 4 mm, ", "peak_time"),
]
#: And of those with h = Δx/2 alone.
BESIDE += [
    (f"beam under water, E = {e:g} Pa", f"beam under water, E = {e:g} Pa, 4 cells, ", "sinks")
    for e in (2e5, 1e6, 5e6, 5e7)
]
#: Whose time on one core is compared.
_COSTS = "cantilever, 4 cells, ", "bar, "


def beside(lines: list[Line]) -> str:
    """Return particles and elements side by side, with what they cost on one core."""
    newest = {line["case"]: line["values"] for line in lines}
    rows = [["", "particles, 4 a cell", *_LENGTHS[1:]]]
    for name, case, quantity in BESIDE:
        values = [newest.get(case + what, {}).get(quantity) for what in _LENGTHS]
        rows.append([name, *("" if v is None else f"{v:.4g}" for v in values)])
    for case in _COSTS:
        costs = [newest.get(case + what, {}).get("processor") for what in _LENGTHS]
        if None not in costs:
            name = case.removesuffix(", ")
            rows.append([f"time of the {name}", *(f"{c / costs[0]:.2g}" for c in costs)])
    return "\n".join(markdown(rows))


def holds(bound: Bound, values: dict[str, float]) -> bool:
    """Tell whether a bound is met."""
    name, kind, value, share = bound
    found = values[name]
    if kind == "near":
        return abs(found / value - 1) <= share
    return found >= value if kind == "over" else found <= value


def said(bound: Bound) -> str:
    """Return a bound in words."""
    name, kind, value, share = bound
    tolerance = f"{100 * share:g} %" if share >= 1e-3 else f"{share:g}"
    how = (
        f"{value:g} ± {tolerance}"
        if kind == "near"
        else f"{'≥' if kind == 'over' else '≤'} {value:g}"
    )
    return f"{name.replace('_', ' ')} {how}"


def shown(name: str, value: float) -> str:
    """Return a measured quantity in words."""
    text = f"1 {value - 1:+.0e}" if name == "momentum" else f"{value:.4g}"
    return f"{name.replace('_', ' ')} {text}"


def table(lines: list[Line]) -> str:
    """Return the newest results as a table."""
    newest = {line["case"]: line for line in lines}
    rows = [["case", "measured", "bound"]]
    for name, (_, _, bounds) in CASES.items():
        if name in newest:
            values = newest[name]["values"]
            hidden = ("steps", "deep", "seconds", "processor", "along")
            measured = "; ".join(shown(k, v) for k, v in values.items() if k not in hidden)
            missed = "" if all(holds(b, values) for b in bounds) else " (missed)"
            rows.append([name, measured, "; ".join(map(said, bounds)) + missed])
    return "\n".join(markdown(rows))


def main() -> int:
    """Do what the command line says."""
    arguments, names = chosen(__doc__, RESULTS, CASES, figures=True)
    missed = 0
    for name in names:
        case, given, bounds = CASES[name]
        began, worked = time.time(), time.process_time()
        values = case(**given) | {
            "seconds": round(time.time() - began, 1),
            "processor": round(time.process_time() - worked, 2),
        }
        met = [holds(b, values) for b in bounds]
        missed += met.count(False)
        line = {"case": name, "values": values, "bounds": [said(b) for b in bounds], "met": met,
                "commit": bench.commit(), "version": libmpm.__version__}  # fmt: skip
        append(arguments.output, line)
        print(name, values, met, flush=True)
    if arguments.write:
        lines = load(arguments.output)
        for marks, text in ((MARKS, table(lines)), (BESIDE_MARKS, beside(lines))):
            PAGE.write_text(filled(PAGE, *marks, text), encoding="utf-8")
    if arguments.figures:
        draw_beams(load(arguments.output), arguments.figures / "beam_under_water.png")
        draw_columns(arguments.figures / "elastic_column.png")
    return int(missed > 0)


if __name__ == "__main__":
    raise SystemExit(main())
