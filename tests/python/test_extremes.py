"""Water at its extremes: what is promised holds, what lies outside is named, and the map is whole.

The whole sweep is `benchmarks/extremes.py`; here both ends of each short axis are tried.
"""

from __future__ import annotations

import os
import signal
import time

import pytest

import libmpm
from libmpm import materials, shapes
from support.extremes import CPU, FOLDER, ends, expect_holds, expect_outcome

ALONE = ()

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="needs the source tree")
if FOLDER.exists():
    import extremes
    import extremes_page
    import extremes_water
    from extremes_axis import FORBIDDEN, Axis, Trial, probe

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


def block(**options):
    """A free block of water of 4 cells without gravity."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0),
        **{k: v for k, v in options.items() if k != "velocity"},
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6)),
        material=materials.TaitFluid(bulk_modulus=1e5), velocity=options.get("velocity"),
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


def _made(build, **more):
    return Axis(
        name="made", unit="1", meaning="", base=1.0, envelope=(1.0, 2.0), reach=(1.0, 100.0),
        scale="log", build=build, **more,
    )  # fmt: skip


def test_crash_and_hang_are_seen():
    def crash(value):
        os.kill(os.getpid(), signal.SIGKILL)

    def hang(value):
        time.sleep(60)

    assert extremes.isolated(_made(crash), 1.0, 20.0).outcome == "crash"
    assert extremes.isolated(_made(hang), 1.0, 0.5).outcome == "hang"


def test_bisection_finds_the_break_and_silent_errors_are_reported(monkeypatch):
    """Of a trial that is wrong beyond 7, refused beyond 50: the gap shrinks to 2⁻⁵ of a part."""
    monkeypatch.setattr(extremes, "isolated", lambda a, v, limit, **o: probe(a, v, **o))

    def build(value):
        if value > 50:
            raise libmpm.SceneError("too much")
        return Trial(
            scene=block(), steps=1, pieces=1,
            judge=lambda simulation: "" if value <= 7 else "beyond 7",
        )  # fmt: skip

    line = extremes.push(_made(build), "upper", 1.0, **CPU)
    assert line["holds_to"] <= 7 < line["breaks_at"]
    assert line["breaks_at"] / line["holds_to"] == pytest.approx(100 ** (1 / 6 / 2**5))
    assert (line["outcome"], line["worst"]) == ("wrong", "wrong")
    assert {o for _, o, _, _ in line["probes"]} == {"holds", "wrong", "refused"}
    said = extremes.broken([line | {"precision": "single", "device_kind": "cpu"}])
    assert any("is wrong: beyond 7" in text for text in said)
    assert not any("promised" in text for text in said)


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
