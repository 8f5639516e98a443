"""Materials: values that follow from the core's table."""

from __future__ import annotations

import importlib.util
import inspect
import math
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

import libmpm
from libmpm import materials
from libmpm._src.materials.material import wave_speed

TOOL = Path(__file__).resolve().parents[2] / "tools" / "generate_materials.py"
ALL = [
    materials.TaitFluid(),
    materials.HerschelBulkleyFluid(
        density=1600.0, yield_stress=40.0, consistency=8.0, largest_viscosity=1e3
    ),
    materials.FixedCorotated(density=7.0, youngs_modulus=2e5),
    materials.NeoHookean(density=7.0, youngs_modulus=2e5),
    materials.StVenantKirchhoffHencky(density=7.0, youngs_modulus=2e5),
    materials.LinearElastic(density=7.0, youngs_modulus=2e5),
    materials.VonMises(density=7.0, youngs_modulus=2e5, yield_stress=1e3),
    materials.DruckerPrager(density=7.0, youngs_modulus=2e5, cohesion=10.0),
    materials.CamClay(density=7.0, youngs_modulus=2e5, log_plastic_volume=-0.02),
    materials.Hypoelastic(density=7.0, youngs_modulus=2e5),
]


@pytest.mark.parametrize("material", ALL)
def test_value_semantics(material: materials.Material) -> None:
    same = type(material).from_dict(material.to_dict())
    assert same == material
    assert hash(same) == hash(material)
    assert pickle.loads(pickle.dumps(material)) == material
    assert type(material)(**material.parameters()) == material
    assert eval(repr(material), {"materials": materials}) == material


@pytest.mark.parametrize("material", ALL)
def test_signature_and_documentation_follow_the_table(material: materials.Material) -> None:
    signature = inspect.signature(type(material))
    documentation = type(material).__doc__ or ""
    for p in material.table.parameters:
        given = signature.parameters[p.name]
        assert given.kind is inspect.Parameter.KEYWORD_ONLY
        assert given.default == (inspect.Parameter.empty if p.default is None else p.default)
        assert p.name in documentation
        assert p.symbol in documentation
        assert p.unit in documentation


def test_defaults_and_conversion() -> None:
    water = materials.TaitFluid(density=998)
    assert water.density == 998.0
    assert isinstance(water.density, float)
    assert (water.bulk_modulus, water.exponent, water.viscosity) == (2.2e9, 7.15, 0.001)


def test_poisson_ratio_says_why() -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        materials.FixedCorotated(density=1.0, youngs_modulus=1.0, poissons_ratio=0.5)
    (problem,) = caught.value.problems
    assert problem.startswith("materials.FixedCorotated: poissons_ratio is 0.5; expected > -1")
    assert "incompressible" in problem
    assert "0.49 or less" in problem


def test_all_problems_at_once() -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        materials.TaitFluid(density=0, bulk_modulus=-1.0, exponent=0.5, viscosity=math.inf)
    assert len(caught.value.problems) == 4
    assert "density is 0; expected > 0 kg/m³" in caught.value.problems[0]


@pytest.mark.parametrize("bad", ["1000", None, True, math.nan, [1.0]])
def test_only_finite_numbers(bad: object) -> None:
    with pytest.raises(libmpm.SceneError, match="density"):
        materials.TaitFluid(density=bad)


def test_wrong_keywords() -> None:
    with pytest.raises(libmpm.SceneError) as caught:
        materials.FixedCorotated(density=1.0, young_modulus=1.0)
    first, second = caught.value.problems
    assert "unknown argument 'young_modulus'; did you mean 'youngs_modulus'?" in first
    assert "'youngs_modulus' is missing" in second
    with pytest.raises(libmpm.SceneError, match="takes keyword arguments only"):
        materials.TaitFluid(1000.0)


def test_wave_speed() -> None:
    assert wave_speed(materials.TaitFluid(bulk_modulus=4e6)) == math.sqrt(4e3)
    solid = materials.FixedCorotated(density=2.0, youngs_modulus=8.0, poissons_ratio=0.0)
    assert wave_speed(solid) == 2.0


def _tool():
    spec = importlib.util.spec_from_file_location("generate_materials", TOOL)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_generator_reproduces_the_committed_files() -> None:
    if not TOOL.is_file():
        pytest.skip("the sources are not beside the tests")
    tool = _tool()
    table = []
    for material in map(type, ALL):
        entry = material.table
        table.append(
            {k: getattr(entry, k) for k in ("name", "summary", "source", "needs", "fbar")}
            | {
                "columns": [vars(c) for c in entry.columns],
                "parameters": [vars(p) for p in entry.parameters],
            }
        )
    assert tool.render(table) == tool.MODULE.read_text(encoding="utf-8")
    assert tool.render_page(table) == tool.PAGE.read_text(encoding="utf-8")
    table[0]["parameters"][0] = table[0]["parameters"][0] | {"default": 998.0}
    assert tool.render(table) != tool.MODULE.read_text(encoding="utf-8")


def test_committed_files_match_the_core() -> None:
    pytest.importorskip("libmpm._core")
    if not TOOL.is_file():
        pytest.skip("the sources are not beside the tests")
    done = subprocess.run([sys.executable, str(TOOL), "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
