"""Inflow and outflow: supply at a stated rate and level, removal, the bore behind a broken dam."""

import json

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.output.sensor_file import read_sensors

LEVEL, SPEED, CELL = 0.3, 0.5, 0.05
LENGTH = 1.0


def channel(dimension=2, *, draws=SPEED, level=LEVEL, speed=SPEED, **body):
    """Return a channel of 20 cells in which water runs from an inlet to an outlet."""
    middle = (0.1,) * (dimension - 2)
    low = (0.0,) * dimension
    scene = libmpm.Scene(
        dimension=dimension, cell_size=CELL, lower=low, upper=(LENGTH, *middle, 0.5),
        gravity=(*low[:-1], -9.81),
    )  # fmt: skip
    first = speed if isinstance(speed, float) else 0.0
    scene.add_body(
        name="water", shape=shapes.Box(lower=low, upper=(LENGTH, *middle, level)),
        material=materials.TaitFluid(bulk_modulus=1e5), velocity=(first, *low[1:]),
        hydrostatic=level, **body,
    )  # fmt: skip
    faces = ("y-",) if dimension == 2 else ("y-", "y+", "z-")
    wall = shapes.DomainWalls(faces=faces)
    scene.add_boundary(name="walls", shape=wall, response=boundaries.Slip())
    inlet = boundaries.Inflow(body="water", face="x-", velocity=speed, level=level)
    scene.add_flow(name="inlet", flow=inlet)
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=draws))
    return scene


def simulate(scene, until=None, **options):
    """Return a simulation on the CPU, advanced to a time."""
    simulation = libmpm.Simulation(scene, device="cpu", **({"threads": 1} | options))
    if until is not None:
        simulation.run(until=until, progress=False)
    return simulation


def last(series):
    """Return the totals of a series of flow."""
    return series.values[-1] if len(series) else np.zeros(3)


def balance(simulation, before):
    """Return supplied - removed - change of the number of particles."""
    change = simulation.particle_count(0) - before
    return last(simulation.inflow["inlet"])[0] - last(simulation.outflow["outlet"])[0] - change


def state(simulation):
    """Return ids, positions and pressures in the order of the ids."""
    water = simulation.particles["water"]
    order = np.argsort(water["id"])
    return [water[name][order] for name in ("id", "position", "velocity", "pressure")]


@pytest.mark.parametrize("case", [(0.5180, 0.20), (0.6170, 0.10), (0.5180, 0.15)])
def test_riemann_inlet(case):
    """Table 5.3 of Yang (2016), and the bore speed that goes with mass conservation."""
    printed = {
        (0.5180, 0.20): (0.3384, 0.8645, 2.1138),
        (0.6170, 0.10): (0.2903, 1.5454, 2.3574),
        (0.5180, 0.15): (0.3022, 1.0648, 2.1140),
    }[case]
    bore = boundaries.riemann_inlet(*case)
    np.testing.assert_allclose((bore.depth, bore.velocity, bore.speed), printed, atol=5e-5)
    with pytest.raises(libmpm.SceneError, match="deeper reservoir"):
        boundaries.riemann_inlet(*case[::-1])


@pytest.mark.parametrize("dimension", [2, 3])
def test_steady_current(dimension):
    """Level within half a cell and velocity within 2 % after two transits; mass to the particle."""
    scene = channel(dimension)
    simulation = simulate(scene)
    before = simulation.particle_count(0)
    simulation.run(until=2 * LENGTH / SPEED + 0.02, progress=False)
    water = simulation.particles["water"]
    position, velocity = water["position"], water["velocity"]
    assert len(np.unique(water["id"])) == len(position) == simulation.particle_count(0)
    inner = (position[:, 0] > 0.25) & (position[:, 0] < 0.75)
    for low in np.arange(0.2, 0.8, CELL):
        column = position[(position[:, 0] >= low) & (position[:, 0] < low + CELL), -1]
        # Half a particle lies above the highest one's centre.
        assert column.max() + CELL / 4 == pytest.approx(LEVEL, abs=CELL / 2)
    assert velocity[inner, 0].mean() == pytest.approx(SPEED, rel=0.02)
    assert np.abs(velocity[inner, 1:]).max() < 0.02 * SPEED
    layer = 12 * (1 if dimension == 2 else 4)
    assert balance(simulation, before) == 0
    assert abs(simulation.particle_count(0) - before) <= layer
    # rho u A t, to a layer.
    supplied = last(simulation.inflow["inlet"])[1]
    area = LEVEL * (1 if dimension == 2 else 0.1)
    width = CELL / 2
    assert supplied == pytest.approx(1000 * SPEED * area * simulation.time, abs=1000 * area * width)


def test_current_that_begins():
    """The supply follows a table of time: its integral, to a layer."""
    rise = libmpm.TimeTable([0.0, 0.4], [0.0, SPEED])
    # Not when a layer is just due: steps of 2 ms follow the rise to half a millimetre.
    simulation = simulate(channel(speed=rise, draws=rise), until=1.02)
    moved = 0.5 * 0.4 * SPEED + 0.62 * SPEED
    particles = last(simulation.inflow["inlet"])[0]
    assert particles % 12 == 0
    assert particles / 12 * CELL / 2 == pytest.approx(moved, abs=CELL / 2)


def test_layers_go_on_where_those_before_stood():
    """Where led nodes alone move them, particles stand on one lattice, whenever they came."""
    simulation = simulate(channel(), until=0.51, precision="double")
    x = simulation.particles["water"]["position"]
    rows = x[(x[:, 0] < 2 * CELL) & (x[:, 1] < CELL / 2)]
    spacing = np.diff(np.sort(rows[:, 0]))
    assert len(spacing) >= 3
    np.testing.assert_allclose(spacing, CELL / 2, rtol=1e-10)


@pytest.mark.parametrize(
    "options", [{}, {"precision": "double"}, {"pipeline": "two-pass"}, {"pipeline": "phased"}]
)
def test_bits(tmp_path, options):
    """Threads, portions and checkpoints change no bit, and no row of the series."""
    until = 0.3
    one = simulate(channel(), until, **options)
    other = simulate(channel(), until, **(options | {"threads": 2}))
    parts = simulate(channel(), **options)
    while parts.steps < one.steps:
        parts.step(min(7, one.steps - parts.steps))
    begun = simulate(channel(), **options)
    begun.step(61)
    begun.save_checkpoint(tmp_path / "state.npz")
    resumed = libmpm.Simulation.resume(tmp_path / "state.npz")
    resumed.run(until=until, progress=False)
    assert last(one.inflow["inlet"])[0] > 0 and last(one.outflow["outlet"])[0] > 0
    for simulation in (other, parts, resumed):
        for a, b in zip(state(one), state(simulation), strict=True):
            np.testing.assert_array_equal(a, b)
        for a, b in zip(one.flow_series(), simulation.flow_series(), strict=True):
            np.testing.assert_array_equal(a.time, b.time)
            np.testing.assert_array_equal(a.values, b.values)


@pytest.mark.parametrize("per_cell", [1, 9])
def test_particles_per_cell(per_cell):
    """Layers as far apart as a cell, or three to a cell, supply the same mass."""
    scene = channel(particles_per_cell=per_cell)
    simulation = simulate(scene)
    before = simulation.particle_count(0)
    simulation.run(until=1.02, progress=False)
    assert balance(simulation, before) == 0
    supplied = last(simulation.inflow["inlet"])[1]
    layer = 1000 * LEVEL * CELL / per_cell**0.5
    assert supplied == pytest.approx(1000 * SPEED * LEVEL * simulation.time, abs=layer)
    assert simulation.particles["water"]["velocity"][:, 0].mean() == pytest.approx(SPEED, rel=0.02)


@pytest.mark.parametrize("scheme", ["FLIP", "XPIC"])
def test_transfers_that_store_velocities(scheme):
    """New particles bring the velocity of the inlet with them."""
    scene = channel()
    method = libmpm.Method(transfer=libmpm.methods.Transfer(scheme=scheme))
    moved = libmpm.Scene.from_dict(scene.to_dict() | {"method": method.to_dict()})
    simulation = simulate(moved, until=2.0)
    velocity = simulation.particles["water"]["velocity"]
    np.testing.assert_allclose(velocity[:, 0], SPEED, rtol=0.02)


def test_free_overfall():
    """What falls off the end is counted; other faces keep their policy."""
    scene = channel(draws=None, speed=1.5)
    simulation = simulate(scene)
    before = simulation.particle_count(0)
    simulation.run(until=1.0, progress=False)
    assert balance(simulation, before) == 0
    outflow = simulation.outflow["outlet"]
    assert outflow.components == ("particles", "mass", "volume")
    assert np.all(np.diff(outflow.values[:, 0]) > 0)
    # Supercritical water leaves as fast as it comes, or faster.
    rate = np.polyfit(outflow.time[-20:], outflow.values[-20:, 2], 1)[0]
    assert 0.9 * 1.5 * LEVEL < rate < 1.5 * 1.5 * LEVEL


def test_other_faces_keep_their_policy():
    """With leaving="stop", one particle through another face still ends the run."""
    scene = libmpm.Scene(dimension=2, cell_size=CELL, lower=(0, 0), upper=(1, 0.5))
    box = shapes.Box(lower=(0.8, 0.1), upper=(1.0, 0.3))
    solid = materials.FixedCorotated(density=500.0, youngs_modulus=1e5)
    scene.add_body(name="block", shape=box, material=solid, velocity=(1.0, 0.0))
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x+"))
    simulation = simulate(scene, until=0.3)
    assert simulation.particle_count(0) == 0
    np.testing.assert_allclose(last(simulation.outflow["outlet"]), (64, 20.0, 0.04))
    up = libmpm.Scene.from_dict(json.loads(json.dumps(scene.to_dict())) | {"gravity": [0.0, 60.0]})
    with pytest.raises(libmpm.NumericalError, match="left the domain"):
        simulate(up, until=2.0)


def test_inlet_above_a_bed():
    """Layers keep out of the bed, and supply rho u times the wetted area."""
    bed = shapes.Box(lower=(-1.0, -1.0), upper=(2.0, 0.1))
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(0, 0), upper=(1.0, 0.5), gravity=(0, -9.81)
    )
    water = shapes.Box(lower=(0, 0.1), upper=(1.0, LEVEL))
    scene.add_body(
        name="water", shape=water, material=materials.TaitFluid(bulk_modulus=1e5),
        velocity=(SPEED, 0.0), hydrostatic=LEVEL,
    )  # fmt: skip
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    inlet = {"body": "water", "face": "x-", "velocity": SPEED, "level": LEVEL}
    scene.add_flow(name="inlet", flow=boundaries.Inflow(**inlet, bed=bed))
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=SPEED))
    simulation = simulate(scene, until=1.02)
    area = LEVEL - 0.1
    supplied = last(simulation.inflow["inlet"])[1]
    assert supplied == pytest.approx(1000 * SPEED * area * 1.02, abs=1000 * area * CELL / 2)
    velocity = simulation.particles["water"]["velocity"]
    assert velocity[:, 0].mean() == pytest.approx(SPEED, rel=0.02)
    assert simulation.particles["water"]["position"][:, 1].min() > 0.1


def test_upper_face_and_side_by_side_bodies():
    """From x+ the water comes the other way; ids of the next body do not meet those supplied."""
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(0, 0), upper=(1.1, 0.5), gravity=(0, -9.81)
    )
    fluid = materials.TaitFluid(bulk_modulus=1e5)
    for name, low, high in (("far", 0.0, 0.5), ("near", 0.5, 1.1)):
        scene.add_body(
            name=name, shape=shapes.Box(lower=(low, 0.0), upper=(high, LEVEL)), material=fluid,
            velocity=(-SPEED, 0.0), hydrostatic=LEVEL,
        )  # fmt: skip
    wall = shapes.DomainWalls(faces=("y-",))
    scene.add_boundary(name="floor", shape=wall, response=boundaries.Slip())
    inlet = boundaries.Inflow(body="near", face="x+", velocity=SPEED, level=LEVEL)
    scene.add_flow(name="inlet", flow=inlet)
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x-", velocity=SPEED))
    simulation = simulate(scene, until=1.5)
    near, far = simulation.particles["near"], simulation.particles["far"]
    assert len(near["id"]) + len(far["id"]) == 22 * 24
    assert len(np.intersect1d(near["id"], far["id"])) == 0
    assert near["velocity"][:, 0].mean() == pytest.approx(-SPEED, rel=0.02)


def test_bore():
    """A bore runs into still water as the shallow-water equations have it (Yang 2016, case 1)."""
    bore = boundaries.riemann_inlet(0.5180, 0.20)
    cell, length = 0.025, 4.0
    scene = libmpm.Scene(
        dimension=2, cell_size=cell, lower=(0, 0), upper=(length, 0.6), gravity=(0, -9.81)
    )
    fluid = materials.TaitFluid(bulk_modulus=6e5)
    zone = 3 * cell
    for name, low, high, level, speed in (
        ("inflow", 0.0, zone, bore.depth, bore.velocity),
        ("flume", zone, length, 0.20, 0.0),
    ):
        scene.add_body(
            name=name, shape=shapes.Box(lower=(low, 0.0), upper=(high, level)), material=fluid,
            velocity=(speed, 0.0), hydrostatic=level,
        )  # fmt: skip
    wall = shapes.DomainWalls(faces=("y-", "x+"))
    scene.add_boundary(name="walls", shape=wall, response=boundaries.Slip())
    flow = boundaries.Inflow(body="inflow", face="x-", velocity=bore.velocity, level=bore.depth)
    scene.add_flow(name="inlet", flow=flow)
    simulation = simulate(scene)
    fronts = []
    # Until it has taken its form, its front is steeper and slower.
    for time in (0.8, 1.6):
        simulation.run(until=time, progress=False)
        bodies = [simulation.particles[name] for name in ("inflow", "flume")]
        position = np.concatenate([b["position"] for b in bodies])
        velocity = np.concatenate([b["velocity"][:, 0] for b in bodies])
        # Volume of water over columns of two cells: the level; the first may lack a layer.
        column = np.minimum((position[:, 0] / (2 * cell)).astype(int), 79)
        areas = np.concatenate([b["volume"] for b in bodies])
        level = np.bincount(column, areas, 80) / (2 * cell)
        half = 0.5 * (0.20 + bore.depth)
        k = 2 + int(np.argmax(level[2:] < half))
        share = (level[k - 1] - half) / (level[k - 1] - level[k])
        fronts.append((k - 0.5 + share) * 2 * cell)
    speed = (fronts[1] - fronts[0]) / 0.8
    assert speed == pytest.approx(bore.speed, rel=0.05)
    behind = (position[:, 0] > 0.3) & (position[:, 0] < fronts[-1] - 0.3)
    assert velocity[behind].mean() == pytest.approx(bore.velocity, rel=0.05)
    inner = level[6 : int((fronts[-1] - 0.3) / (2 * cell))]
    assert inner.mean() == pytest.approx(bore.depth, abs=cell / 2)


def test_scene_and_plan():
    """Flows round-trip through JSON, and the plan says what they do; other scenes have no trace."""
    scene = channel(3)
    again = libmpm.Scene.from_dict(json.loads(json.dumps(scene.to_dict())))
    assert again == scene and [p.name for p in again.flows] == ["inlet", "outlet"]
    plan = scene.plan(device="cpu")
    assert "48 particles into 'water' every 0.025 m" in str(plan)
    assert "supply:inlet (when a layer is due)" in plan.kernels
    bare = libmpm.Scene.from_dict({k: v for k, v in scene.to_dict().items() if k != "flows"})
    assert bare != scene and "flows" not in bare.to_dict()
    assert "supply" not in str(bare.plan(device="cpu"))
    assert plan.memory_total == bare.plan(device="cpu").memory_total


def test_output(tmp_path):
    """The series of flows are written beside those of sensors; what left is no warning."""
    output = libmpm.Output(tmp_path / "run")
    simulation = libmpm.Simulation(channel(), device="cpu", threads=1, output=output)
    with simulation:
        simulation.run(until=0.4, progress=False)
    written = read_sensors(tmp_path / "run" / "sensors.h5")
    for name, series in (simulation.inflow | simulation.outflow).items():
        np.testing.assert_array_equal(written[name].values, series.values)
    assert not (tmp_path / "run" / "removed.csv").exists()


def test_max_particles():
    """A body that is full ends the run by name, with its state whole."""
    scene = channel()
    data = scene.to_dict()
    data["flows"][0]["flow"]["max_particles"] = 500
    simulation = simulate(libmpm.Scene.from_dict(data))
    with pytest.raises(libmpm.CapacityError, match=r"'inlet'.*500.*max_particles"):
        simulation.run(until=1.0, progress=False)
    assert simulation.particle_count(0) <= 500
    assert np.all(np.isfinite(simulation.particles["water"]["position"]))


@pytest.mark.parametrize(
    ("flow", "text"),
    [
        ({"velocity": -1.0}, "velocity is -1"),
        ({"face": "z-"}, "face is 'z-' in 2D"),
        ({"face": "y-"}, "wall of boundary 'walls'"),
        ({"body": "wine"}, "body 'wine' is unknown"),
        ({"level": 0.7}, "level is 0.7 m"),
        ({"zone": 1}, "zone is 1"),
        ({"zone": 40}, "zone is 40 cells"),
        ({"face": "x+"}, "one flow a face"),
        ({"max_particles": 2**33}, "max_particles"),
        ({"bed": shapes.Box(lower=(-1, -1), upper=(2, 2))}, "no point of its layers"),
    ],
)
def test_refusals(flow, text):
    """Errors name the flow, the value and the rule."""
    given = {"body": "water", "face": "x-", "velocity": SPEED, "level": LEVEL} | flow
    scene = channel()
    bare = libmpm.Scene.from_dict({k: v for k, v in scene.to_dict().items() if k != "flows"})
    bare.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=SPEED))
    with pytest.raises(libmpm.SceneError, match=text):
        bare.add_flow(name="inlet", flow=boundaries.Inflow(**given))
        bare.validate()


def test_ids_of_bodies_beside_one_that_grows():
    """Trackers follow ids that are still to come, and those of the body behind all of them."""
    scene = channel()
    solid = materials.FixedCorotated(density=500.0, youngs_modulus=1e5)
    box = shapes.Box(lower=(0.5, 0.4), upper=(0.6, 0.5))
    scene.add_body(name="float", shape=box, material=solid)
    room = 2**32 - 257
    with pytest.raises(libmpm.SceneError, match="'water', 0 to 4294967038"):
        wrong = libmpm.Scene.from_dict(scene.to_dict())
        tracker = sensors.ParticleTracker(body="water", ids=(room,))
        wrong.add_sensor(name="track", sensor=tracker)
        wrong.validate()
    with pytest.raises(libmpm.SceneError, match="ids is 'all' of body 'water'"):
        wrong = libmpm.Scene.from_dict(scene.to_dict())
        wrong.add_sensor(name="track", sensor=sensors.ParticleTracker(body="water", ids="all"))
        wrong.validate()
    later, beside = 480 + 5, room + 2
    for name, ids in (("water", (later,)), ("float", (beside,))):
        tracker = sensors.ParticleTracker(body=name, ids=ids, interval=0.05)
        scene.add_sensor(name=name, sensor=tracker)
    simulation = simulate(scene, until=0.21)
    supplied = simulation.inflow["inlet"].time[0]
    for name in ("water", "float"):
        x = simulation.sensors[name].values[:, 0]
        came = simulation.sensors[name].time >= (supplied if name == "water" else 0.0)
        np.testing.assert_array_equal(np.isfinite(x), came)
    assert simulation.particles["float"]["id"].min() == room


@pytest.mark.gpu
@pytest.mark.parametrize("options", [{}, {"precision": "mixed"}, {"pipeline": "phased"}])
def test_device(tmp_path, options):
    """A device supplies and removes the same particles, and its own bits again when resumed."""
    scene, until = channel(3), 0.5
    host = simulate(scene, until, precision="double")
    device = libmpm.Simulation(scene, device="cuda", **options)
    before = device.particle_count(0)
    device.run(until=until, progress=False)
    assert device.steps == host.steps and balance(device, before) == 0
    for a, b in zip(host.flow_series(), device.flow_series(), strict=True):
        np.testing.assert_array_equal(a.values[-1], b.values[-1])
    ids, position, _, _ = state(device)
    np.testing.assert_array_equal(ids, state(host)[0])
    # Positions in single precision: rounding of a cell's fraction over some hundred steps.
    np.testing.assert_allclose(position, state(host)[1], atol=1e-4 * CELL)
    part = libmpm.Simulation(scene, device="cuda", **options)
    part.step(101)
    part.save_checkpoint(tmp_path / "state.npz")
    resumed = libmpm.Simulation.resume(tmp_path / "state.npz")
    resumed.run(until=until, progress=False)
    for a, b in zip(state(device), state(resumed), strict=True):
        np.testing.assert_array_equal(a, b)


def test_body_must_fill_the_zone():
    """Water that begins behind the face is refused."""
    data = channel().to_dict()
    data["bodies"][0]["shape"]["lower"] = [0.2, 0.0]
    with pytest.raises(libmpm.SceneError, match="does not fill the zone"):
        libmpm.Scene.from_dict(data).validate()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("at", [0.0, 0.3, 0.4, 0.8])
def test_layers_start_at_the_face(dimension, at):
    """A boundary at the face is in their way; one downstream is not, wherever it is."""
    scene = channel(dimension)
    thing = shapes.Sphere(centre=(at,) + (0.1,) * (dimension - 1), radius=0.1)
    data = scene.to_dict()
    data["bodies"][0]["shape"] = (scene.bodies[0].shape - thing).to_dict()
    scene = libmpm.Scene.from_dict(data)
    scene.add_boundary(name="thing", shape=thing, response=boundaries.Slip())
    if at > 0.1:
        scene.validate()
        return
    with pytest.raises(libmpm.SceneError, match="layers lie in boundary 'thing'"):
        scene.validate()


def test_layers_that_start_inside_a_bed_are_refused():
    """Of any shape; and a body that is no box has to fill the zone as well."""
    bed = shapes.HeightField(x=[0, 1, 2], z=[0.3, 0.3, 0.1], base=-1)
    scene = libmpm.Scene(
        dimension=2, cell_size=CELL, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81)
    )
    box = shapes.Box(lower=(0, 0), upper=(1, 0.6))
    scene.add_body(name="water", shape=box - bed, material=materials.TaitFluid(bulk_modulus=1e5))
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip())
    inlet = boundaries.Inflow(body="water", face="x-", velocity=0.5, level=0.6)
    scene.add_flow(name="inlet", flow=inlet)
    with pytest.raises(libmpm.SceneError, match="lie in boundary 'bed'"):
        scene.validate()
    far = libmpm.Scene(dimension=2, cell_size=CELL, lower=(0, 0), upper=(2, 1), gravity=(0, -9.81))
    ball = shapes.Sphere(centre=(1.5, 0.5), radius=0.2)
    far.add_body(name="water", shape=ball, material=materials.TaitFluid(bulk_modulus=1e5))
    far.add_flow(name="inlet", flow=inlet)
    with pytest.raises(libmpm.SceneError, match="does not fill the zone"):
        far.validate()
