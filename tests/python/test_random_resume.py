"""Whatever a scene has in it, a run that is saved and resumed gives the bits of one that is not.

`pytest tests/python/test_random_resume.py --scenes 2000` tries more. Scenes of square cells without
flows are in `test_random_scenes.py`. Expected duration: 10 s.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, note, seed, settings
from hypothesis import strategies as st

import libmpm
from libmpm import boundaries, materials, sensors, shapes
from libmpm._src.methods.transfer import SCHEMES
from support import fuzzing, random_function_scenes

pytestmark = pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")

STEPS = 32
KEYS = ("id", "position", "velocity", "stress", "pressure")


def state(sim):
    """What particles show, by body and attribute, in the order of their ids."""
    found = {}
    for name, view in sim.particles.items():
        order = np.argsort(view["id"])
        for key in KEYS:
            found[name, key] = np.asarray(view[key])[order]
    return found


def _middle(sim):
    """What a custom sensor reads: where the water is, and of how many particles."""
    position = np.asarray(sim.particles["water"]["position"])
    return [len(position), *position.mean(axis=0)]


def check_resumed(scene, part, folder):
    """Steps in one go, and with a file after some of them: time, particles and sensors alike."""
    note(json.dumps(scene.to_dict()))
    own = [s.name for s in scene.sensors if isinstance(s.sensor, sensors.Custom)]
    functions = dict.fromkeys(own, _middle)

    def run(*parts):
        sim = libmpm.Simulation(scene, device="cpu", threads=1, functions=functions)
        for steps in parts:
            sim.step(steps)
        return sim

    whole = fuzzing.answer(lambda: run(STEPS))
    assume(not isinstance(whole, libmpm.Error))
    half = run(part)
    half.save_checkpoint(folder / "state.npz")
    other = libmpm.Simulation.resume(folder / "state.npz", device="cpu", functions=functions)
    other.step(STEPS - part)
    assert other.time == whole.time
    one, two = state(whole), state(other)
    for key, values in one.items():
        np.testing.assert_array_equal(two[key], values, err_msg=str(key))
    for name, series in whole.sensors.items():
        rows, again = np.asarray(series.values), np.asarray(other.sensors[name].values)
        np.testing.assert_array_equal(again, rows[len(rows) - len(again) :], err_msg=name)


def drawn(strategy, part):
    """Run a check with scenes of a strategy and a number of steps before the file."""

    def decorate(check):
        def run(request, tmp_path):
            @given(strategy, st.integers(1, STEPS - 1))
            def example(scene, first):
                check(scene, first, tmp_path)

            chosen = settings(
                max_examples=max(1, round(part * request.config.getoption("--scenes"))),
                derandomize=not request.config.getoption("--fuzz-seed"),
                deadline=None,
                database=None,
                print_blob=True,
                suppress_health_check=list(HealthCheck),
            )
            seed(request.config.getoption("--fuzz-seed"))(chosen(example))()

        run.__name__, run.__doc__ = check.__name__, check.__doc__
        return run

    return decorate


@drawn(random_function_scenes.scenes(), 0.25)
def test_grids_of_functions(scene, first, folder):
    """Every basis, mass and solver, particles that enter and leave cells, holds that end."""
    check_resumed(scene, first, folder)


@st.composite
def channels(draw):
    """Water that flows in and out past a block, with every sensor that is there for it."""
    scheme = draw(st.sampled_from(("APIC", "APIC", *SCHEMES)))
    numbers = {"flip": 0.9} if "FLIP" in scheme and scheme not in ("FLIP", "NFLIP") else {}
    numbers |= {"shift_max": 0.5} if "SFLIP" in scheme else {}
    transfer = libmpm.methods.Transfer(scheme=scheme, **numbers)
    scene = libmpm.Scene(
        dimension=2,
        cell_size=0.1,
        lower=(0, 0),
        upper=(1.6, 1),
        gravity=(0, -9.81),
        method=libmpm.Method(transfer=transfer, cfl=0.4),
    )
    water = materials.TaitFluid(density=1000.0, bulk_modulus=1e5)
    whole = shapes.Box(lower=(0, 0), upper=(1.6, 0.5))
    scene.add_body(name="water", shape=whole, material=water, hydrostatic=0.5,
                   velocity=(0.5, 0), subtract_from=())  # fmt: skip
    solid = materials.FixedCorotated(density=500.0, youngs_modulus=1e5, poissons_ratio=0.3)
    block = shapes.Box(lower=(0.8, 0.6), upper=(1.1, 0.8))
    scene.add_body(name="block", shape=block, material=solid)
    given = draw(st.sampled_from(("inlet", "outlet", "both", "none")))
    open_faces = {"inlet": ("x-",), "outlet": ("x+",), "both": ("x-", "x+"), "none": ()}[given]
    walls = tuple(f for f in ("x-", "x+", "y-", "y+") if f not in open_faces)
    smooth = draw(st.sampled_from((boundaries.Slip(), boundaries.Separable())))
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(faces=walls), response=smooth)
    speed = draw(st.sampled_from((0.5, libmpm.TimeTable((0.0, 0.03), (0.5, 0.8)))))
    if "x-" in open_faces:
        inlet = boundaries.Inflow(
            body="water", face="x-", velocity=speed, level=0.5, max_particles=2000
        )
        scene.add_flow(name="in", flow=inlet)
    if "x+" in open_faces:
        out = boundaries.Outflow(face="x+", velocity=draw(st.sampled_from((None, 0.5))))
        scene.add_flow(name="out", flow=out)
    part = {"region": shapes.Box(lower=(0, 0), upper=(0.8, 0.5)), "interval": 0.004}
    every = {
        "load": sensors.LoadCell(boundary="walls", interval=0.005),
        "gauge": sensors.WaveGauge(position=(0.5,), interval=0.004),
        "speed": sensors.ParticleSensor(attribute="speed", operation="max", body="water", **part),
        "force": sensors.GridSensor(attribute="force", operation="sum", direction="y+", **part),
        "body": sensors.BodyTracker(body="block", quantities=("velocity",), interval=0.003),
        "ids": sensors.AttributeTracker(
            body="water", ids=(7, 0), attributes=("pressure", "position"), interval=0.003
        ),
        "p": sensors.PressureProbe(
            position=(0.4, 0.2), radius=0.15, order=1, body="water", interval=0.003
        ),
        "column": sensors.ColumnGauge(position=(0.5,), width=0.2, body="water", interval=0.004),
        "touch": sensors.ContactForce(body="block", by="water", interval=0.004),
        "energy": sensors.Energy(interval=0.004),
        "own": sensors.Custom(
            function="middle", columns=("n", "x", "y"), units=("1", "m", "m"), interval=0.006
        ),
    }
    for name in draw(st.lists(st.sampled_from(sorted(every)), unique=True, max_size=5)):
        scene.add_sensor(name=name, sensor=every[name])
    return scene


@drawn(channels(), 0.2)
def test_flows_and_sensors(scene, first, folder):
    """Inlets, outlets, and what sensors remember between their samples."""
    check_resumed(scene, first, folder)
