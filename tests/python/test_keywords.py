"""A misspelt, missing or unnamed argument is one kind of error wherever a user types it."""

import functools
import inspect

import pytest

import libmpm
from libmpm import boundaries, debris, grids, materials, methods, sensors, shapes
from libmpm._src.base.values import Value
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


def test_an_unknown_keyword_of_a_scenes_changes(scene):
    with pytest.raises(ArgumentError, match=r"Scene\.copy: unknown argument 'cell_sise'; did you"):
        scene.copy(cell_sise=0.1)
    with pytest.raises(ArgumentError, match=r"Scene\.replace: unknown argument 'materia'; did you"):
        scene.replace("water", materia=1)
    with pytest.raises(ArgumentError, match=r"Scene\.remove: unknown argument 'nonsense'"):
        scene.remove("water", nonsense=1)


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


MODULES = (
    boundaries, debris, grids, materials, methods, sensors, shapes, libmpm.advice,
    libmpm.analysis, libmpm.demand, libmpm.design, libmpm.studies, libmpm,
)  # fmt: skip


def _callables():
    """Functions, values and their class methods that a user calls by name, with their labels."""
    for module in MODULES:
        for name in module.__all__:
            thing = getattr(module, name)
            if name in LEFT_OUT or inspect.ismodule(thing) or not callable(thing):
                continue
            label, kind = f"{module.__name__}.{name}", inspect.isclass(thing)
            if not kind or (issubclass(thing, Value) and not inspect.isabstract(thing)):
                yield label, thing
            bases = reversed(thing.__mro__) if kind else ()
            for key, inner in {k: x for base in bases for k, x in vars(base).items()}.items():
                if isinstance(inner, classmethod) and key[0] != "_" and key != "from_dict":
                    yield f"{label}.{key}", getattr(thing, key)


#: What takes no arguments of a user's, or hands them to another function that does the check.
LEFT_OUT = {"attribute_names", "build_info", "formula_table", "formulas", "save_metadata"}
#: Bases of values, which nobody makes.
BASES = ("Angles", "Flow", "Material", "Response", "Sampling", "Sensor", "Shape", "Solid")


def test_every_public_function_and_value_refuses_a_misspelt_keyword_alike():
    wrong, seen = [], 0
    for label, function in _callables():
        if label.split(".")[-1] in BASES:
            continue
        seen += 1
        try:
            function(nonsense=1)
        except ArgumentError as error:
            if "unknown argument 'nonsense'; " not in str(error):
                wrong.append(f"{label}: {error}")
        except Exception as error:
            wrong.append(f"{label}: {type(error).__name__}: {error}")
        else:
            wrong.append(f"{label}: accepted")
    assert seen > 150 and not wrong, "\n".join(wrong)


def test_warnings_point_at_the_line_that_called(scene):
    flat = shapes.Box(lower=(0.6, 0), upper=(1, 0.1))
    scene.add_body(name="film", shape=flat, material=materials.TaitFluid())
    for call in (scene.validate, lambda: libmpm.Simulation(scene, device="cpu")):
        with pytest.warns(libmpm.ModelWarning, match="body 'film': 0.1 m thick") as seen:
            call()
        assert {warning.filename for warning in seen} == {__file__}


def test_a_box_by_centre_and_size_is_sent_to_the_shape_that_has_them():
    for key in ("center", "centre", "size"):
        with pytest.raises(ArgumentError, match=r"use .*shapes.OrientedBox\(centre=, size=\)"):
            shapes.Box(**{key: (1.0, 1.0)})
