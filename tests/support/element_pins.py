"""Bodies of elements between pins: a stretched bar, and a cantilever beside the mesh alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
import scipy.sparse.linalg

import libmpm
from libmpm import boundaries, sensors
from libmpm.grids import Pin
from support.element_cases import Numbers, mesh_of, of_wave, solid, timoshenko
from support.element_load_cases import ramp

Array = npt.NDArray[np.float64]
DENSITY, MODULUS = 1000.0, 1e6


def moved(time: float, way: Sequence[float]) -> boundaries.Displacement:
    """Return a way that is gone over half a cosine."""
    rows = ramp(way, time)
    return boundaries.Displacement(libmpm.TimeTable(rows.time, rows.value, end="hold"))


def bar(d: int, pins: Any, cells: int = 4, edge: float = 0.5, **more: Any) -> libmpm.Scene:
    """Return a bar of 0.5 × 0.1 (× 0.1) m of elements in a room of its own; ν = 0."""
    dx = 0.1 / cells
    room = [round(x / dx) * dx for x in (0.9, 0.5, 0.5)[:d]]
    scene = libmpm.Scene(dimension=d, cell_size=dx, lower=(0,) * d, upper=room, **more)
    low = np.array([0.2, 0.2, 0.2][:d]) + 0.3 * dx
    scene.add_body(
        name="bar", shape=mesh_of(low, low + [0.5, 0.1, 0.1][:d], edge * dx),
        material=solid("NeoHookean", DENSITY, MODULUS, 0.0), pins=pins,
    )  # fmt: skip
    return scene


def stretched_bar(cells: int = 4, edge: float = 0.5, strain: float = 2e-3) -> Numbers:
    """Return the forces on the pins at both ends of a stretched bar over E A ε, plane strain."""
    long, wave = 0.5, math.sqrt(MODULUS / DENSITY)
    lasts = 8 * long / wave
    pins = (Pin(face="x-"), Pin(face="x+", motion=moved(lasts, (strain * long, 0.0))))
    scene = bar(2, pins, cells, edge, method=libmpm.Method(cfl=0.3))
    for k in (0, 1):
        sensor = sensors.PinForce(body="bar", pin=k, interval=lasts / 400)
        scene.add_sensor(name=f"pin {k}", sensor=sensor)
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    sim.run(until=lasts + 4 * long / wave, progress=False)
    # Stress of a neo-Hookean bar without lateral strain: E (λ - 1/λ) / 2, here ≈ E ε.
    expected = MODULUS * 0.1 * ((1 + strain) - 1 / (1 + strain)) / 2
    found = {}
    for k, (name, sign) in enumerate((("held", 1), ("driven", -1))):
        series = sim.sensors[f"pin {k}"]
        late = series.time > lasts
        found[f"force at {name} end"] = sign * float(series["force_x"][late].mean()) / expected
    return found


def mesh_alone(mesh: Any, ratio: float) -> float:
    """Return the first frequency, Hz, of a plane mesh whose lower end along x is fixed, ρ and E as
    here: linear triangles, small strains, lumped masses, without a grid."""
    x, n = mesh.vertices, len(mesh.vertices)
    lame = MODULUS * ratio / ((1 + ratio) * (1 - 2 * ratio))
    shear = MODULUS / (2 * (1 + ratio))
    law = np.array([[lame + 2 * shear, lame, 0], [lame, lame + 2 * shear, 0], [0, 0, shear]])
    rows, columns, values, mass = [], [], [], np.zeros(n)
    for element in mesh.elements:
        corner = np.c_[np.ones(3), x[element]]
        area, slope = 0.5 * np.linalg.det(corner), np.linalg.inv(corner)[1:]
        strain = np.zeros((3, 6))
        strain[0, 0::2] = strain[2, 1::2] = slope[0]
        strain[1, 1::2] = strain[2, 0::2] = slope[1]
        own = (2 * element[:, None] + [0, 1]).ravel()
        rows.append(np.repeat(own, 6))
        columns.append(np.tile(own, 6))
        values.append((area * strain.T @ law @ strain).ravel())
        mass[element] += DENSITY * area / 3
    free = np.flatnonzero(np.repeat(x[:, 0] > x[:, 0].min() + 1e-9, 2))
    at = np.concatenate(rows), np.concatenate(columns)
    stiff = scipy.sparse.csc_matrix((np.concatenate(values), at))[free][:, free]
    weight = scipy.sparse.diags(np.repeat(mass, 2)[free]).tocsc()
    square = scipy.sparse.linalg.eigsh(stiff.tocsc(), k=1, M=weight, sigma=0)[0][0]
    return float(math.sqrt(square) / (2 * math.pi))


def pinned_cantilever(cells: int = 4, edge: float = 0.5, ratio: float = 0.3) -> Numbers:
    """Return the frequency of a cantilever 1 × 0.1 m that is pinned at its end, plane strain.

    Over that of its mesh alone, and over Timoshenko's.
    """
    long, dx = 1.0, 0.1 / cells
    room = [(math.ceil(1.4 * long / dx) + 12) * dx, (math.ceil(0.6 * long / dx) + 16) * dx]
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(0, 0), upper=room, method=libmpm.Method(cfl=0.3)
    )
    low = np.array([8 * dx, 0.5 * room[1] - 0.05 + 0.2 * dx])
    mesh = mesh_of(low, low + np.array([long, 0.1]), edge * dx)
    scene.add_body(name="beam", shape=mesh, pins=Pin(face="x-"),
                   material=solid("NeoHookean", DENSITY, MODULUS, ratio))  # fmt: skip
    sim = libmpm.Simulation(scene, device="cpu", precision="double")
    beam = sim.particles["beam"]
    position = beam["position"]
    along = (position[:, 0] - low[0]) / long
    velocity, slope = np.zeros_like(position), np.zeros((len(position), 2, 2))
    velocity[:, 1] = 0.05 * along**2 * (3 - along) / 2
    slope[:, 1, 0] = 0.05 * (3 * along - 1.5 * along**2) / long
    beam["velocity"], beam["velocity_gradient"] = velocity, slope
    expected = timoshenko(long, 0.1, MODULUS, ratio, DENSITY, True)
    tip = position[:, 0] > position[:, 0].max() - 1e-6
    time, gone = [0.0], [0.0]
    while time[-1] < 3.3 / expected:
        sim.run(until=len(time) / (100 * expected), progress=False)
        time.append(sim.time)
        gone.append(float((beam["position"][tip, 1] - position[tip, 1]).mean()))
    found = of_wave(np.array(time), np.array(gone), expected)["frequency"]
    return {"over the mesh alone": found * expected / mesh_alone(mesh, ratio), "frequency": found}
