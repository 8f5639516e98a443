"""Smoothing over cells in runs: the same as on arrays, bars of Yang (2016), refusals.

Expected duration: 9 s.
"""

import numpy as np
import pytest

import libmpm
from libmpm import _core, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm.methods import METHODS, smooth
from support.bars import YOUNG, Bar
from support.drifting import DX, SOFT, by_id, drifting, state_of, undecided

WATER = materials.TaitFluid(density=1000, bulk_modulus=1e6)
FORCE = libmpm.boundaries.PlacedForce(axis="x", place=(0.0, 1.0), value=((-4.0, 0.0), (4.0, 0.0)))
STEEL = materials.LinearElastic(density=1000, youngs_modulus=1e6, poissons_ratio=0.2)


#: NB means at nodes of the scene's functions, which are corners of cells for linear ones.
CASES = [
    (method, *case)
    for method in METHODS
    for case in ((2, "quadratic", "volume"), (2, "linear", "strain"), (3, "linear", "volume"))
    if method != "NB" or case[1] == "linear"
]


@pytest.mark.parametrize(("method", "dimension", "kernel", "field"), CASES)
def test_a_step_smooths_as_arrays_do_and_counts_strays(tmp_path, method, dimension, kernel, field):
    engine, state = drifting(
        tmp_path, dimension, kernel, libmpm.methods.Smoothing(method=method), field
    )
    shift = 0 if kernel == "quadratic" else 0.5 * DX
    changes = []
    for _ in range(7):  # 0.7 cells: some stand beside the cell that they were sorted into
        before = by_id(engine, "position")
        made = smooth(state, 1, before - shift, DX, method=method)
        clear = ~undecided(state, before - shift, method, made.q)
        assert clear.mean() > 0.95
        energy = (state**2).sum()
        engine.run(1, np.inf, 1e9)
        state = state_of(engine)
        changes.append((state**2).sum() - energy)
        np.testing.assert_allclose(state[clear], made.q[clear], rtol=0, atol=1e-13)
    rows = engine.smoothing(0)
    assert rows.shape == (7, 5)
    mass = 1000 * 1e-4
    np.testing.assert_allclose(rows[:, 3], mass * np.array(changes), rtol=1e-6, atol=1e-16)
    assert (rows[:, 3] <= 1e-13 * rows[:, 2]).all()


@pytest.mark.parametrize("method", ["NB", "F0AL1", "F1"])
def test_threads_and_portions_change_no_bit(tmp_path, method):
    found = []
    for threads, portions in ((1, (6,)), (2, (1, 2, 3))):
        engine, _ = drifting(
            tmp_path, 3, "quadratic", libmpm.methods.Smoothing(method=method),
            threads=threads, n=5000,
            assumed=libmpm.methods.AssumedFields(over="cell", part="full"), modulus=50.0,
            force=libmpm.boundaries.PlacedForce(
                axis="x", place=(0.0, 1.0), value=((-4.0, 0.0, 0.0), (4.0, 0.0, 0.0))
            ),
        )  # fmt: skip
        for steps in portions:
            engine.run(steps, np.inf, 1e9)
        found.append((state_of(engine), by_id(engine, "position")))
    for a, b in zip(*found, strict=True):
        np.testing.assert_array_equal(a, b)


# ---- assumed fields and modified functions ------------------------------------------------------


def hats(x, modified):
    """Linear functions at the nodes 0 and 1 of spans, and their slopes, at x of the span."""
    value = np.stack([1 - x, x])
    slope = np.stack([-np.ones_like(x), np.ones_like(x)])
    if modified:
        natural = 2 * x - 1
        value = np.clip(value, 0.001, 0.999)
        slope = slope * np.minimum((1 - abs(natural)) / 0.01, 1)
    return value, slope


@pytest.mark.parametrize("modified", [False, True])
@pytest.mark.parametrize(
    ("over", "rate"), [(None, True), ("cell", True), ("node", True), ("cell", False)]
)
def test_nodal_sums_are_those_of_the_mean_stress(tmp_path, over, rate, modified):
    assumed = None
    if over is not None:
        assumed = libmpm.methods.AssumedFields(over=over, part="full", rate=rate)
    engine, _ = drifting(
        tmp_path, 2, "linear", None, modified=modified, assumed=assumed, modulus=50.0, fbar=None
    )
    engine.run(2, np.inf, 1e9)
    x = by_id(engine, "position") / DX - 0.5
    tau = -50 / 7.15 * ((1 - state_of(engine)[:, 0]) ** -7.15 - 1) * (1 - state_of(engine)[:, 0])
    span = np.floor(x).astype(int)
    at = x - span
    exact, _ = hats(at, False)
    used, slope = hats(at, modified)
    if over == "cell":
        _, cell = np.unique(span, axis=0, return_inverse=True)
        cell = cell.ravel()
        tau = (np.bincount(cell, tau) / np.bincount(cell))[cell]
    elif over == "node":
        mass, sums = np.zeros((30, 30)), np.zeros((30, 30))
        for i in (0, 1):
            for j in (0, 1):
                w = exact[i, :, 0] * exact[j, :, 1]
                np.add.at(mass, (span[:, 0] + i, span[:, 1] + j), w)
                np.add.at(sums, (span[:, 0] + i, span[:, 1] + j), w * tau)
        mean = sums / np.where(mass > 0, mass, 1)
        tau = sum(
            exact[i, :, 0] * exact[j, :, 1] * mean[span[:, 0] + i, span[:, 1] + j]
            for i in (0, 1) for j in (0, 1)
        )  # fmt: skip
    velocity = state_of(engine)[:, -2:]  # that FLIP stores
    mass, momentum = np.zeros((30, 30)), np.zeros((30, 30, 2))
    for i in (0, 1):
        for j in (0, 1):
            place = (span[:, 0] + i, span[:, 1] + j)
            w = used[i, :, 0] * used[j, :, 1]
            np.add.at(mass, place, 0.1 * w)
            along = np.stack([slope[i, :, 0] * used[j, :, 1], used[i, :, 0] * slope[j, :, 1]], 1)
            force = -1e-4 * tau[:, None] * along / DX
            np.add.at(momentum, place, 0.1 * w[:, None] * velocity + 0.01 * force)
    sums = engine.sums()
    place = tuple(sums["cell"].T)
    np.testing.assert_allclose(sums["mass"], mass[place], atol=1e-13)
    for a, name in enumerate(("momentum_x", "momentum_y")):
        np.testing.assert_allclose(sums[name], momentum[place][:, a], atol=1e-12)


def test_a_cells_particles_share_the_assumed_volume_rate(tmp_path):
    spread = []
    for assumed in (None, libmpm.methods.AssumedFields()):
        engine, before = drifting(
            tmp_path, 2, "linear", None, assumed=assumed, modulus=50.0, fbar=None
        )
        engine.run(1, np.inf, 1e9)
        x = by_id(engine, "position")
        start = np.floor((np.load(tmp_path / "points2.npy") / DX) - 0.5).astype(int)
        _, cell = np.unique(start, axis=0, return_inverse=True)
        after, first = state_of(engine)[:, 0], before[:, 0]
        rate = (first - after) / (1 - first)  # dt tr(d)
        assert np.isfinite(x).all()
        spread.append(max(np.ptp(rate[cell.ravel() == c]) for c in range(cell.max() + 1)))
    assert spread[0] > 1e-7
    assert spread[1] < 1e-14


def swaying(assumed, steps=40):
    """A block of LinearElastic that a smooth velocity field strains within its cells."""
    scene = body_scene(
        STEEL, method=libmpm.Method(transfer="FLIP", kernel="linear", time_step=2e-4),
        velocity=libmpm.Field(components=("0.01 * sin(20 * x * y)", "0.01 * cos(15 * x)")),
        assumed=assumed, particles_per_cell=4,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    sim.step(steps)
    found = sim.particles["b"]
    order = np.argsort(found["id"])
    # The state's own stress: its spread within cells is that of the strains.
    return found["position"][order], found["stress"][order].reshape(-1, 4)


@pytest.mark.parametrize("over", ["cell", "node"])
def test_a_mean_of_strains_drives_a_body_as_a_mean_of_rates_does(over):
    """Yang (2016) 3.44 to 3.48: without the assumed rate the mean stress is C : ε̃ (3.43), of which
    mean rates make the same while a cell keeps its particles: a mean of means is itself. Lumped
    means at nodes are not, and what is strained by them is smoothed twice."""
    forms = [libmpm.methods.AssumedFields(over=over, part="full", rate=r) for r in (True, False)]
    (place, stress), (other, own) = (swaying(a) for a in forms)
    plain, _ = swaying(None)
    spans = np.floor(place / 0.1 - 0.5)
    assert (spans == np.floor(other / 0.1 - 0.5)).all()
    cell = np.unique(spans, axis=0, return_inverse=True)[1].ravel()
    spread = [max(np.ptp(s[cell == c, 0]) for c in range(cell.max() + 1)) for s in (stress, own)]
    moved, apart = abs(place - plain).max(), abs(place - other).max()
    assert moved > 1e-6
    if over == "cell":
        assert apart < 1e-12 * moved
        assert spread[0] < 1e-9 * spread[1]
    else:
        assert apart > 0.1 * moved


# ---- bars ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("method", ["C0", "F0AL1", "NB", "F0"])
def test_bar_in_equilibrium(tmp_path, method, free):
    """T2, Yang (2016) 3.6.1 with 10 kN/m: means of cells hold, what diffuses loses the stress."""
    bar = Bar(
        tmp_path, 16, load=-10e3, courant=0.1, damping=0.02, modified=True, free=free,
        smoothing=libmpm.methods.Smoothing(method=method), strain="static",
    )  # fmt: skip
    bar.run(5.0)
    worst, rms = bar.errors()
    if method in ("C0", "F0AL1"):
        assert worst < 1e-3
    else:
        assert rms > 0.05


def test_a_placed_load_in_equilibrium_moves_nothing(tmp_path):
    """Three particles a span put q (h/2 - 19 h² / 54 L) on the node at an end, where the means of
    σ over their places ask for q (h/2 - 35 h² / 108 L): q h² / 36 L less, then nothing moves."""
    load, length = -10e3, 1.6
    size = length / 16
    bar = Bar(
        tmp_path, 16, load=load, courant=0.1, free=True,
        smoothing=libmpm.methods.Smoothing(method="C0"),
        strain=lambda x: load * (x * (length - x) - size**2 / 36) / length / YOUNG,
    )  # fmt: skip
    bar.run(0.5)
    assert abs(bar.position() - bar.rest).max() < 1e-13


def minimum(time, value):
    """Where a parabola through the least value and those beside it is least, and how low."""
    k = int(np.argmin(value))
    near = slice(k - 3, k + 4)
    c = np.polyfit(time[near] - time[k], value[near], 2)
    return time[k] - c[1] / (2 * c[0]), c[2] - c[1] ** 2 / (4 * c[0])


def rises(time, value):
    """When a sampled value comes up through zero."""
    up = np.nonzero((value[:-1] < 0) & (value[1:] >= 0))[0]
    return time[up] - value[up] * (time[up + 1] - time[up]) / (value[up + 1] - value[up])


@pytest.mark.parametrize("free", [False, True])
def test_bar_in_vibration(tmp_path, free):
    """T3, Yang (2016) 3.6.2 with 10 N/m, by theory: the end of a held bar swings between 0 and
    -2 q L with 4 L / c, the middle of a free one between 0 and -q L / 2 with 2 L / c."""
    lowest, period = (-8.0, 0.16) if free else (-32.0, 0.32)
    at = slice(93, 99) if free else slice(0, 3)  # of the cells beside the middle, or the first
    found = []
    for smoothing in (None, libmpm.methods.Smoothing(method="C0")):
        bar = Bar(tmp_path, 64, load=-10.0, courant=0.5, smoothing=smoothing, free=free)
        time, stress = [], []
        while bar.engine.time < 2.0:
            bar.engine.run(2, np.inf, 1e9)
            time.append(bar.engine.time)
            stress.append(bar.stress()[at].mean())
        time, stress = np.array(time), np.array(stress)
        first = time < 0.9 * period
        when, least = minimum(time[first], stress[first])
        crossings = rises(time, stress - lowest / 2)
        assert np.polyfit(np.arange(len(crossings)), crossings, 1)[0] == pytest.approx(
            period, rel=0.01
        )
        assert least == pytest.approx(lowest, rel=0.02 if free else 0.04)
        assert when == pytest.approx(period / 2, rel=0.02)
        found.append(stress)
    assert abs(found[0] - found[1]).max() < 0.005 * abs(lowest)


def test_numerical_damping_of_a_wave_is_that_of_its_viscosity(tmp_path):
    """σ = E ε + 2 Δx ξ √(E ρ) ε̇: the first mode decays with Δx ξ c k² (k = π / 2 L)."""
    ratio, size, amplitude = 0.5, 0.05, 1e-6
    k = np.pi / 3.2
    bar = Bar(
        tmp_path, 32, load=0.0, courant=0.1, damping=ratio,
        strain=lambda x: amplitude * k * np.cos(k * x),
    )  # fmt: skip
    kept = []
    for cycle in range(4):
        bar.run(cycle * 0.32 + 1e-9)
        strain = bar.stress() / YOUNG
        kept.append(2 * np.mean(strain * np.cos(k * bar.rest)) / (amplitude * k))
    decay = -np.polyfit(np.arange(4) * 0.32, np.log(kept), 1)[0]
    assert decay == pytest.approx(size * ratio * 20 * k**2, rel=0.03)


@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
def test_a_force_by_place_drives_a_body_as_its_sum_over_particles(transfer):
    """b = 8 (x - 0.5) is linear: whatever the body's inside does, its centre has x'' = b(x)."""
    rate = np.sqrt(8.0)
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(-1.0, 0.0), upper=(2.0, 1.0),
        method=libmpm.Method(transfer=transfer, time_step=1e-3),
    )  # fmt: skip
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6)), material=SOFT["strain"],
        force=FORCE,
    )  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double", threads=1)
    order = np.argsort(sim.particles["b"]["id"])
    start = sim.particles["b"]["position"][order]
    sim.run(until=0.5, progress=False)
    end = sim.particles["b"]["position"][np.argsort(sim.particles["b"]["id"])]
    # x += dt v with the v of the end of the step: half a step ahead in time.
    assert end[:, 0].mean() == pytest.approx(
        0.5 - 0.1 * np.cosh(rate * sim.time), abs=0.1 * rate * 1e-3 * np.sinh(rate * 0.5)
    )
    assert end[:, 1].mean() == pytest.approx(0.4, abs=1e-12)
    columns = np.sort(np.unique(start[:, 0].round(9)))
    moved = [(end - start)[abs(start[:, 0] - x) < 1e-6, 0].mean() for x in columns]
    assert (np.diff(moved) > 0).all()


# ---- what is refused ----------------------------------------------------------------------------


def body_scene(material, method=None, **body):
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0),
        method=method or libmpm.Method(transfer="FLIP"),
    )  # fmt: skip
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6)), material=material, **body
    )
    return scene


@pytest.mark.parametrize(
    ("scene", "named"),
    [
        (lambda: body_scene(WATER, smoothing=libmpm.methods.Smoothing(field="strain")), "'volume'"),
        (
            lambda: body_scene(WATER, smoothing=libmpm.methods.Smoothing(), fbar=libmpm.FBar()),
            "fbar",
        ),
        (lambda: body_scene(WATER, damping=0.1), "shear modulus"),
        (
            lambda: body_scene(
                STEEL, method=libmpm.Method(), assumed=libmpm.methods.AssumedFields()
            ),
            "transfer 'APIC'",
        ),
        (
            lambda: body_scene(
                STEEL, method=libmpm.Method(kernel=libmpm.methods.Kernel(moved_nodes=True))
            ),
            "transfer 'APIC'",
        ),
        (
            lambda: body_scene(
                STEEL,
                force=libmpm.boundaries.PlacedForce(axis="z", place=(0.0, 1.0), value=FORCE.value),
            ),
            "2 axes",
        ),
        (
            lambda: libmpm.boundaries.PlacedForce(axis="x", place=(1.0, 0.0), value=FORCE.value),
            "increasing",
        ),
        (
            lambda: libmpm.boundaries.PlacedForce(axis="x", place=(0.0,), value=FORCE.value),
            "as many",
        ),
        (lambda: libmpm.methods.Kernel(name="cubic", modified=True), "linear functions"),
        (lambda: libmpm.methods.Smoothing(method="C0", gamma=0.5), "'F0'"),
        (lambda: libmpm.methods.Smoothing(method="F0", flux_length="inertia"), "'F1'"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(scene, named):
    with pytest.raises(libmpm.SceneError, match=named):
        scene().plan(device="cpu")


SOLID = {"density": 1000.0, "youngs_modulus": 1e6, "poissons_ratio": 0.2}
PLASTIC = [
    materials.VonMises(**SOLID, yield_stress=1e3),
    materials.DruckerPrager(**SOLID, friction_angle=30.0),
    materials.CamClay(**SOLID, friction_angle=40.0, log_plastic_volume=-0.05),
]


@pytest.mark.parametrize("material", PLASTIC, ids=lambda m: type(m).__name__)
def test_total_strain_is_not_to_be_had_beside_plastic_strain(material):
    name = type(material).__name__
    with pytest.raises(libmpm.SceneError, match=f"strain' for {name}, which stores its elastic"):
        body_scene(material, smoothing=libmpm.methods.Smoothing(method="C0")).plan(device="cpu")
    told = lower(body_scene(material), with_particles=False)
    told["bodies"][0]["smoothing"] = libmpm.methods.Smoothing(method="C0").specification(False)
    with pytest.raises(libmpm.SceneError, match=f"'strain', which {name} does not store"):
        _core.plan(told, "cpu")


@pytest.mark.parametrize("method", ["C0", "C1"])
def test_smoothing_beside_plastic_strain_that_stays_adds_energy(method):
    """With P for C0 or C1 and ε^p untouched (Yang 2016, 3.67) the elastic strain becomes
    P ε^e - (1 - P) ε^p, and Σ m |ε^e|² changes by Σ m |(1 - P) ε^p|² - Σ m |(1 - P) ε^e|²."""
    random = np.random.default_rng(3)
    x = random.random((400, 2))
    mass = 1 + random.random(400)
    elastic = random.standard_normal((400, 3))

    def energy(strain):
        return (mass[:, None] * strain**2).sum()

    def rest(strain):
        return strain - smooth(strain, mass, x, 0.2, method=method).q

    for much in (0.1, 10.0):
        plastic = much * random.standard_normal((400, 3))
        smoothed = smooth(elastic + plastic, mass, x, 0.2, method=method).q - plastic
        change = energy(smoothed) - energy(elastic)
        by_parts = energy(rest(plastic)) - energy(rest(elastic))
        assert change == pytest.approx(by_parts, rel=1e-10)
        assert (change > 0) == (much > 1)


@pytest.mark.parametrize(
    "body",
    [
        {"assumed": libmpm.methods.AssumedFields()},
        {"damping": 0.1},
        {"force": FORCE},
    ],
)
def test_cuda_is_refused_by_name(body):
    scene = body_scene(STEEL, **body)
    with pytest.raises(libmpm.SceneError, match="not built for cuda"):
        _core.plan(lower(scene, with_particles=False), "cuda")


def test_a_scene_without_it_plans_as_before():
    def planned(**smoothing):
        # Smoothing over cells goes with the phased step of a CPU, so the other has it too.
        scene = body_scene(STEEL, **smoothing)
        return _core.plan(lower(scene, with_particles=False, pipeline="phased"), "cpu")

    plain, smoothed = planned(), planned(smoothing=libmpm.methods.Smoothing())
    assert plain["bodies"] == smoothed["bodies"]  # not a byte on a particle
    assert "smooth_cells:b" in smoothed["kernels"]
    assert "smooth_cells:b" not in plain["kernels"]
    assert smoothed["memory_total"] > plain["memory_total"]


@pytest.mark.parametrize(("method", "numbers"), [("C0", 2), ("NB", 2), ("F0", 3), ("F0AL2", 7)])
def test_cells_of_a_device_are_in_the_plan(method, numbers):
    """Of a cell: mass, mean, what exchanges make of it; centre and inertias where asked for."""

    def planned(smoothing, device):
        # On a device it goes with the fused step; a CPU would change its pipeline for it.
        kernel = libmpm.methods.Kernel(gradient="kernel" if device == "cpu" else "mls")
        scene = body_scene(
            WATER, method=libmpm.Method(kernel=kernel), smoothing=smoothing, fbar=None
        )
        return _core.plan(lower(scene, with_particles=False), device)

    for device in ("cpu", "cuda"):
        plain, smoothed = (
            planned(None, device),
            planned(libmpm.methods.Smoothing(method=method), device),
        )
        assert plain["bodies"] == smoothed["bodies"]
        assert plain["pipeline"] == smoothed["pipeline"] == {"cpu": "phased"}.get(device, "fused")
        assert "smooth_cells:b" in smoothed["kernels"]
        blocks = 3 * 3  # of 8 x 8 cells: one that the body fills in part, and those around it
        energies = 8 if device == "cuda" else 0  # of a block
        more = smoothed["memory_total"] - plain["memory_total"]
        assert more == pytest.approx(8 * (64 * numbers + energies) * blocks, rel=1e-12), device


# ---- arrays -------------------------------------------------------------------------------------


def test_arrays_keep_their_shape_and_say_what_was_lost():
    x = (np.arange(30) + 0.5) / 30
    made = smooth(x, 1.0, x, 0.1, method="F0", passes=100)
    assert made.q.shape == (30,)
    assert made.index[[0, 9, 99]] == pytest.approx([-0.061457, -0.403759, -0.993105], abs=1e-5)
    assert (made.energy_change <= 0).all()
    assert made.q.mean() == pytest.approx(x.mean(), abs=1e-14)
    both = smooth(np.stack([x, x**2], axis=1), np.ones(30), x, 0.1, method="C1")
    np.testing.assert_allclose(both.q[:, 0], x, atol=1e-15)
    constant = smooth(np.full(30, 3.0), 1.0, x, 0.1, method="NB", passes=3)
    assert (constant.index == 0).all()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"mass": -1.0}, "mass"),
        ({"mass": np.ones(3)}, "as many"),
        ({"q": [1.0, np.nan]}, "not finite"),
        ({"position": [[0, 0, 0, 0], [1, 1, 1, 1]]}, "one to three"),
        ({"cell_size": 0}, "cell_size"),
        ({"method": "F2"}, "method"),
        ({"passes": 0}, "passes"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(change, named):
    given = {"q": [1.0, 2.0], "mass": 1.0, "position": [0.0, 1.0], "cell_size": 1.0} | change
    q, mass, position, size = (given.pop(k) for k in ("q", "mass", "position", "cell_size"))
    with pytest.raises(libmpm.SceneError, match=named):
        smooth(q, mass, position, size, **given)
