"""Linear walls in flows and at rest, against closed forms (`design/walls.md`, 7).

Expected duration: 80 s (boxes in three dimensions, bores and the half drop of 40 cells).
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from support.still_water import GRAVITY, WATER, box_in_still_water, faces_of

pytestmark = pytest.mark.validation


def run_scene(scene, device, precision="double"):
    return libmpm.Simulation(scene, device=device, precision=precision, threads=1)


def impulse(sim, name, after=0.0):
    """Integral of a load cell's forces, N s, from a time on."""
    series = sim.sensors[name]
    time = np.asarray(series.time)
    length = np.diff(np.concatenate([[0.0], time]))
    keep = time > after + 1e-12
    return (np.asarray(series.values)[keep] * length[keep][:, None]).sum(axis=0)


class Drop:
    """Half an elliptical drop that falls apart on a plane: v = (A x, -A y).

    The pressure is p_c (1 - x²/a² - y²/b²) with p_c = ρ A² a² b² / (a² + b²), and
    A' = A² (b² - a²) / (a² + b²), a' = a A, b' = -b A: no free parameter, pressure positive
    everywhere, pressure and force of the wall in closed form.
    """

    def __init__(self):
        self.time, self.rate, self.a, self.b, self.force = 0.0, 1.0, 1.0, 1.0, 0.0

    @property
    def pressure(self):
        a, b = self.a**2, self.b**2
        return WATER * self.rate**2 * a * b / (a + b)

    def go_on(self, time):
        """To a time; `force` is the impulse on the plane until then, N s/m."""
        n = 8
        dt = (time - self.time) / n
        for _ in range(n):
            self.force += dt * self.pressure * 4 / 3 * self.a
            a, b = self.a**2, self.b**2
            self.rate += dt * self.rate**2 * (b - a) / (a + b)
            self.a, self.b = self.a + dt * self.a * self.rate, self.b - dt * self.b * self.rate
        self.time = time


def tilted_drop(cells, device, tmp_path, *, angle=0.0, offset=0.0, transfer="APIC", slope=False):
    """The same on a `HalfSpace`, at an angle in degrees or `offset` cells above a cell face.

    `slope`: with a gravity that does nothing but say which way is down, so that nodes move as on
    slopes.
    """
    weight = (0.0, -1e-9 if slope else 0.0)
    dx = 1.0 / cells
    along = np.array([np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))])
    normal = np.array([-along[1], along[0]])
    origin = np.array([0.0137, 0.0171]) if angle else np.array([0.0, offset * dx])
    x, y = np.meshgrid(
        (np.arange(-2 * cells, 2 * cells) + 0.5) * dx / 2, (np.arange(2 * cells) + 0.5) * dx / 2
    )
    inside = x**2 + y**2 < 1
    file = tmp_path / "drop.npy"
    np.save(file, origin + x[inside][:, None] * along + y[inside][:, None] * normal)
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(-2.8, -2.8), upper=(2.8, 2.8), gravity=weight,
        method=libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.PointFile(file=file, particle_volume=dx * dx / 4),
        material=materials.TaitFluid(density=WATER, bulk_modulus=WATER * 15.0**2, viscosity=0.0),
    )  # fmt: skip
    scene.add_boundary(
        name="plane", shape=shapes.HalfSpace(point=tuple(origin), normal=tuple(normal)),
        response=boundaries.Slip(cell="linear"),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="plane", interval=0.0))
    sim = run_scene(scene, device)
    body = sim.particles["water"]
    place = (body["position"] - origin) @ np.stack([along, normal], axis=1)
    body["pressure"] = 0.5 * WATER * (1 - (place**2).sum(axis=1)).clip(0)
    body["velocity"] = place[:, :1] * along - place[:, 1:] * normal
    return watch_drop(sim, origin, along, normal, dx)


def drop(cells, device, *, transfer="APIC", response=None, precision="double"):
    """Errors of a half drop of radius `cells` over quarters of 1/A: (4,) each.

    Mean pressure in the wall's cells over |x| < a/2, of the exact one; force; both semi-axes.
    """
    dx = 1.0 / cells
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(-2.6, 0.0), upper=(2.6, 1.3), gravity=(0.0, 0.0),
        method=libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    quarter = shapes.Box(lower=(-1.0, 0.0), upper=(1.0, 1.0))
    scene.add_body(
        name="water",
        shape=shapes.Intersection(parts=(shapes.Sphere(centre=(0.0, 0.0), radius=1.0), quarter)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=WATER * 15.0**2, viscosity=0.0),
        velocity=libmpm.Field(components=("x", "-y")),
    )
    scene.add_boundary(
        name="plane", shape=shapes.DomainWalls(faces=("y-",)),
        response=response or boundaries.Slip(cell="linear"),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="plane", interval=0.0))
    sim = run_scene(scene, device, precision)
    body = sim.particles["water"]
    body["pressure"] = 0.5 * WATER * (1 - (body["position"] ** 2).sum(axis=1)).clip(0)
    return watch_drop(sim, np.zeros(2), np.array([1.0, 0.0]), np.array([0.0, 1.0]), dx)


def watch_drop(sim, origin, along, normal, dx):
    """Run a half drop on a plane to 1/A and return its errors (see `drop`)."""
    body, exact = sim.particles["water"], Drop()
    errors, since, sums, pushed = [], 0.0, np.zeros(2), 0.0
    while exact.time < 1.0 - 1e-9:
        sim.step(4)
        exact.go_on(sim.time)
        found = body.read(["position", "pressure"])
        x, y = (found["position"] - origin) @ along, (found["position"] - origin) @ normal
        near = (np.abs(x) < 0.5 * exact.a) & (y < dx)
        right = exact.pressure * (1 - (x / exact.a) ** 2 - (y / exact.b) ** 2)
        sums += [(found["pressure"] - right)[near].mean(), right[near].mean()]
        if exact.time >= 0.25 * (len(errors) + 1):
            force = -(impulse(sim, "load", since)[:2] @ normal) / (exact.force - pushed)
            axes = [2 * np.sqrt((x**2).mean()) / exact.a, 2 * np.sqrt((y**2).mean()) / exact.b]
            errors.append([sums[0] / sums[1], force - 1, axes[0] - 1, axes[1] - 1])
            since, pushed, sums = sim.time, exact.force, np.zeros(2)
    return np.array(errors).T


@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
def test_half_drop(transfer, device):
    """Held nodes miss the pressure by 12 times itself here, and more cells do not help."""
    pressure, force, a, b = drop(20, device, transfer=transfer)
    assert np.abs(pressure).max() <= 0.03
    assert np.abs(force).max() <= 0.015
    assert np.abs(a).max() <= 0.005
    assert np.abs(b).max() <= 0.005


def test_half_drop_converges(device):
    coarse, fine = (np.abs(drop(n, device)[0]).max() for n in (20, 40))
    assert fine <= coarse
    assert fine <= 0.03


def test_half_drop_in_single_precision_and_with_a_wall_that_lets_go(device):
    response = boundaries.Separable(cell="linear")
    pressure, force, _, _ = drop(20, device, response=response, precision="single")
    assert np.abs(pressure).max() <= 0.03
    assert np.abs(force).max() <= 0.015


PLANES = [(0.0, 0.0, False), (0.0, 0.25, False), (0.0, 0.4, False), (0.0, 0.5, False)]
PLANES += [(30.0, 0.0, False), (45.0, 0.0, False)]
PLANES += [(5.0, 0.0, True), (15.0, 0.0, True), (30.0, 0.0, True), (40.0, 0.0, True)]


@pytest.mark.parametrize(("angle", "offset", "slope"), PLANES)
def test_half_drop_on_a_surface(angle, offset, slope, device, tmp_path):
    """A plane by its signed distance, wherever it lies in the cells and at any angle."""
    pressure, force, a, b = tilted_drop(
        20, device, tmp_path, angle=angle, offset=offset, slope=slope
    )
    assert np.abs(pressure).max() <= 0.03
    assert np.abs(force).max() <= 0.015
    assert np.abs(a).max() <= 0.005
    assert np.abs(b).max() <= 0.005


@pytest.mark.parametrize("transfer", ["APIC", "FLIP"])
@pytest.mark.parametrize("cells", [8, 16])
def test_force_of_a_bore_on_the_piston_that_drives_it(cells, transfer, device):
    """Half ρ g h₂², h₂ by mass and momentum across the bore: u = (h₂ - h₁) √(g/2 (1/h₁ + 1/h₂)).

    A piston at 0.1 √(g h₁) through the cells. Held nodes: 1.36 at 8 cells a depth, 1.09 at 16, 1.02
    at 32.
    """
    dx, speed = 1.0 / cells, 0.1 * np.sqrt(GRAVITY)
    low, high = 1.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        found = (middle - 1) * np.sqrt(GRAVITY / 2 * (1 + 1 / middle))
        low, high = (middle, high) if found < speed else (low, middle)
    time = np.linspace(0.0, 3.0, 301)
    rise = np.clip(time * np.sqrt(GRAVITY) / 2, 0, 1)
    velocity = speed * rise**2 * (3 - 2 * rise)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time))])
    path = libmpm.TimeTable(time=tuple(time), value=tuple((x, 0.0) for x in way), end="hold")
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(8.0, 2.0), gravity=(0.0, -GRAVITY),
        method=libmpm.Method(cfl=0.3, transfer=transfer),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(8 * dx, 0.0), upper=(8.0, 1.0)), hydrostatic=1.0,
        material=materials.TaitFluid(
            density=WATER, bulk_modulus=200 * WATER * GRAVITY, viscosity=0.0
        ),
    )  # fmt: skip
    response = boundaries.Slip(cell="linear")
    walls = shapes.DomainWalls(faces=("x+", "y-"))
    scene.add_boundary(name="walls", shape=walls, response=response)
    scene.add_boundary(
        name="piston", shape=shapes.Box(lower=(-3.0, -1.0), upper=(8 * dx, 3.0)),
        response=response, motion=boundaries.Displacement(path),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="piston", interval=0.0))
    sim = run_scene(scene, device, "single")
    sim.run(until=1.5, progress=False)
    since = sim.time
    sim.run(until=2.25, progress=False)
    force = -impulse(sim, "load", since)[0] / (sim.time - since)
    assert force == pytest.approx(0.5 * WATER * GRAVITY * low**2, rel=0.01)
    place = np.interp(sim.time, time, way) + 8 * dx
    assert (sim.particles["water"]["position"][:, 0] > place).all()


@pytest.mark.parametrize("offset", [0.25, 0.5])
def test_still_water_on_a_plane_between_the_nodes(offset, device):
    cell = 1 / 40
    bed = (3 + offset) * cell
    scene = libmpm.Scene(
        dimension=2, cell_size=cell, lower=(0.0, 0.0), upper=(8 * cell, 50 * cell),
        gravity=(0.0, -GRAVITY), method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, bed), upper=(8 * cell, bed + 1.0)),
        material=materials.TaitFluid(
            density=WATER, bulk_modulus=200 * WATER * GRAVITY, viscosity=0.0
        ),
        hydrostatic=bed + 1.0,
    )  # fmt: skip
    response = boundaries.Slip(cell="linear")
    scene.add_boundary(
        name="sides", shape=shapes.DomainWalls(faces=("x-", "x+")), response=response
    )
    scene.add_boundary(
        name="bed", shape=shapes.HalfSpace(point=(0.0, bed), normal=(0.0, 1.0)), response=response
    )
    sim = run_scene(scene, device)
    body = sim.particles["water"]
    before = body["position"][:, 1].mean()
    sim.step(20_000)
    found = body.read(["position", "pressure"])
    height = found["position"][:, 1] - bed
    error = found["pressure"] / (WATER * GRAVITY) - (1 - height)
    assert np.sqrt((error**2).mean()) <= 0.005
    assert abs(error[height < cell].mean()) <= 0.01
    assert abs(body["position"][:, 1].mean() - before) <= 1e-4 * 0.5
    assert np.sqrt((sim.grid["velocity"] ** 2).sum(axis=1).mean() / GRAVITY) <= 2e-4


def test_bed_pressure_of_a_dam_break(device):
    """In every window the bed's cells press as the bed is pressed, in nearly every column."""
    n = 25
    dx, stiff = 1.0 / n, 100 * WATER * 2 * GRAVITY
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0.0, 0.0), upper=(4.0, 4.0), gravity=(0.0, -GRAVITY),
        method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(2.0, 1.0)), hydrostatic=1.0,
        material=materials.TaitFluid(density=WATER, bulk_modulus=stiff, viscosity=0.0),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response=boundaries.Slip(cell="linear"),
    )  # fmt: skip
    scene.add_sensor(
        name="bed", sensor=sensors.LoadCell(boundary="walls", faces=("y-",), interval=0.0)
    )
    sim = run_scene(scene, device, "single")
    body, columns, unit = sim.particles["water"], 4 * n, 1 / np.sqrt(GRAVITY)
    for end in (1.0, 1.5, 2.0, 2.5):
        since, looks = sim.time, 0
        bed, weight, deep = np.zeros((3, columns))
        while sim.time < end * unit:
            sim.step(10)
            found = body.read(["position", "pressure"])
            column = np.clip((found["position"][:, 0] / dx).astype(int), 0, columns - 1)
            count = np.bincount(column, minlength=columns)
            low = found["position"][:, 1] < dx
            pressure = np.bincount(column[low], found["pressure"][low], columns)
            lowest = np.bincount(column[low], minlength=columns)
            # The mean of a cell that is half a cell above the bed.
            pressure = np.where(
                lowest > 0, pressure / np.maximum(lowest, 1) + 0.5 * dx * WATER * GRAVITY, 0.0
            )
            bed += pressure
            weight += count * 0.25 * dx * WATER * GRAVITY
            deep += count >= 24
            looks += 1
        load = -impulse(sim, "bed", since)[1] / (sim.time - since)
        assert bed.sum() * dx / looks / load == pytest.approx(1, abs=0.05)
        if end > 1.0:
            watched = deep > 0.5 * looks
            off = np.abs(bed - weight)[watched] > 0.1 * weight[watched]
            assert off.sum() <= 0.25 * watched.sum()


def test_vortex_in_a_box_keeps_its_energy(device):
    """After a turnover held walls leave 0.45 of it."""
    n = 32
    scene = libmpm.Scene(
        dimension=2, cell_size=1 / n, lower=(0.0, 0.0), upper=(1.0, 1.0), gravity=(0.0, 0.0),
        method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0.0, 0.0), upper=(1.0, 1.0)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=100 * WATER, viscosity=0.0),
        velocity=libmpm.Field(components=("sin(pi*x)*cos(pi*y)", "-cos(pi*x)*sin(pi*y)")),
    )  # fmt: skip
    scene.add_boundary(
        name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip(cell="linear")
    )
    sim = run_scene(scene, device)
    body = sim.particles["water"]
    x, y = body["position"].T
    body["pressure"] = WATER * (1 + 0.25 * (np.cos(2 * np.pi * x) + np.cos(2 * np.pi * y)))
    before = (body["velocity"] ** 2).sum()
    sim.run(until=2.0, progress=False)
    place = body["position"] * n
    depth = np.minimum(place, n - place).min(axis=1)
    assert (body["velocity"] ** 2).sum() >= 0.85 * before
    assert (depth < 1).sum() <= 1.15 * 4 * (4 * n - 4)


def still_box(low, high, basin, cell, device, dimension):
    """Loads on the faces of a box in still water, of the hydrostatic ones; particles inside."""
    depth, faces = basin[-1] * cell, faces_of(dimension)
    linear = boundaries.Slip(cell="linear")
    scene, lower, upper = box_in_still_water(low, high, basin, cell, linear)
    for face in faces:
        scene.add_sensor(
            name=face, sensor=sensors.LoadCell(boundary="box", faces=(face,), interval=2e-3)
        )
    sim = run_scene(scene, device, "single")
    sim.step(1000)
    since = 0.6 * sim.time
    size, found = upper - lower, {}
    for k, face in enumerate(faces):
        axis = k // 2
        place = (
            0.5 * (lower[-1] + upper[-1]) if axis < dimension - 1 else (upper, lower)[1 - k % 2][-1]
        )
        area = np.prod(np.delete(size, axis))
        right = WATER * GRAVITY * (depth - place) * area * (1 if k % 2 == 0 else -1)
        found[face] = impulse(sim, face, since)[axis] / (sim.time - since) / right
    x = sim.particles["water"]["position"]
    inside = np.all((x > lower) & (x < upper), axis=1).sum()
    up, down = faces[-1], faces[-2]
    head = {up: depth - upper[-1], down: depth - lower[-1]}
    lift = (found[down] * head[down] - found[up] * head[up]) / size[-1]
    return found, lift, inside


@pytest.mark.parametrize("cells", [4, 8])
def test_box_in_still_water(cells, device):
    """Held faces of 8 cells lack 10 to 15 % of their load, held boxes of 4 10 % of the lift."""
    n = cells + 8
    found, lift, inside = still_box((4, 4, 4), (n - 4,) * 3, (n, n, n), 0.05, device, 3)
    for face, load in found.items():
        assert load == pytest.approx(1, abs=0.02), face
    assert lift == pytest.approx(1, abs=0.02)
    assert inside == 0


def test_deck_of_two_cells_in_still_water(device):
    """The ends of the deck too, which are two cells."""
    found, lift, inside = still_box((4, 8), (12, 10), (16, 20), 0.05, device, 2)
    for face, load in found.items():
        assert load == pytest.approx(1, abs=0.05), face
    assert lift == pytest.approx(1, abs=0.02)
    assert inside == 0


@pytest.mark.parametrize("where", ["wall", "ceiling"])
def test_a_film_falls_off(where, device):
    """One cell of water beside a wall that lets go, and under one, falls as it is free to."""
    gravity, ceiling = 1e-3, where == "ceiling"
    scene = libmpm.Scene(
        dimension=2, cell_size=1.0, lower=(0.0, 0.0), upper=(40.0, 120.0),
        gravity=(0.0, -gravity), method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    film = ((10.0, 119.0), (30.0, 120.0)) if ceiling else ((0.0, 90.0), (1.0, 110.0))
    scene.add_body(
        name="film", shape=shapes.Box(lower=film[0], upper=film[1]),
        material=materials.TaitFluid(density=WATER, bulk_modulus=WATER, viscosity=0.0),
    )  # fmt: skip
    scene.add_boundary(
        name="wall", shape=shapes.DomainWalls(faces=("y+" if ceiling else "x-",)),
        response=boundaries.Separable(cell="linear"),
    )  # fmt: skip
    sim = run_scene(scene, device)
    body = sim.particles["film"]
    start = body["position"][:, 1].mean()
    sim.run(until=np.sqrt(2 * (20 if ceiling else 40) / gravity), progress=False)
    fallen = start - body["position"][:, 1].mean()
    assert fallen == pytest.approx(0.5 * gravity * sim.time**2, rel=0.005)


def test_a_slab_bounces_and_the_wall_counts_its_momentum(device):
    cells, speed = 32, 0.02
    scene = libmpm.Scene(
        dimension=2, cell_size=1.0, lower=(0.0, 0.0), upper=(4.0, 3.0 * cells),
        gravity=(0.0, 0.0), method=libmpm.Method(cfl=0.3),
    )  # fmt: skip
    scene.add_body(
        name="slab", shape=shapes.Box(lower=(0.0, 2.0), upper=(4.0, 2.0 + cells)),
        material=materials.TaitFluid(density=WATER, bulk_modulus=WATER, viscosity=0.0),
        velocity=(0.0, -speed),
    )  # fmt: skip
    scene.add_boundary(
        name="sides", shape=shapes.DomainWalls(faces=("x-", "x+")),
        response=boundaries.Slip(cell="linear"),
    )  # fmt: skip
    scene.add_boundary(
        name="wall", shape=shapes.DomainWalls(faces=("y-",)),
        response=boundaries.Separable(cell="linear"),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="wall", interval=0.0))
    sim = run_scene(scene, device)
    sim.run(until=2 / speed + 6 * cells, progress=False)
    rebound = sim.particles["slab"]["velocity"][:, 1].mean() / speed
    mass = WATER * 4 * cells
    # What the transfer takes from the shock; held walls that let go give 0.84.
    assert rebound >= 0.82
    assert -impulse(sim, "load")[1] == pytest.approx(mass * speed * (1 + rebound), rel=1e-5)
    assert sim.particles["slab"]["position"][:, 1].min() > 1.0
