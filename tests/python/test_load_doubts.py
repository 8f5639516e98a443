"""What `validate` and the plan say of loads that the cells do not resolve."""

from __future__ import annotations

import warnings

import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes

DEEP, LONG = 1.0, 6.0  # m
BLEND = libmpm.methods.Transfer(scheme="AFLIP", flip=0.95)


def said(scene: libmpm.Scene) -> list[str]:
    """Return the doubts of `validate`."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.validate()
    return [str(w.message) for w in caught if issubclass(w.category, libmpm.ModelWarning)]


def flume(
    across=8,
    gap=20.0,
    *,
    deep=20,
    cell="held",
    transfer="FLIP",
    weighed=True,
    velocity=1.0,
    modulus=1e6,
    faces="all",
) -> libmpm.Scene:
    """Return water `deep` cells deep in a flume, with a box `gap` cells above its bed."""
    dx = DEEP / deep
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(LONG, DEEP + (across + gap) * dx),
        gravity=(0, -9.81), method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    response = boundaries.Separable(cell=cell)
    box = shapes.Box(lower=(3.0, gap * dx), upper=(3.0 + across * dx, (gap + across) * dx))
    water = shapes.Box(lower=(0, 0), upper=(LONG, DEEP)) - box
    scene.add_body(
        name="water", shape=water, material=materials.TaitFluid(bulk_modulus=modulus),
        hydrostatic=DEEP, velocity=(velocity, 0.0),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=("x-", "x+", "y-")), response=response
    )
    scene.add_boundary(name="box", shape=box, response=response)
    if weighed:
        load = sensors.LoadCell(boundary="box", interval=0.01, faces=faces)
        scene.add_sensor(name="load", sensor=load)
    return scene


def test_a_resolved_load_is_quiet():
    assert not said(flume())
    assert not said(flume(deep=40, across=40, gap=10.0))


@pytest.mark.parametrize(
    ("how", "words"),
    [({"gap": 2}, ("boundary 'box'", "face 'y-' is 2 cells wide", "10 cells or more")),
     ({"across": 2, "transfer": "APIC"}, ("2 cells thick", "APIC over", "transfer 'FLIP'")),
     ({"across": 2}, ("2 cells thick", "4 cells or more")),
     ({"deep": 10, "gap": 10.0}, ("10 cells deep", "34 % too much with 8", 'cell="linear"')),
     ({"modulus": 1e5}, ("body 'water': bulk_modulus is 1e+05", "ρgH/K"))],
)  # fmt: skip
def test_each_cause_is_named_with_its_remedy(how, words):
    (text,) = [t for t in said(flume(**how)) if all(w in t for w in words)]
    assert "use " in text or "or more cells" in text
    assert not said(flume(**how | {"weighed": False}))


@pytest.mark.parametrize(
    ("gap", "modulus", "named"), [(2, 1e9, True), (2, 1e7, False), (20, 1e9, False)]
)
def test_stiff_water_beside_a_narrow_gap_is_named(gap, modulus, named):
    """ρgH is 9,810 Pa: 2,000 of it are 2e7."""
    stiff = [text for text in said(flume(gap=gap, modulus=modulus)) if "water so stiff" in text]
    assert len(stiff) == named
    assert not named or "use bulk_modulus ≤ 2e+07, or cells of a tenth of the gap" in stiff[0]


def test_strict_makes_it_an_error_and_the_plan_has_it():
    scene = flume(gap=2)
    with pytest.raises(libmpm.SceneError, match="2 cells wide"):
        scene.validate(strict=True)
    with pytest.warns(libmpm.ModelWarning, match="2 cells wide"):
        plan = scene.plan(device="cpu")
    assert any("2 cells wide" in w for w in plan.warnings)


def test_linear_cells_need_half_the_depth():
    assert any("10 cells deep" in t for t in said(flume(deep=10, gap=10.0)))
    assert not said(flume(deep=10, gap=10.0, cell="linear", transfer=BLEND))


def test_a_box_that_stands_on_the_bed_has_no_gap_there():
    assert not said(flume(gap=0.0))


def test_the_bed_under_a_structure_makes_its_depth():
    """A berm that leaves four cells of water, as on a flume's flat."""
    scene = flume(gap=20.0, across=8)
    assert not said(scene)
    berm = shapes.Box(lower=(2.0, 0.0), upper=(5.0, 0.8))
    scene = flume(gap=20.0, across=8)
    told = scene.to_dict()
    told["bodies"][0]["shape"] = {"type": "Box", "lower": [0, 0], "upper": [2.0, DEEP]}
    other = libmpm.Scene.from_dict(told)
    other.add_boundary(name="berm", shape=berm, response=boundaries.Slip())
    texts = said(other)
    assert any("water up to 4 cells deep" in t for t in texts), texts
    assert any("face 'y-' is 4 cells wide" in t for t in texts), texts


def test_still_water_only_lacks_on_single_faces_of_held_boxes():
    still = {"velocity": 0.0, "gap": 4.0, "across": 4}
    assert not said(flume(**still))
    (text,) = said(flume(**still, faces=("x-",)))
    assert "sensor 'load'" in text and "10% of the 4 cells" in text
    assert not said(flume(**still, faces=("x-",), cell="linear", transfer=BLEND))


@pytest.mark.parametrize(
    ("place", "velocity", "cell", "words"),
    [((1.0, 0.0), 1.0, "held", "2 to 13 times"), ((1.0, 0.0), 0.0, "held", None),
     ((1.0, 0.0), 1.0, "linear", None), ((1.0, 0.2), 1.0, "held", None),
     ((2.99, 1.1), 0.0, "held", "1.2 to 1.3 times")],
)  # fmt: skip
def test_probes_beside_held_walls(place, velocity, cell, words):
    scene = flume(weighed=False, velocity=velocity, cell=cell)
    scene.add_sensor(name="probe", sensor=sensors.PressureProbe(position=place))
    texts = [t for t in said(scene) if "sensor 'probe'" in t]
    assert len(texts) == (words is not None)
    assert words is None or words in texts[0]


def advice(**how):
    """Return what `advise` says, without the doubts of `validate`."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        cases = how.pop("cases", None)
        return flume(**how).advise(device="cpu", cases=cases)


def test_advice_speaks_of_the_loads_error():
    """Between held walls a bore of 8 cells has 24 % too much load, in the case that fits."""
    found = advice(transfer="APIC", gap=20.0)
    assert "surge-load" in [m.case for m in found.matches]
    assert found.present_error > 0.2
    assert not any("nothing measured covers it" in w for w in found.warnings)
    assert "surge-load" not in [m.case for m in advice(weighed=False).matches]


def test_a_gap_of_few_cells_is_like_a_gate_and_a_slot():
    assert {"gate", "slot"} <= {m.case for m in advice(gap=2).matches}
    assert not {"gate", "slot"} & {m.case for m in advice().matches}


def test_advice_says_where_its_error_is_not_the_loads():
    told = advice(gap=2, cases=["dam-break"]).warnings
    assert any("the load on 'box'" in w and "nothing measured covers it" in w for w in told)
    assert any("2 cells wide" in w for w in told)
    without = advice(gap=2, weighed=False, cases=["dam-break"]).warnings
    assert not any("load on" in w or "carries a load cell" in w for w in without)
