"""A misspelt, missing or unnamed argument is one kind of error wherever a user types it."""

import functools

import pytest

import libmpm
from libmpm import boundaries, debris, grids, materials, methods, sensors, shapes
from libmpm._src.errors import ArgumentError

GIVEN = {
    "Scene": libmpm.Scene,
    "Box": shapes.Box,
    "Sphere": shapes.Sphere,
    "TaitFluid": materials.TaitFluid,
    "Slip": boundaries.Slip,
    "Energy": sensors.Energy,
    "Method": libmpm.Method,
    "Transfer": methods.Transfer,
    "Guard": libmpm.Guard,
    "TriangularGrid": grids.TriangularGrid,
    "Output": functools.partial(libmpm.Output, "results"),
    "debris.random": functools.partial(debris.random, ()),
    "debris.ordered": functools.partial(debris.ordered, ()),
    "animate": functools.partial(libmpm.animate, "run", "film.gif"),
    "tradeoff": lambda **more: libmpm.advice.tradeoff(None, {}, **more),
    "Study": lambda **more: libmpm.Study("folder", None, [], **more),
    "Simulation": lambda **more: libmpm.Simulation(None, **more),
    "Simulation.resume": lambda **more: libmpm.Simulation.resume("folder", **more),
    "Scene.from_checkpoint": lambda **more: libmpm.Scene.from_checkpoint("folder", **more),
}


@pytest.fixture
def scene():
    made = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    box = shapes.Box(lower=(0, 0), upper=(0.5, 0.5))
    made.add_body(name="water", shape=box, material=materials.TaitFluid())
    return made


@pytest.mark.parametrize("name", GIVEN)
def test_an_unknown_keyword(name):
    with pytest.raises(ArgumentError, match="unknown argument 'nonsense'; ") as caught:
        GIVEN[name](nonsense=1)
    assert isinstance(caught.value, libmpm.SceneError) and isinstance(caught.value, TypeError)


@pytest.mark.parametrize("method", ["plan", "advise", "scaled", "preview", "validate", "add_body"])
def test_an_unknown_keyword_of_a_scenes_methods(scene, method):
    with pytest.raises(ArgumentError, match=f"Scene.{method}: unknown argument 'nonsense'"):
        getattr(scene, method)(nonsense=1)


@pytest.mark.parametrize("method", ["run", "plot", "view"])
def test_an_unknown_keyword_of_a_simulations_methods(scene, method):
    simulation = libmpm.Simulation(scene, device="cpu")
    with pytest.raises(ArgumentError, match=f"Simulation.{method}: unknown argument 'nonsense'"):
        getattr(simulation, method)(nonsense=1)


def test_a_misspelt_keyword_is_guessed(scene):
    with pytest.raises(ArgumentError, match="unknown argument 'devic'; did you mean 'device'"):
        libmpm.Simulation(scene, devic="cpu")
    with pytest.raises(ArgumentError, match="did you mean 'frame_interval'"):
        libmpm.Output("results", frame_intervall=0.1)


def test_an_argument_without_its_name(scene):
    with pytest.raises(ArgumentError, match="write them as keywords: until"):
        libmpm.Simulation(scene, device="cpu").run(0.1)


def test_arguments_before_the_keywords_may_be_named(scene):
    assert libmpm.Simulation(scene=scene, device="cpu").scene == scene
    assert libmpm.Output(path="results") == libmpm.Output("results")


def test_a_renamed_argument_works_and_warns():
    from libmpm._src.base.values import keywords_only

    @keywords_only("draw", 1, method=False, renamed={"color": "colour"})
    def draw(what, *, colour="blue"):
        return what, colour

    with pytest.warns(DeprecationWarning, match="draw: 'color' is 'colour' since libmpm 0.2"):
        assert draw(1, color="red") == (1, "red")
    assert draw(1, colour="red") == (1, "red")
