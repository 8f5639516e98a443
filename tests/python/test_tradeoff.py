"""The trade-off table has a row for every option, its file a line for every row, its page both."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
import typing
from pathlib import Path

import pytest

from libmpm import Error, FBar, contacts
from libmpm._src.materials import generated
from libmpm._src.methods.transfer import KERNELS, SCHEMES, SWEEPS
from libmpm._src.run.choices import PIPELINES, PRECISIONS
from libmpm.methods import Kernel, Transfer

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPT = FOLDER / "tradeoff.py"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="needs the source tree")
if SCRIPT.exists():
    sys.path.insert(0, str(FOLDER))
    import atlas_data
    import atlas_page
    import result_pages
    import tradeoff_table
    from tradeoff_cases import CHANGING, MEASURED, wave_speed
    from tradeoff_options import BASELINE, BY_LENGTH, OPTIONS, SHORT


def choices(kind, name):
    """The values that a field of a value may take, from its annotation."""
    return typing.get_args(typing.get_type_hints(kind)[name])


def wanted():
    """Pairs of an option and a case that the table has."""
    return [(o, m) for o in OPTIONS for m in MEASURED if m.applies(o)]


def lines():
    """The newest lines of the CPU's rows, by names of option and case."""
    some = [line for line in result_pages.load(tradeoff_table.RESULTS) if line["level"] == "small"]
    return tradeoff_table.newest(some)


def run(*arguments):
    return subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, timeout=240, check=False,
    )  # fmt: skip


def test_every_transfer_has_a_row():
    assert {o.transfer.scheme for o in OPTIONS} == set(SCHEMES)
    for name in ("shift_rule", "below"):
        assert {getattr(o.transfer, name) for o in OPTIONS} == set(choices(Transfer, name))
    assert {o.transfer.guard for o in OPTIONS} == {True, False}
    for scheme in SWEEPS:
        assert {o.transfer.every > 1 for o in OPTIONS if o.transfer.scheme == scheme} == {
            True,
            False,
        }


def test_every_kernel_and_gradient_has_a_row():
    found = {(o.kernel.name, o.kernel.form, o.kernel.boundary) for o in OPTIONS}
    possible = set()
    for name, gradient, boundary in itertools.product(KERNELS, ("mls", "kernel"), (False, True)):
        try:
            kernel = Kernel(name=name, gradient=gradient, boundary=boundary)
        except Error:
            continue
        possible.add((kernel.name, kernel.form, kernel.boundary))
    assert found == possible


def test_every_form_of_fbar_precision_and_pipeline_has_a_row():
    forms = set(choices(FBar, "form"))
    assert {o.fbar for o in OPTIONS} == {o.solid_fbar for o in OPTIONS} == forms | {None}
    assert {o.precision for o in OPTIONS} == set(PRECISIONS)
    # The baseline takes the fused step by itself; "by-body" is what "auto" is called afterwards.
    assert {o.pipeline for o in OPTIONS} == set(PIPELINES) - {"fused", "by-body"}
    assert lines()[BASELINE, "vortex"]["pipeline"] == "fused"


def test_every_law_of_contact_has_a_row():
    laws = {name for name in contacts.__all__ if name not in ("Stick", "ContactLaw")}
    assert {o.contact for o in OPTIONS} == laws | {None}
    for law in laws:
        assert any(o.contact == law and m.applies(o) for o in OPTIONS for m in MEASURED)


def test_every_elastic_law_has_a_row():
    """Laws compete where they need the same numbers."""
    elastic = set()
    for name in generated.__all__:
        needs = {p.name for p in getattr(generated, name).table.parameters}
        if needs == {"density", "youngs_modulus", "poissons_ratio"}:
            elastic.add(name)
    assert elastic <= {o.material for o in OPTIONS}


def test_options_differ_by_one_choice_from_what_they_stand_beside():
    names = {o.name: o for o in OPTIONS}
    assert len(names) == len(OPTIONS)
    plain = ("fbar", "solid_fbar", "material", "precision", "pipeline", "step", "walls", "layer")
    changes = ("size", "cells", "per_cell", "bulk", "extent", "smoothing", "assumed", "contact",
               "solids")  # fmt: skip
    fields = ("transfer", "kernel", *plain, *changes)
    for option in OPTIONS:
        other = names[option.beside]
        changed = [f for f in fields if getattr(option, f) != getattr(other, f)]
        assert len(changed) == (option.name != BASELINE), option.name


def test_every_row_is_measured_with_the_choices_that_it_has_now():
    found = lines()
    assert set(found) == {(o.name, m.name) for o, m in wanted()}
    for option, measured in wanted():
        line = found[option.name, measured.name]
        assert line["option"] == option.to_dict()
        assert {"commit", "command", "version", "threads", "precision", "level"} <= set(line)
        if line["failed"]:
            assert line["cost"] is None
            continue
        assert line["cost"] > 0 and line["simulated_s"] > 0 and line["steps"] > 0
        assert line["particles"] > 0 and line["bytes_per_particle"] > 0
        assert line["bytes_per_node"] > 0 and line["particles_per_cell"] > 0 and line["device"]
        assert set(line["errors"]) == set(measured.expected)
        assert (line["energy_drift"] is None) == (measured.energy is None)


def test_every_axis_has_rows_to_both_sides_of_the_base():
    assert {o.cells for o in OPTIONS} >= {0.5, 1, 2}
    assert {o.per_cell for o in OPTIONS if not o.extent} >= {1, 9, 16}
    assert {o.per_cell for o in OPTIONS if o.extent} >= {1, None, 27}
    assert {o.bulk for o in OPTIONS} >= {1, 1 / 10, 1 / 100}
    assert {o.step for o in OPTIONS} >= {0.5, 1, 2}
    assert {o.extent for o in OPTIONS} == {"", "slice", "full"}
    usual = {o.fbar: o.smoothed for o in OPTIONS if o.group == "F-bar"}
    for form, value in usual.items():
        sizes = [o.size for o in OPTIONS if o.fbar == form and o.size is not None]
        assert min(sizes) < value < max(sizes)
    assert set(SHORT) <= {o.name for o in OPTIONS}


def test_a_change_means_the_same_in_every_case():
    bases = {m.name: m.build(OPTIONS[0], "small")[0] for m in MEASURED if "small" in m.sizes}
    for option, measured in wanted():
        # The tank makes a body of each particle, which takes time; "hydrostatic" is made alike.
        if option.group not in CHANGING or measured.name == "tank":
            continue
        base, own = bases[measured.name], measured.build(option, "small")[0]
        assert own.cell_size * option.cells == pytest.approx(base.cell_size)
        assert own.dimension == (3 if option.extent else 2)
        per_cell = option.per_cell or 2**own.dimension
        assert own.bodies[0].particles_per_cell == per_cell
        if option.bulk is not None:
            laws = [b.material.to_dict() for b in own.bodies]
            found = {law["bulk_modulus"] for law in laws if "bulk_modulus" in law}
            assert len(found) == 1 and found.pop() == pytest.approx(option.bulk * 2.2e9)
        assert own.method.cfl == pytest.approx(base.method.cfl * option.step)


def test_smoothing_counts_in_cells_and_in_crossings_of_sound():
    measured = next(m for m in MEASURED if m.name == "vortex")
    for option in OPTIONS:
        if option.group == "F-bar size" and measured.applies(option):
            scene = measured.build(option, "small")[0]
            body, dx = scene.bodies[0], scene.cell_size
            sound = wave_speed(body.material.to_dict())
            if option.fbar in BY_LENGTH:
                assert body.fbar.length == pytest.approx(option.size * dx)
            else:
                assert body.fbar.time == pytest.approx(option.size * dx / sound)


def test_numbers_that_ranges_count_from_are_those_of_the_scenes():
    for measured in MEASURED:
        size = "small" if "small" in measured.sizes else "device"
        if size == "device" or measured.kind == "solid":
            continue
        scene = measured.build(OPTIONS[0], size)[0]
        law = scene.bodies[0].material.to_dict()
        assert law["bulk_modulus"] == pytest.approx(measured.bulk_modulus), measured.name
        assert 0 < measured.head / measured.bulk_modulus <= 0.05


def test_the_shipped_atlas_has_what_was_measured():
    data = json.loads(atlas_data.DATA.read_text(encoding="utf-8"))
    assert data["format"] == 1 and data["library"] and data["device"]
    entries = {(e["option"], e["case"], e["device_kind"]): e for e in data["lines"]}
    assert len(entries) == len(data["lines"])
    found = lines()
    for (option, case), line in found.items():
        if line["failed"]:
            assert (option, case, "cpu") not in entries
            continue
        entry = entries[option, case, "cpu"]
        judged = atlas_data.judged(atlas_data.CASES[case])
        if all(k in entry["errors"] for k in judged):
            assert entry["worst"] == max(abs(entry["errors"][k]) for k in judged)
        assert entry["cost"] == pytest.approx(line["cost"], rel=1e-3)
        assert entry["range"]["cells_across"] >= 2 and entry["range"]["particles_per_cell"] >= 1
    for kept in data["broken"]:
        if kept["device_kind"] == "cpu":
            assert found[kept["option"], kept["case"]]["failed"]


def test_the_cheapest_setting_is_within_its_error_and_not_right_by_accident():
    some = atlas_data.entries(lines())
    for case in atlas_data.CASES:
        own = [e for e in some if e["case"] == case]
        for value in atlas_data.judged(atlas_data.CASES[case]):
            chosen = atlas_page.choose(own, value, 0.05)
            good = [e for e in own if atlas_page.settled(e, own, value, 0.05)]
            assert (chosen is None) == (not good)
            if chosen is not None:
                assert abs(chosen["errors"][value]) <= 0.05 and not chosen["dissipates"]
                assert chosen["cost"] <= atlas_page.SAME * min(e["cost"] for e in good)


def test_what_more_cells_undo_is_not_chosen():
    some = atlas_data.entries(lines())
    own = [e for e in some if e["case"] == "incline"]
    coarse = next(e for e in own if e["option"] == "half the cells")
    # Right by accident: the base and finer ones slide a third and more too far.
    assert abs(coarse["errors"]["distance_ratio_0.95"]) < 0.05
    assert not atlas_page.settled(coarse, own, "distance_ratio_0.95", 0.05)
    front = {e["option"]: e for e in some if e["case"] == "dam-break"}
    assert front["half the cells, slice, 1 particle per cell"]["accidental"]
    assert not front["baseline"]["accidental"]


def test_the_pages_and_the_atlas_are_up_to_date():
    done = run("check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_another_line_changes_pages_and_atlas():
    found = result_pages.load(tradeoff_table.RESULTS)
    slower = [{**line, "cost": line["cost"] and line["cost"] + 1} for line in found]
    assert tradeoff_table.page(found) == tradeoff_table.PAGE.read_text(encoding="utf-8")
    for make in (tradeoff_table.page, atlas_page.atlas_page, atlas_data.shipped):
        assert make(slower) != make(found)


def test_a_budget_ends_a_run_that_goes_on(tmp_path):
    output = tmp_path / "lines.jsonl"
    chosen = ("--cases", "bar", "--options", "cubic", "--output", output)
    done = run("run", *chosen, "--budget", 0)
    assert done.returncode == 0 and "goes on" in done.stdout and not output.exists()


def test_a_run_is_recorded_and_not_repeated(tmp_path):
    output = tmp_path / "lines.jsonl"
    chosen = ("--cases", "mode", "--options", "two-pass", "mixed precision", "--output", output)
    for _ in range(2):
        done = run("run", *chosen)
        assert done.returncode == 0, done.stderr
        made = [json.loads(text) for text in output.read_text().splitlines()]
        names = [line["option"]["name"] for line in made]
        assert names == [BASELINE, "mixed precision", "two-pass", BASELINE]
    first, mixed, passes, _ = made
    assert mixed["failed"].startswith("SceneError") and mixed["cost"] is None
    # The same discretisation in another order of sums.
    assert passes["values"]["period"] == pytest.approx(first["values"]["period"], rel=1e-4)
    assert passes["pipeline"] == "two-pass" and first["pipeline"] == "fused"
    assert passes["steps"] == first["steps"]
