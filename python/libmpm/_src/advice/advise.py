"""`Scene.advise`: the cheapest measured settings that keep an error, with the reason for each."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.advice.atlas import BASELINE, Atlas, read_atlas
from libmpm._src.advice.choose import (
    Candidate,
    Table,
    candidates,
    choose,
    layer_of,
    per_case,
    present,
    softest,
    walls_of,
)
from libmpm._src.advice.facts import Facts, own_fbar
from libmpm._src.advice.result import Advice, Reason, Settings
from libmpm._src.advice.rules import RULES, Match, matches, unmatched
from libmpm._src.advice.validity_ranges import leaves, of_loads
from libmpm._src.base.values import Checker, nearest, sequence, shown
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.method import FBar
from libmpm._src.run import backends
from libmpm._src.scene.checks import check_scene
from libmpm._src.scene.checks_loads import doubtful_loads
from libmpm._src.shapes.solid import GivenPoints

if TYPE_CHECKING:
    from libmpm._src.scene.scene import Scene

__all__ = ["advise"]

#: What differs between two messages of one kind.
_NUMBERS = re.compile(r"\d[\d.]*(?:e[-+]?\d+)?")
#: Part by which a bulk modulus has to be off before another one is proposed.
_WORTH_IT = 1.25


def advise(
    scene: Scene,
    *,
    error: float = 0.05,
    device: str = "auto",
    cases: Sequence[str] | None = None,
    atlas: Path | None = None,
) -> Advice:
    """Return advice on a scene; see `Scene.advise`. `atlas` is another file than the shipped."""
    error, cases = _checked(scene, error, cases)
    measured = read_atlas(atlas)
    facts = Facts(scene, frozenset(measured.laws))
    kind, warnings = _device(measured, device)
    rows = measured.of(kind)
    found = matches(facts) if cases is None else [m for m in _asked(cases) if _has(facts, m)]
    warnings += unmatched(facts)
    known = [m for m in found if BASELINE in rows.get(m.case, {})]
    warnings += [
        f"case '{m.case}' fits ({m.why}), but the atlas has no line of it on {kind}"
        for m in found
        if m not in known
    ]
    if not found:
        warnings.append("no case of the atlas fits this scene; nothing is proposed")
    source = f"libmpm {measured.version}, commit {measured.commit}, {', '.join(measured.devices)}"
    made = candidates(rows, known, facts) if known else []
    if known and not made:
        names = ", ".join(m.case for m in known)
        warnings.append(
            f"no setting was measured on all of {names}; nothing is proposed; ask for fewer with "
            "cases="
        )
    warnings += leaves(facts, [r for m in known for r in rows[m.case].values()])
    warnings += of_loads(facts, [m.case for m in known])
    doubts = doubtful_loads(scene)
    if not made:
        return Advice(
            scene, error, kind, tuple(found), None, (), None, False, None, None, None, (),
            tuple(warnings + doubts), source,
        )  # fmt: skip
    now = present(made, facts)
    chosen = choose(made, error, now)
    for match in known if chosen.error > error else ():
        best = per_case(rows, match.case, facts)
        if best is not None and (best.worst or 0.0) > error:
            warnings.append(
                f"on case '{match.case}' nothing measured is within {error:.3g}; nearest is "
                f"'{best.option}' with {best.worst or 0.0:.1%}"
            )
    settings, reasons = _settings(facts, rows, known, chosen, now, error)
    advice = Advice(
        scene=scene,
        error=error,
        device=kind,
        matches=tuple(found),
        settings=settings,
        reasons=tuple(reasons),
        expected_error=chosen.error,
        reached=chosen.error <= error,
        cost=chosen.cost,
        present_error=None if now is None else now.error,
        present_cost=None if now is None else now.cost,
        lines=chosen.rows,
        warnings=tuple(warnings),
        source=source,
        refine=chosen.refine,
    )
    said = _of_proposal(doubts, doubtful_loads(advice.apply(cell_size=True)))
    return dataclasses.replace(advice, warnings=(*warnings, *said))


def _of_proposal(doubts: Sequence[str], left: Sequence[str]) -> list[str]:
    """Return doubts about the loads of a scene, each with what the proposal makes of it.

    They are told apart by their words; numbers, such as those of cells, change.
    """
    there = {_NUMBERS.sub("#", text) for text in left}
    return [
        f"{text}; the settings proposed do not change that, since no case of the atlas has it"
        if _NUMBERS.sub("#", text) in there
        else f"{text}; no longer so with the settings and the cell size proposed"
        for text in doubts
    ]


def _checked(
    scene: Scene, error: float, cases: Sequence[str] | None
) -> tuple[float, list[str] | None]:
    """Return the arguments converted; raises `SceneError`."""
    check = Checker("Scene.advise")
    error = check.number("error", error, lower=0, lower_open=True, remedy="0.05 is 5 %")
    if scene.grid is not None:
        check.fail(
            f"the scene has {shown(scene.grid)}, which the atlas has not measured; expected square "
            "cells; libmpm.advice.tradeoff measures settings on the scene itself"
        )
    names = None if cases is None else sequence((cases,) if isinstance(cases, str) else cases)
    for name in names or ():
        if name not in [r.case for r in RULES]:
            check.fail(f"cases has {shown(name)}; {nearest(name, [r.case for r in RULES])}")
    check.finish()
    problems, _ = check_scene(scene)
    if problems:
        raise SceneError(problems)
    return error, names


def _asked(cases: Sequence[str]) -> list[Match]:
    """Return the cases asked for by name, in place of those that the rules find."""
    return [Match(r.case, r.kind, "asked for") for r in RULES if r.case in cases]


def _has(facts: Facts, match: Match) -> bool:
    """Return whether a scene has bodies of the kind of a case."""
    if bool(facts.water if match.kind == "water" else facts.solids):
        return True
    raise SceneError(
        f"Scene.advise: cases has '{match.case}', a case of {match.kind}, of which the scene has "
        "none; leave it out"
    )


def _device(measured: Atlas, device: str) -> tuple[str, list[str]]:
    """Return the kind of device whose rows are used, and a word where it is not the one asked."""
    kind, _ = backends.parse_device(device)
    if measured.of(kind):
        return kind, []
    other = "cpu" if kind == "cuda" else "cuda"
    return other, [f"the atlas has no lines of {kind}; errors and costs are those of {other}"]


# ---- settings -----------------------------------------------------------------------------------


def _settings(
    facts: Facts,
    rows: Table,
    known: Sequence[Match],
    chosen: Candidate,
    now: Candidate | None,
    error: float,
) -> tuple[Settings, list[Reason]]:
    """Return the settings of a candidate and the reason for each."""
    scene, first = facts.scene, chosen.rows[0]
    why = _why(rows, chosen, now)
    cfl = min(row.choices["cfl"] for row in chosen.rows)
    transfer, kernel = first.transfer, first.kernel
    named = scene.method.transfer if transfer == scene.transfer else transfer
    method = dataclasses.replace(scene.method, transfer=named, kernel=kernel, cfl=cfl)
    reasons = [
        _reason("transfer", transfer.to_dict(), scene.transfer.to_dict(), why),
        _reason("kernel", kernel.to_dict(), scene.method.kernel_choice.to_dict(), why),
        Reason("cfl", f"{cfl:g}", _of_step(chosen), cfl != scene.method.cfl),
        Reason(
            "precision",
            first.choices["precision"],
            _of_precision(rows, chosen),
            first.choices["precision"] != "single",
        ),
    ]
    fbar: dict[str, FBar | None] = {}
    particles: dict[str, int] = {}
    for body in (*facts.water, *facts.solids):
        kind = "water" if body in facts.water else "solid"
        row = chosen.of(kind)
        if row is None:
            continue  # nothing was measured on bodies like this
        name = "fbar" if kind == "water" else "solid_fbar"
        fbar[body.name] = row.fbar(name, scene.cell_size, wave_speed(body.material))
        own = own_fbar(body)
        reasons.append(
            Reason(f"F-bar of '{body.name}'", _fbar_text(fbar[body.name]),
                   why if fbar[body.name] != own else "", fbar[body.name] != own)
        )  # fmt: skip
        if body.lattice is None and not isinstance(body.shape, GivenPoints):
            count = row.per_axis**scene.dimension
            particles[body.name] = count
            reasons.append(
                Reason(f"particles of '{body.name}'", f"{count} per cell",
                       f"{row.per_axis} an axis in '{row.option}'",
                       count != body.particles_per_cell)
            )  # fmt: skip
    reasons = _merged(reasons)
    reasons.append(_of_cells(facts, chosen))
    bulk, more = _bulk(facts, rows, known, error)
    walls = walls_of(first, facts)
    changed = facts.mirrorable if walls is not None else ()
    if walls is not None:
        named = "Mirror" if walls == "mirror" else 'Slip(cell="linear")'
        named += f" for {', '.join(changed)}" if changed else ""
        reasons.append(Reason("walls", named, why, bool(changed)))
    layer = next((layer_of(row) for row in chosen.rows if row.case == "slope-basin"), None)
    if layer is not None:
        text = f"{layer.function}, {layer.thickness:g} cells"
        changes = any(own != layer for own in facts.layers)
        reasons.append(Reason("layer of surfaces", text, why, changes))
    settings = Settings(
        method=method,
        precision=first.choices["precision"],
        fbar=fbar,
        particles_per_cell=particles,
        cell_size=scene.cell_size / chosen.refine,
        bulk_modulus=bulk,
        mirrored=changed if walls == "mirror" else (),
        linear=changed if walls == "linear" else (),
        layer=layer,
    )
    return settings, reasons + more


def _reason(name: str, new: dict[str, Any], old: dict[str, Any], why: str) -> Reason:
    """Return the reason of a value whose first field names it; numbers that differ follow."""
    key = "scheme" if name == "transfer" else "name"
    said = ("flip", "shift_max", "order", "every", "gradient", "boundary")
    more = [
        f"{k} {v:g}" if isinstance(v, float) else f"{k} {v}"
        for k, v in new.items()
        if k in said and v != old.get(k) and v is not None
    ]
    return Reason(name, ", ".join([new[key], *more]), why if new != old else "", new != old)


def _why(rows: Table, chosen: Candidate, now: Candidate | None) -> str:
    """Return what the settings reach on each case, against the scene's own or the baseline."""
    said = []
    for k, row in enumerate(chosen.rows):
        beside = rows[row.case][BASELINE] if now is None else now.rows[k]
        name = "baseline" if now is None else "as it is"
        said.append(f"{row.case} {row.worst or 0.0:.1%} ({name} {beside.worst or 0.0:.1%})")
    names = dict.fromkeys(f"'{row.option}'" for row in chosen.rows)
    return f"{' and '.join(names)}: {', '.join(said)}"


def _of_step(chosen: Candidate) -> str:
    rows = ", ".join(dict.fromkeys(f"{r.case} {r.choices['cfl']:g}" for r in chosen.rows))
    return f"measured with {rows}"


def _of_precision(rows: Table, chosen: Candidate) -> str:
    """Return what double precision changes on the cases."""
    found = []
    for row in chosen.rows:
        double = rows[row.case].get("double precision")
        base = rows[row.case][BASELINE]
        if double is not None and double.worst is not None and base.worst is not None:
            found.append((abs(double.worst - base.worst), row.case, double.cost or math.nan))
    if not found:
        return "double precision was not measured on these cases"
    change, case, cost = max(found)
    return f"double changes the error on {case} by {change:.2g}, at {cost:.2g} of the cost"


def _fbar_text(fbar: FBar | None) -> str:
    if fbar is None:
        return "none"
    more = [f"{k} {getattr(fbar, k):.3g} {u}" for k, u in (("length", "m"), ("time", "s"))
            if getattr(fbar, k) is not None]  # fmt: skip
    return ", ".join([fbar.form, *more])


def _merged(reasons: Sequence[Reason]) -> list[Reason]:
    """Return the reasons with one for all bodies of which the same is said."""
    made: list[Reason] = []
    groups: dict[tuple[str, str, str, bool], list[str]] = {}
    for r in reasons:
        what, of, name = r.setting.partition(" of '")
        if not of:
            made.append(r)
            continue
        groups.setdefault((what, r.value, r.why, r.changes), []).append(name.rstrip("'"))
    for (what, value, why, changes), names in groups.items():
        shown = f"'{names[0]}'" if len(names) == 1 else f"{len(names)} bodies"
        made.append(Reason(f"{what} of {shown}", value, why, changes))
    return made


def _of_cells(facts: Facts, chosen: Candidate) -> Reason:
    scene = facts.scene
    finest = max(chosen.rows, key=lambda row: row.cells)
    kinds = [k for k, some in (("water", facts.water), ("solid", facts.solids)) if some]
    have = " and ".join(f"{facts.cells(k):.3g} across the {k}" for k in kinds)
    why = f"{have}; '{finest.option}' on {finest.case} has {finest.cells:g}"
    if chosen.refine > 1:
        why += "; apply(cell_size=True) does it"
    value = f"{scene.cell_size / chosen.refine:.4g} m"
    return Reason("cell size", value, why, chosen.refine > 1)


def _bulk(
    facts: Facts, rows: Table, known: Sequence[Match], error: float
) -> tuple[Mapping[str, float], list[Reason]]:
    """Return the least bulk modulus of each body of water, and the reason.

    With ρ g H/K and v/c as in the softest water that keeps the error; two laws have to stay within
    the error too: the side force of a tank, off by (2/3) ρ g H/K, and what water is compressed by
    where its flow is stopped, (v/c)²/2.
    """
    limit = softest(rows, [m.case for m in known if m.kind == "water"], error)
    if limit is None or not facts.water:
        return {}, []
    allowed = min(limit.compression, 1.5 * error)
    fastest = min(limit.mach or math.inf, math.sqrt(2 * error))
    found: dict[str, float] = {}
    reasons = []
    for body in facts.water:
        now = body.material.parameters()["bulk_modulus"]
        compression = facts.compression(body)
        ratio = max(compression / allowed, (facts.mach(body) / fastest) ** 2)
        if not ratio > 0 or 1 / _WORTH_IT < ratio < _WORTH_IT:
            continue
        found[body.name] = float(f"{now * ratio:.3g}")
        why = (
            f"ρgH/K {compression:.2g} and v/c {facts.mach(body):.2g}; '{limit.row.option}' on "
            f"{limit.row.case} and the laws allow {allowed:.2g} and {fastest:.2g}; "
            f"{math.sqrt(ratio):.2g} of the steps; apply(bulk_modulus=True) does it"
        )
        value = f"{found[body.name]:.3g} Pa"
        reasons.append(Reason(f"bulk modulus of '{body.name}'", value, why, True))
    return found, _merged(reasons)
