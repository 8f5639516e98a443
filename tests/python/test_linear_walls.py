"""Walls of linear cells against the naive method, and what every wall has to be.

Expected duration: 30 s, nearly all of it the naive method.
"""
# ruff: noqa: F811  the fixture `device` is imported

import numpy as np
import pytest

from support import scenes
from support.devices import device  # noqa: F401
from support.lines_reference import LinesReference
from support.tolerances import REFERENCE

SCENES = {
    "slip": {},
    "separable": {"separable": True},
    "gap of one": {"gap": 1},
    "gap of two": {"gap": 2, "separable": True},
    "wide gap": {"gap": 5},
    "thin": {"thin": True},
}


@pytest.mark.parametrize("case", SCENES)
@pytest.mark.parametrize("dimension", [2, 3])
def test_as_the_naive_method(dimension, case, device):
    scene = scenes.narrow(dimension, **SCENES[case])
    steps = 40 if dimension == 2 else 6
    spec = scenes.specification(scene)
    machine, naive = scenes.engine(spec, device), LinesReference(spec)
    scenes.advance(machine, steps)
    naive.run(steps)
    for k in range(len(spec["bodies"])):
        expected = naive.velocity(k)[0]
        assert np.abs(scenes.by_id(machine, k, "position") - naive.position[k]).max() < (
            REFERENCE * naive.dx
        )
        assert np.abs(scenes.by_id(machine, k, "velocity") - expected).max() < (
            REFERENCE * np.abs(expected).max()
        )
