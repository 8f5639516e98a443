"""Contact at its extremes: both ends of each envelope hold, what lies outside is named.

The whole sweep is `benchmarks/extremes.py`.
"""

from __future__ import annotations

import pytest

import libmpm
from libmpm import contacts, materials, shapes
from support import contact_scenes as cases
from support.extremes import FOLDER, ends, expect_holds, expect_outcome

AXES = ()

pytestmark = pytest.mark.skipif(not FOLDER.exists(), reason="needs the source tree")
if FOLDER.exists():
    import extremes
    import extremes_contact
    from extremes_axis import FORBIDDEN

    AXES = extremes_contact.AXES


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize(("one", "value"), ends(AXES, single=True))
def test_envelope_holds(one, value):
    expect_holds(one, value)


#: Axis, value outside its envelope, outcome, and what the program says.
OUTSIDE = [
    ("contact, speed", 2.5, "warned", "Mach 2.5 of the slower one's waves.*Then .*overlap"),
    ("contact, speed", 10.0, "named", "body 'first'.*no longer invertible.*Remedy"),
    ("contact, squeezed", 0.8, "named", "body 'soft'.*inside body.*Remedy"),
    ("contact, squeezed", 0.95, "named", "body 'soft'.*no longer invertible.*Remedy"),
    ("contact, sticking", 3.0, "warned", "contact 'sole': static is 3; expected ≤ 1.5.*Then speed"),
]


@pytest.mark.filterwarnings("ignore::libmpm.ModelWarning")
@pytest.mark.parametrize(("name", "value", "outcome", "says"), OUTSIDE)
def test_outside_is_named(name, value, outcome, says):
    expect_outcome(AXES, name, value, outcome, says)


def test_map_keeps_its_promises():
    """Envelopes are those of the lines, and nothing breaks within them."""
    lines = [x for x in extremes.newest(extremes.RESULTS) if x["group"] == "contact"]
    promised = {a.name: list(a.envelope) for a in AXES}
    assert {x["axis"] for x in lines} == set(promised)
    for line in lines:
        low, high = promised[line["axis"]]
        assert line["envelope"] == [low, high]
        inside = [p for p in line["probes"] if low <= p[0] <= high]
        assert {outcome for _, outcome, *_ in inside} == {"holds"}
        assert not [p for p in line["probes"] if p[1] in FORBIDDEN]


def doubts(recwarn, scene):
    """What a scene is doubted for because of its contacts."""
    recwarn.clear()
    scene.validate()
    return [str(w.message) for w in recwarn if "contact '" in str(w.message)]


def test_friction_that_does_not_hold_is_doubted(recwarn):
    """Between bodies that bend: no slab was found to slip where one of the two is rigid."""
    assert doubts(recwarn, cases.slope(2, 1.5)) == []
    (said,) = doubts(recwarn, cases.slope(2, 1.6))
    assert said.startswith("contact 'sole': static is 1.6; expected ≤ 1.5 between bodies that bend")
    assert doubts(recwarn, extremes_contact._slab(2.0, 0.8, 0.25, cfl=0.2)[0]) == []
    (said,) = doubts(recwarn, extremes_contact._slab(2.1, 0.8, 0.25, cfl=0.2)[0])
    assert "static is 2.1; expected ≤ 2 between bodies that bend and cfl 0.2" in said
    mixed = cases.slope(2, 0.5)
    mixed._contacts.clear()
    box = shapes.Box(lower=(0.5, 0.6), upper=(0.8, 0.9))
    mixed.add_body(name="rock", shape=box, material=materials.Rigid(density=1000.0))
    law = contacts.Friction(static=2.0)
    mixed.add_contact(name="rocks", between=("rock", "*"), law=law)
    assert doubts(recwarn, mixed) == []
    mixed.add_contact(name="slab", between=("slab", "block"), law=law)
    assert len(doubts(recwarn, mixed)) == 1


@pytest.mark.parametrize("many", [False, True])
def test_fast_collisions_are_doubted(recwarn, many):
    """By the two bodies that differ most, and the slower wave: that of the soft one."""

    def scene(mach):
        found = libmpm.Scene(dimension=2, cell_size=0.1, lower=(0.0, 0.0), upper=(9.0, 9.0))
        c = cases.sound_speed(1e4, 0.3)
        for k in range(3 if many else 2):
            found.add_body(
                name=f"block {k}", material=cases.solid(1e6 if k == 0 else 1e4),
                shape=shapes.Box(lower=(1.0 + k, 1.0), upper=(1.5 + k, 1.5)),
                velocity=(0.0, (0.0, mach / 2, -mach)[k if many else 2 * k] * c),
            )  # fmt: skip
        found.add_contact(name="all", between=("block*", "*"), law=contacts.Friction())
        return found

    part = 1 / 1.5 if many else 1.0
    assert doubts(recwarn, scene(1.49 * part)) == []
    (said,) = doubts(recwarn, scene(1.6 * part))
    assert f"'block {1 if many else 0}' and 'block {2 if many else 1}' begin with" in said
    assert "Mach 1.6 of the slower one's waves; expected ≤ 1.5" in said
    with pytest.raises(libmpm.SceneError, match="begin with velocities that differ"):
        scene(1.6 * part).validate(strict=True)
