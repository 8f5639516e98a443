"""Which bodies have a field of velocities of their own, by which laws they meet, and the rules.

A body that a contact names has a field; all that none names share field 0. Two bodies of different
fields without a law move as one (`design/contact.md`).
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence, Set
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.base.formulas import Field
from libmpm._src.base.values import Checker, nearest, shown
from libmpm._src.boundaries.contact_laws import Contact, Fluid, Friction, Stick
from libmpm._src.boundaries.flows import Inflow
from libmpm._src.boundaries.responses import Mirror
from libmpm._src.errors import SceneError
from libmpm._src.materials.material import wave_speed
from libmpm._src.materials.rigid import Rigid
from libmpm._src.sensors.engine_sensors import ContactLoad
from libmpm._src.sensors.python_sensors import BodyTracker, ContactForce, GridSensor

if TYPE_CHECKING:
    from libmpm._src.scene.data import SceneData

__all__ = ["check_contact_load", "check_contacts", "contact_entry", "contact_rows"]
__all__ += ["contact_sides", "device_of_rigid", "doubtful_contacts", "field_of_bodies"]
__all__ += ["has_fields", "rigid_bodies"]

#: Static friction up to which 0.8 of its limit holds, by cfl from 0.2 and above; Mach number of a
#: collision up to which no face enters the other by half a cell, with a margin. Measured by
#: `benchmarks/extremes_contact.py`.
_HOLDS, _MACH = (2.0, 1.5), 1.5


def _named(pattern: str, names: list[str]) -> list[str]:
    # Brackets and question marks are parts of names, as elsewhere in a scene.
    plain = pattern.replace("[", "[[]").replace("?", "[?]")
    return [name for name in names if fnmatch.fnmatchcase(name, plain)]


class Groups:
    """Bodies that nothing in a scene's contacts tells apart: pairs of thousands are never listed.

    sides: of each body, (contact, 0 or 1) for each name of a contact's `between` that fits it.
    members: of each group, its bodies in the order of the scene; fluids are not among solids.
    """

    def __init__(self, scene: SceneData) -> None:
        self.names = [b.name for b in scene.bodies]
        order = {name: i for i, name in enumerate(self.names)}
        self.contacts = len(scene.contacts)
        found: list[list[tuple[int, int]]] = [[] for _ in self.names]
        for i, contact in enumerate(scene.contacts):
            for side, pattern in enumerate(contact.between):
                for name in _named(pattern, self.names):
                    found[order[name]].append((i, side))
        self.sides = [frozenset(of) for of in found]
        members: dict[Any, list[int]] = {}
        for i, body in enumerate(scene.bodies):
            members.setdefault((self.sides[i], body.material.table.stores_volume), []).append(i)
        self.members = list(members.values())
        self.fluid = [fluid for _, fluid in members]

    def meet(self, contact: int, a: int, b: int) -> bool:
        """Whether a contact names two bodies, by their numbers, one on each side."""
        one, other = self.sides[a], self.sides[b]
        return a != b and (
            ((contact, 0) in one and (contact, 1) in other)
            or ((contact, 1) in one and (contact, 0) in other)
        )

    def pairs(self, contact: int) -> list[tuple[int, int, int, int]]:
        """Return, for each two groups that a contact names, the first two bodies and the groups.

        In the order of these bodies, the first two of a contact's pairs first.
        """
        found = []
        for g, of in enumerate(self.members):
            for h, others in enumerate(self.members[g:], g):
                if g == h and len(of) < 2:
                    continue
                a, b = (of[0], of[1]) if g == h else sorted((of[0], others[0]))
                if self.meet(contact, a, b):
                    found.append((a, b, *((g, h) if a == of[0] else (h, g))))
        return sorted(found)

    def count(self, contact: int) -> int:
        """Return of how many pairs a contact is."""
        on = [sum((contact, side) in of for of in self.sides) for side in (0, 1)]
        both = sum({(contact, 0), (contact, 1)} <= of for of in self.sides)
        return on[0] * on[1] - both - both * (both - 1) // 2

    def named(self) -> set[str]:
        """Return the bodies of all pairs."""
        found: set[int] = set()
        for i in range(self.contacts):
            for _, _, g, h in self.pairs(i):
                found.update(self.members[g], self.members[h])
        return {self.names[i] for i in found}


def rigid_bodies(scene: SceneData) -> list[str]:
    """Return the names of the bodies that move as a whole."""
    return [b.name for b in scene.bodies if isinstance(b.material, Rigid)]


def has_fields(scene: SceneData) -> bool:
    """Whether bodies have fields of velocities of their own: by contacts, or some are rigid."""
    return bool(scene.contacts) or bool(rigid_bodies(scene))


def field_of_bodies(scene: SceneData) -> list[int]:
    """Return the field of each body: 0 of all that no contact names, else one of its own.

    Those of rigid bodies, which always have one, are the last.
    """
    return _fields(scene, Groups(scene))


def _fields(scene: SceneData, groups: Groups) -> list[int]:
    rigid = set(rigid_bodies(scene))
    named = groups.named() - rigid
    bending = len(scene.bodies) - len(rigid)
    # A field that nobody is in would cost nothing, but the first one named may as well have it.
    next_one = 1 if len(named) < bending or not bending else 0
    field = {}
    for body in scene.bodies:
        own = body.name in named
        field[body.name] = next_one if own else 0
        next_one += own
    for i, name in enumerate(b.name for b in scene.bodies if b.name in rigid):
        field[name] = next_one + i
    return [field[b.name] for b in scene.bodies]


def _kinds(
    scene: SceneData,
) -> tuple[list[int], list[int], list[list[int]], Groups]:
    """Return the field of each body, the kind of each field, the bodies of each kind, and groups.

    Bodies are of one kind where neither the list of contacts nor their densities tell them apart.
    """
    groups = Groups(scene)
    fields = _fields(scene, groups)
    shared = fields.count(0) > 1
    kinds: dict[tuple[Any, ...], int] = {}
    kind = [0] * (max(fields) + 1)
    members: list[list[int]] = []
    for i, body in enumerate(scene.bodies):
        density = body.material.core_parameters(scene.dimension)["density"]
        key = ("field 0",) if fields[i] == 0 and shared else (
            density, isinstance(body.material, Rigid), groups.sides[i])  # fmt: skip
        of = kinds.setdefault(key, len(kinds))
        if of == len(members):
            members.append([])
        members[of].append(i)
        kind[fields[i]] = of
    return fields, kind, members, groups


def contact_entry(scene: SceneData) -> dict[str, Any]:
    """Return the fields, their kinds and laws as the engine takes them; empty without contacts.

    Fields of one kind meet all others by the same laws.
    """
    if not has_fields(scene):
        return {}
    fields, kind, members, groups = _kinds(scene)
    laws = [c.law for c in scene.contacts if not isinstance(c.law, Stick)]
    number = {law: i for i, law in reversed(list(enumerate(laws)))}

    def law_of(a: int, b: int) -> int:
        for i, contact in enumerate(scene.contacts):
            if groups.meet(i, a, b):
                return number.get(contact.law, -1)
        return -1

    def of_kinds(a: int, b: int) -> int:
        for i in members[a]:
            for j in members[b]:
                if i != j:
                    return law_of(i, j)
        return -1  # the only member of its kind never meets itself

    densities = [
        scene.bodies[m[0]].material.core_parameters(scene.dimension)["density"] for m in members
    ]
    return {
        "contact": {
            "fields": len(kind),
            "of_body": fields,
            "kind": kind,
            "density": densities,
            "laws": [law.specification() for law in laws],
            "law_of": [of_kinds(a, b) for a in range(len(members)) for b in range(len(members))],
        }
        | ({"rigid": len(rigid)} if (rigid := rigid_bodies(scene)) else {})
    }


def contact_sides(scene: SceneData, sensor: ContactLoad) -> dict[str, Any]:
    """Return which pairs of fields a sensor of a contact counts, as the engine takes it.

    sides: of two kinds, the first that of the lower field: 1 where the force on the other counts,
    -1 where that on this one does, 0 where none does. fields: the only two, lower first, or none.
    """
    names = [b.name for b in scene.bodies]
    number = [c.name for c in scene.contacts].index(sensor.contact)
    fields, kind, members, groups = _kinds(scene)
    count = len(members)
    table = [0] * (count * count)
    if sensor.pair is not None:
        first, second = (fields[names.index(name)] for name in sensor.pair)
        low, high = sorted((first, second))
        table[kind[low] * count + kind[high]] = 1 if low == first else -1
        return {"sides": table, "fields": [low, high]}
    of: list[Set[tuple[int, int]]] = [groups.sides[m[0]] if m else set() for m in members]
    for a in range(count):
        for b in range(count):
            if {(number, 0)} <= of[a] and {(number, 1)} <= of[b]:
                table[a * count + b] = 1
            elif {(number, 1)} <= of[a] and {(number, 0)} <= of[b]:
                table[a * count + b] = -1
    return {"sides": table, "fields": []}


def contact_rows(scene: SceneData) -> list[tuple[str, str, str, str]]:
    """Return (contact, between, law, pairs) of each contact, for tables."""
    groups = Groups(scene)
    return [
        (c.name, " and ".join(c.between), repr(c.law), str(groups.count(i)))
        for i, c in enumerate(scene.contacts)
    ]


def device_of_rigid(scene: SceneData, device: str | Sequence[str]) -> str | Sequence[str]:
    """Return the device of a scene on square cells: with rigid bodies the CPU."""
    if rigid := rigid_bodies(scene):
        if isinstance(device, str) and device in ("auto", "cpu"):
            return "cpu"
        raise SceneError(
            f"device is {shown(device)} with rigid body '{rigid[0]}', which is built for the CPU "
            "and one rank; expected 'cpu' or 'auto'; use one of these, or an elastic material"
        )
    return device


# Rules --------------------------------------------------------------------------------------------


def check_contacts(scene: SceneData, problems: list[str]) -> None:
    """Refuse contacts that name nothing, contradict each other, or meet what they cannot."""
    before = len(problems)
    groups = Groups(scene)
    by: dict[tuple[int, int], Contact] = {}
    for i, contact in enumerate(scene.contacts):
        check = Checker(f"contact '{contact.name}'")
        for pattern in contact.between:
            if not _named(pattern, groups.names):
                check.fail(
                    f"between has '{pattern}', which is no body; {nearest(pattern, groups.names)}"
                )
        pairs = groups.pairs(i)
        if not check.problems and not pairs:
            check.fail(
                f"between is {contact.between}, a body with itself; expected two bodies; a body "
                "has one field of velocities; make it several bodies"
            )
        for a, b, *_ in pairs:
            other = by.setdefault((a, b), contact)
            if other is not contact:
                one, two = groups.names[a], groups.names[b]
                check.fail(
                    f"between has '{one}' and '{two}', a pair of contact '{other.name}' "
                    "too; expected one law for a pair; narrow one of the patterns"
                )
                break
        _check_law(check, contact, groups, pairs)
        problems += check.problems
    if has_fields(scene) and len(problems) == before:
        _check_scene(scene, groups, problems)


def doubtful_contacts(scene: SceneData) -> list[str]:
    """Return what of the contacts can run, but lies beyond where it has been found to be right."""
    groups = Groups(scene)
    doubts = []
    holds = _HOLDS[scene.method.cfl > 0.2 or scene.method.time_step is not None]
    bend = [
        sum(not isinstance(scene.bodies[k].material, Rigid) for k in of) for of in groups.members
    ]
    for i, contact in enumerate(scene.contacts):
        if not isinstance(contact.law, Friction):
            continue
        pairs = groups.pairs(i)
        both = any(bend[g] > (g == h) and bend[h] for *_, g, h in pairs)
        if contact.law.static > holds and both:
            doubts.append(
                f"contact '{contact.name}': static is {contact.law.static:g}; expected ≤ "
                f"{holds:g} between bodies that bend and cfl {scene.method.cfl:g}: a slab on a "
                "body as stiff as itself, which should hold at 0.8 of its limit, slips where "
                "static is 2 and cfl 0.4, then slides with 1.4; lower it, or cfl to 0.2, with "
                "which 2 holds"
            )
        mach, speed, one, two = max(
            (_fastest(scene, groups, *of) for of in pairs), key=lambda found: found[0]
        )
        if mach > _MACH:
            doubts.append(
                f"contact '{contact.name}': '{one}' and '{two}' begin with velocities that differ "
                f"by {speed:.4g} m/s, Mach {mach:.3g} of the slower one's waves; expected ≤ "
                f"{_MACH:g}: blocks that approach faster than 1.9 enter each other by half a cell; "
                "slow them down, or raise their youngs_modulus"
            )
    return doubts


def _fastest(
    scene: SceneData, groups: Groups, first: int, second: int, g: int, h: int
) -> tuple[float, float, str, str]:
    """Return (Mach, m/s, body, body) of the two of two groups that differ most as they begin.

    Mach is by the slower waves of the two; a rigid body has none, and fields are not looked at.
    """

    def rows(of: list[int]) -> dict[tuple[float, ...], int]:
        found: dict[tuple[float, ...], int] = {}
        for i in of:
            body = scene.bodies[i]
            if not isinstance(body.velocity, Field):
                rigid = isinstance(body.material, Rigid)
                wave = np.inf if rigid else wave_speed(body.material) or np.inf
                found.setdefault((wave, *map(float, body.velocity)), i)
        return found

    here, there = rows(groups.members[g]), rows(groups.members[h])
    best = (0.0, 0.0, scene.bodies[first].name, scene.bodies[second].name)
    if not there:
        return best
    other = np.array(list(there))
    for row, i in here.items():
        speed = np.linalg.norm(other[:, 1:] - np.array(row[1:]), axis=1)
        mach = speed / np.minimum(other[:, 0], row[0])
        k = int(np.argmax(mach))
        if mach[k] > best[0]:
            name = scene.bodies[list(there.values())[k]].name
            best = float(mach[k]), float(speed[k]), scene.bodies[i].name, name
    return best


def check_contact_load(check: Checker, scene: SceneData, sensor: ContactLoad) -> None:
    """Refuse a sensor of a contact that is not there, or of bodies that are no pair of it."""
    contact = next((c for c in scene.contacts if c.name == sensor.contact), None)
    if contact is None:
        known = [c.name for c in scene.contacts]
        rule = nearest(sensor.contact, known) if known else "the scene has none; use add_contact"
        check.fail(f"contact '{sensor.contact}' is unknown; {rule}")
        return
    if isinstance(contact.law, Stick):
        check.fail(
            f"contact '{contact.name}' is of Stick(), whose bodies move as one and exchange no "
            "impulse; expected Friction or Fluid; use BodyTracker, whose force is what acts on the "
            "whole body"
        )
    if sensor.pair is None:
        return
    names = [b.name for b in scene.bodies]
    unknown = [name for name in sensor.pair if name not in names]
    if unknown:
        check.fail(f"pair has '{unknown[0]}', which is no body; {nearest(unknown[0], names)}")
        return
    if not Groups(scene).meet(scene.contacts.index(contact), *map(names.index, sensor.pair)):
        check.fail(
            f"pair is {tuple(sensor.pair)}, which contact '{contact.name}' between "
            f"{contact.between} does not name; expected two of its bodies; correct the pair or the "
            "contact"
        )


def _check_law(
    check: Checker, contact: Contact, groups: Groups, pairs: list[tuple[int, int, int, int]]
) -> None:
    for a, b, g, h in pairs:
        one, two = groups.names[a], groups.names[b]
        fluids = [name for name, of in ((one, g), (two, h)) if groups.fluid[of]]
        if isinstance(contact.law, Friction) and fluids:
            check.fail(
                f"law is {contact.law!r} between '{one}' and '{two}', of which '{fluids[0]}' is a "
                "fluid; expected two solids; name the solids alone and use contacts.Fluid() for "
                "the fluid"
            )
            return
        if isinstance(contact.law, Fluid) and len(fluids) != 1:
            what = "neither" if not fluids else "each"
            check.fail(
                f"law is {contact.law!r} between '{one}' and '{two}', of which {what} is a fluid; "
                "expected a solid and a fluid; use contacts.Friction for solids, and leave fluids "
                "to share their velocities"
            )
            return


def _check_scene(scene: SceneData, groups: Groups, problems: list[str]) -> None:
    """Refuse what contact is not built for."""
    rigid = rigid_bodies(scene)
    what = f"body '{rigid[0]}'" if rigid else f"contact '{scene.contacts[0].name}'"
    first = Checker(what)
    kernel, transfer = scene.method.kernel_choice, scene.transfer
    if scene.grid is not None:
        first.fail(
            "a grid of functions has one field of velocities; expected square or cubic cells; "
            "leave grid out, or remove the contacts"
        )
    elif kernel.name != "quadratic" or kernel.boundary:
        first.fail(
            f"{kernel.text()} with contacts, whose gaps are measured by plain quadratic splines; "
            "expected these; use kernel='quadratic', or remove the contacts"
        )
    if transfer.scheme in ("XPIC", "FMPM"):
        first.fail(
            f"transfer '{transfer.scheme}' with contacts, which sweep over the grid after contact; "
            "expected another transfer; use APIC, or remove the contacts"
        )
    problems += first.problems
    named = groups.named() | set(rigid)
    for boundary in scene.boundaries:
        check = Checker(f"boundary '{boundary.name}'")
        for response in boundary.responses:
            if isinstance(response, Mirror):
                remedy = "use Slip(), or remove the contacts"
                check.fail(
                    f"response is {response!r} with contacts, where it is not built for several "
                    f"fields of velocities; expected a wall that holds nodes; {remedy}"
                )
                break
        problems += check.problems
    for body in scene.bodies:
        check = Checker(f"body '{body.name}'")
        if body.smoothing is not None or body.assumed is not None:
            check.fail(
                "smoothing or assumed fields with contacts, which are not built together; expected "
                "neither; leave them out, or remove the contacts"
            )
        if getattr(body.fbar, "form", None) == "split":
            check.fail(
                "fbar is of the split form with contacts, which are not built together; expected "
                "another form; use FBar(), or remove the contacts"
            )
        problems += check.problems
    for placed in scene.flows:
        if isinstance(placed.flow, Inflow) and placed.flow.body in named:
            problems.append(
                f"flow '{placed.name}': body is '{placed.flow.body}', which a contact names; "
                "expected a body without contact; particles that come in join no field of their "
                "own; feed another body, or remove the contact"
            )
    for sensor in scene.sensors:
        asked = sensor.sensor
        of_boundaries = (
            isinstance(asked, BodyTracker) and "boundary_force" in asked.quantities
        ) or (isinstance(asked, GridSensor) and asked.attribute == "force")
        if of_boundaries:
            problems.append(
                f"sensor '{sensor.name}': forces of boundaries on nodes are asked for with "
                "contacts, which are not built together; expected one field of velocities; use a "
                "LoadCell, or BodyTracker without boundary_force"
            )
        if isinstance(asked, ContactForce) and {asked.by, asked.body} & named:
            problems.append(
                f"sensor '{sensor.name}': ContactForce between '{asked.body}' and '{asked.by}', "
                "which a contact gives velocities of their own; expected bodies that share their "
                "velocities; use BodyTracker, whose force is what acts on the whole body"
            )
