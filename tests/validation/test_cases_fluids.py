"""The reference cases of water, alone and with solids, on their reduced and full levels.

What each is compared with stands in the case (`libmpm.cases`); here are also the trends that need
more than one run. Expected duration: 4 min of one core; the full level 10 min of a GPU.
"""

import pytest

import libmpm
import libmpm.cases
from libmpm import FBar, Method
from libmpm.cases import Options
from libmpm.methods import Transfer

pytestmark = pytest.mark.validation

NAMES = ("tank", "sloshing", "dam-break", "vortex", "loaded-beam", "elastic-column",
         "elastic-column-light", "buoyancy")  # fmt: skip


def run(name, device, options=None, **changes):
    return libmpm.cases.run(name, options=options, device=device, **changes)


def test_every_case_of_water_is_here():
    from libmpm._src.advice.cases.fluids import CASES

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


# ---- tank ---------------------------------------------------------------------------------------


def test_tank_does_not_depend_on_the_time_step(device):
    """Half the step over the same time gives the same profile to 0.1 % of ρ g H."""
    profile = [
        run("tank", device, steps=20_000, time_step_factor=f).values["profile"] for f in (1.0, 0.5)
    ]
    assert abs(profile[1] - profile[0]) <= 0.001


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5, 0.75])
def test_tank_with_a_disordered_fill(offset, device):
    """Particles up to a tenth of a cell off, the fill anywhere against the bed: layers within 4 %.

    Nothing of the pressure alternates from cell to cell.
    """
    result = run("tank", device, jitter=0.1, width=8, steps=20_000, offset=offset)
    assert result.values["profile"] <= 0.04
    assert result.values["checkerboard"] <= 0.04


@pytest.mark.gpu
@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize("jitter", [0.0, 0.1])
@pytest.mark.parametrize("offset", [0.0, 0.25, 0.5, 0.75])
def test_tank_for_long(offset, jitter, full):
    """4e5 steps with the fill at any place against the bed."""
    result = libmpm.cases.run(
        "tank", "full", device="cuda", offset=offset, jitter=jitter, width=8 if jitter else 3
    )
    assert result.values["profile"] <= (0.04 if jitter else 0.01), result.values


# ---- waves and vortices -------------------------------------------------------------------------


def test_sloshing_with_the_published_smoothing(device):
    result = run("sloshing", device, Options(fbar=FBar(form="two-volume", ratio=0.99)))
    assert not result.failures, result.failures


def test_sloshing_between_walls_that_hold_nodes(device):
    """They take more of the motion than mirrored ones; a shorter relaxation gives part of it back.

    What they strain wrongly is a spring beside the wall; what F-bar relaxes of it is lost
    (design/fbar.md, 6).
    """
    modulus, dx = 2.2e6, 0.1

    def left(fbar, **walls):
        values = run("sloshing", device, Options(fbar=fbar), bulk_modulus=modulus, **walls).values
        return values["amplitude"]

    shorter = FBar(time=3 * dx / (modulus / 1000) ** 0.5)
    held = [left(fbar, mirror=False, gap=0.5) for fbar in (FBar(), shorter)]
    assert held[0] < held[1] < left(FBar()), held


def test_what_transfers_dissipate(device):
    """PIC stops the vortex, APIC keeps part of it, a share of the particles' own motion more."""
    left = [
        run("vortex", device, Options(method=Method(transfer=t))).values["kinetic_left"]
        for t in ("PIC", "APIC", Transfer(scheme="AFLIP", flip=0.9))
    ]
    assert left[0] < 0.1 < left[1] < left[2] <= 1.02, left


def test_vortex_lasts_longer_on_finer_cells(device):
    """With fourfold as many cells a side, the loss is less than half."""
    lost = [1 - run("vortex", device, cells=n).values["kinetic_left"] for n in (16, 64)]
    assert lost[1] < 0.5 * lost[0]


# ---- water and solids ---------------------------------------------------------------------------

MODULI = (5e7, 5e6, 2e6, 1e6)


def test_beams_of_four_moduli(device):
    """All follow the beam with membrane stiffening; the softer, the more it is stiffened."""
    results = [run("loaded-beam", device, youngs_modulus=e) for e in MODULI]
    assert not [r.failures for r in results if r.failures]
    stiffening = [r.values["stiffening"] for r in results]
    assert stiffening == sorted(stiffening, reverse=True)
    assert stiffening[0] > 1 > stiffening[-1]


@pytest.mark.gpu
@pytest.mark.parametrize("modulus", MODULI)
def test_beams_in_full(modulus, full):
    result = libmpm.cases.run("loaded-beam", "full", device="cuda", youngs_modulus=modulus)
    assert not result.failures, result.failures


def test_cubes_converge_on_refinement(device):
    """Every cube goes further, towards the model of open water, on finer cells."""
    runs = [run("buoyancy", device, cell_size=size).values for size in (0.2, 0.4 / 3, 0.1)]
    for density in (750, 1500, 3000):
        away = [values[f"model_{density}"] for values in runs]
        assert away == sorted(away, reverse=True), (density, away)


@pytest.mark.slow
def test_cubes_meet_less_drag_with_less_dissipation(device):
    """A larger FLIP share lets every cube go further (0.3 against 0.9); so does shifting."""
    moved = []
    for transfer in (
        Transfer(scheme="AFLIP", flip=0.3),
        Transfer(scheme="AFLIP", flip=0.9),
        Transfer(scheme="ASFLIP", flip=0.9, shift_max=0.2),
    ):
        method = Method(cfl=0.45, transfer=transfer)
        values = run("buoyancy", device, Options(method=method), cell_size=0.4 / 3).values
        moved.append([values["y_750"] - 5, 5 - values["y_1500"], 5 - values["y_3000"]])
    low, high, shifted = moved
    assert all(a < b for a, b in zip(low, high, strict=True)), moved
    assert all(b > a for a, b in zip(low, shifted, strict=True)), moved
