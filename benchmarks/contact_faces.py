"""Rows of `contact.py` of faces that touch: press, slope, Hertz; what other rows use too."""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import libmpm
from libmpm import boundaries, contacts, sensors, shapes

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from support import contact_scenes as cases

Values = dict[str, float]
Numbers = NDArray[np.float64]


def simulate(scene: libmpm.Scene, **options: Any) -> libmpm.Simulation:
    """Return a simulation on the CPU in double precision."""
    return libmpm.Simulation(scene, device="cpu", **({"precision": "double"} | options))


def moved(scene: libmpm.Scene, body: str, speed: libmpm.TimeTable, box: shapes.Box) -> None:
    """Give the nodes of one body in a box a velocity."""
    scene.add_boundary(
        name=f"hold {body}", shape=box, response=boundaries.Prescribed(), motion=speed,
        bodies=(body,),
    )  # fmt: skip


def rings(centre: Numbers, radius: float, spacing: float) -> shapes.PointFile:
    """Return a disc of particles in rings: cut out of a lattice it has steps for normals."""
    count = round(radius / spacing)
    width = radius / count
    points = []
    for k in range(count):
        r = (k + 0.5) * width
        angle = (
            2
            * math.pi
            * (np.arange(round(2 * math.pi * (k + 0.5))) + 0.5 * (k % 2))
            / round(2 * math.pi * (k + 0.5))
        )
        points.append(centre + r * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    found = np.concatenate(points)
    file = Path(tempfile.mkdtemp()) / "disc.csv"
    np.savetxt(file, found, delimiter=",", header="x,y", comments="")
    return shapes.PointFile(file=str(file), volume=math.pi * radius**2)


# Press --------------------------------------------------------------------------------------------


def press(offset: float, nu: float = 0.0) -> Values:
    """Two blocks of 16 x 8 cells, closed at 0.02 c, pressed by 1.8 % of their height and held."""
    n, dx, gap = 16, 1 / 16, 1.0
    c = cases.sound_speed(1e6, nu)
    speed = 0.02 * c
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(3, 3))
    middle = 1.5 + offset * dx
    for name, side in (("low", -1.0), ("high", 1.0)):
        near, far = (middle + side * (gap / 2 + k) * dx for k in (0, n / 2))
        low, high = sorted((near, far))
        scene.add_body(
            name=name, shape=shapes.Box(lower=(1.0, low), upper=(2.0, high)),
            material=cases.solid(1e6, nu),
        )  # fmt: skip
    scene.add_contact(name="faces", between=("low", "high"), law=contacts.Friction())
    push = 2 * 0.018 * (n / 2) * dx
    until = (gap * dx + push) / speed
    for body, side in (("low", -1.0), ("high", 1.0)):
        # The outer cell and a half of each, and what lies beyond it.
        far = middle + side * ((n / 2 - 1.5) * dx)
        low, high = sorted((far, middle + side * 1.4))
        moved(scene, body, libmpm.TimeTable(
            time=[0.0, until, 1.0001 * until, 1e3],
            value=[[0.0, -side * speed / 2]] * 2 + [[0.0, 0.0]] * 2,
        ), shapes.Box(lower=(0, low), upper=(3, high)))  # fmt: skip
    scene.add_sensor(name="faces", sensor=sensors.ContactLoad(contact="faces", interval=0.01))
    simulation = simulate(scene)
    hold = 40 * (n / 2) * dx / c
    simulation.run(until=until + hold)
    gaps, near, deep, spread = [], [], [], []
    for _ in range(10):
        simulation.run(until=simulation.time + 0.01 * hold)
        faces = {}
        for body, side in (("low", -1.0), ("high", 1.0)):
            p = simulation.particles[body]
            x, stress, ratio = (np.asarray(p[a]) for a in ("position", "stress", "volume_ratio"))
            inside = np.abs(x[:, 0] - 1.5) < n * dx / 4
            rows = side * (x[inside, 1] - middle)
            front = rows < np.sort(rows)[n - 1] + 1e-3 * dx  # half of the width, two a cell
            # A row of particles lies a quarter of a compressed cell behind its face.
            faces[side] = float(np.mean(rows[front] - 0.25 * dx * ratio[inside][front]))
            if body == "low":
                pressure = -stress[inside, 1, 1]
                deepest = (rows > 3 * dx) & (rows < (n / 2 - 3) * dx)
                close = rows < 2 * dx
                deep.append(pressure[deepest].mean())
                near.append(pressure[close].mean())
                spread.append(pressure[close].std())
        gaps.append((faces[1.0] + faces[-1.0]) / dx)
    force = simulation.sensors["faces"]
    deep_mean = float(np.mean(deep))
    return {
        "rest_gap": float(np.mean(gaps)),
        "near": float(np.mean(near) / deep_mean),
        "spread": float(np.mean(spread) / deep_mean),
        # On the upper body, over its width; the sides bulge nowhere where nu is 0.
        "force": float(force["force_y"][-5:].mean() / (deep_mean * n * dx)),
    }


# Slope --------------------------------------------------------------------------------------------


def slope(friction: float, turn: float, cells: int = 12, degrees: float = 30.0) -> Values:
    """`cases.slope` with the whole scene turned against the grid: error of the acceleration, of g.

    The slab is held in its lowest cell and a half, not by a wall.
    """
    dx, g, angle = 1 / cells, 10.0, math.radians(degrees)
    t = math.radians(turn)
    along, up = np.array([math.cos(t), math.sin(t)]), np.array([-math.sin(t), math.cos(t)])
    long, wide, high = 3.0, 1.0, cells // 2 * dx
    corners = [x * along + y * up for x in (0.0, long) for y in (-high, high)]
    low = np.min(corners, axis=0) - 4 * dx
    size = np.ceil((np.max(corners, axis=0) - low) / dx + 4) * dx
    pull = -g * math.cos(angle) * up
    down = pull - g * math.sin(angle) * along
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=tuple(size),
        gravity=libmpm.TimeTable(
            time=[0.0, 0.3, 0.5, 0.501, 10.0],
            value=[[0.0, 0.0], list(1.1 * pull), list(pull), list(down), list(down)],
        ),
    )  # fmt: skip

    def box(middle: float, height: float, length: float, thick: float) -> shapes.OrientedBox:
        centre = middle * along + height * up - low
        return shapes.OrientedBox(centre=tuple(centre), size=(length, thick), angle=turn)

    scene.add_body(name="slab", shape=box(long / 2, -high / 2, long, high), material=cases.solid())
    scene.add_body(name="block", shape=box(2.0, high / 2, wide, high), material=cases.solid())
    scene.add_boundary(
        name="hold", shape=box(long / 2, -high, long + 8 * dx, 3 * dx),
        response=boundaries.Prescribed(), bodies=("slab",),
        motion=libmpm.TimeTable(time=[0.0, 1e3], value=[[0.0, 0.0]] * 2),
    )  # fmt: skip
    scene.add_contact(
        name="sole", between=("block", "slab"), law=contacts.Friction(static=friction)
    )
    simulation = simulate(scene)
    simulation.run(until=0.65, progress=False)
    times, speeds = [], []

    def see(s: libmpm.Simulation) -> None:
        times.append(s.time)
        speeds.append(-cases.mean(s, "block", "velocity") @ along)

    cases.each_step(simulation, 0.95, see)
    found = float(np.polyfit(times, speeds, 1)[0])
    right = g * (math.sin(angle) - friction * math.cos(angle))
    return {"acceleration": found, "error": (found - right) / g}


# Hertz --------------------------------------------------------------------------------------------


def hertz_force(d: float, radius: float, modulus: float) -> float:
    """Return the force, N/m, at which a plate has come nearer to a disc's middle by d: Johnson."""
    low, high = 0.0, modulus * radius
    for _ in range(200):
        force = 0.5 * (low + high)
        near = near_by_force(force, radius, modulus)
        low, high = (force, high) if near < d else (low, force)
    return 0.5 * (low + high)


def near_by_force(force: float, radius: float, modulus: float) -> float:
    """Return how much nearer a plate is to a disc's middle at a force, m."""
    a = math.sqrt(4 * force * radius / (math.pi * modulus))
    return force / (math.pi * modulus) * (2 * math.log(4 * radius / a) - 1)


def hertz(cells: int, offset: float) -> Values:
    """A disc between two plates of prescribed velocity that close at 0.001 c each."""
    dx, r, e, nu = 1 / cells, 1.0, 1e6, 0.3
    wide, high = math.ceil(3.2 * cells), 2 * cells + 24
    # A disc that lies between faces of whole or half cells.
    centre = np.array([wide * dx / 2 + 0.2 * dx, (high // 2 + offset) * dx])
    c = cases.sound_speed(e, nu)
    speed, thick = 0.001 * c, 5
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(wide * dx, high * dx)
    )  # fmt: skip
    scene.add_body(
        name="disc", shape=rings(centre, r, dx / 2), material=cases.solid(e, nu),
    )  # fmt: skip
    for name, side in (("low", -1.0), ("high", 1.0)):
        face = centre[1] + side * r
        low, top = sorted((face, face + side * thick * dx))
        scene.add_body(
            name=name, shape=shapes.Box(lower=(0.2 * r, low), upper=(wide * dx - 0.2 * r, top)),
            material=cases.solid(e, nu), velocity=(0.0, -side * speed),
        )  # fmt: skip
        moved(scene, name, libmpm.TimeTable(time=[0.0, 1e3], value=[[0.0, -side * speed]] * 2),
              shapes.Box(lower=(0, 0), upper=(wide * dx, high * dx)))  # fmt: skip
    scene.add_contact(name="plates", between=("disc", "*"), law=contacts.Friction())
    interval = 0.0005 * r / speed
    for name in ("low", "high"):
        load_of = sensors.ContactLoad(contact="plates", pair=("disc", name), interval=interval)
        scene.add_sensor(name=name, sensor=load_of)
    simulation = simulate(scene)
    values = {}
    marks = (0.01, 0.0184, 0.03)
    simulation.run(until=1.02 * marks[-1] * r / speed)
    for d in marks:
        at = d * r / speed
        found = []
        for name in ("low", "high"):
            series = simulation.sensors[name]
            # The mean over a tenth of the way, whose middle is at d.
            span = np.abs(series.time - interval / 2 - at) < 0.05 * at
            found.append(abs(series["force_y"][span].mean()))
        modulus, mean = e / (1 - nu**2), float(np.mean(found))
        values[f"force_at_{d * cells:.2f}_cells"] = mean / hertz_force(d * r, r, modulus) - 1
        values[f"shift_at_{d * cells:.2f}_cells"] = (near_by_force(mean, r, modulus) - d * r) / dx
    return values
