"""What bodies do to each other where they touch: `Friction`, `Fluid`, `Stick`, and their pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from libmpm._src.base.arguments import quoted
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, sequence, shown, value

__all__ = ["Contact", "ContactLaw", "Fluid", "Friction", "Stick"]


class ContactLaw(Value):
    """Base of the laws of contact between two bodies."""

    #: Name of the law in the engine; empty: the bodies move as one.
    kind: ClassVar[str] = ""

    def specification(self) -> dict[str, Any]:
        """Return the numbers of the law as the engine takes them."""
        return {"kind": self.kind, "static_friction": 0.0, "dynamic_friction": 0.0, "fill": 0.0}


@value
class Friction(ContactLaw):
    """Two solids that push each other where they touch, slide with Coulomb friction, and separate.

    {fields}

    With the velocities v of both at a node, w = v_a - v_b, the normal n from a to b, the reduced
    mass m = m_a m_b / (m_a + m_b) and the gap g, the impulse of a step is

        J_n = m (w·n - max(g, 0) / Δt), none where that is negative,
        J_t = m |w_t| while that is ≤ μ_s J_n, else μ_d J_n, against w_t = w - (w·n) n.

    The gap follows from the volume fractions c of both at the node, c = m / (ρ Δx^d), by the
    distance of a flat face that the spline smooths to c: faces that touch fill every node to one.
    Neither restitution nor adhesion; the impulse takes energy alone. Raises `SceneError`. Source:
    `design/contact.md`; Bardenhagen, Brackbill and Sulsky (2000) for fields of velocities.
    """

    label: ClassVar[str] = "contacts.Friction"
    kind: ClassVar[str] = "friction"

    static: float = given(
        "μ_s: nothing slides while the tangential impulse is ≤ μ_s · the normal one",
        default=0.0,
        unit="1",
        low=0,
        remedy="friction opposes sliding; use 0 for smooth faces",
    )
    dynamic: float | None = given(
        "μ_d: tangential impulse over the normal one while sliding, ≤ μ_s; None = μ_s",
        default=None,
        unit="1",
        low=0,
        remedy="friction opposes sliding; use 0 for smooth faces",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        static = check.given("static", self)
        dynamic = static if self.dynamic is None else check.given("dynamic", self)
        if dynamic > static:
            check.fail(
                f"static is {static:g} with dynamic {dynamic:g}; expected static ≥ dynamic, or "
                "sliding would be harder than starting to slide; raise static"
            )
        return {"static": static, "dynamic": dynamic}

    def specification(self) -> dict[str, Any]:
        """Return the numbers of the law as the engine takes them."""
        return super().specification() | {
            "static_friction": self.static, "dynamic_friction": self.dynamic,
        }  # fmt: skip


@value
class Fluid(ContactLaw):
    """A solid in a fluid that slips along it: pushed apart where both fill a node to `fill`.

    {fields}

    Particles of a fluid keep no lattice, so the gap between their volume fractions fluctuates and a
    rule by the gap would let bodies sink. In its place both touch where c_a + c_b ≥ `fill`, and may
    not approach there; the impulse is else that of `Friction`. Skin friction is far below what a
    cell can show, so that 0 is what water does. Raises `SceneError`. Source: `design/contact.md`.
    """

    label: ClassVar[str] = "contacts.Fluid"
    kind: ClassVar[str] = "fluid"

    fill: float = given(
        "c_a + c_b from which on both touch; 0.5 to 0.8 give the same draught",
        default=0.7,
        unit="1",
        above=0,
        high=1,
        remedy="0.7 is what the draught of floating blocks was measured with",
    )
    friction: float = given(
        "tangential impulse over the normal one, static and dynamic",
        default=0.0,
        unit="1",
        low=0,
        remedy="friction opposes sliding; use 0 for water",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        return {name: check.given(name, self) for name in ("fill", "friction")}

    def specification(self) -> dict[str, Any]:
        """Return the numbers of the law as the engine takes them."""
        return super().specification() | {
            "static_friction": self.friction, "dynamic_friction": self.friction, "fill": self.fill,
        }  # fmt: skip


@value
class Stick(ContactLaw):
    """Two bodies that move as one where they share nodes, as all do that no contact names.

    A node that both reach moves with (m_a v_a + m_b v_b) / (m_a + m_b), what one field of
    velocities gives.
    """

    label: ClassVar[str] = "contacts.Stick"


@value
class Contact(Value):
    """A law of contact between bodies, by their names; see `Scene.add_contact` for the fields.

    {fields}
    """

    name: str = given("name among the contacts", range="unique")
    between: Sequence[str] = given(
        "two names of bodies, or patterns in which * stands for any text: each body of the first "
        "with each other one of the second",
        range="names",
    )
    law: ContactLaw = given("`contacts.Friction`, `contacts.Fluid` or `contacts.Stick`")

    def _label(self) -> str:
        return f"contact {quoted(self.name)}"

    def _check(self, check: Checker) -> dict[str, Any]:
        check.instance("law", self.law, (ContactLaw,), "contacts.Friction(static=0.3)")
        names = None if isinstance(self.between, str) else sequence(self.between)
        if names is None or len(names) != 2:
            check.fail(
                f"between is {shown(self.between)}; expected two names or patterns of bodies; give "
                "('debris*', 'structure')"
            )
            names = []
        return {
            "name": check.text("name", self.name),
            "between": tuple(check.text("between", name) for name in names),
        }
