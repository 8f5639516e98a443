"""The reference cases of wave makers on their reduced and full levels.

What each is compared with stands in the case (`libmpm.cases`). Expected duration: 35 s of one core;
the full level 3 min of a GPU.
"""

import pytest

import libmpm.cases

pytestmark = pytest.mark.validation

NAMES = ("piston-flume", "ritter", "pump-current", "slope-basin")


def run(name, device, **changes):
    return libmpm.cases.run(name, device=device, **changes)


def test_every_case_of_waves_is_here():
    from libmpm._src.advice.cases.waves import CASES

    assert tuple(case.name for case in CASES) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_reduced(name, device):
    result = run(name, device)
    assert not result.failures, result.failures


@pytest.mark.gpu
@pytest.mark.parametrize("name", NAMES)
def test_full(name, full):
    result = libmpm.cases.run(name, "full", device="cuda")
    assert not result.failures, result.failures


@pytest.mark.parametrize("angle", [pytest.param(5.0, marks=pytest.mark.slow), 31.0])
def test_basins_on_other_slopes_rest(angle, device):
    result = run("slope-basin", device, angle=angle)
    assert not result.failures, result.failures


@pytest.mark.slow
def test_depth_at_the_gate_is_that_of_fine_cells(device):
    """What it is above Ritter's at T = 2.5 is no matter of cells, nor of the speed of sound."""
    early = [run("ritter", device, **c).values["gate_early"] for c in ({}, {"cells": 20},
             {"cells": 20, "sound": 20.0})]  # fmt: skip
    assert max(early) - min(early) < 0.01, early
