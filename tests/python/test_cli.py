"""The command line: commands, exit codes, files, and stopping by a signal."""

from __future__ import annotations

import json
import sys

import pytest

from libmpm._src.cli.commands import EXIT_CODES, ExitCode, main
from libmpm._src.cli.demo import load_demo
from libmpm._src.output.frames import list_frames
from libmpm._src.scene.run_file import RunFile, RunSettings, read_run_file, without_debris
from python import fake_engine


@pytest.fixture(autouse=True)
def core(monkeypatch):
    """A stand-in for the compiled module."""
    made = fake_engine.module()
    monkeypatch.setitem(sys.modules, "libmpm._core", made)
    return made


@pytest.fixture
def scene_file(tmp_path):
    """A scene file with a "run" key."""
    settings = RunSettings(
        until=0.1,
        frame_interval=0.02,
        checkpoint_interval=0.05,
        filter=0.02,
        debris=["block"],
        attributes={"water": ["speed"], "block": ["velocity"]},
    )
    path = tmp_path / "scene.json"
    scene = fake_engine.small_scene()
    path.write_text(json.dumps(RunFile(scene, settings).to_dict()))
    return path


def test_run_writes_files_and_prints_the_table(scene_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["run", str(scene_file), "-o", str(out), "--device", "cpu"]) == 0
    text = capsys.readouterr().out
    for part in ("first peak", "largest peak", "impulse", "arrival", "particle-steps/s"):
        assert part in text
    assert "means over 10 ms; peaks of the moving mean over 20 ms" in text
    for name in ("scene.json", "plan.txt", "log.json", "sensors.h5", "report.png", "csv/load.csv"):
        assert (out / name).is_file()
    assert str(out / "report.png") in text
    assert read_run_file(out / "scene.json") == read_run_file(scene_file)
    assert {b: len(v) for b, v in list_frames(out / "frames").items()} == {"water": 6, "block": 6}


def test_a_run_without_frames_says_how_to_get_them(scene_file, tmp_path, capsys):
    content = json.loads(scene_file.read_text())
    quiet = ["-o", str(tmp_path / "out"), "--quiet", "--no-picture", "--device", "cpu"]
    assert main(["run", str(scene_file), *quiet]) == 0
    assert "(12 files, VTKHDF for ParaView)" in capsys.readouterr().out
    del content["run"]["frame_interval"]
    scene_file.write_text(json.dumps(content))
    assert main(["run", str(scene_file), *quiet, "--overwrite"]) == 0
    assert 'frames   none; "frame_interval" in the "run" key' in capsys.readouterr().out


def test_a_second_run_into_the_folder_needs_overwrite(scene_file, tmp_path, capsys):
    out = str(tmp_path / "out")
    command = ["run", str(scene_file), "-o", out, "--quiet", "--no-picture", "--device", "cpu"]
    assert main(command) == 0
    assert main(command) == 4
    assert "--overwrite" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0


def test_without_debris_leaves_the_bodies_out(scene_file, tmp_path):
    source = without_debris(read_run_file(scene_file))
    assert [b.name for b in source.scene.bodies] == ["water"]
    assert source.settings.attributes == {"water": ["speed"]}


def test_resume_goes_on_to_the_recorded_end(scene_file, tmp_path, capsys):
    out = tmp_path / "out"
    quiet = ["--quiet", "--no-picture", "--device", "cpu"]
    assert main(["run", str(scene_file), "-o", str(out), "--until", "0.06", *quiet]) == 0
    assert main(["resume", str(out), "--until", "0.1", *quiet]) == 0
    assert json.loads((out / "log.json").read_text())["steps"] == 100
    assert list(list_frames(out / "frames")["water"]) == [0, 1, 2, 3, 4, 5]
    assert list_frames(out / "frames")["water"][5].is_file()
    capsys.readouterr()
    # A checkpoint file goes on in the folder that it came from, and to the end asked for then.
    checkpoint = sorted((out / "checkpoints").glob("*.npz"))[-1]
    assert main(["resume", str(checkpoint), *quiet]) == 0
    assert str(out / "sensors.h5") in capsys.readouterr().out


def test_plan_check_and_info_print(scene_file, capsys):
    assert main(["plan", str(scene_file), "--device", "cpu"]) == 0
    assert "particles  280" in capsys.readouterr().out
    assert main(["check", str(scene_file)]) == 0
    assert "valid" in capsys.readouterr().out
    assert main(["info"]) == 0
    text = capsys.readouterr().out
    for part in ("libmpm", "backends", "threads", "single, double", "CUDA"):
        assert part in text


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(cell_size=-1), "cell_size"),
        (lambda d: d["run"].update(untill=1), "did you mean 'until'"),
        (lambda d: d["run"].update(until=-1), "until = -1"),
        (lambda d: d.update(run=[]), '"run" is'),
    ],
)
def test_bad_scene_files_exit_with_2(scene_file, capsys, change, message):
    document = json.loads(scene_file.read_text())
    change(document)
    scene_file.write_text(json.dumps(document))
    assert main(["check", str(scene_file)]) == 2
    assert message in capsys.readouterr().err


def test_unreadable_files_exit_with_2(tmp_path, capsys):
    (tmp_path / "bad.json").write_text("{")
    for name in ("bad.json", "none.json"):
        assert main(["check", str(tmp_path / name)]) == 2
        assert name in capsys.readouterr().err
    assert main(["resume", str(tmp_path)]) == 2
    assert "holds no checkpoint" in capsys.readouterr().err


def test_exit_codes_tell_failures_apart(scene_file, tmp_path, core, capsys, monkeypatch):
    command = ["run", str(scene_file), "--quiet", "--no-picture", "--device", "cpu", "-o"]
    (tmp_path / "file").write_text("")
    assert main([*command, str(tmp_path / "file")]) == 4
    assert main([*command, str(tmp_path / "a"), "--device", "cuda:9"]) == 5
    core.Engine.fail_at = 5
    assert main([*command, str(tmp_path / "b")]) == 3
    assert "particle 3, 7" in capsys.readouterr().err
    assert set(EXIT_CODES.values()) == {2, 3, 4, 5}
    assert set(ExitCode) - set(EXIT_CODES.values()) == {0, 1, 6, 130}


def test_the_demonstration_is_as_promised():
    source = load_demo()
    plan = source.scene.plan(device="cpu")
    assert plan.particles >= 100_000
    assert len(source.settings.debris) == 6
    kinds = [placed.sensor.kind for placed in source.scene.sensors]
    assert "load-cell" in kinds
    assert "wave-gauge" in kinds
    structure = next(b for b in source.scene.boundaries if b.name == "structure")
    assert structure.shape.lower[2] > source.scene.lower[2]


def test_options_of_a_run_are_grouped():
    from libmpm._src.cli.options import parser

    (commands,) = (a for a in parser()._actions if hasattr(a, "choices") and a.choices)
    groups = {g.title: g._group_actions for g in commands.choices["run"]._action_groups}
    assert {a.dest for a in groups["several devices or ranks"]} == {
        "cuts", "at", "by", "weights", "rebalance_above",
    }  # fmt: skip
    assert len(groups["options"]) < 8 and all(len(group) < 9 for group in groups.values())
