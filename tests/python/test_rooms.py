"""The package as a house: folders and first lines answer the questions of CONTRIBUTING.md."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "python" / "libmpm" / "_src"
GUIDE = ROOT / "CONTRIBUTING.md"

pytestmark = pytest.mark.skipif(not GUIDE.exists(), reason="needs the source tree")


def first_line(path):
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text, f"{path} has no docstring"
    return text.split("\n")[0]


def test_a_strangers_questions_are_answered_by_first_lines():
    text = GUIDE.read_text(encoding="utf-8")
    rows = re.findall(r"^\| ([^|]*\?) \| `([^`]+)` \| (.*) \|$", text, flags=re.MULTILINE)
    assert len(rows) >= 10
    for question, file, said in rows:
        assert first_line(SOURCE / file) == said, f"{question} is answered elsewhere: {file}"


def test_every_file_says_what_one_would_come_for():
    for path in SOURCE.rglob("*.py"):
        line = first_line(path)
        assert line[-1] in ".:", f"{path}: {line}"
        assert 10 < len(line) < 98, f"{path}: {line}"


def test_the_rooms_are_those_of_the_architecture():
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `([a-z]+)` \| ", page.split("## Rooms")[1], flags=re.MULTILINE))
    rooms = {p.name for p in SOURCE.iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert rooms <= listed
    assert {p.name for p in SOURCE.glob("*.py")} == {"__init__.py", "errors.py", "moved.py"}


def test_no_file_is_long():
    """Tests apart: what those of one subject share lies in one file."""
    for folder in ("python", "tools", "benchmarks", "examples", "docs"):
        for path in (ROOT / folder).rglob("*.py"):
            if path.name != "generated.py":
                lines = path.read_text(encoding="utf-8").count("\n")
                assert lines <= 500, f"{path.relative_to(ROOT)} has {lines} lines"


def test_the_pages_of_the_api_follow_the_rooms():
    docs = ROOT / "docs"
    text = (docs / "api.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `([a-z]+)` \| .* \| (.*) \|$", text, flags=re.MULTILINE))
    rooms = {p.name for p in SOURCE.iterdir() if p.is_dir() and (p / "__init__.py").exists()}
    assert set(rows) == rooms
    linked = {page for cell in rows.values() for page in re.findall(r"\(([^)]+\.md)\)", cell)}
    pages = {f"api/{p.name}" for p in (docs / "api").glob("*.md")}
    assert linked == pages | {"command-line.md"}
    assert set(re.findall(r"^(api/\w+)$", text, flags=re.MULTILINE)) == {p[:-3] for p in pages}


def test_completion_and_page_of_a_simulation_leave_out_what_only_parts_of_the_package_need():
    import libmpm
    from libmpm._src.run.plotting import SEAM

    page = (ROOT / "docs" / "api" / "run.md").read_text(encoding="utf-8")
    said = re.search(r"^   :exclude-members: (engine.*)$", page, flags=re.MULTILINE)
    assert said and said[1].split(", ") == list(SEAM)
    scene = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0, 0), upper=(1, 1))
    box = libmpm.shapes.Box(lower=(0, 0), upper=(1, 0.5))
    scene.add_body(name="water", shape=box, material=libmpm.materials.TaitFluid())
    simulation = libmpm.Simulation(scene, device="cpu")
    assert not set(SEAM) & set(dir(simulation)) and {"run", "particles"} <= set(dir(simulation))
    assert all(hasattr(simulation, name) for name in SEAM)


def test_every_public_name_has_its_place_on_one_page():
    import libmpm

    found: dict[str, int] = {}
    for page in (ROOT / "docs" / "api").glob("*.md"):
        kinds = "module|class|function|exception"
        for name in re.findall(rf"^\.\. auto(?:{kinds}):: libmpm\.(\w+)$",
                               page.read_text(encoding="utf-8"), flags=re.MULTILINE):  # fmt: skip
            found[name] = found.get(name, 0) + 1
    # Of modules: `Study` of `studies`, `FBar` and `Method` of `methods`, and what `compat` holds.
    elsewhere = {"Study", "FBar", "Method", "compat"}
    assert set(found) == set(libmpm.__all__) - elsewhere
    assert max(found.values()) == 1
