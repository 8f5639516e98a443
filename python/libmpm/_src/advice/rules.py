"""Which cases of the atlas a scene is like: one rule a case, each with its reason in words."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from libmpm._src.advice.facts import LOCKS, Facts
from libmpm._src.base.formulas import Field
from libmpm._src.scene.checks_loads import narrow_gap, weighed

__all__ = ["FLOATING", "RULES", "Match", "Rule", "matches", "unmatched"]

#: How many times as long as thick a body is that bends, or as high as wide one that falls over.
_SLENDER = 3.0
#: Part of a body's motion about its centre that is a turn, from which on it spins.
_TURNING = 0.5


#: The case that has both water and a solid.
FLOATING = "floating-block"


@dataclass(frozen=True)
class Rule:
    """A case fits a scene where `when` holds, for the reason `why`."""

    case: str
    kind: str
    why: str
    when: Callable[[Facts], bool]


@dataclass(frozen=True)
class Match:
    """A case of the atlas that fits, with the reason."""

    case: str
    kind: str
    why: str


def _still(f: Facts) -> bool:
    return f.at_rest


def _waves(f: Facts) -> bool:
    stirred = f.levels > 1 or bool(f.moving)
    return bool(f.water) and f.balanced and f.water_speed == 0 and stirred


def _released(f: Facts) -> bool:
    if not f.water or _turns(f):
        return False
    return f.water_speed > 0 or (f.gravity > 0 and not f.balanced)


def _turns(f: Facts) -> bool:
    return bool(f.water) and f.water_speed > 0 and f.closed


def _dry(f: Facts) -> bool:
    return bool(f.solids) and not f.water


def _locks(f: Facts) -> bool:
    have = [b.material.parameters() for b in f.solids]
    return any(p.get("poissons_ratio", 0.0) >= LOCKS for p in have)


def _strikes(f: Facts) -> bool:
    flies = any(not isinstance(b.velocity, Field) and f.speed_of(b) > 0 for b in f.solids)
    return _dry(f) and flies


def _spins(f: Facts) -> bool:
    return _dry(f) and any(f.turning(b) >= _TURNING for b in f.solids)


def _shaped(f: Facts, upright: bool | None = None) -> bool:
    found = [f.slender(b) for b in f.solids]
    return any(
        n >= _SLENDER and (upright is None or (axis == f.vertical) == upright) for axis, n in found
    )


def _bends(f: Facts) -> bool:
    return _dry(f) and f.gravity > 0 and f.holds and _shaped(f, upright=False)


def _tips(f: Facts) -> bool:
    return _dry(f) and f.gravity > 0 and f.rubs and _shaped(f, upright=True)


def _slides(f: Facts) -> bool:
    return _dry(f) and f.gravity > 0 and f.rubs and not _tips(f)


def _swings(f: Facts) -> bool:
    others = (_strikes, _spins, _bends, _tips, _slides)
    # Under its own weight only what is held swings; the rest slides, falls or settles.
    free = f.gravity == 0 or f.holds
    return _dry(f) and free and not any(rule(f) for rule in others)


def _loads(f: Facts) -> bool:
    return bool(f.water) and f.gravity > 0 and not f.at_rest and bool(weighed(f.scene))


def _chokes(f: Facts) -> bool:
    return _loads(f) and narrow_gap(f)


def _floats(f: Facts) -> bool:
    return bool(f.water) and any(not f.submerged(b) for b in f.solids)


RULES: tuple[Rule, ...] = (
    Rule(
        "hydrostatic", "water", "water in balance, on a lattice, that nothing moves",
        lambda f: _still(f) and f.ordered,
    ),
    Rule(
        "tank", "water", "water in balance that nothing moves, with particles off a lattice",
        lambda f: _still(f) and not f.ordered,
    ),
    Rule(
        "slope-basin", "water", "water in balance above a surface of any shape",
        lambda f: _still(f) and bool(f.surfaces),
    ),
    Rule("sloshing", "water", "water in balance with several levels or a moving boundary", _waves),
    Rule("dam-break", "water", "water that falls, flows in or moves, and walls", _released),
    Rule("ritter", "water", "water that falls, flows in or moves, on a bed", _released),
    Rule("vortex", "water", "water that moves and fills the domain", _turns),
    Rule(
        "surge-load", "water", "water that flows or is driven, and a load cell",
        lambda f: _loads(f) and not f.solids,
    ),
    Rule(
        "surge-debris-load", "water", "water that carries solids, and a load cell",
        lambda f: _loads(f) and bool(f.solids),
    ),
    Rule("gate", "water", "a gap of few cells beside or under a box with a load cell", _chokes),
    Rule("slot", "water", "a gap of few cells beside or under a box with a load cell", _chokes),
    Rule(
        FLOATING, "water", "elastic bodies at the surface of water, or beside it",
        _floats,
    ),
    Rule("mode-incompressible", "solid", f"a solid with ν ≥ {LOCKS:g}", _locks),
    Rule("bar-impact", "solid", "a solid that flies and may strike", _strikes),
    Rule("spin", "solid", "a solid that turns", _spins),
    Rule("beam", "solid", "a slender solid under its weight, and a boundary that holds", _bends),
    Rule("domino-tip", "solid", "a slender solid upright on a rough boundary", _tips),
    Rule("incline", "solid", "a solid under its weight on a rough boundary", _slides),
    Rule("bar", "solid", "a slender elastic solid", lambda f: _swings(f) and _shaped(f)),
    Rule("mode", "solid", "an elastic solid", _swings),
)  # fmt: skip


def matches(facts: Facts) -> list[Match]:
    """Return the cases that fit."""
    return [Match(r.case, r.kind, r.why) for r in RULES if r.when(facts)]


def unmatched(facts: Facts) -> list[str]:
    """Return what of the scene no case of the atlas has, by name."""
    unknown = [
        f"body '{b.name}' is of {b.material.table.name}, which the atlas has not measured; nothing "
        "is said about it"
        for b in facts.others
    ]
    under = [
        f"body '{b.name}' is under water, and the atlas has measured bodies at the surface alone; "
        "nothing is said about its motion"
        for b in facts.solids
        if facts.water and facts.submerged(b)
    ]
    return unknown + under
