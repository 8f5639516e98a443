"""The bar and the column of de Koster (2018) as scenes, and what they should do.

`bar` and `column` build scenes on any grid of functions over blocks of four triangles; `trace` runs
one and follows its middle. References: linear waves in closed form, and for large deformations the
same law in one dimension, Lagrangian.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

import libmpm
from libmpm import boundaries, grids, materials, sensors, shapes

GRAVITY = 9.81


@dataclass(frozen=True)
class Bar:
    """A bar between two fixed ends, struck with v₀ sin(πx/L); sections 4.1 and 4.2."""

    density: float = 1.0
    young: float = 100.0
    speed: float = 0.1
    length: float = 25.0
    height: float = 2.0

    @property
    def wave_speed(self):
        return math.sqrt(self.young / self.density)

    @property
    def frequency(self):
        """Angular frequency of the first mode, rad/s."""
        return math.pi * self.wave_speed / self.length

    def linear(self, x, time):
        """Displacement and velocity of small vibrations; eqs. 4.2 and 4.3."""
        w = self.frequency
        shape = np.sin(np.pi * np.asarray(x) / self.length)
        return self.speed / w * np.sin(w * time) * shape, self.speed * np.cos(w * time) * shape

    def lagrangian(self, times, cells=400, place=0.5):
        """Displacement and velocity at a part of the length, by the law of the method."""
        return _lagrangian(
            self.length, self.density, self.young, times, cells,
            start=lambda x: self.speed * np.sin(np.pi * x / self.length), fixed_end=True,
            place=place,
        )  # fmt: skip


@dataclass(frozen=True)
class Column:
    """A column on which gravity acts from t = 0; sections 4.3 and 4.4."""

    height: float = 25.0
    width: float = 2.0
    density: float = 1.0
    young: float = 5e4

    @property
    def wave_speed(self):
        return math.sqrt(self.young / self.density)

    @property
    def period(self):
        return 4 * self.height / self.wave_speed

    def linear(self, y, time, terms=2000):
        """Displacement and velocity at a height of small vibrations; eq. 4.6, g > 0."""
        n = 2 * np.arange(1, terms + 1) - 1
        k, c = n * np.pi / (2 * self.height), self.wave_speed
        part = 2 * self.density * GRAVITY / (self.young * self.height * k**3) * np.sin(k * y)
        time = np.asarray(time)[..., None]
        u = self.density * GRAVITY / self.young * (y * y / 2 - self.height * y)
        return (
            u + (part * np.cos(c * k * time)).sum(-1),
            -(part * c * k * np.sin(c * k * time)).sum(-1),
        )

    def lagrangian(self, times, cells=400, place=0.5):
        """Displacement and velocity at a part of the height, by the law of the method."""
        return _lagrangian(
            self.height, self.density, self.young, times, cells, gravity=GRAVITY, place=place
        )

    @property
    def settled(self):
        """Displacement of the top at rest, from F = 1 / (1 + ρ g (H - X) / E)."""
        q = self.density * GRAVITY * self.height / self.young
        return self.height * (math.log1p(q) / q - 1)


SMALL_BAR, LARGE_BAR = Bar(), Bar(density=25.0, young=50.0)
SMALL_COLUMN, LARGE_COLUMN = Column(), Column(height=1.0, width=0.1, density=1000.0, young=1e5)


def _lagrangian(length, density, young, times, cells, *, start=None, gravity=0.0,
                fixed_end=False, place=0.5):  # fmt: skip
    """Solve ρ₀ü = ∂P/∂X - ρ₀g with P = E (1 - 1/F) by linear elements, lumped, and leapfrog."""
    x = np.linspace(0, length, cells + 1)
    h = length / cells
    mass = np.full(cells + 1, density * h)
    mass[[0, -1]] /= 2
    u, v = np.zeros(cells + 1), np.zeros(cells + 1) if start is None else start(x)

    def acceleration(u):
        stress = young * (1 - 1 / (1 + np.diff(u) / h))
        a = np.full(cells + 1, -gravity)
        a[:-1] += stress / mass[:-1]
        a[1:] -= stress / mass[1:]
        a[0] = 0
        if fixed_end:
            a[-1] = 0
        return a

    longest = 0.2 * h / math.sqrt(young / density)
    now, a = 0.0, acceleration(u)
    found = []
    at = round(place * cells)
    for time in times:
        steps = math.ceil((time - now) / longest - 1e-9)
        dt = (time - now) / steps if steps else 0.0
        for _ in range(steps):
            v += dt / 2 * a
            u += dt * v
            a = acceleration(u)
            v += dt / 2 * a
        now = time
        found.append((u[at], v[at]))
    return np.array(found).T


def blocks(columns, rows, width, height, basis, mass=None, empty_rows=0):
    """Return a grid of blocks of four triangles, with empty rows of blocks above."""
    top = height * (rows + empty_rows) / rows
    mesh = grids.Mesh.blocks(
        columns=columns, rows=rows + empty_rows, lower=(0.0, 0.0), upper=(width, top)
    )
    return grids.TriangularGrid(mesh=mesh, basis=basis, mass=mass or grids.ConsistentMass())


def _elastic(case):
    return materials.Hypoelastic(
        density=case.density, youngs_modulus=case.young, poissons_ratio=0.0
    )


def bar(case, grid, lattice, *, time_step=None, interval=0.0):
    """Return the scene of a bar with so many particles along and across it."""
    scene = libmpm.Scene(grid=grid, method=libmpm.Method(time_step=time_step), name="bar")
    formula = f"{case.speed!r} * sin(pi * x / {case.length!r})"
    scene.add_body(
        name="bar",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(case.length, case.height)),
        lattice=lattice,
        material=_elastic(case),
        velocity=libmpm.Field(components=(formula, "0")),
    )
    slip, sticky = boundaries.Slip(), boundaries.Sticky()
    scene.add_boundary(
        name="ends and sides",
        shape=shapes.DomainWalls(),
        response={"x-": sticky, "x+": sticky, "y-": slip, "y+": slip},
    )
    nx, ny = lattice
    _follow(scene, "bar", nx // 2 * ny + ny // 2, interval)
    return scene


def column(case, grid, lattice, *, time_step=None, interval=0.0):
    """Return the scene of a column with so many particles across and along it."""
    scene = libmpm.Scene(
        grid=grid, gravity=(0.0, -GRAVITY), method=libmpm.Method(time_step=time_step),
        name="column",
    )  # fmt: skip
    scene.add_body(
        name="soil",
        shape=shapes.Box(lower=(0.0, 0.0), upper=(case.width, case.height)),
        lattice=lattice,
        material=_elastic(case),
    )
    slip = boundaries.Slip()
    scene.add_boundary(
        name="box",
        shape=shapes.DomainWalls(faces=("x-", "x+", "y-")),
        response={"x-": slip, "x+": slip, "y-": boundaries.Sticky()},
    )
    nx, ny = lattice
    _follow(scene, "soil", nx // 2 * ny + ny // 2, interval)
    return scene


def _follow(scene, body, particle, interval):
    scene.add_sensor(
        name="middle", sensor=sensors.ParticleTracker(body=body, ids=(particle,), interval=interval)
    )


@dataclass(frozen=True)
class Trace:
    """Motion of the particle at the middle, and how the run ended."""

    time: np.ndarray
    place: np.ndarray  # (2,) at the start
    displacement: np.ndarray  # (n, 2)
    velocity: np.ndarray  # (n, 2)
    end: float
    error: str
    simulation: libmpm.Simulation


def trace(scene, until, **options):
    """Run a scene and return the motion of its middle; an error ends the run, not the call."""
    simulation = libmpm.Simulation(scene, **options)
    error = ""
    try:
        simulation.run(until=until, progress=False)
    except libmpm.NumericalError as fault:
        error = str(fault)
    seen = simulation.sensors["middle"]
    place = seen.values[0, :2]
    return Trace(
        seen.time, place, seen.values[:, :2] - place, seen.values[:, 2:], simulation.time, error,
        simulation,
    )  # fmt: skip


def rms(difference, reference):
    """Return the root mean square of a difference, as a part of the reference's largest value."""
    return float(np.sqrt(np.mean(np.square(difference))) / np.max(np.abs(reference)))


#: Tables 4.2 and 4.3 of the source: blocks -> E_u, m², of linear functions and of splines.
TABLE_42 = {4: 1.80956e-4, 8: 4.44076e-5, 16: 1.07531e-5, 32: 2.68352e-6}
TABLE_43 = {1: 3.70985e-4, 2: 3.13639e-5, 4: 3.56528e-6, 8: 4.90397e-7, 16: 1.76596e-7}


def bar_error(basis, blocks_along, per_block=(16, 14), **options):
    """Return E_u of eq. 4.4, m², of the small bar at 0.02 s, before any particle crosses."""
    case = SMALL_BAR
    grid = blocks(blocks_along, 1, case.length, case.height, basis)
    lattice = (per_block[0] * blocks_along, per_block[1])
    run = trace(bar(case, grid, lattice, time_step=1e-4), 0.02, **options)
    assert not run.error, run.error
    body = run.simulation.particles["bar"]
    start = (body["position"] - body["displacement"])[:, 0]
    expected, _ = case.linear(start, run.simulation.time)
    miss = body["displacement"][:, 0] - expected
    # Both fields grow with time alike; the last step may end a rounding past 0.02 s.
    scale = 0.02 / run.simulation.time
    return scale * float(np.sqrt((body["mass"] / case.density * miss**2).sum()))
