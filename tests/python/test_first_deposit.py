"""What a body's first deposit says of its motion: a spin starts at its rate.

Expected duration: 20 s.
"""

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import Method, contacts, materials, shapes
from libmpm.methods import Transfer

DX = 0.1
RATE = 2.0
AFFINE = {
    "APIC": "APIC",
    "AFLIP": Transfer(scheme="AFLIP", flip=0.95),
    "ASFLIP": Transfer(scheme="ASFLIP", flip=0.95, shift_max=0.02),
}


def centre(dimension):
    return np.full(dimension, 1.2)


def spin(dimension):
    """A turn about z through the middle, a turn about x added in space."""
    if dimension == 2:
        return libmpm.Field(components=(f"-{RATE} * (y - 1.2)", f"{RATE} * (x - 1.2)"))
    return libmpm.Field(
        components=(
            f"-{RATE} * (y - 1.2)",
            f"{RATE} * (x - 1.2) - 0.5 * (z - 1.2)",
            "0.5 * (y - 1.2)",
        )
    )


def disc(dimension=2, *, radius=8, material=None, velocity=None, fbar=None, **method):
    """A disc or ball of so many cells, free in the middle of 24 cells, radius of 8 at 0.1 m."""
    n, dx = (24, DX) if radius == 8 else (18, 2.4 / 18)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=dx, lower=(0.0,) * dimension,
        upper=(n * dx,) * dimension, gravity=(0.0,) * dimension, method=Method(**method),
    )  # fmt: skip
    scene.add_body(
        name="disc",
        shape=shapes.Sphere(centre=tuple(centre(dimension)), radius=radius * dx),
        material=material
        or materials.NeoHookean(density=1000.0, youngs_modulus=1e7, poissons_ratio=0.2),
        velocity=spin(dimension) if velocity is None else velocity,
        fbar=fbar,
    )
    return scene


def simulate(scene, precision="double", device="cpu", **options):
    return libmpm.Simulation(scene, device=device, precision=precision, **options)


def rate(sim, body="disc"):
    """Rate of turn about z, of the particles' velocities in least squares."""
    view = sim.particles[body].read(["position", "velocity"])
    r, v = view["position"] - view["position"].mean(axis=0), view["velocity"]
    return np.sum(r[:, 0] * v[:, 1] - r[:, 1] * v[:, 0]) / np.sum(r[:, 0] ** 2 + r[:, 1] ** 2)


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("pipeline", ["fused", "two-pass", "phased"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_spin_starts_at_its_rate(dimension, pipeline, precision):
    """Linear fields are what affine transfers reproduce, on the surface too."""
    scene = disc(dimension, radius=8 if dimension == 2 else 5)
    sim = simulate(scene, precision, pipeline=pipeline)
    view = sim.particles["disc"].read(["position", "velocity", "velocity_gradient"])
    want = spin(dimension).at(view["position"])
    close = 1e-12 if precision == "double" else 2e-6
    assert np.abs(view["velocity"] - want).max() < close * RATE
    slope = np.zeros((dimension, dimension))
    slope[0, 1], slope[1, 0] = -RATE, RATE
    if dimension == 3:
        slope[1, 2], slope[2, 1] = -0.5, 0.5
    np.testing.assert_allclose(
        view["velocity_gradient"], np.broadcast_to(slope, view["velocity_gradient"].shape),
        atol=50 * close,
    )  # fmt: skip
    assert rate(sim) == pytest.approx(RATE, rel=10 * close)


@pytest.mark.parametrize("kernel", ["quadratic", "cubic", "ugimp", "cpgimp", "cpdi"])
@pytest.mark.parametrize("transfer", AFFINE)
@pytest.mark.parametrize("dimension", [2, 3])
def test_every_affine_transfer_and_kernel(transfer, kernel, dimension):
    """Nodes get the field itself: what the grid says of its velocity is linear everywhere."""
    scene = disc(dimension, radius=5, transfer=AFFINE[transfer], kernel=kernel)
    sim = simulate(scene)
    nodes, velocity, mass = (sim.grid[n] for n in ("position", "velocity", "mass"))
    heavy = mass > 1e-9 * mass.max()
    np.testing.assert_allclose(velocity[heavy], spin(dimension).at(nodes)[heavy], atol=1e-8 * RATE)


def other_bodies(transfer, contact):
    """A bar of elements that spins, and beside it a disc that does, apart by more than their reach.

    With a contact each has nodes of its own.
    """
    scene = disc(radius=8, transfer=transfer)
    told = scene.to_dict() | {"upper": [4.8, 2.4]}
    scene = libmpm.Scene.from_dict(told)
    turns = libmpm.Field(components=(f"-{RATE} * (y - 1.2)", f"{RATE} * (x - 3.6)"))
    mesh = shapes.Triangles.box(lower=(2.9, 0.9), upper=(4.3, 1.5), edge=DX)
    law = materials.NeoHookean(density=1000.0, youngs_modulus=1e7, poissons_ratio=0.2)
    bar = mesh if contact is None else shapes.Box(lower=(2.9, 0.9), upper=(4.3, 1.5))
    scene.add_body(name="bar", shape=bar, material=law, velocity=turns)
    if contact is not None:
        scene.add_contact(name="touch", between=("disc", "bar"), law=contact)
    return scene


@pytest.mark.parametrize(
    "contact",
    [None, contacts.Friction(static=0.3, dynamic=0.3), contacts.Stick()],
    ids=["elements", "friction", "stick"],
)
@pytest.mark.parametrize("transfer", AFFINE)
def test_bodies_of_elements_and_fields_of_contact_start_at_their_rate(transfer, contact):
    """Their deposits are other functions of the engine; PIC, which has no slope, keeps 0.97."""
    sim = simulate(other_bodies(AFFINE[transfer], contact))
    sim.step(1)
    for name in ("disc", "bar"):
        assert rate(sim, name) == pytest.approx(RATE, rel=1e-4), name


def test_a_spin_stays():
    """Over a tenth of a turn APIC holds the moment of momentum that it was given."""
    sim = simulate(disc())
    sim.run(until=0.3)
    assert rate(sim) == pytest.approx(RATE, rel=3e-3)


@pytest.mark.parametrize("form", [None, "one-volume", "one-volume-gradient", "two-volume"])
def test_fluids_and_their_smoothing(form):
    """Averages of volumes are what they are without a turn: nothing is strained yet."""
    scene = disc(material=materials.TaitFluid(bulk_modulus=1e7), fbar=form and libmpm.FBar(
        form=form, **({"length": 0.1} if form == "two-volume" else {})
    ))  # fmt: skip
    sim = simulate(scene)
    assert rate(sim) == pytest.approx(RATE, rel=1e-9)
    sim.run(until=0.05)
    assert rate(sim) == pytest.approx(RATE, rel=2e-3)
    assert np.abs(sim.particles["disc"]["volume_ratio"] - 1).max() < 0.05


def test_a_field_without_a_slope_costs_nothing():
    """A uniform field is a velocity: the bits of one, and no gradient is told."""
    from libmpm._src.run.engine_spec import lower

    uniform = disc(velocity=libmpm.Field(components=("0.3", "0.1")))
    told = lower(uniform, precision="double")["bodies"][0]
    assert "velocity_gradient" not in told
    turning = lower(disc(), precision="double")["bodies"][0]["velocity_gradient"]
    assert np.shape(turning) == (2, 2)
    assert "velocity_gradient" not in lower(disc(transfer="FLIP"), precision="double")["bodies"][0]


def test_slopes_of_fields():
    rng = np.random.default_rng(3)
    points = rng.uniform(0.2, 0.8, size=(200, 2))
    linear = libmpm.Field(components=("3 * x - 2 * y + 1", "0.5 * y"))
    np.testing.assert_allclose(
        linear.gradient(points, 0.1), np.broadcast_to([[3, -2], [0, 0.5]], (200, 2, 2)), atol=1e-11
    )
    # Second order for a smooth field away from where it turns.
    wave = libmpm.Field(components=("exp(x)",))
    errors = [
        np.abs(wave.gradient(points, h)[:, 0, 0] - np.exp(points[:, 0])).max() for h in (0.1, 0.05)
    ]
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    # A jump is no slope, and neither is a step within a cell; nor what is not finite beside it.
    for formula in ("where(x < 0.5, 1, 0)", "sqrt(0.8 - x) * 0 + where(x > 0.5, 2, -1)"):
        jump = libmpm.Field(components=(formula,))
        assert not jump.gradient(points, 0.1).any()
    steep = libmpm.Field(components=("tanh((x - 0.5) / 1e-4)",))
    assert np.abs(steep.gradient(points, 0.1)).max() <= 2 * 2 / 0.1
    with pytest.raises(libmpm.SceneError, match="expected a finite number"):
        libmpm.Field(components=("log(x - 1)",)).gradient(points, 0.1)


def test_particles_of_one_run_start_another():
    """A run taken apart by its readers goes on in a new one: positions apart, as it was."""
    first = simulate(disc())
    first.run(until=0.002)
    view = first.particles["disc"].read(["velocity", "velocity_gradient"])
    again = simulate(disc(velocity=(0.0, 0.0)))
    again.particles["disc"]["velocity"] = view["velocity"]
    slower = rate(again)
    again = simulate(disc(velocity=(0.0, 0.0)))
    again.particles["disc"]["velocity"] = view["velocity"]
    again.particles["disc"]["velocity_gradient"] = view["velocity_gradient"]
    assert slower < 0.99 * rate(first)
    assert rate(again) == pytest.approx(rate(first), rel=1e-3)


def test_given_velocities_replace_the_field_and_its_slope():
    sim = simulate(disc())
    sim.particles["disc"]["velocity"] = np.zeros((len(sim.particles["disc"]), 2))
    assert np.abs(sim.grid["velocity"]).max() == 0


def test_what_cannot_be_given():
    sim = simulate(disc(transfer="FLIP"))
    count = len(sim.particles["disc"])
    with pytest.raises(libmpm.SceneError, match=r"'FLIP' deposits no gradient.*APIC, AFLIP"):
        sim.particles["disc"]["velocity_gradient"] = np.zeros((count, 2, 2))
    sim = simulate(disc())
    with pytest.raises(libmpm.SceneError, match=r"expected \(\d+, 2, 2\)"):
        sim.particles["disc"]["velocity_gradient"] = np.zeros((count, 2))
    bad = np.zeros((count, 2, 2))
    bad[3, 0, 1] = np.inf
    with pytest.raises(libmpm.SceneError, match=r"velocity_gradient\[3\][\s\S]*expected finite"):
        sim.particles["disc"]["velocity_gradient"] = bad


def two_bodies(velocity):
    """A spinning disc and a block beside it, alike but for their motion: merged into one body."""
    scene = disc(velocity=velocity)
    scene.add_body(
        name="block",
        shape=shapes.Box(lower=(0.1, 0.1), upper=(0.3, 0.3)),
        material=scene.bodies[0].material,
        velocity=(0.2, 0.0),
        fbar=None,
    )
    return scene


def test_bodies_that_run_as_one():
    sim = simulate(two_bodies(spin(2)))
    assert rate(sim) == pytest.approx(RATE, rel=1e-9)
    block = sim.particles["block"]
    np.testing.assert_allclose(block["velocity"], np.tile((0.2, 0.0), (len(block), 1)), atol=1e-12)
    assert np.abs(block["velocity_gradient"]).max() < 1e-10


@pytest.mark.parametrize("ranks", [2, 3])
def test_ranks_have_the_bits_of_one(ranks):
    one = simulate(two_bodies(spin(2)))
    many = simulate(two_bodies(spin(2)), device=["cpu"] * ranks)
    for sim in (one, many):
        sim.step(20)
    for body in ("disc", "block"):
        for name in ("position", "velocity"):
            np.testing.assert_array_equal(many.particles[body][name], one.particles[body][name])


def test_a_resumed_run_has_the_same_bits(tmp_path):
    whole, first = simulate(disc()), simulate(disc())
    whole.step(30)
    first.step(11)
    first.save_checkpoint(tmp_path / "half.npz")
    second = libmpm.Simulation.resume(tmp_path / "half.npz")
    second.step(19)
    np.testing.assert_array_equal(
        second.particles["disc"]["position"], whole.particles["disc"]["position"]
    )


def branched(tmp_path, velocity=(0.0, 0.0)):
    """A scene that continues from a disc after 12 steps, and the rate that the disc has there."""
    trunk = simulate(disc(velocity=velocity))
    trunk.step(12)
    trunk.save_checkpoint(tmp_path / "trunk.npz")
    return libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz"), rate(trunk)


def test_a_body_added_to_a_run_starts_at_its_rate(tmp_path):
    """A checkpoint is taken apart, and a turning body placed beside what was in it."""
    scene, _ = branched(tmp_path)
    middle = np.array((2.15, 0.25))  # no node sees both
    turning = libmpm.Field(
        components=(f"-{RATE} * (y - {middle[1]})", f"{RATE} * (x - {middle[0]})")
    )
    scene.add_body(
        name="wheel", shape=shapes.Sphere(centre=tuple(middle), radius=1.5 * DX),
        material=scene.bodies[0].material, velocity=turning,
    )  # fmt: skip
    sim = simulate(scene)
    view = sim.particles["wheel"].read(["position", "velocity"])
    np.testing.assert_allclose(view["velocity"], turning.at(view["position"]), atol=1e-10)
    assert rate(sim, "wheel") == pytest.approx(RATE, rel=1e-9)


@pytest.mark.parametrize("hole", [False, True])
def test_what_a_checkpoint_holds_keeps_its_rate(tmp_path, hole):
    """Taken apart and put together again, and with its middle taken out by another body."""
    scene, before = branched(tmp_path, spin(2))
    if hole:
        scene.add_body(
            name="hub", shape=shapes.Sphere(centre=tuple(centre(2)), radius=2 * DX),
            material=scene.bodies[0].material, velocity=spin(2), subtract_from=("disc",),
        )  # fmt: skip
    sim = simulate(scene)
    assert rate(sim) == pytest.approx(before, rel=2e-3 if hole else 1e-9)
    if hole:
        assert rate(sim, "hub") == pytest.approx(RATE, rel=5e-3)
        assert sim.displaced["disc"] > 30


def test_water_from_an_inlet_comes_without_a_slope_and_leaves_what_is_there_alone():
    """Layers arrive at one speed; beside them a shear flow keeps the slope that it was given."""
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0.0, 0.0), upper=(2.4, 1.2), gravity=(0.0, 0.0)
    )
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(0.6, 0.8)), velocity=(1.0, 0.0),
        material=materials.TaitFluid(bulk_modulus=1e5),
    )  # fmt: skip
    scene.add_body(
        name="shear", shape=shapes.Box(lower=(1.4, 0.2), upper=(2.0, 0.8)),
        material=materials.TaitFluid(bulk_modulus=1e5),
        velocity=libmpm.Field(components=(f"{RATE} * (y - 0.5)", "0")),
    )  # fmt: skip
    inlet = libmpm.boundaries.Inflow(body="water", face="x-", velocity=1.0, level=0.8)
    scene.add_flow(name="inlet", flow=inlet)
    scene.add_boundary(
        name="floor", shape=shapes.DomainWalls(faces=("y-",)), response=libmpm.boundaries.Slip()
    )
    sim = simulate(scene)
    start = sim.particles["shear"]["velocity_gradient"][:, 0, 1]
    np.testing.assert_allclose(start, RATE, atol=1e-9)
    first = len(sim.particles["water"])
    sim.run(until=0.12, progress=False)
    water = sim.particles["water"].read(["id", "position", "velocity", "velocity_gradient"])
    new = (water["id"] >= first) & (water["position"][:, 1] < 0.5)
    assert new.sum() > 10
    assert np.abs(water["velocity"][new] - (1.0, 0.0)).max() < 1e-6
    assert np.abs(water["velocity_gradient"][new]).max() < 1e-5
    inside = np.abs(sim.particles["shear"]["position"] - (1.7, 0.5)).max(axis=1) < 0.1
    slope = sim.particles["shear"]["velocity_gradient"][inside, 0, 1]
    assert slope.mean() == pytest.approx(RATE, rel=0.02)
