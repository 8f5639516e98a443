"""Rows T1 to T8 of the Waseda tsunami basin: what a run is held to, and by how much."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import (
    displacement,
    first_contact,
    pieces_at_rest,
    spread,
    widest_spread,
)

if TYPE_CHECKING:
    from libmpm._src.flumes.waseda_basin import WasedaBasin

__all__ = ["criteria"]

#: Rest by rows of columns and place of the start: row of the table, case of the record, ± m.
_REST = {(0, "upstream"): ("T4", "0x0_up", 0.4), (1, "upstream"): ("T5", "5x1_up", 0.5),
         (2, "downstream"): ("T5", "5x2_down", 0.5)}  # fmt: skip
#: Face of the first row, x of the scene, m, and half the depth of a piece along the flow.
_FACE, _HALF = 5.15, 0.03
#: When all is at rest, s.
_REST_AT = 9.0


def criteria(flume: WasedaBasin) -> tuple[Criterion, ...]:
    """Return rows T1 to T3, with debris T4 to T7, with columns T8."""
    record = records.load("waseda-waves")
    first, second = (0.0, 3.5), (0.0, 5.0)
    found = [
        Criterion("T1", "rms of the level, WG1", "m", ("WG1",), first,
                  measures.rms("WG1", record.curve("WG1"), first), 0.0, 0.0, 0.010,
                  "≤ 0.01 m", "0.028 (column)", gates=flume.drive == "paddle"),
        Criterion("T2", "arrival of 2 cm, WG3", "s", ("WG3",), second,
                  measures.arrival("WG3", 0.02, second), published="+0.04 s",
                  **measures.near(2.45, 0.1, "s")),
        Criterion("T2", "crest, WG3", "m", ("WG3",), second, measures.crest("WG3", second),
                  published="-30 %", **measures.within(0.14, 0.20)),
        Criterion("T2", "rms of the level, WG3", "m", ("WG3",), second,
                  measures.rms("WG3", record.curve("WG3"), second), 0.0, 0.0, 0.015,
                  "≤ 0.015 m", "0.011"),
    ]  # fmt: skip
    held: dict[str, Any] = {"gates": False, "held_out": True}
    for name, high, off, limit in (
        ("WG2", "-8 %", "0.015", 0.02),
        ("WG4", "-28 %", "0.005", 0.008),
    ):
        found += [
            Criterion("T3", f"arrival of 2 cm, {name}", "s", (name,), second,
                      measures.arrival(name, 0.02, second), tolerance="± 0.1 s", **held),
            Criterion("T3", f"crest, {name}", "m", (name,), second,
                      measures.crest(name, second), tolerance="± 20 %", published=high, **held),
            Criterion("T3", f"rms of the level, {name}", "m", (name,), second,
                      measures.rms_of(name, second), 0.0, 0.0, limit, f"≤ {limit:g} m", off,
                      gates=False, curve=name),
        ]  # fmt: skip
    debris = flume.debris if isinstance(flume.debris, str) else ""
    rows, place = flume.rows, debris.partition("-")[2]
    if rows:
        blow = (1.5, 3.6)
        what = f"{rows} row{'s' if rows > 1 else ''}"
        found.append(Criterion(
            "T8", f"first blow on the middle column, surge, {what}", "s", ("column-1-3",), blow,
            _blow, **measures.near(2.60, 0.1, "s"),
        ))  # fmt: skip
        if place == "upstream":
            found.append(Criterion(
                "T8", f"first piece at the first row, {what}", "s", ("debris-1",), blow,
                first_contact(_FACE, _HALF, flume.cell_size), **measures.near(2.85, 0.1, "s"),
            ))  # fmt: skip
    if debris:
        found += _rest(flume, rows, place)
    return tuple(found)


def _rest(flume: WasedaBasin, rows: int, place: str) -> list[Criterion]:
    """Return rows T4 to T7 of where pieces come to rest."""
    window, needs = (0.0, _REST_AT), ("debris-1",)
    setup = f"{5 if rows else 0}x{rows}, {place}"
    found = []
    if rows and place == "upstream":
        found.append(Criterion(
            "T5", f"pieces stuck before the first row, {setup}", "1", needs, window,
            pieces_at_rest(_FACE - 0.15, _FACE + 0.02), tolerance="each is a failure of the scene",
            published="2 of 6" if (rows, place) == (1, "upstream") else "", gates=False,
        ))  # fmt: skip
    if (rows, place) not in _REST:
        held: dict[str, Any] = {"gates": False, "held_out": True}
        return [
            *found,
            Criterion("T6", f"displacement at rest, median, {setup}", "m", needs, window,
                      displacement, tolerance="± 0.5 m", **held),
            Criterion("T7", f"spread, median, {setup}", "degrees", needs, window, spread,
                      tolerance="± 3°", **held),
            Criterion("T7", f"spread, largest, {setup}", "degrees", needs, window, widest_spread,
                      tolerance="≤ 16°", **held),
        ]  # fmt: skip
    row, case, by = _REST[rows, place]
    key = "case_obstacles_columns_x_rows_and_debris_position"
    way = records.load("waseda-displacements").row(key, case)
    angle = records.load("waseda-spread").row(key, case)
    low, high = (float(way[f"exp_q{k}_m"]) for k in (1, 3))
    bounds = measures.near(round(float(way["exp_goseberg2016_median_m"]), 2), by, "m")
    bounds["tolerance"] += f" (quartiles {low:.2f} to {high:.2f})"
    turn = round(float(angle["exp_goseberg2016_median_deg"]), 2)
    edges = [abs(float(angle[f"exp_{k}_whisker_deg"])) for k in ("min", "max")]
    published = {"0x0_up": "-0.1 m", "5x1_up": "four 2.6-2.8 m, two stuck"}.get(case, "")
    return [
        *found,
        Criterion(row, f"displacement at rest, median, {setup}", "m", needs, window, displacement,
                  published=published, **bounds),
        Criterion("T7", f"spread, median, {setup}", "degrees", needs, window, spread, gates=False,
                  **measures.near(turn, 3.0, "°")),
        Criterion("T7", f"spread, largest, {setup}", "degrees", needs, window, widest_spread,
                  max(edges), 0.0, 16.0, "≤ 16°", "≤ 12°", gates=False),
    ]  # fmt: skip


def _blow(signals: measures.Signals) -> float:
    """Return when a tenth of the largest load on the middle column is first reached, s."""
    time, force = signals.load("column-1-3")
    keep = (time > 1.5) & (time < 3.6)
    top = float(np.max(force[keep])) if keep.any() else 0.0
    above = force[keep] >= 0.1 * top
    return float(time[keep][int(np.argmax(above))]) if top > 0 else math.nan
