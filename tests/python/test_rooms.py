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
    for path in SOURCE.rglob("*.py"):
        if path.name != "generated.py":
            lines = path.read_text(encoding="utf-8").count("\n")
            assert lines <= 500, f"{path.relative_to(SOURCE)} has {lines} lines"
