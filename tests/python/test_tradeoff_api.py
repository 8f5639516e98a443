"""`libmpm.advice.tradeoff`: what is varied, measured, held against what, and which rows win."""

from __future__ import annotations

import itertools
import json
import math
import re
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import libmpm
from libmpm import FBar, ModelWarning, SceneError, boundaries, materials, sensors, shapes
from libmpm._src.advice.tradeoff.choices import CHOICES, apply_choices
from libmpm._src.advice.tradeoff.front import front
from libmpm._src.advice.tradeoff.metrics import energy_drift, with_energy
from libmpm._src.advice.tradeoff.result import COLUMNS
from libmpm.advice import TradeOff

G, DENSITY, DEPTH, WIDTH = 9.81, 1000.0, 0.4, 0.2
#: Pa: ρgH/K is 0.02, the force on a wall less than ½ρgH² by 2/3 of it.
MODULUS = DENSITY * G * DEPTH / 0.02
AT_REST = 0.5 * DENSITY * G * DEPTH**2
SETTLED = "side/force_x/settled"


def tank(cell_size=0.1, modulus=MODULUS, interval=0.005, hydrostatic=DEPTH, **body):
    """A tank of 32 particles in 2D, started in balance, with the force on a wall."""
    scene = libmpm.Scene(
        dimension=2,
        cell_size=cell_size,
        lower=(0, 0),
        upper=(WIDTH, 0.6),
        gravity=(0, -G),
        name="tank",
    )
    scene.add_body(
        name="water",
        shape=shapes.Box(lower=(0, 0), upper=(WIDTH, DEPTH)),
        material=materials.TaitFluid(density=DENSITY, bulk_modulus=modulus),
        hydrostatic=hydrostatic,
        **body,
    )
    walls = shapes.DomainWalls(faces=("x-", "x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=boundaries.Slip(cell="held"))
    side = sensors.LoadCell(boundary="walls", faces=("x+",), interval=interval)
    scene.add_sensor(name="side", sensor=side)
    return scene


def run(scene, axes, **how):
    """Run for 0.1 s without a bar, with the force on the wall as the metric."""
    given = {"until": 0.1, "metrics": SETTLED, "progress": False, "device": "cpu"}
    return libmpm.advice.tradeoff(scene, axes, **(given | how))


@pytest.fixture(scope="module")
def table():
    """Cells and moduli against the analytic force."""
    axes = {"cell_size": [0.1, 0.05], "bulk_modulus": [1.0, 0.25]}
    return run(tank(), axes, reference=AT_REST)


# What is measured ---------------------------------------------------------------------------------


def test_all_combinations_with_error_time_and_memory(table):
    assert len(table) == 4 and not table.failed
    assert set(COLUMNS) <= set(table.columns)
    pairs = [(row["cell_size"], row["bulk_modulus"]) for row in table.rows]
    assert pairs == list(itertools.product([0.1, 0.05], [1.0, 0.25]))
    for row in table.rows:
        assert row["error"] == pytest.approx(abs(row[SETTLED] / AT_REST - 1), rel=1e-12)
        assert row[f"{SETTLED}_error"] == pytest.approx(row[SETTLED] / AT_REST - 1, rel=1e-12)
        assert row["time"] > 0 and row["wall_time"] > 0 and row["steps"] > 0
        assert row["device"] == "cpu" and row["precision"] == "single" and row["threads"] == 1
        assert not row["reference"] and row["spread"] is None
    assert table.clock == "processor"
    np.testing.assert_array_equal(table["time"], table["processor_time"])


def test_memory_is_that_of_the_plan(table):
    rows = {(r["cell_size"], r["bulk_modulus"]): r for r in table.rows}
    fine, coarse = rows[0.05, 1.0], rows[0.1, 1.0]
    assert fine["particles"] == 4 * coarse["particles"] == 128
    assert fine["bytes_per_particle"] == tank().plan(device="cpu").bytes_per_particle("water")
    assert coarse["memory"] == with_energy(tank(), 0.1).plan(device="cpu").memory_total


def test_a_soft_fluid_is_faster_and_wrong_by_its_own_weight():
    """Gravity at once: the column comes to rest shorter, with (2/3) ρgH/K less force on a wall and
    ρgH/(3K) less energy, relative to that of its height: half of what its fall sets free."""
    axes = {"bulk_modulus": [1.0, 0.25], "transfer": ["PIC"]}
    table = run(tank(0.025, hydrostatic=None), axes, reference=AT_REST, until=2.0)
    stiff, soft = table.rows
    for row in (stiff, soft):
        compression = 0.02 / row["bulk_modulus"]  # ρgH/K
        # Walls take 0.344 of 16 cells of the depth, of which F-bar heals three quarters and more.
        assert abs(row["error"] - 2 / 3 * compression) < 0.25 * 2 * 0.344 / 16
        # Water stiffens as (n + 1)/2 of its compression, n = 7.15.
        assert row["energy_drift"] == pytest.approx(-compression / 3, rel=4.1 * compression)
    assert stiff["steps"] / soft["steps"] == pytest.approx(2, rel=0.05)
    assert soft["time"] < stiff["time"] and soft["error"] > stiff["error"]
    assert [row["bulk_modulus"] for row in table.pareto] == [0.25, 1.0]
    assert table.cheapest(error=0.02) == stiff and table.cheapest(error=0.1) == soft
    assert table.most_accurate(time=stiff["time"]) == stiff


def test_energy_drift_is_measured_where_no_energy_comes_in(table):
    # A tank that starts in balance: what it can lose is less than gravity at once sets free.
    for row in table.rows:
        assert abs(row["energy_drift"]) < 0.02 / row["bulk_modulus"] / 3
    pushed = libmpm.Scene.from_dict(tank().to_dict())
    motion = libmpm.TimeTable([0.0, 1.0], [[0.0, 0.0], [0.1, 0.0]])
    pushed.add_boundary(
        name="paddle",
        shape=shapes.Box(lower=(0.0, 0.5), upper=(0.1, 0.6)),
        response=boundaries.Slip(),
        motion=motion,
    )
    assert with_energy(pushed, 1.0) is pushed
    assert [s.name for s in with_energy(tank(), 1.0).sensors] == ["side", "energy"]
    (row,) = run(pushed, {"cfl": [0.4]}, reference=AT_REST).rows
    assert row["energy_drift"] is None and row["error"] is not None


def test_the_drift_is_a_share_of_the_largest_energy(tmp_path):
    scene = tank()
    scene.add_sensor(name="energy of all", sensor=sensors.Energy(interval=0.01))
    assert with_energy(scene, 1.0) is scene
    study = libmpm.Study(tmp_path, lambda: scene, [{}], until=0.1)
    study.run(workers=0, progress=False)
    (case,) = study.cases
    series = case.sensors["energy of all"]
    total = series.values[:, :3].sum(axis=1)
    expected = (total[-math.ceil(len(total) / 10) :].mean() - total[0]) / total.max()
    assert energy_drift(case) == pytest.approx(expected, rel=1e-3, abs=1e-12)


def test_metrics_are_functions_names_and_mappings():
    def both(case):
        force = case.sensors["side"].values[:, 0]
        return {"top": np.max(force), "mass": np.int64(7)}

    names = ["last", "peak", "largest", "least", "mean", "rms", "settled"]
    known = {name: f"side/force_x/{name}" for name in names}
    metrics = known | {"both": both, "samples": lambda case: len(case.sensors["side"])}
    table = run(tank(), {"cfl": [0.4]}, metrics=metrics, reference={"peak": AT_REST, "top": 1.0})
    (row,) = table.rows
    assert not row["failure"]
    assert set(table.metrics) == {*names, "top", "mass", "samples"}
    assert row["least"] <= row["mean"] <= row["rms"] <= row["largest"] == row["top"]
    assert abs(row["peak"]) == max(abs(row["largest"]), abs(row["least"]))
    assert row["samples"] > 10 and row["mass"] == 7
    # Only what has a reference has an error, and the worst one counts.
    assert "mean_error" not in table.columns
    assert row["error"] == max(abs(row["peak_error"]), abs(row["top_error"]))


def test_where_the_reference_is_zero_the_error_is_absolute():
    metrics = {"up": "side/force_y/settled"}
    (row,) = run(tank(), {"cfl": [0.4]}, metrics=metrics, reference={"up": 0}).rows
    assert row["up_error"] == row["up"] and row["error"] == abs(row["up"])


def test_a_function_of_a_row_is_a_reference():
    """The shift of the equilibrium is part of what is expected: less error is left."""

    def expected(row):
        return AT_REST * (1 - 2 / 3 * 0.02 / row["bulk_modulus"])

    axes = {"bulk_modulus": [1.0, 0.5]}
    known = run(tank(), axes, reference=expected)
    for row in known.rows:
        assert row["error"] == pytest.approx(abs(row[SETTLED] / expected(row) - 1), rel=1e-9)
    broken = run(tank(), axes, reference=lambda row: row["no such name"])
    assert all("KeyError" in row["failure"] for row in broken.rows) and len(broken.failed) == 2


# The finest row -----------------------------------------------------------------------------------


def test_the_finest_row_is_the_reference_and_has_no_error():
    axes = {"precision": ["single", "double"], "cell_size": [0.1, 0.05], "cfl": [0.4, 0.2]}
    table = run(tank(), axes)
    (finest,) = [row for row in table.rows if row["reference"]]
    assert (finest["cell_size"], finest["precision"], finest["cfl"]) == (0.05, "double", 0.2)
    assert finest["error"] is None and not finest["front"] and not finest["failure"]
    for row in table.rows:
        if row is not finest:
            assert row["error"] == pytest.approx(abs(row[SETTLED] / finest[SETTLED] - 1))
    assert len(table.pareto) >= 1 and finest not in table.pareto
    assert "finest" in table.reference and "reference" in repr(table)


def test_a_named_row_is_the_reference():
    axes = {"cell_size": [0.1, 0.05], "cfl": [0.4, 0.2]}
    table = run(tank(), axes, reference={"cfl": 0.4})
    (chosen,) = [row for row in table.rows if row["reference"]]
    assert (chosen["cell_size"], chosen["cfl"]) == (0.05, 0.4)
    with pytest.raises(SceneError, match=r"reference has cfl=0.3, which no row has.*0.4, 0.2"):
        run(tank(), axes, reference={"cfl": 0.3})


def test_a_finest_row_that_failed_is_told():
    # A step that is stable on cells of 0.1 m and not on those of 0.05 m.
    step = 0.9 * tank(0.1).plan(device="cpu").time_step
    with pytest.warns(ModelWarning, match="a finer row than the reference has failed"):
        table = run(tank, {"cell_size": [0.1, 0.05]}, options={"time_step": step})
    failed = [row["cell_size"] for row in table.failed]
    assert failed == [0.05] and "time_step" in table.failed[0]["failure"]
    assert [row["cell_size"] for row in table.rows if row["reference"]] == [0.1]


# What can be varied -------------------------------------------------------------------------------


VALUES = {
    "cell_size": (0.05, lambda s: s.cell_size),
    "particles_per_cell": (9, lambda s: s.bodies[0].particles_per_cell),
    "cfl": (0.25, lambda s: s.method.cfl),
    "transfer": (libmpm.methods.Transfer(scheme="AFLIP", flip=0.5), lambda s: s.method.transfer),
    "kernel": (libmpm.methods.Kernel(name="cubic"), lambda s: s.method.kernel),
    "fbar": (FBar(form="two-volume", length=0.1), lambda s: s.bodies[0].fbar),
    "solid_fbar": (FBar(time=0.1), lambda s: s.bodies[1].fbar),
    "layer": (boundaries.DecayLayer(thickness=0.1), lambda s: s.boundaries[-1].layer),
}


@pytest.fixture
def full():
    """A scene that has every choice."""
    scene = tank()
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(0.0, 0.5), upper=(0.1, 0.6)),
        material=materials.FixedCorotated(density=500.0, youngs_modulus=1e5),
    )
    scene.add_boundary(
        name="ball",
        shape=shapes.Sphere(centre=(0.1, 0.0), radius=0.02),
        response=boundaries.Slip(cell="held"),
    )
    return scene


def test_choices_change_what_they_say_and_nothing_else(full):
    before = full.to_dict()
    assert set(VALUES) | {"bulk_modulus", "rigid", "elements"} == set(CHOICES)
    for name, (value, read) in VALUES.items():
        made = apply_choices(full, {name: value})
        assert read(made) == value, name
        assert apply_choices(made, {name: read(full)}) == full, name
    soft = apply_choices(full, {"bulk_modulus": 0.5})
    assert soft.bodies[0].material.bulk_modulus == 0.5 * MODULUS
    assert soft.bodies[1] == full.bodies[1]
    stiff = apply_choices(full, {"rigid": ("block",)})
    assert stiff.bodies[1].material == materials.Rigid(density=500.0)
    assert stiff.bodies[0] == full.bodies[0] and apply_choices(full, {"rigid": ()}) == full
    meshed = apply_choices(full, {"elements": ("block",), "cell_size": 0.1})
    assert isinstance(meshed.bodies[1].shape, shapes.Triangles)
    assert meshed.bodies[1].shape.edge == pytest.approx(0.05)
    assert meshed.bodies[1].shape.total_volume() == pytest.approx(0.01)
    assert meshed.bodies[0] == full.bodies[0] and apply_choices(full, {"elements": ()}) == full
    assert full.to_dict() == before


def test_a_mesh_that_cuts_corners_off_has_the_mass_of_the_solid():
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2))
    disc = shapes.Sphere(centre=(1.0, 1.0), radius=0.4)
    law = materials.NeoHookean(density=500.0, youngs_modulus=1e5, poissons_ratio=0.3)
    scene.add_body(name="disc", shape=disc, material=law)
    body = apply_choices(scene, {"elements": "disc"}).bodies[0]
    assert body.shape.total_volume() < 0.998 * math.pi * 0.4**2
    mass = body.material.density * body.shape.total_volume()
    assert mass == pytest.approx(500 * math.pi * 0.4**2)


def test_only_solids_that_can_be_meshed_become_elements(full, tmp_path):
    with pytest.raises(SceneError, match="elements has 'water', which is no solid body"):
        apply_choices(full, {"elements": ("water",)})
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2))
    law = materials.NeoHookean(density=500.0, youngs_modulus=1e5, poissons_ratio=0.3)
    np.savetxt(tmp_path / "dots.csv", [(0.5, 0.5), (0.55, 0.5)], delimiter=",")
    dots = shapes.PointFile(file=tmp_path / "dots.csv", volume=0.0025)
    scene.add_body(name="dots", shape=dots, material=law)
    with pytest.raises(SceneError, match="'dots', whose particles come from PointFile"):
        apply_choices(scene, {"elements": ("dots",)})


def test_names_stand_for_their_values(full):
    made = apply_choices(full, {"transfer": "FLIP", "kernel": "cubic", "fbar": "one-volume"})
    assert made.method.transfer == libmpm.methods.Transfer(scheme="FLIP")
    assert made.bodies[0].fbar == FBar(form="one-volume") and made.bodies[1] == full.bodies[1]


@pytest.mark.parametrize(
    ("name", "values", "message"),
    [
        ("cel_size", [0.1], r"'cel_size' is no numerical choice.*did you mean 'cell_size'"),
        ("dimension", [2, 3], r"'dimension' cannot be varied of a scene.*give a factory"),
        ("reproducible", [True], r"'reproducible' cannot be varied: every run gives the same bits"),
        ("solid_fbar", [None], r"no solid of the scene has volume smoothing"),
        ("layer", [None], r"no boundary of the scene is a surface"),
        ("cell_size", [0.1, -0.1], r"cell_size is -0.1; expected > 0 m"),
        ("cfl", [1.5], r"cfl is 1.5; expected > 0 and ≤ 1"),
        ("bulk_modulus", ["1e6"], r"bulk_modulus is '1e6'; expected a number"),
        ("particles_per_cell", [0], r"particles_per_cell is 0; expected a whole number ≥ 1"),
        ("transfer", ["APICC"], r"transfer is 'APICC'.*did you mean 'APIC'"),
        ("transfer", ["AFLIP"], r"flip"),
        ("kernel", ["quartic"], r"kernel is 'quartic'"),
        ("fbar", ["two-volume"], r"length"),
        ("fbar", [3], r"fbar has 3; expected FBar"),
        ("precision", ["half"], r"precision is 'half'"),
        ("pipeline", ["fuse"], r"did you mean 'fused'"),
        ("device", ["gpu"], r"device has 'gpu'"),
        ("threads", [-1], r"threads is -1"),
        ("cfl", [0.4, 0.4], r"axes has 0.4 twice in 'cfl'"),
        ("cfl", [], r"axes has 'cfl' with \[\]; expected a name and a list"),
        ("cfl", 0.4, r"axes has 'cfl' with 0.4"),
    ],
)
def test_bad_axes_are_named_before_anything_runs(name, values, message, monkeypatch):
    monkeypatch.setattr(libmpm.Study, "run", lambda *a, **k: pytest.fail("something ran"))
    with pytest.raises(SceneError, match=message):
        run(tank(), {name: values})


def test_all_problems_are_told_at_once():
    with pytest.raises(SceneError) as caught:
        run(
            tank(),
            {"cfl": [2.0], "dimension": [2]},
            until=0,
            metrics=["side/force_x/lst", "sid/force_x/last", 3],
            reference="finnest",
            repeats=0,
            clock="sun",
            one_at_a_time=1,
        )
    text = str(caught.value)
    parts = ["cfl is 2", "'dimension'", "until is 0", "'last'", "'side'", "metrics has 3"]
    parts += ["did you mean 'finest'", "repeats is 0", "clock is 'sun'", "one_at_a_time is 1"]
    assert [part for part in parts if part not in text] == []
    with pytest.raises(SceneError, match="argument 'until' is missing"):
        libmpm.advice.tradeoff(tank(), {"cfl": [0.4]}, metrics=SETTLED)
    with pytest.raises(SceneError, match="expected a Scene or a function"):
        run(3, {"cfl": [0.4]})
    with pytest.raises(SceneError, match="workers is given with an executor"):
        run(tank(), {"cfl": [0.4]}, executor=object(), workers=1)


def test_a_body_with_its_own_choice_keeps_it():
    own = tank(lattice=(3, 5))
    with pytest.raises(SceneError, match="body 'water' has a lattice of its own"):
        run(own, {"particles_per_cell": [4, 9]})
    own = tank(transfer=libmpm.methods.Transfer())
    with pytest.raises(SceneError, match="body 'water' has a transfer of its own"):
        run(own, {"transfer": ["APIC", "PIC"]})


def test_a_scene_that_goes_on_from_a_checkpoint_keeps_its_choices(tmp_path):
    """Its state has the step, the columns and the cells of the run that wrote it."""
    before = libmpm.Simulation(tank(), device="cpu", threads=1)
    before.run(until=0.02, progress=False)
    before.save_checkpoint(tmp_path / "trunk.npz")
    scene = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz")
    for name, value in VALUES.items():
        with pytest.raises(
            SceneError, match=f"'{name}' cannot be varied of this scene: it continues"
        ):
            run(scene, {name: [value[0]]})
    # Options of a run can be, and time counts from where it begins.
    (row,) = run(scene, {"threads": [1]}, reference=AT_REST, until=0.04).rows
    dt = before.plan.time_step
    assert row["error"] < 0.1 and row["steps"] == pytest.approx(0.02 / dt, abs=2)


def test_a_factory_takes_its_own_names_first():
    """`modulus` is an absolute value of the factory's; `cfl` is put into what it returns."""
    seen = []

    def factory(modulus, cell_size=0.1):
        seen.append((modulus, cell_size))
        return tank(cell_size, modulus)

    axes = {"modulus": [MODULUS, 0.5 * MODULUS], "cfl": [0.4, 0.2], "precision": ["double"]}
    table = run(factory, axes, reference=AT_REST)
    assert not table.failed and set(seen) == {(MODULUS, 0.1), (0.5 * MODULUS, 0.1)}
    steps = {(r["modulus"], r["cfl"]): r["steps"] for r in table.rows}
    assert steps[MODULUS, 0.2] / steps[MODULUS, 0.4] == pytest.approx(2, rel=0.1)
    assert set(table["precision"]) == {"double"}
    with pytest.raises(SceneError, match="no default for 'modulus', which is no axis"):
        run(factory, {"cell_size": [0.1]})
    with pytest.raises(SceneError, match="did you mean 'modulus'"):
        run(factory, {"modulos": [MODULUS]})
    with pytest.raises(SceneError, match="the axis 'error' is the name of a column"):
        run(lambda error: tank(), {"error": [1, 2]})


def test_one_at_a_time_varies_around_the_first_values():
    axes = {"cell_size": [0.1, 0.05], "cfl": [0.4, 0.3, 0.2], "transfer": ["APIC", "PIC"]}
    table = run(tank(), axes, one_at_a_time=True, reference=AT_REST)
    rows = [tuple(row[name] for name in axes) for row in table.rows]
    assert rows == [(0.1, 0.4, "APIC"), (0.05, 0.4, "APIC"), (0.1, 0.3, "APIC"),
                    (0.1, 0.2, "APIC"), (0.1, 0.4, "PIC")]  # fmt: skip


# What goes wrong, and going on --------------------------------------------------------------------


def test_what_breaks_is_a_row_with_its_reason():
    def scene(kind):
        if kind == "factory":
            raise RuntimeError("no such tank")
        # A cell size that does not divide the domain, and particles that leave through the roof.
        return tank(0.07) if kind == "cells" else tank()

    def metric(case):
        last = case.sensors["side"].values[-1, 0]
        return math.nan if case.parameters["kind"] == "metric" else last

    kinds = ["good", "factory", "cells", "metric"]
    table = run(scene, {"kind": kinds}, metrics={"force": metric}, reference=AT_REST)
    why = {row["kind"]: row["failure"] for row in table.rows}
    assert why["good"] == ""
    assert "RuntimeError: no such tank" in why["factory"]
    assert why["cells"].startswith("SceneError") and "whole number" in why["cells"]
    assert "metric 'force' gave nan" in why["metric"]
    assert [row["kind"] for row in table.failed] == kinds[1:]
    assert table.pareto == (table.rows[0],)
    assert "no such tank" in repr(table) and "failed" in table._repr_html_()


def test_metrics_that_fit_no_column_are_named():
    axes = {"cfl": [0.4]}
    cases = {
        "side/force_z/last": r"no component 'force_z'; did you mean 'force_",
        "side/last": r"no component ''",
    }
    for metric, message in cases.items():
        (row,) = run(tank(), axes, metrics=metric, reference=1).failed
        assert re.search(message, row["failure"]), row["failure"]
    (row,) = run(tank(), axes, metrics=lambda case: {}, reference=1).failed
    assert "the metrics gave no number" in row["failure"]
    (row,) = run(tank(), axes, metrics={"error": SETTLED}, reference=1).failed
    assert "'error' has the name of another column" in row["failure"]
    (row,) = run(tank(), axes, reference={"side": 1.0}).failed
    assert "reference has 'side', which no metric gives" in row["failure"]
    (row,) = run(tank(), axes, metrics=[SETTLED, "side/force_x/last"], reference=1.0).failed
    assert "one number for the metrics" in row["failure"]


def test_a_folder_goes_on_and_is_read_again(tmp_path, counted):
    axes = {"cell_size": [0.1], "cfl": [0.4, 0.2]}
    first = run(tank(), axes, reference=AT_REST, folder=tmp_path)
    assert len(counted) == 2
    axes["cell_size"] = [0.1, 0.05]
    again = run(tank(), axes, reference=AT_REST, folder=tmp_path)
    assert len(counted) == 4 and len(again) == 4
    assert again.rows[:2] == first.rows or again.rows[0]["time"] == first.rows[0]["time"]
    # A changed metric needs no run.
    other = run(tank(), axes, metrics="side/force_x/peak", reference=AT_REST, folder=tmp_path)
    assert len(counted) == 4 and other.metrics == ("side/force_x/peak",)
    assert TradeOff.load(tmp_path) == other
    assert (tmp_path / "tradeoff.csv").read_text().count("\n") == 5


def test_an_interrupted_sweep_goes_on(tmp_path, counted, monkeypatch):
    from libmpm._src.studies.study import worker

    real, calls = worker._Attempt._simulate, []

    def once(attempt):
        calls.append(attempt)
        if len(calls) == 2:
            raise KeyboardInterrupt
        real(attempt)

    monkeypatch.setattr(worker._Attempt, "_simulate", once)
    axes = {"cfl": [0.4, 0.3, 0.2]}
    with pytest.raises(KeyboardInterrupt):
        run(tank(), axes, reference=AT_REST, folder=tmp_path)
    table = run(tank(), axes, reference=AT_REST, folder=tmp_path)
    assert len(calls) == 4 and not table.failed


def test_repeats_take_the_least_time_and_tell_the_spread(counted):
    table = run(tank(), {"cfl": [0.4, 0.2]}, reference=AT_REST, repeats=3, clock="wall")
    assert len(counted) == 6 and table.clock == "wall"
    for row in table.rows:
        assert row["spread"] >= 0 and row["time"] == row["wall_time"] > 0
    assert "repeats differ by up to" in table.summary()


def test_an_executor_takes_the_runs():
    """Of threads of one process nobody can tell whose processor time it was."""
    with ThreadPoolExecutor(1) as executor:
        table = run(tank(), {"cfl": [0.4, 0.2]}, reference=AT_REST, executor=executor)
    assert not table.failed and table.clock == "wall"
    assert [row["processor_time"] for row in table.rows] == [None, None]
    assert all(row["time"] == row["wall_time"] > 0 for row in table.rows)


def test_a_value_survives_being_saved(tmp_path):
    transfers = ["PIC", libmpm.methods.Transfer(scheme="PIC-FLIP", flip=0.9)]
    table = run(tank(), {"transfer": transfers, "fbar": [None, "default"]}, reference=AT_REST)
    table.save(tmp_path / "table.json")
    back = TradeOff.load(tmp_path / "table.json")
    assert back == table and back.rows[2]["transfer"] == transfers[1]
    assert "PIC-FLIP(flip=0.9)" in repr(table)
    for content in ("", "[]", json.dumps({"tradeoff": 2}), "{}"):
        (tmp_path / "table.json").write_text(content)
        with pytest.raises(libmpm.OutputError, match=r"expected a file of TradeOff\.save"):
            TradeOff.load(tmp_path / "table.json")


def test_the_table_as_arrays_and_pictures(table, tmp_path):
    records = table.to_records()
    assert records.shape == (4,) and records["error"].dtype == np.float64
    np.testing.assert_array_equal(records["cell_size"], table["cell_size"])
    pandas = pytest.importorskip("pandas")
    frame = table.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and list(frame.columns) == list(table.columns)
    table.to_csv(tmp_path / "table.csv")
    read = pandas.read_csv(tmp_path / "table.csv", float_precision="round_trip")
    np.testing.assert_array_equal(read["error"], table["error"])
    picture = table.plot(by="bulk_modulus")
    axes = picture.axes[0]
    assert axes.get_xscale() == axes.get_yscale() == "log"
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["bulk_modulus = 1", "bulk_modulus = 0.25", "front"]
    drawn = sum(len(line.get_xdata()) for line in axes.lines[:2])
    assert drawn == 4 and table.plot(axes=axes) is picture
    with pytest.raises(SceneError, match="did you mean 'bulk_modulus'"):
        table.plot(by="bulk_modulos")
    with pytest.raises(KeyError, match="did you mean 'error'"):
        table["errors"]


# The front ----------------------------------------------------------------------------------------

#: Few values, so that rows tie often.
COARSE = st.sampled_from([0.0, 1e-3, 0.5, 1.0, 2.0])
NUMBER = st.none() | st.just(math.nan) | COARSE | st.floats(1e-9, 1e9)
ROWS = st.lists(st.fixed_dictionaries({"error": NUMBER, "time": NUMBER}), max_size=12)


def made(rows):
    """A table of rows with given errors and times."""
    full = [
        dict.fromkeys(COLUMNS) | {"number": i, "failure": "", "reference": False} | row
        for i, row in enumerate(rows)
    ]
    return TradeOff(tuple(full), ("number",), ())


def rated(rows):
    return [
        r for r in rows if all(r[k] is not None and math.isfinite(r[k]) for k in ("error", "time"))
    ]


def beats(a, b):
    no_worse = a["error"] <= b["error"] and a["time"] <= b["time"]
    return no_worse and (a["error"] < b["error"] or a["time"] < b["time"])


@given(ROWS)
@settings(deadline=None)
def test_nothing_beats_the_front_and_the_front_beats_the_rest(rows):
    best = [rows[i] for i in front(rows)]
    compared = rated(rows)
    assert all(not any(beats(a, b) for a in compared) for b in best)
    numbers = set(front(rows))
    for i, row in enumerate(rows):
        if i not in numbers and row in compared:
            assert any(beats(a, row) for a in best)
    assert bool(best) == bool(compared)
    times, errors = [r["time"] for r in best], [r["error"] for r in best]
    assert times == sorted(times) and errors == sorted(errors, reverse=True)


@given(ROWS, st.randoms(use_true_random=False))
@settings(deadline=None)
def test_the_front_does_not_depend_on_the_order_of_rows(rows, random):
    order = list(range(len(rows)))
    random.shuffle(order)
    shuffled = [rows[i] for i in order]
    assert {order[i] for i in front(shuffled)} == set(front(rows))


@given(ROWS, COARSE.filter(bool) | st.floats(1e-9, 1e9))
@settings(max_examples=200, deadline=None)
def test_the_cheapest_and_the_most_accurate_are_on_the_front(rows, limit):
    table = made(rows)
    for method, bounded, wanted in (
        (table.cheapest, "error", "time"),
        (table.most_accurate, "time", "error"),
    ):
        within = [r for r in rated(table.rows) if r[bounded] <= limit]
        if within:
            found = method(limit)
            assert found[bounded] <= limit
            assert found[wanted] == min(r[wanted] for r in within)
            assert found in table.pareto
            continue
        with pytest.raises(SceneError) as caught:
            method(limit)
        if rated(table.rows):
            nearest = min(rated(table.rows), key=lambda r: (r[bounded], r[wanted]))
            assert f"no row has {bounded} ≤ {limit:g}" in str(caught.value)
            assert f"{bounded} {nearest[bounded]:.4g}" in str(caught.value)
        else:
            assert "no row has an error and a time" in str(caught.value)


def test_limits_are_positive_numbers(table):
    for wrong in (0, -1, "small", math.nan):
        with pytest.raises(SceneError, match=r"TradeOff.cheapest: error is"):
            table.cheapest(error=wrong)
    with pytest.raises(SceneError, match="argument 'time' is missing"):
        table.most_accurate()
    assert table.cheapest(error=1.0) == min(table.rows, key=lambda r: r["time"])
    with pytest.raises(SceneError, match=r"the nearest is cell_size=.*allow more"):
        table.cheapest(error=1e-12)
