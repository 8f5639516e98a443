"""Reference cases with known answers, to be run on your machine or with your choices.

>>> import libmpm.cases
>>> result = libmpm.cases.run("sloshing", device="cuda")  # doctest: +SKIP
>>> result.values, result.failures  # doctest: +SKIP

Each case says what it is compared with (`Case.source`, `Bound.source`). `run` takes the level
("reduced": seconds to minutes on two cores; "full": minutes on a GPU), `Options` with the numerical
choices to try, and changes of the case's own parameters.
"""

from __future__ import annotations

from typing import Any

from libmpm._src.advice.cases.bridges import CASES as _BRIDGES
from libmpm._src.advice.cases.case import Bound, Case, CaseResult, Options
from libmpm._src.advice.cases.decks import CASES as _DECKS
from libmpm._src.advice.cases.fluids import CASES as _FLUIDS
from libmpm._src.advice.cases.loads import CASES as _LOADS
from libmpm._src.advice.cases.locking import CASES as _LOCKING
from libmpm._src.advice.cases.solids import CASES as _SOLIDS
from libmpm._src.advice.cases.waves import CASES as _WAVES
from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.values import nearest
from libmpm._src.errors import SceneError

__all__ = ["Bound", "Case", "CaseResult", "Options", "case", "names", "run"]

_ALL = (*_SOLIDS, *_LOCKING, *_FLUIDS, *_WAVES, *_BRIDGES, *_DECKS, *_LOADS)
_CASES: dict[str, Case] = {c.name: c for c in _ALL}


def names() -> list[str]:
    """Return the names of all cases."""
    return list(_CASES)


@keywords_only("cases.case", 1, method=False)
def case(name: str) -> Case:
    """Return a case. Raises `SceneError` naming the nearest one."""
    if name not in _CASES:
        raise SceneError(f"case is {name!r}; {nearest(name, names())}")
    return _CASES[name]


def run(
    name: str, level: str = "reduced", options: Options | None = None, **how: Any
) -> CaseResult:
    """Run a case and compare; see `Case.run` for the rest. Raises `SceneError`."""
    return case(name).run(level, options, **how)
