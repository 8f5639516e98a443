"""Error over time, with the Pareto front."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from libmpm._src.advice.tradeoff.front import is_rated
from libmpm._src.advice.tradeoff.labels import label_of, short
from libmpm._src.base.values import nearest, shown
from libmpm._src.errors import SceneError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from libmpm._src.advice.tradeoff.result import TradeOff

__all__ = ["plot"]

_MARKS = "os^Dv<>Pph8X"
#: Rows of a front that get a text of their own.
_NAMED = 12


def plot(table: TradeOff, *, by: str | None, axes: Any) -> Figure:
    """See `TradeOff.plot`."""
    if by is None:
        several = [p for p in table.parameters if len({short(r.get(p)) for r in table.rows}) > 1]
        by = several[0] if several else table.parameters[0]
    elif by not in table.parameters:
        raise SceneError(f"TradeOff.plot: by is {shown(by)}; {nearest(str(by), table.parameters)}")
    picture: Figure
    if axes is None:
        from libmpm._src.pictures.figures import Picture

        picture = Picture(figsize=(7.0, 4.5), layout="constrained")
        axes = picture.add_subplot()
    else:
        picture = axes.figure
    rated = [row for row in table.rows if is_rated(row)]
    # A logarithmic axis has no place for an error of 0: it stands at the lower edge.
    positive = [row["error"] for row in rated if row["error"] > 0]
    floor = 0.5 * min(positive, default=1.0)
    groups: dict[str, list[Any]] = {}
    for row in rated:
        groups.setdefault(short(row.get(by)) or "None", []).append(row)
    for k, (value, rows) in enumerate(groups.items()):
        axes.plot(
            [row["time"] for row in rows],
            [max(row["error"], floor) for row in rows],
            _MARKS[k % len(_MARKS)],
            markersize=5,
            label=f"{by} = {value}",
        )
    best = table.pareto
    if best:
        axes.step(
            [row["time"] for row in best],
            [max(row["error"], floor) for row in best],
            "k-",
            where="post",
            linewidth=0.8,
            zorder=1,
            label="front",
        )
    for row in best if len(best) <= _NAMED else ():
        axes.annotate(
            label_of(row, table),
            (row["time"], max(row["error"], floor)),
            xytext=(4, 4),
            textcoords="offset points",
            fontsize=7,
        )
    for row in table.rows:
        if row["reference"] and row["time"]:
            axes.axvline(row["time"], color="0.6", linestyle=":", linewidth=0.8, label="reference")
    axes.set(
        xscale="log",
        yscale="log",
        xlabel=f"{table.clock} time for a simulated second [s/s]",
        ylabel="error",
    )
    said = [table.name, f"{len(table.failed)} failed" if table.failed else ""]
    axes.set_title(", ".join(x for x in said if x), fontsize=10, loc="left")
    if rated or best:
        axes.legend(fontsize=8)
    return picture
