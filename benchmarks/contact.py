"""Bodies that touch against closed forms: what `docs/contact.md` says of them, one line a row.

    python benchmarks/contact.py                    all rows, about half an hour on one thread
    python benchmarks/contact.py press sink         some
    python benchmarks/contact.py --list             their names

2D, double precision, APIC unless a row says otherwise. Rows go to benchmarks/results/contact.jsonl
with what is right, where that is known. Rows that are there are kept.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from contact_bars import bars
from contact_squeeze import rows as squeezes
from numpy.typing import NDArray
from result_pages import append, load

import libmpm
from libmpm import boundaries, contacts, materials, sensors, shapes
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
RESULTS = ROOT / "benchmarks/results/contact.jsonl"

from support import contact_scenes as cases  # noqa: E402

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


# Blows --------------------------------------------------------------------------------------------


def oblique(impact: float, degrees: float, friction: float = 0.1, radius: int = 16) -> Values:
    """Two discs that slide along each other: impulse along the line of centres, spin."""
    dx, r = 0.01, radius * 0.01
    c = cases.sound_speed(1e6, 0.3)
    speed = 0.005 * c
    turn = math.radians(degrees)
    along, up = (np.array([math.cos(turn), math.sin(turn)]),
                 np.array([-math.sin(turn), math.cos(turn)]))  # fmt: skip
    size = dx * math.ceil(5.6 * radius)
    scene = libmpm.Scene(dimension=2, cell_size=dx, lower=(0, 0), upper=(size, size))
    apart = 2 * r * math.sqrt(1 - impact**2) + 0.5 * dx
    for name, side in (("left", -1.0), ("right", 1.0)):
        centre = size / 2 + side * (along * apart / 2 + up * impact * r)
        scene.add_body(
            name=name, shape=rings(centre, r, dx / 2), material=cases.solid(),
            velocity=tuple(-side * speed * along),
        )  # fmt: skip
    scene.add_contact(
        name="discs", between=("left", "right"), law=contacts.Friction(static=friction)
    )
    scene.add_sensor(name="blow", sensor=sensors.ContactLoad(contact="discs", interval=0.0))
    simulation = simulate(scene)
    mass = {b: np.asarray(simulation.particles[b]["mass"]) for b in ("left", "right")}
    start = {b: cases.mean(simulation, b, "velocity") for b in mass}
    push = slide = 0.0

    def middle(body: str) -> Numbers:
        return cases.mean(simulation, body, "position")

    last = start["right"]
    until = 0.5 * dx / (2 * speed * math.sqrt(1 - impact**2)) + 14 * 2 * r / c
    while simulation.time < until:
        simulation.step(5)
        line = middle("right") - middle("left")
        line /= np.linalg.norm(line)
        now = cases.mean(simulation, "right", "velocity")
        change = now - last
        push += change @ line
        slide += change @ np.array([-line[1], line[0]])
        last = now
    x, v = (np.asarray(simulation.particles["right"][a]) for a in ("position", "velocity"))
    x, v = x - x.mean(axis=0), v - v.mean(axis=0)
    spin = (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]).sum() / (x**2).sum()
    momentum = sum(mass[b].sum() * (cases.mean(simulation, b, "velocity") - start[b]) for b in mass)
    # Restitution along the line of centres when they touch.
    normal = along * math.sqrt(1 - impact**2) + up * impact
    before = (start["left"] - start["right"]) @ normal
    after = (
        cases.mean(simulation, "left", "velocity") - cases.mean(simulation, "right", "velocity")
    ) @ normal
    series = simulation.sensors["blow"]
    return {
        "ratio": float(abs(slide) / push),
        "spin": float(abs(spin) / (friction * push * r / (0.5 * r**2))),
        "restitution": float(-after / before),
        "momentum": float(np.abs(momentum).max() / (mass["left"].sum() * speed)),
        "nodes_ratio": float(series.impulse("tangential") / series.impulse("normal")),
    }


# Pile, thin plate ---------------------------------------------------------------------------------


def pile(until: float = 15.0) -> Values:
    """Twenty soft discs of 5 cells that fall into a box."""
    scene = cases.pile()
    scene.add_sensor(name="pile", sensor=sensors.ContactLoad(contact="pile", interval=0.05))
    scene.add_sensor(name="floor", sensor=sensors.LoadCell(boundary="box", interval=0.05))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.05))
    simulation = simulate(scene, precision="single")
    simulation.run(until=until)
    ids = np.sort(np.concatenate([np.asarray(p["id"]) for p in simulation.particles.values()]))
    weight = 10.0 * sum(float(np.asarray(p["mass"]).sum()) for p in simulation.particles.values())
    square = sum(
        float((np.asarray(p["mass"])[:, None] * np.asarray(p["velocity"]) ** 2).sum())
        for p in simulation.particles.values()
    )
    energy = simulation.sensors["energy"].values[:, :3].sum(axis=1)
    return {
        "every_id_once": float(np.array_equal(ids, np.arange(len(ids)))),
        "rms_speed": math.sqrt(square / (weight / 10.0)),
        "floor": float(-simulation.sensors["floor"]["force_y"][-40:].mean() / weight),
        "energy_rise": float(np.maximum(np.diff(energy), 0).max() / abs(energy).max()),
    }


def plate(cells: float) -> Values:
    """A plate of so many cells between two blocks of which the upper one lies on it."""
    dx, g = 0.01, 9.81
    thick, size = cells * dx, 8 * dx
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=(20 * dx, 22 * dx), gravity=(0, -g)
    )  # fmt: skip
    left, right = 6 * dx, 14 * dx
    bottom = 0.0
    for name, high in (("lower", size), ("plate", thick), ("upper", size)):
        scene.add_body(
            name=name, shape=shapes.Box(lower=(left, bottom), upper=(right, bottom + high)),
            material=cases.solid(1e6, 0.3),
            particles_per_cell=16 if name == "plate" else 4,
        )  # fmt: skip
        bottom += high
    floor = boundaries.Separable(static_friction=0.5, dynamic_friction=0.5)
    scene.add_boundary(name="floor", shape=shapes.DomainWalls(faces=["y-"]), response=floor)
    scene.add_contact(name="all", between=("*", "*"), law=contacts.Friction(static=0.5))
    simulation = simulate(scene)

    def above() -> float:
        places = {b: cases.mean(simulation, b, "position")[1] for b in ("lower", "upper")}
        return places["upper"] - places["lower"]

    start = above()
    simulation.run(until=1.0)
    heights = []
    for _ in range(50):
        simulation.run(until=simulation.time + 0.01)
        heights.append(above())
    # What weight shortens: half of the lower block, the plate, the lower half of the upper one.
    own = 1000 * g / (1e6 / (1 - 0.3**2))  # strain a metre of what lies above
    shorter = own * (
        size / 2 * (1.25 * size + thick) + thick * (size + thick / 2) + size / 2 * 0.75 * size
    )
    return {"sunk": float((start - np.mean(heights) - shorter) / dx), "by_weight": shorter / dx}


def dominoes(friction: float, cells: int) -> Values:
    """A row of 24 dominoes, of which the first tips; speed of the front from the 8th on."""
    count = 24
    simulation = simulate(cases.dominoes(count, cells, friction), precision="single")
    names = [f"domino {k:02d}" for k in range(count)]
    ends = {}
    for name in names:
        y = cases.by_id(simulation, name, "position")[:, 1]
        ends[name] = (y > np.quantile(y, 0.75), y < np.quantile(y, 0.25))
    passed: dict[str, float] = {}
    while simulation.time < 1.6 and len(passed) < count:
        simulation.run(until=simulation.time + 1e-3, progress=False)
        # The front has at most a few on their way at a time.
        for name in [n for n in names if n not in passed][:4]:
            if cases.tilt(simulation, name, *ends[name]) > math.radians(20):
                passed[name] = simulation.time
    rows = np.array([(k, passed[n]) for k, n in enumerate(names) if n in passed and k >= 8])
    return {
        "fallen": float(len(passed)),
        "speed": float(cases.PITCH / np.polyfit(rows[:, 0], rows[:, 1], 1)[0]),
    }


# In water -----------------------------------------------------------------------------------------


def in_water(
    density: float, size: float, pull: float, bulk_modulus: float, touching: bool = True
) -> libmpm.Scene:
    """Return a disc of 8 cells in the middle of a closed box of water, `size` radii wide.

    `pull` is on the disc alone, m/s² downwards: its weight less its buoyancy, so that the water
    has no pressure to begin with. Without it the disc turns by 1 rad/s.
    """
    scene = libmpm.Scene(dimension=2, cell_size=1 / 8, lower=(0, 0), upper=(size, size))
    centre = (size / 2, size / 2)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(size, size)),
        material=materials.TaitFluid(bulk_modulus=bulk_modulus),
    )  # fmt: skip
    weight = boundaries.PlacedForce(axis="x", place=[0.0], value=[[0.0, -pull]])
    turning = libmpm.Field(components=(f"-(y - {centre[1]!r})", f"x - {centre[0]!r}"))
    scene.add_body(
        name="disc", shape=shapes.Sphere(centre=centre, radius=1.0),
        material=cases.solid(5e5, 0.3, density), subtract_from=("water",),
        velocity=(0.0, 0.0) if pull else turning, force=weight if pull else None,
    )  # fmt: skip
    walls = boundaries.Slip(cell="held")
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    if touching:
        scene.add_contact(name="wet", between=("disc", "water"), law=contacts.Fluid())
    return scene


def sink(bulk_modulus: float, touching: bool = True) -> Values:
    """A cylinder of twice the water's density starts to sink: potential flow has added mass 1."""
    g = 10.0
    simulation = simulate(in_water(2000.0, 12.0, g / 2, bulk_modulus, touching))
    values = {}
    for at in (0.25, 0.375):
        simulation.run(until=at)
        speed = -cases.mean(simulation, "disc", "velocity")[1]
        values[f"speed_at_{at:g}_s"] = float(speed / (g / 3 * at))
    return values


def spin() -> Values:
    """A disc that turns in water at rest: what is left after a radian."""
    simulation = simulate(in_water(1000.0, 6.0, 0.0, 2e5))

    def rate() -> float:
        x, v = (np.asarray(simulation.particles["disc"][a]) for a in ("position", "velocity"))
        x, v = x - x.mean(axis=0), v - v.mean(axis=0)
        return float((x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]).sum() / (x**2).sum())

    start = rate()
    simulation.run(until=1.0)
    return {"left": rate() / start}


def column(touching: bool) -> Values:
    """Water on an elastic column (Walhorn), 3 cells across: the reduced case, with contact."""
    from libmpm._src.advice.cases.case import Options
    from libmpm._src.advice.cases.coupled import _elastic_column, _tip

    parameters = {
        "cell_size": 0.004, "thickness": 0.0, "coarser": (), "bulk_modulus": 1e6, "until": 0.26,
        "density": 2500.0, "poissons_ratio": 0.0, "flip": 0.8,
    }  # fmt: skip
    scene = _elastic_column(parameters, Options())
    if touching:
        scene.add_contact(name="wet", between=("column", "water"), law=contacts.Fluid())
    peak, time, arrival = _tip(simulate(scene, precision="single"), parameters["until"])
    return {"tip_mm": 1e3 * peak, "time": time, "arrival": arrival}


BOTH = (("contact", True), ("one field", False))
ROWS: dict[str, Callable[[], Iterator[tuple[str, Callable[[], Values]]]]] = {
    "press": lambda: ((f"offset {o:g}", lambda o=o: press(o)) for o in (0.0, 0.25, 0.5)),
    "hertz": lambda: (
        (f"R {n}, offset {o:g}", lambda n=n, o=o: hertz(n, o))
        for n, o in ((32, 0.0), (16, 0.0), (16, 0.5), (8, 0.0), (8, 0.5))
    ),
    "oblique": lambda: (
        (f"b {b:g}, turned {t:g}", lambda b=b, t=t: oblique(b, t))
        for b, t in ((0.5, 0.0), (0.7, 20.0))
    ),
    "pile": lambda: iter([("20 discs, single", pile)]),
    "plate": lambda: ((f"{n:g} cells", lambda n=n: plate(n)) for n in (1.0, 0.5)),
    "squeeze": squeezes,
    "dominoes": lambda: (
        (f"friction {mu:g}, {n} cells", lambda mu=mu, n=n: dominoes(mu, n))
        for mu, n in ((0.3, 3), (0.0, 3), (0.6, 3), (0.3, 4))
    ),
    "sink": lambda: (
        (f"density 2, R 8, K {k:g} Pa{'' if on else ', one field'}", lambda k=k, on=on: sink(k, on))
        for k, on in ((2e5, True), (2e6, True), (2e6, False))
    ),
    "spin": lambda: iter([("R 8", spin)]),
    "bars": lambda: ((name, lambda on=on: bars(on)) for name, on in BOTH),
    "column": lambda: ((name, lambda on=on: column(on)) for name, on in BOTH),
}


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("rows", nargs="*", help="names of cases; all unless given")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--list", action="store_true", help="the names")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(ROWS))
        return 0
    unknown = [name for name in arguments.rows if name not in ROWS]
    if unknown:
        parser.error(f"unknown {', '.join(unknown)}; expected {', '.join(ROWS)}")
    done = {(x["case"], x["row"]) for x in load(arguments.output)}
    for case in arguments.rows or ROWS:
        for row, measure in ROWS[case]():
            if (case, row) in done:
                continue
            values = measure()
            line = {"case": case, "row": row, "values": values, "commit": bench.commit(),
                    "version": libmpm.__version__}  # fmt: skip
            append(arguments.output, line)
            print(case, row, {k: round(v, 5) for k, v in values.items()}, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
