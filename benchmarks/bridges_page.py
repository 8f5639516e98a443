"""Figures and tables of docs/bridges.md from the lines of `bridges.py`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from bridges import FEW, LADDER, METHODS, SOFT
from bridges_scenes import BLOCKS, DENSITY, MODELS, TABLE, Model, net_area
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from result_pages import Line, filled, load, markdown

from libmpm._src.base.palette import CYCLE

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIGURES = ROOT / "docs" / "bridges.md", ROOT / "docs" / "figures"
MARKS = "<!-- {} of benchmarks/bridges.py -->", "<!-- end of {} -->"
#: Load of model II without a block, N: a number of the text.
STEADY = {"II": "120"}
NAMES = {
    "fbar": "F-bar, APIC", "NB": "NB, APIC", "FLIP fbar": "F-bar", "FLIP F0AL1": "F0AL1",
    "FLIP NB": "NB",
}  # fmt: skip
LONG = NAMES | {m: f"{NAMES[m]}, FLIP" for m in METHODS if m.startswith("FLIP")}
COLOURS = {
    "fbar": CYCLE[1],
    "FLIP fbar": CYCLE[0],
    "FLIP F0AL1": CYCLE[4],
    "FLIP NB": CYCLE[2],
}


class Lines:
    """The lines of a file that go together: one kind of device, its modulus and ten times it."""

    def __init__(self, path: Path) -> None:
        """Take those with the source's modulus, on a device, if there are any."""
        found = load(path)
        order = {(x["bulk_modulus"] == SOFT, x["device"] == "cuda") for x in found}
        best = max(order)
        self.kept = [
            x for x in found if (x["device"] == "cuda") == best[1] and self._near(x, best[0])
        ]
        self.device = "cuda" if best[1] else "cpu"
        self.modulus = min(x["bulk_modulus"] for x in self.kept)

    @staticmethod
    def _near(line: Line, soft: bool) -> bool:
        return (line["bulk_modulus"] >= SOFT) == soft

    def get(
        self, case: str, model: str, method: str, block: str = "", times: float = 1.0
    ) -> Line | None:
        """Return the newest line of a run with `times` the modulus."""
        for x in reversed(self.kept):
            here = (x["case"], x["model"], x["method"], x["block"])
            same = math.isclose(x["bulk_modulus"], times * self.modulus)
            if here == (case, model, method, block) and same:
                return x
        return None


def value(line: Line | None, name: str, digits: int = 0, over: float = 1.0) -> str:
    """Return a value as text, "-" where there is none."""
    found = None if line is None else line["values"].get(name)
    return "-" if found is None else f"{found / over:.{digits}f}"


# ---- tables -------------------------------------------------------------------------------------


def fronts(lines: Lines) -> list[list[str]]:
    """Return bores without a deck over the shallow-water equations."""
    rows = [["flume", "method", "speed of the front", "depth behind", "velocity behind"]]
    for model in ("F1", "F1-R", "F2", "F3"):
        for method in METHODS:
            line = lines.get("V7", model, method)
            if line is not None:
                names = ("front_speed", "depth_behind", "velocity_behind")
                rows.append([model, NAMES[method], *(value(line, n, 3) for n in names)])
    return rows


def decks(lines: Lines) -> list[list[str]]:
    """Return what the text of the source speaks about, model by model."""
    rows = [[
        "model", "method", "level at 0.1-1, 2-6 s", "velocity at 0.1-1, 1-2, 2-6 s",
        "F_x first", "F_x late", "F_y first", "F_y late", "filled below",
    ]]  # fmt: skip
    runs = [("V7", m) for m in ("M1", "M1-L", "M1-R", "M2", "M2-R", "M3", "M4")] + [("V8", "II")]
    for case, model in runs:
        bore = MODELS[model].state()
        for method in METHODS:
            line = lines.get(case, model, method)
            if line is None:
                continue
            level = [value(line, f"gauge_level_{n}", 2, bore.depth) for n in ("second", "rest")]
            speed = [
                value(line, f"gauge_velocity_{n}", 2, bore.velocity)
                for n in ("second", "second_2", "rest")
            ]
            force = [
                x
                for a in "xy"
                for x in (
                    value(line, f"first_{a}"),
                    f"{value(line, f'late_{a}')} ± {value(line, f'late_{a}_deviation')}",
                )
            ]
            row = [", ".join(level), ", ".join(speed), *force, value(line, "below_filled", 2)]
            rows.append([model, NAMES[method], *row])
    return rows


def moduli(lines: Lines) -> list[list[str]]:
    """Return runs with the modulus, and with ten times it."""
    rows = [["model", "method", "K, Pa", "level 2-6 s", "F_x first, late", "F_y first, late"]]
    for case, model in (("V7", "M1-L"), ("V8", "II")):
        for method in METHODS:
            pair = [lines.get(case, model, method, times=t) for t in (1.0, 10.0)]
            if None in pair:
                continue
            for line in pair:
                assert line is not None
                force = [f"{value(line, f'first_{a}')}, {value(line, f'late_{a}')}" for a in "xy"]
                level = value(line, "gauge_level_rest", 3)
                rows.append([model, NAMES[method], f"{line['bulk_modulus']:.3g}", level, *force])
    return rows


def ladder(path: Path) -> list[list[str]]:
    """Return the load of M1 from 0.8 to 1.45 s by modulus, cells and transfer, on one core."""
    found = {
        (x["model"], x["method"], x["bulk_modulus"]): x for x in load(path) if x["case"] == "K"
    }
    moduli = (1e6, 1e7, 1e8)
    rows = [["model", "method", *(f"F_x at {k:.0e} Pa" for k in moduli)]]
    for model, methods in LADDER.items():
        for method in methods:
            lines = [found.get((model, method, k)) for k in moduli]
            if any(lines):
                rows.append([model, LONG[method], *(value(x, "middle_x") for x in lines)])
    return rows


def exponent(points: Iterable[tuple[float, float]]) -> tuple[float, float]:
    """Return exponent and R² of force against area, straight in logarithms."""
    area, force = np.log(np.array(list(points))).T
    slope, offset = np.polyfit(area, force, 1)
    rest = force - slope * area - offset
    return float(slope), float(1 - rest.var() / force.var())


def points(lines: Lines, method: str) -> list[tuple[str, str, float, float]]:
    """Return model, block, area at the start and peak in N of what the source lists."""
    found = []
    for model, block in TABLE:
        line = lines.get("V9", model, method, block)
        peak = line and line["values"].get("peak")
        if peak and peak > 0:
            found.append((model, block, net_area(MODELS[model], block), peak))
    return found


def damming(lines: Lines) -> list[list[str]]:
    """Return peaks and net areas beside the source's."""
    rows = [[
        "run", "A_if, m²", "A_pf, source", "A_pf, NB", "F_de, source", "F_de, NB", "F_de, F-bar",
        "impact, NB", "after, NB",
    ]]  # fmt: skip
    for model, blocks in (("I", tuple(BLOCKS)), ("II", ("B1", "B2", "B3", "B5"))):
        for block in ("", *blocks):
            nb, fbar = (lines.get("V9", model, m, block) for m in FEW)
            if nb is None and fbar is None:
                continue
            there = TABLE.get((model, block))
            first, last = ("peak", "mean_after") if block else ("late_x_most", "late_x")
            rows.append([
                f"{model}-{block}" if block else f"{model}, no block",
                f"{net_area(MODELS[model], block):.3f}" if block else "-",
                f"{there[2]:.3f}" if there else "-",
                value(nb, "net_area_peak", 3),
                f"{1000 * there[0]:.0f}" if there else STEADY.get(model + block, "-"),
                value(nb, first), value(fbar, first), value(nb, "peak_impact"), value(nb, last),
            ])  # fmt: skip
    return rows


def fits(lines: Lines) -> list[list[str]]:
    """Return exponents of force against the area at the start."""
    rows = [["", "blocks", "exponent", "R²", "least and most F_de, N"]]
    table = [(x[1], 1000 * x[0]) for x in TABLE.values()]
    sets = [("table 6.2", table)]
    sets += [(NAMES[m], [(a, f) for _, _, a, f in points(lines, m)]) for m in FEW]
    for name, pairs in sets:
        if len(pairs) > 5:
            slope, fit = exponent(pairs)
            least, most = min(f for _, f in pairs), max(f for _, f in pairs)
            row = [f"{len(pairs)}", f"{slope:.2f}", f"{fit:.2f}", f"{least:.0f}, {most:.0f}"]
            rows.append([name, *row])
    return rows


def stopped(model: Model) -> float:
    """Return the load of a wall that stops all of a flow, N: ½ ρ g h² behind the reflected bore."""
    bore = model.state()
    low, high = bore.depth, 4 * bore.depth
    for _ in range(60):
        depth = 0.5 * (low + high)
        root = math.sqrt(0.5 * 9.81 * (1 / depth + 1 / bore.depth))
        low, high = (low, depth) if (depth - bore.depth) * root > bore.velocity else (depth, high)
    return 0.5 * DENSITY * 9.81 * high**2


# ---- figures ------------------------------------------------------------------------------------


def save(figure: Figure, name: str) -> None:
    """Save a figure for the documentation, in 32 colours."""
    canvas = FigureCanvasAgg(figure)
    figure.set_dpi(80)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy())
    FIGURES.mkdir(parents=True, exist_ok=True)
    palette = picture.quantize(32, dither=Image.Dither.NONE)
    palette.save(FIGURES / f"{name}.png", optimize=True)


def curve(axes: Any, line: Line, name: str, **style: Any) -> None:
    """Draw a column of a history."""
    history = line["history"]
    if name in history:
        values = [math.nan if x is None else x for x in history[name]]
        axes.plot(history["time"], values, linewidth=1.0, **style)


def draw_bores(lines: Lines) -> None:
    """Draw gauge and forces of the models by all methods."""
    models = [
        m
        for m in ("M1", "M1-L", "M2", "M3", "M4")
        if any(lines.get("V7", m, method) for method in METHODS)
    ]
    if not models:
        return
    # One row for each quantity and one column for each model, so that its unit stands once.
    figure = Figure(figsize=(3.2 * len(models), 10.0), layout="constrained")
    grid = figure.subplots(4, len(models), squeeze=False, sharex=True, sharey="row")
    columns = (
        ("level", "level [m]"), ("velocity", "velocity [m/s]"), ("force_x", "$F_x$ [N/m]"),
        ("force_y", "$F_y$ [N/m]"),
    )  # fmt: skip
    for row, model in zip(grid.T, models, strict=True):
        bore = MODELS[model].state()
        for axes, (name, title) in zip(row, columns, strict=True):
            for method in METHODS:
                line = lines.get("V7", model, method)
                if line is not None:
                    style = {"color": COLOURS[method], "label": NAMES[method]}
                    curve(axes, line, name, **style)
            if name in ("level", "velocity"):
                inlet = bore.depth if name == "level" else bore.velocity
                axes.axhline(inlet, color="k", linestyle=":", linewidth=1.0)
            axes.grid(alpha=0.25, linewidth=0.5)
            if model == models[0]:
                axes.set_ylabel(title, fontsize=12)
        row[0].set_title(model, fontsize=13)
        row[-1].set_xlabel("time [s]", fontsize=12)
    show: Any = figure.legend
    show(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", fontsize=12,
         ncols=len(METHODS), frameon=False)  # fmt: skip
    save(figure, "bores_at_decks")


def draw_damming(lines: Lines) -> None:
    """Draw force histories with blocks, and the peaks against the net area."""
    figure = Figure(figsize=(10.5, 3.2), layout="constrained")
    first, second, third = figure.subplots(1, 3)
    for axes, model in ((first, "I"), (second, "II")):
        for k, block in enumerate(("", *BLOCKS)):
            line = next((x for m in FEW if (x := lines.get("V9", model, m, block))), None)
            if line is not None:
                colour = "k" if not block else f"C{k - 1}"
                curve(axes, line, "force_x", color=colour, label=block or "no block")
        axes.set(title=f"Model {model}: F_x, N/m", xlabel="s")
        axes.legend(fontsize=6)
    areas = np.array([x[1] for x in TABLE.values()])
    peaks = np.array([1000 * x[0] for x in TABLE.values()])
    third.loglog(areas, peaks, "kx", label="table 6.2")
    span = np.array([0.135, 0.23])
    third.loglog(span, 782e3 * span**3.56, "k:", linewidth=1.0, label="782 kN A^3.56")
    for method in FEW:
        found = points(lines, method)
        if found:
            label = f"{NAMES[method]}"
            area, force = [x[2] for x in found], [x[3] for x in found]
            third.loglog(area, force, "o", color=COLOURS[method], markersize=4, label=label)
    for model, style in (("I", "--"), ("II", "-")):
        label = f"{model}: wall that stops all water"
        third.axhline(stopped(MODELS[model]), color="0.5", linewidth=0.8, ls=style, label=label)
    third.set(title="peak, N/m, against A_if, m²", xlim=(0.13, 0.24), ylim=(100, 9000))
    third.set_xticks([0.14, 0.17, 0.2, 0.23], ["0.14", "0.17", "0.20", "0.23"])
    third.minorticks_off()
    third.legend(fontsize=6)
    for axes in (first, second, third):
        axes.title.set_size(8)
        axes.tick_params(labelsize=7, which="both")
    save(figure, "damming")


def write(results: Path) -> None:
    """Write the figures, and the tables into the page."""
    lines = Lines(results)
    draw_bores(lines)
    draw_damming(lines)
    device = {"cuda": "one GPU", "cpu": "one core"}[lines.device]
    head = f"Runs on {device}, K = {lines.modulus:.3g} Pa."
    tables: Sequence[tuple[str, list[list[str]]]] = (
        ("fronts", fronts(lines)), ("decks", decks(lines)), ("moduli", moduli(lines)),
        ("damming", damming(lines)), ("fits", fits(lines)),
        ("ladder", ladder(results)),
    )  # fmt: skip
    for name, rows in tables:
        begin, end = (m.format(f"table {name}") for m in MARKS)
        over = [] if name == "ladder" else [head, ""]
        text = [*over, *markdown(rows)] if len(rows) > 1 else ["Not run."]
        PAGE.write_text(filled(PAGE, begin, end, "\n".join(text)), encoding="utf-8")
