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

from libmpm import Error, FBar, Kernel, Transfer
from libmpm._src import materials_generated
from libmpm._src.lowering import PIPELINES, PRECISIONS
from libmpm._src.transfer import KERNELS, SCHEMES, SWEEPS

FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
SCRIPT = FOLDER / "tradeoff.py"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="needs the source tree")
if SCRIPT.exists():
    sys.path.insert(0, str(FOLDER))
    import tradeoff_table
    from tradeoff_cases import MEASURED
    from tradeoff_options import BASELINE, OPTIONS


def choices(kind, name):
    """The values that a field of a value may take, from its annotation."""
    return typing.get_args(typing.get_type_hints(kind)[name])


def wanted():
    """Pairs of an option and a case that the table has."""
    return [(o, m) for o in OPTIONS for m in MEASURED if o.applies(m.kind, m.materials, m.boundary)]


def lines():
    """The newest lines of the CPU's rows, by names of option and case."""
    some = [
        line for line in tradeoff_table.load(tradeoff_table.RESULTS) if line["level"] == "small"
    ]
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
    # The baseline takes the fused step by itself.
    assert {o.pipeline for o in OPTIONS} == set(PIPELINES) - {"fused"}
    assert lines()[BASELINE, "vortex"]["pipeline"] == "fused"


def test_every_elastic_law_has_a_row():
    """Laws compete where they need the same numbers."""
    elastic = set()
    for name in materials_generated.__all__:
        needs = {p.name for p in getattr(materials_generated, name).table.parameters}
        if needs == {"density", "youngs_modulus", "poissons_ratio"}:
            elastic.add(name)
    assert elastic <= {o.material for o in OPTIONS}


def test_options_differ_by_one_choice_from_what_they_stand_beside():
    names = {o.name: o for o in OPTIONS}
    assert len(names) == len(OPTIONS)
    plain = ("fbar", "solid_fbar", "material", "precision", "pipeline", "step", "walls", "layer")
    fields = ("transfer", "kernel", *plain)
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


def test_the_page_is_up_to_date():
    done = run("check")
    assert done.returncode == 0, done.stdout + done.stderr


def test_another_line_changes_the_page():
    found = tradeoff_table.load(tradeoff_table.RESULTS)
    slower = [{**line, "cost": line["cost"] and line["cost"] + 1} for line in found]
    assert tradeoff_table.page(found) == tradeoff_table.PAGE.read_text(encoding="utf-8")
    assert tradeoff_table.page(slower) != tradeoff_table.page(found)


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
