"""One velocity for all who ask: every kind of sensor against a motion that is known.

A body moves as a whole, or turns about its centre. What sensors in the engine, sensors in Python,
readers and arrays for other libraries say of the same moment is held against the motion and
against each other, under every transfer and all functions, in the plane and in space.

Expected duration: 60 s.
"""

import itertools

import numpy as np
import pytest

import libmpm
from libmpm import Method, materials, sensors, shapes
from libmpm.methods import Kernel, Transfer

DX = 0.1
TRANSFERS = {
    "PIC": "PIC",
    "FLIP": "FLIP",
    "PIC-FLIP": Transfer(scheme="PIC-FLIP", flip=0.9),
    "APIC": "APIC",
    "AFLIP": Transfer(scheme="AFLIP", flip=0.9),
    "NFLIP": "NFLIP",
    "SFLIP": Transfer(scheme="SFLIP", flip=0.9, shift_max=0.2),
    "ASFLIP": Transfer(scheme="ASFLIP", flip=0.9, shift_max=0.2),
    "XPIC": "XPIC",
    "FMPM": "FMPM",
    "FMPM, now and then": Transfer(scheme="FMPM", every=3),
}
AFFINE = ("APIC", "AFLIP", "ASFLIP")
KERNELS = {
    "linear": Kernel(name="linear"),
    "modified linear": Kernel(name="linear", modified=True),
    "quadratic": Kernel(name="quadratic"),
    "cubic": Kernel(name="cubic"),
    "quadratic, ending with the domain": Kernel(name="quadratic", boundary=True),
    "ugimp": Kernel(name="ugimp"),
    "cpgimp": Kernel(name="cpgimp"),
    "cpdi": Kernel(name="cpdi"),
    "ddmp": Kernel(name="ddmp"),
}
ALL = [
    pytest.param(t, k, id=f"{t}-{k}")
    for t, k in itertools.product(TRANSFERS, KERNELS)
    if KERNELS[k].has_moments or t not in AFFINE
]
CELLS = {2: 14, 3: 10}


def moving(dimension, transfer, kernel, velocity, *, shape=None, extra=None):
    """A soft solid in the middle of an empty domain, with a sensor of every kind on it."""
    n = CELLS[dimension]
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=(n * DX,) * dimension, gravity=(0.0,) * dimension,
        method=Method(transfer=TRANSFERS[transfer], kernel=KERNELS[kernel], cfl=0.05),
    )  # fmt: skip
    middle = 0.5 * n * DX
    side = 0.31 if dimension == 2 else 0.2
    scene.add_body(
        name="body",
        shape=shape or shapes.Box(lower=(middle - side,) * dimension,
                                  upper=(middle + side,) * dimension),
        material=materials.NeoHookean(density=1000.0, youngs_modulus=1e4, poissons_ratio=0.2),
        velocity=velocity,
        fbar=None,
    )  # fmt: skip
    centre = (middle + 0.037,) * dimension
    for name, sensor in {
        "tracker": sensors.ParticleTracker(body="body", ids="all"),
        "mean": sensors.ParticleSensor(attribute="velocity", operation="mean", body="body"),
        "whole": sensors.BodyTracker(body="body", quantities=("centroid", "velocity", "momentum")),
        "probe": sensors.VelocityProbe(position=centre),
        "energy": sensors.Energy(),
        **(extra or {}),
    }.items():
        scene.add_sensor(name=name, sensor=sensor)
    return scene


def seen(sim, body="body"):
    """Velocities by id, as each kind of reader says them now; all sensors sample every step."""
    d = sim.scene.dimension
    view = sim.particles[body]
    order = np.argsort(view["id"])
    tracker = sim.sensors["tracker"]
    rows = np.asarray(tracker.values)[-1].reshape(-1, 2 * d)
    with sim.device_arrays(body, "velocity", "speed", "kinetic_energy") as arrays:
        gathered = np.array(arrays["velocity"])
        speed = np.array(arrays["speed"])
    return {
        "reader": view["velocity"][order],
        "tracker": rows[:, d:],
        "export": gathered[np.argsort(sim_ids(sim, body))],
        "speed": speed[np.argsort(sim_ids(sim, body))],
    }


def sim_ids(sim, body):
    with sim.device_arrays(body, "id") as arrays:
        return np.array(arrays["id"])


def run(scene, steps):
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.step(steps)
    return sim


def agree(found):
    """All say the same velocity of each particle, to the last bits."""
    scale = np.abs(found["reader"]).max()
    for name in ("tracker", "export"):
        np.testing.assert_allclose(
            found[name], found["reader"], rtol=0, atol=1e-13 * scale, err_msg=name
        )
    np.testing.assert_allclose(
        found["speed"], np.linalg.norm(found["reader"], axis=1), rtol=0, atol=1e-13 * scale
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("transfer", "kernel"), ALL)
def test_translation(transfer, kernel, dimension):
    """A body that moves as a whole: every sensor has its velocity, to rounding."""
    v = np.array((0.7, -0.4, 0.5)[:dimension])
    sim = run(moving(dimension, transfer, kernel, tuple(v)), 6)
    found = seen(sim)
    agree(found)
    np.testing.assert_allclose(found["tracker"], np.tile(v, (len(found["tracker"]), 1)), atol=1e-9)
    for name in ("mean", "probe"):
        rows = np.asarray(sim.sensors[name].values)
        np.testing.assert_allclose(rows, np.tile(v, (len(rows), 1)), atol=1e-9, err_msg=name)
    body = sim.sensors["whole"]
    mass = sim.particles["body"]["mass"].sum()
    for name, want in {"velocity": v, "momentum": mass * v}.items():
        for a, axis in enumerate("xyz"[:dimension]):
            np.testing.assert_allclose(body[f"{name}_{axis}"], want[a], rtol=1e-8, err_msg=name)
    kinetic = np.asarray(sim.sensors["energy"].values)[:, 0]
    np.testing.assert_allclose(kinetic, 0.5 * mass * (v @ v), rtol=1e-8)


def turning(dimension, rate, about):
    """Velocity field of a turn about an axis along z, a turn about x added in space."""
    x, y = (f"({a} - {c})" for a, c in zip("xy", about, strict=False))
    if dimension == 2:
        return libmpm.Field(components=(f"-{rate} * {y}", f"{rate} * {x}"))
    z = f"(z - {about[2]})"
    half = 0.5 * rate
    return libmpm.Field(
        components=(f"-{rate} * {y}", f"{rate} * {x} - {half} * {z}", f"{half} * {y}")
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("transfer", "kernel"), ALL)
def test_rotation(transfer, kernel, dimension):
    """A body that turns: sensors of particles agree to the last bits, with the turn to a cell."""
    middle = (0.5 * CELLS[dimension] * DX,) * dimension
    field = turning(dimension, 2.0, middle)
    sim = run(moving(dimension, transfer, kernel, field), 0)
    view = sim.particles["body"]
    if stores(transfer) or transfer in AFFINE:  # what was given is stored, or deposited whole
        want = field.at(view["position"])
        np.testing.assert_allclose(view["velocity"], want, atol=1e-11)
    sim.step(1)
    agree(seen(sim))
    # The grid averages over a cell or so, and nothing over more.
    within = 2.0 * np.sqrt(1.25 if dimension == 3 else 1.0) * DX
    assert np.abs(view["velocity"] - field.at(view["position"])).max() < within
    probe = np.asarray(sim.sensors["probe"].values)[-1]
    point = np.full((1, dimension), middle[0] + 0.037)
    assert np.abs(probe - field.at(point)[0]).max() < 0.25 * within
    sim.step(6)
    agree(seen(sim))


def stores(transfer):
    chosen = TRANSFERS[transfer]
    return (Transfer(scheme=chosen) if isinstance(chosen, str) else chosen).stores_velocity


SPLINES = {
    "linear": lambda r: np.maximum(1 - r, 0),
    "quadratic": lambda r: np.where(
        r < 0.5, 0.75 - r**2, 0.5 * np.maximum(1.5 - r, 0) ** 2
    ),
    "cubic": lambda r: np.where(
        r < 1, 2 / 3 - r**2 + 0.5 * r**3, np.maximum(2 - r, 0) ** 3 / 6
    ),
}  # fmt: skip


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("spline", SPLINES)
def test_a_probe_sees_the_functions_of_the_scene(spline, dimension, precision):
    """Of a wavy field: nodal velocities by the scene's splines, where they carry mass."""
    length = CELLS[dimension] * DX
    waves = libmpm.Field(components=tuple(
        f"sin(17 * x + {k}) * cos(13 * y)" for k in range(dimension)
    ))  # fmt: skip
    rng = np.random.default_rng(7)
    points = 0.5 * length + rng.uniform(-0.33, 0.33, size=(12, dimension))
    extra = {f"p{k}": sensors.VelocityProbe(position=tuple(p)) for k, p in enumerate(points)}
    scene = moving(dimension, "PIC", spline, waves, extra=extra)
    sim = libmpm.Simulation(scene, device="cpu", precision=precision)
    sim.step(3)
    nodes, velocity = sim.grid["position"], sim.grid["velocity"]
    seen_by = 0
    for k, p in enumerate(points):
        weight = np.prod(SPLINES[spline](np.abs(nodes - p) / DX), axis=1)
        got = np.asarray(sim.sensors[f"p{k}"].values)[-1]
        if weight.sum() < 1e-6:
            assert np.isnan(got).all()
            continue
        seen_by += 1
        want = weight @ velocity / weight.sum()
        np.testing.assert_allclose(got, want, atol=1e-11 if precision == "double" else 1e-5)
    assert seen_by > 6
