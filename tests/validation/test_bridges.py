"""Bores from a Riemann inlet, alone and against a deck: Yang (2016) 5.2 and 6.1 (V7, V8).

Curves of the source are not to hand. What is held to are the shallow-water equations, which its
inlets come from, balances, and what its text states.

Expected duration: 8 s.
"""

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm.analysis import Signal

pytestmark = pytest.mark.validation

FLUME = 0.2
BORE = boundaries.riemann_inlet(reservoir_depth=0.518, flume_depth=FLUME)
FRONT, LENGTH, DEPTH = 1.0, 0.5, 0.05  # m: of the deck


def flume(dx, outlet, bulk_modulus=1e6, soffit=None, before=0.5, **how):
    """Water that a bore enters at x = 0, with a deck where a soffit is given."""
    scene = libmpm.Scene(
        dimension=2, cell_size=dx, lower=(-before, 0), upper=(outlet, 0.9), gravity=(0, -9.81),
        method=libmpm.Method(leaving="delete", transfer="APIC"),
    )  # fmt: skip
    water = shapes.Box(lower=(-before, 0), upper=(0, BORE.depth))
    scene.add_body(
        name="water",
        shape=water | shapes.Box(lower=(0, 0), upper=(outlet, FLUME)),
        material=materials.TaitFluid(density=1000, bulk_modulus=bulk_modulus),
        particles_per_cell=9,
        velocity=libmpm.Field(components=(f"where(x < 0, {BORE.velocity!r}, 0)", "0")),
        hydrostatic=FLUME,
        **how,
    )
    bed = shapes.DomainWalls(faces=("y-",))
    scene.add_boundary(name="bed", shape=bed, response=boundaries.Slip(cell="held"))
    inlet = boundaries.Inflow(body="water", face="x-", velocity=BORE.velocity, level=BORE.depth)
    scene.add_flow(name="inlet", flow=inlet)
    due = outlet / BORE.speed
    leaves = libmpm.TimeTable((due - 0.01, due + 0.01), (0.0, BORE.velocity))
    scene.add_flow(name="outlet", flow=boundaries.Outflow(face="x+", velocity=leaves))
    if soffit is not None:
        deck = shapes.Box(lower=(FRONT, soffit), upper=(FRONT + LENGTH, soffit + DEPTH))
        scene.add_boundary(name="deck", shape=deck, response=boundaries.Separable(cell="held"))
        cell = sensors.LoadCell(boundary="deck", interval=0.01)
        scene.add_sensor(name="deck", sensor=cell)
        front = sensors.LoadCell(boundary="deck", faces=("x-",), interval=0.01)
        scene.add_sensor(name="front", sensor=front)
    return scene


def smooth(sim, sensor, component):
    """The source's mean of eleven samples without the largest and the smallest."""
    series = Signal.from_series(sim.sensors[sensor], component)
    return series.resampled(0.01).moving_mean(11, trim=1)


SMOOTHED = [{}, {"fbar": None, "smoothing": libmpm.methods.Smoothing(method="F0AL1")}]


# F-bar's front is 6 % late in cells of 0.05 m, 2 % in these; that of F0AL1 is not.
@pytest.mark.parametrize(
    ("dx", "how"), list(zip((0.025, 0.05), SMOOTHED, strict=True)), ids=["F-bar", "F0AL1"]
)
def test_a_bore_runs_as_the_shallow_water_equations_say(dx, how, device):
    """T6: front at h v / (h - h_R), behind it the inlet's depth and velocity; nothing is lost."""
    scene = flume(dx, 3.0, **how)
    places = (0.9, 1.8, 2.7)
    for x in places:
        gauge = sensors.ColumnGauge(position=(x,), interval=0.01)
        scene.add_sensor(name=f"{x:g}", sensor=gauge)
    sim = libmpm.Simulation(scene, device=device, threads=1)
    at_start = sim.particles["water"]["mass"].sum()
    sim.run(until=1.4, progress=False)
    half = 0.5 * (BORE.depth + FLUME)
    times = []
    for x in places:
        series = sim.sensors[f"{x:g}"]
        k = int(np.argmax(series.values[:, 0] > half))
        times.append(np.interp(half, series.values[k - 1 : k + 1, 0], series.time[k - 1 : k + 1]))
    speed = np.polyfit(times, places, 1)[0]
    assert speed == pytest.approx(BORE.speed, rel=0.05)
    gauge = sim.sensors["1.8"]
    behind = gauge.time > 1.8 / BORE.speed + 0.2
    level, velocity, _ = gauge.values[behind].mean(axis=0)
    assert level == pytest.approx(BORE.depth, rel=0.05)
    assert velocity == pytest.approx(BORE.velocity, rel=0.1)
    # What came in is there: ρ h v for all the time, up to a layer of particles.
    came = sim.particles["water"]["mass"].sum() - at_start
    expected = 1000 * BORE.depth * BORE.velocity * sim.time
    assert came == pytest.approx(expected, abs=1000 * BORE.depth * dx / 3)


def test_a_bore_pushes_a_deck(device):
    """V7, M1: no load before the front; its face carries the load; the first uplift is the largest.

    Between the stagnation pressure on the deck's own depth, and all of the water that the bore's
    momentum could hold back on twice of it, which the nodes around it cover.
    """
    scene = flume(0.025, 3.0, soffit=FLUME)
    sim = libmpm.Simulation(scene, device=device, threads=1)
    sim.run(until=1.1, progress=False)
    across, up = (smooth(sim, "deck", f"force_{a}") for a in "xy")
    due = FRONT / BORE.speed
    steady = across.time > due + 0.3
    push = across.value[steady].mean()
    stagnation = 0.5 * 1000 * BORE.velocity**2
    reach = DEPTH + 2 * 0.025
    hydrostatic = 1000 * 9.81 * (BORE.depth + stagnation / 9810 - FLUME - 0.5 * DEPTH)
    assert stagnation * DEPTH < push < (hydrostatic + stagnation) * reach
    assert np.abs(across.value[across.time < due - 0.15]).max() < 0.1 * push
    face = smooth(sim, "front", "force_x").value[steady].mean()
    assert face == pytest.approx(push, rel=0.05)
    assert across.value[steady].std() < 0.1 * push
    first = up.time < due + 0.3
    assert up.value[first].max() > 1.5 * up.value[~first].max() > 0


def test_a_deck_above_the_water_is_pushed_on(full, device):
    """V8: the steady load of 120 N without debris."""
    scene = flume(0.025, 3.0, soffit=0.225, before=1.0)
    sim = libmpm.Simulation(scene, device=device)
    sim.run(until=3.0, progress=False)
    force = smooth(sim, "deck", "force_x")
    assert force.value[force.time > 2.0].mean() == pytest.approx(120, rel=0.35)
