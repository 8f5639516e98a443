"""`Series.plot`: what a sensor has recorded, over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from libmpm._src.base.arguments import shown
from libmpm._src.base.palette import CYCLE
from libmpm._src.errors import Error
from libmpm._src.output.series import moving_mean
from libmpm._src.pictures.figures import Picture, check_axes, names_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from libmpm._src.output.series import Series

__all__ = ["plot_series"]

#: Components that are drawn where none is named.
_MOST = 6


def plot_series(
    series: Series,
    components: Sequence[str] | str | None,
    *,
    filter: float,
    axes: Any,
    label: str | None,
) -> Figure:
    """See `Series.plot`."""
    if components is None:
        same = [i for i, unit in enumerate(series.units) if unit == series.units[0]]
        columns = same[:_MOST]
    else:
        names = names_of("components", components)
        columns = [series.column(name) for name in names]
    units = {series.units[i] for i in columns}
    if len(units) > 1:
        raise Error(
            f"series '{series.name}': {', '.join(series.components[i] for i in columns)} have the "
            f"units {', '.join(sorted(units))}; one plot has one unit, draw them one by one"
        )
    filter = series.filter_length(filter)
    if label is not None and not isinstance(label, str):
        raise Error(f"label is {shown(label)}; expected a text, or None")
    check_axes(axes)
    shared = axes is not None
    if axes is None:
        axes = Picture(figsize=(7.0, 3.0), layout="constrained").add_subplot()
    time, rows = series.since(0)
    for column in columns:
        name = series.components[column]
        text = label or (f"{series.name}, {name}" if shared else name)
        colour = CYCLE[
            len([line for line in axes.lines if line.get_label()[0] != "_"]) % len(CYCLE)
        ]
        if filter > 0:
            # What was measured stays visible behind what is shown of it.
            axes.plot(time, rows[:, column], color=colour, lw=0.6, alpha=0.35, label="_samples")
            text += f", mean over {1e3 * filter:g} ms"
            axes.plot(time, moving_mean(time, rows[:, column], filter), color=colour, label=text)
        else:
            axes.plot(time, rows[:, column], color=colour, lw=1.1, label=text)
    kinds = {series.components[i].split("_")[0].split(":")[0] for i in columns}
    quantity = kinds.pop() if len(kinds) == 1 else "value"
    axes.set(xlabel="time [s]", ylabel=f"{quantity} [{units.pop()}]")
    if not shared:
        axes.set_title(series.name, fontsize=10, loc="left")
    if len(columns) > 1 or shared or filter > 0:
        axes.legend(fontsize=8, frameon=False)
    axes.grid(alpha=0.25, lw=0.5)
    figure: Figure = axes.figure
    return figure
