"""What attacks have found: numbers beyond all others, texts that are none, odd arguments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from fractions import Fraction

import h5py
import numpy as np
import pytest

import libmpm
from libmpm import analysis, boundaries, demand, materials, shapes
from libmpm._src.cli.commands import main
from libmpm.compat import claymore
from support import fuzz_readers, fuzzing


@pytest.mark.parametrize(
    ("name", "place", "number"),
    [
        ("flume.json", ("boundaries", 0, "domain_start", 1), -1e308),
        ("flume.json", ("boundaries", 1, "bathymetry", 2, 1), 1.7e308),
        ("flume.json", ("boundaries", 2, "domain_start", 0), -1e308),
        ("flume.json", ("boundaries", 2, "domain_end", 0), 1.7e308),
        ("flume.json", ("simulation", "default_dx"), 5e-324),
        ("flume.json", ("simulation", "default_dx"), 1e-300),
        ("models.json", ("grid-boundaries", 1, "domain_start", 1), 1.7e308),
    ],
)
def test_numbers_of_claymore_beyond_all_lengths_are_refused(tmp_path, name, place, number):
    """They became infinite where places were counted in cells."""
    document = json.loads((fuzz_readers.CLAYMORE / name).read_text())
    fuzzing.at(document, place[:-1])[place[-1]] = number
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document))
    found = fuzzing.answer(lambda: claymore.load(path, motion_folder=fuzz_readers.CLAYMORE))
    assert isinstance(found, libmpm.SceneError)
    assert "1e-09 m" in str(found) or "below 1e+30" in str(found)


def test_a_domain_of_claymore_of_more_cells_than_are_counted_is_refused(tmp_path):
    document = json.loads((fuzz_readers.CLAYMORE / "flume.json").read_text())
    document["simulation"]["domain"] = [1e12, 1.0, 1.0]
    document["boundaries"] = []
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document))
    found = fuzzing.answer(lambda: claymore.load(path, motion_folder=fuzz_readers.CLAYMORE))
    assert isinstance(found, libmpm.SceneError)
    assert "fewer than 1e+09 on an axis" in str(found)


@pytest.mark.parametrize("scale", [1e-320, 1e-200, 1e90])
def test_the_axis_of_a_cylinder_of_any_length_has_a_direction(scale):
    """Squares of its length are beyond all numbers."""
    cylinder = shapes.Cylinder(start=(0, 0, 0), end=(3 * scale, 0, 4 * scale), radius=1.0)
    assert cylinder._axis == pytest.approx((0.6, 0, 0.8), rel=1e-3)


@pytest.mark.parametrize("number", [1e100, -1e300, 10**400, np.inf])
def test_numbers_beyond_all_that_is_measured_are_refused(number):
    """Their squares are infinite: they ended in an `OverflowError` of one check or another."""
    for make in (
        lambda: shapes.Box(lower=(-1.0, -1.0), upper=(1.0, abs(number))),
        lambda: libmpm.FBar(length=abs(number)),
        lambda: materials.TaitFluid(bulk_modulus=abs(number)),
        lambda: libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1),
                             gravity=(0, number)),
    ):  # fmt: skip
        with pytest.raises(libmpm.SceneError, match=r"number below 1e\+100|finite number"):
            make()
    with pytest.raises(libmpm.SceneError, match=r"below 1e|not finite|regular table"):
        libmpm.TimeTable((0.0, 1.0), (0.0, number))


@pytest.mark.parametrize("number", [5e-324, 1e-300, 9e-101])
def test_numbers_above_nothing_that_is_measured_are_refused(number):
    """What was divided by them was infinite."""
    for make in (
        lambda: libmpm.Method(time_step=number),
        lambda: materials.TaitFluid(bulk_modulus=1e5, density=number),
        lambda: libmpm.Scene(dimension=2, cell_size=number, lower=(0, 0), upper=(1, 1)),
        lambda: shapes.Sphere(centre=(0, 0, 0), radius=number),
        lambda: shapes.afloat(
            shape=shapes.Box(lower=(0, 0), upper=(1, 1)), density=number, level=1
        ),
    ):
        with pytest.raises(libmpm.SceneError, match="expected ≥ 1e-100"):
            make()


def test_a_gravity_that_moves_nothing_has_a_plan():
    """The modulus that is proposed for a slower sound was beyond all numbers."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -5e-324)
    )
    scene.add_body(
        name="w", shape=shapes.Box(lower=(0, 0), upper=(1, 0.3)),
        material=materials.TaitFluid(bulk_modulus=2e5),
    )  # fmt: skip
    plan = scene.plan(device="cpu", until=1.0, threads=1)
    assert not any("times the flow" in text for text in plan.warnings)


# Characters ---------------------------------------------------------------------------------------


def test_a_text_that_is_no_text_in_a_log_is_shown(tmp_path, capsys):
    folder = tmp_path / "run"
    libmpm.Simulation(fuzz_readers.small_tank(), device="cpu", output=folder).run(
        until=0.002, progress=False
    )
    log = json.loads((folder / "log.json").read_text())
    log["message"] = "a \ud800 b"
    (folder / "log.json").write_text(json.dumps(log))
    call = [sys.executable, "-c", "import sys\nfrom libmpm._src.cli.commands import main\n"
            "sys.exit(main(['info', sys.argv[1], *sys.argv[2:]]))", str(folder)]  # fmt: skip
    for environment in ({"PYTHONIOENCODING": "utf-8"}, {"PYTHONIOENCODING": "ascii"},
                        {"LC_ALL": "C", "PYTHONIOENCODING": "utf-8:surrogateescape"}):  # fmt: skip
        for more in ([], ["--json"]):
            done = subprocess.run([*call, *more], capture_output=True, env=os.environ | environment)
            assert done.returncode == 0, done.stderr.decode()
            assert rb"a \ud800 b" in done.stdout


def test_standard_output_is_as_before_after_a_command(tmp_path, monkeypatch):
    with (tmp_path / "out").open("w", encoding="ascii") as stream:
        monkeypatch.setattr(sys, "stdout", stream)
        assert main(["schema"]) == 0
        assert stream.errors == "strict"
    assert (tmp_path / "out").stat().st_size > 1000


def test_a_scene_with_a_file_whose_name_is_no_text_is_saved(tmp_path):
    name = os.fsdecode(bytes(tmp_path / "points") + b"\xff.csv")
    with open(name, "w") as file:
        file.write("x,y\n0.25,0.25\n0.5,0.25\n")
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(
        name="b", shape=shapes.PointFile(file=name, volume=0.01),
        material=materials.FixedCorotated(density=800.0, youngs_modulus=1e5),
    )  # fmt: skip
    scene.save(tmp_path / "scene.json")
    assert libmpm.Scene.load(tmp_path / "scene.json") == scene
    with libmpm.Simulation(scene, device="cpu", threads=1, output=tmp_path / "run") as sim:
        sim.run(until=1e-3, progress=False)
    assert main(["info", str(tmp_path / "run")]) == 0


def _labelled(label):
    return fuzz_readers.small_tank()


def test_texts_that_are_none_in_a_study_and_in_units_are_stored(tmp_path):
    """The table of a study ended in a `UnicodeEncodeError` when all its cases had run."""
    rows = [{"label": "a\ud800"}, {"label": "a\0b"}]
    study = libmpm.studies.Study(tmp_path / "study", _labelled, rows, until=0.003)
    found = study.run(workers=0, device="cpu", progress=False)
    assert found["label"].tolist() == ["a\ud800", "a\0b"]
    assert rb"a\ud800" in (tmp_path / "study" / "table.csv").read_bytes()
    with h5py.File(tmp_path / "study" / "table.h5") as file:
        assert file["label"].asstr()[:].tolist() == [r"a\ud800", r"a\x00b"]
    scene = fuzz_readers.small_tank()
    one = libmpm.sensors.Custom(function=lambda sim: [1.0], columns=("a",), units=("\ud800\0",))
    scene.add_sensor(name="own", sensor=one)
    output = libmpm.Output(tmp_path / "run")
    with libmpm.Simulation(scene, device="cpu", threads=1, output=output) as sim:
        sim.run(until=0.003, progress=False)
    assert libmpm.load(tmp_path / "run").sensors["own"].units == (r"\ud800\x00",)


# Odd arguments -----------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [np.array([]), np.full(4, np.nan), np.array(["x", "y"]), []])
def test_an_array_for_the_axis_of_a_basin_is_refused(axis):
    bed = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 0.2))
    within = shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1))
    with pytest.raises(libmpm.SceneError, match="axis is"):
        shapes.basin(level=0.5, bed=bed, within=within, axis=axis)


@pytest.mark.parametrize("scatter", [np.array(["1", "2"]), np.zeros((2, 2)), 0.3, None])
def test_a_scatter_of_samples_is_a_choice(scatter):
    with pytest.raises(libmpm.SceneError, match="scatter is"):
        demand.exceedance(lambda c: 2.0 * c, count=[1, 2, 3], samples=10, scatter=scatter)


@pytest.mark.parametrize("function", [int, lambda x: 1 / 0, lambda x: "a"])
def test_what_a_function_of_demand_raises_is_named(function):
    """Functions of a number, of an array, or of what they are not for."""
    for make in (
        lambda: demand.Density(function, lower=0.0, upper=1.0),
        lambda: demand.Reduction(function, upper=1.0),
        lambda: demand.exceedance(function, count=[1, 2, 4], samples=10),
        lambda: demand.expected_load(function, count=demand.Discrete([1.0, 2.0, 4.0, 5.0])),
        lambda: demand.rate_weighted_load(
            lambda c: 2.0 * c, count=[1, 2], porosity=[0.1, 0.2], porosity_reduction=function,
            rate=1.0,
        ),
    ):  # fmt: skip
        assert isinstance(fuzzing.answer(make), libmpm.Error)


def test_arrays_without_a_length_are_no_pairs():
    with pytest.raises(libmpm.SceneError, match="scenarios is"):
        demand.combine(np.array(1.0))
    with pytest.raises(libmpm.SceneError, match="hazard is"):
        demand.exceedance(lambda c: 2.0 * c, count=[1, 2], samples=10, hazard=np.array(1.0))
    with pytest.raises(libmpm.SceneError, match="breaks"):
        demand.Reduction(np.ones_like, upper=1.0, breaks=[None])


def test_samples_that_no_memory_holds_are_refused():
    with pytest.raises(libmpm.SceneError, match="samples is 1e"):
        demand.exceedance(lambda c: 2.0 * c, count=[1, 2], samples=10**9)


@pytest.mark.parametrize("path", [10**5000, fuzzing.nested(5000)], ids=range(2))
def test_a_path_of_a_mesh_that_has_no_text_is_refused(path):
    for shape in (shapes.Tetrahedra, shapes.Triangles):
        with pytest.raises(libmpm.SceneError, match="path is"):
            shape.read(path)


def test_a_mesh_of_no_size_is_refused():
    with pytest.raises(libmpm.SceneError, match="have no area"):
        shapes.Triangles.box(lower=(0, 0), upper=(1e-320, 1e-320), edge=0.5)


@pytest.mark.parametrize(
    "attributes",
    [fuzzing.nested(3), fuzzing.nested(5000), np.array(1.0), [1], [["velocity"]], {"w": [None]},
     {1: ["velocity"]}, {"w": {"velocity": 1}}, b"velocity", {"w": "velocity"}],
    ids=range(10),
)  # fmt: skip
def test_attributes_of_an_output_are_names(tmp_path, attributes):
    with pytest.raises(libmpm.SceneError, match="attributes is"):
        libmpm.Output(tmp_path, attributes=attributes)


def test_intervals_of_an_output_are_numbers_that_a_file_can_hold(tmp_path):
    for many in (10**400, 10**5000):
        with pytest.raises(libmpm.SceneError, match="frame_interval is"):
            libmpm.Output(tmp_path, frame_interval=many)
    output = libmpm.Output(
        tmp_path, frame_interval=Fraction(1, 4), checkpoint_interval=np.float32(0.5),
        attributes={"w": (np.str_("velocity"),)},
    )  # fmt: skip
    assert json.loads(json.dumps(output.to_dict()))["frame_interval"] == 0.25
    assert output.checkpoint_interval == 0.5
    assert type(output.attributes_of("w")[0]) is str
    assert eval(repr(output), {"Output": libmpm.Output}) == output


@pytest.mark.parametrize(
    "text", [10**5000, fuzzing.nested(5000), None], ids=("long", "deep", "none")
)
def test_name_and_unit_of_a_record_are_texts(text):
    for key in ("unit", "name"):
        with pytest.raises(libmpm.SceneError, match=f"{key} is"):
            analysis.Signal([0.0, 1.0], [1.0, 2.0], **{key: text})


@pytest.mark.parametrize("text", [10**5000, *map(fuzzing.nested, (101, 5000))], ids=range(3))
def test_a_rotation_by_what_has_no_text_is_refused(text):
    for key in ("degrees", "angle"):
        with pytest.raises(libmpm.SceneError, match="without a text of its own"):
            boundaries.Rotation(about=(0, 0), rate=1.0, **{key: text})


@pytest.mark.parametrize("item", [np.zeros(0), np.ones(3), [], [True], {}, "on", None, 1, np.nan])
def test_what_is_not_a_choice_is_refused_by_name(item):
    """An array is neither true nor false, and asking it was a `ValueError` of NumPy."""
    flags = {
        "shifting": libmpm.FBar, "density": libmpm.FBar, "boundary": libmpm.Kernel,
        "modified": libmpm.Kernel, "moved_nodes": libmpm.Kernel, "guard": libmpm.Transfer,
    }  # fmt: skip
    for name, kind in flags.items():
        with pytest.raises(libmpm.SceneError, match=f"{name} is .*; expected True or False"):
            kind(**{name: item})
    with pytest.raises(libmpm.SceneError, match=r"boundary is .*; expected True or False"):
        libmpm.Kernel(name="cubic", modified=True, boundary=item)
    with pytest.raises(libmpm.SceneError, match=r"boundary is .*; expected True or False"):
        libmpm.Kernel(name="linear", modified=True, boundary=item)
    choices = {"form": libmpm.FBar, "name": libmpm.Kernel, "scheme": libmpm.Transfer}
    for name, kind in choices.items():
        with pytest.raises(libmpm.SceneError, match=rf"{name} is "):
            kind(**{name: item})
    if not isinstance(item, int | None):
        for name in ("time", "ratio", "length"):
            with pytest.raises(libmpm.SceneError, match=f"{name} is .*expected "):
                libmpm.FBar(**{name: item})
