"""Pictures of debris fields: plan, rose, histogram and cumulative curve of angles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.palette import CYCLE, FLUIDS, SOLIDS
from libmpm._src.errors import SceneError
from libmpm._src.studies.debris.metadata import angle_data

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from libmpm._src.studies.debris.field import DebrisField

__all__ = ["cumulative", "draw", "figure", "histogram", "rose"]

_ANGLE = "obliquity [degrees]"
#: Part of the footprint's longer edge: length of the arrow of the flow, and its distance.
_ARROW, _ASIDE = 0.2, 0.06


def _axes(ax: Axes | None, **style: Any) -> Axes:
    """Return the given axes, or new ones."""
    if ax is None:
        import matplotlib.pyplot as plt

        return plt.subplots(subplot_kw=style)[1]
    return ax


def draw(field: DebrisField, ax: Axes | None = None) -> Axes:
    """Draw the plan to scale: footprint, pieces by prototype, direction of the flow."""
    from matplotlib.patches import Polygon

    ax = _axes(ax)
    outline = field.outline()
    ax.add_patch(Polygon(outline, fill=False, edgecolor="0.4", linestyle="--", gid="footprint"))
    first: dict[int, Any] = {}
    for piece, corners in zip(field.pieces, field.rectangles().corners(), strict=True):
        k = piece.prototype
        patch = Polygon(
            corners, gid="piece", facecolor=SOLIDS[k % len(SOLIDS)], edgecolor="k", linewidth=0.6
        )
        first.setdefault(k, ax.add_patch(patch))
    low, high = outline.min(axis=0), outline.max(axis=0)
    longer = float(max(high - low))
    start = low[0], low[1] - _ASIDE * longer
    end = start[0] + _ARROW * longer, start[1]
    ax.annotate("", xy=end, xytext=start, arrowprops={"arrowstyle": "->", "color": FLUIDS[0]})
    ax.annotate("flow", xy=end, xytext=(4, 0), textcoords="offset points", va="center",
                color=FLUIDS[0])  # fmt: skip
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    # An annotation does not widen the view.
    ax.update_datalim([start])
    ax.autoscale_view()
    if len(first) > 1:
        names = {k: field.prototypes[k].name for k in sorted(first)}
        ax.legend([first[k] for k in names], list(names.values()), fontsize="small",
                  loc="lower right", bbox_to_anchor=(1, 1), ncols=len(names))  # fmt: skip
    return ax


def rose(field: DebrisField, ax: Axes | None, *, bins: int, flow: float) -> Axes:
    """Draw shares of obliquities as a rose over [0, 90] degrees."""
    from matplotlib.ticker import MaxNLocator

    data = angle_data(field, bins=bins, flow=flow)
    ax = _axes(ax, projection="polar")
    if ax.name != "polar":
        raise SceneError(
            "debris.DebrisField.rose: ax has straight axes; expected polar ones; make them with "
            'subplots(subplot_kw={"projection": "polar"})'
        )
    edges = np.radians(data["edges"])
    ax.bar(edges[:-1], data["shares"], width=np.diff(edges), align="edge", edgecolor="k",
           linewidth=0.6, color=SOLIDS[0])  # fmt: skip
    ax.set(thetamin=0, thetamax=90)
    ax.yaxis.set_major_locator(MaxNLocator(3))  # more would overlap along the small side
    ax.set_title("share by obliquity", fontsize="medium")
    return ax


def histogram(field: DebrisField, ax: Axes | None, *, bins: int, flow: float) -> Axes:
    """Draw numbers of pieces against obliquity."""
    from matplotlib.ticker import MaxNLocator

    data = angle_data(field, bins=bins, flow=flow)
    ax = _axes(ax)
    edges = np.array(data["edges"])
    ax.bar(edges[:-1], data["counts"], width=np.diff(edges), align="edge", edgecolor="k",
           linewidth=0.6, color=SOLIDS[0])  # fmt: skip
    ax.set(xlabel=_ANGLE, ylabel="pieces", xlim=(0, 90), xticks=edges)
    ax.yaxis.set_major_locator(MaxNLocator("auto", steps=[1, 2, 2.5, 5, 10], integer=True))
    return ax


def cumulative(field: DebrisField, ax: Axes | None, *, flow: float) -> Axes:
    """Draw the share of pieces up to an obliquity as steps, with D10, D30 and D60."""
    data = angle_data(field, bins=1, flow=flow)
    ax = _axes(ax)
    angles, share = [0.0, *data["obliquity"], 90.0], [0.0, *data["cumulative"], 1.0]
    ax.step(angles, share, where="post", color="k")
    for part, colour in zip((10, 30, 60), CYCLE, strict=False):
        angle = data[f"D{part}"]
        label = f"D{part} = {angle:.3g}°"
        ax.plot([0, angle, angle], [part / 100, part / 100, 0], "--", color=colour,
                linewidth=0.8, label=label)  # fmt: skip
    ax.set(xlabel=_ANGLE, ylabel="share of pieces", xlim=(0, 90), ylim=(0, 1.02))
    ax.legend(loc="lower right", fontsize="small")
    return ax


def figure(field: DebrisField, *, bins: int, flow: float) -> Figure:
    """Return a figure of the four pictures."""
    import matplotlib.pyplot as plt

    fig = plt.figure(figsize=(9, 7), layout="constrained")
    draw(field, fig.add_subplot(2, 2, 1))
    rose(field, fig.add_subplot(2, 2, 2, projection="polar"), bins=bins, flow=flow)
    histogram(field, fig.add_subplot(2, 2, 3), bins=bins, flow=flow)
    cumulative(field, fig.add_subplot(2, 2, 4), flow=flow)
    return fig
