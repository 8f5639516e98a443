"""Drawings of a facility from the side, and of a run against the measured curves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.palette import CYCLE
from libmpm._src.flumes import records

if TYPE_CHECKING:
    from libmpm._src.flumes.collection import Collection
    from libmpm._src.flumes.comparison import Comparison
    from libmpm._src.flumes.laboratory import Laboratory
    from libmpm._src.pictures.figures import Picture

__all__ = ["curves", "preview", "ratios"]

_KINDS = {
    "level": ("v", CYCLE[1]),
    "depth": ("v", CYCLE[1]),
    "height": ("^", CYCLE[1]),
    "velocity": ("o", CYCLE[2]),
    "load": ("s", CYCLE[3]),
}


def preview(facility: Laboratory) -> Picture:
    """See `Facility.preview`."""
    from libmpm._src.pictures.figures import Picture

    figure = Picture(figsize=(10.0, 3.6), layout="constrained")
    axes = figure.add_subplot(1, 1, 1)
    x, z = (np.array(c) for c in zip(*facility.bed_profile, strict=True))
    floor = float(z.min()) - 0.1 * max(float(np.ptp(z)), 0.5)
    axes.fill_between(x, z, floor, color="0.6", linewidth=0, label="bed")
    level = facility.still_water
    if level is not None:
        fine = np.linspace(x[0], x[-1], 2000)
        bed = np.interp(fine, x, z)
        axes.fill_between(fine, bed, level, where=bed < level, color=CYCLE[0], alpha=0.25,
                          linewidth=0, label="still water")  # fmt: skip
    for k, (name, corners) in enumerate(facility.outlines()):
        u, v = zip(*corners, strict=True)
        axes.fill(u, v, facecolor=CYCLE[(k + 4) % len(CYCLE)], edgecolor="k", linewidth=0.6,
                  alpha=0.7, label=name)  # fmt: skip
    top = max(level or 0.0, float(z.max()), *(
        [v for _, c in facility.outlines() for _, v in c] or [0.0]))  # fmt: skip
    step = 0.09 * (top - floor)
    last, row = -np.inf, 0
    span = float(np.ptp(x))
    for one in sorted(facility.instruments(), key=lambda i: i.x):
        mark, colour = _KINDS.get(one.kind, ("d", CYCLE[5]))
        row = row + 1 if one.x - last < 0.06 * span else 0
        last = one.x
        height = top + step * (1.5 + row)
        bottom = one.z if one.kind != "load" else top
        axes.plot([one.x, one.x], [bottom, height], color=colour, linewidth=0.7)
        axes.plot([one.x], [bottom], mark, color=colour, markersize=4)
        axes.annotate(one.name, (one.x, height), fontsize=7, ha="center", va="bottom")
    axes.set_xlabel("x, m")
    axes.set_ylabel("z, m")
    axes.margins(x=0.02, y=0.12)
    axes.legend(fontsize=7, loc="lower right")
    axes.set_title(f"{facility.title}; heights not to scale", fontsize=10)
    return figure


def curves(comparison: Comparison) -> Picture:
    """See `Comparison.figure`."""
    facility, signals = comparison.facility, comparison.signals
    panels: list[tuple[str, Any]] = []
    for name in records.names(type(facility).__name__):
        panels += [(c.instrument, c) for c in records.load(name).curves]
    panels += [] if signals is None else list(signals.curves.items())
    known = {i.name: i for i in facility.instruments()}
    panels = [(n, c) for n, c in panels if n in known]
    shown = {n for n, _ in panels}
    panels += [
        (n, None)
        for n, i in known.items()
        if n not in shown and i.kind in ("level", "depth", "height", "load")
    ]
    panels = [(n, c) for n, c in panels if signals is not None and n in signals] or panels[:1]
    wide = 2 if len(panels) > 2 else 1
    tall = -(-len(panels) // wide)
    from libmpm._src.pictures.figures import Picture

    figure = Picture(figsize=(5.2 * wide, 2.5 * tall + 0.8), layout="constrained")
    for k, (name, curve) in enumerate(panels):
        axes = figure.add_subplot(tall, wide, k + 1)
        if curve is not None:
            as_depth = curve.quantity != "level"
            middle = curve.value if as_depth else curve.change()
            base = 0.0 if as_depth else float((curve.value - middle)[0])
            axes.fill_between(curve.time, curve.low - base - curve.uncertainty,
                              curve.high - base + curve.uncertainty, color="0.75", linewidth=0,
                              label="measured, band")  # fmt: skip
            axes.plot(curve.time, middle, color="k", linewidth=1.0, label="measured")
            for i, (code, values) in enumerate(curve.published.items()):
                axes.plot(curve.time, curve.change(values), "--", color=CYCLE[1 + i],
                          linewidth=0.9, label=code)  # fmt: skip
        if signals is not None and name in signals:
            kind = known[name].kind
            if kind == "load":
                time, values = signals.load(name)
            elif kind in ("depth", "height") or (curve is not None and curve.quantity == "depth"):
                time, values = signals.depth(name)
            else:
                time, values = signals.level(name)
            axes.plot(time, values, color=CYCLE[0], linewidth=1.2, label="this run")
        axes.set_title(name, fontsize=9)
        axes.set_xlabel("time of the laboratory, s", fontsize=8)
        axes.set_ylabel("load, N" if known[name].kind == "load" else "m", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.legend(fontsize=6)
    cell = f"cells of {facility.cell_size:g} m, {facility.width}"
    figure.suptitle(f"{facility.title}: {cell}", fontsize=10)
    return figure


def ratios(collection: Collection) -> Picture:
    """See `Collection.figure`."""
    from libmpm._src.pictures.figures import Picture

    rows = [r for r in collection.rows if r.measured and r.simulated is not None]
    figure = Picture(figsize=(8.0, 0.22 * max(len(rows), 4) + 1.4), layout="constrained")
    axes = figure.add_subplot(1, 1, 1)
    colours = {"passed": CYCLE[2], "failed": CYCLE[3]}
    for k, row in enumerate(rows):
        assert row.measured is not None and row.simulated is not None
        colour = colours.get(row.verdict, "0.4")
        if row.spread is not None:
            axes.plot([x / row.measured for x in row.spread], [k, k], color=colour, linewidth=1.0)
        axes.plot([row.simulated / row.measured], [k], "o", color=colour, markersize=4)
    axes.axvline(1.0, color="k", linewidth=0.7)
    axes.set_yticks(range(len(rows)), [f"{r.id} {r.quantity}" for r in rows], fontsize=6)
    axes.invert_yaxis()
    axes.tick_params(axis="x", labelsize=7)
    axes.set_xlabel("this run over measured; green passed, red failed, grey reported", fontsize=8)
    axes.set_title(collection.kind.title, fontsize=10)
    return figure
