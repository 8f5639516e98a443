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
