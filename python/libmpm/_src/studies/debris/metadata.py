"""The variables that describe a debris field, Bonus (2023) 10.2."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from libmpm._src.base.optional_packages import need
from libmpm._src.base.values import Checker, sequence, shown
from libmpm._src.errors import SceneError
from libmpm._src.output.atomic_files import write_json
from libmpm._src.shapes.oriented_boxes import TurnedBox, close_pairs, cosine_sine, depth, rotation
from libmpm._src.studies.debris.files import write_csv
from libmpm._src.studies.debris.rectangles import Rectangles, obliquity

if TYPE_CHECKING:
    from libmpm._src.studies.debris.field import DebrisField

__all__ = ["angle_data", "metadata", "percentile", "save_metadata"]

Floats = npt.NDArray[np.float64]
Row = dict[str, Any]

#: Sizes of a prototype among the variables.
_SIZES = ("length", "width", "height", "plan_area", "cross_section")
#: Depth in m up to which rectangles touch rather than overlap.
_TOUCH = 1e-8


def percentile(angles: Floats, percent: int) -> float:
    """Return the smallest angle that at least so many percent of the pieces do not exceed."""
    return float(np.sort(angles)[(percent * len(angles) + 99) // 100 - 1])


def metadata(
    field: DebrisField, *, width: Any, flow: Any, footprint: Any, thetas: Sequence[float]
) -> Row:
    """Return every variable of a field; see `DebrisField.metadata`."""
    check = Checker(f"{field.label}.metadata")
    if not field.pieces:
        check.fail("there are no pieces; expected some to measure")
    flow = check.number("flow", flow, unit="degrees")
    if width is not None:
        width = check.number("width", width, lower=0, lower_open=True, unit="m")
    listed = sequence(thetas)
    if listed is None:
        check.fail(
            f"thetas is {shown(thetas)}; expected several angles in degrees, such as (15, 30)"
        )
    angles_of = [
        check.number(f"thetas[{i}]", t, lower=0, upper=90, unit="degrees")
        for i, t in enumerate(listed or [])
    ]
    check.finish()
    rectangles = field.rectangles()
    long, wide = _extents(rectangles, flow)
    total = _area(check, field, footprint, max(long, wide))
    covered = covered_area(field)
    check.finish()
    # Rounding of a footprint without any gap must not show as a porosity.
    open_part = (total - covered) / total
    n = 0.0 if abs(open_part) < 1e-9 else open_part
    if n < 0:
        raise SceneError(
            f"{check.label}: the pieces cover {covered:g} m² of a footprint of {total:g} m²; "
            "expected no more than it has; give a larger footprint"
        )
    rows = field.table()
    angle = obliquity(rows["angle"] - flow)
    d10, d30, d60 = (percentile(angle, percent) for percent in (10, 30, 60))
    theta15 = float(np.mean(angle < 15))
    mass = float(rows["mass"].sum())
    nearest = rows["gap"]
    kinds = _kinds(field)
    made = field.placement
    found: Row = {
        "c": len(field),
        "sqrt_c": math.sqrt(len(field)),
        "footprint_area": total,
        "covered_area": covered,
        "D": 1 - n,
        "n": n,
        "log_n": math.log(n) if n > 0 else None,
        "e": n / (1 - n),
        "s": float(nearest.mean()) if len(field) > 1 else None,
        "L_x": long,
        "L_y": wide,
        "W": width,
        "L_x_over_W": None if width is None else long / width,
        "L_y_over_W": None if width is None else wide / width,
        "theta_mean": float(angle.mean()),
        "theta_std": float(angle.std()),
        "D10": d10,
        "D30": d30,
        "D60": d60,
        "C_u": d60 / d10 if d10 > 0 else None,
        "C_c": d30**2 / (d60 * d10) if d10 > 0 else None,
        "theta15": theta15,
        "sqrt_theta15": math.sqrt(theta15),
    }
    for theta in angles_of:
        found[f"D_theta_{theta:g}"] = float(np.mean(angle >= theta))
    return found | {
        "x": float((rows["mass"] * rows["x"]).sum()) / mass,
        "y": float((rows["mass"] * rows["y"]).sum()) / mass,
        "mass": mass,
        **{f"mean_{key}": _mean(kinds, key) for key in ("density", "youngs_modulus", *_SIZES)},
        "prototypes": kinds,
        "rotation": field.rotation,
        "flow": flow,
        "clearance": field.clearance,
        "kind": made.kind,
        "angles": None if made.angles is None else made.angles.to_dict(),
        "interval": None if made.interval is None else list(made.interval),
        "seed": made.seed,
        "attempts": made.attempts,
        "restarts": made.restarts,
        "skipped": made.skipped,
        "rejected": made.rejected,
        "acceptance": len(field) / made.attempts if made.attempts else None,
    }


def _kinds(field: DebrisField) -> list[Row]:
    """Return the debris set {ρ, E, A, L} and the number of pieces of each prototype."""
    found: list[Row] = []
    for k, kind in enumerate(field.prototypes):
        have = kind.material.parameters()
        row = {"name": kind.name, "count": sum(p.prototype == k for p in field.pieces)}
        row |= {key: have.get(key) for key in ("density", "youngs_modulus")}
        found.append(row | {key: getattr(kind, key) for key in _SIZES})
    return found


def _mean(kinds: list[Row], key: str) -> float | None:
    """Return the mean over the pieces; None if a kind among them has no such number."""
    have = [(row[key], row["count"]) for row in kinds if row["count"]]
    if any(item is None for item, _ in have):
        return None
    found: float | None = sum(item * n for item, n in have) / sum(n for _, n in have)
    return found


def _extents(rectangles: Rectangles, flow: float) -> tuple[float, float]:
    """Return the extents along and across the flow, m."""
    c, s = cosine_sine(flow)
    x, y = rectangles.corners().reshape(-1, 2).T
    return float(np.ptp(x * c + y * s)), float(np.ptp(y * c - x * s))


def _area(check: Checker, field: DebrisField, footprint: Any, longest: float) -> float:
    if footprint is None:
        return math.prod(field.footprint)
    if footprint == "square":
        return longest**2
    edges = sequence(footprint) or [footprint, footprint]
    if len(edges) != 2 or isinstance(footprint, str):
        check.fail(f'footprint is {shown(footprint)}; expected None, "square", L or (lx, ly) in m')
        return 1.0
    return math.prod(
        check.number("footprint", edge, lower=0, lower_open=True, unit="m") for edge in edges
    )


def covered_area(field: DebrisField) -> float:
    """Return the area that the pieces cover, seen from above, m²."""
    seen: dict[tuple[float, ...], None] = {}
    rectangles = field.rectangles()
    parts = (rectangles.x, rectangles.y, rectangles.angle, rectangles.length, rectangles.width)
    for row in np.column_stack(parts).tolist():
        seen[tuple(row)] = None  # layers on top of each other cover their plan once
    flat = [TurnedBox((x, y), (a, b), rotation(2, angle)) for x, y, angle, a, b in seen]
    pairs = close_pairs([box.bounds() for box in flat])
    if not any(depth(flat[i], flat[j]) > _TOUCH for i, j in pairs):
        return sum(math.prod(box.size) for box in flat)
    shapely = need("shapely", "the area that unequal layers of debris cover", "studies")
    polygons = [shapely.Polygon(corners) for corners in rectangles.corners()]
    return float(shapely.union_all(polygons).area)


def angle_data(field: DebrisField, *, bins: int, flow: float) -> dict[str, Any]:
    """Return the numbers behind the pictures of angles; see `DebrisField.angle_data`."""
    check = Checker(f"{field.label}.angle_data")
    bins = check.integer("bins", bins, lower=1)
    flow = check.number("flow", flow, unit="degrees")
    if not field.pieces:
        check.fail("there are no pieces; expected some to measure")
    check.finish()
    angles = np.sort(field.obliquity(flow))
    counts, edges = np.histogram(angles, bins=bins, range=(0.0, 90.0))
    share = np.searchsorted(angles, angles, side="right") / len(angles)
    return {
        "obliquity": angles.tolist(),
        "cumulative": share.tolist(),
        "edges": edges.tolist(),
        "counts": counts.tolist(),
        "shares": (counts / len(angles)).tolist(),
        **{f"D{p}": percentile(angles, p) for p in (10, 30, 60)},
    }


def save_metadata(fields: Iterable[DebrisField], path: str | Path, **options: Any) -> None:
    """Write the metadata of fields to a file, one row a field.

    A path that ends in .json gets a list of dictionaries, any other a CSV file in which what is
    undefined stays empty and lists are texts in JSON. `options` go to
    `debris.DebrisField.metadata`. Raises `SceneError`, `OutputError`.
    """
    rows = [field.metadata(**options) for field in fields]
    if not rows:
        raise SceneError("debris.save_metadata: there are no fields; expected one or more")
    path = Path(path)
    if path.suffix == ".json":
        write_json(path, rows)
        return
    write_csv(path, list(rows[0]), [[_cell(item) for item in row.values()] for row in rows])


def _cell(item: Any) -> Any:
    return json.dumps(item, ensure_ascii=False) if isinstance(item, list | dict) else item
