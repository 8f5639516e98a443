"""Debris blocks that hit a rigid wall in air: ordered ones, then random fields of them.

The in-air studies of Bonus (2023), 10.3 and 10.4. No gravity, no fluid: blocks of 0.5 × 0.1 ×
0.05 m and 981 kg/m³ move at 1 m/s towards a wall that they may leave again. The scene is their plan
in plane strain; with Poisson's ratio 0 its forces per metre times the height are those of the
blocks, and v A √(ρE) is exact for one that hits head-on. The solid is fixed corotated, as in the
source, because blocks turn over: the small strain of linear elasticity would take that for strain.
`InAir(dimension=3, edge=0.5)` is the same in space, with blocks of finite elements
(`benchmarks/debris_elements.py`).

The nearest corner starts two cells from the wall, beyond the reach of the grid's functions. A run
ends when the last block has had time to reach the wall and to turn over: extent along the flow plus
0.6 m, divided by the speed. Ten fields were run 1.8 s longer, and no largest load changed.

E is 1e6 Pa, not the 8e8 Pa of the blocks in the flume: corners are then pressed in by 16 mm, which
a grid can resolve, and a step is 28 times longer.

Run:  python examples/debris_study/in_air.py --reduced
      python examples/debris_study/in_air.py --fields 100 --blocks 32 --output results/in_air
      libmpm study run examples/debris_study/in_air.py -o results/fields
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import figures
import numpy as np
from record import add_arguments, costs, run, sharing, tell

import libmpm
from libmpm import (
    analysis,
    boundaries,
    debris,
    demand,
    design,
    materials,
    sensors,
    shapes,
    studies,
)

LENGTH, WIDTH, HEIGHT = 0.5, 0.1, 0.05
DENSITY, SPEED = 981.0, 1.0
#: Angles of a single block, degrees against the flow.
ANGLES = tuple(11.25 * i for i in range(9))
#: Gap between blocks, m: two cells of 0.025 m, four of 0.0125 m. Nearer blocks share the grid's
#: velocities and move as one.
GAP = 0.05
#: Cells between the nearest corner and the wall at the start; room on the other sides, m, and the
#: way that the last block has left, m.
CLEAR, ROOM, AFTER = 2, 1.0, 0.6
#: In space: cells above and below the blocks.
OVER = 4
#: What a field is described by in the table of results.
MEASURES = ("c", "n", "theta15", "D_theta_75", "theta_mean", "theta_std", "s", "L_x", "L_y")
#: Share of a random field's footprint that blocks may cover at most.
COVERED = 0.3


@dataclass(frozen=True)
class InAir:
    """The choices of the studies; its methods are factories of fields, scenes and studies."""

    cell_size: float = 0.0125
    """Δx, m."""
    youngs_modulus: float = 1e6
    """E, Pa."""
    blocks: int = 32
    """Most blocks of a random field, ≥ 2."""
    dimension: int = 2
    """2, the plan in plane strain, or 3."""
    edge: float | None = None
    """Edge of finite elements, in cells; None = particles."""

    @property
    def head_on(self) -> float:
        """v A √(ρE) of one block, N."""
        return float(
            design.bar_force_of_material(
                velocity=SPEED,
                area=WIDTH * HEIGHT,
                density=DENSITY,
                youngs_modulus=self.youngs_modulus,
            )
        )

    @property
    def cutoff(self) -> float:
        """Cut-off of the loads, Hz: a wave crosses the width of a block in its period."""
        speed = design.sound_speed(bulk_modulus=self.youngs_modulus, density=DENSITY)
        return float(speed / WIDTH)

    # Fields -------------------------------------------------------------------------------------

    def block(self) -> debris.Prototype:
        """Return the block."""
        solid = materials.FixedCorotated(
            density=DENSITY, youngs_modulus=self.youngs_modulus, poissons_ratio=0.0
        )
        return debris.Prototype(length=LENGTH, width=WIDTH, height=HEIGHT, material=solid)

    def array(self, angle: float = 0.0, count: int = 1, gap: float = GAP) -> debris.DebrisField:
        """Return a row of blocks side by side, the whole turned by degrees against the flow."""
        return debris.ordered(self.block(), rows=1, columns=count, clearance=gap, rotation=angle)

    def field(self, seed: int) -> debris.DebrisField:
        """Return a random field: count, size, mean angle and spread are drawn, all uniform."""
        most = self.blocks
        return debris.random(
            self.block(),
            count=(2, most),
            side=(0.3 * most**0.5, 0.6 * most**0.5),
            porosity=(1 - COVERED, 1 - 1e-9),
            angles=debris.SpreadAngles(mean=(-90, 90), spread=(0, 45)),
            clearance=GAP,
            seed=seed,
            samples=100,
        )

    # Scenes -------------------------------------------------------------------------------------

    def scene(self, field: debris.DebrisField) -> libmpm.Scene:
        """Return the scene in which a field moves along x into the wall at x = 0."""
        dx = self.cell_size
        corners = field.rectangles().corners().reshape(-1, 2)
        low, high = corners.min(axis=0), corners.max(axis=0)
        # What rebounds first goes back for the whole time, at its speed of arrival at most.
        back = high[0] - low[0] + SPEED * self.until(field) + ROOM
        cells = np.ceil([back / dx, 0.5 * (high[1] - low[1] + 2 * ROOM) / dx])
        above = OVER * dx
        scene = libmpm.Scene(
            dimension=self.dimension,
            cell_size=dx,
            lower=(-cells[0] * dx, -cells[1] * dx, -above)[: self.dimension],
            upper=(0, cells[1] * dx, HEIGHT + above)[: self.dimension],
            name="debris in air",
        )
        start = field.moved((-CLEAR * dx - high[0], -0.5 * (low[1] + high[1])))
        start.add_to(
            scene,
            velocity=(SPEED, 0, 0)[: self.dimension],
            edge=None if self.edge is None else self.edge * dx,
        )
        walls = shapes.DomainWalls()
        scene.add_boundary(name="walls", shape=walls, response=boundaries.Separable())
        load = sensors.LoadCell(boundary="walls", faces=("x+",), interval=0.1 / self.cutoff)
        scene.add_sensor(name="load", sensor=load)
        return scene

    def until(self, field: debris.DebrisField) -> float:
        """Return the end of a run, s."""
        extent = np.ptp(field.rectangles().corners()[..., 0])
        return float((extent + AFTER) / SPEED)

    # Responses ----------------------------------------------------------------------------------

    def load(self, case: studies.StudyCase) -> analysis.Signal:
        """Return the force on the wall, N: that per metre of the plan times the height."""
        found = analysis.Signal.from_series(case.sensors["load"], "force_x")
        value = (HEIGHT if self.dimension == 2 else 1.0) * found.value
        return analysis.Signal(found.time, value, sampling="mean", start=found.start)

    def response(self, case: studies.StudyCase, field: debris.DebrisField) -> dict[str, float]:
        """Return loads, in N and parts of v A √(ρE), and impulses, in N·s and parts of m v."""
        load = self.load(case)
        found = analysis.responses(load, cutoff=self.cutoff)
        kept = ("f_max", "t_max", "f_first", "t_first", "impulse", "duration", "cutoff")
        momentum = float(field.table()["mass"].sum()) * SPEED
        return {key: found[key] for key in kept} | {
            "f_relative": found["f_max"] / self.head_on,
            "first_relative": found["f_first"] / self.head_on,
            "turned_back": found["impulse"] / momentum,
        }

    def plateau(self, case: studies.StudyCase) -> float:
        """Return the mean load, N, over the middle of the bar's pulse 2L √(ρ/E) after arrival."""
        load = self.load(case)
        length = 2 * LENGTH * (DENSITY / self.youngs_modulus) ** 0.5
        begin = load.arrival(level=0.5 * load.first_peak().value)
        return load.plateau(begin + 0.2 * length, begin + 0.8 * length)

    # Studies ------------------------------------------------------------------------------------

    def ordered(self, folder: Path, rows: list[dict[str, Any]]) -> libmpm.Study:
        """Return the study of arrays; rows have angle, count and gap."""

        def response(case: studies.StudyCase) -> dict[str, float]:
            found = self.response(case, self.array(**case.parameters))
            return found | {"plateau": self.plateau(case) / self.head_on}

        return libmpm.Study(
            folder,
            lambda **row: self.scene(self.array(**row)),
            rows,
            until=lambda **row: self.until(self.array(**row)),
            response=response,
            name="ordered blocks in air",
        )

    def angles(self, folder: Path) -> libmpm.Study:
        """Return the study of one block at nine angles."""
        return self.ordered(folder, studies.full_factorial({"angle": ANGLES}))

    def arrays(self, folder: Path, gap: float = GAP) -> libmpm.Study:
        """Return the study of one, two and four blocks in the front row at 0 and 45 degrees."""
        rows = studies.full_factorial({"angle": [0.0, 45.0], "count": [1, 2, 4], "gap": [gap]})
        return self.ordered(folder, rows)

    def random(self, folder: Path, number: int, **options: Any) -> libmpm.Study:
        """Return the study of so many random fields, whose measures join the results.

        `options` are those of `Simulation`, for all cases.
        """

        def response(case: studies.StudyCase) -> dict[str, float]:
            field = self.field(**case.parameters)
            measures: dict[str, Any] = {**field.metadata(thetas=(75,))}
            return {key: float(measures[key]) for key in MEASURES} | self.response(case, field)

        return libmpm.Study(
            folder,
            lambda seed: self.scene(self.field(seed)),
            [{"seed": seed} for seed in range(number)],
            until=lambda seed: self.until(self.field(seed)),
            response=response,
            options=options,
            name="random fields in air",
        )


def study(folder: Path) -> libmpm.Study:
    """Return the study of a hundred random fields, for ``libmpm study run``."""
    return InAir().random(folder, 100)


def tell_ordered(angles: studies.StudyResult, arrays: studies.StudyResult) -> None:
    """Print loads of ordered blocks in parts of v A √(ρE)."""
    print("angle      " + " ".join(f"{angle:6.2f}" for angle in angles["angle"]))
    for name, column in (("largest", "f_relative"), ("first", "first_relative")):
        print(f"{name:10} " + " ".join(f"{load:6.3f}" for load in angles[column]))
    print(f"mean of the pulse at 0 degrees: {angles['plateau'][0]:.4f}")
    for row in arrays.rows:
        print(f"{row['angle']:4.0f} degrees, {row['count']} in front: {row['f_relative']:.3f}")


def regressions(result: studies.StudyResult) -> dict[str, analysis.Regression]:
    """Return the three models of the source, and one that knows of blocks across the flow."""
    terms: dict[str, Any] = {name: name for name in ("linear", "dual", "multi")}
    terms["across"] = ["c", "sqrt theta15", "log n", "sqrt D_theta_75"]
    return {name: analysis.regression(result, "f_max", form) for name, form in terms.items()}


def draw(made: InAir, folder: Path, angles: Any, fields: libmpm.Study, fit: Any) -> None:
    """Save the four figures of the study."""
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots(figsize=(6, 4), layout="constrained")
    broadside = LENGTH / WIDTH
    figures.angle_curve(
        ax, angles["angle"], angles["f_relative"], angles["first_relative"], broadside
    )
    figure.savefig(folder / "angles.png", dpi=120)

    some = fields.cases[:4]
    names = {f"seed {case.parameters['seed']}": case for case in some}
    figure, grid = plt.subplots(2, 2, figsize=(8, 8), layout="constrained")
    drawn = {name: made.field(**case.parameters) for name, case in names.items()}
    figures.plans(grid.flat, drawn)
    figure.savefig(folder / "fields.png", dpi=120)

    figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
    figures.histories(ax, {name: made.load(case) for name, case in names.items()}, made.cutoff)
    figure.savefig(folder / "loads.png", dpi=120)

    figure, ax = plt.subplots(figsize=(5, 4.5), layout="constrained")
    fit.plot_parity(ax)
    figure.savefig(folder / "regression.png", dpi=120)


def main() -> None:
    """Run the ordered and the random study; print tables, write figures and CSV."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--fields", type=int, help="random fields; default 100, reduced 16")
    parser.add_argument("--blocks", type=int, help="most blocks of one; default 32, reduced 8")
    parser.add_argument("--cell-size", type=float, help="m; default 0.0125, reduced 0.025")
    parser.add_argument("--modulus", type=float, default=1e6, help="E in Pa; default 1e6")
    parser.add_argument("--reduced", action="store_true", help="a study for two cores")
    add_arguments(parser, "debris-in-air")
    a = parser.parse_args()
    fields, blocks, cell_size = (16, 8, 0.025) if a.reduced else (100, 32, 0.0125)
    made = InAir(
        cell_size=a.cell_size or cell_size, youngs_modulus=a.modulus, blocks=a.blocks or blocks
    )
    angles, _ = run(made.angles(a.output / "angles"), a)
    arrays, _ = run(made.arrays(a.output / "arrays"), a)
    print(f"v A √(ρE) = {made.head_on:.2f} N, loads below {made.cutoff:.0f} Hz")
    tell_ordered(angles, arrays)

    random = made.random(a.output / "fields", a.fields or fields, **sharing(a))
    result, seconds = run(random, a)
    drawn = [made.field(**case.parameters) for case in random.cases]
    debris.save_metadata(drawn, a.output / "metadata.csv")
    result.save_csv(a.output / "fields.csv")
    print(result)
    print(analysis.correlation(result, ["f_max", "c", "log n", "sqrt theta15", "sqrt D_theta_75"]))
    fits = regressions(result)
    for name, fit in fits.items():
        print(f"\n{name}\n{fit}")
    print(fits["multi"].residual_tests(["c", "log n", "sqrt theta15"], threshold=0.2))
    curve = demand.from_study(result, "f_max")
    curve.save_csv(a.output / "exceedance.csv")
    print(f"exceeded by one field in ten: {curve.at(0.1).load:.0f} N")
    draw(made, a.output, angles, random, fits["multi"])
    tell(costs("debris study in air", result, seconds, a), a.json)


if __name__ == "__main__":
    main()
