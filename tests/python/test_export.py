"""Reading and exporting what a run has written; what `libmpm info` says about it."""

from __future__ import annotations

import csv
import json
import math
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm._src.cli.commands import main
from libmpm._src.cli.info import packages_of
from libmpm._src.output.export import export
from libmpm._src.output.frames import read_frame, read_series
from libmpm._src.output.results import BodyFrames
from libmpm._src.scene.run_file import RunFile, RunSettings
from python import fake_engine


@pytest.fixture(autouse=True, scope="module")
def core():
    """A stand-in for the compiled module."""
    with pytest.MonkeyPatch.context() as patch:
        made = fake_engine.module()
        patch.setitem(sys.modules, "libmpm._core", made)
        yield made


@pytest.fixture(scope="module")
def simulation(core, tmp_path_factory):
    """A finished run with frames and checkpoints."""
    output = libmpm.Output(
        tmp_path_factory.mktemp("run") / "out", frame_interval=0.02, checkpoint_interval=0.05,
        attributes=["velocity", "pressure", "stress"],
    )  # fmt: skip
    sim = libmpm.Simulation(fake_engine.small_scene(), device="cpu", output=output)
    sim.run(until=0.1, progress=False)
    sim.close()
    return sim


@pytest.fixture
def out(simulation, tmp_path):
    """The folder of the run, a copy of its own."""
    return shutil.copytree(simulation.output.path, tmp_path / "out")


# Reading ------------------------------------------------------------------------------------------


def test_results_are_what_the_run_had(simulation, out):
    results = libmpm.load(out)
    assert results.scene == simulation.scene
    assert results.log["steps"] == 100
    assert list(results.sensors) == list(simulation.sensors)
    for name, series in simulation.sensors.items():
        read = results.sensors[name]
        assert (read.components, read.units) == (series.components, series.units)
        np.testing.assert_array_equal(read.time, series.time)
        np.testing.assert_array_equal(read.values, series.values)
    assert list(results.frames) == ["water", "block"]
    water = results.frames["water"]
    assert isinstance(water, BodyFrames)
    assert water.indices == [0, 1, 2, 3, 4, 5]
    np.testing.assert_allclose(water.times, 0.02 * np.arange(6), atol=1.1e-3)
    last = water[-1]
    assert (last.step, last.time, last.count) == (100, pytest.approx(0.1), 216)
    particles = simulation.particles["water"]
    assert last.names == ["position", "pressure", "stress", "velocity"]
    np.testing.assert_array_equal(last["position"], particles["position"])
    np.testing.assert_array_equal(last["stress"], particles["stress"].astype(np.float32))
    assert last["stress"].shape == (216, 3, 3)
    assert last.units == {"position": "m", "pressure": "Pa", "stress": "Pa", "velocity": "m/s"}
    assert water.at(0.043).index == 2
    assert [f.index for f in water[1:3]] == [1, 2]
    assert [p.name for p in results.checkpoints] == ["step_0000000100.npz", "step_0000000050.npz"]
    assert "finished at 0.1 s" in repr(results)


def test_a_plane_scene_has_two_components(tmp_path):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(
        name="water", shape=libmpm.shapes.Box(lower=(0, 0), upper=(0.3, 0.3)),
        material=libmpm.materials.TaitFluid(),
    )  # fmt: skip
    output = libmpm.Output(tmp_path / "out", frame_interval=1, attributes=["velocity", "stress"])
    sim = libmpm.Simulation(scene, device="cpu", output=output)
    sim.run(until=0.01, progress=False)
    frame = libmpm.load(tmp_path / "out").frames["water"][0]
    assert frame["position"].shape == frame["velocity"].shape == (36, 2)
    assert frame["stress"].shape == (36, 2, 2)


def test_nothing_is_read_before_it_is_asked_for(out):
    results = libmpm.load(out)
    frames, sensors = results.frames, results.sensors
    (out / "sensors.h5").write_bytes(b"")
    for path in (out / "frames").glob("*.vtkhdf"):
        path.write_bytes(b"")
    assert len(frames["water"]) == 6
    with pytest.raises(libmpm.SceneError, match=r"sensors\.h5: is no whole .* 0 bytes.*resume"):
        sensors["load"]
    with pytest.raises(libmpm.SceneError, match="no whole frame"):
        frames["water"][0]


def test_what_is_not_there_is_named(tmp_path, out):
    with pytest.raises(libmpm.SceneError, match=r"no scene\.json.*libmpm run"):
        libmpm.load(tmp_path)
    results = libmpm.load(out)
    with pytest.raises(KeyError, match="did you mean 'load'"):
        results.sensors["laod"]
    with pytest.raises(KeyError, match="did you mean 'pressure'"):
        results.frames["water"][0]["presure"]


# Exporting ----------------------------------------------------------------------------------------


def columns_of(path):
    """Return the columns of a CSV file by title."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return dict(zip(head, np.array(rows, dtype=float).T, strict=True))


def test_csv_holds_every_digit(simulation, out, tmp_path):
    made = export(out, "csv", output=tmp_path / "csv", bodies=["block"])
    frame = libmpm.load(out).frames["block"][-1]
    assert sorted(p.name for p in made) == sorted(
        [f"block_{i:06d}.csv" for i in range(6)] + [f"{n}.csv" for n in simulation.sensors]
    )
    columns = columns_of(tmp_path / "csv" / "block_000005.csv")
    assert list(columns)[:4] == ["position_x [m]", "position_y [m]", "position_z [m]",
                                 "pressure [Pa]"]  # fmt: skip
    np.testing.assert_array_equal(columns["position_z [m]"], frame["position"][:, 2])
    np.testing.assert_array_equal(columns["stress_xz [Pa]"].astype("f4"), frame["stress"][:, 0, 2])
    samples = columns_of(tmp_path / "csv" / "energy.csv")
    np.testing.assert_array_equal(samples["kinetic [J]"], simulation.sensors["energy"].values[:, 0])


def test_npz_a_frame_or_all_in_one(simulation, out):
    made = export(out, "npz", attributes=["velocity"])
    assert made[0].parent == out / "export"
    frame = libmpm.load(out).frames["water"][3]
    with np.load(out / "export" / "water_000003.npz") as archive:
        assert sorted(archive) == ["position", "step", "time", "velocity"]
        np.testing.assert_array_equal(archive["velocity"], frame["velocity"])
        assert archive["time"] == frame.time
    with np.load(out / "export" / "sensors.npz") as archive:
        np.testing.assert_array_equal(archive["load/values"], simulation.sensors["load"].values)
    (whole,) = export(out, "npz", one_file=True)
    with np.load(whole) as archive:
        np.testing.assert_array_equal(archive["frames/water/000003/velocity"], frame["velocity"])
        np.testing.assert_array_equal(archive["sensors/load/time"], simulation.sensors["load"].time)
        assert len({k.rsplit("/", 1)[0] for k in archive if k.startswith("frames")}) == 12


def test_vtkhdf_of_a_part(out, tmp_path):
    made = export(
        out, "vtkhdf", output=tmp_path / "part", bodies=["water"], attributes=["pressure"],
        first=0.03, last=0.08,
    )  # fmt: skip
    assert [p.name for p in made] == [f"water_{i:06d}.vtkhdf" for i in (2, 3, 4)]
    arrays, about = read_frame(made[0])
    assert sorted(arrays) == ["position", "pressure"]
    original = libmpm.load(out).frames["water"][2]
    np.testing.assert_array_equal(arrays["position"], original["position"])
    assert arrays["pressure"].dtype == np.float32
    assert about["time"] == original.time
    assert sorted(read_series(tmp_path / "part", "water")) == [2, 3, 4]


def test_a_checkpoint_gives_any_attribute(simulation, out, tmp_path):
    checkpoint = libmpm.load(out).checkpoints[0]
    (made,) = export(
        checkpoint, "npz", output=tmp_path / "x", bodies=["block"], attributes=["speed", "id"]
    )
    assert made.name == "block_000100.npz"
    particles = simulation.particles["block"]
    with np.load(made) as archive:
        np.testing.assert_array_equal(archive["speed"], particles["speed"])
        np.testing.assert_array_equal(archive["id"], particles["id"])
        np.testing.assert_array_equal(archive["position"], particles["position"])
    made = export(checkpoint, "csv")
    assert [p.parent.name for p in made] == ["export", "export"]
    assert "pressure [Pa]" in columns_of(made[0])


def test_exporting_changes_nothing_of_the_run(out):
    def content():
        return {
            p.relative_to(out): p.read_bytes()
            for p in out.rglob("*")
            if p.is_file() and "export" not in p.parts
        }

    before = content()
    for form in ("vtkhdf", "csv", "npz"):
        export(out, form)
    assert content() == before
    with pytest.raises(libmpm.SceneError, match="own results"):
        export(out, "csv", output=out / "csv")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"to": "vtk"}, "did you mean 'vtkhdf'"),
        ({"to": "csv", "bodies": ["watr"]}, "did you mean 'water'"),
        ({"to": "csv", "attributes": ["sped"]}, "there is no 'sped'"),
        ({"to": "csv", "one_file": True}, "expected npz"),
        ({"to": "csv", "first": 2.0, "last": 1.0}, "swap them"),
    ],
)
def test_what_cannot_be_exported_is_named(out, arguments, message):
    with pytest.raises(libmpm.SceneError, match=message):
        export(out, **arguments)
    assert not list(out.glob("export/*"))


def test_the_command(out, tmp_path, capsys):
    command = ["export", str(out), "--to", "csv", "--body", "water", "--from", "0.05", "-o"]
    assert main([*command, str(tmp_path / "x"), "--no-sensors"]) == 0
    assert capsys.readouterr().out == f"3 files in {tmp_path / 'x'}\n"
    assert main(["export", str(out), "--to", "csv", "--attributes", "colour"]) == 2
    assert "there is no 'colour'" in capsys.readouterr().err
    assert main(["export", str(out / "checkpoints"), "--to", "csv"]) == 2
    (out / "checkpoints" / "step_0000000100.npz").write_bytes(b"PK")
    assert main(["export", str(out / "checkpoints/step_0000000100.npz"), "--to", "csv"]) == 2
    assert "truncated or damaged" in capsys.readouterr().err


# Information --------------------------------------------------------------------------------------


def test_info_of_a_run_a_scene_and_a_checkpoint(simulation, out, tmp_path, capsys):
    assert main(["info", str(out)]) == 0
    text = capsys.readouterr().out
    for part in ("finished", "0.1 s, step 100", "water: 6, 0 to 0.1 s", "load (load-cell): 10",
                 "step_0000000100.npz", "water (TaitFluid)"):  # fmt: skip
        assert part in text
    assert main(["info", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["frames"]["water"]["count"] == 6
    assert found["scene"]["sensors"]["gauge"] == "WaveGauge"

    scene = tmp_path / "scene.json"
    settings = RunSettings(until=2.0)
    scene.write_text(json.dumps(RunFile(simulation.scene, settings).to_dict()))
    assert main(["info", str(scene)]) == 0
    text = capsys.readouterr().out
    for part in ("10 × 10 × 10 cells of 0.1 m", "until       2.0", "gauge (WaveGauge)"):
        assert part in text

    assert main(["info", str(out / "checkpoints" / "step_0000000050.npz"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["kind"], found["step"], found["until"]) == ("checkpoint", 50, 0.1)
    assert math.isclose(found["time"], 0.05)
    assert main(["info", str(tmp_path)]) == 2


def test_info_lists_the_packages_of_every_extra(capsys):
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    project = tomllib.loads(text)["project"]
    lines = list(project["dependencies"])
    for extra, wanted in project["optional-dependencies"].items():
        lines += [f'{line}; extra == "{extra}"' for line in wanted]
    found = packages_of(lines)
    assert {"numpy", "h5py", "scipy", "pandas", "statsmodels", "meshio"} <= set(found)
    assert not {"pytest", "sphinx", "ruff", "libmpm"} & set(found)
    assert main(["info", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["packages"]["numpy"] == np.__version__


def test_check_names_all_problems_and_warnings(tmp_path, capsys):
    document = RunFile(fake_engine.small_scene(), RunSettings()).to_dict()
    path = tmp_path / "scene.json"
    document["bodies"][1]["shape"]["upper"] = [0.63, 0.8, 0.8]
    path.write_text(json.dumps(document))
    with pytest.warns(libmpm.ModelWarning):
        assert main(["check", str(path)]) == 0
    assert main(["check", str(path), "--strict"]) == 2
    document["cell_size"] = -1
    document["bodies"][0]["material"]["density"] = -1
    path.write_text(json.dumps(document))
    capsys.readouterr()
    assert main(["check", str(path)]) == 2
    text = capsys.readouterr().err
    assert "cell_size" in text
    assert "density" in text
