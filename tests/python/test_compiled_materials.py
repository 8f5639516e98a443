"""Materials from a C++ header that is compiled at run time.

Expected duration: 60 s on two cores, most of it the compiler's.
"""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import libmpm
from libmpm import materials, shapes

ROOT = Path(__file__).resolve().parents[2]
HEADERS = ROOT / "include/mpm/physics/material"
SOFT = {"density": 1000.0, "youngs_modulus": 1e5, "poissons_ratio": 0.3}

pytestmark = pytest.mark.skipif(
    shutil.which("c++") is None and shutil.which("g++") is None, reason="needs a C++ compiler"
)


def copied(fused):
    """The text of the built-in small-strain law under another name."""
    text = (HEADERS / "linear_elastic.hpp").read_text(encoding="utf-8")
    text = text.replace("LinearElastic", "Copied" if fused else "CopiedPhased")
    words = "static constexpr const char* needs"
    return text if fused else text.replace(words, f"static constexpr bool fused = false;\n{words}")


@pytest.fixture(scope="session")
def cache(tmp_path_factory):
    """One folder for all workers of a run of pytest."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base


def moved(law, dimension, precision, **more):
    scene = libmpm.Scene(
        dimension=dimension, cell_size=0.1, lower=(0,) * dimension, upper=(1,) * dimension,
        gravity=(0,) * dimension, method=libmpm.Method(**more.pop("method", {})),
    )  # fmt: skip
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.3,) * dimension, upper=(0.7,) * dimension),
        material=law(**SOFT),
    )  # fmt: skip
    more = {"device": "cpu", "threads": 2} | more
    sim = libmpm.Simulation(scene, precision=precision, **more)
    x = sim.particles["b"]["position"] - 0.5
    sim.particles["b"]["velocity"] = 0.3 * np.sin(7 * x) + 0.2 * x[:, ::-1]
    sim.step(30)
    return sim.particles["b"].read(["position", "velocity", "stress", "elastic_energy"])


@pytest.mark.parametrize("precision", ["single", "double"])
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("fused", [True, False])
def test_the_formula_of_a_built_in_law_has_its_bits(cache, fused, dimension, precision):
    law = materials.from_header(copied(fused), cache=cache)
    ways = [{"pipeline": p} for p in (("fused", "two-pass", "phased") if fused else ("phased",))]
    for way in [*ways, {"method": {"transfer": "FLIP"}, "pipeline": "phased"}]:
        found = moved(law, dimension, precision, **dict(way))
        expected = moved(materials.LinearElastic, dimension, precision, **dict(way))
        for name, values in expected.items():
            np.testing.assert_array_equal(found[name], values)
        assert np.abs(expected["stress"]).max() > 100


def test_a_class_is_like_those_of_the_library(cache):
    law = materials.from_header(copied(False), cache=cache)
    assert law is materials.from_header(copied(False), cache=cache)
    assert issubclass(law, materials.Material)
    assert law.table.parameters == materials.LinearElastic.table.parameters
    made = law(**SOFT)
    assert made.to_dict() == {"type": "CopiedPhased", **SOFT}
    assert law.from_dict(made.to_dict()) == made
    with pytest.raises(libmpm.SceneError, match=r"poissons_ratio is 0.5"):
        law(**SOFT | {"poissons_ratio": 0.5})
    with pytest.raises(libmpm.SceneError, match="did you mean"):
        law(**SOFT, densty=3)


def test_another_process_takes_what_is_compiled(cache, tmp_path):
    materials.from_header(copied(False), cache=cache)
    (tmp_path / "law.hpp").write_text(copied(False), encoding="utf-8")
    code = f"""
import libmpm.materials as m, libmpm._src.materials.compiled as c
c._compile = lambda *a: 1 / 0
print(m.from_header({str(tmp_path / "law.hpp")!r}, cache={str(cache)!r}).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "CopiedPhased", done.stderr


def test_without_a_compiler_it_is_refused_by_name(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CXX", raising=False)
    with pytest.raises(libmpm.Error, match=r"material 'CopiedPhased' needs a C\+\+20 compiler"):
        materials.from_header(copied(False), cache=tmp_path)
    with pytest.raises(libmpm.Error, match="'no-such' is not found"):
        materials.from_header(copied(False), cache=tmp_path, compiler="no-such")


def test_headers_that_cannot_be_are_refused_by_name(cache, tmp_path):
    with pytest.raises(libmpm.SceneError, match="does not define its name"):
        materials.from_header("struct A {\n};", cache=tmp_path)
    with pytest.raises(libmpm.SceneError, match="cannot be read"):
        materials.from_header(tmp_path / "none.hpp", cache=tmp_path)
    with pytest.raises(libmpm.SceneError, match="'LinearElastic' is built in"):
        materials.from_header(HEADERS / "linear_elastic.hpp", cache=tmp_path)
    wrong = copied(False).replace("CopiedPhased", "Wrong").replace("T(2) * k.shear", "k.sheer")
    with pytest.raises(libmpm.SceneError, match=r"'Wrong' does not compile: .*sheer"):
        materials.from_header(wrong, cache=tmp_path)
    assert not list(tmp_path.rglob("*.so"))
    materials.from_header(copied(False), cache=cache)
    with pytest.raises(libmpm.SceneError, match="another header in this process"):
        materials.from_header(copied(False) + "// changed\n", cache=cache)


def test_a_file_that_is_no_library_is_refused(tmp_path):
    (tmp_path / "a.so").write_text("not one", encoding="ascii")
    core = __import__("libmpm._core", fromlist=["_core"])
    with pytest.raises(libmpm.SceneError, match="cannot be loaded"):
        core.add_material(str(tmp_path / "a.so"))


def thing(law):
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    scene.add_body(
        name="b", shape=shapes.Box(lower=(0.3, 0.3), upper=(0.7, 0.7)), material=law(**SOFT)
    )
    return scene


def test_on_a_cuda_device_it_needs_nvcc(cache, monkeypatch):
    law = materials.from_header(copied(False), cache=cache)
    compiled = importlib.import_module("libmpm._src.materials.compiled")
    monkeypatch.setattr(compiled, "find_nvcc", lambda: None)
    with pytest.raises(libmpm.Error, match=r"body 'b': materials.CopiedPhased .* needs nvcc"):
        libmpm.Simulation(thing(law), device="cuda:0")
    assert libmpm.Simulation(thing(law), device="auto").device == "cpu"


@pytest.mark.gpu
@pytest.mark.parametrize("fused", [True, False])
@pytest.mark.parametrize("precision", ["single", "mixed", "double"])
def test_on_a_device_the_formula_of_a_built_in_law_has_its_bits(cache, fused, precision):
    law = materials.from_header(copied(fused), cache=cache)
    for dimension in (2, 3):
        for pipeline in ("auto", "phased") if fused else ("phased",):
            way = {"device": "cuda", "pipeline": pipeline}
            found = moved(law, dimension, precision, **way)
            expected = moved(materials.LinearElastic, dimension, precision, **way)
            for name, values in expected.items():
                np.testing.assert_array_equal(found[name], values)
