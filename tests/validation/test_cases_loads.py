"""Reference cases of loads and flows at structures. Expected duration: 40 s."""

import warnings

import pytest

import libmpm
from libmpm import boundaries, cases
from libmpm._src.advice.cases.loads import CASES, _jump

pytestmark = pytest.mark.validation
NAMES = [c.name for c in CASES]


def run(name, level="reduced", options=None, **how):
    """Run a case; what its stream takes out of the domain is no matter."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        return cases.run(name, level, options, **how)


@pytest.mark.parametrize("name", NAMES)
def test_reduced(name, device):
    result = run(name, device=device)
    assert not result.failures, result.failures


@pytest.mark.parametrize("name", NAMES)
def test_full(name, full, device):
    result = run(name, "full", device=device)
    assert not result.failures, result.failures


def test_depth_behind_a_bore_conserves_momentum():
    """In the frame of the front: what flows in of mass and momentum flows out."""
    depth, speed, g = 1.0, 0.3, 9.81
    behind = _jump(depth, speed)
    front = speed * behind / (behind - depth)
    assert depth * front == pytest.approx(behind * (front - speed))
    pushed = 0.5 * g * (behind**2 - depth**2)
    assert depth * front * speed == pytest.approx(pushed)


def test_walls_that_hold_nodes_take_a_multiple_of_the_load(device):
    """The wall's cell decides, not the transfer: 1.9 and 1.25 with 4 and 8 cells a depth."""
    held = cases.Options(walls=boundaries.Slip(cell="held"))
    found = [run("surge-load", options=held, device=device, cells=n).values["load"] for n in (4, 8)]
    assert found == [pytest.approx(1.92, abs=0.1), pytest.approx(1.25, abs=0.05)]


def test_what_a_transfer_loses_chokes_a_slot(device):
    """Four cells in the slot: APIC lets a quarter of it through."""
    plain = cases.Options(method=libmpm.Method(cfl=0.3, transfer="APIC"))
    assert run("slot", options=plain, device=device).values["discharge"] < 0.35
