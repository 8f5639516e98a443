"""The benchmark command: its case and the fields of its JSON line."""

from __future__ import annotations

import json
import math
import sys

import pytest

import libmpm
from libmpm._src.cli.bench import FBAR_FORMS, SOUND, collapse, measure, timed
from libmpm._src.cli.commands import main
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


@pytest.mark.parametrize("fbar", FBAR_FORMS)
def test_the_case_is_a_cube_in_a_box_twice_as_long(fbar):
    scene, step = collapse(8_000, fbar)
    assert scene.cells[:2] == (20, 10)
    water = scene.bodies[0]
    height = water.shape.upper[2]
    sound = math.sqrt(water.material.bulk_modulus / water.material.density)
    assert sound == pytest.approx(10 * math.sqrt(2 * 9.81 * height))
    assert step == pytest.approx(0.3 * scene.cell_size / sound)
    assert scene.plan(device="cpu").particles == 8_000


def test_the_cube_may_be_of_another_material_and_fill():
    jelly = libmpm.materials.FixedCorotated(density=1000, youngs_modulus=1e6)
    scene, step = collapse(27_000, material=jelly, particles_per_cell=27, lift=2)
    assert scene.cells == (20, 10, 15)
    solid = scene.bodies[0]
    assert (solid.material, solid.particles_per_cell) == (jelly, 27)
    assert solid.shape.lower[2] == pytest.approx(2 * scene.cell_size)
    assert step == pytest.approx(0.3 * scene.cell_size / SOUND)
    assert scene.plan(device="cpu", time_step=step).particles == 27_000
    with pytest.raises(libmpm.SceneError, match="expected 27 or more"):
        collapse(26, particles_per_cell=27)


def test_any_simulation_can_be_timed():
    jelly = libmpm.materials.FixedCorotated(density=1000, youngs_modulus=1e6)
    scene, step = collapse(1_000, material=jelly)
    block = libmpm.shapes.Box(lower=(1, 0, 0), upper=(1.4, 0.4, 0.4))
    scene.add_body(name="block", shape=block, material=jelly)
    simulation = libmpm.Simulation(scene, device="cpu", time_step=step)
    simulation.step(1)
    tenths = []
    result = timed(
        simulation, 25, case="two", state="started", each_tenth=lambda n, _: tenths.append(n)
    )
    assert simulation.steps == 26
    assert (len(tenths), tenths[-1]) == (10, 25)
    assert (result.case, result.state, result.steps) == ("two", "started", 25)
    assert (result.particles, result.particles_per_cell, result.fbar) == (1_064, 8, "none")
    assert result.particle_steps_per_s == pytest.approx(1_064 * 25 / result.seconds)


def test_the_json_line_has_the_promised_fields(tmp_path, capsys):
    path = tmp_path / "bench.jsonl"
    command = ["bench", "--particles", "1000", "--steps", "50", "--json", str(path)]
    assert main([*command, "--device", "cpu", "--precision", "double", "--fbar", "none"]) == 0
    text = capsys.readouterr().out
    for part in ("first tenth", "last tenth", "bytes per particle", "phases", "precision"):
        assert part in text
    line = json.loads(text.splitlines()[-1])
    assert json.loads(path.read_text()) == line
    fields = "case particles particles_per_cell precision fbar particle_steps_per_s state device"
    assert set(fields.split()) | {"commit", "command"} <= set(line)
    assert (line["particles"], line["precision"], line["fbar"]) == (1000, "double", "none")
    assert sum(line["phases"].values()) == pytest.approx(1) or set(line["phases"].values()) == {0}


def test_bad_requests_are_named():
    with pytest.raises(libmpm.SceneError, match="expected 8 or more"):
        measure(particles=3)
    with pytest.raises(libmpm.SceneError, match="expected 10 or more"):
        measure(steps=3)
    with pytest.raises(libmpm.SceneError, match="fbar is 'three'"):
        measure(fbar="three")
