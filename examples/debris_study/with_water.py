"""Random fields of floating debris that a surge carries into a raised box: water once, debris many.

A flume with a still layer and a reservoir that is released at one end at t = 0. The trunk is the
water alone, until just before the bore reaches the field. Each case continues from there: blocks of
polyethylene (981 kg/m³) float at rest on the layer, at random places and angles, and the bore takes
them to the box, whose upstream face is a load cell. One more case has no debris.

Polyethylene hardly floats: it rises too slowly for a short bore and would pass below a box that
ends at the still water. So the box reaches as deep as the blocks do, and loads are those beyond the
still water's. The blocks' E is 1e7 Pa and the water's bulk modulus 1.6e6 Pa, whose sound of 40 m/s
is still above ten times the flow's speed: steps are longer than with the real values, and impacts
of the blocks softer.

Run:  python examples/debris_study/with_water.py --device cuda --threads-pool 8 --json FILE
      python examples/debris_study/with_water.py --reduced --device cpu
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import figures
import numpy as np
from record import add_arguments, costs, run, sharing, tell

import libmpm
from libmpm import analysis, boundaries, debris, demand, materials, sensors, shapes, studies

DENSITY, WATER, BULK_MODULUS = 981.0, 1000.0, 1.6e6
#: Cut-off of the loads, Hz, and the time between samples of the cell, s.
CUTOFF, INTERVAL = 100.0, 5e-4
#: Gap between blocks, m: two cells of 0.05 m.
GAP = 0.1
#: What a field is described by in the table of results.
MEASURES = ("c", "n", "theta15", "theta_mean", "theta_std", "s", "L_x", "L_y")


@dataclass(frozen=True)
class Flume:
    """The flume; its methods are the factories of the study. Lengths in m."""

    cell_size: float = 0.05
    length: float = 8.0
    width: float = 1.0
    height: float = 1.2
    reservoir: tuple[float, float] = (2.0, 0.9)
    """Length and depth of the water that is released."""
    still: float = 0.3
    """Depth of the still layer."""
    box: tuple[float, float, float, float] = (6.0, 6.5, 0.5, 0.5)
    """Upstream and downstream face, width and height of the box."""
    underside: float = 0.2
    """Its height above the floor: what floats does not pass below it."""
    footprint: tuple[float, float] = (1.5, 0.9)
    corner: float = 4.0
    """Upstream edge of the field's footprint, which lies in the middle of the width."""
    count: tuple[int, int] = (2, 6)
    block: tuple[float, float, float] = (0.5, 0.1, 0.1)
    youngs_modulus: float = 1e7
    """Pa."""
    release: float = 0.6
    """End of the trunk, s."""
    until: float = 3.0
    """End of the cases, s."""

    @classmethod
    def reduced(cls) -> Flume:
        """Return a flume for one core: 35,000 particles, softer blocks."""
        return cls(
            length=3.2,
            width=0.4,
            height=1.0,
            reservoir=(0.8, 0.8),
            box=(2.3, 2.5, 0.2, 0.4),
            footprint=(0.6, 0.36),
            corner=1.5,
            count=(1, 2),
            block=(0.3, 0.1, 0.1),
            youngs_modulus=1e6,
            release=0.2,
            until=1.3,
        )

    def prototype(self) -> debris.Prototype:
        """Return the block."""
        solid = materials.FixedCorotated(
            density=DENSITY, youngs_modulus=self.youngs_modulus, poissons_ratio=0.4
        )
        long, wide, high = self.block
        return debris.Prototype(length=long, width=wide, height=high, material=solid)

    def field(self, seed: int) -> debris.DebrisField:
        """Return a random field: count and angles are drawn."""
        return debris.random(
            self.prototype(),
            count=self.count,
            footprint=self.footprint,
            corner=(self.corner, 0.5 * (self.width - self.footprint[1])),
            clearance=GAP,
            seed=seed,
            samples=20,
        )

    def fills(self) -> dict[str, tuple[shapes.Box, float]]:
        """Return the boxes of water and their levels: the still layer goes around the box."""
        long, deep = self.reservoir
        front, back, wide, _ = self.box
        side = 0.5 * (self.width - wide)
        parts = {
            "reservoir": ((0, 0), (long, self.width), deep),
            "upstream": ((long, 0), (front, self.width), self.still),
            "downstream": ((back, 0), (self.length, self.width), self.still),
            "right": ((front, 0), (back, side), self.still),
            "left": ((front, self.width - side), (back, self.width), self.still),
        }
        fills = {
            name: (shapes.Box(lower=(*low, 0), upper=(*high, level)), level)
            for name, (low, high, level) in parts.items()
        }
        below = shapes.Box(lower=(front, side, 0), upper=(back, self.width - side, self.underside))
        return fills | {"below": (below, self.still)}

    def water(self) -> libmpm.Scene:
        """Return the trunk: reservoir, layer, walls, the box and its load cell."""
        scene = libmpm.Scene(
            dimension=3,
            cell_size=self.cell_size,
            lower=(0, 0, 0),
            upper=(self.length, self.width, self.height),
            gravity=(0, 0, -9.81),
            name="surge with debris",
        )
        fluid = materials.TaitFluid(density=WATER, bulk_modulus=BULK_MODULUS)
        for name, (shape, level) in self.fills().items():
            scene.add_body(name=name, shape=shape, material=fluid, hydrostatic=level)
        scene.add_boundary(
            name="walls", shape=shapes.DomainWalls(), response=boundaries.Separable()
        )
        front, back, wide, high = self.box
        side, bottom = 0.5 * (self.width - wide), self.underside
        body = shapes.Box(
            lower=(front, side, bottom), upper=(back, self.width - side, bottom + high)
        )
        scene.add_boundary(name="box", shape=body, response=boundaries.Separable())
        load = sensors.LoadCell(boundary="box", faces=("x-",), interval=INTERVAL)
        scene.add_sensor(name="load", sensor=load)
        gauge = sensors.WaveGauge(position=(self.corner, 0.5 * self.width), interval=0.01)
        scene.add_sensor(name="gauge", sensor=gauge)
        return scene

    def branch(self, checkpoint: Path, seed: int | None) -> libmpm.Scene:
        """Return a case: the trunk's water, and the field of a seed afloat on the layer."""
        scene = libmpm.Scene.from_checkpoint(checkpoint)
        if seed is not None:
            draught = DENSITY / WATER * self.block[2]
            self.field(seed).add_to(
                scene, elevation=self.still - draught, subtract_from=("upstream",)
            )
        return scene

    def load(self, case: studies.StudyCase) -> analysis.Signal:
        """Return the force on the box along the flow, N, beyond that of the still water."""
        found = analysis.Signal.from_series(case.sensors["load"], "force_x")
        still = found.plateau(0, self.release)
        return analysis.Signal(found.time, found.value - still, sampling="mean", start=found.start)

    def response(self, case: studies.StudyCase) -> dict[str, float]:
        """Return peaks and impulse of the load along the flow, and the field's measures."""
        found = analysis.responses(self.load(case), cutoff=CUTOFF)
        kept = ("f_max", "t_max", "f_first", "t_first", "impulse", "cutoff")
        numbers = {key: found[key] for key in kept}
        seed = case.parameters["seed"]
        measures = {} if seed is None else self.field(seed).metadata()
        # The mean gap of a single block does not exist.
        known = {key: measures.get(key) for key in MEASURES}
        return {key: float(item) for key, item in known.items() if item is not None} | numbers

    def study(self, folder: Path, fields: int, **options: Any) -> libmpm.Study:
        """Return the study of the water alone and of so many fields.

        `options` are those of `Simulation`, for all cases and the trunk.
        """
        seeds: list[int | None] = [None, *range(fields)]
        return libmpm.Study(
            folder,
            self.branch,
            [{"seed": seed} for seed in seeds],
            until=self.until,
            trunk=libmpm.studies.Trunk(self.water, until=self.release),
            response=self.response,
            options=options,
            name="debris in a surge",
        )


def study(folder: Path) -> libmpm.Study:
    """Return the study of 32 random fields, for ``libmpm study run``."""
    return Flume().study(folder, 32)


def draw(flume: Flume, folder: Path, made: libmpm.Study, result: studies.StudyResult) -> None:
    """Save the figure: one field before the box, loads over time, and how often they occur."""
    import matplotlib.pyplot as plt
    from matplotlib.patches import Rectangle

    figure, (plan, time, often) = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
    figures.plans([plan], {"seed 0": flume.field(0)})
    front, back, wide, _ = flume.box
    plan.add_patch(Rectangle((front, 0.5 * (flume.width - wide)), back - front, wide, color="0.6"))
    plan.set(xlim=(flume.corner - 0.2, back + 0.1), ylim=(-0.2, flume.width))

    cases = made.cases
    loads = {f"seed {case.parameters['seed']}": flume.load(case) for case in cases[1:5]}
    flume.load(cases[0]).low_pass(CUTOFF).plot(time, color="k", label="water alone")
    figures.histories(time, loads, CUTOFF)

    curve = demand.from_study(list(result.rows[1:]), "f_max")
    curve.plot(often)
    curve.save_csv(folder / "exceedance.csv")
    often.axvline(result["f_max"][0], color="k", linestyle="--", label="water alone")
    often.legend(fontsize="small")
    figure.savefig(folder / "with_water.png", dpi=120)


def main() -> None:
    """Run the study; print its table and what the trunk saved, write figure and CSV."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--fields", type=int, help="default 32, reduced 3")
    parser.add_argument("--cell-size", type=float, help="m; default 0.05")
    parser.add_argument("--reduced", action="store_true", help="a small flume for two cores")
    add_arguments(parser, "debris-with-water")
    a = parser.parse_args()
    flume = Flume.reduced() if a.reduced else Flume()
    if a.cell_size:
        flume = replace(flume, cell_size=a.cell_size)
    fields = a.fields or (3 if a.reduced else 32)
    if fields < 2:
        parser.error(f"--fields {fields}: a curve of exceedance needs at least two")
    made = flume.study(a.output / "study", fields, **sharing(a))
    result, seconds = run(made, a)
    result.save_csv(a.output / "with_water.csv")
    print(result)
    alone, loads = result["f_max"][0], result["f_max"][1:]
    print(
        f"largest load below {CUTOFF:.0f} Hz: water alone {alone:.0f} N; with debris "
        f"{loads.min():.0f} to {loads.max():.0f} N, median {np.median(loads):.0f} N"
    )
    print(
        f"trunk {result.trunk_wall_time:.1f} s, shared by {len(result)} cases: "
        f"{result.time_saved:.1f} s not run again"
    )
    draw(flume, a.output, made, result)
    tell(costs("debris study with water", result, seconds, a), a.json)


if __name__ == "__main__":
    main()
