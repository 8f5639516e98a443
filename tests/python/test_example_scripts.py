"""The examples of one file each run as they stand, and say what theory or a measurement says."""

from __future__ import annotations

import re
import runpy
import warnings
from pathlib import Path

import pytest

import libmpm

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run an example in an empty folder and return the numbers that it prints."""

    def go(name):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr("sys.argv", [name])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        said = capsys.readouterr().out
        return said, [float(x) for x in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?", said)]

    return go


def test_every_example_is_tested():
    tested = set(re.findall(r'run\("(\w+)"\)', Path(__file__).read_text(encoding="utf-8")))
    assert tested == {path.stem for path in EXAMPLES.glob("*.py")}


def test_dam_break(run, tmp_path):
    _, (peak, time, *_) = run("dam_break")
    # Between the push of the head's depth at rest and twice the momentum flux of a bore of H/2
    # at 2 √(g H), a loose bound that wrong signs, units and silence fall out of.
    assert 0.5 * 1000 * 9.81 * 0.1**2 < peak < 2 * 1000 * 0.25 * 4 * 9.81 * 0.5
    # The front needs 0.9 m at up to 2 √(g H) and at least √(g H).
    assert 0.9 / 4.43 < time < 1.0
    for name in ("dam_break.png", "dam_break_load.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_floating_block(run):
    _, (height, archimedes) = run("floating_block")
    assert height == pytest.approx(archimedes, abs=0.002)  # a tenth of a cell


def test_wave_flume(run):
    said, numbers = run("wave_flume")
    speed, solitary = numbers[-2:]
    assert said.count("crest") == 3 and speed == pytest.approx(solitary, rel=0.08)


def test_sand_column(run):
    _, (run_out, height) = run("sand_column")
    assert 0.7 < run_out < 1.6 and 0.7 < height < 1.05


def test_custom_sensor(run):
    _, (front, *_) = run("custom_sensor")
    assert front == pytest.approx(1.16, rel=0.15)


def test_two_gpus(run):
    said, _ = run("two_gpus")
    assert "the bits of cpu" in said


def test_from_cad_mesh(run, tmp_path):
    _, (force, _) = run("from_cad_mesh")
    assert force > 20 and (tmp_path / "from_cad_mesh.png").stat().st_size > 10_000


def test_debris_field_study(run):
    said, numbers = run("debris_field_study")
    mean, low, high = numbers[-3:]
    # Eight bars of 600 kg/m³ × 0.5 m × 0.1 m at 1 m/s bring 240 N·s/m; what bounces brings up to
    # twice as much.
    assert 0.95 * 240 < low <= mean <= high < 480 and "nan" not in said
