"""The rows of the trade-off table: every numerical choice, one at a time, beside one baseline.

An option differs from the one that it stands `beside` in a single choice. Smoothing lengths are
counted in cells, so that an option means the same in every case.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from libmpm import FBar, Kernel, Method, Transfer
from libmpm.boundaries import DecayLayer, Mirror, Response
from libmpm.cases import Options

BASELINE = "baseline"
#: Forms of F-bar whose smoothing is set by a length.
BY_LENGTH = ("two-volume", "split", "literal")
LENGTH = 1.0  # cells, of those forms
Group = Literal[
    "baseline", "transfer", "kernel", "F-bar", "solid", "boundary", "precision", "pipeline"
]


@dataclass(frozen=True)
class Option:
    """A row: all choices of a run. `fbar` and `solid_fbar` are names of forms; None is no F-bar.

    `material` names the elastic law of the cases that let it vary; `step` is the time step's part
    of the case's own.
    """

    name: str
    group: Group
    transfer: Transfer = field(default_factory=Transfer)
    kernel: Kernel = field(default_factory=Kernel)
    fbar: str | None = None
    solid_fbar: str | None = None
    material: str = "FixedCorotated"
    precision: str = "single"
    pipeline: str = "auto"
    step: float = 1.0
    walls: Response | None = None
    layer: DecayLayer | None = None
    beside: str = BASELINE

    def applies(self, kind: str, varies: bool, of_case: str = "") -> bool:
        """Return whether it changes anything in cases of "water" or "solid".

        `varies`: the law does; `of_case`: the boundary that does, "walls" or "layer", of which
        "layer" is all that its cases are for.
        """
        if self.walls is not None or self.layer is not None:
            return of_case == ("walls" if self.layer is None else "layer")
        if of_case == "layer":
            return self.group == "baseline"
        if self.fbar is not None:
            return kind == "water"
        if self.material != "FixedCorotated":
            return varies
        return self.solid_fbar is None or kind == "solid"

    def choices(self, cfl: float, cell_size: float) -> Options:
        """Return what a case is built with."""
        return Options(
            method=Method(cfl=cfl * self.step, transfer=self.transfer, kernel=self.kernel),
            fbar=smoothing(self.fbar, cell_size),
            solid_fbar=smoothing(self.solid_fbar, cell_size),
            walls=self.walls,
            layer=self.layer,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return all choices as plain values."""
        changed = {
            k: v
            for k, v in vars(self.transfer).items()
            if k != "scheme" and v != getattr(Transfer(), k)
        }
        return {
            "name": self.name,
            "group": self.group,
            "beside": self.beside,
            "transfer": {"scheme": self.transfer.scheme, **changed},
            "kernel": {
                "name": self.kernel.name,
                "gradient": self.kernel.form,
                "boundary": self.kernel.boundary,
            },
            "fbar": self.fbar,
            "solid_fbar": self.solid_fbar,
            "length_cells": LENGTH if (self.fbar or self.solid_fbar) in BY_LENGTH else None,
            "material": self.material,
            "precision": self.precision,
            "pipeline": self.pipeline,
            "step": self.step,
            **({} if self.walls is None else {"walls": self.walls.kind}),
            **({} if self.layer is None else {"layer": self.layer.to_dict()}),
        }


def smoothing(form: str | None, cell_size: float) -> FBar | None:
    """Return a form with its default time, or with a length of `LENGTH` cells."""
    if form is None:
        return None
    return FBar(form=form, length=LENGTH * cell_size) if form in BY_LENGTH else FBar(form=form)  # type: ignore[arg-type]


def _transfers() -> list[Option]:
    """Return the transfers with quadratic functions."""

    def shifted(scheme: str, **more: Any) -> Transfer:
        return Transfer(scheme=scheme, flip=0.95, shift_max=1.0, **more)  # type: ignore[arg-type]

    rows = {
        "PIC": Transfer(scheme="PIC"),
        "FLIP": Transfer(scheme="FLIP"),
        "PIC-FLIP 0.95": Transfer(scheme="PIC-FLIP", flip=0.95),
        "AFLIP 0.95": Transfer(scheme="AFLIP", flip=0.95),
        "AFLIP 0.5": Transfer(scheme="AFLIP", flip=0.5),
        "NFLIP": Transfer(scheme="NFLIP"),
        "SFLIP 0.95": shifted("SFLIP"),
        "SFLIP 0.95 smooth": shifted("SFLIP", shift_rule="smooth"),
        "ASFLIP 0.95": shifted("ASFLIP"),
        "ASFLIP 0.95 smooth": shifted("ASFLIP", shift_rule="smooth"),
        "ASFLIP 0.95 smooth, zero below": shifted("ASFLIP", shift_rule="smooth", below="zero"),
        "ASFLIP 0.95 without guard": shifted("ASFLIP", guard=False),
        "XPIC 2": Transfer(scheme="XPIC", order=2),
        "XPIC 5": Transfer(scheme="XPIC", order=5),
        "XPIC 5 every 5": Transfer(scheme="XPIC", order=5, every=5),
        "FMPM 2": Transfer(scheme="FMPM", order=2),
        "FMPM 4": Transfer(scheme="FMPM", order=4),
        "FMPM 4 every 4": Transfer(scheme="FMPM", order=4, every=4),
    }
    made = [Option(name, "transfer", transfer=transfer) for name, transfer in rows.items()]
    sharp = "FMPM 4"
    made.append(Option(f"{sharp}, half the step", "transfer", rows[sharp], step=0.5, beside=sharp))
    return made


def _kernels() -> list[Option]:
    """Return the kernels: with APIC, or with PIC-FLIP where APIC is undefined."""
    blend, beside = Transfer(scheme="PIC-FLIP", flip=0.95), "PIC-FLIP 0.95"
    with_apic = {
        "quadratic, kernel gradient": Kernel(gradient="kernel"),
        "cubic": Kernel(name="cubic"),
        "cubic, kernel gradient": Kernel(name="cubic", gradient="kernel"),
        "uGIMP": Kernel(name="ugimp"),
        "uGIMP, MLS gradient": Kernel(name="ugimp", gradient="mls"),
        "cpGIMP": Kernel(name="cpgimp"),
        "cpGIMP, MLS gradient": Kernel(name="cpgimp", gradient="mls"),
    }
    with_blend = {
        "linear, PIC-FLIP 0.95": Kernel(name="linear"),
        "linear boundary, PIC-FLIP 0.95": Kernel(name="linear", boundary=True),
        "quadratic boundary, PIC-FLIP 0.95": Kernel(name="quadratic", boundary=True),
        "cubic boundary, PIC-FLIP 0.95": Kernel(name="cubic", boundary=True),
    }
    return [
        *(Option(name, "kernel", kernel=kernel) for name, kernel in with_apic.items()),
        *(
            Option(name, "kernel", transfer=blend, kernel=kernel, beside=beside)
            for name, kernel in with_blend.items()
        ),
    ]


FORMS = ("one-volume-gradient", "one-volume", "two-volume", "stress-only", "split", "literal")
LAYERS = (
    ("constrained", 1.5), ("flipped", 1.0), ("cosine", 2.0), ("linear", 1.5), ("quadratic", 2.0),
    ("free", 1.0),
)  # fmt: skip
LAWS = ("NeoHookean", "StVenantKirchhoffHencky", "LinearElastic", "Hypoelastic", "VonMises")

OPTIONS: tuple[Option, ...] = (
    Option(BASELINE, "baseline"),
    *_transfers(),
    *_kernels(),
    *(Option(f"F-bar {form}", "F-bar", fbar=form) for form in FORMS),
    *(Option(f"solid F-bar {form}", "solid", solid_fbar=form) for form in FORMS),
    *(Option(law, "solid", material=law) for law in LAWS),
    Option("mirrored walls", "boundary", walls=Mirror()),
    *(
        Option(
            f"layer {name} {cells:g}", "boundary", layer=DecayLayer(function=name, thickness=cells)
        )
        for name, cells in LAYERS
    ),
    Option("double precision", "precision", precision="double"),
    Option("mixed precision", "precision", precision="mixed"),
    Option("two-pass", "pipeline", pipeline="two-pass"),
    Option("phased", "pipeline", pipeline="phased"),
)
