"""Writing into the particles of a running simulation, functions and forces that act on it.

Expected duration: 15 s.
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, methods, sensors, shapes

SOFT = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}
TRANSFERS = ["APIC", "FLIP", methods.Transfer(scheme="AFLIP", flip=0.95), "XPIC"]


def scene(transfer="APIC", gravity=(0.0, 0.0), material=None, **body):
    made = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2), gravity=gravity,
        method=libmpm.Method(transfer=transfer),
    )  # fmt: skip
    made.add_body(
        name="b", shape=shapes.Box(lower=(0.5, 0.5), upper=(1.1, 0.9)),
        material=material or materials.NeoHookean(**SOFT), **body,
    )  # fmt: skip
    return made


def begun(of, precision="double", **more):
    return libmpm.Simulation(of, device="cpu", precision=precision, threads=1, **more)


def momentum(sim):
    """Of the nodes, with the stresses' own parts, which add up to nothing without walls."""
    sums = sim.engine.sums()
    return np.array([sums["momentum_x"].sum(), sums["momentum_y"].sum()])


def mass(sim):
    return sim.engine.sums()["mass"].sum()


def bits(sim):
    return {k: np.asarray(v).tobytes() for k, v in sim.engine.save().items()}


@pytest.mark.parametrize("transfer", TRANSFERS)
@pytest.mark.parametrize("precision", ["double", "single"])
def test_no_change_has_the_bits_of_none(transfer, precision):
    kick = np.random.default_rng(0).normal(size=2)
    a, b = (begun(scene(transfer, velocity=tuple(kick)), precision) for _ in range(2))
    for sim in (a, b):
        sim.step(7)
    n = len(b.particles["b"])
    b.assign("b", velocity_change=np.zeros((n, 2)))
    b.assign("b", stored=b.stored("b"))
    for sim in (a, b):
        sim.step(5)
    np.testing.assert_array_equal(a.particles["b"]["position"], b.particles["b"]["position"])
    np.testing.assert_array_equal(a.particles["b"]["stress"], b.particles["b"]["stress"])


@pytest.mark.parametrize("transfer", TRANSFERS)
def test_momentum_grows_by_what_is_given(transfer):
    sim = begun(scene(transfer, velocity=(0.3, -0.2)))
    sim.step(9)
    ids = sim.particles["b"]["id"][::3]
    change = np.random.default_rng(1).normal(size=(len(ids), 2))
    each = sim.particles["b"]["mass"][0]
    before, whole = momentum(sim), mass(sim)
    sim.assign("b", velocity_change=change, ids=ids)
    assert mass(sim) == pytest.approx(whole, rel=1e-14)
    np.testing.assert_allclose(momentum(sim) - before, each * change.sum(axis=0), rtol=1e-11)
    sim.step(9)
    np.testing.assert_allclose(momentum(sim) - before, each * change.sum(axis=0), rtol=1e-9)


@pytest.mark.parametrize("transfer", TRANSFERS)
@pytest.mark.parametrize("precision", ["double", "single"])
def test_velocities_at_the_start_are_those_given_before_it(transfer, precision):
    """A deposit is linear: resting particles and a change of velocity are particles that move."""
    within = 1e-12 if precision == "double" else 3e-6
    a, b = begun(scene(transfer), precision), begun(scene(transfer), precision)
    x = a.particles["b"]["position"]
    v = np.stack([0.3 * np.sin(3 * x[:, 1]), 0.2 * x[:, 0]], axis=1)
    a.particles["b"]["velocity"] = v
    b.assign("b", velocity=v)
    for sim in (a, b):
        sim.step(6)
    for name in ("velocity", "position"):
        np.testing.assert_allclose(
            a.particles["b"][name], b.particles["b"][name], atol=within, rtol=0
        )


def test_a_pressure_is_that_given_before_the_start():
    water = materials.TaitFluid(bulk_modulus=1e5)
    a, b = begun(scene(material=water)), begun(scene(material=water))
    p = 50.0 + 500 * a.particles["b"]["position"][:, 0]
    a.particles["b"]["pressure"] = p
    _ = b.time, b.step(0)
    b.assign("b", pressure=p)
    # As readers see it: with what viscosity adds.
    expected = a.particles["b"]["pressure"]
    np.testing.assert_allclose(b.particles["b"]["pressure"], expected, rtol=1e-12)
    for sim in (a, b):
        sim.step(20)
    np.testing.assert_allclose(
        a.particles["b"]["velocity"], b.particles["b"]["velocity"], atol=1e-11, rtol=0
    )


@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
def test_a_state_is_that_of_a_stress_given_at_the_start(transfer):
    law = materials.LinearElastic(**SOFT)
    a = begun(scene(transfer, material=law, stress=(300.0, -200.0, 50.0)))
    b = begun(scene(transfer, material=law))
    b.step(0)
    b.assign("b", stored=a.stored("b"))
    for sim in (a, b):
        sim.step(25)
    assert np.abs(a.particles["b"]["velocity"]).max() > 1e-3
    np.testing.assert_allclose(
        a.particles["b"]["velocity"], b.particles["b"]["velocity"], atol=1e-12, rtol=0
    )


def test_bodies_stepped_as_one_are_assigned_apart():
    made = scene()
    made.add_body(
        name="c", shape=shapes.Box(lower=(0.5, 1.3), upper=(1.1, 1.7)),
        material=materials.NeoHookean(**SOFT),
    )  # fmt: skip
    sim = begun(made)
    sim.step(3)
    sim.assign("c", velocity_change=np.full((len(sim.particles["c"]), 2), 0.25))
    np.testing.assert_allclose(sim.particles["c"]["velocity"], 0.25, atol=1e-9)
    np.testing.assert_allclose(sim.particles["b"]["velocity"], 0.0, atol=1e-9)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_a_constant_force_is_gravity(precision):
    """Kicks of f dt at every step and gravity differ by when in a step they act: by g dt t."""
    pushed = begun(scene(), precision)
    pushed.add_force("weight", "b", lambda a: np.tile([0.0, -9.81], (len(a["id"]), 1)), interval=0)
    falls = begun(scene(gravity=(0.0, -9.81)), precision)
    for sim in (pushed, falls):
        sim.run(until=0.2, progress=False)
    v = pushed.particles["b"]["velocity"][:, 1]
    np.testing.assert_allclose(
        v, -9.81 * pushed.time, rtol=1e-10 if precision == "double" else 1e-4
    )
    lag = 9.81 * falls.dt * falls.time
    np.testing.assert_allclose(
        pushed.particles["b"]["position"], falls.particles["b"]["position"], atol=2 * lag
    )


def test_a_spring_swings_with_its_period():
    """Symplectic Euler of period h: the frequency is right to (w h)^2 / 24."""
    sim = begun(scene(velocity=(0.5, 0.0)))
    omega, h = 2 * np.pi / 0.4, 0.004
    home = sim.particles["b"]["position"].mean(axis=0)

    def spring(arrays):
        x = np.from_dlpack(arrays.position)
        return np.tile(-(omega**2) * (x.mean(axis=0) - home), (len(x), 1))

    sim.add_force("spring", "b", spring, interval=h)
    seen = []
    sim.add_action(
        "look", lambda s: seen.append((s.time, s.particles["b"]["position"][:, 0].mean())),
        interval=h,
    )  # fmt: skip
    sim.run(until=0.4, progress=False)
    t, x = np.array(seen).T
    amplitude = 0.5 / omega
    expected = home[0] + amplitude * np.sin(omega * t)
    # A kick comes up to h late, so phases may be out by w h / 2 and a step's rest.
    np.testing.assert_allclose(x, expected, atol=amplitude * omega * h)


def wind(arrays):
    return arrays.position.to_numpy() * [0.5, -0.25]


@pytest.mark.parametrize("interval", [0, 0.013])
@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
def test_a_resumed_run_has_the_same_bits(tmp_path, interval, transfer):
    whole = begun(scene(transfer), "single")
    whole.add_force("wind", "b", wind, interval=interval)
    whole.run(until=0.1, progress=False)

    half = begun(scene(transfer), "single")
    half.add_force("wind", "b", wind, interval=interval)
    half.run(until=0.047, progress=False)
    half.save_checkpoint(tmp_path / "c.npz")
    again = libmpm.Simulation.resume(tmp_path / "c.npz")
    again.add_force("wind", "b", wind, interval=interval)
    again.run(until=0.1, progress=False)
    assert bits(again) == bits(whole)


def test_a_resumed_run_asks_for_its_actions(tmp_path):
    sim = begun(scene())
    sim.add_force("wind", "b", wind, interval=0.01)
    sim.run(until=0.03, progress=False)
    sim.save_checkpoint(tmp_path / "c.npz")
    again = libmpm.Simulation.resume(tmp_path / "c.npz")
    with pytest.raises(libmpm.CheckpointError, match=r"actions wind.*add them by the same names"):
        again.step()
    with pytest.raises(libmpm.CheckpointError, match=r"interval is 0.02 s.*was 0.01 s"):
        again.add_force("wind", "b", wind, interval=0.02)
    again.add_force("wind", "b", wind, interval=0.01)
    again.step()
    with pytest.raises(libmpm.Error, match="'wind': expected a name that no other"):
        again.add_force("wind", "b", wind, interval=0.01)


def test_an_action_is_called_at_the_start_and_at_its_times():
    sim = begun(scene())
    seen = []
    sim.add_action("look", lambda s: seen.append(s.time), interval=0.02)
    sim.run(until=0.1, progress=False)
    assert seen[0] == 0 and len(seen) == 6
    np.testing.assert_allclose(seen, np.arange(6) * 0.02, atol=sim.dt)
    sim.add_action("run", lambda s: s.step(), interval=1)
    with pytest.raises(libmpm.Error, match="advances the simulation that calls it"):
        sim.step()


BAD = {
    "there is no such body": lambda s, n: s.assign("c", velocity=np.zeros((n, 2))),
    r"velocity_change has the shape \(3,\)": lambda s, n: s.assign("b", velocity_change=[1, 2, 3]),
    "finite numbers": lambda s, n: s.assign("b", velocity=np.full((n, 2), np.nan)),
    "both velocity and velocity_change": lambda s, n: s.assign(
        "b", velocity=np.zeros((n, 2)), velocity_change=np.zeros((n, 2))
    ),
    "which is for fluids": lambda s, n: s.assign("b", pressure=np.zeros(n)),
    "'strain' is not stored": lambda s, n: s.assign("b", stored={"strain": np.zeros((n, 3))}),
    "id 7777 is not there": lambda s, n: s.assign("b", velocity=[[0, 0]], ids=[7777]),
    "an id is there twice": lambda s, n: s.assign("b", velocity=[[0, 0]] * 2, ids=[3, 3]),
    "cells in the next step": lambda s, n: s.assign("b", velocity=np.full((n, 2), 1e5)),
    "one that NeoHookean can have": lambda s, n: s.assign(
        "b", stored={k: np.full_like(v, -3.0) for k, v in s.stored("b").items()}
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_what_is_refused_changes_nothing(what):
    sim = begun(scene(velocity=(0.1, 0.2)))
    sim.step(3)
    before = bits(sim)
    with pytest.raises(libmpm.SceneError, match=what):
        BAD[what](sim, len(sim.particles["b"]))
    assert bits(sim) == before


def test_sensors_may_not_assign():
    made = scene()

    def write(sim):
        sim.assign("b", velocity=np.zeros((len(sim.particles["b"]), 2)))
        return 0.0

    made.add_sensor(name="s", sensor=sensors.Custom(function=write, columns=("x",), interval=0.01))
    with pytest.raises(libmpm.SceneError, match="assign in an action"):
        begun(made).step()


def test_several_ranks_are_refused_by_name():
    sim = libmpm.Simulation(scene(), device=["cpu", "cpu"])
    sim.step(2)
    with pytest.raises(libmpm.SceneError, match="one device"):
        sim.assign("b", velocity_change=np.ones((len(sim.particles["b"]), 2)))


def test_a_push_into_water_is_no_energy_from_nowhere():
    made = scene(material=materials.TaitFluid(bulk_modulus=1e5), gravity=(0.0, -9.81))
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    sim = begun(made, guard=libmpm.Guard(every=20))
    sim.add_force("wind", "b", lambda a: np.tile([20.0, 0.0], (len(a["id"]), 1)), interval=0.005)
    assert sim.run(until=0.2, progress=False)


@pytest.mark.gpu
@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
@pytest.mark.parametrize("transfer", TRANSFERS)
def test_a_device_is_assigned_as_the_cpu_is(tmp_path, transfer, precision):
    """Fixed-point sums are put in and taken out to their last bit, 2^-24 of the largest."""
    within = {"single": 1e-5, "mixed": 1e-5, "double": 1e-11}[precision]
    made = scene(transfer, velocity=(0.3, -0.2))
    sim = libmpm.Simulation(made, device="cuda", precision=precision)
    sim.step(9)
    n, each = len(sim.particles["b"]), sim.particles["b"]["mass"][0]
    change = np.random.default_rng(1).normal(size=(n, 2))
    before, whole = momentum(sim), mass(sim)
    sim.assign("b", velocity_change=change)
    assert mass(sim) == pytest.approx(whole, rel=within)
    given = each * change.sum(axis=0)
    np.testing.assert_allclose(momentum(sim) - before, given, atol=within * n * each)
    sim.step(9)
    np.testing.assert_allclose(momentum(sim) - before, given, atol=10 * within * n * each)

    runs = []
    for resumes in (False, True):
        run = libmpm.Simulation(scene(transfer), device="cuda", precision=precision)
        run.add_force("wind", "b", wind, interval=0.013)
        if resumes:
            run.run(until=0.047, progress=False)
            run.save_checkpoint(tmp_path / "c.npz")
            run = libmpm.Simulation.resume(tmp_path / "c.npz")
            run.add_force("wind", "b", wind, interval=0.013)
        run.run(until=0.1, progress=False)
        runs.append(bits(run))
    assert runs[0] == runs[1]
