"""What the README claims is measured: times by CI, its numbers, script, pictures and links here.

Expected duration: 10 s.
"""

import re
import subprocess
import sys
from pathlib import Path

import matplotlib

import libmpm
from libmpm._src.methods import transfer

matplotlib.use("Agg", force=False)

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
WORDS = {"seven": 7, "eight": 8, "nine": 9, "ten": 10, "eleven": 11, "twelve": 12}


def compared(*rows):
    command = [sys.executable, ROOT / "tools/readme_claims.py", *rows]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_every_row_that_ci_measures_is_in_the_readme():
    script = (ROOT / ".ci/run").read_text(encoding="utf-8")
    rows = [line.split('claims+=("')[1].split("=")[0] for line in script.splitlines()
            if 'claims+=("' in line]  # fmt: skip
    assert len(rows) == 3
    done = compared(*(f"{row}=60" for row in rows))
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("README") >= 3


def test_a_row_that_is_not_there_fails_and_a_far_time_is_marked():
    assert compared("make coffee=60").returncode == 1
    assert "correct the README" in compared("pytest=60000").stdout
    assert "correct the README" not in compared("pytest=600").stdout
    assert "not measured" in compared("pytest=600").stdout, "rows that CI leaves out are named"


def test_the_readme_script_runs_and_its_load_is_that_of_a_bore(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = re.search(r"## A first script\n.*?```python\n(.*?)```", README, re.DOTALL)[1]
    names = {}
    exec(compile(code, "README.md", "exec"), names)  # as a reader would
    peak = names["sim"].sensors["load"].peak(filter=0.01)
    assert "Peak(" in capsys.readouterr().out
    # Between the static push of half the head and three times that of the whole, N/m.
    static = 0.5 * 1000 * 9.81 * 0.5**2
    assert 0.25 * static < peak.value < 3 * static and peak.component == "force_x"
    assert 0.2 < peak.time < 0.45, "no sooner than a front of 2 sqrt(gH) reaches the pier"


def test_the_demo_has_the_particles_that_the_readme_says():
    count = int(re.search(r"`libmpm demo`: ([0-9,]+) particles", README)[1].replace(",", ""))
    scene = libmpm.Scene.load(ROOT / "python/libmpm/data/surge.json")
    assert scene.plan(until=0.01, device="cpu").particles == count


def test_counts_of_scripts_notebooks_and_pictures():
    words = README.lower()
    scripts = re.search(r"(\w+) scripts that stand alone", words)[1]
    assert WORDS[scripts] == len(list((ROOT / "examples").glob("*.py")))
    notebooks = re.search(r"(\w+) notebooks in", words)[1]
    assert WORDS[notebooks] == len(list((ROOT / "docs/tutorials").glob("*.ipynb")))
    gallery = (ROOT / "docs/gallery.ipynb").read_text(encoding="utf-8")
    pictures = re.search(r"\[(\w+) pictures\]", words)[1]
    assert WORDS[pictures] == gallery.count('"image/png"')


def test_counts_of_transfers_and_shape_functions():
    transfers = re.search(r"APIC, FLIP and (\w+) other transfers", README)[1]
    assert WORDS[transfers] + 2 == len(transfer.SCHEMES)
    functions = re.search(r"(\w+) shape functions", README)[1]
    assert WORDS[functions] == len(transfer.KERNELS)


def test_links_and_pictures_are_there_and_the_film_is_small():
    targets = re.findall(r"\]\(([^)#]+?)(?:#[^)]*)?\)", README)
    assert len(targets) > 15
    for target in targets:
        assert target.startswith("https://") or (ROOT / target).exists(), target
    first = README.split("\n## ")[0]
    assert "docs/figures/demo.gif" in first, "the first screen shows what it does"
    assert (ROOT / "docs/figures/demo.gif").stat().st_size < 3e6


def test_the_page_for_a_forge_lists_what_the_index_has():
    docs = ROOT / "docs"
    index = (docs / "index.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL)
    lines = [line for block in blocks for line in block.splitlines()]
    pages = [line for line in lines if line and line[0] != ":"]
    assert len(pages) > 40
    forge = (docs / "README.md").read_text(encoding="utf-8")
    listed = re.findall(r"^- \[.*?\]\((.*?)\)", forge, re.MULTILINE)
    assert [name.rsplit(".", 1)[0] for name in listed] == pages
    assert all((docs / name).exists() for name in listed)
    theory = (docs / "theory.md").read_text(encoding="utf-8")
    assert "{math}" not in theory and theory.count("$$") > 20, "formulas that a forge shows"
