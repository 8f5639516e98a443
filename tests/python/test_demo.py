"""The demonstration does its job: debris is lifted, hits the structure, and the load shows it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from libmpm._src.cli.demo import load_demo
from libmpm._src.output.frames import list_frames, read_frame
from libmpm._src.output.report import summarise
from libmpm._src.output.sensor_file import read_sensors
from libmpm._src.output.series import moving_mean
from libmpm._src.run.runner import run_to_end, start
from libmpm._src.scene.run_file import without_debris

#: Seconds after arrival in which the peaks are compared.
WINDOW = 0.4


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of the run with debris and of the one without."""
    folders = []
    for name, change in (("with", lambda source: source), ("without", without_debris)):
        source = change(load_demo())
        source = replace(source, settings=replace(source.settings, checkpoint_interval=None))
        folder = tmp_path_factory.mktemp("demo") / name
        sim = start(source, folder, device="cpu")
        text = run_to_end(sim, 1.4, progress=False, picture=name == "with")
        assert "largest peak" in text
        folders.append(folder)
    return folders


@pytest.fixture(scope="module")
def paths():
    """Structure and block sizes of the scene."""
    scene = load_demo().scene
    structure = next(b.shape for b in scene.boundaries if b.name == "structure")
    thickness = scene.bodies[1].shape.upper[2] - scene.bodies[1].shape.lower[2]
    return np.array(structure.lower), np.array(structure.upper), thickness, scene.cell_size


def blocks(folder):
    """Return body -> positions (frames, particles, 3)."""
    debris = load_demo().settings.debris
    found = list_frames(folder / "frames")
    return {
        body: np.array([read_frame(p)[0]["position"] for p in found[body].values()])
        for body in debris
    }


@pytest.mark.timeout(900)
def test_blocks_are_lifted_and_touch_the_face(runs, paths):
    lower, upper, thickness, cell = paths
    count = 0
    for body, x in blocks(runs[0]).items():
        rise = x[:, :, 2].mean(axis=1) - x[0, :, 2].mean()
        # Bodies meet a face through the grid, up to a cell and a half away from it.
        near = (x[:, :, 0].max(axis=1) > lower[0] - 1.5 * cell) & (x[:, :, 0].mean(1) < lower[0])
        level = (x[:, :, 2].max(axis=1) > lower[2]) & (x[:, :, 2].min(axis=1) < upper[2])
        lifted = rise >= thickness
        count += bool(lifted.any() and (near & level).any())
        # A block that hangs would end beside the box, between its side and the wall.
        last = x[-1].mean(axis=0)
        beside = lower[0] < last[0] < upper[0] and not lower[1] < last[1] < upper[1]
        assert not beside, body
    # Three pairs that are images of one another; one reaches the face, the others stop behind it.
    assert count >= 2


@pytest.mark.timeout(900)
def test_debris_raises_the_peak(runs):
    peaks = []
    for folder in runs:
        series = read_sensors(folder / "sensors.h5")["load"]
        load = summarise(series, 0.005)
        assert load is not None
        assert load.component == "force_x"
        force = moving_mean(series.time, series[series.main_component], 0.005)
        window = (series.time >= load.arrival) & (series.time <= load.arrival + WINDOW)
        peaks.append(force[window].max())
    assert peaks[0] >= 1.5 * peaks[1]


@pytest.mark.timeout(900)
def test_the_picture_and_the_gauge_are_there(runs):
    assert (runs[0] / "report.png").stat().st_size > 50_000
    level = read_sensors(runs[0] / "sensors.h5")["gauge"].values
    assert 0.2 < np.nanmax(level) < 1.2


def test_frames_are_enough_for_a_film_and_no_more():
    """It wrote 357 of them, five times what its film shows."""
    source = load_demo()
    moments = round(source.settings.until / source.settings.frame_interval) + 1
    assert moments * len(source.scene.bodies) < 100
