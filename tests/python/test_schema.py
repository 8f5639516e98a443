"""The JSON Schema of scene files: up to date, true of every scene, and false of misspelt ones."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray
from python.conftest import make_scene
from python.test_scaling import plane_scene, rich_scene

import libmpm
from libmpm import boundaries, cases, grids, materials, sensors
from libmpm._src.cli.demo import demo_file
from libmpm._src.scene.run_file import RunFile, RunSettings, read_run_file
from libmpm._src.scene.schema import _Types, scene_schema, schema_text
from python import fake_engine

jsonschema = pytest.importorskip("jsonschema")

FILE = Path(__file__).parents[2] / "docs" / "schema" / "scene.schema.json"


@pytest.fixture(scope="module")
def validator():
    """What checks a scene file by the schema."""
    schema = scene_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def problems(validator, document):
    """Return what the schema says about a document, as a file would hold it."""
    return [e.message for e in validator.iter_errors(json.loads(json.dumps(document)))]


def test_the_published_schema_is_up_to_date():
    """A process of its own: values that a test defines are in no file."""
    command = [sys.executable, "-m", "libmpm", "schema"]
    made = subprocess.run(command, capture_output=True, text=True, check=True)
    hint = "write it again: libmpm schema -o docs/schema/scene.schema.json"
    assert made.stdout == FILE.read_text(encoding="utf-8"), hint


def scenes():
    """Return name -> scene file of what tests and cases describe."""
    found = {
        "demo": read_run_file(demo_file()).to_dict(),
        "small": make_scene().to_dict(),
        "fake": fake_engine.small_scene().to_dict(),
        "rich": rich_scene().to_dict(),
        "plane": plane_scene().to_dict(),
    }
    grid = grids.SplineGrid(lower=(0, 0), upper=(1, 1), spans=(4, 4), degree=2)
    splines = libmpm.Scene(grid=grid, gravity=libmpm.TimeTable((0, 1), ((0, 0), (0, -9.81))))
    found["splines"] = splines.to_dict()
    settings = RunSettings(until=1, attributes={"water": ["speed"]}, debris=["block"])
    found["run"] = RunFile(make_scene(), settings).to_dict()
    return found


@pytest.mark.parametrize("name", scenes())
def test_scenes_satisfy_the_schema(name, validator):
    assert problems(validator, scenes()[name]) == []


@pytest.mark.parametrize("name", cases.names())
def test_reference_cases_satisfy_the_schema(name, validator):
    case = cases.case(name)
    scene = case.build(case.parameters(next(iter(case.levels)), {}), cases.Options())
    assert problems(validator, scene.to_dict()) == []


def test_the_short_form_of_a_file_satisfies_it_too(validator):
    """Everything with a default may be left out; "$schema" tells an editor where the schema is."""
    document = {
        "$schema": "scene.schema.json",
        "libmpm": 1, "cell_size": 0.1, "lower": [0, 0, 0], "upper": [1, 1, 1],
        "bodies": [
            {
                "name": "water",
                "shape": {"type": "Box", "lower": [0, 0, 0], "upper": [1, 1, 0.5]},
                "material": {"type": "TaitFluid"},
            }
        ],
        "boundaries": [
            {
                "name": "walls", "shape": {"type": "DomainWalls"},
                "response": {"type": "Slip"}, "time": [0.5, None],
            }
        ],
    }  # fmt: skip
    assert problems(validator, document) == []
    assert len(libmpm.Scene.from_dict(document).bodies) == 1


def change(document, path, value):
    """Put a value at a place of a document."""
    *way, last = path
    for key in way:
        document = document[key]
    document[last] = value


@pytest.mark.parametrize(
    ("path", "value", "word"),
    [
        (("cel_size",), 0.1, "cel_size"),
        (("bodies", 0, "materail"), {"type": "TaitFluid"}, "materail"),
        (("bodies", 0, "shape", "uper"), [1, 1, 1], "uper"),
        (("bodies", 0, "material", "type"), "Tait", "Tait"),
        (("bodies", 0, "material", "density"), -1, "-1"),
        (("bodies", 0, "material", "density"), "heavy", "heavy"),
        (("boundaries", 0, "response", "x-", "type"), "Slipp", "Slipp"),
        (("boundaries", 1, "response", "static_frictoin"), 0.1, "static_frictoin"),
        (("sensors", 0, "sensor", "intervall"), 0.1, "intervall"),
        (("method", "leaving"), "vanish", "vanish"),
        (("method", "transfer"), {"type": "Transfer", "scheme": "FLOP"}, "FLOP"),
        (("run",), {"untill": 2}, "untill"),
        (("run",), {"until": -2}, "-2"),
        (("libmpm",), 99, "1"),
    ],
)
def test_what_is_misspelt_does_not(path, value, word, validator):
    document = make_scene().to_dict()
    change(document, path, value)
    found = list(validator.iter_errors(json.loads(json.dumps(document))))
    assert found
    # The reader refuses it too, so an editor says nothing that the reader does not.
    with pytest.raises(libmpm.SceneError):
        RunSettings.from_dict(document.pop("run", {}))
        libmpm.Scene.from_dict(document)

    def leaves(error):
        return [leaf for e in error.context for leaf in leaves(e)] or [error]

    said = [f"{leaf.message} {leaf.instance}" for error in found for leaf in leaves(error)]
    assert any(word in text for text in said)


@pytest.mark.parametrize("key", ["libmpm", "cell_size"])
def test_what_is_missing_does_not(key, validator):
    document = make_scene().to_dict()
    del document[key]
    assert problems(validator, document)


def test_fields_carry_meaning_unit_range_and_default():
    defined = scene_schema()["$defs"]
    modulus = defined["FixedCorotated"]["properties"]["youngs_modulus"]
    assert modulus["exclusiveMinimum"] == 0
    assert "[Pa]" in modulus["description"]
    assert defined["TaitFluid"]["properties"]["exponent"]["default"] == 7.15
    assert "[s, ≥ 0]" in defined["LoadCell"]["properties"]["interval"]["description"]
    assert "surface level" in defined["bodies"]["properties"]["hydrostatic"]["description"]


def test_a_value_is_in_the_schema_by_being_one():
    """No list is kept by hand: shapes, responses, sensors and materials follow from their bases."""
    defined = scene_schema()["$defs"]

    def names(schema):
        return {one["$ref"].rpartition("/")[2] for one in schema["anyOf"] if "$ref" in one}

    for base, place in (
        (materials.TaitFluid.__mro__[1], defined["bodies"]["properties"]["material"]),
        (sensors.LoadCell.__mro__[1], defined["sensors"]["properties"]["sensor"]),
        (boundaries.Slip.__mro__[1], defined["boundaries"]["properties"]["response"]),
    ):
        public = vars(materials) | vars(sensors) | vars(boundaries)
        kinds = {
            k.__name__ for k in public.values()
            if isinstance(k, type) and issubclass(k, base) and k is not base
        }  # fmt: skip
        assert kinds
        assert kinds <= names(place)
    assert {"Box", "OrientedBox"} <= names(defined["bodies"]["properties"]["shape"])


def test_an_alias_is_what_it_stands_for():
    """`NDArray` is an alias of a ``type`` statement since NumPy 2.5, and others may follow."""
    aliases = pytest.importorskip("typing_extensions")
    number = TypeVar("number")
    of = _Types().of
    rows = aliases.TypeAliasType("rows", list[number], type_params=(number,))
    plain = aliases.TypeAliasType("plain", rows[float])
    assert of(rows[int]) == of(list[int]) == {"type": "array", "items": {"type": "integer"}}
    assert of(plain | None) == of(list[float] | None)
    assert of(NDArray[np.float64]) == of(NDArray[Any]) == {"type": "array"}


def test_the_text_is_json_that_ends_with_a_line():
    assert json.loads(schema_text()) == scene_schema()
    assert schema_text().endswith("}\n")
