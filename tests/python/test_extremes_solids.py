"""Solids and sizes at their extremes: both ends of each envelope hold, what lies outside is named.

The whole sweep is `benchmarks/extremes.py`.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, shapes
from support import scenes
from support.extremes import FOLDER, ends, expect_holds, expect_outcome

AXES = ()

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="needs the source tree")
if FOLDER.exists():
    import extremes_motion
    import extremes_solids
    import extremes_widths

    AXES = extremes_solids.AXES + extremes_motion.AXES + extremes_widths.AXES

ELASTIC = {"density": 1000.0, "youngs_modulus": 1e6, "poissons_ratio": 0.3}


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize(("one", "value"), ends(AXES))
def test_envelope_holds(one, value):
    expect_holds(one, value)


#: Axis, value outside its envelope, outcome, and what the program says.
OUTSIDE = [
    ("impact of a solid", 1e5, "named", "crushed, inverted or torn.*Remedy"),
    ("wall into a solid", 3.0, "refused", "boundary 'piston': moves at up to .* cells in a step"),
    ("wall into a solid", 1e5, "refused", "boundary 'piston': moves at up to .* cells in a step"),
    ("spin", 30.0, "named", "left the domain"),
    ("volume ratio of NeoHookean", 0.005, "named", "volume ratio left the range 0.05 to 20"),
    ("volume ratio of Hypoelastic", 100.0, "named", "volume ratio left the range 0.05 to 20"),
    ("volume ratio of CamClay", 0.005, "named", "elastic volume ratio left the range"),
    ("volume ratio of LinearElastic", 0.005, "named", "volume ratio left the range"),
    ("cells along an axis", 2.0**31, "refused", "2147483648 cells on axis 0; expected ≤"),
    ("cells of a cube", 1e7, "refused", "blocks of 4 cells an edge, which 64 bits can number"),
    ("particles of a body", 2.0**32, "refused", "expected ≤ 4294967039 in one body; split it"),
    ("particles of a body", 1e18, "refused", "expected ≤ 4294967039 in one body; split it"),
    ("density", 1e-25, "refused", "particle mass .*single precision holds.*precision='double'"),
    ("density", 1e36, "refused", "particle mass .*single precision holds.*precision='double'"),
    ("Young's modulus", 1e-40, "refused", "youngs_modulus is 1e-40 Pa; single precision holds"),
    ("Young's modulus", 1e39, "refused", "youngs_modulus is 1e\\+39 Pa; single precision holds"),
]


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize(("name", "value", "outcome", "says"), OUTSIDE)
def test_outside_is_named(name, value, outcome, says):
    expect_outcome(AXES, name, value, outcome, says)


def box(dimension=2, cells=10, dx=0.1, *, velocity=None, **options):
    """A free solid of 4 cells in an empty domain."""
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx,
        **{"lower": (0.0,) * dimension, "upper": (cells * dx,) * dimension, **options},
    )  # fmt: skip
    low = [a + 3 * dx for a in scene.lower]
    scene.add_body(
        name="body", shape=shapes.Box(lower=low, upper=[a + 4 * dx for a in low]),
        material=materials.NeoHookean(**ELASTIC), velocity=velocity,
    )  # fmt: skip
    return scene


def test_at_rest_without_gravity_nothing_changes():
    """No bit, in a thousand steps of every law."""
    for name in extremes_solids.SOLIDS:
        scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0))
        scene.add_body(
            name="body", shape=shapes.Box(lower=(0.31, 0.33), upper=(0.61, 0.63)),
            material=extremes_solids.solid(name),
        )  # fmt: skip
        simulation = libmpm.Simulation(scene, device="cpu", threads=1)
        before = simulation.particles["body"]["position"].copy()
        simulation.step(1000)
        np.testing.assert_array_equal(simulation.particles["body"]["position"], before)


def test_particles_beyond_2_to_the_31_in_all():
    """Ids of a scene with 2^33 particles before this body: none but the number differs."""
    spec = scenes.specification(box(velocity=(0.3, 0.2)), precision="single")
    near, far = spec | {"device": 0}, spec | {"device": 0}
    first = 2**33 - 7
    far["bodies"] = [spec["bodies"][0] | {"first_id": first}]
    machines = [scenes.engine(each) for each in (near, far)]
    for machine in machines:
        scenes.advance(machine, 100)
    low, high = (machine.attribute(0, "id") for machine in machines)
    np.testing.assert_array_equal(high - np.uint64(first), low)
    np.testing.assert_array_equal(*(machine.attribute(0, "position") for machine in machines))


def test_2_to_the_31_particles_are_planned_and_not_allocated(monkeypatch):
    """The plan is made in no memory; a run is refused with the plan's numbers."""
    side = 2.0**15.5 / 2
    scene = libmpm.Scene(dimension=2, cell_size=1.0, lower=(0.0, 0.0), upper=(23200.0, 23200.0))
    scene.add_body(
        name="body", shape=shapes.Box(lower=(8.0, 8.0), upper=(8.0 + side, 8.0 + side)),
        material=materials.NeoHookean(**ELASTIC),
    )  # fmt: skip
    plan = scene.plan(device="cpu")
    assert plan.particles == pytest.approx(2**31, rel=1e-4)
    assert plan.memory_total > 2**31 * 4 * (2 + 4 + 1)
    monkeypatch.setattr("libmpm._src.run.backends.memory_free", lambda backend: 2**30)
    with pytest.raises(libmpm.CapacityError, match=r"1,024 MiB free\. The plan asks for .* MiB"):
        libmpm.Simulation(scene, device="cpu", threads=1).step()


def test_narrow_domains_between_walls_are_doubted(recwarn):
    """Slip walls hold every node of one or two cells; a slice across gravity is no doubt."""
    for cells, wall, doubt in (
        (1, boundaries.Slip(), True),
        (2, boundaries.Separable(), True),
        (2, boundaries.Mirror(), False),
        (3, boundaries.Slip(), False),
    ):
        for axis in (0, 1):
            size = [0.4, 0.4]
            size[axis] = cells * 0.1
            scene = libmpm.Scene(
                dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=size, gravity=(0.0, -9.81)
            )
            scene.add_body(
                name="body", shape=shapes.Box(lower=(0.0, 0.0), upper=size),
                material=materials.NeoHookean(**ELASTIC),
            )  # fmt: skip
            scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=wall)
            recwarn.clear()
            scene.validate()
            said = [w for w in recwarn if "nothing will move there" in str(w.message)]
            assert bool(said) == (doubt and axis == 1)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"origin": (1e15, 0.0)}, "world positions of 1e\\+15 m on axis 0 .* origin nearer"),
        ({"origin": (0.0, 1e90)}, "world positions of 1e\\+90 m on axis 1"),
        ({"lower": (1e12, 0.0), "upper": (1e12 + 1.0, 1.0)}, "coordinates of 1e\\+12 m on axis 0"),
    ],
)
def test_coordinates_that_do_not_resolve_a_cell_are_refused(options, says):
    with pytest.raises(libmpm.SceneError, match=says):
        box(**options).validate()


@pytest.mark.parametrize(
    "motion",
    [
        {"motion": boundaries.Travel((400.0, 0.0))},
        {"motion": boundaries.Travel(libmpm.TimeTable((0.0, 1.0), ((0.0, 0.0), (0.0, -1e90))))},
        {"motion": boundaries.Displacement(
            libmpm.TimeTable((0.0, 1e-5), ((0.0, 0.0), (0.3, 0.0)), end="hold"))},
        {"rotation": boundaries.Rotation(about=(0.1, 0.1), rate=1e4)},
        {"rotation": boundaries.Rotation(
            about=(0.1, 0.1), angle=libmpm.TimeTable((0.0, 1e-6), (0.0, 1.0), end="hold"))},
    ],
)  # fmt: skip
def test_shapes_that_would_pass_a_cell_in_a_step_are_refused(motion):
    scene = box()
    wall = shapes.Box(lower=(0.0, 0.0), upper=(0.2, 0.2))
    scene.add_boundary(name="wall", shape=wall, response=boundaries.Slip(), **motion)
    with pytest.raises(libmpm.SceneError, match=r"boundary .wall.: moves at up to .* slow it down"):
        scene.plan(device="cpu")
    with pytest.raises(libmpm.SceneError, match="boundary 'wall': moves at up to"):
        libmpm.Simulation(scene, device="cpu", threads=1).step()


def test_numbers_beyond_single_precision_run_in_double():
    """A particle of 1e-33 kg, whose nodes single precision would lose in silence."""
    scene = box(velocity=(1.0, 0.0))
    tiny = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(1.0, 1.0))
    tiny.add_body(
        name="body", shape=scene.bodies[0].shape, velocity=(1.0, 0.0),
        material=materials.NeoHookean(density=1e-30, youngs_modulus=1e-27),
    )  # fmt: skip
    with pytest.raises(libmpm.SceneError, match=r"particle mass is 2\.5e-33 kg; single precision"):
        libmpm.Simulation(tiny, device="cpu", precision="single")
    simulation = libmpm.Simulation(tiny, device="cpu", precision="double", threads=1)
    simulation.step(20)
    np.testing.assert_allclose(simulation.particles["body"]["velocity"][:, 0], 1.0, atol=1e-12)
    with pytest.raises(libmpm.SceneError, match=r"velocity has 1e\+31 m/s; single precision"):
        libmpm.Simulation(box(velocity=(1e31, 0.0)), device="cpu", precision="single")


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_particles_whose_place_rounds_up_to_a_cell_face_stay(dimension, precision):
    """A place 1e-15 below a face is half a cell off its centre in float32: in its cell, not past.

    One that is set into the cell below by the rounding would be a whole cell away.
    """
    spec = scenes.specification(box(dimension), precision=precision)
    body = spec["bodies"][0]
    below = np.array([0.4, 0.5, 0.6]) * (1 - 2.0**-52)
    axes = np.meshgrid(*[below] * dimension, indexing="ij")
    wanted = np.stack([a.ravel() for a in axes], axis=1)
    body["position"], body["count"] = wanted, len(wanted)
    machine = scenes.engine(spec)
    np.testing.assert_allclose(scenes.by_id(machine, 0, "position"), wanted, atol=1e-8)
    scenes.advance(machine, 20)
    np.testing.assert_allclose(scenes.by_id(machine, 0, "position"), wanted, atol=1e-8)
