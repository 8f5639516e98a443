"""Reference cases of solids and grains: their own bounds, and the trends behind them.

Expected duration: 2 min on one core (1.1e9 particle-steps).
"""

import math

import numpy as np
import pytest

import libmpm
import libmpm.cases
from libmpm._src.advice.cases.dominoes import _rigid_time
from libmpm._src.advice.cases.grains import runout
from libmpm._src.advice.cases.solids import CASES
from libmpm._src.materials.friction import triaxial

pytestmark = pytest.mark.validation


#: How deep two discs overlap at the worst hangs on the last digit of a chaotic fall: 0.2 cells in
#: double on every backend, 0.2 to 2.3 in single by how its sums are ordered.
PRECISION = {"discs": "double"}


def passed(name, device, **changes):
    """Run a case and ask for its bounds; returns what it measured."""
    if device == "cpu" or changes.get("level") != "full":
        changes.setdefault("precision", PRECISION.get(name, "auto"))
    result = libmpm.cases.run(name, device=device, **changes)
    assert not result.failures, result.failures
    return result.values


@pytest.mark.parametrize("name", [c.name for c in CASES if "reduced" in c.levels])
def test_reduced(name, device):
    passed(name, device)


@pytest.mark.gpu
@pytest.mark.parametrize("name", [c.name for c in CASES if "full" in c.levels])
def test_full(name, full):
    passed(name, "cuda", level="full")


def test_steep_incline(device):
    passed("incline", device, angle=31.0)


@pytest.mark.parametrize("aspect", [0.5, 1.5, 3.0, 4.0])
def test_runout_over_aspect_ratios(aspect, device):
    """Both branches of the experiments; the reduced level itself has a = 1."""
    passed("column-collapse", device, aspect=aspect)


@pytest.mark.parametrize("aspect", [0.7, 1.0, 2.0, 4.0, 7.0])
def test_columns_in_20_cells_spread_as_measured(aspect, device):
    """Run-out ± 15 %, height ± 10 %; what APIC loses in thin layers ends them at 0.7 and 4."""
    passed("column-collapse", device, aspect=aspect, cells=20)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("aspect", [0.7, 1.0, 2.0, 4.0, 7.0])
def test_columns_in_40_cells_spread_as_measured(aspect, device):
    """The same on a finer grid: half a minute to three minutes each."""
    passed("column-collapse", device, aspect=aspect, cells=40)


def test_runout_falls_with_friction(device):
    """Stronger sand goes less far and stands higher."""
    found = [
        libmpm.cases.run("column-collapse", device=device, friction_angle=angle, cells=16).values
        for angle in (25.0, 32.0, 39.0)
    ]
    reach = [v["runout"] for v in found]
    height = [v["height_ratio"] for v in found]
    assert reach[0] > reach[1] > reach[2]
    assert height[0] < height[1] < height[2]


@pytest.mark.parametrize("modulus", [1e6, 2e6])
def test_soft_beams_stretch(modulus, device):
    """Where the linear beam is wrong by up to 7 %, the one with membrane force holds."""
    values = passed("beam", device, youngs_modulus=modulus)
    assert values["linear_ratio"] < values["deflection_ratio"]


def test_beam_converges(device):
    """The held nodes take a third of a cell from the span at either end (design/walls.md)."""
    error = [
        1 - libmpm.cases.run("beam", device=device, cells=n).values["deflection_ratio"]
        for n in (3, 6)
    ]
    assert error[0] / error[1] == pytest.approx(2, abs=0.5)


def test_domino_tips_alike_on_other_grids(device):
    for cells in (3, 4):
        passed("domino-tip", device, cells=cells)


def test_domino_below_its_critical_angle_falls_back(device):
    values = libmpm.cases.run("domino-tip", device=device, cells=3, start=5.0).values
    assert values["time"] == math.inf


def test_closed_forms():
    """Numbers of the sources: Bonus (2023), 6.9; design/solids.md; Lube et al. (2005)."""
    assert _rigid_time(15.0, 60.0) == pytest.approx(0.1498, abs=1e-4)
    assert triaxial(43.9, "plane-strain") == pytest.approx(30.0, abs=0.05)
    assert triaxial(30.0, "plane-strain") == pytest.approx(22.2, abs=0.05)
    assert runout(1.0) == 1.2
    assert runout(4.0) == pytest.approx(1.9 * 4 ** (2 / 3))
    steps = np.diff([runout(a) for a in np.linspace(0.5, 5, 200)])
    assert (steps > 0).all()
