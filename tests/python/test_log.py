"""What runs say to the logger "libmpm", and that they print nothing."""

import logging

import pytest

import libmpm
from libmpm import boundaries, materials, shapes


def simulation(folder=None, *, bulk_modulus=1e5, velocity=(0.0, 0.0), walls=True):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81), name="tank"
    )
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)),
        material=materials.TaitFluid(bulk_modulus=bulk_modulus),
        velocity=velocity,
    )
    if walls:
        scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    output = None if folder is None else libmpm.Output(folder, checkpoint_interval=0.01)
    return libmpm.Simulation(scene, device="cpu", output=output)


def said(caplog, level):
    return [r.getMessage() for r in caplog.records if r.levelno == level and r.name == "libmpm"]


def test_beginning_checkpoints_and_end(tmp_path, caplog, capsys):
    with caplog.at_level(logging.INFO, "libmpm"):
        simulation(tmp_path / "run").run(until=0.02, progress=False)
    first, *between, last = said(caplog, logging.INFO)
    assert first.startswith("tank: runs from 0 to 0.02 s, step 0, 200 particles, on cpu")
    assert len(between) == 2 and all("checkpoint" in text for text in between)
    assert last.startswith("tank: finished at 0.02")
    assert not said(caplog, logging.WARNING) and not said(caplog, logging.ERROR)
    assert capsys.readouterr() == ("", ""), "a library prints nothing"


def test_a_stopped_run_is_a_warning(caplog):
    with caplog.at_level(logging.INFO, "libmpm"):
        assert not simulation().run(until=1.0, progress=False, wall_limit=0.0)
    (text,) = said(caplog, logging.WARNING)
    assert "interrupted" in text and "wall limit" in text


def test_a_failed_run_is_an_error(caplog):
    with (
        caplog.at_level(logging.INFO, "libmpm"),
        pytest.raises(libmpm.NumericalError),
    ):
        simulation(walls=False).run(until=2.0, progress=False)
    (text,) = said(caplog, logging.ERROR)
    assert "tank: failed" in text and "left the domain" in text


def test_stiff_water_is_a_tip(caplog):
    stiff = simulation(bulk_modulus=2.2e9)
    with caplog.at_level(logging.INFO, "libmpm"):
        stiff.run(until=1e-5, progress=False)
    assert said(caplog, 25) == [f"tank: {text}" for text in stiff.plan.warnings]
    assert said(caplog, 25), "the plan has something to say about water as stiff as it is"


def test_silent_unless_asked_for(capfd):
    simulation().run(until=0.001, progress=False)
    assert capfd.readouterr() == ("", "")
