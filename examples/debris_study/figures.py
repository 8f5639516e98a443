"""Pictures of the studies; each function draws into axes that it is given."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from libmpm import analysis, debris


def angle_curve(ax: Any, angle: Any, largest: Any, first: Any, broadside: float) -> None:
    """Draw loads in parts of v A √(ρE) against the angle of a block in degrees.

    `broadside` is the same formula for the long face, in the same parts.
    """
    ax.axvspan(30, 60, color="0.93", label="middle third")
    ax.plot(angle, largest, "o-", label="largest load")
    ax.plot(angle, first, "s--", markersize=4, label="first impact")
    ax.plot([0, 90], [1, broadside], "k_", markersize=14, label="v A √(ρE)")
    ax.set(xlabel="angle (degrees)", ylabel="load / v A √(ρE)", xticks=range(0, 91, 15))
    ax.set_yscale("log")
    ticks = [0.3, 0.5, 1, 2, 5]
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.set_yticks([], minor=True)
    ax.legend(fontsize="small")


def plans(axes: Iterable[Any], fields: Mapping[str, debris.DebrisField]) -> None:
    """Draw fields to scale, one in each of the axes, with their names."""
    for ax, (name, field) in zip(axes, fields.items(), strict=False):
        field.draw(ax)
        ax.set_title(name, fontsize="medium")


def histories(ax: Any, loads: Mapping[str, analysis.Signal], cutoff: float) -> None:
    """Draw loads over time, N, through the filter of the responses."""
    for name, load in loads.items():
        load.low_pass(cutoff).plot(ax, label=name, linewidth=1.0)
    ax.set(xlabel="time (s)", ylabel=f"load below {cutoff:.0f} Hz (N)")
    ax.legend(fontsize="small")
