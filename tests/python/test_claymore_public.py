"""Scenes that the authors of ClaymoreUW and HydroUQ publish, coarsened.

They are not part of the repository; LIBMPM_SCENE_DIR names their folder.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import sensors
from libmpm.compat import claymore

#: Cells in CI, m; a quarter of a metre for all others.
COARSE = {"hydrouq_osu_lwf": 0.4}


def public_scenes() -> list[Path]:
    """Return the public scenes, none where their folder is not stated."""
    folder = os.environ.get("LIBMPM_SCENE_DIR")
    return sorted(Path(folder).glob("*.json")) if folder else []


pytestmark = [
    pytest.mark.filterwarnings("ignore::libmpm.ModelWarning"),
    pytest.mark.skipif(not public_scenes(), reason="LIBMPM_SCENE_DIR is not set"),
]


def run_steps(scene: libmpm.Scene, steps: int) -> libmpm.Simulation:
    """Run a few steps on the CPU; every number of every particle must be finite."""
    sim = libmpm.Simulation(scene, device="cpu", precision="single")
    sim.step(steps)
    for body in sim.particles.values():
        for name in ("position", "velocity", "pressure"):
            assert np.all(np.isfinite(body[name]))
    return sim


def test_scenes_load_and_run(tmp_path: Path) -> None:
    scenes = public_scenes()
    trunk = None
    for path in scenes:
        size = COARSE.get(path.stem, 0.25)
        if "Resume" in path.name:
            continue
        found = claymore.load(path, cell_size=size)
        sim = run_steps(found.scene, 4)
        if "CreateCheckpoint" in path.name:
            trunk = tmp_path / "trunk.ckpt"
            sim.save_checkpoint(trunk)
    for path in scenes:
        if "Resume" in path.name:
            with pytest.raises(libmpm.SceneError, match="checkpoint="):
                claymore.load(path, cell_size=0.25)
            assert trunk is not None
            found = claymore.load(path, cell_size=0.25, checkpoint=trunk)
            run_steps(found.scene, 4)


def test_at_their_own_resolution(monkeypatch: pytest.MonkeyPatch) -> None:
    # Nothing is filled here; the numbers follow from the files.
    monkeypatch.setattr("libmpm._src.compat.claymore.build._COUNTED", 0)
    for path in public_scenes():
        if "Resume" in path.name or "hydrouq" in path.name:
            continue
        found = claymore.load(path)
        data = json.loads(path.read_text())
        assert found.scene.cell_size == data["simulation"]["default_dx"]
        assert found.run.until == data["simulation"]["frames"] / data["simulation"]["fps"]
        assert len(found.scene.sensors) >= len(data["grid-sensors"] + data["particle-sensors"])
        assert all(isinstance(s.sensor, sensors.Sensor) for s in found.scene.sensors)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_large_wave_flume_runs_to_its_wave() -> None:
    """The twin of the front end, 4.4 cells deep, until its wave has passed the first gauge.

    A piston in shallow water raises it by u √(h/g) where it moves at u (long waves: Dean and
    Dalrymple 1991, 6.2), 0.19 m here, and the crest travels at √(g (h + η)). Boxes ahead of the
    wave float, the structure is dry: its underside is a cell above the water, so that of the nodes
    around it only the row below has mass, an eighth of a cell's, which linear cells hold at edges.
    All of that could press on the front with no more than ρ g Δx/8 on a row of nodes; higher up
    nothing presses. At 4.4 cells waves were seen to lose a third of their height
    (docs/reference-cases.md), so that it is held to between a half and the whole of it; the place
    where a crest 5 s wide is highest to two thirds of a second.
    """
    paths = [p for p in public_scenes() if p.stem == "hydrouq_osu_lwf"]
    if not paths:
        pytest.skip("the scene is not among the public ones")
    scene = claymore.load(paths[0], cell_size=0.4).scene
    paddle = next(b for b in scene.boundaries if b.name == "paddle")
    time, place = (np.asarray(a) for a in paddle.motion.table.arrays()[:2])
    place = place.reshape(len(time), -1)[:, 0]
    speed = np.gradient(place, time)
    fastest, depth, gauge = speed.argmax(), 2.0 - 0.225, 16.05
    height = speed[fastest] * np.sqrt(depth / 9.81)
    arrives = time[fastest] + (gauge - 1.91 - place[fastest]) / np.sqrt(9.81 * (depth + height))

    sim = libmpm.Simulation(scene, device="cpu", precision="single")
    # Water 0.6 cells deep ahead of it creeps ashore, by 0.4 m/s in the end, with the boxes:
    # none may be within two cells of the structure where that is to be dry.
    until, dry, front = float(arrives + 1.5), 0.0, 45.8 - 2 * 0.4
    for end in np.append(np.arange(0.5, until, 0.5), until):
        sim.run(until=float(end), progress=False)
        boxes = [sim.particles[f"debris-{n}"]["position"][:, 0].max() for n in range(1, 17)]
        if max(boxes) + 0.05 < front:
            dry = sim.time
    series = sim.sensors["WaveGauge1"]
    level = np.asarray(series.values)[:, 0]
    rise = level - level[np.asarray(series.time) < 1.0].mean()
    crest = np.convolve(rise, np.full(15, 1 / 15), mode="same")
    print(f"rise {rise.max():.3f} m of {height:.3f}, at {series.time[crest.argmax()]:.2f} s of "
          f"{arrives:.2f}")  # fmt: skip
    assert 0.5 * height < rise.max() < 1.1 * height
    assert series.time[crest[:-8].argmax()] == pytest.approx(arrives, abs=0.67)
    beside = 1000 * 9.81 * 0.4 / 8 * 0.4 * 1.2  # N: 0.4 m of height, 1.2 m of effective width
    loads = []
    for k in (1, 2):
        cell = sim.sensors[f"LoadCell{k}"]
        loads.append(np.abs(np.asarray(cell.values)[np.asarray(cell.time) <= dry]).max())
    print(f"loads {loads[0]:.1f} and {loads[1]:.1f} N of {beside:.0f} until {dry:.1f} s")
    assert dry > 8.0
    assert loads[0] < beside
    assert loads[1] == 0
    for number in range(1, 17):
        box = sim.particles[f"debris-{number}"]
        assert np.isfinite(box["position"]).all()
        assert 1.6 < box["position"][:, 1].mean() < 2.5
