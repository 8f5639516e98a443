"""The atlas as data: what the package ships of the trade-off table's lines."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from result_pages import Line
from tradeoff_cases import MEASURED, Measured
from tradeoff_options import BASELINE, BY_LENGTH, OPTIONS, Option
from tradeoff_table import ROOT, newest

DATA = ROOT / "python/libmpm/data/atlas.json"
#: What a setting may lose of the mechanical energy beyond the baseline, parts: a number that comes
#: out right where the motion has died is right by accident.
LOSS = 0.05

#: Choices in which two options must agree to differ in their cells alone.
FIXED = (
    "transfer", "kernel", "fbar", "solid_fbar", "size", "material", "precision", "pipeline", "step",
    "walls", "layer", "per_cell", "bulk", "smoothing", "assumed", "contact",
    "solids",
)  # fmt: skip

CASES = {m.name: m for m in MEASURED}
NAMED = {o.name: o for o in OPTIONS}


def rounded(value: Any, digits: int = 4) -> Any:
    """Return plain values with their numbers to so many digits."""
    if isinstance(value, float):
        return float(f"{value:.{digits}g}")
    if isinstance(value, Mapping):
        return {k: rounded(v, digits) for k, v in value.items()}
    return value


def errors_of(line: Line, measured: Measured) -> dict[str, float]:
    """Return the errors of a line, parts, without values that have a unit or could not be read."""
    found = {}
    for name, error in line["errors"].items():
        if error is not None and name not in measured.apart:
            cells = measured.across(line["parameters"]) if name in measured.length else 1.0
            found[name] = error / cells
    return found


def judged(measured: Measured) -> tuple[str, ...]:
    """Return the values whose errors say how good a setting is."""
    return measured.judged or tuple(k for k in measured.expected if k not in measured.apart)


def worst(errors: Mapping[str, float], measured: Measured) -> float | None:
    """Return the largest of the judged errors; None where one could not be read."""
    names = judged(measured)
    return max(abs(errors[k]) for k in names) if all(k in errors for k in names) else None


def _smoothing(form: str | None, option: Option) -> dict[str, Any] | None:
    if form is None:
        return None
    length = option.smoothed if form in BY_LENGTH else None
    time = None if form in BY_LENGTH else option.smoothed
    ratio = None if length is None else 4 * length**2 / (1 + 4 * length**2)
    return {"form": form, "length_cells": length, "time_crossings": time, "ratio": ratio}


def _changes(option: Option, measured: Measured, line: Line) -> dict[str, Any]:
    """Return what differs from the case's own scene; `cells` are those of `range`."""
    found: dict[str, Any] = {}
    if option.cells != 1:
        across = measured.across(line["parameters"])
        found |= {"cells": round(across), "cells_ratio": option.cells}
    if option.per_cell is not None:
        found["particles_per_cell"] = option.per_cell
    if option.bulk is not None:
        found["bulk_ratio"] = measured.bulk_ratio(option)
        found["bulk_of_water"] = option.bulk
    if option.extent:
        found["extent"] = option.extent
    return found


def _range(option: Option, measured: Measured, line: Line) -> dict[str, Any]:
    """Return where in the numbers that matter the line was measured."""
    ratio = measured.bulk_ratio(option)
    water = bool(measured.bulk_modulus)
    speed = measured.speed
    if water:
        # The speed is in m/s; the density of water is 1000 kg/m³.
        speed /= (measured.bulk_modulus * ratio / 1000.0) ** 0.5
    per_cell = option.per_cell or line["particles_per_cell"]
    return {
        "cells_across": round(measured.across(line["parameters"])),
        "particles_per_cell": per_cell,
        "compression": measured.head / (measured.bulk_modulus * ratio) if water else None,
        "mach": speed,
        "dimension": 3 if option.extent or line["parameters"].get(measured.depth) else 2,
    }


def entry(line: Line, base: Line) -> dict[str, Any]:
    """Return a line of the atlas; `base` is the baseline of its case."""
    measured, option = CASES[line["case"]], NAMED[line["option"]["name"]]
    errors = errors_of(line, measured)
    drift, own = line["energy_drift"], base["energy_drift"]
    made = {
        "case": measured.name,
        "kind": measured.kind,
        "option": option.name,
        "group": option.group,
        "choices": {
            "transfer": line["option"]["transfer"],
            "kernel": line["option"]["kernel"],
            "fbar": _smoothing(option.fbar, option),
            "solid_fbar": _smoothing(option.solid_fbar, option),
            "material": option.material,
            "precision": option.precision,
            "pipeline": line["pipeline"],
            "cfl": measured.cfl * option.step,
            "layer": line["option"].get("layer"),
            "walls": line["option"].get("walls"),
            **{
                k: v
                for k in ("smoothing", "assumed", "contact", "solids")
                if (v := getattr(option, k)) is not None
            },
        },
        "changes": _changes(option, measured, line),
        "errors": errors,
        "worst": worst(errors, measured),
        "cost": line["cost"],
        "bytes_per_particle": line["bytes_per_particle"],
        "energy_drift": drift,
        "dissipates": drift is not None and drift < own - LOSS,
        "device_kind": line["device_kind"],
        "range": _range(option, measured, line),
    }
    return dict(rounded(made))


def latest(lines: Iterable[Line]) -> dict[tuple[str, str], dict[tuple[str, str], Line]]:
    """Return the newest line of each option and case, by size and kind of device."""
    found: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        if line["option"]["name"] in NAMED and line["case"] in CASES:
            found.setdefault((line["level"], line["device_kind"]), []).append(line)
    return {place: newest(some) for place, some in found.items()}


def is_finer(option: str, own: str) -> bool:
    """Return whether an option is another one with more cells; a slice has the plane's."""

    def choices(name: str) -> tuple[Any, ...]:
        return tuple(getattr(NAMED[name], f) for f in FIXED)

    return NAMED[option].cells > NAMED[own].cells and choices(option) == choices(own)


def finer(entry: Mapping[str, Any], some: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return what was measured of a setting with more cells."""
    own = entry["option"]
    return [e for e in some if e["case"] == entry["case"] and is_finer(e["option"], own)]


def accidental(
    entry: Mapping[str, Any],
    some: Sequence[Mapping[str, Any]],
    broken: Sequence[tuple[str, str]],
) -> bool:
    """Return whether more cells make the error larger by a half and 0.2 %, or let motion die, or
    break the run: `broken` are options and cases."""
    if entry["worst"] is None:
        return True
    if any(c == entry["case"] and is_finer(o, entry["option"]) for o, c in broken):
        return True
    limit = 1.5 * entry["worst"] + 2e-3
    kept = finer(entry, some)
    return any(e["dissipates"] or e["worst"] is None or e["worst"] > limit for e in kept)


def entries(rows: Mapping[tuple[str, str], Line]) -> list[dict[str, Any]]:
    """Return the entries of one size and device in the order of cases and options.

    Without the baseline of its case a setting has no cost.
    """
    order = {name: k for k, name in enumerate(NAMED)}
    cases = {name: k for k, name in enumerate(CASES)}
    keys = sorted(rows, key=lambda key: (cases[key[1]], order[key[0]]))
    ran = [k for k in keys if not rows[k]["failed"] and not rows[BASELINE, k[1]]["failed"]]
    broken = [k for k in keys if rows[k]["failed"]]
    made = [entry(rows[k], rows[BASELINE, k[1]]) for k in ran]
    return [e | {"accidental": accidental(e, made, broken)} for e in made]


def shipped(lines: Sequence[Line]) -> str:
    """Return the text of the shipped file: a line of text for each setting and case."""
    made, broken, devices, last = [], [], {}, lines[-1]
    for rows in latest(lines).values():
        made += entries(rows)
        for line in rows.values():
            if line["failed"]:
                name = {"case": line["case"], "option": line["option"]["name"]}
                reason = line["failed"].partition(":")[0]
                broken.append(name | {"device_kind": line["device_kind"], "failed": reason})
            devices |= dict.fromkeys([line["device"]] if "device" in line else [])
    head = {
        "format": 1,
        "library": last["version"],
        "commit": last["commit"],
        "device": list(devices),
    }
    text = [f"{json.dumps(k)}: {json.dumps(v, ensure_ascii=False)}," for k, v in head.items()]
    for name, some in (("lines", made), ("broken", broken)):
        plain = [json.dumps(e, ensure_ascii=False, separators=(",", ":")) for e in some]
        text.append(f'"{name}": [\n' + ",\n".join(plain) + "\n]" + ("," if name == "lines" else ""))
    return "{\n" + "\n".join(text) + "\n}\n"
