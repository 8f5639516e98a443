"""What pictures of analyses share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from libmpm._src.base.palette import CYCLE
from libmpm._src.studies.analysis.record import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["POINTS", "THIN", "axes", "diagonal"]

#: Looks of points and of lines behind them.
POINTS: dict[str, Any] = {"linestyle": "", "marker": "o", "markersize": 4, "color": CYCLE[0]}
THIN: dict[str, Any] = {"color": "0.6", "linewidth": 0.8}


def axes(ax: Axes | None, x: str, y: str) -> Axes:
    """Return the given axes, or new ones, with labels."""
    if ax is None:
        from matplotlib import pyplot as plt

        ax = plt.subplots()[1]
    ax.set(xlabel=x, ylabel=y)
    return ax


def diagonal(ax: Any, x: Floats, y: Floats) -> None:
    """Draw the line on which both are equal, over the range of both."""
    ends = [min(x.min(), y.min()), max(x.max(), y.max())]
    ax.plot(ends, ends, **THIN)
