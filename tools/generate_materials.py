#!/usr/bin/env python3
"""Write the Python classes and the documentation page of all materials from the core's table.

Each material is described once, in its C++ header. This tool turns that description into typed
Python classes (python/libmpm/_src/materials/generated.py), so that editors, type checkers and
`help` show real signatures, and into docs/materials.md.

    python tools/generate_materials.py            write both
    python tools/generate_materials.py --check    exit 1 if a committed one is stale

`--table FILE` reads the table from a JSON file instead of the installed core.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
import textwrap
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MODULE = ROOT / "python/libmpm/_src/materials/generated.py"
PAGE = ROOT / "docs/materials.md"
LINE = 100

#: In the core's table without a law; their classes are written by hand.
BY_HAND = ("Rigid",)

#: Materials whose friction angle belongs to a test of the soil, which `cone` names. The core knows
#: that in triaxial compression; the angle in another is converted before it gets there.
FRICTIONAL = ("CamClay", "DruckerPrager")
CONE = {
    "names": '"compression", "extension", "plane-strain"',
    "meaning": "test in which the angles hold: triaxial compression or extension, or plane strain; "
    "None = plane strain in 2D, compression in 3D",
}
ANGLES = {
    "friction_angle": "friction angle in the test that `cone` names, degrees",
}

HEADER = '''"""Materials, generated from the compiled core; do not edit.

Change the C++ header of the material, build, and run ``python tools/generate_materials.py``.
"""
# ruff: noqa: E501  the texts are those of the headers

from __future__ import annotations

import math
from typing import ClassVar

from libmpm._src.base.declarations import given
from libmpm._src.base.values import value
from libmpm._src.materials.friction import Cone, FrictionalMaterial
from libmpm._src.materials.material import Column, Entry, Material, Parameter

'''


def number(item: float) -> str:
    """Return the expression of a float; infinities have no literal."""
    if math.isinf(item):
        return "math.inf" if item > 0 else "-math.inf"
    return repr(float(item))


def bounds(entry: dict[str, Any]) -> str:
    """Return the range of a parameter for people."""
    parts = []
    if not math.isinf(entry["lower"]):
        parts.append(f"{'>' if entry['lower_open'] else '≥'} {entry['lower']:g}")
    if not math.isinf(entry["upper"]):
        parts.append(f"{'<' if entry['upper_open'] else '≤'} {entry['upper']:g}")
    return ", ".join(parts) or "any"


def documentation(material: dict[str, Any]) -> list[str]:
    """Return the lines of a class docstring: summary, parameter table, storage, source."""
    rows = [("parameter", "symbol", "unit", "range", "default", "meaning")]
    for p in material["parameters"]:
        default = "required" if p["default"] is None else f"{p['default']:g}"
        rows.append((p["name"], p["symbol"], p["unit"], bounds(p), default, p["meaning"]))
    if material["name"] in FRICTIONAL:
        rows.append(("cone", "-", "-", "a name", "None", CONE["meaning"]))
    # A long meaning goes on below; a row that begins with a blank continues the one above it.
    left = sum(max(len(row[i]) for row in rows) + 2 for i in range(5))
    rows = [
        (*(row[:5] if i == 0 else ("",) * 5), part)
        for row in rows
        for i, part in enumerate(textwrap.wrap(row[5], LINE - 4 - left))
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    rule = "  ".join("=" * w for w in widths)
    lines = ["  ".join(c.ljust(w) for c, w in zip(r, widths, strict=True)).rstrip() for r in rows]
    stored = ", ".join(f"{c['name']} ({c['meaning']})" for c in material["columns"])
    return [
        f"{material['summary']}.",
        "",
        rule,
        lines[0],
        rule,
        *lines[1:],
        rule,
        "",
        *textwrap.wrap(f"Particles store: {stored}.", LINE - 4),
        f"Volume smoothing (`FBar`) {smoothing(material)}.",
        f"Source: {material['source']}.",
        *names_of_cones(material),
        "",
        "Raises `SceneError` with every parameter out of range.",
    ]


def names_of_cones(material: dict[str, Any]) -> list[str]:
    """Return a paragraph about the choice of a cone, if the material has it."""
    if material["name"] not in FRICTIONAL:
        return []
    text = (
        f"`cone` is one of {CONE['names']}. A cone is circular and can meet Mohr and Coulomb's "
        "surface in one test only: that of 30 degrees in triaxial compression acts as 43.9 degrees "
        "in plane strain."
    )
    return ["", *textwrap.wrap(text, LINE - 4)]


def smoothing(material: dict[str, Any]) -> str:
    """Say whether F-bar applies, after its name."""
    if not material["fbar"]:
        return "does not apply"
    return "is on by default" if material["needs"] == "volume" else "is off unless given"


def render_class(material: dict[str, Any]) -> str:
    """Return the class of one material."""
    base = "FrictionalMaterial" if material["name"] in FRICTIONAL else "Material"
    out = ["", "@value", f"class {material['name']}({base}):"]
    doc = documentation(material)
    out.append(f'    """{doc[0]}')
    out += [f"    {line}".rstrip() for line in doc[1:]]
    out += ['    """', "", f'    label: ClassVar[str] = "materials.{material["name"]}"']
    out.append("    table: ClassVar[Entry] = Entry(")
    for key in ("name", "summary", "source", "needs"):
        out.append(f"        {key}={json.dumps(material[key], ensure_ascii=False)},")
    out.append("        columns=(")
    for c in material["columns"]:
        out.append("            Column(")
        out.append(f"                name={json.dumps(c['name'])},")
        out.append(f"                components={c['components']},")
        out.append(f"                meaning={json.dumps(c['meaning'], ensure_ascii=False)},")
        out.append(f"                unit={json.dumps(c['unit'], ensure_ascii=False)},")
        out.append("            ),")
    out += ["        ),", f"        fbar={bool(material['fbar'])},", "        parameters=("]
    for p in material["parameters"]:
        default = "None" if p["default"] is None else number(p["default"])
        out.append("            Parameter(")
        for key in ("name", "symbol", "unit"):
            out.append(f"                {key}={json.dumps(p[key], ensure_ascii=False)},")
        out.append(f"                default={default},")
        out.append(f"                lower={number(p['lower'])},")
        out.append(f"                upper={number(p['upper'])},")
        out.append(f"                lower_open={bool(p['lower_open'])},")
        out.append(f"                upper_open={bool(p['upper_open'])},")
        out.append(f"                meaning={json.dumps(p['meaning'], ensure_ascii=False)},")
        out.append("            ),")
    out += ["        ),", "    )", ""]
    for p in material["parameters"]:
        default = "" if p["default"] is None else f" = {number(p['default'])}"
        out.append(f"    {p['name']}: float{default}")
    if material["name"] in FRICTIONAL:
        wrapped = textwrap.wrap(CONE["meaning"], LINE - 12)
        parts = [f"{part} " for part in wrapped[:-1]] + wrapped[-1:]
        text = "\n".join(f"        {json.dumps(part, ensure_ascii=False)}" for part in parts)
        out.append(
            "    cone: Cone | None = given(\n"
            f'{text},\n        default=None,\n        range="a name",\n    )'
        )
    return "\n".join(out) + "\n"


def render(table: list[dict[str, Any]]) -> str:
    """Return the text of the whole module."""
    names = sorted(m["name"] for m in table)
    exported = "__all__ = [" + ", ".join(f'"{n}"' for n in names) + "]\n"
    if len(exported) > 100:
        exported = "__all__ = [\n" + "".join(f'    "{n}",\n' for n in names) + "]\n"
    return HEADER + exported + "".join("\n" + render_class(m) for m in table)


PAGE_HEADER = """<!-- Generated by tools/generate_materials.py; do not edit. -->

# Materials

A material is a value of `libmpm.materials`; its parameters are keyword arguments in SI units. One
out of its range is refused with the range and a remedy, all of them at once. What a particle of the
material stores, besides its position and its id, is listed here and in `scene.plan()`.
A body without a law, which keeps its shape, is of [`materials.Rigid`](rigid.md).
"""


def cell(text: str) -> str:
    """Return text that a Markdown table holds."""
    return text.replace("|", "\\|")


def render_section(material: dict[str, Any]) -> str:
    """Return the section of one material."""
    out = ["", f"## {material['name']}", "", f"{material['summary']}.", ""]
    out += ["| parameter | symbol | unit | range | default | meaning |"]
    out += ["| --- | --- | --- | --- | --- | --- |"]
    for p in material["parameters"]:
        default = "required" if p["default"] is None else f"{p['default']:g}"
        row = (f"`{p['name']}`", p["symbol"], p["unit"], bounds(p), default, p["meaning"])
        out.append(f"| {' | '.join(map(cell, row))} |")
    if material["name"] in FRICTIONAL:
        row = ("`cone`", "-", "-", "a name", "None", CONE["meaning"])
        out.append(f"| {' | '.join(map(cell, row))} |")
        out += [line for line in names_of_cones(material) if not line]
        out.append(" ".join(line for line in names_of_cones(material) if line))
    out += ["", "| stored by a particle | numbers | unit | meaning |", "| --- | --- | --- | --- |"]
    for c in material["columns"]:
        numbers = str(c["components"])
        row = (f"`{c['name']}`", numbers, c["unit"], c["meaning"])
        out.append(f"| {' | '.join(map(cell, row))} |")
    out += [
        "",
        f"Volume smoothing (`libmpm.FBar`) {smoothing(material)}. Source: {material['source']}.",
    ]
    return "\n".join(out) + "\n"


def render_page(table: list[dict[str, Any]]) -> str:
    """Return the documentation page."""
    return PAGE_HEADER + "".join(render_section(m) for m in table)


def load(path: Path | None) -> list[dict[str, Any]]:
    """Return the table of the installed core, or of a JSON file; a bound of None is infinite."""
    if path is None:
        table = importlib.import_module("libmpm._core").material_table()
    else:
        table = json.loads(path.read_text(encoding="utf-8"))
    table = [material for material in table if material["name"] not in BY_HAND]
    for material in table:
        for p in material["parameters"]:
            p["lower"] = -math.inf if p["lower"] is None else p["lower"]
            p["upper"] = math.inf if p["upper"] is None else p["upper"]
            if material["name"] in FRICTIONAL:
                p["meaning"] = ANGLES.get(p["name"], p["meaning"])
    return list(table)


def main(arguments: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare with the committed files")
    parser.add_argument("--table", type=Path, help="read the table from this JSON file")
    options = parser.parse_args(arguments)
    try:
        table = load(options.table)
    except ImportError as error:
        print(f"the compiled core cannot be imported: {error}; build libmpm first", file=sys.stderr)
        return 2
    stale = 0
    for target, text in ((MODULE, render(table)), (PAGE, render_page(table))):
        if target.is_file() and target.read_text(encoding="utf-8") == text:
            continue
        if options.check:
            print(f"{target} is stale; run python tools/generate_materials.py", file=sys.stderr)
            stale = 1
        else:
            target.parent.mkdir(exist_ok=True)
            target.write_text(text, encoding="utf-8")
    return stale


if __name__ == "__main__":
    sys.exit(main())
