"""Sensors evaluated in Python: bodies, forces, the grid, runs taken apart."""

from __future__ import annotations

import math

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes
from libmpm._src.sensors import body_sensors
from libmpm._src.sensors.step_readings import Moment
from support.sensing_scenes import (
    G,
    add_block,
    add_walls,
    busy_scene,
    column,
    height,
    open_scene,
    same,
    simulate,
)

# Motion of bodies ---------------------------------------------------------------------------------


@pytest.mark.parametrize("scheme", ["APIC", "FLIP"])
def test_a_free_fall_has_its_closed_form_and_no_contact(scheme):
    scene = open_scene(transfer=libmpm.methods.Transfer(scheme=scheme))
    add_block(scene, lower=(0.6, 1.2), upper=(1.0, 1.6), velocity=(0.5, 1.0))
    scene.add_sensor(name="body", sensor=sensors.BodyTracker(body="block", interval=0.02))
    sim = simulate(scene, 0.2)
    series = sim.sensors["body"]
    t, dt = series.time, sim.dt
    # Symplectic steps; velocities without a memory of their own are those of the coming step.
    seen = t if scheme == "FLIP" else t + dt
    start = np.array([100.8, 11.4])
    np.testing.assert_allclose(column(series, "velocity_y"), 1 - G * seen, atol=1e-9)
    np.testing.assert_allclose(column(series, "centroid_x"), start[0] + 0.5 * t, atol=1e-9)
    fallen = start[1] + t - 0.5 * G * t * (t + dt)
    np.testing.assert_allclose(column(series, "centroid_y"), fallen, atol=1e-9)
    mass = 500 * 0.4 * 0.4
    np.testing.assert_allclose(column(series, "momentum_x"), 0.5 * mass, rtol=1e-12)
    force = column(series, "contact_force_y")
    assert np.isnan(force[0])
    assert np.abs(force[1:]).max() < 1e-8 * mass * G
    np.testing.assert_allclose(column(series, "upper_x") - column(series, "lower_x"), 0.35)
    assert np.abs(column(series, "angle")).max() < 1e-9


def test_a_spinning_block_turns_by_its_rate_over_full_turns():
    rate = 12.0
    scene = open_scene(gravity=0.0)
    spin = libmpm.Field(components=(f"-{rate} * (y - 1)", f"{rate} * (x - 1)"))
    stiff = materials.FixedCorotated(density=500.0, youngs_modulus=4e5)
    add_block(scene, lower=(0.7, 0.8), upper=(1.3, 1.2), velocity=spin, material=stiff)
    scene.add_sensor(name="body", sensor=sensors.BodyTracker(body="block", interval=0.01))
    series = simulate(scene, 0.7).sensors["body"]
    angle = column(series, "angle")
    assert angle[-1] > 2 * math.pi
    # The angle is the integral of the rate; both are found from the particles independently.
    omega, t = column(series, "angular_velocity"), series.time
    turned = np.concatenate([[0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * np.diff(t))])
    np.testing.assert_allclose(angle, turned, atol=0.01)


def test_rotations_are_found_from_points():
    rng = np.random.default_rng(4)
    start = rng.normal(size=(50, 3))
    mass = rng.uniform(1, 2, size=50)
    axis = np.array([1.0, -2.0, 0.5]) / math.sqrt(5.25)
    angle = 2.2
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    moment = (start * mass[:, None]).T @ (start @ turn.T)
    (found,) = body_sensors.quaternions(moment[None])
    half = [math.cos(angle / 2), *(math.sin(angle / 2) * axis)]
    np.testing.assert_allclose(found, half, atol=1e-12)
    omega = np.array([0.3, -1.0, 2.0])
    away = start - mass @ start / mass.sum()
    spin = mass @ np.cross(away, np.cross(omega, away))
    squares = (away * mass[:, None]).T @ away
    (spun,) = body_sensors.turn_rates(spin[None], squares[None])
    np.testing.assert_allclose(spun, omega, rtol=1e-12)
    plane = start[:, :2]
    turned = plane @ np.array([[math.cos(2), math.sin(2)], [-math.sin(2), math.cos(2)]])
    moment = (plane * mass[:, None]).T @ turned
    assert body_sensors.angles(moment[None])[0] == pytest.approx(2, abs=1e-12)


def test_gravity_over_time_is_integrated():
    table = libmpm.TimeTable([0.0, 0.1, 0.3], [[0, 0], [0, -10], [0, -4]])
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=table)
    np.testing.assert_allclose(body_sensors.gravity_impulse(scene, 0.05, 0.3), [0, -0.375 - 1.4])


# Forces -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "later"), [("APIC", 1), ("FLIP", 0)])
def test_contact_is_what_load_cells_measure(scheme, later):
    scene = open_scene(transfer=libmpm.methods.Transfer(scheme=scheme))
    add_block(scene, lower=(0.6, 0.05), upper=(1.0, 0.45), velocity=(0.3, -1.0))
    add_walls(scene, boundaries.Separable(static_friction=0.4, dynamic_friction=0.3))
    asked = ("contact_force", "boundary_force")
    scene.add_sensor(name="body", sensor=sensors.BodyTracker(body="block", quantities=asked))
    scene.add_sensor(name="grid", sensor=sensors.GridSensor(attribute="force"))
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls"))
    sim = simulate(scene, 0.15)
    load = sim.sensors["load"].values[:, :2]
    size = np.abs(load).max()
    assert size > 5 * 500 * 0.16 * G
    body, grid = sim.sensors["body"].values, sim.sensors["grid"].values
    # A cell's sample is of the step before; the tracker's of the step to come.
    np.testing.assert_allclose(body[1:, :2][: len(load) - later], -load[later:], atol=1e-9 * size)
    np.testing.assert_allclose(grid[:-1], load, atol=1e-9 * size)
    np.testing.assert_allclose(body[:-1, 2:], -load, atol=1e-9 * size)


KERNELS = {
    "linear": libmpm.methods.Kernel(name="linear"),
    "modified": libmpm.methods.Kernel(name="linear", modified=True),
    "quadratic": libmpm.methods.Kernel(name="quadratic"),
    "cubic": libmpm.methods.Kernel(name="cubic"),
    "ddmp": libmpm.methods.Kernel(name="ddmp"),
}


@pytest.mark.parametrize("name", KERNELS)
def test_shares_of_boundaries_forces_add_up_with_every_kernel(name):
    """What two blocks bear together is what the load cell has; so are their shares of the mass."""
    scene = open_scene(
        transfer=libmpm.methods.Transfer(scheme="FLIP"), kernel=KERNELS[name], cfl=0.1
    )
    add_block(scene, name="lower", lower=(0.6, 0.05), upper=(1.0, 0.25), velocity=(0.3, -1.0))
    add_block(scene, name="upper", lower=(0.6, 0.25), upper=(1.0, 0.45), velocity=(0.3, -1.0))
    add_walls(scene, boundaries.Separable(static_friction=0.4, dynamic_friction=0.3))
    for body in ("lower", "upper"):
        tracker = sensors.BodyTracker(body=body, quantities=("boundary_force",))
        scene.add_sensor(name=body, sensor=tracker)
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="walls"))
    sim = simulate(scene, 0.06)
    moment = Moment(sim)
    place = [sim.particles[b]["position"] - sim.offset for b in ("lower", "upper")]
    mass = [sim.particles[b]["mass"] for b in ("lower", "upper")]
    nodes = moment.nodes
    (share,) = nodes.spread(np.concatenate(place), [np.concatenate(mass)])
    np.testing.assert_allclose(share, nodes.mass, rtol=1e-6, atol=1e-9 * nodes.mass.max())
    load = sim.sensors["load"].values[:, :2]
    size = np.abs(load).max()
    assert size > 500 * 0.16 * G
    both = sim.sensors["lower"].values + sim.sensors["upper"].values
    np.testing.assert_allclose(both[:-1], -load, atol=1e-6 * size)


def test_blocks_at_rest_bear_their_weights():
    scene = open_scene(transfer=libmpm.methods.Transfer(scheme="PIC"))
    add_block(scene, name="lower", lower=(0.6, 0.0), upper=(1.0, 0.4))
    add_block(scene, name="upper", lower=(0.6, 0.4), upper=(1.0, 0.7))
    add_walls(scene, boundaries.Separable())
    asked = ("contact_force", "boundary_force")
    for name in ("lower", "upper"):
        tracker = sensors.BodyTracker(body=name, quantities=asked, interval=0.1)
        scene.add_sensor(name=name, sensor=tracker)
    sim = simulate(scene, 2.0)
    weight = {"lower": 500 * 0.16 * G, "upper": 500 * 0.12 * G}
    last = {
        name: dict(zip(s.components, s.values[-1], strict=True)) for name, s in sim.sensors.items()
    }
    for name in weight:
        assert last[name]["contact_force_y"] == pytest.approx(weight[name], rel=0.01)
    assert last["upper"]["boundary_force_y"] == pytest.approx(0, abs=1e-6)
    # The floor bears both; what the lower block has beyond its weight is the upper one's push.
    assert last["lower"]["boundary_force_y"] == pytest.approx(sum(weight.values()), rel=0.01)
    push = last["lower"]["contact_force_y"] - last["lower"]["boundary_force_y"]
    assert push == pytest.approx(-last["upper"]["contact_force_y"], rel=0.01)


# The grid -----------------------------------------------------------------------------------------


def test_grid_sensors_reduce_nodes_with_signs():
    scene = busy_scene()
    region = shapes.Box(lower=(0.3, 0.2), upper=(1.2, 1.0))
    made = {}
    for operation in ("sum", "mean", "min", "max", "std", "variance", "range", "count"):
        for direction in ("x", "x+", "y-"):
            made[f"{operation} {direction}"] = sensors.GridSensor(
                attribute="velocity", operation=operation, direction=direction, region=region
            )
    made["mass"] = sensors.GridSensor(attribute="mass")
    made["filled"] = sensors.GridSensor(attribute="volume")
    made["ratio"] = sensors.GridSensor(attribute="jbar", operation="max")
    made["momentum"] = sensors.GridSensor(attribute="momentum")
    dry = shapes.Box(lower=(1.5, 1.5), upper=(1.9, 1.9))
    made["none"] = sensors.GridSensor(attribute="mass", operation="mean", region=dry)
    made["no force"] = sensors.GridSensor(attribute="force", operation="count", region=dry)
    for name, sensor in made.items():
        scene.add_sensor(name=name, sensor=sensor)
    sim = simulate(scene)
    sim.step(40)
    place = sim.grid["position"] - np.array(scene.origin)
    inside = np.all((place > region.lower) & (place < region.upper), axis=1)
    v = sim.grid["velocity"][inside]
    chosen = {"x": v[:, 0], "x+": v[v[:, 0] > 0, 0], "y-": v[v[:, 1] < 0, 1]}
    rules = {"sum": np.sum, "mean": np.mean, "min": np.min, "max": np.max, "std": np.std,
             "variance": np.var, "range": np.ptp, "count": len}  # fmt: skip
    assert 0 < len(chosen["x+"]) < len(v)
    for name in made:
        operation, _, direction = name.partition(" ")
        if direction in chosen:
            want = rules[operation](chosen[direction])
            assert sim.sensors[name].values[-1, 0] == pytest.approx(want, rel=1e-12)
    total = sum(float(p["mass"].sum()) for p in sim.particles.values())
    volume = sum(float(p["volume"].sum()) for p in sim.particles.values())
    assert sim.sensors["mass"].values[-1, 0] == pytest.approx(total, rel=1e-12)
    # Walls are on cell faces: particles beside them leave shares to nodes outside, with mass too.
    assert sim.sensors["filled"].values[-1, 0] == pytest.approx(volume, rel=1e-12)
    ratios = np.concatenate([p["volume_ratio"] for p in sim.particles.values()])
    assert ratios.min() < sim.sensors["ratio"].values[-1, 0] <= ratios.max()
    momentum = sim.grid["mass"] @ sim.grid["velocity"]
    np.testing.assert_allclose(sim.sensors["momentum"].values[-1], momentum, rtol=1e-10)
    assert np.isnan(sim.sensors["none"].values[-1, 0])
    assert sim.sensors["no force"].values[-1].tolist() == [0, 0]


def test_acceleration_is_that_of_gravity_in_free_fall():
    scene = open_scene()
    add_block(scene, lower=(0.6, 1.0), upper=(1.0, 1.6))
    for operation in ("min", "max"):
        sensor = sensors.GridSensor(attribute="acceleration", operation=operation, interval=0.003)
        scene.add_sensor(name=operation, sensor=sensor)
    sim = simulate(scene, 0.03)
    for series in sim.sensors.values():
        assert np.isnan(series.values[0]).all()
        np.testing.assert_allclose(series.values[1:], [[0, -G]] * (len(series) - 1), atol=1e-8)


# Times, portions, checkpoints ---------------------------------------------------------------------


def test_samples_fall_on_the_first_boundaries_and_change_no_bit():
    scene = busy_scene()
    sim = simulate(scene, 0.1)
    body, dt = sim.sensors["body"], sim.dt
    late = body.time - 0.007 * np.arange(len(body))
    assert len(body) == 15
    assert late.min() >= -1e-12
    assert late.max() < dt
    assert len(sim.sensors["speed"]) == sim.steps + 1
    bare = busy_scene().to_dict()
    bare["sensors"] = []
    plain = simulate(libmpm.Scene.from_dict(bare), 0.1)
    for name, view in sim.particles.items():
        for attribute in ("position", "velocity", "stress"):
            np.testing.assert_array_equal(view[attribute], plain.particles[name][attribute])


def test_portions_and_resumed_runs_have_the_same_series(tmp_path):
    whole = simulate(busy_scene(), 0.1)
    split = simulate(busy_scene(), output=libmpm.Output(tmp_path / "run"))
    split.step(13)
    split.run(until=0.04, progress=False)
    split.step(5)
    split.save_checkpoint(tmp_path / "state.npz")
    split.run(until=0.1, progress=False)
    same(whole, split)
    split.close()
    resumed = libmpm.Simulation.resume(tmp_path / "state.npz")
    resumed.run(until=0.1, progress=False)
    same(whole, resumed)
    from libmpm._src.output.sensor_file import read_sensors

    stored = read_sensors(tmp_path / "run" / "sensors.h5")
    np.testing.assert_array_equal(stored["body"].values, whole.sensors["body"].values)
    text = (tmp_path / "run" / "csv" / "body.csv").read_text().splitlines()
    assert text[0].startswith("time [s],centroid_x [m],")
    assert len(text) == 1 + len(stored["body"])


def test_scenes_with_sensors_round_trip(tmp_path):
    scene = busy_scene()
    scene.save(tmp_path / "scene.json")
    assert libmpm.Scene.load(tmp_path / "scene.json") == scene


# Other scenes -------------------------------------------------------------------------------------


@pytest.mark.parametrize("largest", [1 << 25, 0])
def test_what_bodies_share_of_nodes_is_their_mass(monkeypatch, largest):
    from libmpm._src.sensors import step_readings as moment

    monkeypatch.setattr(moment, "_LARGEST_TABLE", largest)
    sim = simulate(busy_scene())
    sim.step(40)
    nodes = moment.Nodes(sim)
    shares = np.zeros(len(nodes.mass))
    for view in sim.particles.values():
        relative = view["position"] - sim.offset
        shares += nodes.spread(relative, [view["mass"]])[0]
    # The engine deposits each particle with the weights of the place that it has just come to.
    np.testing.assert_allclose(shares, nodes.mass, rtol=1e-9, atol=1e-9 * nodes.mass.max())
    np.testing.assert_array_equal(nodes.find(nodes.cell), np.arange(len(nodes.mass)))
    assert (nodes.find(nodes.cell + 1000) == -1).all()


def test_branches_go_on_with_the_sensors_of_their_trunk(tmp_path):
    trunk = simulate(busy_scene(), 0.05)
    trunk.save_checkpoint(tmp_path / "trunk.npz")
    scene = libmpm.Scene.from_checkpoint(tmp_path / "trunk.npz")
    late = sensors.BodyTracker(body="block", quantities=("orientation", "contact_force"))
    scene.add_sensor(name="late", sensor=late)
    scene.add_sensor(name="mine", sensor=sensors.Custom(function=height, columns="top"))
    branch = simulate(scene, 0.1)
    whole = simulate(busy_scene(), 0.1)
    same(whole, branch)
    series = branch.sensors["late"]
    assert series.time[0] == trunk.time
    assert series.values[0, 0] == 0
    assert np.isnan(series.values[0, 1:]).all()
    assert len(series) == branch.steps - trunk.steps + 1


@pytest.mark.parametrize("leaving", ["freeze", "delete"])
def test_particles_that_have_left_count_no_more(leaving):
    scene = open_scene(gravity=0.0, leaving=leaving)
    add_block(scene, name="leaves", lower=(0.1, 0.5), upper=(0.5, 0.9), velocity=(-4.0, 0.0))
    add_block(scene, name="stays", lower=(1.4, 0.5), upper=(1.8, 0.9))
    for name in ("leaves", "stays"):
        scene.add_sensor(name=name, sensor=sensors.BodyTracker(body=name, interval=0.01))
        count = sensors.ParticleSensor(attribute="Mass", operation="count", body=name)
        scene.add_sensor(name=f"{name} count", sensor=count)
    with pytest.warns(libmpm.ModelWarning, match="left the domain"):
        sim = simulate(scene, 0.2)
    count = sim.sensors["leaves count"].values[:, 0]
    assert count[0] == 64
    assert count[-1] == 0
    assert (sim.sensors["stays count"].values == 64).all()
    assert np.isnan(sim.sensors["leaves"].values[-1]).all()
    assert not np.isnan(sim.sensors["stays"].values[1:]).any()
    # A loss of particles is no force.
    force = column(sim.sensors["leaves"], "contact_force_x")
    assert np.nanmax(np.abs(force)) < 1e-6
    assert np.isnan(force).sum() > 1


def test_grids_of_functions_have_particle_sensors_only():
    mesh = grids.Mesh.blocks(columns=4, rows=2, lower=(0, 0), upper=(2, 1))
    scene = libmpm.Scene(grid=grids.TriangularGrid(mesh=mesh), gravity=(0.0, -G))
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(0.5, 0.3), upper=(1.5, 0.8)),
        material=materials.LinearElastic(density=500.0, youngs_modulus=1e5),
    )
    scene.add_sensor(name="body", sensor=sensors.BodyTracker(body="bar"))
    scene.add_sensor(name="top", sensor=sensors.ParticleSensor(attribute="Elevation"))
    sim = simulate(scene)
    sim.step(20)
    assert column(sim.sensors["body"], "velocity_y")[-1] == pytest.approx(-G * sim.time, rel=1e-6)
    scene.add_sensor(name="grid", sensor=sensors.GridSensor())
    with pytest.raises(libmpm.SceneError, match=r"'grid'.*no nodes that carry mass"):
        scene.validate()


def test_sensors_of_what_has_left_read_nothing():
    """No particle is left: zero mass, no velocity, and the run goes on."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1),
        method=libmpm.Method(leaving="delete"),
    )  # fmt: skip
    scene.add_body(
        name="block", shape=shapes.Box(lower=(0.7, 0.4), upper=(0.9, 0.6)), velocity=(5.0, 0.0),
        material=materials.FixedCorotated(density=1000, youngs_modulus=1e5, poissons_ratio=0.3),
    )  # fmt: skip
    mass = sensors.GridSensor(attribute="mass", operation="sum", interval=0.02)
    scene.add_sensor(name="mass", sensor=mass)
    tracker = sensors.AttributeTracker(
        body="block", ids=[0], attributes=["velocity"], interval=0.02
    )
    scene.add_sensor(name="track", sensor=tracker)
    simulation = libmpm.Simulation(scene, device="cpu")
    with pytest.warns(libmpm.ModelWarning, match="left"):
        simulation.run(until=0.15, progress=False)
    assert simulation.sensors["mass"].values[0] == pytest.approx(40.0)
    assert simulation.sensors["mass"].values[-1] == 0.0
    assert np.isnan(simulation.sensors["track"].values[-1]).all()


def stacked(interval=0.0, **changes):
    """A block on a block on the floor, water beside both."""
    scene = libmpm.Scene(
        dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2), gravity=(0, -9.81), **changes
    )
    # A wall of linear cells acts on what is two cells off, as the upper block is in the end.
    walls = boundaries.Slip(cell="held")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    for name, density, low, high in (
        ("lower", 500, (0.5, 0.0), (1.1, 0.4)), ("upper", 800, (0.6, 0.4), (1.0, 0.7)),
    ):  # fmt: skip
        law = materials.FixedCorotated(density=density, youngs_modulus=1e5, poissons_ratio=0.3)
        scene.add_body(name=name, shape=shapes.Box(lower=low, upper=high), material=law)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(1.1, 0), upper=(2, 0.6)),
        material=materials.TaitFluid(density=1000, bulk_modulus=1e5),
    )  # fmt: skip
    for one in ("lower", "upper", "water"):
        for other in ("lower", "upper", "water"):
            if one != other:
                force = sensors.ContactForce(body=one, by=other, interval=interval)
                scene.add_sensor(name=f"{one}-{other}", sensor=force)
    return scene


@pytest.mark.parametrize("precision", ["single", "double"])
def test_contact_forces_are_opposite_and_change_the_momentum(precision):
    """Of a pair to rounding; those on a body that touches no wall add up to all that it feels."""
    scene = stacked()
    track = sensors.BodyTracker(body="upper", quantities=("contact_force",), interval=0.0)
    scene.add_sensor(name="all", sensor=track)
    simulation = libmpm.Simulation(scene, device="cpu", precision=precision)
    simulation.step(200)
    size = 1e-9 if precision == "double" else 1e-4
    found = {s.name: simulation.sensors[s.name] for s in scene.sensors}
    weight = 0.4 * 0.3 * 800 * 9.81
    for one, other in (("lower", "upper"), ("lower", "water"), ("upper", "water")):
        there, back = found[f"{one}-{other}"].values, found[f"{other}-{one}"].values
        np.testing.assert_allclose(there, -back, atol=size * weight)
    on_upper = found["upper-lower"].values + found["upper-water"].values
    assert np.abs(on_upper).max() > 0.5 * weight
    # What a body feels from one sample of its velocities to the next is what the step between
    # gave it.
    felt = found["all"]
    at = np.searchsorted(felt.time, found["upper-lower"].time)
    np.testing.assert_allclose(on_upper[1:], felt.values[at][1:], atol=20 * size * weight)


def test_contact_force_carries_the_weight_at_rest():
    scene = stacked(interval=0.05, method=libmpm.Method(transfer="APIC"))
    simulation = libmpm.Simulation(scene, device="cpu")
    simulation.run(until=3.0, progress=False)
    force = simulation.sensors["upper-lower"]
    assert len(force) == pytest.approx(61, abs=1)
    half = len(force) // 2
    assert force.values[half:, 1].mean() == pytest.approx(0.4 * 0.3 * 800 * 9.81, rel=0.05)


def test_contact_force_of_a_resumed_run_is_that_of_a_whole_one(tmp_path):
    """Also when the run is parted between the two steps of a sample."""
    whole = libmpm.Simulation(stacked(interval=0.01), device="cpu", precision="double")
    whole.step(60)
    first = libmpm.Simulation(stacked(interval=0.01), device="cpu", precision="double")
    for _ in range(30):
        first.step(1)
        first.save_checkpoint(tmp_path / "part.npz")
        first = libmpm.Simulation.resume(tmp_path / "part.npz")
    first.step(30)
    for name in ("upper-lower", "water-upper"):
        np.testing.assert_array_equal(first.sensors[name].time, whole.sensors[name].time)
        np.testing.assert_array_equal(first.sensors[name].values, whole.sensors[name].values)


def test_contact_force_is_refused_where_it_means_nothing():
    scene = stacked(method=libmpm.Method(transfer=libmpm.methods.Transfer(scheme="FLIP")))
    with pytest.raises(libmpm.SceneError, match="APIC on quadratic splines"):
        scene.validate()
