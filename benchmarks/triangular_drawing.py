"""How the figures of `triangular_grids.py` look: panels, and curves by their kind."""

import textwrap
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Canvas

#: How each kind of curve is drawn; "mesh" and "values" are drawn apart.
STYLES = {
    "line": {"linewidth": 1.0},
    "reference": {"color": "k", "linestyle": "--", "linewidth": 1.0, "zorder": 3},
    "second reference": {"color": "0.45", "linestyle": ":", "linewidth": 1.4, "zorder": 3},
    "points": {"linestyle": "none", "marker": ".", "markersize": 2},
    "marked": {"marker": "o", "markersize": 5, "linewidth": 1.0},
    "printed": {"linestyle": "none", "marker": "x", "markersize": 7, "color": "k"},
}


@dataclass(frozen=True)
class Panel:
    """Axes of a figure; `scale` "log" makes both axes logarithmic."""

    x: str
    y: str
    title: str = ""
    scale: str = "linear"
    log_y: bool = False
    equal: bool = False


@dataclass(frozen=True)
class Figure:
    """A figure: its name, number in the thesis, caption, panels by rows, and source of curves."""

    name: str
    number: str
    caption: str
    panels: tuple[tuple[Panel, ...], ...]
    curves: Callable
    widths: tuple[float, ...] | None = None
    size: tuple[float, float] = (5.2, 3.2)


def curve(panel, label, x, y, kind="line", **more):
    """Return a curve with six significant digits, without `figure`."""
    found = {"panel": panel, "label": label, "kind": kind, "x": rounded(x), "y": rounded(y)}
    return found | {k: rounded(v) for k, v in more.items()}


def rounded(values):
    return [
        float(f"{v:.6g}") if np.isfinite(v) else None
        for v in np.asarray(values, dtype=float).ravel().tolist()
    ]


def _numbers(values):
    return np.array([np.nan if v is None else v for v in values], dtype=float)


def draw(figure, curves, path):
    """Draw a figure's curves to a PNG."""
    rows, columns = len(figure.panels), len(figure.panels[0])
    width = figure.size[0] * columns if figure.widths is None else figure.size[0] * sum(
        figure.widths)  # fmt: skip
    canvas = Canvas(figsize=(width, figure.size[1] * rows + 0.7), layout="constrained")
    FigureCanvasAgg(canvas)
    grid = canvas.subplots(rows, columns, squeeze=False, width_ratios=figure.widths)
    for number, (axes, panel) in enumerate(
        zip(grid.ravel(), [p for row in figure.panels for p in row], strict=True)
    ):
        own = [c for c in curves if c["panel"] == number]
        for c in own:
            _draw_curve(axes, c)
        axes.set_xlabel(panel.x)
        axes.set_ylabel(panel.y)
        axes.set_title(panel.title, fontsize=10)
        if panel.scale == "log":
            axes.set_xscale("log")
        if panel.scale == "log" or panel.log_y:
            axes.set_yscale("log")
        if panel.equal:
            axes.set_aspect("equal")
        else:
            axes.grid(color="0.9", linewidth=0.6)
            axes.legend(fontsize=8)
    wrapped = "\n".join(textwrap.wrap(figure.caption, width=int(12 * width)))
    canvas.suptitle(f"{figure.number}\n{wrapped}", fontsize=10)
    canvas.savefig(path, dpi=120)


def _draw_curve(axes, c):
    x, y = _numbers(c["x"]), _numbers(c["y"])
    if c["kind"] == "mesh":
        axes.plot(x, y, color="0.55", linewidth=0.6, zorder=1)
    elif c["kind"] == "values":
        z = _numbers(c["z"]).reshape(len(y), len(x))
        ticks = np.arange(np.ceil(10 * z.max()) + 1) / 10
        levels = np.linspace(0, ticks[-1], 15)
        levels[0] = -1e-6  # a rounding below zero belongs to zero
        filled = axes.contourf(x, y, z, levels=levels, cmap="viridis")
        axes.figure.colorbar(filled, ax=axes, shrink=0.8, ticks=ticks)
    else:
        axes.plot(x, y, label=c["label"], **STYLES[c["kind"]])
