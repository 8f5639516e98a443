"""`Transfer` (APIC, FLIP, ...) and `Kernel`: how numbers go between particles and grid."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, nearest, shown, value

__all__ = ["KERNELS", "SCHEMES", "Kernel", "Transfer", "as_kernel", "as_transfer"]

#: Transfers whose affine part goes back to the grid.
AFFINE = ("APIC", "AFLIP", "ASFLIP")
#: Transfers of which a particle keeps the share `flip` of what the grid cannot see.
BLENDS = ("PIC-FLIP", "AFLIP", "SFLIP", "ASFLIP")
#: Transfers that move particles with a share of that too, by a rule.
SHIFTS = ("SFLIP", "ASFLIP")
#: Transfers that sweep the grid.
SWEEPS = ("XPIC", "FMPM")
SCHEMES = ("PIC", "FLIP", "PIC-FLIP", "APIC", "AFLIP", "NFLIP", "SFLIP", "ASFLIP", "XPIC", "FMPM")
KERNELS = ("linear", "quadratic", "cubic", "ugimp", "cpgimp", "cpdi", "ddmp")


@value
class Transfer(Value):
    """What particles keep of their velocity, and how they move.

    With v̂ the velocity that the grid gives a particle, r what of its own the grid cannot see:
    v ← v̂ + α r, x ← x + Δt (v̂ + β α r).

    {fields}

    Schemes: "PIC" keeps nothing; "FLIP" all of r, "PIC-FLIP" α of it; "APIC" keeps the affine part
    of the grid's velocity; "AFLIP" both; "NFLIP" moves with what it keeps (β = 1); "SFLIP" and
    "ASFLIP" are PIC-FLIP and AFLIP with β by a rule: binary, β_max where J > J_c, else β_min, or
    smooth, β_min + (β_max - β_min) min(((J - J_c)/δ_c)ᵇ, 1). "XPIC" and "FMPM" remove what the grid
    cannot see to order k. All but PIC, APIC and FMPM with `every` = 1 store a velocity.

    The fused step has "APIC", PIC-FLIP, FLIP, AFLIP, NFLIP, SFLIP and ASFLIP with quadratic
    functions; what the others cost and what they gain is in the documentation's table. Raises
    `SceneError`.

    Source: Bonus (2023) 2.4, 5.6 and 5.33-5.34 (the smooth rule corrected); Hammerquist and Nairn
    (2017) for XPIC; Nairn and Hammerquist (2021) for FMPM.
    """

    label: ClassVar[str] = "Transfer"

    scheme: Literal[
        "PIC", "FLIP", "PIC-FLIP", "APIC", "AFLIP", "NFLIP", "SFLIP", "ASFLIP", "XPIC", "FMPM"
    ] = given("the transfer", default="APIC")
    flip: float | None = given(
        "α of PIC-FLIP, AFLIP, SFLIP and ASFLIP; of NFLIP, None = 1",
        default=None,
        unit="1",
        low=0,
        high=1,
    )
    shift_max: float = given("β_max of SFLIP and ASFLIP", default=0.0, unit="1", low=0, high=1)
    shift_min: float = given(
        "β_min of SFLIP and ASFLIP, not above β_max", default=0.0, unit="1", low=0, high=1
    )
    shift_rule: Literal["binary", "smooth"] = given('"binary" or "smooth"', default="binary")
    critical_ratio: float = given(
        "J_c: above this volume ratio a particle counts as free", default=1.0, unit="1", above=0
    )
    width: float = given("δ_c of the smooth rule", default=0.01, unit="1", above=0)
    power: float = given("b of the smooth rule", default=2.0, unit="1", low=1)
    below: Literal["min", "zero"] = given(
        'β below J_c in the smooth rule: "min" (β_min) or "zero"', default="min"
    )
    guard: bool = given(
        "β = 0 (NFLIP, SFLIP, ASFLIP) for a particle one of whose nodes' velocities a "
        "boundary has changed in this step",
        default=True,
        range="bool",
    )
    order: int = given(
        "k of XPIC and FMPM; 2 to 8 are of use", default=2, unit="1", low=1, whole=True
    )
    every: int = given(
        "of so many steps one filters, in XPIC and FMPM; the others are FLIP",
        default=1,
        unit="1",
        low=1,
        whole=True,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        scheme = check.choice("scheme", self.scheme, SCHEMES)
        flip = self.flip
        if flip is not None:
            flip = check.given("flip", self, flip)
            if scheme not in (*BLENDS, "NFLIP"):
                check.fail(
                    f"flip is {flip:g} with scheme '{scheme}', which has none; leave it out, or "
                    f"use one of {', '.join(BLENDS)}"
                )
        elif scheme in BLENDS:
            check.fail(
                f"scheme '{scheme}' without flip; expected the share α of it, 0 to 1; give for "
                "instance flip=0.9"
            )
        most = check.given("shift_max", self)
        least = check.given("shift_min", self)
        if (most or least) and scheme not in SHIFTS:
            check.fail(
                f"shift_max is {most:g} and shift_min {least:g} with scheme '{scheme}'; only "
                f"{' and '.join(SHIFTS)} move with what they keep by a rule; leave them out"
            )
        if least > most:
            check.fail(f"shift_min is {least:g} above shift_max {most:g}; expected at most that")
        order = check.given("order", self)
        every = check.given("every", self)
        if scheme not in SWEEPS and not check.problems and (order, every) != (2, 1):
            check.fail(
                f"order is {order} and every {every} with scheme '{scheme}'; they belong "
                f"to {' and '.join(SWEEPS)}; leave them out"
            )
        if not isinstance(self.guard, bool):
            check.fail(f"guard is {shown(self.guard)}; expected True or False")
        return {
            "scheme": scheme,
            "flip": flip,
            "shift_max": most,
            "shift_min": least,
            "shift_rule": check.choice("shift_rule", self.shift_rule, ("binary", "smooth")),
            "critical_ratio": check.given("critical_ratio", self),
            "width": check.given("width", self),
            "power": check.given("power", self),
            "below": check.choice("below", self.below, ("min", "zero")),
            "order": order,
            "every": every,
        }

    @property
    def affine(self) -> bool:
        """Whether the affine part goes back to the grid."""
        return self.scheme in AFFINE

    @property
    def stores_velocity(self) -> bool:
        """Whether particles store a velocity."""
        if self.scheme == "FMPM":
            return self.every > 1
        return self.scheme not in ("PIC", "APIC")

    @property
    def kept(self) -> float:
        """Share α of what the grid cannot see that a particle keeps."""
        return 1.0 if self.flip is None else self.flip

    def scene_part(self) -> dict[str, Any]:
        """Return the engine's specification for the whole scene."""
        return {"scheme": self.scheme, "order": self.order, "every": self.every}

    def body_part(self) -> dict[str, Any]:
        """Return the engine's specification for a body."""
        return {
            "flip": self.kept,
            "affine": self.affine,
            "shift_max": self.shift_max,
            "shift_min": self.shift_min,
            "rule": self.shift_rule,
            "critical_ratio": self.critical_ratio,
            "width": self.width,
            "power": self.power,
            "below": self.below,
            "guard": self.guard,
        }


@value
class Kernel(Value):
    """The functions between particles and nodes.

    {fields}

    Names: B-splines "linear", "quadratic", "cubic"; "ugimp", the mean of the linear function over a
    particle that keeps its size, "cpgimp", over one that follows its stretch along each axis;
    "cpdi", over a parallelepiped that follows its whole deformation, by its corners; "ddmp", linear
    functions whose gradients come from the grid the more the nearer a particle is to where they
    jump. The last two are for the CPU; "cpdi" stores the edges (d² numbers) of particles whose law
    does not store F, and a particle that grows beyond three cells is a named error.

    Linear functions, "ddmp" and those that end with the domain have second moments that vanish at
    nodes: transfers with an affine part and gradient "mls" are undefined there and refused, as is
    "mls" for "cpdi". Raises `SceneError`.

    Source: Bonus (2023) 2.28; Bardenhagen and Kober (2004) for GIMP; Sadeghirad, Brannon and
    Burghardt (2011) and Yang (2016) 2.40 to 2.43 for CPDI; Zhang, Ma and Giguere (2011) and Yang
    (2016) 2.18 to 2.23 for DDMP; Steffen, Kirby and Berzins (2008) for splines at boundaries; Yang
    (2016) A.4 and A.5 (the clamp corrected) for modified functions, A.8 and A.9 for moved nodes.
    """

    label: ClassVar[str] = "Kernel"

    name: Literal["linear", "quadratic", "cubic", "ugimp", "cpgimp", "cpdi", "ddmp"] = given(
        "the functions", default="quadratic"
    )
    gradient: Literal["mls", "kernel"] | None = given(
        'where velocity gradients and internal forces come from: "mls" (first moments, '
        'MLS-MPM) or "kernel" (gradients of the functions); None = "mls" for quadratic and '
        'cubic, else "kernel"',
        default=None,
    )
    boundary: bool = given(
        "B-splines that end where the domain does (modified boundary splines), for linear, "
        "quadratic and cubic ones",
        default=False,
        range="bool",
    )
    modified: bool = given(
        "linear functions N deposit by others: N between 0.001 and 0.999, their slopes "
        "falling to zero within 0.5 % of a span from its ends; nothing is almost massless, "
        "nothing jumps",
        default=False,
        range="bool",
    )
    moved_nodes: bool = given(
        "velocity gradients by where the nodes go in the step, L (I + Δt L)⁻¹: a rigid turn "
        "does not strain",
        default=False,
        range="bool",
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        name = check.choice("name", self.name, KERNELS)
        gradient: str | None = self.gradient
        if gradient is not None:
            gradient = check.choice("gradient", gradient, ("mls", "kernel"))
        if not isinstance(self.boundary, bool):
            check.fail(f"boundary is {shown(self.boundary)}; expected True or False")
        elif self.boundary and name not in ("linear", "quadratic", "cubic"):
            check.fail(
                f"boundary is True for '{name}'; splines that end with the domain are linear, "
                "quadratic or cubic; leave it out"
            )
        for flag in ("modified", "moved_nodes"):
            if not isinstance(getattr(self, flag), bool):
                check.fail(f"{flag} is {shown(getattr(self, flag))}; expected True or False")
        if self.modified is True and (name != "linear" or self.boundary is True):
            check.fail(
                f"modified is True for {self.text()}; it is defined for linear functions; leave "
                "it out"
            )
        if not check.problems and gradient == "mls" and name == "cpdi":
            check.fail(
                "gradient is 'mls' for kernel 'cpdi', whose gradients are those of its corners; "
                "use 'kernel'"
            )
        elif not check.problems and gradient == "mls" and not self.has_moments:
            check.fail(
                f"gradient is 'mls' for {self.text()}: it divides by the second moment of the "
                "functions, which is zero at their nodes; use 'kernel'"
            )
        return {"name": name}

    @property
    def has_moments(self) -> bool:
        """Whether the second moment is nowhere zero, as affine transfers and "mls" need."""
        return self.name not in ("linear", "ddmp") and not self.boundary

    @property
    def form(self) -> str:
        """Where gradients come from: "mls" or "kernel"."""
        if self.gradient is not None:
            return self.gradient
        return "mls" if self.name in ("quadratic", "cubic") and not self.boundary else "kernel"

    def text(self) -> str:
        """Return its name in words."""
        splines = self.boundary is True  # anything else is refused, by a check that asks for this
        return f"{self.name} boundary splines" if splines else f"kernel '{self.name}'"

    def specification(self) -> dict[str, Any]:
        """Return the engine's specification."""
        told = {"name": self.name, "gradient": self.form, "boundary": self.boundary}
        return told | ({"modified": True} if self.modified else {})


def as_transfer(check: Checker, given: Any) -> Transfer:
    """Return a transfer from one, or from the name of a scheme that needs no numbers."""
    if isinstance(given, Transfer):
        return given
    names = [s for s in SCHEMES if s not in BLENDS]
    named: Any = given
    if not isinstance(given, str):
        check.fail(f"transfer is {shown(given)}; expected Transfer(...) or the name of a scheme")
        return Transfer()
    if given in names:
        return Transfer(scheme=named)
    hint = "give Transfer(scheme=..., flip=...)" if given in BLENDS else nearest(str(given), names)
    check.fail(f"transfer is {shown(given)}; expected Transfer(...) or a scheme; {hint}")
    return Transfer()


def as_kernel(check: Checker, given: Any) -> Kernel:
    """Return a kernel from one, or from its name."""
    if isinstance(given, Kernel):
        return given
    named: Any = given
    if isinstance(given, str) and given in KERNELS:
        return Kernel(name=named)
    check.fail(
        f"kernel is {shown(given)}; expected Kernel(...) or a name; {nearest(given, KERNELS)}"
    )
    return Kernel()
