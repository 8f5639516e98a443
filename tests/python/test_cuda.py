"""The CUDA backend against the CPU in double precision, and against itself bit by bit.

Expected duration: 60 s on one GPU.
"""

import numpy as np
import pytest

import libmpm
from support import scenes
from support.tolerances import REFERENCE

pytestmark = pytest.mark.gpu

DX, DENSITY, MODULUS = 0.1, 1000.0, 2e5
SOUND = np.sqrt(MODULUS / DENSITY)
# Per step, in cells and in parts of the sound speed: rounding of float32 and the quantum of the
# sums (2^-25 of the largest nodal value), which at the edge of a body weighs a hundredfold.
SINGLE = {"position": 1e-6, "velocity": 1e-6}
EDGES = [1, 2, 31, 32, 33, 63, 64, 65, 127, 128, 129, 255, 256, 257, 511, 512, 513, 1025]


def box_scene(dimension, material, fbar="default", n=16):
    """One body of that material in a closed box of n cells; its particles are replaced."""
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension, upper=(n * DX,) * dimension,
        gravity=(0.0,) * (dimension - 1) + (-9.81,), method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="body",
        shape=libmpm.shapes.Box(lower=(0.4,) * dimension, upper=(0.8,) * dimension),
        material=material,
        fbar=fbar if material.table.fbar else None,
    )
    scene.add_boundary(
        name="walls", shape=libmpm.shapes.DomainWalls(), response=libmpm.boundaries.Separable()
    )
    return scene


def water():
    return libmpm.materials.TaitFluid(density=DENSITY, bulk_modulus=MODULUS, viscosity=0.1)


def solid():
    return libmpm.materials.FixedCorotated(
        density=DENSITY, youngs_modulus=MODULUS, poissons_ratio=0.3
    )


def specification(scene, position, per_cell, *, precision, pipeline, velocity=None):
    """The scene with these particles, `per_cell` of which have the mass of a full cell."""
    spec = scenes.specification(scene, precision=precision, pipeline=pipeline)
    body = spec["bodies"][0]
    rng = np.random.default_rng(5)
    body["count"] = len(position)
    body["position"] = position
    body["velocity"] = rng.uniform(-1, 1, position.shape) if velocity is None else velocity
    body["particle_mass"] = DENSITY * DX**scene.dimension / per_cell
    return spec


def in_cells(cells, per_cell, dimension, seed=1):
    """Random positions: `per_cell` in each of the given cells, (n, dimension), m."""
    rng = np.random.default_rng(seed)
    base = np.repeat(np.asarray(cells, float), per_cell, axis=0)
    return (base + rng.uniform(0.05, 0.95, (len(base), dimension))) * DX


def rows_of_cells(dimension, count, first=6):
    """`count` cells of a cube around the middle, in rows."""
    edge = 6
    grid = np.stack(np.meshgrid(*[np.arange(edge)] * dimension, indexing="ij"), axis=-1)
    return grid.reshape(-1, dimension)[:count] + first


def compare(spec_of, precision, steps, pipeline="auto", adds=1.0):
    """Run CPU double and CUDA; positions, velocities and states agree.

    `adds`: how many times more roundings a sum suffers than with eight particles a cell, as a root.
    """
    reference = scenes.engine(spec_of("double", "auto"))
    machine = scenes.engine(spec_of(precision, pipeline), "cuda")
    for engine in (reference, machine):
        scenes.advance(engine, steps)
    single = precision != "double"  # mixed: what goes through the grid is single
    assert machine.time == pytest.approx(reference.time, rel=1e-4 if single else 1e-10)
    found, expected = (
        {name: scenes.by_id(e, 0, name) for name in ("position", "velocity", "volume_ratio")}
        for e in (machine, reference)
    )
    assert all(np.isfinite(found[name]).all() for name in found)
    bound = SINGLE if single else {"position": REFERENCE, "velocity": REFERENCE}
    growth = steps * adds if single else 1
    error = {name: np.abs(found[name] - expected[name]).max() for name in found}
    assert error["position"] < growth * bound["position"] * DX, error
    assert error["velocity"] < growth * bound["velocity"] * SOUND, error
    assert error["volume_ratio"] < growth * bound["velocity"], error
    return machine


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", EDGES)
def test_counts_around_the_edges(count, dimension, precision):
    per_cell = 8 if dimension == 3 else 32  # 2D: the same counts in as few cells as hold them
    cells = rows_of_cells(dimension, -(-count // per_cell))
    position = in_cells(cells, per_cell, dimension)[:count]

    def spec_of(precision, pipeline):
        return specification(
            box_scene(dimension, water()),
            position,
            per_cell,
            precision=precision,
            pipeline=pipeline,
        )

    compare(spec_of, precision, 20)


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("material", [water, solid])
@pytest.mark.parametrize("per_cell", [1, 27, 64, 500])
def test_particles_piled_into_one_cell(per_cell, material, precision):
    position = in_cells([(7, 7, 7)], per_cell, 3)

    def spec_of(precision, pipeline):
        return specification(
            box_scene(3, material()), position, per_cell, precision=precision, pipeline=pipeline
        )

    machine = compare(spec_of, precision, 20, adds=max(1.0, np.sqrt(per_cell / 8)))
    assert machine.particle_count(0) == per_cell


MATERIALS = {
    "neo-hookean": libmpm.materials.NeoHookean(density=DENSITY, youngs_modulus=MODULUS),
    "hencky": libmpm.materials.StVenantKirchhoffHencky(density=DENSITY, youngs_modulus=MODULUS),
    "linear": libmpm.materials.LinearElastic(density=DENSITY, youngs_modulus=MODULUS),
    "von-mises": libmpm.materials.VonMises(
        density=DENSITY, youngs_modulus=MODULUS, yield_stress=1e-2 * MODULUS,
        hardening_modulus=0.1 * MODULUS,
    ),
    "drucker-prager": libmpm.materials.DruckerPrager(
        density=DENSITY, youngs_modulus=MODULUS, cohesion=5e-3 * MODULUS, dilatancy_angle=5,
        tension_cutoff=2e-3 * MODULUS,
    ),
    "hypoelastic": libmpm.materials.Hypoelastic(density=DENSITY, youngs_modulus=MODULUS),
}  # fmt: skip


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", MATERIALS)
def test_every_material(name, dimension, precision):
    position = in_cells(rows_of_cells(dimension, 27), 8, dimension)

    def spec_of(precision, pipeline):
        return specification(
            box_scene(dimension, MATERIALS[name]), position, 8,
            precision=precision, pipeline=pipeline,
        )  # fmt: skip

    machine = compare(spec_of, precision, 30)
    if "plastic_strain" in machine.attribute_names(0):
        assert scenes.by_id(machine, 0, "plastic_strain").max() > 1e-3, "it flows"


FORMS = {
    "none": None,
    "one-volume": libmpm.FBar(form="one-volume"),
    "gradient": libmpm.FBar(),
    "two-volume": libmpm.FBar(form="two-volume", length=0.2),
    "stress-only": libmpm.FBar(form="stress-only"),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("pipeline", ["fused", "two-pass"])
def test_forms_and_pipelines_in_single(form, dimension, pipeline):
    position = in_cells(rows_of_cells(dimension, 36), 8, dimension)

    def spec_of(precision, pipeline):
        return specification(
            box_scene(dimension, water(), FORMS[form]), position, 8,
            precision=precision, pipeline=pipeline,
        )  # fmt: skip

    compare(spec_of, "single", 30, pipeline)


def flying(precision, pipeline, dimension=3):
    """A body that crosses many cells, so that particles stray and are sorted."""
    position = in_cells(rows_of_cells(dimension, 36, first=2), 8, dimension)
    speed = np.array((2.0, 1.5, 1.0)[:dimension])
    return specification(
        box_scene(dimension, water()), position, 8, precision=precision, pipeline=pipeline,
        velocity=speed + np.random.default_rng(3).uniform(-0.1, 0.1, position.shape),
    )  # fmt: skip


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_strays_and_sorts(dimension, precision):
    machine = compare(lambda p, pipe: flying(p, pipe, dimension), precision, 120)
    assert machine.statistics()["sorts"] >= 2


@pytest.mark.parametrize(
    ("dimension", "form"), [(2, "gradient"), (3, "gradient"), (3, "none"), (3, "two-volume")]
)
def test_particles_of_nearly_empty_blocks(dimension, form):
    """Thousands of blocks with three particles each go one by one, beside a block that is full."""
    edge, side = (8, 80) if dimension == 2 else (4, 19)
    rng = np.random.default_rng(8)
    corners = np.stack(np.meshgrid(*[np.arange(side)] * dimension, indexing="ij"), axis=-1)
    cells = edge * (corners.reshape(-1, dimension) + 1)
    cells += rng.integers(0, edge, cells.shape)
    full = edge * (side // 2) + np.zeros((1, dimension), dtype=int)
    position = np.concatenate([in_cells(cells, 3, dimension), in_cells(full, 40, dimension)])
    speed = np.array((2.0, 1.5, 1.0)[:dimension])
    velocity = speed + rng.uniform(-0.1, 0.1, position.shape)

    def spec_of(precision, pipeline):
        return specification(
            box_scene(dimension, water(), FORMS[form], n=(side + 3) * edge), position, 8,
            precision=precision, pipeline=pipeline, velocity=velocity,
        )  # fmt: skip

    machine = compare(spec_of, "single", 120, adds=np.sqrt(5.0))
    assert machine.statistics()["sorts"] >= 1
    assert machine.statistics()["lone"] > len(position) // 2


@pytest.mark.parametrize("dimension", [2, 3])
def test_fused_and_two_pass_agree(dimension):
    results = []
    for pipeline in ("fused", "two-pass"):
        machine = scenes.engine(flying("single", pipeline, dimension), "cuda")
        scenes.advance(machine, 60)
        results.append({n: scenes.by_id(machine, 0, n) for n in ("position", "velocity")})
    one, two = results
    assert np.abs(one["position"] - two["position"]).max() < 60 * SINGLE["position"] * DX
    assert np.abs(one["velocity"] - two["velocity"]).max() < 60 * SINGLE["velocity"] * SOUND


def same_bits(one, two):
    assert one.keys() == two.keys()
    # The clock is compared by what it says: its padding bytes are nobody's.
    return all(np.array_equal(one[k], two[k]) for k in one if not k.startswith("clock"))


@pytest.mark.parametrize(
    ("precision", "pipeline"),
    [("single", "fused"), ("single", "two-pass"), ("mixed", "two-pass"), ("double", "two-pass")],
)
def test_two_runs_give_the_same_bits(precision, pipeline):
    states = []
    for split in ((250,), (1, 99, 150)):
        machine = scenes.engine(flying(precision, pipeline), "cuda")
        for steps in split:
            scenes.advance(machine, steps)
            machine.attribute(0, "pressure")  # looking changes nothing
        assert machine.statistics()["sorts"] > 0
        states.append((machine.save(), machine.time))
    assert states[0][1] == states[1][1]
    assert same_bits(states[0][0], states[1][0])


def test_many_runs_of_a_crowded_block_give_the_same_bits():
    """Strays, surplus and a full list of strays, all in one block."""
    position = np.concatenate([
        in_cells([(5, 5, 5)], 700, 3), in_cells([(6, 5, 5)], 300, 3, seed=2),
    ])  # fmt: skip
    first = None
    for _ in range(5):
        spec = specification(
            box_scene(3, water()), position, 200, precision="single", pipeline="fused",
            velocity=np.array((1.5, 1.0, 0.5)),
        )  # fmt: skip
        machine = scenes.engine(spec, "cuda")
        scenes.advance(machine, 60)
        state = machine.save()
        assert first is None or same_bits(first, state)
        first = state


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_a_saved_state_goes_on_bit_for_bit(precision):
    spec = flying(precision, "auto")
    machine = scenes.engine(spec, "cuda")
    scenes.advance(machine, 70)
    other = scenes.engine(flying(precision, "auto"), "cuda")
    other.load(machine.save())
    for engine in (machine, other):
        scenes.advance(engine, 50)
    assert same_bits(machine.save(), other.save())


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_sensors_and_two_materials(precision):
    scene = scenes.crowded(3)
    scene.add_sensor(name="energy", sensor=libmpm.sensors.Energy())
    scene.add_sensor(name="gauge", sensor=libmpm.sensors.WaveGauge(position=(0.15, 0.15)))
    scene.add_sensor(name="probe", sensor=libmpm.sensors.VelocityProbe(position=(0.2, 0.2, 0.2)))
    scene.add_sensor(name="track", sensor=libmpm.sensors.ParticleTracker(body="water", ids=(0, 7)))
    series = []
    for device, kind in (("cpu", "double"), ("cuda", precision)):
        sim = libmpm.Simulation(scene, device=device, precision=kind)
        sim.step(50)
        series.append({n: np.asarray(sim.sensors[n].values) for n in
                       ("walls", "step", "energy", "gauge", "probe", "track")})  # fmt: skip
    for name in series[0]:
        expected, found = series[0][name], series[1][name]
        assert found.shape == expected.shape, name
        assert np.array_equal(np.isnan(found), np.isnan(expected)), name
        # Loads are differences of momenta: one step of one node's rounding is a part of the peak.
        bound = (2e-3 if precision != "double" else 1e-7) * np.nanmax(np.abs(expected))
        assert np.nanmax(np.abs(found - expected)) < bound, name


@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_momentum_is_kept_to_the_quantum(precision):
    """Free flight without walls: each node loses at most half a quantum a step."""
    scene = scenes.free_body(3, velocity=(1.0, -0.5, 0.25))
    sim = libmpm.Simulation(scene, device="cuda", precision=precision)
    before = np.array((1.0, -0.5, 0.25))
    steps = 100
    sim.step(steps)
    velocity = sim.particles["solid"]["velocity"].mean(axis=0)
    nodes = len(sim.grid["mass"])
    quantum = 2.0**-24 if precision != "double" else 1e-15
    assert np.abs(velocity - before).max() < quantum * np.sqrt(nodes) * steps


def test_mixed_precision_moves_particles_by_less_than_single_resolves():
    """A body drifts by 1e-9 cells a step: nothing in single, all of it with double particles."""
    speed, step = 1e-3, 1e-6 * DX
    quarters = np.stack(np.meshgrid(*[[7.25, 7.75]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    moved = {}
    for precision in ("single", "mixed", "double"):
        spec = specification(
            box_scene(3, water(), None), quarters * DX, 8, precision=precision, pipeline="auto",
            velocity=np.array((speed, 0.0, 0.0)),
        )  # fmt: skip
        spec["time_step"] = step
        spec["gravity"]["value"] = np.zeros((1, 3))
        machine = scenes.engine(spec, "cuda")
        start = scenes.by_id(machine, 0, "position")
        scenes.advance(machine, 1000)
        moved[precision] = (scenes.by_id(machine, 0, "position") - start)[:, 0] / (
            speed * step * 1000
        )
    assert np.abs(moved["single"]).max() == 0
    assert np.abs(moved["mixed"] - 1).max() < 1e-5
    assert np.abs(moved["double"] - 1).max() < 1e-5


def test_a_fault_names_the_particle():
    """One particle is given a volume outside the law's range."""
    position = in_cells([(7, 7, 7), (8, 7, 7)], 8, 3)
    codes = []
    for device in ("cpu", "cuda"):
        spec = specification(
            box_scene(3, water(), None), position, 8, precision="single", pipeline="auto",
            velocity=np.zeros(3),
        )  # fmt: skip
        pressure = np.zeros(len(position))
        pressure[5] = 1e15
        spec["bodies"][0]["pressure"] = pressure
        report = scenes.engine(spec, device).run(50, np.inf, 60.0)
        assert report["reason"] == "fault", report
        codes.append((report["fault"]["code"], device))
    assert {code for code, _ in codes} <= {"compressed", "outran-cell", "non-finite", "fixed-point"}


def test_devices_are_listed():
    from libmpm import _cuda

    for device in _cuda.devices():
        assert device["memory"] >= device["free"] > 0
        assert device["name"] and "." in device["compute_capability"]
    with pytest.raises(libmpm.DeviceError, match="there is no CUDA device 99"):
        spec = flying("single", "auto")
        spec["device"] = 99
        _cuda.Engine(spec)
