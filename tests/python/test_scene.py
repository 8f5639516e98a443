"""Scenes as values, and what their checks say."""

from __future__ import annotations

import json
import math
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import libmpm
from libmpm import FBar, Method, Scene, TimeTable, boundaries, materials, sensors, shapes

Make = Callable[..., Scene]
WATER = materials.TaitFluid()
WOOD = materials.FixedCorotated(density=600.0, youngs_modulus=1e6)


def box(*ends: float) -> shapes.Box:
    half = len(ends) // 2
    return shapes.Box(lower=ends[:half], upper=ends[half:])


def problems(scene: Scene, *, strict: bool = False) -> list[str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            scene.validate(strict=strict)
        except libmpm.SceneError as error:
            return error.problems
    return []


def refused(call: Callable[..., Any], *args: Any, **keywords: Any) -> list[str]:
    with pytest.raises(libmpm.SceneError) as caught:
        call(*args, **keywords)
    return caught.value.problems


# Values ------------------------------------------------------------------------------------


def test_valid_scene_is_quiet(scene: Scene) -> None:
    """But for its load: four cells of water are too few for one."""
    told = scene.to_dict()
    told["sensors"] = [s for s in told["sensors"] if s["sensor"]["type"] != "LoadCell"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        Scene.from_dict(told).validate(strict=True)
    with pytest.raises(libmpm.SceneError, match="water up to 4 cells deep"):
        scene.validate(strict=True)


def test_water_that_nothing_drives_is_named() -> None:
    """A dam break without gravity ran, and stood still without a word."""

    def dam(velocity: Any = (0, 0), material: Any = WATER, **changes: Any) -> Scene:
        made = Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(2, 1), **changes)
        made.add_body(name="dam", shape=box(0.1, 0, 0.6, 0.5), material=material, velocity=velocity)
        return made

    def told(scene: Scene) -> bool:
        said = problems(scene, strict=True)
        return any("'dam': gravity is zero" in x and "gravity=(0, -9.81)" in x for x in said)

    assert told(dam())
    assert told(dam(gravity=TimeTable((0, 1), ((0, 0), (0, 0)))))
    assert not told(dam(gravity=(0, -9.81)))
    assert not told(dam(gravity=TimeTable((0, 1), ((0, 0), (0, -9.81)))))
    assert not told(dam(velocity=(1, 0)))
    assert not told(dam(velocity=libmpm.Field(components=("y", "0"))))
    assert not told(dam(material=WOOD)), "solids at rest are looked at as they are"
    pushed = dam()
    pushed.add_boundary(
        name="piston", shape=box(-1, -1, 0, 2), response=boundaries.Slip(),
        motion=boundaries.Displacement(TimeTable((0, 1), ((0, 0), (0.1, 0)))),
    )  # fmt: skip
    assert not told(pushed)


def test_round_trips(scene: Scene, tmp_path: Path) -> None:
    assert Scene.from_dict(scene.to_dict()) == scene
    assert Scene.from_dict(json.loads(json.dumps(scene.to_dict()))) == scene
    scene.save(tmp_path / "scene.json")
    assert Scene.load(tmp_path / "scene.json") == scene
    assert pickle.loads(pickle.dumps(scene)) == scene
    assert scene.to_dict()["libmpm"] == 1


def test_round_trip_of_every_option(tank: Make) -> None:
    scene = tank(
        gravity=TimeTable([0.0, 1.0], [[0.0, 0.0], [0.0, -9.81]], "repeat"),
        method=Method(cfl=0.3, time_step=1e-5, leaving="delete"),
        origin=(1e6, 2e6),
    )
    scene.add_body(
        name="w",
        shape=box(0, 0, 0.5, 0.5),
        material=WATER,
        particles_per_cell=9,
        fbar=FBar(form="two-volume", length=0.3),
    )
    scene.add_boundary(
        name="gate",
        shape=box(0.6, 0, 0.8, 1),
        response=boundaries.Slip(),
        time=(0.5, math.inf),
    )
    scene.add_sensor(name="t", sensor=sensors.ParticleTracker(body="w", ids="all"))
    text = json.dumps(scene.to_dict(), allow_nan=False)
    again = Scene.from_dict(json.loads(text))
    assert again == scene
    assert again.boundaries[0].window == (0.5, math.inf)


def test_differences_are_seen(new_scene: Make) -> None:
    assert new_scene() == new_scene()
    assert new_scene() != new_scene(name="another")
    assert new_scene() != new_scene(method=Method(cfl=0.3))


def test_names_are_returned_and_order_is_kept(scene: Scene, tank: Make) -> None:
    assert [b.name for b in scene.bodies] == ["water", "block"]
    assert [b.name for b in scene.boundaries] == ["walls", "pier"]
    assert [s.name for s in scene.sensors] == ["load", "gauge", "probe", "track", "energy"]
    empty = tank()
    assert empty.add_body(name="w", shape=box(0, 0, 1, 1), material=WATER) == "w"
    # A name is unique among its kind only.
    assert empty.add_sensor(name="w", sensor=sensors.Energy()) == "w"


def test_a_copy_is_stored(tank: Make) -> None:
    scene = tank()
    response: dict[str, Any] = {f: boundaries.Slip() for f in ("x-", "x+", "y-", "y+")}
    scene.add_boundary(name="walls", shape=shapes.DomainWalls(), response=response)
    del response["x-"]
    stored = scene.boundaries[0].response
    assert isinstance(stored, dict)
    assert len(stored) == 4


def test_default_particles_per_cell(scene: Scene, tank: Make) -> None:
    assert scene.bodies[0].particles_per_cell == 8
    flat = tank()
    flat.add_body(name="w", shape=box(0, 0, 1, 1), material=WATER)
    assert flat.bodies[0].particles_per_cell == 4


def test_values_are_frozen_and_hashable() -> None:
    shape = box(0, 0, 1, 1)
    with pytest.raises(AttributeError):
        shape.lower = (0.0, 0.5)
    assert len({shape, box(0, 0, 1, 1), FBar(), FBar(), Method()}) == 3


# One object --------------------------------------------------------------------------------


def test_scene_reports_all_of_its_own() -> None:
    found = refused(
        Scene, dimension=2, cell_size=-1.0, lower=(0, 0, 0), upper=(1, 1), gravity=(0, 0, -9.81)
    )
    assert len(found) == 3
    assert "gravity is (0, 0, -9.81); expected 2 numbers in m/s²" in found[2]


def test_unknown_and_missing_keywords(tank: Make) -> None:
    found = refused(Scene, cellsize=0.1, lower=(0, 0), upper=(1, 1))
    assert found[0] == "Scene: unknown argument 'cellsize'; did you mean 'cell_size'?"
    assert "'cell_size' is missing" in found[1]
    found = refused(tank().add_body, name="w", shap=box(0, 0, 1, 1), material=WATER)
    assert "did you mean 'shape'?" in found[0]
    assert "takes keyword arguments only" in refused(tank().add_body, "w")[0]


def test_domain_is_a_whole_number_of_cells() -> None:
    found = refused(Scene, dimension=2, cell_size=0.3, lower=(0, 0), upper=(1.0, 0.9))
    assert len(found) == 1
    assert "3.33333 cells wide on axis 0" in found[0]
    assert "upper[0] = 0.9" in found[0]
    scene = Scene(dimension=2, cell_size=0.1, lower=(1e4, 0.3), upper=(1e4 + 0.7, 0.6))
    assert scene.cells == (7, 3)


def test_duplicate_names(tank: Make) -> None:
    scene = tank()
    scene.add_body(name="w", shape=box(0, 0, 1, 1), material=WATER)
    assert "unique" in refused(scene.add_body, name="w", shape=box(0, 0, 1, 1), material=WATER)[0]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: box(0, 0, 1, -1), "expected upper > lower"),
        (lambda: shapes.Box(lower=(0,), upper=(1,)), "expected 2 or 3 numbers in m"),
        (lambda: shapes.Box(lower=(0, 0), upper=(1, 1, 1)), "lower has 2 and upper 3"),
        (lambda: shapes.DomainWalls(faces=("x-", "w+")), "faces has 'w+'"),
        (lambda: boundaries.Separable(static_friction=-0.1), "static_friction is -0.1; expected ≥"),
        (
            lambda: boundaries.Separable(static_friction=0.1, dynamic_friction=0.2),
            "expected static ≥ dynamic",
        ),
        (lambda: sensors.LoadCell(boundary="b", interval=-1), "interval is -1; expected ≥ 0 s"),
        (lambda: sensors.LoadCell(boundary="b", faces=()), "faces is ()"),
        (lambda: sensors.ParticleTracker(body="b", ids=(1, 1)), "more than once"),
        (lambda: sensors.ParticleTracker(body="b", ids=(-1,)), "whole number ≥ 0"),
        (lambda: Method(cfl=1.5), "unstable above 1"),
        (lambda: Method(time_step=0), "time_step is 0; expected > 0 s"),
        (lambda: Method(leaving="fly"), "leaving is 'fly'"),
        (lambda: FBar(time=1.0, ratio=0.5), "time and ratio are given"),
        (lambda: FBar(length=1.0), "belongs to two-volume, split"),
        (lambda: FBar(form="two-volume"), "neither length nor ratio"),
        (lambda: FBar(ratio=1.5), "ratio is 1.5"),
    ],
)
def test_refused_values(make: Callable[[], Any], words: str) -> None:
    found = refused(make)
    assert any(words in p for p in found), found


def test_refused_arguments_of_objects(tank: Make) -> None:
    scene = tank()
    found = refused(
        scene.add_body,
        name="w",
        shape=shapes.DomainWalls(),
        material="water",
        particles_per_cell=0,
        velocity=(1, math.nan),
        fbar=0.5,
    )
    assert len(found) == 5
    assert all(p.startswith("body 'w': ") for p in found)
    found = refused(
        scene.add_boundary,
        name="b",
        shape=box(0, 0, 1, 1),
        response={"x-": 1, "q": boundaries.Slip()},
        time=(2.0, 1.0),
    )
    assert len(found) == 3


# The scene as a whole ----------------------------------------------------------------------


def tank_with(tank: Make, *bodies: tuple[str, shapes.Box, dict[str, Any]], **changes: Any) -> Scene:
    scene = tank(**changes)
    for name, shape, more in bodies:
        scene.add_body(**({"name": name, "shape": shape, "material": WATER} | more))
    return scene


def test_overlap_needs_an_order(tank: Make) -> None:
    two = box(0.4, 0, 0.8, 0.4)
    scene = tank_with(tank, ("a", box(0, 0, 0.5, 0.5), {}), ("b", two, {}))
    (problem,) = problems(scene)
    assert problem.startswith("body 'a': with body 'b': the bodies overlap by 0.1 × 0.4 m")
    assert "subtract_from=('a',)" in problem
    ordered = {"subtract_from": ("a",)}
    assert not problems(tank_with(tank, ("a", box(0, 0, 0.5, 0.5), {}), ("b", two, ordered)))
    touching = box(0.5, 0, 0.8, 0.4)
    assert not problems(tank_with(tank, ("a", box(0, 0, 0.5, 0.5), {}), ("b", touching, {})))


def test_contradictory_subtraction(tank: Make) -> None:
    scene = tank_with(
        tank,
        ("water", box(0, 0, 0.5, 0.5), {"subtract_from": ("stone", "watr")}),
        ("stone", box(0.2, 0, 0.8, 0.4), {"subtract_from": ("water", "stone")}),
    )
    found = "\n".join(problems(scene))
    assert "each is subtracted from the other" in found
    assert "unknown body 'watr'" in found
    assert "subtract_from has the body itself" in found


def test_nothing_left(tank: Make) -> None:
    scene = tank_with(
        tank,
        ("a", box(0.2, 0.2, 0.4, 0.4), {}),
        ("b", box(0, 0, 1, 1), {"subtract_from": ("a",)}),
    )
    (problem,) = problems(scene)
    assert "body 'a': no particle is left" in problem


def test_outside_domain(tank: Make) -> None:
    (problem,) = problems(tank_with(tank, ("a", box(0.5, 0, 1.2, 0.5), {})))
    assert "spans 0.5 to 1.2 m on axis 0; expected inside the domain, 0 to 1 m" in problem


def test_thin_body_is_a_doubt(tank: Make) -> None:
    scene = tank_with(tank, ("a", box(0, 0, 0.5, 0.15), {}))
    with pytest.warns(libmpm.ModelWarning, match=r"1\.5 cells.*an error of about 67 %"):
        scene.validate()
    assert "0.15 m thick on axis 1" in problems(scene, strict=True)[0]
    assert not problems(tank_with(tank, ("a", box(0, 0.1, 0.5, 0.3), {})), strict=True)


def test_wrong_dimensions(tank: Make) -> None:
    scene = tank_with(tank, ("a", box(0, 0, 0, 1, 1, 1), {"velocity": (0, 0, 0)}))
    scene.add_boundary(
        name="b",
        shape=box(0, 0, 0, 1, 1, 1),
        response=boundaries.Slip(),
        motion=TimeTable([0.0], [1.0]),
    )
    scene.add_sensor(name="p", sensor=sensors.VelocityProbe(position=(0, 0, 0)))
    scene.add_sensor(name="g", sensor=sensors.WaveGauge(position=(0, 0)))
    assert len(problems(scene)) == 6


def test_hydrostatic_needs_gravity_and_a_fluid(tank: Make) -> None:
    still = {"hydrostatic": 0.5}
    (problem,) = problems(tank_with(tank, ("a", box(0, 0, 1, 0.5), still), gravity=None))
    assert "without gravity" in problem
    (problem,) = problems(tank_with(tank, ("a", box(0, 0, 1, 0.5), still | {"material": WOOD})))
    assert "stores no volume ratio" in problem


def test_fbar_only_where_supported(tank: Make) -> None:
    sand: dict[str, Any] = {
        "material": libmpm.materials.DruckerPrager(density=1600.0, youngs_modulus=1e6)
    }
    (problem,) = problems(tank_with(tank, ("a", box(0, 0, 1, 0.5), sand | {"fbar": FBar()})))
    assert "DruckerPrager, which has no volume smoothing" in problem
    for solid in (sand, {"material": WOOD}, {"material": WOOD, "fbar": FBar()}):
        assert not problems(tank_with(tank, ("a", box(0, 0, 1, 0.5), solid)))


def with_box(tank: Make, shape: shapes.Box, **more: Any) -> Scene:
    scene = tank_with(tank, ("a", box(0, 0, 0.5, 0.5), {}))
    arguments: dict[str, Any] = {"name": "b", "shape": shape, "response": boundaries.Slip()}
    scene.add_boundary(**(arguments | more))
    return scene


def test_body_inside_a_box(tank: Make) -> None:
    (problem,) = problems(with_box(tank, box(0.3, 0, 0.8, 0.4)))
    assert "body 'a': reaches 0.2 × 0.4 m into boundary 'b'" in problem
    assert not problems(with_box(tank, box(0.5, 0, 0.8, 0.4)))
    # A box that appears later does not stand in the body at the start.
    assert not problems(with_box(tank, box(0.3, 0, 0.8, 0.4), time=(1.0, 2.0)))


def test_boxes_off_the_grid_or_outside(tank: Make) -> None:
    (problem,) = problems(with_box(tank, box(0.63, 0, 0.8, 0.4)), strict=True)
    assert "lower[0] is 0.63 m, its effective plane 0.6 m, -0.30 cells away" in problem
    assert "one cell or more" in problems(with_box(tank, box(0.72, 0, 0.74, 0.4)))[0]
    assert "outside the domain" in problems(with_box(tank, box(1.2, 0, 1.4, 0.4)))[0]
    assert not problems(with_box(tank, box(0.8, -5.0, 2.0, 9.0)), strict=True)


def test_responses_cover_the_faces(tank: Make) -> None:
    some = {"x-": boundaries.Slip()}
    (problem,) = problems(with_box(tank, box(0.6, 0, 0.8, 0.4), response=some))
    assert "response has no entry for x+, y-, y+" in problem
    walls = shapes.DomainWalls(faces=("y-",))
    found = problems(with_box(tank, walls, response=some))
    assert "response has face 'x-'; the boundary has y-" in found[0]
    assert "faces has 'z-' in 2D" in problems(with_box(tank, shapes.DomainWalls(faces=("z-",))))[0]


def test_one_response_per_wall_at_a_time(tank: Make) -> None:
    def two(first: Any, second: Any) -> list[str]:
        scene = with_box(tank, shapes.DomainWalls(), time=first)
        scene.add_boundary(
            name="c",
            shape=shapes.DomainWalls(faces=("x-",)),
            response=boundaries.Sticky(),
            time=second,
        )
        return problems(scene)

    assert "x- is also a wall of boundary 'b'" in two(None, None)[0]
    assert not two((0.0, 1.0), (1.0, 2.0))


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (sensors.LoadCell(boundary="peir"), "boundary 'peir' is unknown; did you mean 'pier'?"),
        (sensors.LoadCell(boundary="pier", reference=(0, 0)), "reference has 2 numbers"),
        (sensors.WaveGauge(position=(9.0, 0.1)), "spans 9 m on axis 0; expected inside"),
        (sensors.WaveGauge(position=(1.0,)), "position has 1 numbers; expected 2"),
        (sensors.WaveGauge(position=(1, 0.4), body="watr"), "did you mean 'water'?"),
        (sensors.VelocityProbe(position=(1, 0.4, 5)), "the probe spans 5 m on axis 2"),
        (sensors.ParticleTracker(body="block", ids=(0,)), "expected ids of body 'block', "),
        (sensors.Energy(body="x"), "body 'x' is unknown; choose from water, block"),
    ],
)
def test_sensors(scene: Scene, sensor: sensors.Sensor, words: str) -> None:
    scene.add_sensor(name="s", sensor=sensor)
    (problem,) = problems(scene)
    assert problem.startswith("sensor 's': ")
    assert words in problem


def test_faces_of_the_measured_boundary(tank: Make) -> None:
    scene = with_box(tank, shapes.DomainWalls(faces=("x-",)))
    scene.add_sensor(name="s", sensor=sensors.LoadCell(boundary="b", faces=("x-", "y-")))
    assert problems(scene) == ["sensor 's': faces has 'y-'; boundary 'b' has x-"]


def test_empty_scene(tank: Make) -> None:
    assert "no body" in problems(tank())[0]


# Files -------------------------------------------------------------------------------------


def test_a_scene_passes_over_the_settings_of_a_run(scene: Scene, tmp_path: Path) -> None:
    data = scene.to_dict() | {"run": {"until": 1.0}}
    assert Scene.from_dict(data) == scene
    (tmp_path / "scene.json").write_text(json.dumps(data))
    assert Scene.load(tmp_path / "scene.json") == scene


def test_a_file_reports_everything_at_once(scene: Scene) -> None:
    data = scene.to_dict()
    data["cel_size"] = 1
    data["cell_size"] = 0
    data["bodies"][0]["material"]["density"] = -1
    data["bodies"][0]["shape"]["type"] = "Bx"
    data["bodies"][1]["particles_per_cell"] = 0
    data["boundaries"][1]["responce"] = data["boundaries"][1].pop("response")
    data["sensors"][0] = "load"
    found = refused(Scene.from_dict, data)
    text = "\n".join(found)
    assert "scene file: unknown key 'cel_size'; did you mean 'cell_size'?" in text
    assert "cell_size is 0" in text
    assert "body 'water': materials.TaitFluid: density is -1" in text
    assert "body 'water': shape: \"type\" is 'Bx'; did you mean 'Box'?" in text
    assert "body 'block': particles_per_cell is 0" in text
    assert "did you mean 'response'?" in text
    assert "sensor '0': 'load' is not an object" in text


def test_a_file_adds_the_checks_of_the_whole(scene: Scene) -> None:
    data = scene.to_dict()
    data["nme"] = "x"
    data["sensors"][0]["sensor"]["boundary"] = "peir"
    assert len(refused(Scene.from_dict, data)) == 2


def test_other_files_are_named(tmp_path: Path, scene: Scene) -> None:
    path = tmp_path / "broken.json"
    path.write_text("{")
    assert "not JSON" in refused(Scene.load, path)[0]
    assert '"libmpm" is missing' in refused(Scene.from_dict, {"bodies": []})[0]
    later = scene.to_dict() | {"libmpm": 99}
    assert "reads version 1" in refused(Scene.from_dict, later)[0]
