"""Bodies that touch against closed forms: what `docs/contact.md` says of them, one line a row.

    python benchmarks/contact.py                    all rows, more than an hour on one thread
    python benchmarks/contact.py press sink         some
    python benchmarks/contact.py --list             their names

2D, double precision, APIC unless a row says otherwise. Rows go to benchmarks/results/contact.jsonl
with what is right, where that is known. Rows that are there are kept.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from contact_bars import bars
from contact_faces import hertz, press, rings, simulate, slope
from contact_squeeze import rows as squeezes
from contact_water import column, rises, sinks, spin
from numpy.typing import NDArray
from result_pages import append, load

import libmpm
from libmpm import boundaries, contacts, sensors, shapes
from libmpm._src.cli import bench

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))
RESULTS = ROOT / "benchmarks/results/contact.jsonl"

from support import contact_scenes as cases  # noqa: E402

Values = dict[str, float]
Numbers = NDArray[np.float64]


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
        "spin": float(abs(spin) / (friction * push * r / (0.5 * r**2))) if friction else 0.0,
        "restitution": float(-after / before),
        "momentum": float(np.abs(momentum).max() / (mass["left"].sum() * speed)),
        "nodes_ratio": float(series.impulse("tangential") / series.impulse("normal")),
    }


def head_on() -> Values:
    """Two discs of 16 cells that meet head on at 0.005 of the wave speed."""
    found = oblique(0.0, 0.0, 0.0)
    return {k: found[k] for k in ("restitution", "momentum")}


# Stack, pile, thin plate --------------------------------------------------------------------------


def stack(until: float) -> Values:
    """A stack of three blocks of 6 cells: fastest particle in the last tenth, way of a middle."""
    simulation = simulate(cases.stack())
    names = [f"block {k}" for k in range(3)]
    start = [cases.mean(simulation, n, "position") for n in names]
    simulation.run(until=0.9 * until, progress=False)
    fastest = 0.0
    while simulation.time < until - 1e-9:
        simulation.run(until=min(until, simulation.time + 0.002 * until), progress=False)
        for n in names:
            speed = np.linalg.norm(np.asarray(simulation.particles[n]["velocity"]), axis=1)
            fastest = max(fastest, float(speed.max()))
    way = [cases.mean(simulation, n, "position") - s for n, s in zip(names, start, strict=True)]
    dx = simulation.scene.cell_size
    return {
        "speed": fastest,
        "drift": float(max(abs(w[0]) for w in way) / dx),
        "sunk": float(max(-w[1] for w in way) / dx),
        "steps": float(simulation.steps),
    }


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


def dominoes(friction: float, cells: int, **other: float) -> Values:
    """A row of 24 dominoes, of which the first tips; speed of the front from the 8th on.

    And the deepest particle in a neighbour, cells, and what `blows` says of the tenth to twentieth.
    """
    count = 24
    scene = cases.dominoes(count, cells, friction, **other)
    names = [f"domino {k:02d}" for k in range(count)]
    pairs = range(9, 20)
    for k in pairs:
        load_of = sensors.ContactLoad(
            contact="tips", pair=(names[k], names[k + 1]), interval=2e-4
        )  # fmt: skip
        scene.add_sensor(name=names[k], sensor=load_of)
    simulation = simulate(scene, precision="single")
    ends = {}
    for name in names:
        y = cases.by_id(simulation, name, "position")[:, 1]
        ends[name] = (y > np.quantile(y, 0.75), y < np.quantile(y, 0.25))
    passed: dict[str, float] = {}
    deepest, times, tilts = 0.0, [], []
    while simulation.time < 1.6 and len(passed) < count:
        simulation.run(until=simulation.time + 1e-3, progress=False)
        times.append(simulation.time)
        tilts.append([cases.tilt(simulation, name, *ends[name]) for name in names])
        if len(times) % 2 == 0:
            front = names[max(0, len(passed) - 6) : len(passed) + 3]
            deepest = max(deepest, entered(simulation, front, ends))
        # The front has at most a few on their way at a time.
        for name in [n for n in names if n not in passed][:4]:
            if tilts[-1][names.index(name)] > math.radians(20):
                passed[name] = simulation.time
    rows = np.array([(k, passed[n]) for k, n in enumerate(names) if n in passed and k >= 8])
    loads = [simulation.sensors[names[k]] for k in pairs]
    return {
        "fallen": float(len(passed)),
        "speed": float(cases.PITCH / np.polyfit(rows[:, 0], rows[:, 1], 1)[0]),
        "deepest": deepest / simulation.scene.cell_size,
        **blows(loads, np.array(times), np.array(tilts)[:, pairs[0] : pairs[-1] + 2]),
    }


def blows(loads: list[Any], times: Numbers, tilts: Numbers) -> Values:
    """Return what dominoes strike the next ones with; rigid ones slide all the while.

    Tilt of the striker at first, degrees; impulse along the face of the struck one over that across
    it, in the first 4 ms and from then until it has turned by 20 degrees. Means of the pairs.
    """
    found = []
    for k, load_on in enumerate(loads):
        middle = load_on.time - 1e-4
        angle = np.interp(middle, times, tilts[:, k + 1])
        x, y = np.nan_to_num(load_on["force_x"]), np.nan_to_num(load_on["force_y"])
        across = np.abs(x * np.cos(angle) - y * np.sin(angle))
        along = -(x * np.sin(angle) + y * np.cos(angle))
        if not across.any():
            continue
        first = middle[np.flatnonzero(across)[0]]
        early = middle < first + 4e-3
        late = ~early & (angle < math.radians(20))
        shares = [along[part].sum() / across[part].sum() for part in (early, late)]
        found.append([math.degrees(np.interp(first, times, tilts[:, k])), *shares])
    strikes_at, along_first, along_then = (float(x) for x in np.mean(found, axis=0))
    return {"strikes_at": strikes_at, "along_first": along_first, "along_then": along_then}


def entered(
    simulation: libmpm.Simulation, names: list[str], ends: dict[str, tuple[Numbers, Numbers]]
) -> float:
    """Return how deep, m, the deepest particle of a domino is in the rectangle of its neighbour."""
    deepest = 0.0
    place = {n: cases.by_id(simulation, n, "position") for n in names}
    for one, other in itertools.pairwise(names):
        for a, b in ((one, other), (other, one)):
            up = place[b][ends[b][0]].mean(axis=0) - place[b][ends[b][1]].mean(axis=0)
            up /= np.linalg.norm(up)
            off = place[a] - place[b].mean(axis=0)
            high, wide = np.abs(off @ up), np.abs(off @ np.array([up[1], -up[0]]))
            inside = np.minimum(cases.HIGH / 2 - high, cases.THICK / 2 - wide)
            deepest = max(deepest, float(inside.max()))
    return deepest


def rows_of_dominoes() -> Iterator[tuple[str, Callable[[], Values]]]:
    """Rows of dominoes: cells and friction, then what else may change the speed."""
    for n, mu in itertools.product((3, 4, 6), (0.3, 0.0, 0.6)):
        yield f"friction {mu:g}, {n} cells", lambda mu=mu, n=n: dominoes(mu, n)
    others: dict[str, dict[str, float]] = {
        "floor 0.6": {"floor": 0.6},
        "floor 5": {"floor": 5.0},
        "E 12 MPa": {"modulus": 12e6},
        "E 0.75 MPa": {"modulus": 0.75e6},
    }
    for name, other in others.items():
        yield f"friction 0.3, 4 cells, {name}", lambda o=other: dominoes(0.3, 4, **o)


BOTH = (("contact", True), ("one field", False))
ROWS: dict[str, Callable[[], Iterator[tuple[str, Callable[[], Values]]]]] = {
    "press": lambda: ((f"offset {o:g}", lambda o=o: press(o)) for o in (0.0, 0.25, 0.5)),
    "slope": lambda: (
        (f"12 x 6 cells, grid turned {t}, friction {mu:g}", lambda mu=mu, t=t: slope(mu, float(t)))
        for t in (0, 15, 30)
        for mu in (0.0, 0.3)
    ),
    "hertz": lambda: (
        (f"R {n}, offset {o:g}", lambda n=n, o=o: hertz(n, o))
        for n, o in ((32, 0.0), *((n, o) for n in (16, 8) for o in (0.0, 0.125, 0.25, 0.375, 0.5)))
    ),
    "head on": lambda: iter([("R 16", head_on)]),
    "stack": lambda: ((f"6 cells, {t} s", lambda t=t: stack(float(t))) for t in (4, 6, 8)),
    "oblique": lambda: (
        (f"b {b:g}, turned {t:g}", lambda b=b, t=t: oblique(b, t))
        for b, t in ((0.5, 0.0), (0.7, 20.0))
    ),
    "pile": lambda: iter([("20 discs, single", pile)]),
    "plate": lambda: ((f"{n:g} cells", lambda n=n: plate(n)) for n in (1.0, 0.5)),
    "squeeze": squeezes,
    "dominoes": rows_of_dominoes,
    "sink": sinks,
    "rise": rises,
    "spin": lambda: iter([("R 8", spin)]),
    "bars": lambda: ((name, lambda on=on: bars(on)) for name, on in BOTH),
    "column": lambda: ((name, lambda on=on: column(on)) for name, on in BOTH),
}


#: What is bound, by case: (quantity, least, most). Sources: the comments, `docs/contact.md`.
BOUNDS: dict[str, list[tuple[str, float, float]]] = {
    "press": [("rest_gap", -0.01, 0.01), ("near", 0.95, 1.03), ("spread", 0.0, 0.06)],
    "slope": [("error", -0.03, 0.03)],
    "head on": [("restitution", 0.93, 1.0), ("momentum", 0.0, 1e-12)],
    "stack": [("speed", 0.0, 1e-5), ("drift", 0.0, 0.02)],
    "oblique": [("ratio", 0.08, 0.12), ("spin", 0.8, 1.2)],
    "rise": [("acceleration", 0.75, 1.25)],
    "spin": [("left", 0.97, 1.03)],
    "sink": [("speed_at_0.25_s", 0.9, 1.15), ("speed_at_0.375_s", 0.9, 1.15)],
}
#: Speed of the front of rigid dominoes, m/s, by friction, and what it may be off.
FRONT = {0.0: (1.170, 0.05), 0.3: (0.827, 0.05), 0.6: (0.641, 0.1)}


def bounds(case: str, row: str) -> list[tuple[str, float, float]]:
    """Return what is bound in a row."""
    if case == "dominoes" and row.endswith("cells"):
        speed, off = FRONT[float(row.split(",")[0].split()[1])]
        return [
            ("fallen", 24, 24), ("speed", (1 - off) * speed, (1 + off) * speed),
            ("deepest", 0.0, 0.7),
        ]  # fmt: skip
    if case == "hertz" and row.startswith("R 32"):
        off = {"0.32": 0.1, "0.59": 0.05, "0.96": 0.03}
        return [(f"force_at_{d}_cells", -b, b) for d, b in off.items()]
    if case == "hertz":
        radius = int(row.split(",")[0].split()[1])
        return [(f"shift_at_{d * radius:.2f}_cells", -0.08, 0.08) for d in (0.01, 0.0184, 0.03)]
    if case == "stack" and not row.endswith(" 8 s"):
        return []  # the bound is that of 44,000 steps
    return BOUNDS.get(case, [])


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("rows", nargs="*", help="names of cases; all unless given")
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--only", default="", help="rows whose names begin so")
    parser.add_argument("--again", action="store_true", help="rows that are in the file too")
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
            if ((case, row) in done and not arguments.again) or not row.startswith(arguments.only):
                continue
            values = measure()
            limits = [x for x in bounds(case, row) if x[0] in values]
            met = [bool(low <= values[k] <= high) for k, low, high in limits]
            line = {"case": case, "row": row, "values": values,
                    "bounds": [f"{k} from {low:.4g} to {high:.4g}" for k, low, high in limits],
                    "met": met, "hardware": "CPU", "commit": bench.commit(),
                    "version": libmpm.__version__}  # fmt: skip
            append(arguments.output, line)
            print(case, row, {k: round(v, 5) for k, v in values.items()}, met, flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
