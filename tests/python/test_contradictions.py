"""Boundaries that contradict each other, or act for less than a step, are warned of.

Expected duration: 5 s.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, cases, materials, shapes

SIDES = ({"lower": (1, 0), "upper": (3, 0.5)}, {"lower": (2, 0), "upper": (4, 0.5)})
STICKY = {"response": boundaries.Sticky()}


def belt(speed):
    """A velocity along x that a face has."""
    return libmpm.TimeTable((0.0,), ((speed, 0.0),))


def scene(*parts, **walls):
    """Water above boundaries named a, b ..."""
    made = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 2), gravity=(0, -9.81))
    made.add_body(
        name="water", shape=shapes.Box(lower=(2.2, 0.5), upper=(2.8, 0.9)),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    if walls:
        made.add_boundary(name="walls", shape=shapes.DomainWalls(), **walls)
    for name, part in zip("abc", parts, strict=False):
        made.add_boundary(name=name, **part)
    return made


def told(made):
    """What the plan says about boundaries that contradict each other."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return [w for w in libmpm.Simulation(made, device="cpu").plan.warnings if "contra" in w]


def belts(**more):
    """Two belts that run against each other, with the tops of two boxes that overlap."""
    return [
        {"shape": shapes.Box(**side), "motion": belt(v), **STICKY, **more}
        for side, v in zip(SIDES, (1.0, -1.0), strict=True)
    ]


def rough(friction):
    return boundaries.Separable(static_friction=friction, dynamic_friction=friction)


def test_the_order_of_definition_decides_and_is_warned_of():
    ends = []
    for parts in (belts(), belts()[::-1]):
        made = scene(*parts)
        (text,) = told(made)
        assert "boundary 'b'" in text and "boundary 'a'" in text
        assert "2 to 3 m, 0.5 to 0.5 m" in text and "end one where the other begins" in text
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            sim = libmpm.Simulation(made, device="cpu", threads=1)
        sim.step(20)
        ends.append(float(np.mean(sim.particles["water"]["velocity"][:, 0])))
    assert ends[0] * ends[1] < 0, ends


def regions(speed):
    return [
        {"shape": shapes.Box(**side), "motion": belt(v), "response": boundaries.Prescribed()}
        for side, v in zip(SIDES, (1.0, speed), strict=True)
    ]


@pytest.mark.parametrize(("parts", "many"), [
    (regions(-1.0), 1), (regions(1.0), 0),
    ([{"shape": shapes.Box(**s), "response": rough(f)}
      for s, f in zip(SIDES, (0.5, 0.0), strict=True)], 1),
    ([{"shape": shapes.Box(**s), "response": rough(0.5)} for s in SIDES], 0),
    ([{**b, "time": t} for b, t in zip(belts(), ((0, 1), (1, 2)), strict=True)], 0),
    ([{**belts()[0]}, {**belts()[1], "shape": shapes.Box(lower=(3, 0), upper=(4, 0.5))}], 0),
])  # fmt: skip
def test_pairs(parts, many):
    assert len(told(scene(*parts))) == many


@pytest.mark.parametrize("response", [boundaries.Sticky(), boundaries.Slip(), rough(0.3)])
def test_what_stands_or_moves_on_a_floor_is_no_contradiction(response):
    post = {"shape": shapes.Box(lower=(1, 0), upper=(1.5, 1)), "response": response}
    piston = {"shape": shapes.Box(lower=(-1, -1), upper=(0.5, 2)), "response": response,
              "motion": boundaries.Travel((1.0, 0.0))}  # fmt: skip
    for walls in (boundaries.Sticky(), boundaries.Slip(), rough(0.1)):
        assert told(scene(post, piston, response=walls)) == []
        moving = {**post, "motion": boundaries.Travel((1.0, 0.0))}
        assert told(scene(moving, response=walls)) == []


@pytest.mark.parametrize("name", ["piston-flume", "pump-current", "slope-basin", "dam-break"])
def test_no_false_alarm_in_reference_cases(name):
    case = cases.case(name)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert told(case.build(case.levels["reduced"], cases.Options())) == []


def test_a_time_shorter_than_a_step_is_warned_of():
    part = {"shape": shapes.Box(**SIDES[0]), **STICKY}
    short, long = ({**part, "time": (0.5, 0.5 + width)} for width in (1e-6, 0.5))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = [libmpm.Simulation(scene(p), device="cpu").plan.warnings for p in (short, long)]
    (text,) = (w for w in found[0] if "steps of" in w)
    assert "boundary 'a': time is (0.5, 0.500001), 1e-06 s" in text and "longer time" in text
    assert not [w for w in found[1] if "steps of" in w]
