"""The examples, as their commands run them, with small numbers."""

from __future__ import annotations

import csv
import dataclasses
import json

import numpy as np
import pytest

import libmpm
from support.examples import debris_study


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: [row[key] for row in rows] for key in rows[0]}


def command(monkeypatch, module, folder, *arguments):
    """Run the main function of a module and return its line of costs."""
    words = ["--device", "cpu", "--workers", "0", "--quiet"]
    words += ["--output", str(folder), "--json", str(folder / "costs.jsonl"), *arguments]
    folder.mkdir()
    monkeypatch.setattr("sys.argv", [module.__name__, *words])
    module.main()
    (line,) = (folder / "costs.jsonl").read_text(encoding="utf-8").splitlines()
    return json.loads(line)


def test_debris_in_air(monkeypatch, tmp_path, capsys):
    in_air = debris_study(monkeypatch, "in_air")
    arguments = ["--fields", "12", "--blocks", "5", "--cell-size", "0.05"]
    line = command(monkeypatch, in_air, tmp_path / "out", *arguments)
    found = table(tmp_path / "out" / "fields.csv")
    assert found["seed"] == [str(seed) for seed in range(12)]
    # Every block brings at least its momentum, m v, and at most twice that.
    momentum = np.array(found["c"], dtype=float) * 981 * 0.5 * 0.1 * 0.05
    share = np.array(found["impulse"], dtype=float) / momentum
    assert (share > 0.95).all() and (share < 2).all()
    np.testing.assert_allclose(share, np.array(found["turned_back"], dtype=float))
    assert table(tmp_path / "out" / "metadata.csv")["c"] == [c[0] for c in found["c"]]
    for name in ("angles", "fields", "loads", "regression"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 10_000
    assert line["cases"] == 12 and line["particle_steps_per_s"] > 0
    assert "sqrt theta15" in capsys.readouterr().out


def test_the_hook_for_the_command_line(monkeypatch, tmp_path):
    in_air = debris_study(monkeypatch, "in_air")
    study = in_air.study(tmp_path)
    assert isinstance(study, libmpm.Study) and len(study.rows) == 100


@pytest.fixture
def with_water(monkeypatch):
    """The module with a flume of 12,000 particles."""
    module = debris_study(monkeypatch, "with_water")
    small = dataclasses.replace(
        module.Flume.reduced(),
        length=1.6,
        height=0.7,
        reservoir=(0.4, 0.6),
        still=0.2,
        box=(1.1, 1.3, 0.2, 0.3),
        underside=0.1,
        footprint=(0.5, 0.36),
        corner=0.55,
        count=(1, 1),
        release=0.1,
        until=0.7,
    )
    monkeypatch.setattr(module.Flume, "reduced", lambda: small)
    return module


def test_debris_with_water(with_water, monkeypatch, tmp_path):
    folder = tmp_path / "out"
    line = command(monkeypatch, with_water, folder, "--reduced", "--fields", "2")
    found = table(folder / "with_water.csv")
    assert found["seed"] == ["", "0", "1"] and found["c"] == ["", "1.0", "1.0"]
    assert len(set(found["trunk"])) == 1
    assert line["cases"] == 3
    assert line["time_saved"] == pytest.approx(2 * line["trunk_wall_time"])
    assert (folder / "with_water.png").stat().st_size > 10_000
    assert (folder / "exceedance.csv").exists()

    flume = with_water.Flume.reduced()
    alone, debris = flume.study(folder / "study", 1, shared_device=False).cases
    loads = [flume.load(case) for case in (alone, debris)]
    for load in loads:
        # Still water before the bore: what remains is small beside what follows.
        assert abs(load.plateau(0, 0.15)) < 0.02 * load.largest_peak().value
        assert load.impulse() > 0
    later = [load.window(0.4, 0.7).impulse() for load in loads]
    assert later[0] != pytest.approx(later[1], rel=0.02)


def test_debris_floats_where_it_is_put(with_water, tmp_path):
    """On still water a block neither sinks nor rises: draught and density agree."""
    flume = dataclasses.replace(with_water.Flume.reduced(), reservoir=(0.4, 0.2))
    trunk = libmpm.Simulation(flume.water(), device="cpu", threads=1)
    trunk.run(until=0.05, progress=False)
    trunk.save_checkpoint(tmp_path / "trunk.npz")
    scene = flume.branch(tmp_path / "trunk.npz", 0)
    run = libmpm.Simulation(scene, device="cpu", threads=1)
    before = run.particles["debris-1"]["position"][:, 2].mean()
    displaced = sum(len(trunk.particles[n]) - len(run.particles[n]) for n in trunk.particles)
    water = 1000.0 * flume.cell_size**3 / 8
    block = with_water.DENSITY * np.prod(flume.block)
    assert displaced * water == pytest.approx(block, rel=0.1)
    run.run(until=0.5, progress=False)
    after = run.particles["debris-1"]["position"][:, 2].mean()
    assert abs(after - before) < 0.1 * flume.cell_size
