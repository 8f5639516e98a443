"""Laboratory flumes: what is stated stands in the scene, records are whole, a run is compared."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest

import libmpm
from libmpm import flumes
from libmpm._src.base.values import from_plain
from libmpm._src.cli.commands import main
from libmpm._src.flumes import records as files
from libmpm._src.flumes.comparison import blank, compare
from libmpm._src.flumes.debris_flow_flume_shape import END, along_bed

ALL = [flumes.named(name) for name in flumes.names()]


# Records --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", flumes.records.names())
def test_every_record_says_what_it_is(name):
    one = flumes.records.load(name)
    assert len(one) >= 3
    assert one.citation and one.licence and one.how and one.facility
    for curve in one.curves:
        assert np.all(np.diff(curve.time) > 0)
        # Edges of a band are read one by one; a gap is no reading.
        assert not np.any(curve.low > curve.high + 2 * curve.uncertainty)
        assert curve.uncertainty > 0 and curve.time_uncertainty > 0
    with pytest.raises(KeyError, match="has no column 'nonsense'"):
        one["nonsense"]


def test_records_hold_the_numbers_of_the_text():
    waves = flumes.records.load("lwf-waves")
    for name, crest in (("WG1", 0.198), ("WG2", 0.238), ("WG3", 0.242)):
        assert waves.curve(name).value.max() == pytest.approx(crest, abs=0.002)
    peaks = flumes.records.load("lwf-first-peaks").row("case", "8-L-1.0x0.4")
    assert peaks["exp_mascarenas2022_median_N"] == 940
    stroke = flumes.records.load("lwf-broken-stroke").curve("piston")
    assert stroke.value[-1] == pytest.approx(3.643, abs=1e-3)
    assert np.gradient(stroke.value, stroke.time).max() == pytest.approx(2.30, abs=0.02)
    assert "lwf-waves" in flumes.records.table()
    assert flumes.records.names("WasedaBasin")[0] == "waseda-waves"
    with pytest.raises(libmpm.SceneError, match="did you mean 'lwf-waves'"):
        flumes.records.load("lwf-wave")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"citation": ""}, "citation is ''; expected a text"),
        ({"columns": {"t": "s", "x": "furlong"}}, "has unit 'furlong'; expected one of s, m"),
        ({"columns": {"t": "s"}}, "its description differ in x"),
        ({"facility": "LargeWaveFlum"}, "did you mean 'LargeWaveFlume'"),
        ({"rows": "0,1\n0,2\n"}, "has times that do not rise"),
        ({"rows": "0,1\n1,two\n"}, "column 'x': could not convert"),
        ({"uncertainty": 0}, "uncertainties that are not > 0"),
        ({"unit": "N"}, "one of its columns not"),
    ],
)
def test_a_bad_record_is_refused_by_name(change, said, tmp_path):
    curve = {"instrument": "WG1", "quantity": "level", "unit": "m", "measured": "x",
             "uncertainty": 0.1, "time_uncertainty": 0.1}  # fmt: skip
    about = {"file": "a.csv", "title": "t", "facility": "LargeWaveFlume", "citation": "c",
             "licence": "l", "how": "h", "columns": {"t": "s", "x": "m"}, "time": "t",
             "curves": [curve | {k: v for k, v in change.items() if k in curve}]}  # fmt: skip
    (tmp_path / "a.csv").write_text("t,x\n" + change.get("rows", "0,1\n1,2\n"))
    with pytest.raises(libmpm.SceneError, match="record 'mine': ") as caught:
        files.read("mine", about | {k: v for k, v in change.items() if k in about}, tmp_path)
    assert said in str(caught.value)


# Facilities -----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("level", ["laptop", "full"])
def test_every_level_is_a_valid_scene_with_its_instruments(kind, level):
    flume = kind.at_level(level)
    scene = flume.scene()
    if scene.dimension == 2:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", libmpm.ModelWarning)
            scene.validate()
    names = [s.name for s in scene.sensors]
    for one in flume.instruments():
        assert one.name in names
        if one.kind == "level":
            assert scene.lower[0] < one.x < scene.upper[0]
    assert scene.dimension == (2 if level == "laptop" else 3)
    assert (scene.method.transfer is None) != kind.granular
    assert from_plain(json.loads(json.dumps(flume.to_dict()))) == flume
    assert libmpm.Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    assert flume.deviations() and all(all(d) for d in flume.deviations())
    assert kind.title in str(flume)
    assert {c.id for c in flume.criteria()} and blank(flume).rows
    assert flume.until > 0


@pytest.mark.parametrize(
    ("name", "given"),
    [
        pytest.param(
            "lwf",
            {"cell_size": 0.2, "structure": "box", "debris": "1-T-0.1x0.5", "gap": 0.4},
            marks=pytest.mark.slow,
        ),
        ("dwb", {"cell_size": 0.1, "channel": 2.0, "debris": "hdpe"}),
        ("waseda", {"cell_size": 0.05, "rows": 1, "debris": "3x1-upstream"}),
        ("wasirf", {"cell_size": 0.05, "structure": "box", "debris": "8-L"}),
        (
            "dwb",
            {
                "cell_size": 0.1,
                "channel": 2.0,
                "debris": "mixed",
                "structure": "boxes",
                "contact": 0.3,
                "packing": None,
            },
        ),
        (
            "waseda",
            {
                "cell_size": 0.05,
                "rows": 1,
                "debris": "3x2-upstream",
                "contact": 0.3,
                "drive": "column",
            },
        ),
        ("wasirf", {"cell_size": 0.05, "structure": "box", "debris": "8-L", "contact": 0.3}),
    ],
)
def test_a_scene_with_debris_can_run(name, given):
    scene = flumes.named(name)(width="full", **given).scene()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        scene.validate()
    assert sum(b.name.startswith("debris") for b in scene.bodies) >= 1


def test_water_above_the_flumes_bed_has_its_volume():
    flume = flumes.LargeWaveFlume(cell_size=0.1)
    x, z = (np.array(c) for c in zip(*flume.bed_profile, strict=True))
    at = np.linspace(0, 88, 200_001)
    area = np.trapezoid(np.clip(2.0 - np.interp(at, x, z), 0, None), at)
    plan = flume.scene().plan(device="cpu")
    assert plan.particles * 0.1**2 / 4 == pytest.approx(area, rel=0.01)


def test_the_strokes_are_those_of_the_tables():
    unbroken = flumes.LargeWaveFlume().stroke()
    time, place = unbroken.arrays()
    law = 2 * np.vectorize(math.erf)(0.2 * (time - 9.9303))
    assert np.allclose(place, law - law[0], atol=1e-9)
    assert np.gradient(place, time).max() == pytest.approx(0.4514, abs=1e-3)
    basin = flumes.DirectionalWaveBasin().stroke().arrays()
    assert np.gradient(basin[1], basin[0]).max() == pytest.approx(0.301, abs=1e-3)
    assert flumes.LargeWaveFlume(wave="broken").still_water == 1.85


def test_a_layout_of_bars_lies_before_the_box():
    flume = flumes.LargeWaveFlume(width="full", structure="box", debris="8-L-1.0x0.4", gap=0.0)
    field = flume.field()
    assert len(field) == 8
    assert max(p.x for p in field.pieces) + 0.25 == pytest.approx(43.80 - 2.0)
    half = flumes.LargeWaveFlume(width="half", structure="box", debris="1-L-0.5x0.1")
    bodies = [b for b in half.scene().bodies if b.name.startswith("debris")]
    low, high = bodies[0].shape.bounds()
    assert len(bodies) == 1 and (low[1], high[1]) == pytest.approx((0.0, 0.05))
    assert flumes.LargeWaveFlume(debris_modulus="measured").modulus() == 0.8e9
    soft = flumes.LargeWaveFlume(bulk_modulus=2.2e7, debris_modulus=None)
    assert soft.modulus() == pytest.approx(1e7, rel=0.02)
    assert flumes.LargeWaveFlume().modulus() == 4e6


@pytest.mark.parametrize(
    ("kind", "given", "said"),
    [
        ("lwf", {"structure": "box"}, "structure is 'box' with width 'slice'"),
        ("lwf", {"debris": "8-L-1.0x0.4"}, "debris in a slice"),
        ("lwf", {"width": "full", "debris": "8-L-1.0x0.5"}, "did you mean '8-L-1.0x0.4'"),
        ("lwf", {"wave": "breaking"}, "wave is 'breaking'; "),
        ("lwf", {"cell_size": 0}, "cell_size is 0; expected > 0"),
        ("dwb", {"width": "full", "friction": "damp"}, "friction is 'damp'"),
        ("dwb", {"width": "full", "friction": -0.1}, "friction is -0.1; expected"),
        ("waseda", {"width": "strip"}, "width is 'strip'"),
        ("dwb", {"width": "strip", "structure": "boxes"}, "'boxes' with width 'strip'"),
        ("dwb", {"width": "strip", "debris": "hdpe"}, "debris in a strip"),
        ("lwf", {"width": "half", "edges": "round"}, "edges is 'round'"),
        ("lwf", {"width": "strip", "structure": "box"}, "structure is 'box' with width 'strip'"),
        ("lwf", {"width": "full", "contact": 0.3}, "contact is 0.3 without debris; expected None"),
        ("waseda", {"width": "full", "debris": "3x1-upstream", "contact": -1}, "contact is -1; "),
        ("usgs", {"obstacle": "1994-06-22"}, "did you mean '1994-06-2"),
        ("usgs", {"obstacle": "1994-06-21", "end": 80.0}, "the wall stands at s 91 m"),
        ("usgs", {"friction_factor": libmpm.TimeTable([0, 1], [1, -1])}, "numbers below 0"),
        ("waseda", {"rows": 3, "width": "full"}, "expected 0, 1 or 2 rows"),
        ("waseda", {"rows": 1}, "rows is 1 with width 'slice'"),
        ("wasirf", {"structure": "box"}, "structure is 'box' with width 'slice'"),
        ("wasirf", {"width": "full", "debris": "J"}, "debris is 'J'"),
        ("usgs", {"release": "prisma"}, "release is 'prisma'"),
        ("usgs", {"gate_time": 0}, "gate_time is 0; expected > 0"),
    ],
)
def test_what_cannot_be_is_refused(kind, given, said):
    with pytest.raises(libmpm.SceneError) as caught:
        flumes.named(kind)(**given)
    assert said in str(caught.value)
    with pytest.raises(libmpm.SceneError, match="facility is 'lwff'; did you mean 'lwf'"):
        flumes.named("lwff")
    with pytest.raises(libmpm.SceneError, match="did you mean 'laptop'"):
        flumes.LargeWaveFlume.at_level("lapto")


@pytest.mark.parametrize("kind", ALL)
def test_a_preview_names_every_instrument(kind):
    flume = kind.at_level("full")
    texts = {t.get_text() for axes in flume.preview().axes for t in axes.texts}
    assert {i.name for i in flume.instruments()} <= texts


def test_a_paddle_sends_the_wave_of_its_gauge_along_characteristics():
    depth, distance, g = 0.25, 3.0, 9.81
    time = np.arange(0.0, 6.0, 0.01)
    level = 0.02 / (1 + np.exp(-6 * (time - 3.0)))
    table, start = flumes.stroke_of_gauge(time, level, depth=depth, distance=distance, smooth=0.0)
    still = math.sqrt(g * depth)
    when, place = table.arrays()
    # Forward again: what the piston does now is at the gauge after the rest of the way.
    speed = np.gradient(place, when)
    wave = still + 0.5 * speed
    arrives = when + start + (distance - place) / (wave + speed)
    found = wave**2 / g - depth
    keep = (arrives > 2.8) & (arrives < 5.0)
    assert np.allclose(found[keep], np.interp(arrives[keep], time, level), atol=5e-4)
    with pytest.raises(libmpm.SceneError, match="level has gaps"):
        flumes.stroke_of_gauge([0, 1, 2], [0, math.nan, 0], depth=1, distance=1)


# Comparison -----------------------------------------------------------------------------------


class Run:
    """A run whose gauges read what was measured, to which an error is added."""

    def __init__(self, flume, until, add=0.0, late=0.0):
        record = flumes.records.load("lwf-waves")
        self.sensors = {}
        for name in ("WG1", "WG2", "WG3"):
            curve = record.curve(name)
            time = np.arange(0.0, until - flume.clock, 0.05)
            level = 2.0 + np.interp(
                time + flume.clock - late, curve.time, curve.change() * (1 + add)
            )
            self.sensors[name] = Samples(time, level)


class Samples:
    def __init__(self, time, level):
        self.time, self.level, self.components = time, level, ("level",)

    def __getitem__(self, name):
        return self.level


def test_what_was_measured_passes_and_what_is_off_fails():
    flume = flumes.LargeWaveFlume()
    found = flume.compare(Run(flume, 45.0))
    assert found.passed
    assert found["L1 rms of the level, WG2"].simulated < 1e-3
    assert found["L4"].verdict == "no instrument"
    assert not flume.compare(Run(flume, 45.0, add=0.3)).passed
    late = flume.compare(Run(flume, 45.0, late=0.5))
    assert late["L2 half of the crest, WG1"].verdict == "failed"
    assert late["L2 half of the crest, WG1"].error == pytest.approx(0.5, abs=0.05)
    with pytest.raises(libmpm.SceneError, match=r"reached 19\.9"):
        flume.compare(Run(flume, 20.0))


def test_rows_that_are_held_out_are_produced_and_not_judged():
    rows = blank(flumes.WasedaBasin()).rows
    kept = [r for r in rows if r.id == "T3" and not r.quantity.startswith("rms")]
    assert kept and all(r.measured is None for r in kept)


#: Rows of the acceptance table of each facility.
ROWS = {
    "lwf": [f"L{k}" for k in range(1, 11)], "dwb": [f"B{k}" for k in range(1, 8)],
    "waseda": [f"T{k}" for k in range(1, 9)], "usgs": [f"U{k}" for k in range(1, 9)],
    "wasirf": [f"W{k}" for k in range(1, 6)],
}  # fmt: skip


@pytest.mark.parametrize("name", list(ROWS))
def test_the_table_has_all_rows_measured_or_not(name, capsys):
    found = flumes.collect(flumes.named(name))
    assert list(dict.fromkeys(row.id for row in found.rows)) == ROWS[name]
    assert {row.verdict for row in found.rows} == {"not run"} and not found.passed
    assert main(["flume", name, "--table"]) == 0
    assert capsys.readouterr().out.strip() == str(found)
    for case in flumes.named(name).cases:
        assert flumes.named(name).of_case(case).criteria()
    with pytest.raises(libmpm.SceneError, match="case is 'nothing'"):
        flumes.named(name).of_case("nothing")


def test_layouts_that_are_held_out_and_those_of_the_older_series_are_kept_apart():
    held = {"8-T-0.8x0.5", "16-L-2.0x0.4", "16-T-0.4x2.0", "24-L-2.0x0.6"}
    for name in flumes.LargeWaveFlume.cases:
        if name in ("waves", "box"):
            continue
        flume = flumes.LargeWaveFlume.of_case(name, width="full", gap=0.0)
        last = flume.criteria()[-1]
        assert last.id == ("L9" if name in held else "L8") and last.held_out == (name in held)
        assert len(flume.field()) == int(name.split("-")[0])
    older = flumes.LargeWaveFlume.at_level("full", debris="4-L-0.5x0.4").criteria()[-1]
    assert (older.id, older.gates, older.measured) == ("-", False, None)
    broken = flumes.LargeWaveFlume.at_level("full", wave="broken", debris="8-L-1.0x0.4")
    assert broken.criteria() == () and broken.until == 30.0


def comparison(case, value, seed=0):
    flume = flumes.LargeWaveFlume.of_case(case, seed=seed)
    row = flumes.blank(flume, case).rows[-1]
    good = "passed" if abs(value / row.measured - 1) < 0.2 else "failed"
    row = replace(row, simulated=value, verdict=good)
    return flumes.Comparison(flume, (row,), None)


def test_a_line_is_drawn_through_first_peaks():
    names = ["1-L-0.5x0.1", "8-L-1.0x0.4", "16-L-1.0x0.8", "16-T-0.8x1.0", "24-T-0.6x2.0"]
    peaks = [421.0, 940.0, 1389.0, 1283.0, 798.0]
    few = flumes.LargeWaveFlume.joint_rows([comparison(names[0], 400.0)])
    assert [row.verdict for row in few] == ["not run"] * 2
    for share, verdict in ((0.95, "passed"), (0.8, "failed")):
        pairs = zip(names, peaks, strict=True)
        slope, square = flumes.LargeWaveFlume.joint_rows(
            [comparison(n, share * p) for n, p in pairs]
        )
        assert slope.simulated == pytest.approx(share) and slope.verdict == verdict
        assert square.simulated == pytest.approx(1.0) and square.verdict == "passed"


def test_runs_that_differ_in_seed_give_a_median_with_its_spread():
    values = [700.0, 900.0, 800.0, 1000.0, 5000.0]
    runs = [comparison("8-L-1.0x0.4", v, k) for k, v in enumerate(values)]
    row = flumes.median_of(runs)["L8"]
    assert (row.simulated, row.spread, row.runs) == (900.0, (700.0, 5000.0), 5)
    assert row.verdict == "passed" and "900 (700 to 5000, 5 runs)" in " ".join(row.texts())
    lost = comparison("8-L-1.0x0.4", math.nan)
    assert flumes.median_of([runs[0], lost])["L8"].verdict == "failed"


def test_a_measured_curve_of_the_caller_is_compared():
    flume = flumes.LargeWaveFlume.of_case("box")
    time = np.arange(0.0, 32.0, 0.01)
    force = 100.0 * np.exp(-((time - 17.5) ** 2))
    run = Run(flume, 47.0)
    run.sensors["box"] = Samples(time, force)
    assert flume.compare(run)["L7 rms"].verdict == "no record"
    curve = flumes.records.curve("box", time + 15.0, 2.2 * force, quantity="load", unit="N")
    row = flume.compare(run, {"box": curve})["L7 rms"]
    # Half of the box has half of the load: 200 N against 220.
    assert row.verdict == "reported" and 0.01 < row.simulated < 0.1
    with pytest.raises(libmpm.SceneError, match="did you mean 'box'"):
        flume.compare(run, {"boxx": curve})


def test_rows_of_gauges_begin_too_late_in_a_near_field():
    flume = flumes.LargeWaveFlume()
    run = Run(flume, 45.0)
    for one in run.sensors.values():
        one.level, one.time = one.level[one.time > 12.5], one.time[one.time > 12.5]
    said = r"begins at 27\.\d+ s .*begins late: L1, L2.*; expected 15\.5 s or before; begin the"
    with pytest.raises(libmpm.SceneError, match=said):
        flume.compare(run)
    assert {r.verdict for r in compare(flume, run, strict=False).rows} >= {"begins late"}
    for one in run.sensors.values():
        one.level, one.time = one.level[one.time < 13.5], one.time[one.time < 13.5]
    # A longer one would begin as late.
    with pytest.raises(libmpm.SceneError, match=said):
        flume.compare(run)
    basin = flumes.DirectionalWaveBasin.of_case("waves")
    run.sensors = dict.fromkeys(("WG1", "WG9", "USWG5"), run.sensors["WG1"])
    with pytest.raises(libmpm.SceneError, match=r"expected 11\.3 s or before; compare a run of sc"):
        basin.compare(run)


class Platform:
    """A near field of the basin: its front runs on the platform at 1.4 m/s, blocks at 0.7 m/s."""

    def __init__(self, begin, until=38.0):
        time = np.arange(begin, until + 0.01, 0.05)

        def level(comes, depth):
            return Samples(time - 11.3, np.where(time < comes, np.nan, 1.0 + depth))

        self.sensors = {
            "USWG5": Samples(time - 11.3, np.full(len(time), 0.9)),
            "front-1": level(30.975, 0.03), "front-2": level(30.975 + 3 / 1.4, 0.03),
            "USWG-h5": level(33.475, 0.06),
            "debris-01": Samples(time - 11.3, 31.3 + 0.7 * np.maximum(time - 31.0, 0.0)),
        }  # fmt: skip


@pytest.mark.parametrize("width", ["half", "full"])
def test_rows_of_the_platform_are_compared_in_a_near_field(width):
    # B7 is of the full width.
    flume = flumes.DirectionalWaveBasin.of_case("hdpe", width=width)
    assert flume.near[0] == 28.5
    found = flume.compare(Platform(28.5))
    late = {(r.id, r.verdict) for r in found.rows if r.simulated is None}
    assert late == {("B1", "no instrument"), ("B2", "no instrument"), ("B3", "begins late"),
                    ("B3", "no record")}  # fmt: skip
    assert found["B3 crest, USWG-h5"].simulated == pytest.approx(0.06)
    assert found["B3 arrival of 1 cm, USWG-h5"].simulated == pytest.approx(33.5, abs=0.05)
    assert found["B3 crest, USWG5"].verdict == "begins late"
    assert found["B4"].simulated == pytest.approx(1.4, rel=0.02)
    assert found["B5"].simulated == pytest.approx(0.7, rel=0.02)
    assert found["B6"].simulated == pytest.approx(4.9, rel=0.02)
    assert ("B7" in {r.id for r in found.rows}) == (width == "full")


def test_a_run_of_which_nothing_can_be_compared_says_why():
    flume = flumes.DirectionalWaveBasin.of_case("platform")
    said = (r"begins at 29\.5 s .*no instrument: B1, B2; begins late: B3, B4\); "
            r"expected 29 s or before; begin the near field earlier, or compare")  # fmt: skip
    with pytest.raises(libmpm.SceneError, match=said):
        flume.compare(Platform(29.5))
    with pytest.raises(libmpm.SceneError, match=r"reached 34 s .*; expected 38 s or more; contin"):
        flume.compare(Platform(28.5, 34.0))
    run = Platform(28.5)
    run.sensors = {"flow-0": run.sensors["USWG5"]}
    with pytest.raises(libmpm.SceneError, match=r"sensors flow-0; expected those of scene\(\)"):
        flume.compare(run)


def test_a_run_that_needs_measured_curves_says_so(monkeypatch):
    flume = flumes.DirectionalWaveBasin.of_case("platform")
    rows = tuple(c for c in flume.criteria() if c.curve)
    monkeypatch.setattr(flumes.DirectionalWaveBasin, "criteria", lambda self: rows)
    with pytest.raises(libmpm.SceneError, match="expected one of USWG-h5; give it in curves"):
        flume.compare(Platform(28.5))


def test_a_level_over_land_is_that_over_the_bed_where_a_run_has_no_rest():
    time = np.array([18.0, 19.0, 20.0])
    sensors = {"sea": Samples(time, np.array([0.9, 0.97, 0.87])),
               "land": Samples(time, np.array([np.nan, 1.03, 1.0]))}  # fmt: skip
    places = [flumes.Instrument("sea", "level", 20.0, z=0.5),
              flumes.Instrument("land", "level", 33.0, z=1.0)]  # fmt: skip
    signals = flumes.Signals(sensors, 11.3, places, still=0.87)
    when, level = signals.level("land")
    assert when == pytest.approx(time + 11.3) and level == pytest.approx([0.0, 0.03, 0.0])
    assert signals.level("sea")[1] == pytest.approx([0.03, 0.10, 0.0])
    unknown = flumes.Signals(sensors, 11.3, places)
    assert unknown.level("sea")[1] == pytest.approx([0.0, 0.07, -0.03])
    # From rest on both are changes from it, as before.
    for one in sensors.values():
        one.time = time - 18.0
    rested = flumes.Signals(sensors, 11.3, places, rest=0.5, still=0.5)
    assert rested.level("sea")[1] == pytest.approx([0.0, 0.07, -0.03])
    assert rested.level("land")[1] == pytest.approx([0.0, 0.03, 0.0])


def test_edges_of_a_box_are_free_or_cut():
    box = libmpm.shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1))
    cut = flumes.bevelled(box, 0.1)
    far = cut.distance([(0.5, 0.5, 0.001), (0.04, 0.04, 0.5), (0.08, 0.08, 0.5)])
    assert far[0] < 0 < far[1] and far[2] < 0
    with pytest.raises(libmpm.SceneError, match="less than half of it"):
        flumes.bevelled(box, 0.6)
    for edges, kind in (("free", "Box"), ("bevel", "Intersection")):
        scene = flumes.LargeWaveFlume.of_case("box", edges=edges).scene()
        shape = next(b.shape for b in scene.boundaries if b.name == "box")
        assert type(shape).__name__ == kind
    whole = shape.bounds()
    assert whole[0][1] == pytest.approx(-0.5) and whole[1][1] == pytest.approx(0.5)


def test_friction_of_the_platform_is_of_each_kind_of_block():
    flume = flumes.DirectionalWaveBasin(width="full", channel=2.0, debris="mixed")
    scene = flume.scene()
    rubs = {b.name: b for b in scene.boundaries if b.name.startswith("platform")}
    found = {b.response.dynamic_friction: len(b.bodies) for b in rubs.values()}
    assert found == {0.38: 10, 0.71: 10}
    dry = flumes.DirectionalWaveBasin(width="full", channel=2.0, debris="hdpe", friction="dry")
    (one,) = [b for b in dry.scene().boundaries if b.name.startswith("platform")]
    assert one.response.static_friction == flumes.friction("hdpe", "concrete", "dry") == 0.66
    assert all(source for _, source in flumes.FRICTION.values())
    with pytest.raises(libmpm.SceneError, match="did you mean 'hdpe, concrete, wet'"):
        flumes.friction("hdpe", "concrete", "we")


def test_the_friction_of_the_flume_goes_in_steps():
    table = libmpm.TimeTable([1.0, 3.0, 4.0], [0.0, 1.0, 0.5])
    scene = flumes.DebrisFlowFlume(friction_factor=table, end=20.0).scene()
    found = [(b.window, b.response.dynamic_friction) for b in scene.boundaries
             if b.name.startswith("channel")]  # fmt: skip
    assert [w for w, _ in found] == [(0.0, 1.0), (1.0, 3.0), (3.0, 4.0), (4.0, math.inf)]
    assert [mu for _, mu in found] == pytest.approx([0.0, 0.1, 0.15, 0.1])


def test_the_wall_stands_where_it_was_and_its_test_has_its_volume():
    flume = flumes.DebrisFlowFlume(bed="smooth", obstacle="1994-06-21")
    scene = flume.scene()
    wall = next(b.shape for b in scene.boundaries if b.name == "wall")
    low, high = wall.bounds()
    one = next(i for i in flume.instruments() if i.name == "run-up")
    assert low[0] < one.x < high[0] and high[1] - one.z == pytest.approx(
        2.4 * math.cos(math.radians(31)) + 0.5 * math.sin(math.radians(31))
    )
    x, z = np.array(flume.prism()).T
    area = 0.5 * abs(np.dot(x, np.roll(z, 1)) - np.dot(z, np.roll(x, 1)))
    assert 2.0 * area == pytest.approx(9.3, rel=0.01)
    assert {c.id for c in flume.criteria()} == {"U5", "U6"}


@pytest.mark.parametrize("name", ["lwf", "waseda"])
def test_the_command_goes_on_where_it_was_stopped_and_compares(name, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["flume", name, "--level", "reduced", "-o", str(out), "--quiet", "--no-picture",
               "--device", "cpu", "--threads", "1"]  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        assert main([*command, "--until", "0.5", "--wall-limit", "0"]) == 6
        stopped = libmpm.load(out).log["time"]
        capsys.readouterr()
        # Too short for any row, which is said and not passed over.
        assert main([*command, "--until", "0.5"]) == 2
    assert "s or more; continue it" in capsys.readouterr().err
    assert libmpm.load(out).log["time"] == pytest.approx(0.5, abs=0.01) and stopped < 0.5
    other = ["flume", name, "--level", "quick", "-o", str(out), "--quiet"]
    assert main(other) == 2
    assert "holds a run of another set-up or level" in capsys.readouterr().err
    # The folder says what was run there: the level need not be given again.
    assert main(["flume", name, "--table", "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "not reached" in said and "not run" in said and (tmp_path / "table.csv").is_file()
    assert main(["flume", name]) == 2


# Runs that are short enough to be held to what was measured -----------------------------------


def run(flume, until=None):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        sim = libmpm.Simulation(flume.scene(), device="cpu", threads=1)
        sim.run(until=flume.until if until is None else until, progress=False)
    return sim


def test_the_release_has_the_volume_of_the_drawing():
    flume = flumes.DebrisFlowFlume()
    plan = flume.scene().plan(device="cpu")
    assert plan.particles * flume.cell_size**2 / 4 == pytest.approx(4.95, rel=0.01)
    x, z = (np.array(c) for c in zip(*flume.bed_profile, strict=True))
    slope = np.degrees(np.arctan2(np.diff(z), np.diff(x)))
    assert slope[0] == 0 and slope[-1] == pytest.approx(31 - 2.4)
    # On the arc the bed turns by less than a degree and a half from piece to piece.
    assert np.all(np.diff(slope) > -1e-9) and np.diff(slope).max() < 1.5


def test_the_mixture_passes_two_metres_as_the_measured_one():
    flume = flumes.DebrisFlowFlume.at_level("reduced")
    found = flume.compare(run(flume))
    assert found.passed, str(found)
    assert {row.verdict for row in found.rows} == {"passed"}
    # Dry on the rough bed it does not get there in time: rows can fail.
    dry = flumes.DebrisFlowFlume.at_level("reduced", mixture="dry")
    late = dry.compare(run(dry))["U2 time of the largest depth, 2 m"]
    assert late.error is None or not abs(late.error) < 0.3


@pytest.mark.slow
def test_all_of_the_mixture_comes_to_rest_on_the_pad():
    """Row U2's balance: single grains go farther than s 118 m, where the pad ended before."""
    flume = flumes.DebrisFlowFlume.at_level("quick")
    sim = run(flume, until=12.0)
    mass = sim.sensors["mass"].values[:, 0]
    assert mass[-1] == pytest.approx(mass[0], rel=1e-6)
    assert np.linalg.norm(sim.particles["mixture"]["velocity"], axis=1).max() < 0.1
    farthest = along_bed(float(sim.particles["mixture"]["position"][:, 0].max()))
    assert 118.0 < farthest < END - 5.0


@pytest.mark.parametrize("friction", [0.1, 0.4])
def test_a_block_slides_down_the_flume_by_its_friction(friction):
    flume = flumes.DebrisFlowFlume(
        cell_size=0.1, end=20.0, release="block", channel_friction=friction
    )
    found = flume.compare(run(flume))
    assert found.passed, str(found)
    assert found["U1"].simulated == pytest.approx(1.0, abs=0.03)


def test_a_current_keeps_its_level_and_speed():
    flume = flumes.WASIRF.at_level("reduced")
    found = flume.compare(run(flume))
    assert found.passed, str(found)
    assert len(found.rows) == 4


def test_a_current_at_four_times_the_size_is_the_same():
    """Row W5: Froude and Cauchy together leave every number of a run alike but its units."""
    flume = flumes.WASIRF.at_level("reduced", speed=0.4)
    row = flume.similarity(until=1.0, threads=1)
    assert row.verdict == "passed" and row.simulated < 1e-3
    scene = flume.scene()
    big = scene.scaled(4.0, cauchy=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        small, large = (libmpm.Simulation(s, device="cpu", threads=1) for s in (scene, big))
        small.run(until=2.0, progress=False)
        large.run(until=4.0, progress=False)
    for name, scale in (("WG1", 4.0), ("WG3", 4.0)):
        one, other = (np.asarray(s.sensors[name]["level"]) for s in (small, large))
        n = min(len(one), len(other))
        assert n > 30
        assert np.allclose(other[:n], scale * one[:n], rtol=0.01)
    one, other = (np.asarray(s.sensors["WG1"]["velocity_x"]) for s in (small, large))
    n = min(len(one), len(other))
    assert np.allclose(other[:n], 2.0 * one[:n], rtol=0.01)


def test_cells_in_which_the_wave_flume_sinks_are_warned_of():
    fine = flumes.LargeWaveFlume(structure=None, cell_size=0.03, end=60.0)
    with pytest.warns(libmpm.ModelWarning, match=r"packing is None.*use packing='density'"):
        fine.scene()
    with warnings.catch_warnings():
        warnings.simplefilter("error", libmpm.ModelWarning)
        replace(fine, packing="density").scene()
        replace(fine, cell_size=0.05).scene()
