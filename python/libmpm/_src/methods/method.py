"""`Method` and `FBar`: time step, out-of-domain policy, volume smoothing."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from libmpm._src.base.arguments import shown
from libmpm._src.base.declarations import given
from libmpm._src.base.values import Checker, Value, value
from libmpm._src.methods.transfer import Kernel, Transfer, as_kernel, as_transfer

__all__ = ["CROSSINGS", "PACKING", "FBar", "Method"]

#: Default of `FBar.time`, in cell crossings of the sound wave.
CROSSINGS = 35.0
#: Options of `FBar` that keep stirred fluids from packing.
PACKING = ("density", "shifting")


@value
class Method(Value):
    """Choices that apply to the whole scene.

    {fields}

    `leaving`: "stop" ends the run with an error, "freeze" keeps the particle at rest where it left,
    outside the computation, "delete" removes it. Every such particle is listed by id.
    Raises `SceneError`.
    """

    label: ClassVar[str] = "Method"

    cfl: float = given(
        "part of a cell that the fastest wave may cross in one step",
        default=0.4,
        unit="1",
        above=0,
        high=1,
    )
    time_step: float | None = given(
        "fixed step; None = the stable one. Above it: refused", default=None, unit="s", above=0
    )
    leaving: Literal["stop", "freeze", "delete"] = given(
        "what happens to a particle that leaves the domain", default="stop"
    )
    transfer: Transfer | str | None = given(
        "how velocities go between particles and grid; or a scheme's name. None = AFLIP with flip "
        "0.99 where a fluid flows past a structure, 0.95 where grains flow, APIC elsewhere "
        "(`Scene.transfer`)",
        default=None,
        range="`Transfer`",
    )
    kernel: Kernel | str = given(
        "the functions between them; or their name", default=Kernel(), range="`Kernel`"
    )

    @property
    def transfer_choice(self) -> Transfer:
        """The transfer as a value; APIC where none is named: what acts is `Scene.transfer`."""
        return self.transfer if isinstance(self.transfer, Transfer) else Transfer()

    @property
    def kernel_choice(self) -> Kernel:
        """The kernel as a value."""
        assert isinstance(self.kernel, Kernel)
        return self.kernel

    def _check(self, check: Checker) -> dict[str, Any]:
        step = self.time_step
        if step is not None:
            remedy = "use None for the stable step"
            step = check.given("time_step", self, step, remedy=remedy)
        transfer = None if self.transfer is None else as_transfer(check, self.transfer)
        kernel = as_kernel(check, self.kernel)
        acting = Transfer() if transfer is None else transfer  # both of None are affine
        if acting.affine and not kernel.has_moments:
            check.fail(
                f"transfer '{acting.scheme}' with {kernel.text()}: its affine part divides by "
                "the second moment of the functions, which is zero at their nodes; use PIC, FLIP, "
                "PIC-FLIP, NFLIP, SFLIP, XPIC or FMPM, or another kernel"
            )
        remedy = "an explicit step is unstable above 1; 0.4 is a safe start"
        return {
            "cfl": check.given("cfl", self, remedy=remedy),
            "time_step": step,
            "leaving": check.choice("leaving", self.leaving, ("stop", "freeze", "delete")),
            "transfer": transfer,
            "kernel": kernel,
        }


@value
class FBar(Value):
    """Smoothing of the volume ratio over neighbours (F-bar), against pressure checkerboards.

    Each step the stored ratio moves by the part ψ towards the grid's average of it.

    {fields}

    Forms: "one-volume-gradient" stores one ratio and carries its gradient to the grid;
    "one-volume" does not carry it; "two-volume" stores the smoothed ratio beside the true one and
    takes `length` or `ratio`; "stress-only" smooths for the stress and stores the true one;
    "split" is "two-volume" with a transfer of its own for the average; "literal" is a step late and
    meant only to reproduce published runs. At most one of `time`, `ratio`, `length` may be given.
    In solids the volumetric part of the deformation is scaled, F̄ = (J̄/J)^(1/d) F; there it is off
    unless given. Raises `SceneError`.

    Source: Bonus (2023) 5.7 to 5.10: eq. 5.54 and 5.59 "split", 5.66 "literal".
    """

    label: ClassVar[str] = "FBar"

    form: Literal[
        "one-volume-gradient", "one-volume", "two-volume", "stress-only", "split", "literal"
    ] = given("the recursion", default="one-volume-gradient")
    time: float | None = given(
        "relaxation time τ, ψ = 1 - exp(-Δt/τ); None = 35 Δx/c₀", default=None, unit="s", above=0
    )
    ratio: float | None = given(
        "ψ itself, per step. The result then depends on the time step; meant only to "
        "reproduce published runs",
        default=None,
        unit="1",
        above=0,
        high=1,
    )
    length: float | None = given(
        'smoothing length ℓ of the forms with two volumes ("two-volume", "split", '
        '"literal"), ψ = 4ℓ²/(Δx² + 4ℓ²)',
        default=None,
        unit="m",
        above=0,
    )
    shifting: bool = given(
        "move a fluid's particles away from nodes that hold more of it than its volumes say, every "
        "ten steps",
        default=False,
    )
    density: bool = given(
        "lead a fluid's volumes to the density that its particles have on the grid, every ten "
        "steps, so that stirred water does not pack",
        default=False,
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        two = ("two-volume", "split", "literal")
        forms = ("one-volume-gradient", "one-volume", "two-volume", "stress-only", *two[1:])
        form = check.choice("form", self.form, forms)
        found: dict[str, Any] = {"form": form}
        limits = (("time", "s", math.inf), ("ratio", "1", 1.0), ("length", "m", math.inf))
        for name, unit, upper in limits:
            item = getattr(self, name)
            if item is not None:
                item = check.number(name, item, lower=0, upper=upper, lower_open=True, unit=unit)
            found[name] = item
        given = [n for n in ("time", "ratio", "length") if found[n] is not None]
        if len(given) > 1:
            check.fail(f"{' and '.join(given)} are given; expected at most one; remove the others")
        if form in two:
            if found["time"] is not None or not given:
                have = "time" if given else "neither length nor ratio"
                check.fail(
                    f"form '{form}' with {have}; its smoothing is set by a length: "
                    "give length in m, for instance a few cells"
                )
        elif found["length"] is not None:
            check.fail(
                f"length is {found['length']:g} with form '{form}'; a length belongs to "
                f"{', '.join(two)}; give time in s instead, or leave it out"
            )
        for option in PACKING:
            if not isinstance(getattr(self, option), bool):
                check.fail(f"{option} is {shown(getattr(self, option))}; expected True or False")
            found[option] = getattr(self, option)
        return found
