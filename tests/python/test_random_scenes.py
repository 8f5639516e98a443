"""Random small scenes: what holds of every scene holds of them.

`pytest tests/python/test_random_scenes.py --scenes 2000` tries more. Each is refused with its
problems, runs, or ends by an error with a name; nothing else. Expected duration: 25 s.
"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, note, seed, settings
from hypothesis import strategies as st

import libmpm
from libmpm import boundaries
from libmpm._src.run.engine_spec import lower
from support import fuzzing, random_scenes
from support.random_scenes import DX, SPEED

STEPS = 16

#: Unit of rounding, and how much of it a run of that many steps may leave in sums.
ROUNDING = {"single": 2e-6 * STEPS, "double": 5e-15 * STEPS}

pytestmark = pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")


def examples(part):
    """Hypothesis with a part of the scenes asked for, the same ones in every run of CI."""

    def decorate(test):
        @pytest.mark.usefixtures("tmp_path")
        def run(request, tmp_path_factory):
            count = max(1, round(part * request.config.getoption("--scenes")))
            chosen = settings(
                max_examples=count,
                derandomize=not request.config.getoption("--fuzz-seed"),
                deadline=None,
                database=None,
                print_blob=True,
                suppress_health_check=list(HealthCheck),
            )
            made = seed(request.config.getoption("--fuzz-seed"))(test)
            chosen(made)(folder=tmp_path_factory.mktemp("scenes"))

        run.__name__, run.__doc__ = test.__name__, test.__doc__
        return run

    return decorate


def start(scene, threads=1, **options):
    return libmpm.Simulation(scene, device="cpu", threads=threads, **options)


def lowered_bodies(scene):
    """Bodies with what the engine is told of them."""
    return zip(scene.bodies, lower(scene, with_particles=False)["bodies"], strict=True)


def state(sim):
    """What particles show, by body and attribute, in the order of their ids."""
    found = {}
    for name, view in sim.particles.items():
        order = np.argsort(view["id"])
        for key in ("id", "position", "velocity", "pressure"):
            found[name, key] = np.asarray(view[key])[order]
    return found


def same(one, two, what):
    assert one.keys() == two.keys()
    for key, values in one.items():
        np.testing.assert_array_equal(two[key], values, err_msg=f"{what}: {key}")


def ran(scene, options, steps=STEPS):
    """Return a simulation after its steps; what may not run is no example."""
    note(json.dumps(scene.to_dict() | {"run as": options}))

    def run():
        sim = start(scene, **options)
        sim.step(steps)
        return sim

    found = fuzzing.answer(run)
    assume(not isinstance(found, libmpm.Error))
    return found


@examples(1.0)
@given(random_scenes.scenes(), random_scenes.runs(), st.integers(1, STEPS - 1))
def test_runs_or_says_why_and_nothing_changes_a_bit(folder, scene, options, part):
    """Portions, threads, frames, a file in between, a checkpoint: the same bits."""
    sim = ran(scene, options)
    found = state(sim)
    first = 0
    for i, body in enumerate(scene.bodies):
        ids, position = found[body.name, "id"], found[body.name, "position"]
        assert ids.tolist() == list(range(first, first + sim.particle_count(i)))
        first += len(ids)
        slack = 1e-5 * DX
        assert np.all(position >= np.array(scene.lower) - slack), body.name
        assert np.all(position <= np.array(scene.upper) + slack), body.name
    for key, values in found.items():
        assert np.isfinite(values).all(), key

    again = libmpm.Scene.from_dict(json.loads(json.dumps(scene.to_dict())))
    assert again == scene
    watched = libmpm.Output(folder / "out", frame_interval=2 * sim.dt, overwrite=True)
    other = start(again, threads=2, output=watched, **options)
    other.step(part)
    state(other)
    assert np.isfinite(other.grid["mass"]).all()
    other.save_checkpoint(folder / "state.npz")
    other.step(STEPS - part)
    other.close()
    same(found, state(other), "in portions, by two threads, with frames")
    for name, series in sim.sensors.items():
        np.testing.assert_array_equal(other.sensors[name].values, series.values, err_msg=name)
    resumed = libmpm.Simulation.resume(folder / "state.npz")
    resumed.step(STEPS - part)
    assert resumed.time == sim.time
    same(found, state(resumed), "resumed")


@examples(0.5)
@given(
    random_scenes.scenes(),
    st.sampled_from((True, True, True, False)),
    st.sampled_from(("double", "single")),
    st.integers(2, 4),
)
def test_ranks_have_the_bits_of_one_or_are_refused(folder, scene, usual, precision, ranks):
    """Whatever a scene has in it, several ranks do what one does, or say by name what they cannot.

    Scenes span a few blocks: most of these are beside a cut.
    """
    if usual:  # most methods are those that are refused
        data = scene.to_dict() | {"method": libmpm.Method(cfl=scene.method.cfl).to_dict()}
        for body, described in zip(scene.bodies, data["bodies"], strict=True):
            if not body.material.table.stores_volume:
                described["fbar"] = None
        scene = libmpm.Scene.from_dict(data)
    one = ran(scene, {"precision": precision})
    several = fuzzing.answer(
        lambda: libmpm.Simulation(scene, device=["cpu"] * ranks, threads=ranks, precision=precision)
    )
    assert not isinstance(several, libmpm.Error)
    refused = fuzzing.answer(lambda: several.step(1))
    if isinstance(refused, libmpm.Error):
        assert "is not built for several ranks; take one rank" in str(refused)
        scheme = scene.transfer.scheme
        assert one.pipeline in ("phased", "by-body") or scheme != "APIC"
        return
    several.step(STEPS - 1)
    assert several.time == one.time
    same(state(one), state(several), f"on {ranks} ranks")
    for name, series in one.sensors.items():
        values = np.asarray(series.values)
        slack = 1e-9 * max(np.abs(values).max(initial=0.0), 1e-30)
        np.testing.assert_allclose(several.sensors[name].values, values, rtol=0, atol=slack)


def counts_all(scene):
    """Whether load cells have all that walls take.

    Where particles keep velocities of their own, a mirror's cells count what it turns round at its
    nodes, of which these particles get a share. FMPM's filter passes over what walls have changed.
    """
    walls = scene.boundaries[0].response
    every = walls.values() if isinstance(walls, dict) else [walls]
    transfer = scene.transfer
    mirrored = any(isinstance(wall, boundaries.Mirror) for wall in every)
    return transfer.scheme != "FMPM" and not (mirrored and transfer.stores_velocity)


@examples(0.6)
@given(random_scenes.scenes(), random_scenes.runs())
def test_mass_stays_and_walls_take_the_missing_momentum(folder, scene, options):
    """Σmv at the end = Σmv at the start + gravity's impulse - what load cells say; grid sums."""
    d, gravity = scene.dimension, scene.gravity
    assume(counts_all(scene))
    probe = fuzzing.answer(lambda: start(scene, **options))
    assume(not isinstance(probe, libmpm.Error))
    note(json.dumps(scene.to_dict() | {"run as": options}))
    given_mass, momentum = 0.0, np.zeros(d)
    for body, lowered in lowered_bodies(scene):
        mass = lowered["count"] * lowered["particle_mass"]
        volume = body.shape.volume()
        assert volume is None or abs(mass / (volume * body.material.density) - 1) < 1e-12
        given_mass += mass
        momentum += mass * np.array(body.velocity)
    impulse, fastest = np.zeros(d), SPEED

    def run():
        nonlocal impulse, fastest
        for step in range(STEPS):
            now = probe.time
            if step == STEPS - 1:
                # Readers show the velocities of the coming step; cells learn of it in making it.
                at_end.append((np.array(probe.grid["mass"]), np.array(probe.grid["velocity"])))
            probe.step(1)
            g = gravity.at(now) if isinstance(gravity, libmpm.TimeTable) else np.array(gravity)
            impulse = impulse + given_mass * g * (probe.time - now)

    at_end = []
    assume(not isinstance(fuzzing.answer(run), libmpm.Error))
    mass, velocity = at_end[0]
    unit = ROUNDING[options["precision"]]
    assert abs(mass.sum() / given_mass - 1) < unit
    taken, passed = np.zeros(d), 0.0
    for boundary in scene.boundaries:
        series = probe.sensors[f"load {boundary.name}"]
        length = np.diff(np.asarray(series.time), prepend=0.0)[:, None]
        pushes = np.asarray(series.values)[:, :d] * length
        taken += pushes.sum(axis=0)
        passed += np.abs(pushes).sum()
    last = (mass[:, None] * velocity).sum(axis=0)
    size = given_mass * fastest + np.abs(impulse).sum() + passed
    assert np.abs(last - momentum - impulse + taken).max() < unit * size


#: (axis taken for each, axes turned round): reflections and turns that keep gravity where it is.
MOVES = {"mirrored": lambda d: (tuple(range(d)), (0,)), "turned": lambda d: ((1, 0, 2)[:d], (0,))}


def moved(scene, order, flipped):
    """The scene with its axes in another order and some of them turned round; boxes and walls."""
    top = [scene.upper[a] for a in order]

    def vector(v):
        return [-v[a] if k in flipped else v[a] for k, a in enumerate(order)]

    def corners(shape):
        low, high = ([shape[end][a] for a in order] for end in ("lower", "upper"))
        for k in flipped:
            low[k], high[k] = top[k] - high[k], top[k] - low[k]
        return shape | {"lower": low, "upper": high}

    data = json.loads(json.dumps(scene.to_dict()))
    data |= {"upper": top, "gravity": vector(data["gravity"])}
    for body in data["bodies"]:
        body |= {"shape": corners(body["shape"]), "velocity": vector(body["velocity"])}
        if body["hydrostatic"] is not None:
            up = int(np.argmax(np.abs(data["gravity"])))
            # The level is a coordinate along gravity, wherever that points now.
            body["hydrostatic"] = body["shape"]["upper" if data["gravity"][up] < 0 else "lower"][up]
    data["sensors"] = []
    return libmpm.Scene.from_dict(data)


@pytest.mark.parametrize("how", MOVES)
def test_seen_otherwise(how, request, tmp_path_factory):
    """What is reflected, or turned by 90 degrees, moves likewise: to rounding, in double."""

    @examples(0.4)
    @given(random_scenes.scenes(plain=True))
    def check(folder, scene):
        options = {"precision": "double"}
        order, flipped = MOVES[how](scene.dimension)
        level = any(b.hydrostatic is not None for b in scene.bodies)
        # A level counts upwards; what hangs from it after half a turn is another scene.
        assume(how == "mirrored" or not level)
        one = ran(scene, options)
        two = ran(moved(scene, order, flipped), options)
        assert math.isclose(one.time, two.time, rel_tol=1e-12)
        top = np.array(two.scene.upper)
        for body in scene.bodies:
            x, v = (np.asarray(one.particles[body.name][k])[:, order] for k in KEYS)
            y, w = (np.asarray(two.particles[body.name][k]) for k in KEYS)
            x, v = x.copy(), v.copy()
            for k in flipped:
                x[:, k], v[:, k] = top[k] - x[:, k], -v[:, k]
            near = np.abs(x[:, None] - y[None]).sum(axis=2)
            other = near.argmin(axis=1)
            assert len(set(other.tolist())) == len(x)
            assert np.abs(x - y[other]).max() < 1e-9 * DX, body.name
            assert np.abs(v - w[other]).max() < 1e-9 * max(SPEED, np.abs(w).max()), body.name

    check(request, tmp_path_factory)


KEYS = ("position", "velocity")


@examples(0.3)
@given(random_scenes.scenes(plain=True), st.integers(1, 5), st.integers(0, 3))
def test_whole_cells_further(folder, scene, right, up):
    """In a domain so much larger that no wall is near, a scene moves on whole cells likewise."""
    d = scene.dimension
    shift = np.array((right, up, up)[:d]) * DX
    data = scene.to_dict()
    data |= {
        "boundaries": [],
        "sensors": [],
        "lower": [-4 * DX] * d,
        "upper": [x + 12 * DX for x in scene.upper],
    }
    near = libmpm.Scene.from_dict(data)
    for body in data["bodies"]:
        for end in ("lower", "upper"):
            body["shape"][end] = (np.array(body["shape"][end]) + shift).tolist()
        if body["hydrostatic"] is not None:
            body["hydrostatic"] += float(shift[d - 1])
    far = libmpm.Scene.from_dict(data)
    one, two = ran(near, {"precision": "double"}), ran(far, {"precision": "double"})
    for body in scene.bodies:
        x, y = (sim.particles[body.name].read(["id", *KEYS]) for sim in (one, two))
        a, b = (np.argsort(found["id"]) for found in (x, y))
        move = y["position"][b] - x["position"][a] - shift
        assert np.abs(move).max() < 1e-9 * DX
        speed = np.abs(x["velocity"]).max()
        assert np.abs(y["velocity"][b] - x["velocity"][a]).max() < 1e-9 * max(SPEED, speed)


@examples(0.4)
@given(random_scenes.scenes(plain=True, closed=True))
def test_energy_of_what_is_closed_does_not_grow(folder, scene):
    """Elastic bodies and fluids between smooth walls that rest, PIC and APIC, CFL number 0.1."""
    given_energy = sum(
        0.5 * lowered["count"] * lowered["particle_mass"] * np.dot(body.velocity, body.velocity)
        for body, lowered in lowered_bodies(scene)
    )
    assume(given_energy > 0)
    sim = ran(scene, {"precision": "double"}, 4 * STEPS)
    series = sim.sensors["energy"]
    column = {name: series.values[:, k] for k, name in enumerate(series.components)}
    # Without gravity: its work and the velocities of a sample are half a step apart.
    total = column["kinetic"] + column["elastic"]
    assert total.max() < 1.01 * given_energy
