"""What sensors cost: the same run without any and with each kind at 1 kHz.

    python benchmarks/sensors.py [--device cpu] [--precision single] [--threads 0] [--seconds 0.1]
                                 [--only KIND ...]

76,800 particles of water in 3D, cells of 0.05 m, that fall against a column, and a block of 1,728
particles that is carried along. A line goes to benchmarks/results/sensors.jsonl: milliseconds a
step without sensors, and for each kind milliseconds a sample and its share of the run.
"""

from __future__ import annotations

import argparse
import time
import warnings
from pathlib import Path

from result_pages import append

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.cli import bench

RESULTS = Path(__file__).resolve().parents[1] / "benchmarks/results/sensors.jsonl"
EVERY = 1e-3
COLUMN = shapes.Box(lower=(2.0, 0.4, 0.0), upper=(2.2, 0.6, 1.0))
BESIDE = shapes.Box(lower=(1.8, 0.3, 0.0), upper=(2.3, 0.7, 0.6))
ALL = (
    "load cell", "gauge", "region of particles", "region of nodes", "volume of a region",
    "attribute of a body", "attributes by id", "pressure probe", "elevation gauge",
    "column gauge", "body tracker", "boundary force",
)  # fmt: skip


def sensor(name: str) -> sensors.Sensor:
    """Return a sensor of the kind."""
    at: dict[str, sensors.Sensor] = {
        "load cell": sensors.LoadCell(boundary="column", interval=EVERY),
        "gauge": sensors.WaveGauge(position=(1.5, 0.5), interval=EVERY),
        "region of particles": sensors.ParticleSensor(
            attribute="velocity", operation="mean", region=BESIDE, interval=EVERY
        ),
        "region of nodes": sensors.GridSensor(
            attribute="force", operation="sum", region=BESIDE, interval=EVERY
        ),
        "volume of a region": sensors.GridSensor(
            attribute="volume", operation="sum", region=BESIDE, interval=EVERY
        ),
        "attribute of a body": sensors.ParticleSensor(
            attribute="VonMisesStress", operation="max", body="block", interval=EVERY
        ),
        "attributes by id": sensors.AttributeTracker(
            body="water", ids=tuple(range(0, 76800, 9600)), attributes=("Pressure", "velocity"),
            interval=EVERY,
        ),
        "pressure probe": sensors.PressureProbe(position=(1.0, 0.5, 0.1), interval=EVERY),
        "elevation gauge": sensors.ElevationGauge(position=(1.5, 0.5), interval=EVERY),
        "column gauge": sensors.ColumnGauge(position=(1.5, 0.5), interval=EVERY),
        "body tracker": sensors.BodyTracker(
            body="block", quantities=("centroid", "velocity", "orientation"), interval=EVERY
        ),
        "boundary force": sensors.BodyTracker(
            body="block", quantities=("boundary_force",), interval=EVERY
        ),
    }  # fmt: skip
    return at[name]


def scene(names: tuple[str, ...]) -> libmpm.Scene:
    """Return water that falls, a block beside it and a column in its way, with sensors."""
    made = libmpm.Scene(
        dimension=3, cell_size=0.05, lower=(0, 0, 0), upper=(3, 1, 1.5), gravity=(0, 0, -9.81)
    )
    made.add_body(
        name="water", shape=shapes.Box(lower=(0, 0, 0), upper=(1.5, 1.0, 0.8)),
        material=materials.TaitFluid(bulk_modulus=2e6), particles_per_cell=8, hydrostatic=0.8,
    )  # fmt: skip
    made.add_body(
        name="block", shape=shapes.Box(lower=(1.6, 0.35, 0.1), upper=(1.9, 0.65, 0.4)),
        material=materials.FixedCorotated(density=600, youngs_modulus=5e6, poissons_ratio=0.3),
        particles_per_cell=8,
    )  # fmt: skip
    made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    made.add_boundary(name="column", shape=COLUMN, response=boundaries.Slip())
    for name in names:
        made.add_sensor(name=name, sensor=sensor(name))
    return made


def seconds(names: tuple[str, ...], given: argparse.Namespace) -> tuple[float, int]:
    """Return what a run takes, and its steps."""
    sim = libmpm.Simulation(
        scene(names), device=given.device, precision=given.precision, threads=given.threads
    )
    sim.step(20)
    begun, before = time.monotonic(), sim.steps
    sim.run(until=sim.time + given.seconds, progress=False)
    return time.monotonic() - begun, sim.steps - before


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--precision", default="single")
    parser.add_argument("--threads", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=0.1, help="of the clock of the scene")
    parser.add_argument("--only", nargs="*", default=[], help="these, and the run without any")
    parser.add_argument("--output", type=Path, default=RESULTS)
    given = parser.parse_args()
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    three = ("region of particles", "attribute of a body", "body tracker")
    cases = {"none": (), **{n: (n,) for n in ALL}, "region, attribute, body": three, "all": ALL}
    if given.only:
        cases = {name: cases[name] for name in ("none", *given.only)}
    seconds((), given)
    found = {}
    for name, names in cases.items():
        plain = min(seconds((), given)[0] for _ in range(2))
        took, steps = min(seconds(names, given) for _ in range(2))
        samples = round(given.seconds / EVERY)
        found[name] = {
            "ms_a_sample": round(1e3 * (took - plain) / samples, 4),
            "share_of_run": round((took - plain) / took, 4),
            "ms_a_step_without": round(1e3 * plain / steps, 4),
        }
        print(name, found[name], flush=True)
    line = {
        "values": found, "particles": 78528, "interval_s": EVERY, "seconds": given.seconds,
        "device": given.device, "precision": given.precision, "threads": given.threads,
        "commit": bench.commit(), "version": libmpm.__version__,
    }  # fmt: skip
    append(given.output, line)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
