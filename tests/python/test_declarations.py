"""One declaration a field: what it says is in docstring, check, schema and scaling."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import libmpm
from libmpm import sensors, shapes
from libmpm._src.base.declarations import MARK, Given, declared, filled, given, table_of
from libmpm._src.base.values import Checker, Value, registry, value
from libmpm._src.materials.material import Material
from libmpm._src.scene.data import HEAD
from libmpm._src.scene.run_file import RunSettings
from libmpm._src.scene.schema import scene_schema


def kinds():
    package = importlib.import_module("libmpm._src")
    for module in pkgutil.walk_packages(package.__path__, "libmpm._src."):
        importlib.import_module(module.name)
    return {
        name: kind
        for name, kind in sorted(registry.items())
        if kind.__module__.startswith("libmpm.") and not issubclass(kind, Material)
    }


def test_every_field_of_every_value_is_declared():
    """Materials have a table from the core; all others have `given`."""
    missing = [
        f"{name}.{field.name}"
        for name, kind in [*kinds().items(), ("RunSettings", RunSettings)]
        for field in dataclasses.fields(kind)
        if field.name not in declared(kind) or not declared(kind)[field.name].meaning
    ]
    assert not missing, f"declare by given(...): {missing}"
    arguments = set(inspect.signature(libmpm.Scene.__init__).parameters) - {"self"}
    assert arguments == set(HEAD)


def test_every_declared_field_is_in_its_docstring():
    for name, kind in [*kinds().items(), ("RunSettings", RunSettings)]:
        text = inspect.getdoc(kind)
        assert MARK not in text, name
        for field, says in declared(kind).items():
            row = next((r for r in text.splitlines() if r.startswith(f"{field} ")), "")
            assert says.unit in row, f"{name}.{field} is not in the docstring: {row!r}"
            assert says.meaning.split()[0] in row, f"{name}.{field}: {row!r}"
    for method in ("add_body", "add_boundary"):
        assert MARK not in getattr(libmpm.Scene, method).__doc__
        assert "unique" in getattr(libmpm.Scene, method).__doc__


def bounded():
    """Every numeric bound that is declared of a plain number, with a number on its wrong side."""
    for name, kind in kinds().items():
        hints = {f.name: f.type for f in dataclasses.fields(kind)}
        for field, says in declared(kind).items():
            plain = hints[field] in ("float", "int", "float | None", "int | None")
            if says.shape or not plain:
                continue
            for bound, wrong in (
                (says.low, -1), (says.above, 0), (says.high, 1), (says.below, 0),
            ):  # fmt: skip
                if bound is not None:
                    yield pytest.param(kind, field, bound + wrong, id=f"{name}.{field}={bound}")


#: Made by libmpm alone, as a record of what was done.
RECORDS = {"Placement"}


@pytest.mark.parametrize(("kind", "field", "wrong"), list(bounded()))
def test_a_declared_bound_is_checked(kind, field, wrong):
    """Whatever else is missing or wrong, the message names this field, its value and the rule."""
    if kind.__name__ in RECORDS:
        pytest.skip("a record")
    made = object.__new__(kind)
    for f in dataclasses.fields(kind):
        has = f.default is not dataclasses.MISSING
        object.__setattr__(made, f.name, f.default if has else None)
    object.__setattr__(made, field, wrong)
    check = Checker(kind.__name__)
    try:
        made._check(check)
    except (TypeError, AttributeError, ValueError, libmpm.SceneError) as error:
        if not any(field in p for p in check.problems):
            pytest.skip(f"cannot be checked without its other fields: {error!r:.60}")
    assert any(f"{field} is" in p for p in check.problems), check.problems


def test_a_check_says_value_rule_unit_and_remedy():
    @value
    class Pond(Value):
        """A pond.

        {fields}
        """

        depth: float = given(
            "of the water", unit="m", above=0, high=9, remedy="dig", source="Bonus (2023) 2.1"
        )
        fish: int = given("in it", default=1, low=1, whole=True)
        middle: tuple[float, ...] = given("place", default=(0.0, 0.0), unit="m", shape="(2|3,)")

        def _check(self, check):
            return {name: check.given(name, self) for name in declared(type(self))}

    try:
        with pytest.raises(libmpm.SceneError) as caught:
            Pond(depth=0, fish=0, middle=(1,))
        for text in (
            "depth is 0; expected > 0 and ≤ 9 m; dig", "fish is 0; expected a whole number ≥ 1",
            "middle is (1,); expected 2 or 3 numbers in m",
        ):  # fmt: skip
            assert text in str(caught.value)
        assert "depth      m     > 0, ≤ 9  of the water (Bonus (2023) 2.1)" in Pond.__doc__
        assert Pond(depth=1).middle == (0.0, 0.0)
    finally:
        del registry["Pond"]


def test_bounds_and_meaning_are_in_the_schema():
    defined = scene_schema()["$defs"]
    thickness = defined["DecayLayer"]["properties"]["thickness"]
    assert (thickness["exclusiveMinimum"], thickness["maximum"]) == (0, 4)
    assert defined["LoadCell"]["properties"]["interval"]["minimum"] == 0
    assert "[m, (2|3,)]" in defined["Box"]["properties"]["lower"]["description"]


def test_a_table_wraps_and_keeps_hyphens():
    text = table_of({"a": Given("moments, MLS-MPM " * 9, unit="m/s", low=0, high=1)})
    assert "0 to 1" in text
    assert all(len(line) <= 100 for line in text.splitlines())
    assert filled(None, {}) is None
    assert math.isclose(shapes.Box(lower=(0, 0), upper=(1, 2)).volume(), 2)
    assert sensors.Energy().interval == 0.0


TOOL = Path(__file__).resolve().parents[2] / "tools" / "generate_units.py"


@pytest.mark.skipif(not TOOL.exists(), reason="needs the source tree")
def test_the_page_of_units_is_up_to_date():
    """A process of its own: values that a test defines are on no page."""
    subprocess.run([sys.executable, TOOL, "--check"], check=True)
