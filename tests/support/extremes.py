"""What the tests of the extremes share: values of axes, and what a probe must say of them."""

import re
import sys
from pathlib import Path

import pytest

#: Axes and harness lie in the source tree alone.
FOLDER = Path(__file__).resolve().parents[2] / "benchmarks"
if FOLDER.exists():
    sys.path.insert(0, str(FOLDER))
    from extremes_axis import probe

CPU = {"device": "cpu", "threads": 1}


def ends(axes, single=False):
    """Both ends of the envelope of every short axis, with its `single` values or without."""
    found = []
    for one in axes:
        if one.cheap and one.envelope is not None:
            values = dict.fromkeys((*one.envelope, *(one.also if single else ())))
            found += [pytest.param(one, v, id=f"{one.name}-{v:g}") for v in values]
    return found


def expect_holds(one, value):
    """An axis holds at a value."""
    found = probe(one, value, precision="single", **CPU)
    assert found.outcome == "holds", found.message


def expect_outcome(axes, name, value, outcome, says):
    """An axis of a name ends at a value as it should, and the program says so."""
    one = next(a for a in axes if a.name == name)
    found = probe(one, value, precision="single", **CPU)
    assert found.outcome == outcome, found.message
    assert re.search(says, found.message, re.DOTALL), found.message
