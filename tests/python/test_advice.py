"""Advice: which cases a scene is like, what is chosen and why, and where measurements end.

The choice is tested on an atlas made up here, the whole on the shipped one. Expected duration: 8 s.
"""

import copy
import dataclasses
import itertools
import json

import pytest

import libmpm
from libmpm import FBar, Method, boundaries, cases, grids, materials, shapes
from libmpm._src.advice.advise import advise
from libmpm._src.advice.atlas import read_atlas
from libmpm._src.advice.facts import Facts
from libmpm._src.advice.rules import RULES, matches
from libmpm._src.cli.commands import main
from libmpm.cases import Options
from libmpm.methods import Kernel, Transfer
from support import scenes

# ---- scenes -------------------------------------------------------------------------------------


def case_scene(name, options=None, **changes):
    """The scene of a reference case."""
    case = cases.case(name)
    return case.build(case.parameters("reduced", changes), options or Options())


def pool(*, modulus=2e6, depth=1.0, cells=20, fbar="default", method=None, **body):
    """A square of water released at the left of a box."""
    dx = depth / cells
    scene = libmpm.Scene(
        name="pool", dimension=2, cell_size=dx, lower=(0, 0), upper=(4 * depth, 2 * depth),
        gravity=(0, -9.81), method=method,
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(depth, depth)),
        material=materials.TaitFluid(bulk_modulus=modulus), fbar=fbar, **body,
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    return scene


def flying(material=None, **body):
    """A block that flies towards a wall."""
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 2))
    law = material or materials.FixedCorotated(density=1000, youngs_modulus=1e6, poissons_ratio=0.3)
    scene.add_body(
        name="block", material=law,
        **{"velocity": (-0.1, 0.0), "shape": shapes.Box(lower=(1, 0.5), upper=(2, 1.5))} | body,
    )  # fmt: skip
    return scene


def names(scene):
    return [m.case for m in matches(Facts(scene, frozenset(read_atlas().laws)))]


# ---- an atlas of one's own ----------------------------------------------------------------------

APIC, QUADRATIC = {"scheme": "APIC"}, {"name": "quadratic", "gradient": "mls", "boundary": False}


def line(option, worst, cost, *, case="dam-break", kind="water", group="transfer", **more):
    """A line of an atlas; `more` are choices, changes or parts of its range."""
    ranged = {
        "cells_across": 20, "particles_per_cell": 4, "compression": 5e-3, "mach": 0.1,
        "dimension": 2,
    }  # fmt: skip
    choices = {
        "transfer": APIC, "kernel": QUADRATIC, "fbar": None, "solid_fbar": None,
        "material": "FixedCorotated", "precision": "single", "pipeline": "fused", "cfl": 0.4,
        "layer": None, "walls": None,
    }  # fmt: skip
    made = {
        "case": case, "kind": kind, "option": option, "group": group, "changes": {},
        "errors": {"front": worst}, "worst": worst, "cost": cost, "dissipates": False,
        "device_kind": "cpu",
    }  # fmt: skip
    for key, value in more.items():
        for known in (ranged, choices, made):
            if key in known:
                known[key] = value
    return made | {"choices": choices, "range": ranged}


@pytest.fixture
def asked(tmp_path):
    """Ask for advice from an atlas of the given lines."""

    def ask(scene, *lines, broken=(), **options):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.json"
        head = {"format": 1, "library": "test", "commit": "none", "device": ["a core"]}
        path.write_text(json.dumps(head | {"lines": list(lines), "broken": list(broken)}))
        return advise(scene, device="cpu", atlas=path, **options)

    return ask


BASE = line("baseline", 0.08, 1.0, group="baseline")
AFLIP = line("AFLIP", 0.03, 1.5, transfer={"scheme": "AFLIP", "flip": 0.95})
CUBIC = line("cubic", 0.01, 6.0, group="kernel",
             kernel={"name": "cubic", "gradient": "mls", "boundary": False})  # fmt: skip


@pytest.mark.parametrize(("error", "option"), [(0.1, "baseline"), (0.05, "AFLIP"), (0.02, "cubic")])
def test_the_cheapest_within_the_error(asked, error, option):
    advice = asked(pool(fbar=None), BASE, AFLIP, CUBIC, error=error)
    assert [row.option for row in advice.lines] == [option]
    assert advice.reached
    assert advice.expected_error <= error
    assert advice.present_error == 0.08


def test_none_within_the_error_is_said(asked):
    advice = asked(pool(fbar=None), BASE, AFLIP, CUBIC, error=0.005)
    assert not advice.reached
    assert advice.settings.method.kernel_choice == Kernel(name="cubic")
    (said,) = [w for w in advice.warnings if "nothing measured is within 0.005" in w]
    assert "'dam-break'" in said
    assert "'cubic' with 1.0%" in said
    assert "no measured setting" in str(advice)


def test_right_by_accident_is_left_out(asked):
    lossy = line("PIC", 0.001, 0.5, transfer={"scheme": "PIC"}, dissipates=True)
    unread = line("FLIP", None, 0.5, transfer={"scheme": "FLIP"})
    advice = asked(pool(fbar=None), BASE, AFLIP, lossy, unread)
    assert [row.option for row in advice.lines] == ["AFLIP"]


def test_what_is_there_stays_where_nothing_is_much_cheaper(asked):
    """A fifth is no more than timings differ by; a third is."""
    scene = pool(fbar=None)
    cheap = line("AFLIP", 0.03, 0.85, transfer={"scheme": "AFLIP", "flip": 0.95})
    advice = asked(scene, BASE, cheap, error=0.1)
    assert not [r.setting for r in advice.reasons if r.changes]
    assert advice.apply() == scene
    cheap["cost"] = 0.66
    advice = asked(scene, BASE, cheap, error=0.1)
    assert [r.setting for r in advice.reasons if r.changes] == ["transfer"]


def test_of_equal_costs_the_most_accurate(asked):
    best = line("FLIP", 0.01, 1.7, transfer={"scheme": "FLIP"})
    advice = asked(pool(fbar=None), BASE, AFLIP, best)
    assert [row.option for row in advice.lines] == ["FLIP"]


def test_a_setting_has_to_be_measured_on_all_cases(asked):
    """Water that falls is like two cases; the second has no line of the best transfer."""
    second = [
        line("baseline", 0.02, 1.0, case="ritter", group="baseline"),
        line("cubic", 0.04, 5.0, case="ritter", group="kernel", kernel=CUBIC["choices"]["kernel"]),
    ]
    advice = asked(pool(fbar=None), BASE, AFLIP, CUBIC, *second)
    assert [(r.case, r.option) for r in advice.lines] == [
        ("dam-break", "cubic"), ("ritter", "cubic")
    ]  # fmt: skip
    assert advice.expected_error == 0.04
    assert advice.cost == pytest.approx(5.5)
    unread = line("baseline", None, 1.0, case="ritter", group="baseline")
    nothing = asked(pool(fbar=None), BASE, AFLIP, unread, second[1])
    assert nothing.settings is None
    assert any("no setting was measured on all of dam-break, ritter" in w for w in nothing.warnings)


def test_more_cells_than_the_scene_has(asked):
    """Twice the cells, measured at 40, for 10 across: cells of a quarter, 4³ the cost."""
    fine = line("double the cells", 0.02, 8.0, group="cells", cells_across=40,
                changes={"cells": 40, "cells_ratio": 2.0})  # fmt: skip
    scene = pool(cells=10, fbar=FBar(time=1e-3))
    advice = asked(scene, BASE, fine)
    assert advice.refine == 4
    assert advice.cost == pytest.approx(64)
    assert advice.settings.cell_size == pytest.approx(scene.cell_size / 4)
    assert advice.apply().cell_size == scene.cell_size
    assert "error 2.0%, with cells of 0.025 m" in str(advice)
    finer = advice.apply(cell_size=True)
    assert finer.cells == tuple(4 * n for n in scene.cells)
    # Of as many cells as were measured it asks for no more.
    again = asked(pool(cells=80, fbar=None), BASE, fine)
    assert again.refine == 1
    assert again.cost == pytest.approx(1)


def test_rows_next_to_the_cells_of_the_scene_count(asked):
    """Half the cells happen to do better: they say nothing about a scene with all of them."""
    half = line("half the cells", 0.001, 0.2, group="cells", cells_across=10,
                changes={"cells": 10, "cells_ratio": 0.5})  # fmt: skip
    fine = line("double the cells", 0.04, 8.0, group="cells", cells_across=40,
                changes={"cells": 40, "cells_ratio": 2.0})  # fmt: skip
    options = {c: asked(pool(cells=c, fbar=None), half, BASE, fine) for c in (10, 25, 40)}
    found = {c: a.lines[0].option for c, a in options.items()}
    assert found == {10: "half the cells", 25: "double the cells", 40: "double the cells"}
    assert [a.refine for a in options.values()] == [1, 2, 1]


def test_no_step_that_spray_does_not_bear(asked):
    """1/√2 in the plane, 1/√3 in space."""
    long = line("double the step", 0.01, 0.5, group="step", cfl=0.8)
    advice = asked(pool(fbar=None), BASE, AFLIP, long)
    assert advice.settings.method.cfl == 0.4


def test_water_and_solids_take_lines_of_their_own(asked):
    """They share transfer and kernel; F-bar is each one's."""
    filtered = {"form": "two-volume", "length_cells": 2.0, "time_crossings": None, "ratio": 0.9}
    late = {"form": "one-volume", "length_cells": None, "time_crossings": 10.0, "ratio": None}
    wet = [
        line("baseline", 0.01, 1.0, case="floating-block", group="baseline"),
        line("F-bar", 0.01, 1.0, case="floating-block", group="F-bar", fbar=late),
        line("AFLIP", 0.01, 2.0, case="floating-block", transfer=AFLIP["choices"]["transfer"]),
    ]
    dry = {"case": "mode-incompressible", "kind": "solid", "compression": None, "mach": 0.005}
    solid = [
        line("baseline", 0.2, 1.0, group="baseline", **dry),
        line("solid F-bar", 0.02, 4.0, group="solid", solid_fbar=filtered, **dry),
        line("AFLIP", 0.04, 9.0, transfer=AFLIP["choices"]["transfer"], **dry),
    ]
    scene, _ = scenes.floating(0.5)
    data = scene.to_dict()
    data["bodies"][1]["material"]["poissons_ratio"] = 0.49
    scene = libmpm.Scene.from_dict(data)
    assert names(scene) == ["floating-block", "mode-incompressible"]
    advice = asked(scene, *wet, *solid)
    assert [r.option for r in advice.lines] == ["baseline", "solid F-bar"]
    assert advice.settings.fbar["water"] is None
    block = advice.settings.fbar["block"]
    assert block == FBar(form="two-volume", length=2 * scene.cell_size)
    changed = advice.apply()
    assert changed.bodies[1].fbar == block
    changed.validate()


def test_time_of_fbar_counts_crossings(asked):
    late = {"form": "one-volume", "length_cells": None, "time_crossings": 10.0, "ratio": None}
    scene = pool(modulus=4e6, cells=20)
    advice = asked(scene, BASE, line("F-bar", 0.01, 1.0, group="F-bar", fbar=late))
    speed = (4e6 / 1000) ** 0.5
    assert advice.settings.fbar["water"].time == pytest.approx(10 * 0.05 / speed)


def test_particles_along_an_axis_carry_over(asked):
    """Nine in the plane are three an axis: 27 in space. A lattice of a body's own stays."""
    nine = line("9 particles", 0.01, 2.0, group="particles", particles_per_cell=9,
                changes={"particles_per_cell": 9})  # fmt: skip
    assert asked(pool(), BASE, nine).settings.particles_per_cell == {"water": 9}
    assert not asked(pool(lattice=(40, 40)), BASE, nine).settings.particles_per_cell
    deep = libmpm.Scene(
        cell_size=0.1, lower=(0, 0, 0), upper=(4, 1, 2), gravity=(0, 0, -9.81),
    )  # fmt: skip
    deep.add_body(
        name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(1, 1, 1)),
        material=materials.TaitFluid(bulk_modulus=2e6),
    )  # fmt: skip
    advice = asked(deep, BASE, nine)
    assert advice.settings.particles_per_cell == {"water": 27}
    assert any("3 dimensions" in w for w in advice.warnings)


def test_mirrors_for_walls_that_glide(asked):
    """Not for walls that may be left; and not back."""
    mirrored = line("mirrored walls", 0.01, 2.0, group="boundary", walls="mirror", case="vortex")
    base = line("baseline", 0.5, 1.0, group="baseline", case="vortex")
    scene = case_scene("vortex", cells=20)
    advice = asked(scene, base, mirrored)
    changed = advice.apply()
    assert changed.boundaries[0].response == boundaries.Mirror()
    again = asked(changed, base, mirrored)
    assert again.apply() == changed
    assert again.present_error == 0.01
    walls = Options(walls=boundaries.Separable())
    kept = asked(case_scene("vortex", walls, cells=20), base, mirrored)
    assert not kept.settings.mirrored
    assert kept.expected_error == 0.5


# ---- bulk modulus and range ---------------------------------------------------------------------

SOFTER = [
    line("water's bulk modulus", 0.06, 20.0, group="bulk modulus", compression=5e-5, mach=0.01,
         changes={"bulk_ratio": 100.0}),
    line("soft", 0.09, 0.3, group="bulk modulus", compression=0.02, mach=0.2,
         changes={"bulk_ratio": 0.25}),
    line("softest", 0.4, 0.1, group="bulk modulus", compression=0.5, mach=1.0,
         changes={"bulk_ratio": 0.01}),
]  # fmt: skip


def test_least_bulk_modulus(asked):
    """ρgH/K and v/c of the softest line that adds less than the error; here v/c decides."""
    scene = pool(modulus=2.2e9)
    advice = asked(scene, BASE, *SOFTER, error=0.1)
    # c = v/0.2 with v = √(2gH); ρgH/K is then 0.02 too, since both follow from H.
    expected = 1000 * 2 * 9.81 / 0.2**2
    assert advice.settings.bulk_modulus["water"] == pytest.approx(expected, rel=0.01)
    assert advice.apply() == scene.from_dict(advice.apply().to_dict())
    assert advice.apply().bodies[0].material.bulk_modulus == 2.2e9
    softer = advice.apply(bulk_modulus=True)
    assert softer.bodies[0].material.bulk_modulus == pytest.approx(expected, rel=0.01)
    again = asked(softer, BASE, *SOFTER, error=0.1)
    assert not again.settings.bulk_modulus
    assert not [w for w in again.warnings if "ritter" not in w]


def test_water_too_soft_is_said_and_mended(asked):
    scene = pool(modulus=1e4)
    advice = asked(scene, BASE, *SOFTER, error=0.1)
    assert any("loses ρgH/K = 0.981" in w and "up to 0.5" in w for w in advice.warnings)
    assert any("of its wave speed; measured up to 1" in w for w in advice.warnings)
    assert advice.settings.bulk_modulus["water"] > 1e4


def test_laws_limit_the_modulus(asked):
    """(v/c)²/2 = ρgH/K of water that falls, (2/3) ρgH/K of a tank, whatever a case allows."""
    soft = line("soft", 0.08, 0.3, group="bulk modulus", compression=0.3, mach=5.0)
    modulus = asked(pool(modulus=2.2e9), BASE, soft, error=0.01).settings.bulk_modulus["water"]
    assert 1000 * 9.81 / modulus == pytest.approx(0.01, rel=0.01)
    still = [dict(x, case="hydrostatic") for x in (BASE, soft)]
    scene = scenes.tank(cells=(4, 20), cell_size=0.1, modulus=2.2e9, at_rest=True)
    modulus = asked(scene, *still, error=0.01).settings.bulk_modulus["water"]
    assert 2 / 3 * 1000 * 10 * 2 / modulus == pytest.approx(0.01, rel=0.01)


@pytest.mark.parametrize(
    ("scene", "words"),
    [(lambda: pool(cells=8), "8 cells across; measured with 20: smaller cells"),
     (lambda: pool(cells=200), "200 cells across; measured with 20: errors should be smaller"),
     (lambda: pool(particles_per_cell=25), "5 an axis; measured with 2 an axis"),
     (lambda: pool(modulus=2.2e9), "is stiffer than what was measured"),
     (lambda: pool(velocity=(20.0, 0.0)), "may come to 20 m/s"),
     (lambda: pool(depth=10.0), "loses ρgH/K = 0.049")],
)  # fmt: skip
def test_range(asked, scene, words):
    assert any(words in w for w in asked(scene(), BASE).warnings)


def test_loads_on_what_is_a_few_cells_thick(asked):
    """Where the transfer loses shear in every step; not with FLIP, nor on what is thick."""

    def said(thick, weighed=True, transfer="APIC"):
        scene = pool(method=libmpm.Method(transfer=transfer))
        low = (0.8 * scene.upper[0], 0.2 * scene.upper[1])
        high = (low[0] + thick * scene.cell_size, 0.9 * scene.upper[1])
        deck = libmpm.shapes.Box(lower=low, upper=high)
        scene.add_boundary(name="deck", shape=deck, response=libmpm.boundaries.Separable())
        if weighed:
            cell = libmpm.sensors.LoadCell(boundary="deck", interval=0.01)
            scene.add_sensor(name="load", sensor=cell)
        said = asked(scene, BASE).warnings
        return [w for w in said if "carries a load cell and is 2 cells thick: APIC" in w]

    (text,) = said(2)
    assert "APIC over-predicts" in text and "transfer 'FLIP'" in text
    assert not said(2, weighed=False)
    assert not said(2, transfer="FLIP")
    assert not said(2, transfer=None)
    assert not said(5)


def test_doubts_about_loads_say_what_the_proposal_makes_of_them(asked):
    def doubt(*lines):
        scene = pool(method=libmpm.Method(transfer="APIC"))
        low = (0.8 * scene.upper[0], 0.2 * scene.upper[1])
        high = (low[0] + 4 * scene.cell_size, 0.9 * scene.upper[1])
        deck = libmpm.shapes.Box(lower=low, upper=high)
        scene.add_boundary(name="deck", shape=deck, response=libmpm.boundaries.Separable())
        cell = libmpm.sensors.LoadCell(boundary="deck", interval=0.01)
        scene.add_sensor(name="load", sensor=cell)
        advice = asked(scene, *lines)
        (text,) = [w for w in advice.warnings if "is 4 cells thick: APIC" in w]
        return advice, text

    advice, text = doubt(BASE)
    assert advice.refine == 1 and text.endswith("since no case of the atlas has it")
    fine = line("double the cells", 0.01, 8.0, group="cells", cells_across=40,
                changes={"cells": 40, "cells_ratio": 2.0})  # fmt: skip
    advice, text = doubt(BASE, fine)
    assert advice.refine == 2 and text.endswith("with the settings and the cell size proposed")


def test_inside_the_range_nothing_is_said(asked):
    missing = "case 'ritter' fits"
    warned = asked(pool(modulus=1.96e6), BASE, error=0.1).warnings
    assert not [w for w in warned if missing not in w]


def test_speeds_of_flows_and_boundaries_count(asked):
    scene = pool()
    scene.add_boundary(
        name="paddle", shape=shapes.Box(lower=(3.5, 0), upper=(3.7, 1)),
        response=boundaries.Slip(), motion=boundaries.Travel((-30.0, 0.0)),
    )  # fmt: skip
    assert any("may come to 30 m/s" in w for w in asked(scene, BASE).warnings)


# ---- which cases --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "changes", "expected"),
    [("dam-break", {}, ["dam-break", "ritter", "surge-load"]),
     ("ritter", {}, ["dam-break", "ritter"]),
     ("tank", {}, ["hydrostatic"]), ("tank", {"jitter": 0.1, "cells": 6}, ["tank"]),
     ("slope-basin", {}, ["hydrostatic", "slope-basin"]), ("sloshing", {}, ["sloshing"]),
     ("vortex", {}, ["vortex"]), ("beam", {}, ["beam"]), ("incline", {}, ["incline"])],
)  # fmt: skip
def test_reference_cases_are_like_themselves(case, changes, expected):
    assert names(case_scene(case, **changes)) == expected


def test_scenes_of_solids():
    assert names(flying()) == ["bar-impact"]
    assert names(flying(velocity=None)) == ["mode"]
    long = shapes.Box(lower=(0.5, 0.5), upper=(3.5, 1.0))
    assert names(flying(velocity=None, shape=long)) == ["bar", "mode"]
    turning = libmpm._src.base.formulas.Field(components=("-y", "x"))
    assert names(flying(velocity=turning)) == ["spin"]
    soft = materials.LinearElastic(density=1000, youngs_modulus=1e6, poissons_ratio=0.48)
    assert names(flying(soft, velocity=None)) == ["mode-incompressible", "mode"]


def test_a_pulse_along_a_bar_is_no_spin():
    pulse = libmpm.Field(components=("0.1 * exp(-((x - 1.5) / 0.2)**2)", "0"))
    assert names(flying(velocity=pulse)) == ["mode"]
    long = shapes.Box(lower=(0.5, 0.5), upper=(3.5, 1.0))
    assert names(flying(velocity=pulse, shape=long)) == ["bar", "mode"]
    # A shear is half a turn, a turn that also flies is one.
    assert "spin" in names(flying(velocity=libmpm.Field(components=("2 - (y - 1)", "x - 1.5"))))


@pytest.mark.parametrize("response", [boundaries.Slip(), boundaries.Sticky()])
def test_a_block_under_its_weight_swings_only_where_it_is_held(response):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 2), gravity=(0, -9.81))
    scene.add_body(
        name="block", shape=shapes.Box(lower=(1, 0), upper=(2, 1)),
        material=materials.FixedCorotated(density=1000, youngs_modulus=1e6, poissons_ratio=0.3),
    )  # fmt: skip
    scene.add_boundary(name="plane", shape=shapes.DomainWalls(faces=("y-",)), response=response)
    assert names(scene) == (["mode"] if isinstance(response, boundaries.Sticky) else [])


@pytest.mark.parametrize(("height", "floats"), [(0.4, False), (1.0, True), (1.3, True)])
def test_a_body_under_water_does_not_float(height, floats):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(2, 2), gravity=(0, -9.81)
    )
    disc = shapes.Sphere(centre=(1.0, height), radius=0.2)
    scene.add_body(
        name="disc", shape=disc, subtract_from=("water",),
        material=materials.FixedCorotated(density=800, youngs_modulus=1e6, poissons_ratio=0.3),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(2, 1)), hydrostatic=1.0,
        material=materials.TaitFluid(bulk_modulus=1e6),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    assert ("floating-block" in names(scene)) == floats
    told = [w for w in advise(scene).warnings if "is under water" in w]
    assert bool(told) != floats


def test_water_that_a_checkpoint_left_is_not_at_rest(tmp_path):
    scene = scenes.tank(cells=(4, 4), cell_size=0.1, modulus=1e5, at_rest=True)
    assert names(scene) == ["hydrostatic"]
    simulation = libmpm.Simulation(scene, device="cpu", threads=1)
    simulation.step(2)
    simulation.save_checkpoint(tmp_path / "a.h5")
    assert names(libmpm.Scene.from_checkpoint(tmp_path / "a.h5")) == [
        "dam-break",
        "ritter",
        "surge-load",
    ]


def test_rules_and_the_shipped_atlas_know_the_same_cases():
    known = {row.case for row in read_atlas().rows}
    # Contact, which two of them measure, is a choice of the scene that advice leaves as it is.
    assert known <= {rule.case for rule in RULES} | {"dominoes", "bar-pair", "sliding-block"}


# ---- nothing is invented ------------------------------------------------------------------------


def test_materials_that_were_not_measured_are_named(asked):
    sand = materials.DruckerPrager(
        density=1600, youngs_modulus=1e6, poissons_ratio=0.3, friction_angle=30
    )
    alone = asked(flying(sand), BASE)
    assert alone.settings is None
    assert alone.expected_error is None
    assert any("body 'block' is of DruckerPrager" in w for w in alone.warnings)
    assert any("no case of the atlas fits" in w for w in alone.warnings)
    assert alone.apply() == alone.scene
    beside = pool(fbar=None)
    beside.add_body(name="sand", shape=shapes.Box(lower=(2, 0), upper=(3, 1)), material=sand)
    advice = asked(beside, BASE, AFLIP)
    assert any("body 'sand'" in w for w in advice.warnings)
    assert "sand" not in advice.settings.fbar


def test_a_case_without_lines_is_named(asked):
    advice = asked(flying(), BASE)
    assert advice.settings is None
    assert any(
        "case 'bar-impact' fits" in w and "no line of it on cpu" in w for w in advice.warnings
    )


def test_another_device_is_named(asked, tmp_path):
    path = tmp_path / "atlas.json"
    head = {"format": 1, "library": "test", "commit": "none", "device": []}
    path.write_text(json.dumps(head | {"lines": [BASE]}))
    advice = advise(pool(), device="cuda:1", atlas=path)
    assert advice.device == "cpu"
    assert any("no lines of cuda" in w for w in advice.warnings)


def test_a_file_of_another_format_is_refused(tmp_path):
    path = tmp_path / "atlas.json"
    path.write_text(json.dumps({"format": 2, "lines": []}))
    with pytest.raises(libmpm.Error, match="format is 2; expected 1"):
        advise(pool(), device="cpu", atlas=path)


def test_cases_may_be_named(asked):
    vortex = line("baseline", 0.01, 1.0, case="vortex", group="baseline")
    advice = asked(pool(), BASE, vortex, cases=("vortex",))
    assert [m.case for m in advice.matches] == ["vortex"]
    assert advice.matches[0].why == "asked for"


@pytest.mark.parametrize(
    ("options", "words"),
    [({"error": 0}, "error is 0; expected > 0"),
     ({"cases": ("dam-brake",)}, "did you mean 'dam-break'"),
     ({"cases": ("beam",)}, "'beam', a case of solid, of which the scene has none")],
)  # fmt: skip
def test_wrong_questions(options, words):
    with pytest.raises(libmpm.SceneError, match=words):
        pool().advise(device="cpu", **options)


def test_what_cannot_run_is_refused():
    grid = grids.SplineGrid(lower=(0, 0), upper=(1, 1), spans=(2, 2), degree=(1, 1))
    with pytest.raises(libmpm.SceneError, match=r"libmpm\.advice\.tradeoff measures"):
        libmpm.Scene(grid=grid).advise()
    with pytest.raises(libmpm.SceneError, match="there is no body"):
        libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1)).advise()


# ---- what it looks like -------------------------------------------------------------------------


def test_presentation(asked):
    advice = asked(pool(fbar=None), BASE, AFLIP, line("double precision", 0.0801, 1.6))
    text = str(advice)
    for words in ("dam-break: water that falls", "error 3.0%", "AFLIP, flip 0.95", "as it is",
                  "'AFLIP': dam-break 3.0% (as it is 8.0%)", "libmpm test"):  # fmt: skip
        assert words in text
    html = advice._repr_html_()
    assert "<table>" in html
    assert "&#x27;AFLIP&#x27;" in html
    assert "changes transfer" in repr(advice)
    assert all(r.why for r in advice.reasons if r.changes)


def test_command_line(tmp_path, capsys):
    case_scene("dam-break").save(tmp_path / "scene.json")
    assert main(["check", str(tmp_path / "scene.json"), "--advise"]) == 0
    assert "asked for an error of 0.05" in capsys.readouterr().out
    assert main(["check", str(tmp_path / "scene.json"), "--advise", "0"]) == 2
    assert "error is 0" in capsys.readouterr().err


def test_own_transfers_of_bodies_give_way_to_another_scheme(asked):
    scene = pool(fbar=None, transfer=Transfer(scheme="APIC"))
    assert asked(scene, BASE, AFLIP).apply().bodies[0].transfer is None


def test_the_scene_is_left_alone(asked):
    scene = pool()
    before = copy.deepcopy(scene.to_dict())
    asked(scene, BASE, AFLIP).apply(cell_size=True, bulk_modulus=True)
    assert scene.to_dict() == before


# ---- the shipped atlas --------------------------------------------------------------------------

SHIPPED = ("dam-break", "tank", "slope-basin", "sloshing", "vortex", "beam", "incline")


@pytest.mark.parametrize("case", SHIPPED)
def test_advice_taken_is_advice_kept(case):
    """What is proposed is a scene that can run, and of it the same is said again."""
    scene = case_scene(case)
    advice = scene.advise(device="cpu")
    assert advice.settings is not None
    changed = advice.apply(cell_size=True)
    changed.validate()
    again = changed.advise(device="cpu")
    assert again.reached == advice.reached
    assert advice.reached or again.expected_error <= 1.1 * advice.expected_error
    if advice.settings.precision == "single":
        assert again.present_error is not None
    assert isinstance(advice.settings.method, Method)


def test_a_larger_error_never_costs_more():
    scene = case_scene("dam-break")
    found = [scene.advise(error=e, device="cpu") for e in (0.01, 0.02, 0.05, 0.1, 0.3)]
    reached = [a.cost for a in found if a.reached]
    # Costs within a quarter count as equal.
    assert all(a >= b / 1.25 for a, b in itertools.pairwise(reached))
    assert [a.reached for a in found] == sorted(a.reached for a in found)


def test_dam_break_runs_as_well_as_is_said():
    """The front of the case's own scene, with what is proposed for it."""
    case = cases.case("dam-break")
    p = case.parameters("reduced", {"cells": 16, "until": 6.0})
    # The rows of this case were measured with walls that hold nodes.
    scene = scenes.held(case.build(p, Options()))
    advice = scene.advise(error=0.05, device="cpu", cases=("dam-break",))
    assert advice.reached
    simulation = libmpm.Simulation(
        advice.apply(), device="cpu", precision=advice.settings.precision, threads=1
    )
    front = case.measure(simulation, p)["front_speed"]
    assert abs(front / 1.16 - 1) == pytest.approx(advice.expected_error, abs=0.003)


def test_values_are_plain():
    advice = case_scene("dam-break").advise(device="cpu")
    assert dataclasses.is_dataclass(advice.settings)
    assert {r.case for r in advice.lines} <= {"dam-break", "ritter", "surge-load"}
