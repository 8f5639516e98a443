"""The script that redraws figures and measures costs on grids of triangles still runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "triangular_grids.py"

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="needs the source tree")


def run(*arguments):
    found = subprocess.run(
        [sys.executable, str(SCRIPT), *map(str, arguments)], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}, timeout=120, check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    return found.stdout


def test_figures_are_drawn_and_redrawn_from_their_data(tmp_path):
    run("figures", "--output", tmp_path, "--only", "column_starved")
    picture, data = tmp_path / "column_starved.png", tmp_path / "curves.jsonl"
    assert picture.read_bytes().startswith(b"\x89PNG")
    curves = [json.loads(line) for line in data.read_text().splitlines()]
    assert len(curves) == 4
    for curve in curves:
        assert {"figure", "panel", "label", "kind", "x", "y"} == set(curve)
        assert curve["figure"] == "column_starved"
        assert len(curve["x"]) == len(curve["y"]) > 0
    # The same picture from the data alone.
    drawn = picture.read_bytes()
    picture.unlink()
    run("figures", "--output", tmp_path, "--from", data, "--only", "column_starved")
    assert picture.read_bytes() == drawn


def test_cost_is_measured_and_tabled(tmp_path):
    results = tmp_path / "results" / "cost.jsonl"
    run(
        "cost", "--results", results, "--only", "column", "--bases", "P1, 4 blocks", "--steps",
        "own", "--masses", "lumped", "--repeats", 1,
    )  # fmt: skip
    (line,) = [json.loads(text) for text in results.read_text().splitlines()]
    assert line["case"] == "column" and line["basis"] == "P1, 4 blocks"
    assert line["mass"] == "lumped" and line["step"] == "own" and not line["error"]
    assert line["functions"] == 14 and line["particles"] == 1152 and line["threads"] == 1
    assert line["end"] >= line["until"] == 0.4
    assert line["steps"] > 50 and line["seconds"] > 0 and line["bytes"] > 1152 * 50
    assert set(line["timings"]) == {"locate", "assemble", "watch", "step", "sensors"}
    assert sum(line["timings"].values()) == pytest.approx(line["seconds"], rel=0.5)
    assert 0.001 < line["displacement_rms"] < 0.05 and 0.01 < line["velocity_rms"] < 0.3
    assert abs(line["energy_drift"]) < 0.1
    assert {"commit", "device", "version", "command", "setup_s"} <= set(line)
    text = run("cost", "--table", results)
    assert (
        "### Column, one cycle" in text and "| P1, 4 blocks | lumped | own | 14 | 1,152 |" in text
    )
