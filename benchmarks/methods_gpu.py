"""What transfers, kernels, pipelines and smoothing over cells cost: on a GPU that they fill.

The benchmark's collapsing water; the first line is the baseline (APIC, quadratic, fused) and runs
again last, so that the lines between can be compared with both. It has F-bar, which smoothing over
cells replaces; "APIC, plain" has neither.

Run:  python benchmarks/methods_gpu.py --particles 8000000 --steps 1000 --json FILE
      python benchmarks/methods_gpu.py --only smoothing --json FILE
      python benchmarks/methods_gpu.py --only phased --device cpu --threads 2 --particles 97336
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from one_gpu_scenes import sand, solid

import libmpm
from libmpm import FBar, Method
from libmpm._src.cli.bench import Result, collapse, timed
from libmpm.methods import METHODS, Kernel, Smoothing, Transfer

ASFLIP = Transfer(scheme="ASFLIP", flip=0.99, shift_max=0.1)

#: Rows of these names fall as a solid, without F-bar, from four cells above the floor.
SOLIDS = {"FixedCorotated": solid(), "DruckerPrager": sand()}

#: Rows of these names keep the water from packing.
PACKING = {"F-bar, shifting": FBar(shifting=True), "F-bar, density": FBar(density=True)}

#: Name -> (method, pipeline, precision)
ROWS: dict[str, tuple[Method, str, str]] = {
    "APIC": (Method(), "auto", "single"),
    "ASFLIP": (Method(transfer=ASFLIP), "auto", "single"),
    "AFLIP 0.99": (Method(transfer=Transfer(scheme="AFLIP", flip=0.99)), "auto", "single"),
    "FLIP": (Method(transfer="FLIP"), "auto", "single"),
    "APIC, two-pass": (Method(), "two-pass", "single"),
    "APIC, phased": (Method(), "phased", "single"),
    "ASFLIP, phased": (Method(transfer=ASFLIP), "phased", "single"),
    "PIC": (Method(transfer="PIC"), "auto", "single"),
    "FMPM(2)": (Method(transfer=Transfer(scheme="FMPM", order=2)), "auto", "single"),
    "XPIC(3), every 4th": (
        Method(transfer=Transfer(scheme="XPIC", order=3, every=4)), "auto", "single"
    ),
    "quadratic, gradient kernel": (Method(kernel=Kernel(gradient="kernel")), "auto", "single"),
    "uGIMP": (Method(kernel="ugimp"), "auto", "single"),
    "cubic": (Method(kernel="cubic"), "auto", "single"),
    "APIC, double": (Method(), "auto", "double"),
    "APIC, phased, double": (Method(), "phased", "double"),
    "ASFLIP, double": (Method(transfer=ASFLIP), "auto", "double"),
    "APIC, plain": (Method(), "auto", "single"),
    **{name: (Method(), "auto", "single") for name in PACKING},
    **{f"smoothing {name}": (Method(), "auto", "single") for name in METHODS},
    "smoothing F0AL1, two-pass": (Method(), "two-pass", "single"),
    "smoothing F0AL1, phased": (Method(), "phased", "single"),
    **{name: (Method(), "auto", "single") for name in SOLIDS},
    **{f"{name}, phased": (Method(), "phased", "single") for name in SOLIDS},
    "APIC again": (Method(), "auto", "single"),
}  # fmt: skip

#: What belongs to the cost of smoothing against F-bar.
OF_SMOOTHING = [
    "APIC", "APIC, two-pass", "APIC, phased", "APIC, plain",
    *(name for name in ROWS if name.startswith("smoothing")), "APIC again",
]  # fmt: skip

#: What it costs to keep water from packing.
OF_PACKING = ["APIC", *PACKING, "APIC again"]

#: What the phased step costs against the fused one.
OF_PHASES = [
    "APIC", "APIC, phased", "ASFLIP", "ASFLIP, phased", "PIC", "FMPM(2)", "XPIC(3), every 4th",
    "quadratic, gradient kernel", "uGIMP", "cubic", "APIC, double", "APIC, phased, double",
    "FixedCorotated", "FixedCorotated, phased", "DruckerPrager", "DruckerPrager, phased",
    "APIC again",
]  # fmt: skip


def case(name: str, particles: int) -> tuple[libmpm.Scene, float]:
    """Return the scene of a row, and its time step, s."""
    form = name.removeprefix("smoothing ").partition(",")[0]
    material = SOLIDS.get(form)
    scene, step = collapse(
        particles,
        "none" if name.endswith("plain") or material is not None else "default",
        material=material,
        lift=4 if material is not None else 0,
        method=ROWS[name][0],
        smoothing=Smoothing(method=form) if name.startswith("smoothing") else None,
    )
    if name in PACKING:
        scene.replace("water", fbar=PACKING[name])
    return scene, step


def measure(name: str, arguments: argparse.Namespace) -> Result:
    """Return what a row takes."""
    _, pipeline, precision = ROWS[name]
    scene, step = case(name, arguments.particles)
    simulation = libmpm.Simulation(
        scene, device=arguments.device, precision=precision, pipeline=pipeline, time_step=step,
        threads=arguments.threads,
    )  # fmt: skip
    simulation.step(20)
    state = f"steps 20 to {arguments.steps + 20} of the collapse, sorts included, no output"
    return timed(simulation, arguments.steps, case=f"methods: {name}", state=state)


def main() -> None:
    """Run the rows and append their lines."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--particles", type=int, default=8_000_000)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--rows", nargs="*", default=list(ROWS), help="names of rows")
    parser.add_argument(
        "--only", choices=["smoothing", "phased", "packing"], help="rows of this question alone"
    )
    parser.add_argument("--device", default="cuda")
    parser.add_argument("--threads", type=int, default=0, help="of a CPU; 0 = all")
    parser.add_argument(
        "--rounds", type=int, default=1, help="of all rows; the fastest run of each counts"
    )
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    if arguments.only:
        rows = {"smoothing": OF_SMOOTHING, "phased": OF_PHASES, "packing": OF_PACKING}
        arguments.rows = rows[arguments.only]
    results: dict[str, Result] = {}
    for _ in range(arguments.rounds):
        for name in arguments.rows:
            result = measure(name, arguments)
            before = results.get(name, result)
            results[name] = max(before, result, key=lambda r: r.particle_steps_per_s)
    baseline = next(iter(results.values())).particle_steps_per_s
    for name, result in results.items():
        share = result.particle_steps_per_s / baseline
        print(f"{name:<28} {result.particle_steps_per_s:.3e}  {share:.2f}  {result.pipeline}")
        if arguments.json is not None:
            line = json.loads(result.line()) | {"share_of_apic": round(share, 3)}
            line |= {"fastest_of": arguments.rounds} if arguments.rounds > 1 else {}
            with arguments.json.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")


if __name__ == "__main__":
    main()
