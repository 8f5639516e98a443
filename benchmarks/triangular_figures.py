"""The figures of chapters 4 and 5 of de Koster (2018) and the runs behind them.

References: "exact" is the solution of small waves, eqs. 4.2 and 4.6; "1D" is the law of the method
in one dimension, which stands for the thesis's fine finite elements. Time steps and, where the
thesis does not state them, numbers of particles are this library's.
"""

from functools import partial

import numpy as np
from triangular_cost import bar_reference
from triangular_drawing import Figure, Panel, curve

import libmpm
from libmpm import grids
from support import triangular as t

RUN = {"device": "cpu", "threads": 1}  # so few particles that threads would wait for each other
P1, PS = grids.Linear(), grids.PowellSabin()

TIME, U, V = "time (s)", "displacement (m)", "velocity (m/s)"


def histories(*titles):
    """Displacement above and velocity below, a column for each title."""
    return tuple(tuple(Panel(TIME, y, title) for title in titles) for y in (U, V))


def _motion(run, axis, column, columns, label):
    end = f", stops at {run.end:.3f} s" if run.error else ""
    for row, values in enumerate((run.displacement, run.velocity)):
        yield curve(row * columns + column, label + end, run.time, values[:, axis])


def _references(column, columns, kind, label, time, u, v):
    for row, values in enumerate((u, v)):
        yield curve(row * columns + column, label, time, values, kind)


# --- The bar ---


def bar_run(case, basis, columns, rows, per_block, time_step, until, mass=None, interval=0.02):
    grid = t.blocks(columns, rows, case.length, case.height, basis, mass)
    lattice = (per_block[0] * columns, per_block[1] * rows)
    scene = t.bar(case, grid, lattice, time_step=time_step, interval=interval)
    return t.trace(scene, until, **RUN)


def small_bar(*cases):
    """Each case: speed, basis, label, blocks and particles of a block."""
    for column, (speed, basis, label, blocks, per_block) in enumerate(cases):
        case = t.Bar(speed=speed)
        run = bar_run(case, basis, blocks, 1, per_block, 2e-3, 10.0)
        yield from _motion(run, 0, column, len(cases), label)
        time = np.linspace(0, 10, 401)
        exact = case.linear(run.place[0], time)
        yield from _references(column, len(cases), "reference", "exact", time, *exact)


def large_bar(*cases):
    """Each case: basis, label, columns, rows, particles of a block and time step."""
    case = t.LARGE_BAR
    time = np.linspace(0, 36, 361)
    for column, (basis, label, columns, rows, per_block, step) in enumerate(cases):
        run = bar_run(case, basis, columns, rows, per_block, step, 36.0, interval=0.08)
        reference = bar_reference(case, time, run.place[0], per_block[0] * columns)
        yield from _motion(run, 0, column, len(cases), label)
        yield from _references(column, len(cases), "reference", "1D", time, *reference)


def convergence():
    for name, basis, table in (("P1", P1, t.TABLE_42), ("PS", PS, t.TABLE_43)):
        size = [t.SMALL_BAR.length / n for n in table]
        found = [t.bar_error(basis, n, **RUN) for n in table]
        yield curve(0, name, size, found, "marked")
        yield curve(0, f"{name}, thesis", size, list(table.values()), "printed")
        order = 2 if basis is P1 else 3
        ends = np.array([size[0], size[-1 if basis is P1 else 3]])
        kind = "reference" if basis is P1 else "second reference"
        yield curve(0, f"order {order}", ends, 0.6 * found[0] * (ends / size[0]) ** order, kind)


def lumped_bar():
    case, blocks = t.SMALL_BAR, 24
    x = np.linspace(0, case.length, 201)
    profile = []
    for label, basis, mass in (
        ("PS lumped", PS, grids.LumpedMass()), ("P1 lumped", P1, grids.LumpedMass()),
        ("PS consistent", PS, grids.ConsistentMass()),
    ):  # fmt: skip
        run = bar_run(case, basis, blocks, 1, (8, 6), 1e-3, 2.5, mass)
        yield curve(0, label, run.time, run.displacement[:, 0])
        body = run.simulation.particles["bar"]
        row = np.flatnonzero(np.arange(len(body["mass"])) % 6 == 3)
        profile.append(curve(1, label, body["position"][row, 0], body["velocity"][row, 0]))
    time = np.linspace(0, 2.5, 101)
    yield curve(0, "exact", time, case.linear(case.length / 2, time)[0], "reference")
    yield from profile
    yield curve(1, "exact", x, case.linear(x, run.simulation.time)[1], "reference")


# --- The column ---


def column_scene(case, basis, columns, rows, per_block, step, mass=None, empty=0, interval=1e-3):
    grid = t.blocks(columns, rows, case.width, case.height, basis, mass, empty)
    lattice = (per_block[0] * columns, per_block[1] * rows)
    return t.column(case, grid, lattice, time_step=step, interval=interval)


def small_column(*cases):
    """Each case: basis, label, columns, rows of blocks."""
    case, time = t.SMALL_COLUMN, np.linspace(0, 1, 401)
    for column, (basis, label, columns, rows) in enumerate(cases):
        run = t.trace(column_scene(case, basis, columns, rows, (6, 8), 2e-4), 1.0, **RUN)
        yield from _motion(run, 1, column, len(cases), label)
        exact = case.linear(run.place[1], time)
        yield from _references(column, len(cases), "reference", "exact", time, *exact)
        nonlinear = case.lagrangian(time, place=run.place[1] / case.height)
        yield from _references(column, len(cases), "second reference", "1D", time, *nonlinear)


def large_column(*panels, first=0, columns=None, until=0.8):
    """Each panel: cases of label and arguments of `column_scene`."""
    case, time = t.LARGE_COLUMN, np.linspace(0, until, 401)
    columns = columns or len(panels)
    for column, cases in enumerate(panels, first):
        for label, arguments in cases:
            run = t.trace(column_scene(case, interval=2e-3, step=5e-4, **arguments), until, **RUN)
            yield from _motion(run, 1, column, columns, label)
        reference = case.lagrangian(time, place=run.place[1] / case.height)
        yield from _references(column, columns, "reference", "1D", time, *reference)


def case_of(label, rows, per_block=(16, 18), basis=PS, columns=1, mass=None, empty=0):
    return label, {
        "basis": basis, "columns": columns, "rows": rows, "per_block": per_block, "mass": mass,
        "empty": empty,
    }  # fmt: skip


def _mesh(panel, mesh):
    corners = mesh.corners()
    closed = np.concatenate([corners, corners[:, :1], np.full((len(corners), 1, 2), np.nan)], 1)
    return curve(panel, "mesh", closed[..., 0], closed[..., 1], "mesh")


def positions(panel, until, arguments):
    """The mesh and the places of particles at a time."""
    scene = column_scene(t.LARGE_COLUMN, step=5e-4, **arguments)
    simulation = libmpm.Simulation(scene, **RUN)
    if until:
        simulation.run(until=until, progress=False)
    place = simulation.particles["soil"]["position"]
    yield _mesh(panel, scene.grid.mesh)
    yield curve(panel, "particles", place[:, 0], place[:, 1], "points")


def starved():
    arguments = case_of("", 8)[1]
    for panel, time in enumerate((0.0, 0.1)):
        yield from positions(panel, time, arguments)


def unsteady():
    yield from large_column([case_of("consistent", 8)], until=0.2)
    yield from watched()


def watched():
    """Smallest diagonal mass and 2/ω_max at every fourth step, in panels 2 and 3."""
    for label, rows, mass, empty, until in (
        ("consistent, 1 × 8", 8, None, 0, 0.4), ("consistent, 1 × 4", 4, None, 0, 0.4),
        ("partial, 1 × 8 + 1", 8, grids.PartialMass(), 1, 0.4),
        ("lumped, 1 × 8", 8, grids.LumpedMass(), 0, 0.4),
    ):  # fmt: skip
        arguments = case_of("", rows, mass=mass, empty=empty)[1]
        simulation = libmpm.Simulation(column_scene(t.LARGE_COLUMN, step=2e-4, **arguments), **RUN)
        seen = []
        try:
            while simulation.time < until:
                simulation.step(4)
                now = simulation.statistics
                seen.append((simulation.time, now["smallest_mass"], now["stable_step"]))
        except libmpm.NumericalError:
            now = simulation.statistics
            seen.append((simulation.time, now["smallest_mass"], now["stable_step"]))
        time, smallest, step = np.array(seen).T
        yield curve(2, label, time, smallest)
        yield curve(3, label, time, step)


def deactivated():
    cases = [
        case_of(f"M_ii < {below:g} left out", 8, mass=grids.ConsistentMass(deactivate_below=below))
        for below in (1e-3, 1e-2)
    ]
    yield from positions(0, 0.18, cases[1][1])
    yield from ({**c, "panel": 1 + c["panel"]} for c in large_column(cases))


# --- Grids and functions ---


def bar_grids():
    for panel, (blocks, per_block) in enumerate(((12, (8, 6)), (4, (16, 6)))):
        case = t.SMALL_BAR
        grid = t.blocks(blocks, 1, case.length, case.height, P1)
        yield _mesh(panel, grid.mesh)
        x, y = _lattice((case.length, case.height), (per_block[0] * blocks, per_block[1]))
        yield curve(panel, "particles", x, y, "points")


def column_grids():
    for panel, (case, columns, rows, per_block) in enumerate((
        (t.SMALL_COLUMN, 2, 16, (6, 8)), (t.SMALL_COLUMN, 1, 8, (6, 8)),
        (t.LARGE_COLUMN, 1, 4, (16, 18)),
    )):  # fmt: skip
        yield _mesh(panel, t.blocks(columns, rows, case.width, case.height, P1).mesh)
        lattice = (per_block[0] * columns, per_block[1] * rows)
        x, y = _lattice((case.width, case.height), lattice)
        yield curve(panel, "particles", x, y, "points")


def _lattice(size, lattice):
    x, y = ((np.arange(n) + 0.5) * length / n for length, n in zip(size, lattice, strict=True))
    return (a.ravel() for a in np.meshgrid(x, y))


def edge_functions():
    mesh = grids.Mesh.blocks(columns=2, rows=2, lower=(0.0, 0.0), upper=(1.0, 1.0))
    functions = grids.Functions(grids.TriangularGrid(mesh=mesh))
    vertices, _ = mesh.arrays()
    vertex = int(np.argmin(np.abs(vertices - (0.5, 1.0)).sum(axis=1)))
    axis = np.linspace(0, 1, 41)
    x, y = np.meshgrid(axis, axis)
    found = functions.evaluate(np.column_stack([x.ravel(), y.ravel()]))
    for q in range(3):
        value = np.where(found.function == 3 * vertex + q, found.value, 0.0).sum(axis=1)
        yield curve(q, f"function {q + 1}", axis, axis, "values", z=value)
        yield _mesh(q, mesh)


def _places(*titles):
    return (tuple(Panel("x (m)", "y (m)", title, equal=True) for title in titles),)


LUMPED = grids.LumpedMass()
ROWS, SYMMETRIC = grids.PartialMass(form="rows"), grids.PartialMass(form="symmetric")
DEEP = (6, 12)  # particles of a block of 2 × 16: 18 a triangle


FIGURES = (
    Figure(
        "bar_grids", "Figures 4.2 and 4.4",
        "Grids of the bar and particles at the start: 12 blocks for P1, 4 blocks for PS",
        tuple(row for title in ("P1, 12 × 1 blocks", "PS, 4 × 1 blocks") for row in _places(title)),
        bar_grids, size=(10.0, 1.4),
    ),
    Figure(
        "bar_small_linear", "Figure 4.3",
        "Middle of the vibrating bar, small deformations, P1 on 12 × 1 blocks (38 functions), 12 "
        "particles a triangle: particles cross at v₀ = 0.1 m/s and do not at 0.025 m/s",
        histories("v₀ = 0.1 m/s", "v₀ = 0.025 m/s"),
        partial(small_bar, (0.1, P1, "P1", 12, (8, 6)), (0.025, P1, "P1", 12, (8, 6))),
    ),
    Figure(
        "bar_small_spline", "Figure 4.5",
        "Middle of the vibrating bar, small deformations, PS on 4 × 1 blocks (42 functions)",
        histories("v₀ = 0.1 m/s"), partial(small_bar, (0.1, PS, "PS", 4, (16, 6))), size=(6.5, 3.2),
    ),
    Figure(
        "bar_convergence", "Figure 4.6, tables 4.2 and 4.3",
        "Error of the displacement of the bar at 0.02 s, 56 particles a triangle",
        ((Panel("width of a block (m)", "E_u (m²)", scale="log"),),), convergence, size=(6.0, 4.4),
    ),
    Figure(
        "bar_large_linear", "Figure 4.7",
        "Middle of the vibrating bar, large deformations, P1 on 16 × 1 blocks (50 functions)",
        histories("6 particles a triangle", "56 particles a triangle"),
        partial(large_bar, (P1, "P1", 16, 1, (6, 4), 0.02), (P1, "P1", 16, 1, (16, 14), 0.02)),
    ),
    Figure(
        "bar_large_spline", "Figure 4.8",
        "Middle of the vibrating bar, large deformations, PS: 78 functions and 20 particles a "
        "triangle, 249 functions and 90",
        histories("8 × 1 blocks", "16 × 2 blocks"),
        partial(large_bar, (PS, "PS", 8, 1, (10, 8), 0.02), (PS, "PS", 16, 2, (20, 18), 0.04)),
    ),
    Figure(
        "column_grids", "Figures 4.9 and 4.12",
        "Grids of the column and particles at the start: small deformations, P1 and PS; large",
        _places("2 × 16 blocks", "1 × 8 blocks", "1 × 4 blocks"), column_grids, size=(2.6, 6.0),
    ),
    Figure(
        "column_small", "Figure 4.10",
        "Middle of the soil column, small deformations, 12 particles a triangle: P1 with 83 "
        "functions, PS with 78",
        histories("P1, 2 × 16 blocks", "PS, 1 × 8 blocks"),
        partial(small_column, (P1, "P1", 2, 16), (PS, "PS", 1, 8)),
    ),
    Figure(
        "column_small_fine", "Figure 4.11",
        "The same on finer grids. The thesis lost PS on 2 × 16 blocks at 0.031 s; with a step "
        "below the limit of 0.99 ms it completes",
        histories("P1, 2 × 24 blocks", "PS, 2 × 16 blocks"),
        partial(small_column, (P1, "P1", 2, 24), (PS, "PS", 2, 16)),
    ),
    Figure(
        "column_large", "Figure 4.13",
        "Middle of the soil column, large deformations, 1 × 4 blocks, 72 particles a triangle: 14 "
        "functions for P1, 42 for PS",
        histories("P1", "PS"),
        partial(large_column, [case_of("P1", 4, basis=P1)], [case_of("PS", 4)]),
    ),
    Figure(
        "edge_functions", "Figures 5.1 and 5.2",
        "The three PS functions of the upper middle vertex: where a particle at the lower end of "
        "the support may be all that is left of their mass",
        _places("function 1", "function 2", "function 3"), edge_functions, size=(4.2, 3.6),
    ),
    Figure(
        "column_starved", "Figure 5.3",
        "Particles of the column on 1 × 8 blocks, consistent mass: the uppermost triangle empties",
        _places("0 s", "0.1 s"), starved, size=(2.6, 6.5),
    ),
    Figure(
        "column_consistent", "Section 5.1",
        "The column on 1 × 8 blocks with the consistent mass until it stops, and what foretells it",
        (
            (Panel(TIME, U), ),
            (Panel(TIME, V), ),
            (Panel(TIME, "smallest M_ii (kg/m)", log_y=True), ),
            (Panel(TIME, "2/ω_max (s)", log_y=True), ),
        ),
        unsteady, size=(7.0, 2.8),
    ),
    Figure(
        "column_deactivated", "Figure 5.4",
        "The column on 1 × 8 blocks, functions of too little mass left out: particles at 0.18 s "
        "(bound 0.01 kg/m), motion of the middle",
        ((*_places("bound 0.01 kg/m")[0], Panel(TIME, U), Panel(TIME, V)),),
        deactivated, widths=(0.4, 1, 1), size=(5.2, 4.2),
    ),
    Figure(
        "column_lumped", "Figure 5.5", "The column on 1 × 8 blocks with the lumped mass",
        histories("PS", "P1"),
        partial(large_column, [case_of("PS, lumped", 8, mass=LUMPED)],
                [case_of("P1, lumped", 8, mass=LUMPED, basis=P1)]),
    ),
    Figure(
        "column_lumped_fine", "Figure 5.6",
        "The column on 2 × 16 blocks with the lumped mass: no better",
        histories("PS, 18 particles a triangle"),
        partial(large_column, [case_of("PS, lumped", 16, DEEP, columns=2, mass=LUMPED)]),
        size=(6.5, 3.2),
    ),
    Figure(
        "bar_lumped", "Figure 5.7",
        "The small bar on 24 × 1 blocks with the lumped mass: its middle, and the velocity along "
        "it at 2.5 s",
        ((Panel(TIME, U), Panel("x (m)", V)),), lumped_bar, size=(6.0, 4.0),
    ),
    Figure(
        "column_partial", "Figure 5.8",
        "The column on 1 × 8 blocks and an empty one, partially lumped mass in both forms",
        histories("as published (rows)", "symmetric"),
        partial(large_column, [case_of("PS, rows", 8, mass=ROWS, empty=1)],
                [case_of("PS, symmetric", 8, mass=SYMMETRIC, empty=1)]),
    ),
    Figure(
        "column_partial_fine", "Section 5.4",
        "The same on 2 × 16 blocks and an empty row, 18 particles a triangle. The thesis lost it",
        histories("as published (rows)", "symmetric"),
        partial(large_column, [case_of("PS, rows", 16, DEEP, columns=2, mass=ROWS, empty=1)],
                [case_of("PS, symmetric", 16, DEEP, columns=2, mass=SYMMETRIC, empty=1)]),
    ),
)  # fmt: skip
