"""Several CUDA devices share a scene, or several ranks one device: the bits of one.

Expected duration: 60 s on two GPUs, 30 s on one.
"""

# ruff: noqa: F811  the fixture `pair` is imported

from __future__ import annotations

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.run.backends import cuda_status
from support.devices import pair  # noqa: F401

pytestmark = pytest.mark.gpu

DX = 0.05


def tank(cells, walls=None, **options):
    """An empty box of so many cells with walls and gravity along the last axis."""
    dimension = len(cells)
    scene = libmpm.Scene(
        dimension=dimension, cell_size=DX, lower=(0.0,) * dimension,
        upper=[n * DX for n in cells], gravity=(0.0,) * (dimension - 1) + (-9.81,), **options,
    )  # fmt: skip
    walls = boundaries.Slip() if walls is None else walls
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
    return scene


def box(low, high):
    return shapes.Box(lower=[k * DX for k in low], upper=[k * DX for k in high])


def water():
    return materials.TaitFluid(bulk_modulus=2e5)


def slosh(fbar=None, smoothing=None, **options):
    """A column of water that falls over and comes back."""
    scene = tank((48, 12, 24), **options)
    shape = box((0, 0, 0), (16, 12, 20))
    scene.add_body(name="water", shape=shape, material=water(), fbar=fbar, smoothing=smoothing)
    return scene


def carried(fbar=None, **options):
    """Water that carries a block past an obstacle which is weighed."""
    scene = tank((48, 16, 20), **options)
    scene.add_body(name="water", shape=box((0, 0, 0), (20, 16, 12)), material=water())
    scene.add_body(
        name="block", shape=box((13, 5, 9), (18, 10, 14)),
        material=materials.FixedCorotated(density=600.0, youngs_modulus=1e5), fbar=fbar,
        subtract_from=("water",),
    )  # fmt: skip
    scene.add_boundary(
        name="pier", shape=box((30, 5, 0), (34, 11, 16)),
        response=boundaries.Separable(static_friction=0.3, dynamic_friction=0.2),
    )  # fmt: skip
    scene.add_sensor(name="load", sensor=sensors.LoadCell(boundary="pier", interval=0.01))
    scene.add_sensor(name="energy", sensor=sensors.Energy(interval=0.01))
    scene.add_sensor(
        name="track", sensor=sensors.ParticleTracker(body="water", ids=(3, 5000), interval=0.02)
    )
    for k, x in enumerate((0.5, 0.9, 1.2)):  # before the cut, at it and behind it
        gauge = sensors.WaveGauge(position=(x, 0.41), interval=0.005)
        scene.add_sensor(name=f"gauge-{k}", sensor=gauge)
        probe = sensors.VelocityProbe(position=(x, 0.37, 0.21), interval=0.005)
        scene.add_sensor(name=f"probe-{k}", sensor=probe)
    return scene


def plane(**options):
    """A dam break in two dimensions."""
    scene = tank((160, 64), **options)
    scene.add_body(name="water", shape=box((0, 0), (72, 28)), material=water())
    return scene


def film():
    """So many blocks with so few particles that these go one by one."""
    scene = tank((272, 272, 8))
    scene.add_body(
        name="water", shape=box((4, 4, 0.1), (268, 268, 0.9)), material=water(), fbar=None,
        lattice=(330, 330, 1),
    )  # fmt: skip
    return scene


def mirrored():
    """Water beside walls that mirror."""
    scene = tank((32, 12, 16), walls=boundaries.Mirror() if hasattr(boundaries, "Mirror") else None)
    scene.add_body(name="water", shape=box((0, 0, 0), (12, 12, 12)), material=water())
    return scene


def by(transfer="APIC", kernel="quadratic"):
    if transfer in ("AFLIP", "ASFLIP"):
        transfer = libmpm.methods.Transfer(scheme=transfer, flip=0.97)
    elif transfer in ("XPIC", "FMPM"):
        transfer = libmpm.methods.Transfer(scheme=transfer, order=3)
    return {"method": libmpm.Method(transfer=transfer, kernel=kernel)}


def cells(method):
    return libmpm.methods.Smoothing(method=method)


def split():
    return libmpm.FBar(form="split", length=0.2)


#: Water in one pass where its transfer has one, blocks phased, and everything phased.
SCENES = {
    "water": (slosh, {}),
    "F-bar": (lambda: slosh("default"), {}),
    "block, pier, load": (carried, {}),
    "plane": (plane, {}),
    "lone particles": (film, {}),
    "mirrored walls": (mirrored, {}),
    "double": (slosh, {"precision": "double"}),
    "mixed": (carried, {"precision": "mixed"}),
    "FLIP": (lambda: carried(**by("FLIP")), {}),
    "AFLIP, F-bar": (lambda: slosh("default", **by("AFLIP")), {}),
    "ASFLIP, plane": (lambda: plane(**by("ASFLIP")), {}),
    "ASFLIP, double": (lambda: slosh(**by("ASFLIP")), {"precision": "double"}),
    "PIC": (lambda: carried(**by("PIC")), {}),
    "XPIC": (lambda: slosh(**by("XPIC")), {}),
    "FMPM, double": (lambda: slosh(**by("FMPM")), {"precision": "double"}),
    "smoothed by cells": (lambda: slosh(smoothing=cells("F0AL1")), {}),
    "smoothed by nodes": (lambda: slosh(smoothing=cells("NB")), {}),
    "smoothed, stored velocities": (lambda: slosh(smoothing=cells("C1"), **by("FLIP")), {}),
    "phased": (carried, {"pipeline": "phased"}),
    "cubic": (lambda: carried(**by("FLIP", "cubic")), {}),
    "F-bar on a solid": (lambda: carried(libmpm.FBar(form="two-volume", length=0.2)), {}),
    "split F-bar": (lambda: slosh(split()), {}),
    "split F-bar on one of two": (lambda: carried(split(), **by("AFLIP")), {}),
}


def simulate(scene, device="cuda:0", **options):
    return libmpm.Simulation(scene, device=device, **options)


def assert_same(one, many, names=("position", "velocity", "stress")):
    """Same bits of the same particles, whatever their order."""
    assert (one.time, one.steps) == (many.time, many.steps)
    for body in one.particles:
        order = [np.argsort(s.particles[body]["id"]) for s in (one, many)]
        for name in ("id", *names):
            a, b = (s.particles[body][name][o] for s, o in zip((one, many), order, strict=True))
            apart = int(np.count_nonzero(np.any(np.reshape(a != b, (len(a), -1)), axis=1)))
            assert apart == 0, f"{body} {name}: {apart} of {len(a)} particles differ"


@pytest.mark.parametrize("case", SCENES)
def test_bits_of_one(case, pair):
    """Every scene on two ranks ends with the bits of one; sensors to the rounding of sums."""
    make, options = SCENES[case]
    one, two = simulate(make(), **options), simulate(make(), pair, **options)
    assert two.ranks == 2
    for sim in (one, two):
        sim.step(5)
    assert_same(one, two)
    for sim in (one, two):
        sim.step(595)
    assert two.statistics["migrated"] > 0 or case == "lone particles"
    assert_same(one, two)
    if "smoothed" in case:
        a, b = (sim.smoothing["water"] for sim in (one, two))
        assert a["energy_change"].sum() < 0
        assert np.allclose(a["energy"], b["energy"], rtol=1e-11, atol=0)
    for name in one.sensors:
        a, b = one.sensors[name], two.sensors[name]
        assert (a.time == b.time).all()
        size = np.nanmax(np.abs(a.values), initial=0)
        assert np.allclose(a.values, b.values, rtol=0, atol=1e-10 * size, equal_nan=True)
        if name.startswith(("gauge", "probe")):  # these see single nodes
            assert np.isfinite(a.values).any()
            assert np.array_equal(a.values, b.values, equal_nan=True), name


def test_lone_particles_are_what_it_says():
    """The film of `SCENES` goes one by one: else its case tests nothing."""
    sim = simulate(film())
    sim.step(1)
    assert sim.statistics["lone"] > 0


@pytest.mark.parametrize("transfer", ["APIC", "AFLIP"])
def test_rebalance_and_migrate(pair, transfer):
    """All in a corner at the start, then everywhere: new cuts, no particle lost or doubled."""
    one, two = simulate(plane(**by(transfer))), simulate(plane(**by(transfer)), pair)
    for _ in range(6):
        for sim in (one, two):
            sim.step(500)
        ids = np.sort(two.particles["water"]["id"])
        assert (ids == np.arange(len(ids))).all()
    assert_same(one, two)
    assert two.statistics["rebalances"] > 0
    assert two.statistics["migrated"] > len(ids) / 10
    assert two.statistics["imbalance"] < 1.2  # of whole blocks, of which there are few here


def test_three_ranks():
    """Ranks that are neighbours and ranks that are not."""
    names = ["cuda:0", "cuda:0", "cuda:0"]
    if len(cuda_status().devices) > 1:
        names[1] = "cuda:1"
    one, three = simulate(slosh()), simulate(slosh(), names)
    for sim in (one, three):
        sim.step(400)
    assert_same(one, three)


@pytest.mark.parametrize("transfer", ["APIC", "AFLIP"])
def test_resume_on_another_number(tmp_path, pair, transfer):
    """From one to two and back in the middle of a run."""
    whole = simulate(slosh("default", **by(transfer)))
    whole.step(300)
    first = simulate(slosh("default", **by(transfer)))
    first.step(100)
    first.save_checkpoint(tmp_path / "one.npz")
    second = libmpm.Simulation.resume(tmp_path / "one.npz", device=pair)
    second.step(100)
    second.save_checkpoint(tmp_path / "two.npz")
    assert libmpm.Simulation.resume(tmp_path / "two.npz").ranks == 2
    third = libmpm.Simulation.resume(tmp_path / "two.npz", device="cuda:0")
    third.step(100)
    assert_same(whole, third)


def test_a_rank_that_fails_stops_all(pair):
    """Particles leave on one rank: both stop, and the message says who left."""
    scene = libmpm.Scene(
        dimension=2, cell_size=DX, lower=(0, 0), upper=(64 * DX, 64 * DX), gravity=(0, 0),
    )  # fmt: skip
    for name, x, speed in (("left", 8, (0.0, 0.0)), ("right", 48, (4.0, 0.0))):
        scene.add_body(
            name=name, shape=box((x, 24), (x + 12, 36)),
            material=materials.FixedCorotated(density=1000.0, youngs_modulus=1e5), velocity=speed,
        )  # fmt: skip
    two = simulate(scene, pair)
    with pytest.raises(libmpm.Error, match="left"):
        two.run(until=2.0)


def test_what_is_not_built_says_so(pair):
    """Refused by name, before the first step."""
    with pytest.raises(libmpm.DeviceError, match=r"cuda:77"):
        simulate(slosh(), ["cuda:0", "cuda:77"])
    with pytest.raises(libmpm.DeviceError, match="several devices"):
        simulate(slosh(), ["cuda:0", "cpu"])
