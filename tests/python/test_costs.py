"""What a scene costs is said, or refused, before it is paid; and what it would not do at all.

Expected duration: 5 s.
"""

from __future__ import annotations

import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

import libmpm
from libmpm import boundaries, materials, sensors, shapes

CPU = {"device": "cpu"}
SOLID = {"density": 1000.0, "youngs_modulus": 1e6, "poissons_ratio": 0.3}


def tank(*, water=None, method=None, more=None, gravity=(0, -9.81)):
    """Water half a metre deep between walls, and whatever else is asked for."""
    scene = libmpm.Scene(
        dimension=2,
        cell_size=0.1,
        lower=(0, 0),
        upper=(2, 1),
        gravity=gravity,
        method=method or libmpm.Method(),
    )
    water = water or materials.TaitFluid(bulk_modulus=1e6)
    scene.add_body(
        name="water", shape=shapes.Box(lower=(0, 0), upper=(1, 0.5)), material=water,
        hydrostatic=0.5 if gravity else None,
    )  # fmt: skip
    if more is not None:
        box = shapes.Box(lower=(1.3, 0.1), upper=(1.6, 0.4))
        scene.add_body(name="post", shape=box, material=more)
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=boundaries.Slip())
    return scene


@pytest.mark.parametrize(
    ("scene", "why"),
    [
        (lambda: tank(method=libmpm.Method(cfl=1e-8)), "cfl is 1e-08"),
        (
            lambda: tank(water=materials.TaitFluid(bulk_modulus=1e6, viscosity=1e9)),
            "body 'water' has a viscosity of 1e.06",
        ),
        (
            lambda: tank(more=materials.FixedCorotated(**SOLID | {"youngs_modulus": 1e19})),
            "body 'post' has waves of 1.*e.08 m/s",
        ),
    ],
)
def test_a_step_too_short_to_move_anything_is_refused_in_single(scene, why):
    """The step that the plan chooses is judged like one that is given."""
    for act in (lambda s: s.plan(**CPU), lambda s: libmpm.Simulation(s, **CPU)):
        with pytest.raises(libmpm.SceneError, match=f"{why}.*would stand still.*'double'"):
            act(scene())
    assert scene().plan(precision="double", **CPU).time_step > 0


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
def test_what_is_refused_in_single_stands_still_and_moves_in_double():
    """The rule's bound is where motion is lost: a fall of a hundredth of the sound's speed."""
    moved = {}
    for cfl in (1e-8, 3e-5):
        scene = tank(method=libmpm.Method(cfl=cfl), gravity=None)
        body = scene.to_dict()["bodies"][0] | {"velocity": [0.3, 0.0]}
        scene = libmpm.Scene.from_dict(scene.to_dict() | {"bodies": [body], "boundaries": []})
        for precision in ("single", "double"):
            try:
                sim = libmpm.Simulation(scene, precision=precision, threads=1, **CPU)
            except libmpm.SceneError:
                moved[cfl, precision] = "refused"
                continue
            first = np.array(sim.particles["water"]["position"])
            sim.step(200)
            way = float((sim.particles["water"]["position"] - first)[:, 0].mean())
            moved[cfl, precision] = way / (0.3 * sim.time)
    assert moved[1e-8, "single"] == "refused"
    assert moved[1e-8, "double"] == pytest.approx(1, rel=0.01)
    assert moved[3e-5, "single"] == pytest.approx(1, rel=0.1)


def test_a_run_of_very_many_steps_is_named_before_it_begins():
    scene = tank(method=libmpm.Method(cfl=1e-7))
    plan = scene.plan(until=10.0, precision="double", **CPU)
    (said,) = [w for w in plan.warnings if "steps" in w]
    assert "limited by body 'water'" in said
    assert "3.2e+10 steps, about" in said
    assert not scene.plan(until=1e-6, precision="double", **CPU).warnings
    sim = libmpm.Simulation(scene, precision="double", **CPU)
    with pytest.warns(libmpm.ModelWarning, match=r"3\.2e\+10 steps"):
        sim.run(until=10.0, wall_limit=0, progress=False)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.run(until=1e-7, progress=False)


def test_copies_of_solids_are_bounded():
    ball = shapes.Sphere(centre=(0, 0), radius=0.01)
    for make in (
        lambda: ball.repeated((2000, 1000), (0.1, 0.1)),
        lambda: ball.repeated((1000, 10), (0.1, 0.1)).moved((1, 1)).repeated((100, 1), (9, 9)),
        lambda: (ball | ball.repeated((1000, 10), (1, 1))).repeated((100, 1), (9, 9)),
    ):
        with pytest.raises(libmpm.SceneError, match=r"counts is .* copies of a solid in all"):
            make()
    assert ball.repeated((100, 100), (0.1, 0.1)).volume() == pytest.approx(np.pi)


def test_a_sensor_of_the_users_cannot_begin_the_run_again():
    """Setting velocities from a sensor at time 0 made a new engine, and asked it again for ever."""
    scene = tank()

    def push(sim):
        sim.particles["water"]["velocity"] = np.zeros((len(sim.particles["water"]), 2))
        return 1.0

    scene.add_sensor(name="own", sensor=sensors.Custom(function=push, columns=("n",)))
    sim = libmpm.Simulation(scene, **CPU)
    with pytest.raises(libmpm.SceneError, match=r"sensor 'own'.*expected it to read only"):
        sim.run(until=0.01, progress=False)


def test_water_that_is_stiffer_than_its_flow_needs_is_named_with_its_cost():
    """√(2 g 0.5 m) = 3.13 m/s; 1483 m/s of sound are 47 times ten times that."""
    (said,) = tank(water=materials.TaitFluid()).plan(**CPU).warnings
    assert "body 'water': bulk_modulus is 2.2e+09 Pa" in said
    assert "47 times fewer steps" in said
    assert "9.8e+05 Pa" in said
    assert not tank().plan(**CPU).warnings
    # Where another body limits the step the water's modulus costs nothing.
    stiff = materials.FixedCorotated(**SOLID | {"youngs_modulus": 1e10})
    found = tank(water=materials.TaitFluid(), more=stiff).plan(**CPU).warnings
    assert not any("bulk_modulus is" in w for w in found)


def test_the_plan_counts_on_the_threads_that_the_engine_takes():
    code = (
        "import libmpm; from test_costs import tank; p = tank().plan(device='cpu');"
        "print(p.rate / libmpm._src.run.plan.RATES['cpu', 'single'])"
    )
    here = os.path.dirname(__file__)
    path = os.pathsep.join([os.path.dirname(os.path.dirname(libmpm.__file__)), here])
    for threads in ("1", "3"):
        env = os.environ | {"OMP_NUM_THREADS": threads, "PYTHONPATH": path}
        done = subprocess.run(
            [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
        )
        assert float(done.stdout) == float(threads)


def test_a_box_for_some_bodies_blocks_those_alone():
    """Like an `OrientedBox` at angle 0, which always was accepted."""
    for kind in (
        shapes.Box(lower=(0, 0), upper=(2, 0.1)),
        shapes.OrientedBox(centre=(1, 0.05), size=(2, 0.1), angle=0),
    ):
        scene = tank(more=materials.FixedCorotated(**SOLID))
        rough = boundaries.Separable(static_friction=0.5, dynamic_friction=0.5)
        scene.add_boundary(name="floor", shape=kind, response=rough, bodies=("post",))
        scene.validate()
    scene = tank()
    low = shapes.Box(lower=(0, 0), upper=(2, 0.1))
    scene.add_boundary(name="floor", shape=low, response=rough, bodies=("water",))
    with pytest.raises(libmpm.SceneError, match=r"body 'water': reaches .* into boundary 'floor'"):
        scene.validate()


@pytest.mark.parametrize("angle", [None, 0.0, 20.0])
def test_a_box_that_stands_in_water_is_refused_at_any_angle(angle):
    """An OrientedBox was accepted, at angle 0 too, where a Box was not."""
    lower, size = (0.5, 0.0), (0.2, 0.5)
    box = shapes.Box(lower=lower, upper=(0.7, 0.5))
    if angle is not None:
        box = shapes.OrientedBox(centre=(0.6, 0.25), size=size, angle=angle)

    def scene(water, **how):
        made = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
        made.add_body(name="water", shape=water, material=materials.TaitFluid(bulk_modulus=1e6))
        made.add_boundary(name="box", shape=box, response=boundaries.Slip(), **how)
        return made

    pool = shapes.Box(lower=(0, 0), upper=(1, 0.5))
    with pytest.raises(libmpm.SceneError, match=r"body 'water': reaches .* boundary 'box'"):
        scene(pool).validate()
    scene(pool - box).validate()


BALL = shapes.Sphere(centre=(0.6, 0.25), radius=0.15)


@pytest.mark.parametrize(
    "solid",
    [
        BALL,
        shapes.Sphere(centre=(0, 0), radius=0.15).moved((0.6, 0.25)),
        shapes.Box(lower=(0.5, 0), upper=(0.7, 0.5)) | BALL,
        shapes.HalfSpace(point=(0.8, 0), normal=(-1, 0)),
        shapes.HeightField(x=(0, 0.5, 1), z=(0, 0.2, 0.3)),
    ],
    ids=lambda s: type(s).__name__,
)
def test_water_inside_any_other_surface_is_warned_of_and_does_stay_there(solid):
    """Turned boxes were not the only ones that were accepted with the water in them."""

    def scene(water, material=None, response=None, **how):
        made = libmpm.Scene(
            dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1), gravity=(0, -9.81)
        )
        law = material or materials.TaitFluid(bulk_modulus=1e5)
        made.add_body(name="water", shape=water, material=law)
        walls = boundaries.Slip(cell="held")
        made.add_boundary(name="walls", shape=shapes.DomainWalls(), response=walls)
        made.add_boundary(name="post", shape=solid, response=response or walls, **how)
        return made

    def said(scene):
        return [w for w in scene.plan(**CPU).warnings if "into boundary 'post'" in w]

    pool = shapes.Box(lower=(0, 0), upper=(1, 0.5))
    (words,) = said(scene(pool))
    assert "what is inside stays there" in words
    assert not said(scene(pool - solid))
    assert not said(scene(pool, time=(1.0, None)))
    # A solid in what holds it is clamped.
    assert not said(scene(pool, materials.FixedCorotated(**SOLID), boundaries.Sticky()))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", libmpm.ModelWarning)
        sim = libmpm.Simulation(scene(pool), threads=1, **CPU)
        before = int((solid.distance(sim.particles["water"]["position"]) < -0.05).sum())
        sim.run(until=0.3, progress=False)
    after = int((solid.distance(sim.particles["water"]["position"]) < -0.05).sum())
    assert after >= 0.75 * before > 0


def test_damping_with_a_transfer_that_carries_gradients_is_refused_in_its_own_words():
    scene = tank()
    box = shapes.Box(lower=(1.3, 0.1), upper=(1.6, 0.4))
    law = materials.LinearElastic(**SOLID)
    scene.add_body(name="bar", shape=box, material=law, damping=0.02)
    words = r"body 'bar': damping changes .*transfer 'APIC'"
    with pytest.raises(libmpm.SceneError, match=words) as refused:
        scene.plan(**CPU)
    assert "assumed" not in str(refused.value)


def test_a_run_that_got_there_is_finished(tmp_path):
    sim = libmpm.Simulation(tank(), output=tmp_path / "out", **CPU)
    sim.run(until=0.01, progress=False)
    assert libmpm.Results(tmp_path / "out").log["status"] == "finished"
    sim.run(until=0.02, progress=False, wall_limit=0)
    assert libmpm.Results(tmp_path / "out").log["status"] == "interrupted"
