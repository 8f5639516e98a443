"""The trade-off table: every numerical choice on small cases with known answers, error and cost.

    python benchmarks/tradeoff.py run --output benchmarks/results/tradeoff.jsonl [--device cuda]
    python benchmarks/tradeoff.py table       prints the table of the lines in --output
    python benchmarks/tradeoff.py write       writes what is made of them: the tables of
                                              docs/method-tables.md, docs/atlas.md,
                                              docs/anti-locking.md and docs/contact.md, and
                                              python/libmpm/data/atlas.json
    python benchmarks/tradeoff.py check       exit 1 if one of the five is out of date

One JSON line for every option (`tradeoff_options`) and case (`tradeoff_cases`) it applies to. A run
goes on where an earlier one of the same size, device and version of the library stopped;
`--again` measures anew what is chosen; pages take the newest. `--budget` seconds end it early, and
the same command goes on. Runs come one after another in this process. The baseline
(APIC, quadratic splines, no F-bar, single precision) runs before and after every few options of a
case, and `cost` is the time per simulated second over the mean of the two; `baseline_spread` is
their difference over that mean. The clock is the processor time of this process on a CPU with one
thread, which others on the machine do not lengthen, and wall time else.

An option that breaks on a case has the library's error in `failed`.
"""

from __future__ import annotations

import argparse
import math
import shlex
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from atlas_data import DATA, shipped
from atlas_page import ATLAS, atlas_page
from result_pages import Line, append, load
from tradeoff_cases import MEASURED, Measured
from tradeoff_contact import CONTACT, contact_page
from tradeoff_locking import LOCKING, locking_page
from tradeoff_options import BASELINE, OPTIONS, Option
from tradeoff_table import PAGE, RESULTS, page, seconds, tables

import libmpm
from libmpm._src.advice.cases.choices import energies
from libmpm._src.cli import bench

#: Options between two runs of the baseline.
BETWEEN = 6

#: Seconds after which a run is given up: where a method blows up, time steps shrink without end.
PATIENCE = 40.0


class Overdue(Exception):
    """A run that is not done in time."""


@contextmanager
def patience(processor: bool) -> Iterator[None]:
    """Raise `Overdue` in what runs too long, in processor or wall time."""

    def stop(*_: Any) -> None:
        raise Overdue(f"not done after {PATIENCE:g} s")

    which, number = (
        (signal.ITIMER_PROF, signal.SIGPROF) if processor else (signal.ITIMER_REAL, signal.SIGALRM)
    )
    before = signal.signal(number, stop)
    signal.setitimer(which, PATIENCE)
    try:
        yield
    finally:
        signal.setitimer(which, 0)
        signal.signal(number, before)


# ---- running ------------------------------------------------------------------------------------


def read_energy(
    simulation: libmpm.Simulation, measured: Measured, parameters: Mapping[str, Any]
) -> Line:
    """Return change and largest gain of the mechanical energy since the start, parts of its scale.

    The change is that to the mean of the last tenth of the samples. Viscous losses count as change.
    """
    if measured.energy is None:
        return {"energy_drift": None, "energy_gain": None}
    energy = energies(simulation)["total"]
    scale = measured.energy(parameters, float(energy[0]))
    change = (energy - energy[0]) / scale
    return {
        "energy_drift": float(np.mean(change[-math.ceil(len(change) / 10) :])),
        "energy_gain": float(np.max(change)),
    }


def finite(value: float) -> float | None:
    """Return a number that JSON has a word for."""
    return float(value) if math.isfinite(value) else None


def measure(option: Option, measured: Measured, arguments: argparse.Namespace) -> Line:
    """Run one option on one case; a named error of the library is a result."""
    parameters = measured.parameters(option, arguments.size)
    line: Line = {
        "option": option.to_dict(), "case": measured.name, "kind": measured.kind,
        "level": arguments.size, "parameters": parameters, "state": measured.state,
        "precision": option.precision, "threads": arguments.threads, "failed": "",
    }  # fmt: skip
    try:
        scene, _ = measured.build(option, arguments.size)
        if measured.energy is not None and "energy" not in [s.name for s in scene.sensors]:
            sensor = libmpm.sensors.Energy(interval=measured.interval)
            scene.add_sensor(name="energy", sensor=sensor)
        simulation = libmpm.Simulation(
            scene, device=arguments.device, precision=option.precision, pipeline=option.pipeline,
            threads=arguments.threads,
        )  # fmt: skip
        plan = simulation.plan
        bodies = {b.name: plan.bytes_per_particle(b.name) for b in scene.bodies}
        line |= {
            "device": bench._device(simulation),
            "pipeline": plan.pipeline,
            "particles": plan.particles,
            "particles_per_cell": scene.bodies[0].particles_per_cell,
            "bytes_per_particle": max(bodies.values()),
            "bytes_per_node": plan.bytes_per_node,
        }
        simulation.step(1)  # memory and the first order of particles
        wall, processor = time.perf_counter(), time.process_time()
        with patience(arguments.device == "cpu"):
            values = measured.case.measure(simulation, parameters)
        line |= {
            "wall_s": time.perf_counter() - wall,
            "processor_s": time.process_time() - processor,
            "steps": simulation.steps,
            "simulated_s": simulation.time,
            "values": {k: finite(v) for k, v in values.items()},
            "errors": {
                k: finite(values[k] / e - 1 if e else values[k])
                for k, e in measured.expected.items()
            },
            **read_energy(simulation, measured, parameters),
        }
    except libmpm.Error as error:
        line["failed"] = f"{type(error).__name__}: {str(error).splitlines()[0][:300]}"
    except (ArithmeticError, IndexError, ValueError, Overdue) as error:
        # What is left of the water or the solid gives no number to read.
        line["failed"] = f"no result: {type(error).__name__}: {str(error)[:200]}"
    return line


def run_case(
    measured: Measured,
    options: Sequence[Option],
    arguments: argparse.Namespace,
    over: Callable[[], bool],
) -> Iterator[Line]:
    """Run the options on a case, with the baseline before and after every few of them.

    It ends early, with a last baseline, where the time is `over`.
    """
    common = {
        "device_kind": arguments.device.partition(":")[0],
        "commit": bench.commit(),
        "version": libmpm.__version__,
        "command": shlex.join(["python", "benchmarks/tradeoff.py", *sys.argv[1:]]),
    }
    first = next(o for o in OPTIONS if o.name == BASELINE)
    measure(first, measured, arguments)  # warms caches and device
    before = measure(first, measured, arguments) | common
    if before["failed"]:  # nothing to compare with
        yield before | {"cost": None, "baseline_spread": 0.0}
        return
    yield before | {"cost": 1.0, "baseline_spread": 0.0}
    for k in range(0, len(options), BETWEEN):
        lines = []
        for option in options[k : k + BETWEEN]:
            if over():
                break
            lines.append(measure(option, measured, arguments) | common)
        if not lines:
            return
        after = measure(first, measured, arguments) | common
        base = [seconds(b) for b in (before, after)]
        mean = sum(base) / 2
        beside = {"baseline_s": mean, "baseline_spread": abs(base[1] - base[0]) / mean}
        for line in lines:
            cost = None if "values" not in line else seconds(line) / mean
            yield line | {"cost": cost, **beside}
        yield after | {"cost": seconds(after) / mean, **beside}
        before = after


def key(line: Line) -> tuple[Any, ...]:
    """Return what a measurement belongs to."""
    return line["option"]["name"], line["case"], line["level"], line["device_kind"], line["version"]


def run(arguments: argparse.Namespace) -> int:
    """Measure what is missing and append it to the file."""
    warnings.simplefilter("ignore", libmpm.ModelWarning)
    kind = arguments.device.partition(":")[0]
    done = set() if arguments.again else {key(line) for line in load(arguments.output)}
    began = time.perf_counter()

    def over() -> bool:
        return time.perf_counter() - began > arguments.budget

    left = 0
    for measured in MEASURED:
        if arguments.cases and measured.name not in arguments.cases:
            continue
        own = (measured.name, arguments.size, kind, libmpm.__version__)
        missing = [
            o for o in OPTIONS
            if measured.applies(o, arguments.size)
            and (not arguments.options or o.name in arguments.options)
            and (o.name, *own) not in done
        ]  # fmt: skip
        if not missing:
            continue
        left += len(missing)
        if over():
            continue
        others = [o for o in missing if o.name != BASELINE]
        for line in run_case(measured, others, arguments, over):
            left -= line["option"]["name"] in {o.name for o in missing if o.name != BASELINE}
            append(arguments.output, line)
            told = line["failed"] or f"cost {line['cost']:.2f} {line['errors']}"
            print(f"{measured.name}: {line['option']['name']}: {told}", flush=True)
    print(f"{time.perf_counter() - began:.0f} s")
    if over() and left:
        print(f"stopped after --budget {arguments.budget:g} s; the same command goes on")
    return 0


def main() -> int:
    """Do what the command line says."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("what", choices=("run", "table", "write", "check"))
    parser.add_argument("--output", type=Path, default=RESULTS)
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N")
    parser.add_argument("--threads", type=int, default=1, help="CPU threads; 0 = all")
    parser.add_argument("--size", choices=("small", "device"), help="default: by the device")
    parser.add_argument("--cases", nargs="*", choices=[m.name for m in MEASURED])
    parser.add_argument("--options", nargs="*", choices=[o.name for o in OPTIONS])
    parser.add_argument(
        "--budget", type=float, default=math.inf, help="stop after so many s; go on when run again"
    )
    parser.add_argument("--again", action="store_true", help="also what the file has")
    arguments = parser.parse_args()
    arguments.size = arguments.size or ("small" if arguments.device == "cpu" else "device")
    if arguments.what == "run":
        return run(arguments)
    lines = load(arguments.output)
    if arguments.what == "table":
        print(tables(lines))
        return 0
    made = {
        PAGE: page(lines), ATLAS: atlas_page(lines), LOCKING: locking_page(lines),
        CONTACT: contact_page(lines), DATA: shipped(lines),
    }  # fmt: skip
    for path, text in made.items():
        if arguments.what == "write":
            path.write_text(text, encoding="utf-8")
        elif not path.exists() or text != path.read_text(encoding="utf-8"):
            print(f"{path} is out of date; run python benchmarks/tradeoff.py write")
            return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
