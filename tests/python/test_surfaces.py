"""Boundaries of any shape: slopes without stairs, moving and turning bodies, regions, mirrors.

Expected duration: 25 s.
"""

# ruff: noqa: F811  the fixture `device` is imported
from __future__ import annotations

import math

import numpy as np
import pytest

import libmpm
from libmpm import Scene, Simulation, TimeTable
from libmpm._src.boundaries import distance_field
from libmpm.boundaries import (
    DecayLayer,
    Displacement,
    Mirror,
    Prescribed,
    Rotation,
    Separable,
    Slip,
    Sticky,
    Travel,
)
from libmpm.materials import FixedCorotated, TaitFluid
from libmpm.sensors import LoadCell
from libmpm.shapes import Box, Cylinder, DomainWalls, HalfSpace, OrientedBox, Sphere
from support.devices import device  # noqa: F401

WATER = TaitFluid(density=1000.0, bulk_modulus=2e5)
SOLID = FixedCorotated(density=500.0, youngs_modulus=1e5, poissons_ratio=0.3)
G = 9.81


def slope(angle: float, ratio: float, cells: int = 8, travel: float = 50.0):
    """A block 2H x H on an inclined plane, and how far it has slid; H = 1 m."""
    dx, theta = 1.0 / cells, math.radians(angle)
    normal = (math.sin(theta), math.cos(theta))
    down = (math.cos(theta), -math.sin(theta))
    modulus = 500.0 * G / 1e-3
    ramp = 20 * 4 * math.sqrt(500.0 / modulus)
    length = (2 * cells + travel + 8) * dx
    high = length * math.sin(theta) + 4 * dx
    scene = Scene(
        dimension=2, cell_size=dx, lower=(0, 0),
        upper=(math.ceil(length / dx + cells) * dx, math.ceil((high + 3) / dx) * dx),
        gravity=TimeTable((0.0, ramp), ((0.0, 0.0), (0.0, -G))),
    )  # fmt: skip
    start = (2 * dx, high + 0.31 * dx)  # no cell face anywhere near
    mu = ratio * math.tan(theta)
    scene.add_boundary(
        name="slope", shape=HalfSpace(point=start, normal=normal),
        response=Separable(static_friction=mu, dynamic_friction=mu),
    )  # fmt: skip
    middle = [start[a] + down[a] * (1 + 2 * dx) + normal[a] * 0.5 for a in range(2)]
    scene.add_body(
        name="block", shape=OrientedBox(centre=middle, size=(2, 1), angle=-angle),
        material=FixedCorotated(density=500.0, youngs_modulus=modulus, poissons_ratio=0.3),
    )  # fmt: skip
    a = G * math.sin(theta) * (1 - (ratio if ratio < 1 else 0.5))
    end = ramp / 2 + math.sqrt(2 * travel * dx / a - ramp * ramp / 12)

    def slid(time: float) -> float:
        return a * (time * time / 2 - time * ramp / 2 + ramp * ramp / 6)

    return scene, np.array(down), end, slid


@pytest.mark.parametrize("angle", [4.76, 31.0])
@pytest.mark.parametrize("ratio", [0.0, 0.5])
def test_block_slides_down_a_plane_as_coulomb_says(angle, ratio):
    """g (sin θ - μ cos θ) t²/2 within 3 %."""
    scene, down, end, slid = slope(angle, ratio)
    simulation = Simulation(scene, device="cpu")
    first = simulation.particles["block"]["position"].mean(axis=0)
    simulation.run(until=end, progress=False)
    moved = (simulation.particles["block"]["position"].mean(axis=0) - first) @ down
    assert moved == pytest.approx(slid(simulation.time), rel=0.03)


@pytest.mark.parametrize("angle", [4.76, 31.0])
def test_block_holds_above_the_angle_of_friction(angle):
    scene, down, end, _ = slope(angle, 1.2)
    simulation = Simulation(scene, device="cpu")
    simulation.run(until=end / 2, progress=False)
    first = simulation.particles["block"]["position"].mean(axis=0)
    begun = simulation.time
    simulation.run(until=end, progress=False)
    moved = (simulation.particles["block"]["position"].mean(axis=0) - first) @ down
    assert abs(moved) / (simulation.time - begun) < 0.1 * scene.cell_size


def blades(rotation: Rotation | None, motion=None):
    scene = Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(2, 3))
    scene.add_boundary(
        name="paddle", shape=OrientedBox(centre=(1, 1), size=(1.2, 0.2), angle=20.0),
        response=Separable(), rotation=rotation, motion=motion,
    )  # fmt: skip
    scene.add_body(name="block", shape=Box(lower=(1.35, 1.4), upper=(1.55, 1.6)), material=SOLID)
    scene.add_sensor(name="load", sensor=LoadCell(boundary="paddle"))
    return scene


@pytest.mark.parametrize("turning", ["rate", "angle"])
def test_turning_paddle_hits_and_the_load_cell_has_the_momentum(device, turning):
    """What the paddle gives is what the block has; nothing else touches it."""
    rate = {"rate": 2.0}
    angle = {"degrees": TimeTable((0.0, 1.0), (0.0, np.degrees(2.0)))}
    scene = blades(Rotation(about=(1, 1), **(rate if turning == "rate" else angle)))
    simulation = Simulation(scene, device=device, precision="double")
    simulation.run(until=0.4, progress=False)
    block = simulation.particles["block"]
    momentum = (block["velocity"] * block["mass"][:, None]).sum(axis=0)
    load = simulation.sensors["load"]
    time = np.concatenate([[0.0], load.time])
    impulse = (load.values[:, :2] * np.diff(time)[-len(load.time) :, None]).sum(axis=0)
    assert np.linalg.norm(momentum) > 5.0
    # A sample is the mean since the one before; the last step's own is still to come.
    np.testing.assert_allclose(-impulse, momentum, atol=2e-2 * np.linalg.norm(momentum))


def test_angles_in_radians_are_the_same_and_warn():
    turn = TimeTable((0.0, 0.5, 1.0), (0.0, 2.0, 1.0), end="repeat")
    with pytest.warns(DeprecationWarning, match="degrees=TimeTable"):
        old = Rotation(about=(1, 1), angle=turn)
    new = Rotation(about=(1, 1), degrees=TimeTable(turn.time, np.degrees(turn.value), end="repeat"))
    assert new.radians().end == "repeat"
    np.testing.assert_allclose(new.radians().value, old.radians().value, rtol=1e-15)
    with pytest.raises(libmpm.SceneError, match="expected one of them"):
        Rotation(about=(1, 1), rate=1.0, degrees=turn)


def test_travelling_is_displacement_by_its_integral():
    """A place table and its derivative as a velocity table move a shape alike."""
    places = TimeTable((0.0, 0.2, 0.4), ((0.0, 0.0), (0.05, 0.2), (0.1, 0.4)))
    speeds = TimeTable((0.0,), ((0.25, 1.0),))
    results = []
    for motion in (Displacement(places), Travel(speeds), Travel((0.25, 1.0))):
        simulation = Simulation(blades(None, motion), device="cpu", precision="double")
        simulation.run(until=0.4, progress=False)
        results.append(simulation.particles["block"]["position"])
    assert np.ptp(results[0][:, 1]) > 0
    for other in results[1:]:
        np.testing.assert_allclose(other, results[0], atol=1e-9)


def test_piston_pushes_the_water_that_it_displaces(device):
    """Water stays before the piston, and its volume stays: the mean level rises by V / area."""
    scene = Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(3, 1), gravity=(0, -G))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    scene.add_boundary(
        name="piston", shape=Box(lower=(-1, -0.5), upper=(0.5, 1.5)), response=Slip(),
        motion=Displacement(TimeTable((0.0, 1.0), ((0.0, 0.0), (0.5, 0.0)))),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=Box(lower=(0.5, 0), upper=(3, 0.5)), material=WATER, hydrostatic=0.5
    )
    simulation = Simulation(scene, device=device)
    simulation.run(until=2.5, progress=False)
    position = simulation.particles["water"]["position"]
    assert position[:, 0].min() > 1.0 - 0.5 * 0.05
    # The centre of mass of a level pool of depth h is at h / 2.
    assert position[:, 1].mean() == pytest.approx(0.5 * 0.5 * 2.5 / 2.0, rel=0.03)


def test_prescribed_region_has_the_velocity_of_its_motion(device):
    scene = Scene(dimension=2, cell_size=0.05, lower=(0, 0), upper=(2, 1))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
    scene.add_boundary(
        name="pump", shape=Box(lower=(0.5, 0), upper=(1.0, 1.0)),
        response=Prescribed(components="x"), motion=TimeTable((0.0,), ((0.1, 5.0),)),
    )  # fmt: skip
    scene.add_body(name="water", shape=Box(lower=(0, 0), upper=(2, 1)), material=WATER)
    simulation = Simulation(scene, device=device)
    simulation.run(until=0.05, progress=False)
    where, velocity = simulation.grid["position"], simulation.grid["velocity"]
    inside = (where[:, 0] > 0.5) & (where[:, 0] < 1.0)
    np.testing.assert_allclose(velocity[inside, 0], 0.1, rtol=1e-6)
    assert np.abs(velocity[inside, 1]).max() < 1.0  # y is not prescribed
    assert np.abs(velocity[~inside, 0] - 0.1).max() > 0.01


def test_mirror_is_the_half_of_a_symmetric_scene():
    """A block that hits its mirror image is the left half of two blocks that collide."""

    def half(whole: bool) -> np.ndarray:
        scene = Scene(
            dimension=2, cell_size=0.1, lower=(0, 0), upper=(4 if whole else 2, 1),
            method=libmpm.Method(time_step=1e-4),
        )  # fmt: skip
        if not whole:
            scene.add_boundary(name="plane", shape=DomainWalls(faces="x+"), response=Mirror())
        box = Box(lower=(1.2, 0.3), upper=(1.9, 0.7))
        scene.add_body(name="left", shape=box, material=SOLID, velocity=(3.0, 0.5))
        if whole:
            other = Box(lower=(2.1, 0.3), upper=(2.8, 0.7))
            scene.add_body(name="right", shape=other, material=SOLID, velocity=(-3.0, 0.5))
        simulation = Simulation(scene, device="cpu", precision="double")
        simulation.run(until=0.12, progress=False)
        body = simulation.particles["left"]
        return body["position"][np.argsort(body["id"])]

    mirrored, whole = half(False), half(True)
    np.testing.assert_allclose(mirrored, whole, atol=1e-9)
    assert whole[:, 0].max() < 1.9 + 3.0 * 0.12 - 0.2  # they met


def test_mirrored_walls_carry_the_water(device):
    """Side ½ρgH², floor ρgHL, on the stated planes; see design/walls.md section 3."""
    scene = Scene(dimension=2, cell_size=1 / 16, lower=(0, 0), upper=(1, 2), gravity=(0, -G))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Mirror())
    box = Box(lower=(0, 0), upper=(1, 1))
    scene.add_body(name="water", shape=box, material=WATER, hydrostatic=1.0)
    for name, face in (("side", "x+"), ("floor", "y-")):
        cell = LoadCell(boundary="walls", faces=(face,), interval=0.0)
        scene.add_sensor(name=name, sensor=cell)
    simulation = Simulation(scene, device=device)
    simulation.run(until=2.0, progress=False)
    side = simulation.sensors["side"].values
    floor = simulation.sensors["floor"].values
    n = len(side) // 2
    assert side[-n:, 0].mean() == pytest.approx(500 * G, rel=0.01)
    assert floor[-n:, 1].mean() == pytest.approx(-1000 * G, rel=0.01)


def test_boundary_for_one_body_lets_the_other_pass(device):
    """Two blocks fall on one floor; it holds the body that it is for."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 3), gravity=(0, -G))
    scene.add_boundary(
        name="floor", shape=Box(lower=(0, 0.5), upper=(4, 1.0)), response=Slip(), bodies=("held",)
    )
    for name, x in (("held", 0.5), ("free", 2.5)):
        box = Box(lower=(x, 1.0), upper=(x + 1, 1.6))
        scene.add_body(name=name, shape=box, material=SOLID)
    simulation = Simulation(scene, device=device)
    simulation.run(until=0.3, progress=False)
    fallen = 0.5 * G * 0.3**2
    held = simulation.particles["held"]["position"][:, 1].mean()
    free = simulation.particles["free"]["position"][:, 1].mean()
    assert held > 1.3 - 0.1
    assert free == pytest.approx(1.3 - fallen, abs=0.02)


@pytest.mark.parametrize("wall", ["linear", "held"])
def test_a_bed_for_one_body_holds_beside_walls(wall, device):
    """Lines of a wall have a node across the wall, and the bed across itself."""
    dx, depth = 0.0125, 0.05
    scene = Scene(
        dimension=2, cell_size=dx, lower=(0, -2 * dx), upper=(0.5, 0.2), gravity=(0, -9.81)
    )
    water = TaitFluid(density=1000.0, bulk_modulus=1e5)
    scene.add_body(
        name="water", shape=Box(lower=(0, 0), upper=(0.5, depth)), material=water, hydrostatic=depth
    )
    scene.add_body(
        name="other", shape=Box(lower=(0.2, 0.1), upper=(0.25, 0.15)),
        material=FixedCorotated(density=500, youngs_modulus=1e5, poissons_ratio=0.3),
    )  # fmt: skip
    bed = Box(lower=(-1, -1), upper=(2, 0))
    scene.add_boundary(name="bed", shape=bed, response=Separable(cell="held"), bodies=("water",))
    sides = DomainWalls(faces=("x-", "x+"))
    scene.add_boundary(name="sides", shape=sides, response=Slip(cell=wall))
    sim = Simulation(scene, device=device)
    sim.run(until=0.1, progress=False)
    assert sim.particles["water"]["position"][:, 1].min() > 0.2 * dx


def test_within_limits_a_boundary_to_a_box():
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(4, 3), gravity=(0, -G))
    scene.add_boundary(
        name="floor", shape=Box(lower=(0, 0.5), upper=(4, 1.0)), response=Slip(),
        within=Box(lower=(0, 0), upper=(2, 3)),
    )  # fmt: skip
    for name, x in (("held", 0.5), ("free", 2.5)):
        box = Box(lower=(x, 1.0), upper=(x + 1, 1.6))
        scene.add_body(name=name, shape=box, material=SOLID)
    simulation = Simulation(scene, device="cpu")
    simulation.run(until=0.3, progress=False)
    assert simulation.particles["held"]["position"][:, 1].mean() > 1.2
    assert simulation.particles["free"]["position"][:, 1].mean() < 1.0


def test_a_surface_costs_memory_with_its_area():
    """Twice the radius in cells: four times the blocks in 3D, not eight; none for the domain."""

    def field(cells: int, radius: float) -> distance_field.DistanceField:
        scene = Scene(cell_size=1 / cells, lower=(0, 0, 0), upper=(4, 4, 4))
        scene.add_boundary(
            name="ball", shape=Sphere(centre=(2, 2, 2), radius=radius), response=Slip()
        )
        return distance_field.distance_field(scene, scene.boundaries[0])

    small, large = field(32, 0.6), field(64, 0.6)
    assert 3.0 < large.values.nbytes / small.values.nbytes < 5.0
    assert large.bytes < 0.05 * 4 * (4 * 64) ** 3


def test_distances_of_the_lattice_are_those_of_the_shape():
    """Values at the corners of the blocks, also of a lattice finer than the grid."""
    shape = Cylinder(start=(1, 0, 1), end=(1, 2, 1.2), radius=0.4)
    scene = Scene(cell_size=0.1, lower=(-0.3, 0, 0), upper=(2, 2, 2))
    scene.add_boundary(name="pile", shape=shape, response=Sticky(), spacing=0.05)
    field = distance_field.distance_field(scene, scene.boundaries[0])
    assert field.spacing == 0.05
    k = int(np.argmax(field.place >= 0))
    corner = field.keys[k] * distance_field.FIELD_EDGE * field.spacing + np.array(scene.lower)
    wanted = shape.distance(corner[None])[0] / field.spacing
    assert field.values[field.place[k], 0] == pytest.approx(wanted, abs=1e-5)


def test_scenes_without_special_boundaries_run_without_them():
    """Model only what a scene requires: the plan's kernel has another name, the memory is none."""
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_boundary(name="walls", shape=DomainWalls(), response=Slip(cell="held"))
    scene.add_body(name="water", shape=Box(lower=(0, 0), upper=(1, 0.5)), material=WATER)
    plain = scene.plan(device="cpu")
    assert plain.kernels[0] == "update_grid"
    scene.add_boundary(name="ball", shape=Sphere(centre=(0.5, 0.8), radius=0.15), response=Slip())
    with_ball = scene.plan(device="cpu")
    assert with_ball.kernels[0] != plain.kernels[0]
    assert with_ball.memory["tables"] > plain.memory["tables"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"shape": Box(lower=(0, 0), upper=(1, 1)), "response": Mirror()}, "Mirror with Box"),
        ({"shape": DomainWalls(), "response": Prescribed()}, "Solid of shapes"),
        ({"shape": Sphere(centre=(1, 1), radius=0.5), "response": Prescribed()}, "without motion"),
        ({"shape": Sphere(centre=(1, 1), radius=0.04), "response": Slip()}, "one cell or more"),
        ({"shape": Sphere(centre=(9, 9), radius=0.5), "response": Slip()}, "reach into it"),
        ({"shape": DomainWalls(), "response": Slip(), "layer": DecayLayer()}, "leave layer out"),
        ({"shape": DomainWalls(), "response": Slip(), "bodies": ("wter",)}, "did you mean"),
        ({"shape": DomainWalls(), "response": Slip(), "bodies": 5}, "names of bodies"),
        ({"shape": DomainWalls(), "response": Mirror(), "bodies": ("water",)}, "expected neither"),
        (
            {
                "shape": HalfSpace(point=(0, 0), normal=(0, 1)),
                "response": Slip(),
                "motion": Travel((1.0, 0.0)),
            },
            "intersect it with",
        ),
    ],
)
def test_what_means_nothing_is_refused_by_name(arguments, words):
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2))
    scene.add_body(name="water", shape=Box(lower=(0, 0), upper=(2, 0.5)), material=WATER)
    with pytest.raises(libmpm.SceneError, match=words):
        scene.add_boundary(name="it", **arguments)
        scene.validate()


def test_boundaries_round_trip():
    scene = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 2))
    scene.add_body(name="water", shape=Box(lower=(0, 0), upper=(2, 0.5)), material=WATER)
    scene.add_boundary(
        name="it", shape=Sphere(centre=(1, 1.4), radius=0.3) - Box(lower=(0, 0), upper=(1, 2)),
        response=Separable(), motion=Displacement(TimeTable((0.0,), ((0.0, 0.1),))),
        layer=DecayLayer(function="cosine", thickness=1.5), spacing=0.05, bodies=("water",),
        rotation=Rotation(about=(1, 1.4), rate=TimeTable((0.0, 1.0), (0.0, 1.0))),
        within=Box(lower=(0, 1), upper=(2, 2)),
    )  # fmt: skip
    scene.add_boundary(name="rim", shape=DomainWalls(), response=Mirror(slip=False))
    assert Scene.from_dict(scene.to_dict()) == scene
