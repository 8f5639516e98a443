"""Four studies of debris in laboratory flumes, each with one table and one figure.

    python benchmarks/flume_studies.py {ordered,scales,random,rest} -o FOLDER [--level laptop|full]
                                       [--set NAME=VALUE ...] [--where NAME=VALUE ...] [--cases N]
                                       [--budget SECONDS] [--device cpu|cuda:0,cuda:1] [--workers N]

ordered  16 ordered fields of the Large Wave Flume from one water run: first peaks against measured
         boxes, line of parity
scales   a field at λ 0.25, 1, 4, 10 by Froude, with and without the moduli scaled: peaks over λ³
random   34 random fields of the flume's bars from the same water: first peaks and the regression
rest     Waseda basin, 3 and 6 pieces, without columns and behind one or two rows: rest and spread

`--set` changes any argument of the facility: cell_size=0.05, contact=0.3, packing="density".
`--where` takes the rows that have one of the values given of a name: columns=1.
A study that was stopped continues from its folder. The table is FOLDER/NAME.csv, the figure
FOLDER/NAME.png; a line with the seconds of a case goes to benchmarks/results/flume_studies.jsonl.
Level "laptop" is cells in which debris is one to three cells thick, minutes to an hour on two
cores; "full" is one GPU. Several devices have cases in turn, as many at a time as there are
workers.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import signal
import statistics
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from result_pages import append, setting

import libmpm
from libmpm import debris, flumes
from libmpm._src.cli import bench
from libmpm._src.flumes.structures import BETWEEN_PIECES
from libmpm._src.pictures.figures import Picture

matplotlib.use("Agg")

RESULTS = Path(__file__).resolve().parent / "results/flume_studies.jsonl"

#: Layouts with a measured box plot, then those of the older series whose simulation is published.
ORDERED = (
    "1-L-0.5x0.1", "8-L-1.0x0.4", "16-L-1.0x0.8", "1-T-0.1x0.5", "16-T-0.8x1.0", "24-T-0.6x2.0",
    "8-T-0.8x0.5", "16-L-2.0x0.4", "16-T-0.4x2.0", "24-L-2.0x0.6", "4-L-0.5x0.4", "8-L-0.5x0.8",
    "32-L-2.0x0.8", "4-T-0.2x1.0", "8-T-0.2x2.0", "32-T-0.8x2.0",
)  # fmt: skip
#: Published cost of a debris case: A100 hours.
PUBLISHED = "20 h on three A100 for 25 s of 140 M particles"
#: First peaks lie before it, s of the laboratory.
LAST_PEAK = 38.0

Row = Mapping[str, Any]


class Ordered:
    """First peaks of ordered fields in the Large Wave Flume, half of its width."""

    def __init__(self, level: str, folder: Path, device: str, changes: Mapping[str, Any]) -> None:
        self.folder, self.device = folder / "water", device
        given = {"cell_size": 0.1 if level == "laptop" else 0.05} | dict(changes)
        # What debris alone has.
        self.own = {k: given.pop(k) for k in ("contact", "gap", "debris_modulus") if k in given}
        self.flume = flumes.LargeWaveFlume(width="half", structure="box", end=70.0, **given)
        self.until = LAST_PEAK - self.flume.clock

    def rows(self) -> list[dict[str, Any]]:
        """Return the rows of the study."""
        return [{"layout": name} for name in ORDERED]

    def facility(self, **row: Any) -> flumes.LargeWaveFlume:
        """Return the flume of a row."""
        return dataclasses.replace(self.flume, debris=row["layout"], **self.own)

    def scene(self, **row: Any) -> libmpm.Scene:
        """Return the near field of a row, from the one water run."""
        return self.facility(**row).near_field(self.folder, until=LAST_PEAK, device=self.device)

    def response(self, case: Any) -> dict[str, float]:
        """Return the first peak, N, of means of 0.01 s."""
        flume = self.facility(**case.parameters)
        return {"peak": peak(case, flume, (30.0, LAST_PEAK))}

    def report(self, table: Sequence[Row], axes: Any) -> dict[str, Any]:
        """Draw measured and simulated first peaks; return the line through them."""
        record = flumes.records.load("lwf-first-peaks")
        pairs = []
        for row in table:
            found = record["exp_mascarenas2022_median_N"]
            names = list(record["case"])
            if row["layout"] not in names or row.get("peak") is None:
                continue
            measured = float(found[names.index(row["layout"])])
            if math.isfinite(measured):
                pairs.append((measured, row["peak"]))
        return parity(pairs, axes)


class Random(Ordered):
    """First peaks of random fields of bars, full width of the field within half of the flume."""

    def rows(self) -> list[dict[str, Any]]:
        """Return 34 rows of count and seed."""
        counts = (4, 8, 12, 16, 20, 24)
        return [{"count": counts[k % 6], "seed": k + 1} for k in range(34)]

    def facility(self, **row: Any) -> flumes.LargeWaveFlume:
        """Return the flume with a random field that ends 2.0 m before the box, y > 0."""
        count, seed = row["count"], row["seed"]
        one = dataclasses.replace(self.flume, debris="1-L-0.5x0.1", **self.own)
        field = debris.random(
            one.field().prototypes[0], count=count, footprint=(2.0 + 0.1 * count, 1.6),
            clearance=2 * one.cell_size, seed=seed, corner=(41.8 - 2.0 - 0.1 * count, 0.05),
        )  # fmt: skip
        return dataclasses.replace(one, debris=field)

    def response(self, case: Any) -> dict[str, float]:
        """Return the first peak, N, and what the regression takes."""
        field = self.facility(**case.parameters).field()
        angles = np.radians([p.angle for p in field.pieces])
        aligned = float(np.mean(np.cos(angles) ** 2))
        return super().response(case) | {"aligned": aligned, "log_count": math.log(2 * len(field))}

    def report(self, table: Sequence[Row], axes: Any) -> dict[str, Any]:
        """Draw peaks over the number of bars; return the fit by log n and alignment."""
        rows = [r for r in table if r.get("peak") is not None]
        x = np.array([[1.0, r["log_count"], r["aligned"]] for r in rows])
        y = np.array([r["peak"] for r in rows])
        if len(rows) < 4:
            return {"rows": len(rows)}
        found, *_ = np.linalg.lstsq(x, y, rcond=None)
        square = 1 - np.sum((y - x @ found) ** 2) / np.sum((y - y.mean()) ** 2)
        axes.plot([2 * r["count"] for r in rows], y, "o", markersize=4)
        axes.set_xlabel("bars, both halves")
        axes.set_ylabel("first peak, N")
        return {"constant": found[0], "log n": found[1], "aligned": found[2], "R2": square}


class Scales:
    """A field of bars before the box of WASIRF, at several scales by Froude."""

    def __init__(self, level: str, folder: Path, device: str, changes: Mapping[str, Any]) -> None:
        given = {"cell_size": 0.05 if level == "laptop" else 0.0125} | dict(changes)
        self.flume = flumes.WASIRF.of_case("8-L", width="half", **given)

    def rows(self) -> list[dict[str, Any]]:
        """Return λ and whether the moduli are scaled."""
        return [{"scale": s, "moduli": m} for s in (0.25, 1.0, 4.0, 10.0) for m in (True, False)]

    def until(self, scale: float) -> float:
        """Return the end of a case, s."""
        return 4.0 * math.sqrt(scale)

    def scene(self, scale: float, moduli: bool) -> libmpm.Scene:
        """Return the scene of a row."""
        return self.flume.scene().scaled(scale, cauchy=moduli)

    def response(self, case: Any) -> dict[str, float]:
        """Return the largest load over λ³, N at λ 1, in means of 5 ms √λ."""
        scale = case.parameters["scale"]
        series = case.sensors["box"]
        force = 2.0 * np.asarray(series["force_x"]) / scale**3
        time = np.asarray(series.time) / math.sqrt(scale)
        width = max(1, round(0.005 / float(np.median(np.diff(time)))))
        return {"peak": float(np.convolve(force, np.full(width, 1 / width), "same").max())}

    def report(self, table: Sequence[Row], axes: Any) -> dict[str, Any]:
        """Draw peaks over λ; return those without scaled moduli over those with."""
        found = {(r["scale"], r["moduli"]): r["peak"] for r in table if r.get("peak") is not None}
        for moduli, name in ((True, "moduli scaled"), (False, "moduli as they are")):
            points = sorted((s, p) for (s, m), p in found.items() if m == moduli)
            if points:
                axes.semilogx(*zip(*points, strict=True), "o-", label=name)
        axes.set_xlabel("λ")
        axes.set_ylabel("largest load over λ³, N")
        axes.legend()
        return {f"ratio at {s:g}": found[s, False] / found[s, True]
                for s in (0.25, 1.0, 4.0, 10.0)
                if (s, False) in found and found.get((s, True))}  # fmt: skip


class Rest:
    """Rest and spread of pieces in the Waseda basin."""

    def __init__(self, level: str, folder: Path, device: str, changes: Mapping[str, Any]) -> None:
        self.changes = {"cell_size": 0.05 if level == "laptop" else 0.02} | dict(changes)
        self.until = flumes.WasedaBasin.of_case("0x0-up").until

    def rows(self) -> list[dict[str, Any]]:
        """Return rows of columns, layers of pieces and seeds: all set-ups before a second seed."""
        return [{"columns": rows, "layers": layers, "seed": seed}
                for seed in range(1, 6) for rows in (0, 1, 2) for layers in (1, 2)]  # fmt: skip

    def facility(self, columns: int, layers: int, seed: int) -> flumes.WasedaBasin:
        """Return the basin of a row."""
        return flumes.WasedaBasin(
            width="full",
            rows=columns,
            seed=seed,
            debris=f"3x{layers}-upstream",
            **({"contact": BETWEEN_PIECES} | self.changes),
        )

    def scene(self, **row: Any) -> libmpm.Scene:
        """Return the scene of a row."""
        return self.facility(**row).scene()

    def response(self, case: Any) -> dict[str, float]:
        """Return medians of rest, m, and spread, degrees, and pieces stuck before the first row."""
        from libmpm._src.flumes import debris as measures

        flume = self.facility(**case.parameters)
        signals = flumes.Signals(case.sensors, flume.clock, flume.instruments(), flume.rest)
        stuck = measures.pieces_at_rest(5.0, 5.17) if case.parameters["columns"] else None
        return {"rest": measures.displacement(signals), "spread": measures.spread(signals),
                "stuck": 0.0 if stuck is None else stuck(signals)}  # fmt: skip

    def report(self, table: Sequence[Row], axes: Any) -> dict[str, Any]:
        """Draw rest by set-up with the law of the experiment; return medians and spreads."""
        found: dict[str, Any] = {}
        for k, (columns, layers) in enumerate((c, n) for c in (0, 1, 2) for n in (1, 2)):
            rows = [r for r in table if (r["columns"], r["layers"]) == (columns, layers)]
            values = [r["rest"] for r in rows if r.get("rest") is not None]
            if values:
                name = f"{columns} rows, {3 * layers} pieces"
                axes.plot([k] * len(values), values, "o", markersize=4)
                if columns == 0:
                    axes.plot([k], [3.58 - 0.09 * 3 * layers], "_", color="k", markersize=16)
                found[name] = [statistics.median(values), min(values), max(values)]
        axes.set_xticks(range(6), [f"{c}/{3 * n}" for c in (0, 1, 2) for n in (1, 2)])
        axes.set_xlabel("rows of columns / pieces; bar: 3.58 - 0.09 N m without columns")
        axes.set_ylabel("median of the pieces' way, m")
        return found


STUDIES: dict[str, Callable[[str, Path, str, Mapping[str, Any]], Any]] = {
    "ordered": Ordered, "scales": Scales, "random": Random, "rest": Rest,
}  # fmt: skip


def peak(case: Any, flume: Any, window: tuple[float, float]) -> float:
    """Return the largest mean of 0.01 s of the load on the whole box, N."""
    from libmpm._src.flumes.criteria import peak_load

    signals = flumes.Signals(case.sensors, flume.clock, flume.instruments(), flume.rest)
    return peak_load("box", window, 0.01)(signals)


def parity(pairs: Sequence[tuple[float, float]], axes: Any) -> dict[str, Any]:
    """Draw simulated over measured and return the line through them."""
    if not pairs:
        return {"pairs": 0}
    x, y = np.array(pairs).T
    most = 1.1 * max(x.max(), y.max())
    axes.plot([0, most], [0, most], color="0.6", linewidth=0.8)
    axes.plot(x, y, "o", markersize=4)
    axes.set_xlabel("measured median, N")
    axes.set_ylabel("simulated first peak, N")
    found: dict[str, Any] = {"pairs": len(pairs), "error": float(np.mean(np.abs(y / x - 1)))}
    if len(pairs) >= 3:
        slope, start = np.polyfit(x, y, 1)
        axes.plot([0, most], [start, start + slope * most], color="tab:red", linewidth=0.8)
        found |= {"slope": slope, "R2": np.corrcoef(x, y)[0, 1] ** 2}
    return found


def chosen(rows: Sequence[Row], where: Sequence[tuple[str, Any]]) -> list[Row]:
    """Return the rows that have, of each name in `where`, one of its values."""
    return [r for r in rows if all(r[n] in [v for m, v in where if m == n] for n, _ in where)]


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("name", choices=STUDIES)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--level", choices=("laptop", "full"), default="laptop")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--set", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--where", action="append", default=[], type=setting, metavar="NAME=VALUE")
    parser.add_argument("--cases", type=int, help="the first so many rows; default: all")
    parser.add_argument("--budget", type=int, default=0, help="s; stops and reports what is there")
    parser.add_argument("--until", type=float, help="s; shorter than a study needs: a trial")
    parser.add_argument("--results", type=Path, default=RESULTS)
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    devices, changes = given.device.split(","), dict(given.set)
    plan = STUDIES[given.name](given.level, given.output, devices[0], changes)
    study = libmpm.Study(
        given.output / given.name, plan.scene, chosen(plan.rows(), given.where)[: given.cases],
        until=plan.until if given.until is None else given.until, response=plan.response,
        checkpoint_interval=4.0, name=given.name,
    )  # fmt: skip
    if given.budget:
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.alarm(given.budget)
    try:
        result = study.run(workers=given.workers, device=devices, progress=False)
    except KeyboardInterrupt:
        result = study.collect()
    signal.alarm(0)
    figure = Picture(figsize=(6, 4), layout="constrained")
    axes = figure.add_subplot(1, 1, 1)
    rows = [dict(row) for row in result.rows]
    found = {k: v if isinstance(v, list) else float(v) for k, v in plan.report(rows, axes).items()}
    seconds = [row["wall_time"] for row in rows if row["status"] == "finished"]
    axes.set_title(f"{given.name}, {given.level}: {len(seconds)} cases", fontsize=10)
    figure.savefig(given.output / f"{given.name}.png", dpi=110)
    result.save_csv(given.output / f"{given.name}.csv")
    append(given.results, {
        "study": given.name, "level": given.level, "changes": changes, "device": given.device,
        "workers": given.workers, "cases": len(seconds), "of": len(rows),
        "failed": len(result.failed), "seconds_a_case": statistics.mean(seconds or [math.nan]),
        "published": PUBLISHED, "found": found, "commit": bench.commit(),
        "version": libmpm.__version__,
    })  # fmt: skip
    print(result, *(f"{k}: {v}" for k, v in found.items()), sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
