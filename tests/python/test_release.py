"""What a release says of itself agrees: versions, Pythons, what is in the source distribution.

Expected duration: 1 s.
"""

import importlib.util
import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def text(name):
    file = ROOT / name
    if not file.exists():
        pytest.skip(f"{name} is not here")
    return file.read_text(encoding="utf-8")


def test_version_of_the_package_the_citation_and_the_changelog():
    """`pyproject.toml` has the version that everything compiled gets; two texts repeat it."""
    version = PROJECT["version"]
    assert re.search(r"^version: (.+)$", text("CITATION.cff"), re.MULTILINE)[1] == version
    sections = re.findall(r"^## \[(.+?)\](.*)$", text("CHANGELOG.md"), re.MULTILINE)
    assert sections[0][0] == "Unreleased"
    newest, date = sections[1]
    assert newest == version
    released = re.search(r"^date-released: (.+)$", text("CITATION.cff"), re.MULTILINE)[1]
    assert date == f" - {released}"


def test_pythons_that_are_claimed_get_wheels():
    stated = [c.rsplit(" ", 1)[1] for c in PROJECT["classifiers"] if " :: 3." in c]
    assert PROJECT["requires-python"] == f">={stated[0]}"
    workflow = text(".github/workflows/wheels.yml").split("\n  wheels:\n")[1]
    jobs = re.findall(r"python: \[(.+)\]", workflow)
    assert len(jobs) == 2, "wheels are built and tried"
    for versions in jobs:
        assert re.findall(r'"(.+?)"', versions) == stated
    assert f"tools/check_wheel.sh --backend cuda {' '.join('python' + s for s in stated)}" in text(
        "docs/installing.md"
    )


def test_content_of_a_source_distribution():
    spec = importlib.util.spec_from_file_location("check_sdist", ROOT / "tools/check_sdist.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    tracked = {"README.md", "src/a.cpp", "benchmarks/results/a.jsonl", "benchmarks/a.py"}
    packed = {"README.md", "src/a.cpp", "benchmarks/a.py", "PKG-INFO"}
    assert tool.compare(packed, tracked) == []
    wrong = tool.compare(packed - {"src/a.cpp"} | {"out.h5"}, tracked)
    assert wrong == [
        "the source distribution lacks src/a.cpp",
        "the source distribution holds out.h5",
    ]
    assert len(tool.compare(packed | {"benchmarks/results/a.jsonl"}, tracked)) == 1
