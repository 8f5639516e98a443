"""Smoothing over cells on a CUDA device: against arrays, against the CPU, against itself.

Expected duration: 60 s on one GPU.
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from libmpm._src.run.engine_spec import lower
from libmpm.methods import METHODS, smooth
from support import scenes
from support.drifting import DX, by_id, drifting, state_of, undecided

pytestmark = pytest.mark.gpu

WATER = materials.TaitFluid(density=1000, bulk_modulus=2e5, viscosity=0.1)
STEEL = materials.LinearElastic(density=1000, youngs_modulus=2e5, poissons_ratio=0.2)
#: What a step strains a body that flies unstrained, as a share of a cell: 0.1 cells a step of
#: velocities that rounding makes unequal, 6e-8 on the mean, and more the lighter the nodes at the
#: edge of a body are: some of 5,400 numbers by 4e-5. Of double precision the sums of 62 bits.
STRAYS = {"single": 1e-4, "mixed": 1e-4, "double": 1e-10}


#: Of the values of particles, so that the means of a cell's eight stray by 2⁻³³ and more.
TIE = 2e-9

CASES = [
    (2, "quadratic", "volume"), (2, "linear", "strain"), (3, "linear", "volume"),
    (3, "quadratic", "strain"),
]  # fmt: skip


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("dimension", "kernel", "field"), CASES)
def test_a_step_smooths_as_arrays_do(tmp_path, method, dimension, kernel, field, precision):
    if method == "NB" and kernel != "linear":
        pytest.skip("at nodes of the scene's functions, not at corners of cells")
    engine, state = drifting(
        tmp_path, dimension, kernel, libmpm.methods.Smoothing(method=method), field, device="cuda",
        precision=precision, size=0.1,
    )  # fmt: skip
    shift = 0 if kernel == "quadratic" else 0.5 * DX
    changes = []
    for _ in range(7):  # 0.7 cells: some stand beside the cell that they were sorted into
        state = state_of(engine)
        before = by_id(engine, "position")
        made = smooth(state, 1, before - shift, DX, method=method)
        # Means are sums in steps of 2⁻³³: of means as near as that either may be the larger.
        ties = [undecided(state, before - shift, method, made.q, rounding=r) for r in (1e-11, TIE)]
        clear = ~np.logical_or(*ties)
        assert clear.mean() > 0.8, clear.mean()
        engine.run(1, np.inf, 1e9)
        after = state_of(engine)
        stray = abs(after - made.q)[clear]
        assert stray.max() < STRAYS[precision]
        assert np.sqrt(np.mean(stray**2)) < 0.02 * STRAYS[precision]
        changes.append(((after**2).sum() - (state**2).sum(), (state**2).sum()))
    rows = engine.smoothing(0)
    assert rows.shape == (7, 5)
    mass = 1000 * 1e-4
    change, energy = mass * np.array(changes).T
    np.testing.assert_allclose(rows[:, 2], energy, rtol=1e-6)
    np.testing.assert_allclose(rows[:, 3], change, rtol=0, atol=20 * STRAYS[precision] * energy[0])
    assert (rows[:, 3] <= 1e-6 * rows[:, 2]).all()


def tank(smoothing, dimension=3, transfer="APIC"):
    """Water that falls over in a closed tank."""
    cells = (32, 12, 20) if dimension == 3 else (48, 24)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=[n * DX for n in cells], gravity=(0.0,) * (dimension - 1) + (-9.81,),
        method=libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    full = (0.5 * cells[0] * DX, *[n * DX for n in cells[1:-1]], 0.7 * cells[-1] * DX)
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.0,) * dimension, upper=full), material=WATER,
        fbar=None, smoothing=smoothing,
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    return scene


def bar(smoothing, dimension=3, transfer="FLIP"):
    """An elastic bar that hits a wall."""
    upper = (2.0, 1.0, 1.0)[:dimension]
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension, upper=upper,
        gravity=(0.0,) * dimension, method=libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.2, *(0.3,) * (dimension - 1)),
                                   upper=(1.4, *(0.7,) * (dimension - 1))),
        material=STEEL, smoothing=smoothing, velocity=(-0.5, *(0.0,) * (dimension - 1)),
    )  # fmt: skip
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable())
    return scene


def states(scene, device, precision, steps, pipeline="auto"):
    told = lower(scene, precision=precision, pipeline=pipeline)
    engine = scenes.engine(told, device)
    scenes.advance(engine, steps)
    return {name: by_id(engine, name) for name in ("position", "velocity", "pressure")}


#: Of a step, in cells and in parts of what sound carries, on the mean: rounding of single
#: precision, and of sums of the grid, which have 2 to 3 bits fewer. At the edge it weighs more
#: (test_cuda.py).
OF_A_STEP = 2e-7
STEPS = 60
UNIT = {"position": DX, "velocity": np.sqrt(2e5 / 1000), "pressure": 2e5}


def apart(found, expected):
    """Root of mean squares of the differences, in those units."""
    return {
        name: np.sqrt(np.mean((found[name] - expected[name]) ** 2)) / UNIT[name]
        for name in expected
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scene", [tank, bar])
def test_runs_are_those_of_the_cpu(scene, method):
    """In double precision, but for means of 2⁻³³ and what limiters do at a tie."""
    made = scene(libmpm.methods.Smoothing(method=method))
    expected = states(made, "cpu", "double", STEPS)
    moved = np.abs(expected["pressure"]).max() / UNIT["pressure"]
    assert moved > 100 * STEPS * OF_A_STEP, "there is something to be equal"
    for precision in ("single", "mixed", "double"):
        error = apart(states(made, "cuda", precision, STEPS), expected)
        assert max(error.values()) < STEPS * OF_A_STEP, (precision, error)


@pytest.mark.parametrize("method", ["C0", "NB", "F0AL1"])
@pytest.mark.parametrize("transfer", ["APIC", "ASFLIP"])
def test_pipelines_agree(method, transfer):
    if transfer == "ASFLIP":
        transfer = libmpm.methods.Transfer(scheme="ASFLIP", flip=0.99, shift_max=0.1)
    made = tank(libmpm.methods.Smoothing(method=method), transfer=transfer)
    pipelines = ["fused", "phased", *(["two-pass"] if transfer == "APIC" else [])]
    expected, *others = (states(made, "cuda", "single", STEPS, p) for p in pipelines)
    for found in others:
        error = apart(found, expected)
        assert max(error.values()) < STEPS * OF_A_STEP, error


def same_bits(one, two):
    assert one.keys() == two.keys()
    # The clock is compared by what it says: its padding bytes are nobody's.
    return all(np.array_equal(one[k], two[k]) for k in one if not k.startswith("clock"))


RUNS = [(tank, "fused"), (tank, "two-pass"), (tank, "phased"), (bar, "phased")]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("scene", "pipeline"), RUNS)
def test_bits_do_not_depend_on_the_run(scene, pipeline, method):
    """Twice, in portions, and looked at."""
    found = []
    for portions in ((150,), (150,), (1, 63, 64, 22)):
        told = lower(
            scene(libmpm.methods.Smoothing(method=method)), precision="single", pipeline=pipeline
        )
        engine = scenes.engine(told, "cuda")
        for steps in portions:
            scenes.advance(engine, steps)
            engine.attribute(0, "pressure")
        assert engine.statistics()["sorts"] > 0
        found.append((engine.save(), engine.smoothing(0)))
    assert found[0][1][:, 1].sum() == 150
    for state, rows in found[1:]:
        assert same_bits(found[0][0], state)
        np.testing.assert_array_equal(rows, found[0][1])


def test_long_runs_lose_energy_alone():
    sim = libmpm.Simulation(tank(libmpm.methods.Smoothing()), device="cuda", precision="single")
    sim.step(2000)
    rows = sim.smoothing["b"]
    assert rows["energy_change"].sum() < 0
    assert (rows["energy_change"] <= 1e-5 * rows["energy"]).all()


@pytest.mark.parametrize(
    ("body", "named"),
    [
        ({"assumed": libmpm.methods.AssumedFields()}, "assumed fields"),
        ({"damping": 0.1}, "damping"),
        (
            {
                "force": libmpm.boundaries.PlacedForce(
                    axis="x", place=(0.0, 1.0), value=((1.0,) * 2,) * 2
                )
            },
            "placed forces",
        ),
    ],
)
def test_what_is_not_built_is_refused_by_name(body, named):
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=(1.0, 1.0),
        method=libmpm.Method(transfer="FLIP"),
    )  # fmt: skip
    shape = shapes.Box(lower=(0.2, 0.2), upper=(0.6, 0.6))
    scene.add_body(name="b", shape=shape, material=STEEL, **body)
    with pytest.raises(libmpm.SceneError, match=named):
        libmpm.Simulation(scene, device="cuda").step(1)
