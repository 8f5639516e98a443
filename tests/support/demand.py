"""Laws and loads of debris fields for tests, and how far a random result may be off."""

from __future__ import annotations

import math

import numpy as np
import pytest

from libmpm import demand

stats = pytest.importorskip("scipy.stats")
pytest.importorskip("statsmodels")

QUARTER = math.pi / 2
#: A reduction in the angle with a minimum of 0.4, and the law whose load has a closed form.
ANGULAR = demand.Reduction.three_point(0.4)
POROUS = demand.Reduction.linear(0.3)
UNIFORM = stats.uniform(0, 90)
#: Chance that a test of a random result may fail although all is well, for each of its looks.
RARE = 1e-6


def dkw(samples: int) -> float:
    """Bound of the largest error of an empirical law (Dvoretzky, Kiefer and Wolfowitz)."""
    return math.sqrt(math.log(2 / RARE) / (2 * samples))


def fitted(random: np.random.Generator, noise: float = 100.0) -> demand.OrderedLoad:
    """Return a fit to data about 50 N + 300 N c."""
    count = np.repeat([1, 2, 4, 8, 16], 3)
    return demand.ordered_load(count, 50 + 300 * count + random.normal(0, noise, 15))
