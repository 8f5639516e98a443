"""Water at its extremes: what is promised holds, what lies outside is named, and the map is whole.

The whole sweep is `benchmarks/extremes.py`; here both ends of each short axis are tried.
"""

from __future__ import annotations

import math
import os
import signal
import time

import numpy as np
import pytest

import libmpm
from libmpm import materials, shapes
from support.devices import device  # noqa: F401
from support.extremes import CPU, FOLDER, ends, expect_holds, expect_outcome

ALONE = ()

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="needs the source tree")
if FOLDER.exists():
    import extremes
    import extremes_page
    import extremes_water
    import extremes_workers
    from extremes_axis import FORBIDDEN, Axis, Trial, probe
    from extremes_workers import DeviceLostError, Task, Worker, together

    #: Axes of water alone.
    ALONE = [a for a in extremes_water.AXES if a.group == "water"]


def axis(name):
    """The axis of a name."""
    return next(a for a in extremes.AXES if a.name == name)


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize(("one", "value"), ends(ALONE, single=True))
def test_envelope_holds(one, value):
    expect_holds(one, value)


#: Axis, value outside its envelope, outcome, and what the program says.
OUTSIDE = [
    ("cfl", 1.5, "refused", "cfl is 1.5.*lower|cfl is 1.5.*expected"),
    ("cfl, lone particle, 3D", 0.8, "named", "Remedy: lower Method.cfl"),
    ("distance from the origin", 1e13, "refused", "resolved.*use an origin nearer"),
    ("coordinates", 1e13, "refused", "whole number"),
    ("volume ratio, compressed", 0.3, "named", "Remedy: lower Method.cfl"),
    ("volume ratio, expanded", 19.9, "named", "Remedy: lower Method.cfl"),
    ("compression", 100.0, "named", "Remedy: lower Method.cfl"),
    ("impact", 1e4, "named", "Remedy: lower Method.cfl"),
    ("flight", 1e-9, "warned", "use precision=.double"),
    ("time step", 10.0, "refused", "stable limit.*Lower it"),
    ("time step", 1e-6, "refused", "precision='double' or a longer time step"),
    ("time step", 1e-30, "refused", "precision='double' or a longer time step"),
    ("sample interval", 1e-12, "refused", "0 samples every step"),
]


@pytest.mark.parametrize(("name", "value", "outcome", "says"), OUTSIDE)
def test_outside_is_named(name, value, outcome, says):
    expect_outcome(extremes.AXES, name, value, outcome, says)


@pytest.mark.parametrize("pipeline", ["auto", "two-pass", "phased"])
@pytest.mark.parametrize("transfer", ["APIC", "FLIP", "FMPM"])
def test_overflow_is_named(transfer, pipeline, device):  # noqa: F811
    """A pressure beyond float32: whether sums are numbers or integers, none is silently lost."""
    scene = block(
        material=materials.TaitFluid(bulk_modulus=1e16, exponent=20.0),
        method=libmpm.Method(transfer=transfer),
    )
    run = libmpm.Simulation(scene, device=device, precision="single", pipeline=pipeline)
    if pipeline == "two-pass" and transfer != "APIC":
        with pytest.raises(libmpm.SceneError, match="two-pass"):
            run.step(1)
        return
    count = len(run.particles["water"])
    pressure = 1e16 / 20 * math.expm1(-20 * math.log(0.06))
    assert 3.5e38 < pressure < 1e40
    run.particles["water"]["pressure"] = np.full(count, pressure)
    with pytest.raises(libmpm.NumericalError, match="no longer finite at step 0"):
        run.step(10)
    assert run.steps == 0
    assert np.isfinite(run.particles["water"]["position"]).all()


def test_stress_beside_which_motion_rounds_away_is_named(device):  # noqa: F811
    """Steps are 4000 times too long, yet forces of a full box cancel and velocities are lost."""
    found = probe(axis("volume ratio, compressed"), 0.051, device=device, precision="single")
    assert found.outcome == "named", found.message
    assert "Remedy: lower Method.cfl" in found.message
    assert found.steps <= 1


def test_samples_fall_due_in_the_steps_that_viscosity_allows():
    """Waves allow 4e-3 s, viscosity 1.25e-6 s: 2e-8 s is often for one of them."""
    for viscosity, step in ((1e-3, 4e-3), (1e6, 1.25e-6)):
        scene = block(material=materials.TaitFluid(bulk_modulus=1e5, viscosity=viscosity))
        scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy(interval=2e-8))
        if step > 1e-4:
            with pytest.raises(libmpm.SceneError, match=r"time step of 0\.004 s; .* every step"):
                libmpm.Simulation(scene, device="cpu")
            continue
        run = libmpm.Simulation(scene, device="cpu")
        assert run.plan.time_step == pytest.approx(step)
        run.step(2)


def block(material=None, **options):
    """A free block of water of 4 cells without gravity."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0),
        **{k: v for k, v in options.items() if k != "velocity"},
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6)),
        material=material or materials.TaitFluid(bulk_modulus=1e5),
        velocity=options.get("velocity"),
    )  # fmt: skip
    return scene


def test_courant_number_of_a_lone_particle_is_doubted(recwarn):
    """1/√2 in 2D; solids and smaller numbers are not doubted."""
    with pytest.warns(libmpm.ModelWarning, match="a particle of fluid alone.*0.707; lower cfl"):
        block(method=libmpm.Method(cfl=0.71)).validate()
    recwarn.clear()
    block(method=libmpm.Method(cfl=0.7)).validate()
    assert not [w for w in recwarn if "alone" in str(w.message)]


def test_slow_motion_that_rounds_away_is_doubted(recwarn):
    """c = 10 m/s, a step is 0.04 cells at c: 2.5 units of float32 are 7.5e-6 m/s."""
    slow = block(velocity=(7e-6, 0.0))
    with pytest.warns(libmpm.ModelWarning, match="single precision resolves.*precision='double'"):
        libmpm.Simulation(slow, device="cpu", precision="single")
    recwarn.clear()
    libmpm.Simulation(slow, device="cpu", precision="double")
    libmpm.Simulation(block(velocity=(8e-6, 0.0)), device="cpu", precision="single")
    libmpm.Simulation(block(velocity=(0.0, 0.0)), device="cpu", precision="single")
    assert not [w for w in recwarn if "resolves" in str(w.message)]


# ---- the harness --------------------------------------------------------------------------------


def _made(build, name="made", **more):
    return Axis(
        name=name, unit="1", meaning="", base=1.0, envelope=(1.0, 2.0), reach=(1.0, 100.0),
        scale="log", build=build, **more,
    )  # fmt: skip


def says_where(text="{}"):
    """A trial that is refused with the id of the process that it was tried in."""

    def build(value):
        raise libmpm.SceneError(text.format(os.getpid()))

    return build


def crash(value):
    os.kill(os.getpid(), signal.SIGKILL)


def hang(value):
    time.sleep(60)


@pytest.fixture
def worker():
    """A worker for axes that do what their names say."""
    axes = {
        "here": says_where(), "crash": crash, "hang": hang,
        "fault": says_where("cudaErrorIllegalAddress in {}"),
        "full": says_where("out of device memory: {}"),
    }  # fmt: skip
    worker = Worker({name: _made(build, name) for name, build in axes.items()})
    yield worker
    worker.stop()


def test_one_process_answers_until_it_fails(worker):
    """A crash or a hang is the outcome of its own probe, and the next one finds a new process."""

    def ask(name, limit=20.0):
        return worker.probe(name, 1.0, limit, **CPU)

    seen = []
    for name, outcome in (("crash", "crash"), ("hang", "hang")):
        one, two = ask("here").message, ask("here").message
        assert one == two != str(os.getpid())
        found = ask(name, 20.0 if name == "crash" else 0.5)
        assert (found.outcome, found.holds) == (outcome, False)
        seen.append(one)
    assert "code -9" in ask("crash").message
    seen.append(ask("here").message)
    assert len(set(seen)) == 3
    assert ask("hang", 0.2).wall_s == 0.2


def test_what_may_have_spoilt_the_device_ends_its_process(worker):
    """In a process that has probed before it is tried again in a new one, which ends as well."""
    for name in ("fault", "full"):
        before = worker.probe("here", 1.0, 20.0).message
        fault = worker.probe(name, 1.0, 20.0).message.split()[-1]
        after = worker.probe("here", 1.0, 20.0).message
        assert len({before, fault, after}) == 3
        alone = worker.probe(name, 1.0, 20.0).message.split()[-1]
        assert alone != after


def test_a_device_that_is_gone_is_no_outcome(monkeypatch):
    monkeypatch.setattr(extremes_workers, "PAUSES", (0.0, 0.01))
    gone = _made(says_where("device 'cuda' is not available: {}"))
    worker = Worker({"made": gone})
    with pytest.raises(DeviceLostError, match="is not available"):
        worker.probe("made", 1.0, 20.0)
    worker.stop()


def test_a_process_ends_after_so_many_probes(monkeypatch, worker):
    monkeypatch.setattr(extremes_workers, "PROBES_EACH", 3)
    where = [worker.probe("here", 1.0, 20.0).message for _ in range(7)]
    assert [len(set(where[k : k + 3])) for k in (0, 3)] == [1, 1]
    assert len(set(where)) == 3


def below(limit):
    """A trial that is wrong beyond `limit`, refused beyond 50."""

    def build(value):
        if value > 50:
            raise libmpm.SceneError("too much")
        return Trial(
            scene=block(), steps=1, pieces=1,
            judge=lambda simulation: "" if value <= limit else f"beyond {limit}",
        )  # fmt: skip

    return build


@pytest.mark.parametrize("workers", [1, 2])
def test_bisection_finds_the_break_and_silent_errors_are_reported(workers):
    """The gap shrinks to 2⁻⁵ of a part, however many sides are pushed at the same time."""
    axes = {str(k): _made(below(k), str(k)) for k in (7, 30)[:workers]}
    tasks = [Task(name, extremes.push(a, "upper"), 20.0, CPU) for name, a in axes.items()]
    lines = {t.axis: x for t, x in together(iter(tasks), [Worker(axes) for _ in range(workers)])}
    assert lines.keys() == axes.keys()
    for name, line in lines.items():
        assert line["axis"] == name
        assert line["holds_to"] <= int(name) < line["breaks_at"]
        assert line["breaks_at"] / line["holds_to"] == pytest.approx(100 ** (1 / 6 / 2**5))
        assert (line["outcome"], line["worst"]) == ("wrong", "wrong")
        assert {o for _, o, _, _ in line["probes"]} == {"holds", "wrong", "refused"}
        said = extremes.broken([line | {"precision": "single", "device_kind": "cpu"}])
        assert any(f"is wrong: beyond {name}" in text for text in said)
        assert not any("promised" in text for text in said)


def test_a_run_stops_in_time_and_goes_on(monkeypatch, tmp_path):
    """Whole lines, none twice: what a run has left the same command measures."""
    axes = tuple(_made(says_where(), str(k)) for k in (3, 7, 20))
    monkeypatch.setattr(extremes, "AXES", axes)
    path = tmp_path / "lines.jsonl"

    def measured(*more):
        argv = ["extremes.py", "run", "--precision", "single", "--output", str(path), *more]
        monkeypatch.setattr("sys.argv", argv)
        assert extremes.main() == 0
        return [x["axis"] for x in extremes.load(path)]

    assert measured("--seconds", "-1") == []
    assert measured("--axes", "7") == ["7"]
    found = measured("--workers", "2")
    assert sorted(found) == ["20", "3", "7"] and found[0] == "7"
    assert measured("--workers", "2") == found
    assert len(measured("--again", "--workers", "2")) == 6


def test_broken_promise_is_reported():
    line = {
        "axis": "a", "device_kind": "cpu", "precision": "single", "envelope": [1, 2],
        "probes": [[1.5, "named", "no", 3], [3.0, "named", "no", 3]],
    }  # fmt: skip
    assert extremes.broken([line]) == ["a (cpu, single): 1.5 is promised and named: no"]


def test_map_is_whole_and_keeps_its_promises():
    """Every axis has its lines in both precisions; inside nothing breaks, outside all is named."""
    lines = [x for x in extremes.newest(extremes.RESULTS) if x["device_kind"] == "cpu"]
    have = {(x["axis"], x["side"], x["precision"]) for x in lines}
    for one in extremes.chosen([]):
        for side in extremes.sides(one):
            for precision in ("single", "double"):
                assert (one.name, side, precision) in have
    water = {a.name: a for a in extremes_water.AXES}
    ours = [line for line in lines if line["axis"] in water]
    assert extremes.broken(ours) == []
    for line in ours:
        promised = water[line["axis"]].envelope
        assert line["envelope"] == (None if promised is None else list(promised))
    assert set(FORBIDDEN) == {"wrong", "not finite", "crash", "hang"}


def test_page_is_that_of_the_lines():
    lines = extremes.newest(extremes.RESULTS)
    assert extremes_page.PAGE.read_text(encoding="utf-8") == extremes_page.page(lines)
