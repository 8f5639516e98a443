"""The modules of the folder examples, which is no package."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def debris_study(monkeypatch, name):
    """Import a module of examples/debris_study, beside its neighbours, for one test."""
    monkeypatch.syspath_prepend(ROOT / "examples" / "debris_study")
    for module in ("figures", "record", "in_air", "with_water"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    return __import__(name)
