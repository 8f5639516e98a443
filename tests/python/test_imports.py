"""`tools/check_imports.py` finds circles of every kind, and the package has no large one."""

import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOL = ROOT / "tools" / "check_imports.py"

pytestmark = pytest.mark.skipif(not TOOL.exists(), reason="needs the source tree")


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("check_imports", TOOL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def package(folder, **files):
    root = folder / "python" / "libmpm"
    root.mkdir(parents=True)
    (root / "__init__.py").write_text("")
    for name, text in files.items():
        (root / f"{name}.py").write_text(text)
    return folder


def test_the_package_has_no_large_circle(tool):
    assert tool.check(ROOT) == []


@pytest.mark.parametrize(
    "back",
    [
        "from libmpm.a import x\n",
        "import libmpm.a\n",
        "from libmpm import a\n",
        "def f():\n    from libmpm.a import x\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from libmpm.a import x\n",
    ],
)
def test_every_kind_of_import_closes_a_circle(tool, tmp_path, back):
    tree = package(
        tmp_path,
        a="from libmpm.b import y\n",
        b="from libmpm.c import z\n",
        c=back,
        d="import math\n",
    )
    assert tool.check(tree, most=3) == []
    (offence,) = tool.check(tree, most=2)
    assert offence.startswith("3 files") and "libmpm.c imports libmpm.a" in offence
    assert "libmpm.d" not in offence


def test_circles_apart_are_not_added_up(tool, tmp_path):
    tree = package(
        tmp_path,
        a="import libmpm.b\nimport libmpm.c\n",
        b="import libmpm.a\n",
        c="import libmpm.d\n",
        d="import libmpm.c\n",
    )
    assert tool.check(tree, most=2) == []
    assert len(tool.check(tree, most=1)) == 2
