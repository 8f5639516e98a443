"""Rigid bodies: free motion, walls, contact, loads, checkpoints, refusals."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes
from support import rigid_scenes as cases

G = 9.81


def run(scene: libmpm.Scene, **options: Any) -> libmpm.Simulation:
    """Return a simulation on the CPU, in double precision unless said."""
    return libmpm.Simulation(scene, device="cpu", **({"precision": "double"} | options))


def momentum(simulation: libmpm.Simulation, body: str) -> Any:
    """Return the momentum of a body, kg m/s."""
    mass, velocity = (simulation.particles[body][a] for a in ("mass", "velocity"))
    return (np.asarray(mass)[:, None] * np.asarray(velocity)).sum(axis=0)


def places(simulation: libmpm.Simulation, body: str) -> Any:
    """Return the positions of a body's particles by id, m."""
    seen = simulation.particles[body]
    return np.asarray(seen["position"])[np.argsort(np.asarray(seen["id"]))]


# Free motion --------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["double", "single"])
def test_flight_in_the_plane(precision: str) -> None:
    """Centre and angle against closed forms of the symplectic step; the shape stays what it was."""
    velocity, spin, g, dt, until = (0.3, 0.5), 3.0, 2.0, 1e-3, 0.5
    simulation = run(cases.flying((0.4, 0.2), velocity, (spin,), g, dt), precision=precision)
    before = places(simulation, "box")
    simulation.run(until=until)
    found = simulation.sensors["motion"]
    t = found.time[-1]
    # The state is kept in double precision whatever the particles have.
    close = {"rel": 1e-12, "abs": 1e-12}
    assert found["centroid_x"][-1] == pytest.approx(1.5 + velocity[0] * t, **close)
    fall = 0.5 * g * t * (t + dt)  # a step's velocity is that at its end
    assert found["centroid_y"][-1] == pytest.approx(1.5 + velocity[1] * t - fall, **close)
    assert found["angle"][-1] == pytest.approx(spin * t, **close)
    assert np.all(found["angular_velocity"] == pytest.approx(spin, rel=1e-12))
    assert np.all(found.values[1:, -3:] == 0)  # nobody pushes it
    energy = simulation.sensors["energy"]
    inertia = 40.0 * (0.4**2 + 0.2**2) / 12  # of the rectangle, 40 kg/m
    kinetic = 20.0 * (velocity[0] ** 2 + (velocity[1] - g * dt) ** 2) + 0.5 * inertia * spin**2
    assert energy["kinetic"][0] == pytest.approx(
        kinetic, rel=1e-6 if precision == "single" else 1e-12
    )

    after = places(simulation, "box")
    turn = found["angle"][-1]
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    centre = found.values[-1, :2]
    expected = centre + (before - before.mean(axis=0)) @ rotation.T
    bound = 1e-6 if precision == "single" else 1e-12
    assert np.abs(after - expected).max() < bound


def test_box_in_space_turns_as_an_euler_top() -> None:
    """Energy, angular momentum and the tennis racket: turned about its middle axis it flips."""
    size, spin, until = (0.3, 0.2, 0.1), (0.02, 5.0, 0.01), 8.0
    mass = 500.0 * math.prod(size)
    a, b, c = size
    principal = mass / 12 * np.array([b * b + c * c, a * a + c * c, a * a + b * b])
    simulation = run(cases.flying(size, (0.0, 0.0, 0.0), spin, time_step=2e-3))
    simulation.run(until=until)
    found = simulation.sensors["motion"]
    w = np.stack([found[f"angular_velocity_{x}"] for x in "xyz"], axis=1)
    q = np.stack([found[f"quaternion_{x}"] for x in "wxyz"], axis=1)
    r = rotations(q)
    momenta = np.einsum("nij,j,nkj,nk->ni", r, principal, r, w)
    scale = np.linalg.norm(principal * spin)
    assert np.abs(momenta - principal * spin).max() < 1e-11 * scale
    energies = 0.5 * np.einsum("ni,ni->n", momenta, w)
    assert np.ptp(energies) < 2e-6 * energies[0]
    # Against Euler's equations of the same box, by steps of a half.
    turned = np.einsum("nji,nj->ni", r, w)[:, 1]  # about the body's middle axis
    reference = euler_top(principal, spin, found.time)
    assert turned.min() < -4.9
    flip = found.time[np.argmax(turned < 0)]
    expected = found.time[np.argmax(reference[:, 1] < 0)]
    assert flip == pytest.approx(expected, abs=0.02)


def rotations(q: Any) -> Any:
    """Return the matrices of unit quaternions w, x, y, z."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], -1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], -1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], -1),
        ],
        axis=-2,
    )


def euler_top(principal: Any, spin: Any, times: Any) -> Any:
    """Return the angular velocity on the body's axes, by fourth-order steps."""

    def rate(w: Any) -> Any:
        return np.cross(principal * w, w) / principal

    w, out = np.array(spin, dtype=float), []
    for k, t in enumerate(times):
        out.append(w.copy())
        if k + 1 == len(times):
            break
        h = (times[k + 1] - t) / 2
        for _ in range(2):
            k1 = rate(w)
            k2 = rate(w + h / 2 * k1)
            k3 = rate(w + h / 2 * k2)
            k4 = rate(w + h * k3)
            w = w + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return np.array(out)


def test_given_inertia_and_held_degrees() -> None:
    """Energy of the given inertia; what is held moves on as it began."""
    scene = cases.flying((0.4, 0.2), (0.2, 0.0), (2.0,), gravity=3.0, inertia=1.5, held=("y",))
    simulation = run(scene)
    simulation.run(until=0.2)
    found = simulation.sensors["motion"]
    assert np.all(found["centroid_y"] == pytest.approx(1.5, abs=1e-12))
    assert found["centroid_x"][-1] == pytest.approx(1.5 + 0.2 * found.time[-1])
    kinetic = simulation.sensors["energy"]["kinetic"]
    assert kinetic == pytest.approx(0.5 * 40 * 0.04 + 0.5 * 1.5 * 4.0, rel=1e-12)


# Walls and contact --------------------------------------------------------------------------------


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_block_on_a_slope(friction: float) -> None:
    """a = g (sin α - μ cos α), or none; it neither sinks nor lifts."""
    simulation = run(cases.incline(2, friction, 30.0))
    simulation.run(until=0.4)
    found = simulation.sensors["motion"]
    pull = 10.0 * (math.sin(math.pi / 6) - friction * math.cos(math.pi / 6))
    rate = -np.polyfit(found.time[200:], found["velocity_x"][200:], 1)[0]
    assert rate == pytest.approx(max(pull, 0.0), abs=1e-4)
    assert np.abs(found["centroid_y"] - 0.75).max() < 1e-6
    assert np.abs(found["angle"]).max() < 1e-5
    weight = 1000 * 0.5 * 10.0
    assert found["force_y"][-1] == pytest.approx(weight * math.cos(math.pi / 6), rel=1e-6)


@pytest.mark.parametrize("friction", [0.0, 0.2])
def test_block_on_a_surface_that_slopes(friction: float) -> None:
    """The same on a boundary of any shape, across the cells; its load is that of the block."""
    turn, weight = math.radians(20.0), 5000.0
    normal = np.array([-math.sin(turn), math.cos(turn)])
    along = np.array([math.cos(turn), math.sin(turn)])
    scene = libmpm.Scene(
        dimension=2, cell_size=1 / 12, lower=(0, 0), upper=(5, 4), gravity=(0, -10),
        method=libmpm.Method(time_step=5e-4),
    )  # fmt: skip
    response = boundaries.Separable(static_friction=friction, dynamic_friction=friction)
    plane = shapes.HalfSpace(point=(0.0, 0.5), normal=tuple(normal))
    scene.add_boundary(name="slope", shape=plane, response=response)
    centre = np.array([0.0, 0.5]) + 3.5 * along + 0.25 * normal
    scene.add_body(
        name="block", shape=shapes.OrientedBox(centre=tuple(centre), size=(1, 0.5), angle=20.0),
        material=materials.Rigid(density=1000.0),
    )  # fmt: skip
    scene.add_sensor(name="motion", sensor=sensors.RigidMotion(body="block"))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="slope", interval=0.05))
    simulation = run(scene)
    simulation.run(until=0.3)
    found = simulation.sensors["motion"]
    speed = -(found.values[:, 2:4] @ along)
    rate = np.polyfit(found.time[200:], speed[200:], 1)[0]
    pull = 10.0 * (math.sin(turn) - friction * math.cos(turn))
    assert rate == pytest.approx(pull, abs=1e-5)
    assert np.ptp(found.values[:, :2] @ normal) < 1e-6
    load = simulation.sensors["load"].values[-1, :2]
    assert load @ normal == pytest.approx(-weight * math.cos(turn), rel=1e-5)
    assert load @ along == pytest.approx(-friction * weight * math.cos(turn), abs=0.1)


def test_load_cell_hears_a_rigid_body() -> None:
    scene = cases.incline(2, 0.3, 30.0)
    cell = sensors.LoadCell(boundary="plane", interval=0.05, reference=(0.0, 0.0))
    scene.add_sensor(name="load", sensor=cell)
    simulation = run(scene)
    simulation.run(until=0.3)
    load, found = simulation.sensors["load"], simulation.sensors["motion"]
    weight = 1000 * 0.5 * 10.0 * math.cos(math.pi / 6)
    assert load["force_y"][1:] == pytest.approx(-weight, rel=1e-5)
    assert load["force_x"][1:] == pytest.approx(-0.3 * weight, rel=1e-5)
    # x f_y - y f_x about the corner, at the sole: friction, 0.25 m below the centre, tips the block
    # forward, and it presses by 0.3 * 0.25 m nearer to its front.
    middle = np.interp(load.time[-1] - 0.025, found.time, found["centroid_x"])
    arm = -weight * (middle - 0.3 * 0.25) + 0.3 * weight * 0.5
    assert load["moment_z"][-1] == pytest.approx(arm, rel=2e-3)


def test_discs_exchange_momentum() -> None:
    """Momentum is kept to rounding, and head on both go on with the mean velocity."""
    simulation = run(cases.discs(12.0))
    simulation.run(until=0.1)
    left, right = (simulation.sensors[name] for name in ("left", "right"))
    mass = [float(np.asarray(simulation.particles[n]["mass"]).sum()) for n in ("left", "right")]
    total = mass[0] * left.values[:, 2:4] + mass[1] * right.values[:, 2:4]
    assert np.abs(total - total[0]).max() < 1e-13 * mass[0] * 0.5
    together = (mass[0] * 0.5 - mass[1] * 0.5) / (mass[0] + mass[1])
    assert left["velocity_x"][-1] == pytest.approx(together, abs=0.02)
    assert right["velocity_x"][-1] == pytest.approx(together, abs=0.02)
    first = int(np.argmax(np.abs(np.diff(left["velocity_x"])) > 1e-9))
    gap = np.hypot(*(left.values[first, :2] - right.values[first, :2])) / 0.01 - 24
    assert abs(gap) < 0.1  # cells


@pytest.mark.parametrize("law", [contacts.Fluid(), None])
def test_momentum_of_a_body_and_water(law: contacts.ContactLaw | None) -> None:
    """Momentum and angular momentum of both are kept to rounding, by contact and as one."""
    simulation = run(cases.tub(law))
    simulation.step(1)
    mass = 500 * 0.09
    kept = []
    for until in (0.05, 0.1, 0.15):
        simulation.run(until=until)
        kept.append(momentum(simulation, "water") + momentum(simulation, "block"))
    start = mass * np.array([0.3, -2.0])
    assert np.abs(momentum(simulation, "water")).max() > 0.1 * np.abs(start).max()
    assert np.abs(np.array(kept) - start).max() < 1e-12 * np.abs(start).max()
    if law is None:
        return
    load, found = simulation.sensors["load"], simulation.sensors["motion"]
    # The block is the first of the contact: the force is that on the water.
    impulse = (load.values[:, :2] * 0.02).sum(axis=0)
    until = load.time[-1]
    at = int(np.argmin(np.abs(found.time - until)))
    given = mass * (found.values[0, 2:4] - found.values[max(at - 1, 0), 2:4])
    assert np.abs(impulse - given).max() < 0.02 * np.abs(given).max()


@pytest.mark.parametrize("scheme", ["PIC", "PIC-FLIP", "AFLIP"])
def test_momentum_with_other_transfers(scheme: str) -> None:
    """Of the nodes: particles store velocities that are a step behind what pushes them."""
    flip = {} if scheme == "PIC" else {"flip": 0.95}
    scene = cases.tub(contacts.Fluid())
    given = scene.to_dict()
    given["method"]["transfer"] = libmpm.methods.Transfer(scheme=scheme, **flip).to_dict()
    simulation = run(libmpm.Scene.from_dict(given))
    simulation.run(until=0.1)
    nodes = simulation.grid
    found = (np.asarray(nodes["mass"])[:, None] * np.asarray(nodes["velocity"])).sum(axis=0)
    assert np.abs(found - 45 * np.array([0.3, -2.0])).max() < 1e-11


def test_block_floats() -> None:
    """The draught of half the density, within 0.15 cells; it stays upright and where it is."""
    simulation = run(cases.floating(500.0, cells=6))
    simulation.run(until=1.5)
    middle = places(simulation, "block").mean(axis=0)
    assert abs(middle[1] - 2.5) * 6 < 0.15
    assert abs(middle[0] - 2.0) * 6 < 1e-3


# State --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("precision", ["double", "single"])
def test_resumed_run_and_threads_have_the_same_bits(tmp_path: Path, precision: str) -> None:
    scene = cases.tub(contacts.Fluid())
    whole = run(scene, precision=precision, threads=1)
    whole.run(until=0.1)
    half = run(scene, precision=precision, threads=2)
    half.run(until=0.05)
    half.save_checkpoint(tmp_path / "half.h5")
    resumed = libmpm.Simulation.resume(tmp_path / "half.h5", device="cpu")
    resumed.run(until=0.1)
    for body in ("block", "water"):
        for name in ("id", "position", "velocity"):
            one, other = (np.asarray(s.particles[body][name]) for s in (whole, resumed))
            assert np.array_equal(one, other), (body, name)
    cut = len(resumed.sensors["motion"].values)
    assert np.array_equal(whole.sensors["motion"].values[-cut + 1 :],
                          resumed.sensors["motion"].values[1:])  # fmt: skip


@pytest.mark.parametrize("change", ["gone", "short", "infinite"])
def test_state_without_the_motion_is_refused(change: str) -> None:
    simulation = run(cases.tub(contacts.Fluid()))
    simulation.run(until=0.01)
    engine = simulation._assembly.engine
    state = engine.save()
    entry = np.array(state["body1_rigid"])
    if change == "gone":
        del state["body1_rigid"]
    else:
        state["body1_rigid"] = entry[:-1] if change == "short" else np.full_like(entry, np.inf)
    with pytest.raises(libmpm.SceneError, match="body1_rigid"):
        engine.load(state)


# Refusals -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"density": 0.0}, "density"),
        ({"density": 500.0, "held": ("w",)}, "held"),
        ({"density": 500.0, "held": ("x", "x")}, "held"),
        ({"density": 500.0, "inertia": -1.0}, "inertia"),
        ({"density": 500.0, "inertia": ((1, 0, 0), (0, 1, 0), (0, 0, 3))}, "inertia"),
    ],
)
def test_wrong_values(given: dict[str, Any], says: str) -> None:
    with pytest.raises(libmpm.SceneError, match=says):
        materials.Rigid(**given)


def test_unbuilt_is_refused_by_name() -> None:
    scene = cases.tub(contacts.Fluid())
    for device in ("cuda", ["cpu", "cpu"]):
        with pytest.raises(libmpm.SceneError, match="'block'"):
            libmpm.Simulation(scene, device=device)
    alone = libmpm.Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 1))
    box = shapes.Box(lower=(0.3, 0.3), upper=(0.6, 0.6))
    alone.add_body(name="timber", shape=box, material=materials.Rigid(density=500.0))
    with pytest.raises(libmpm.SceneError, match="time_step"):
        run(alone).step(1)
    for given in ({"damping": 0.1}, {"fbar": libmpm.FBar(ratio=0.5)}, {"stress": (1.0, 0, 0)}):
        other = libmpm.Scene(
            dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 1),
            method=libmpm.Method(time_step=1e-3),
        )  # fmt: skip
        other.add_body(name="timber", shape=box, material=materials.Rigid(density=500.0), **given)
        with pytest.raises(libmpm.SceneError, match=f"'timber': {next(iter(given))}"):
            run(other).step(1)
    wall = libmpm.boundaries.Slip(cell="linear")
    scene.add_boundary(name="wall", shape=shapes.DomainWalls(faces=("y+",)), response=wall)
    with pytest.raises(libmpm.SceneError, match="'block': Rigid beside boundary 'wall' with cell"):
        run(scene)


def test_shearing_velocity_is_refused() -> None:
    scene = cases.flying((0.4, 0.2), (0.0, 0.0), (0.0,))
    scene = libmpm.Scene(
        dimension=2, cell_size=0.05, lower=(0, 0), upper=(1, 1),
        method=libmpm.Method(time_step=1e-3),
    )  # fmt: skip
    scene.add_body(
        name="timber", shape=shapes.Box(lower=(0.3, 0.3), upper=(0.6, 0.6)),
        material=materials.Rigid(density=500.0),
        velocity=libmpm.Field(components=("y", "0")),
    )  # fmt: skip
    with pytest.raises(libmpm.SceneError, match="'timber': its velocity differs"):
        run(scene).step(1)


def test_scene_file_and_schema(tmp_path: Path) -> None:
    scene = cases.flying((0.4, 0.2), (0.0, 0.0), (1.0,), inertia=2.0, held=("x", "rotation"))
    scene.save(tmp_path / "scene.json")
    again = libmpm.Scene.load(tmp_path / "scene.json")
    assert again == scene
    assert again.bodies[0].material == materials.Rigid(
        density=500.0, inertia=2.0, held=("x", "rotation")
    )
    jsonschema = pytest.importorskip("jsonschema")
    from libmpm._src.scene.schema import scene_schema

    jsonschema.validate(json.loads((tmp_path / "scene.json").read_text()), scene_schema())


def test_scaled_inertia() -> None:
    """kg m² at λ in similitude: λ⁵, of a metre's thickness λ⁴."""
    flat = cases.flying((0.4, 0.2), (0.0, 0.0), (1.0,), inertia=2.0).scaled(0.25)
    assert flat.bodies[0].material == materials.Rigid(density=500.0, inertia=2.0 * 0.25**4)
    given = np.diag([2.0, 2.0, 3.0])
    whole = cases.flying((0.4, 0.2, 0.2), (0.0,) * 3, (1.0, 0, 0), inertia=given).scaled(0.25)
    assert np.array_equal(whole.bodies[0].material.inertia, given * 0.25**5)


def test_plan_names_rigid_bodies() -> None:
    said = str(run(cases.tub(contacts.Fluid())).plan)
    assert "rigid bodies" in said and "move:block" in said


def test_tradeoff_of_rigid_beside_elastic() -> None:
    """The same scene with its debris as it is and rigid: error of the peak, steps."""
    elastic = materials.NeoHookean(density=2000.0, youngs_modulus=1e9, poissons_ratio=0.0)
    peak = math.sqrt(1e7 * 0.1 / 0.25 * 120.0)  # v √(k M)
    table = libmpm.advice.tradeoff(
        cases.column(elastic, 1e7, 0.25, 4), {"rigid": [("debris",), ()]}, until=0.02,
        metrics="blow/normal/peak", reference=peak, device="cpu",
        options={"precision": "double"}, progress=False,
    )  # fmt: skip
    rigid, bends = table.to_records()
    assert abs(rigid["error"]) < 0.1 and abs(bends["error"]) < 0.15
    assert rigid["steps"] * 6 < bends["steps"]
    wrong = libmpm.advice.tradeoff(
        cases.column(elastic, 1e7, 0.25, 4), {"rigid": [("debri",)]}, until=0.02,
        metrics="blow/normal/peak", progress=False,
    )  # fmt: skip
    assert "'debri', which is no solid body" in wrong.to_records()[0]["failure"]
