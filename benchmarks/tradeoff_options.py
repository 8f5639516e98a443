"""The rows of the trade-off table: every numerical choice, one at a time, beside one baseline.

An option differs from the one that it stands `beside` in a single choice. Smoothing lengths are
counted in cells, so that an option means the same in every case.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from libmpm import FBar, Method
from libmpm._src.methods.method import CROSSINGS
from libmpm.boundaries import DecayLayer, Mirror, Response, Slip
from libmpm.cases import Options
from libmpm.methods import AssumedFields, Kernel, Smoothing, Transfer

BASELINE = "baseline"
WATER = 2.2e9  # Pa, bulk modulus of real water
#: Fields of an option that lines name only where they are not the usual ones.
CHANGES = (
    "size", "shifting", "density", "cells", "per_cell", "bulk", "extent", "smoothing", "assumed",
    "contact", "solids",
)  # fmt: skip
#: Forms of F-bar whose smoothing is set by a length.
BY_LENGTH = ("two-volume", "split", "literal")
LENGTH = 1.0  # cells, of those forms
Group = Literal[
    "baseline", "transfer", "kernel", "F-bar", "F-bar size", "solid", "boundary", "precision",
    "pipeline", "step", "cells", "particles", "bulk modulus", "dimension", "together", "smoothing",
    "contact",
]  # fmt: skip


@dataclass(frozen=True)
class Option:
    """A row: all choices of a run. `fbar` and `solid_fbar` are names of forms; None is no F-bar.

    `material` names the elastic law of the cases that let it vary; `step` is the time step's part
    of the case's own. `size` is the length of F-bar, in cells, in the forms that have one, and its
    time in cell crossings of sound in the others; None is the usual one.

    The others change the case: `cells` is the number of cells along a length, parts of the case's
    own; `per_cell` the number of particles, None is two an axis; `bulk` the bulk modulus, parts of
    that of real water; `extent` "slice", two cells thick, or "full" in three dimensions. `contact`
    is the law by which bodies that meet have velocities of their own, "Friction" or "Fluid";
    `solids` what solid bodies are made of in place of particles: "elements" of half a cell, or
    "rigid".
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
    size: float | None = None
    shifting: bool = False
    density: bool = False
    cells: float = 1.0
    per_cell: int | None = None
    bulk: float | None = None
    extent: str = ""
    smoothing: str | None = None
    assumed: str | None = None
    contact: str | None = None
    solids: str | None = None
    beside: str = BASELINE

    def choices(self, cfl: float, cell_size: float, wave_speed: float) -> Options:
        """Return what a case is built with; `wave_speed` in m/s is that of its first body."""
        crossing = cell_size / wave_speed
        return Options(
            method=Method(cfl=cfl * self.step, transfer=self.transfer, kernel=self.kernel),
            fbar=smoothing(self.fbar, self.size, cell_size, crossing, self.shifting, self.density),
            solid_fbar=smoothing(self.solid_fbar, self.size, cell_size, crossing),
            walls=self.walls,
            layer=self.layer,
        )

    def of_the_cpu(self) -> bool:
        """Return whether other backends refuse it."""
        return self.kernel.name in ("cpdi", "ddmp") or self.assumed is not None

    def over_cells(self) -> dict[str, Any]:
        """Return what a body is told of smoothing over cells and of assumed fields."""
        made: dict[str, Any] = {}
        if self.smoothing is not None:
            made["smoothing"] = Smoothing(method=self.smoothing)  # type: ignore[arg-type]
        if self.assumed is not None:
            made["assumed"] = AssumedFields(over=self.assumed)  # type: ignore[arg-type]
        return made

    @property
    def smoothed(self) -> float | None:
        """Length, in cells, or time, in cell crossings of sound, of its F-bar."""
        form = self.fbar or self.solid_fbar
        if form is None or self.size is not None:
            return self.size
        return LENGTH if form in BY_LENGTH else CROSSINGS

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
            **({} if self.walls is None else {"walls": _walls(self.walls)}),
            **({} if self.layer is None else {"layer": self.layer.to_dict()}),
            **{k: getattr(self, k) for k in CHANGES if getattr(self, k) != getattr(Option, k)},
        }


def _walls(response: Response) -> str:
    return "linear" if response.asks_for_linear else response.kind


def smoothing(
    form: str | None,
    size: float | None,
    cell_size: float,
    crossing: float,
    shifting: bool = False,
    density: bool = False,
) -> FBar | None:
    """Return a form with its length in cells or its time in crossings; None is the usual one."""
    if form is None:
        return None
    if form in BY_LENGTH:
        return FBar(form=form, length=(size or LENGTH) * cell_size)  # type: ignore[arg-type]
    time = None if size is None else size * crossing
    return FBar(form=form, time=time, shifting=shifting, density=density)  # type: ignore[arg-type]


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
        "CPDI": Kernel(name="cpdi"),
    }
    with_blend = {
        "linear, PIC-FLIP 0.95": Kernel(name="linear"),
        "DDMP, PIC-FLIP 0.95": Kernel(name="ddmp"),
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


def _sizes() -> list[Option]:
    """Return each form of F-bar with less and with more smoothing than usual.

    With a length ℓ, ψ = 4ℓ²/(Δx² + 4ℓ²): 0.25 for 0.29 cells, 0.8 for 1, 0.99 for 5.
    """
    made = []
    for form in FORMS:
        unit, values = ("cells", (0.29, 5.0)) if form in BY_LENGTH else ("crossings", (3.5, 350.0))
        name = f"F-bar {form}"
        made += [
            Option(f"{name}, {v:g} {unit}", "F-bar size", fbar=form, size=v, beside=name)
            for v in values
        ]
    for form, value in (("two-volume", 0.29), ("two-volume", 5.0), ("one-volume-gradient", 3.5)):
        name, unit = f"solid F-bar {form}", "cells" if form in BY_LENGTH else "crossings"
        made.append(
            Option(f"{name}, {value:g} {unit}", "F-bar size", solid_fbar=form, size=value,
                   beside=name)
        )  # fmt: skip
    return made


def _over_cells() -> list[Option]:
    """Return smoothing over cells with and without means of stress and rate (Yang 2016)."""
    flip, linear = Transfer(scheme="FLIP"), "linear, PIC-FLIP 0.95"
    means = "FLIP, cell means"
    return [
        *(Option(f"smoothing {m}", "smoothing", smoothing=m) for m in ("C0", "F0AL1", "NB")),
        Option(means, "smoothing", flip, assumed="cell", beside="FLIP"),
        Option(f"{means}, smoothing F0AL1", "smoothing", flip, assumed="cell", smoothing="F0AL1",
               beside=means),
        Option(f"{linear}, smoothing F0AL1", "smoothing", Transfer(scheme="PIC-FLIP", flip=0.95),
               Kernel(name="linear"), smoothing="F0AL1", beside=linear),
        *(
            Option(f"LinearElastic, smoothing {m}", "smoothing", material="LinearElastic",
                   smoothing=m, beside="LinearElastic")
            for m in ("C0", "F0AL1")
        ),
    ]  # fmt: skip


LINEAR = Slip(cell="linear")


def _contacts() -> list[Option]:
    """Return fields of velocities for bodies that meet, with either transfer of the defaults."""
    aflip, shown = Transfer(scheme="AFLIP", flip=0.95), "AFLIP 0.95"
    made = []
    for law in ("Fluid", "Friction"):
        name = f"contact {law}"
        made += [
            Option(name, "contact", contact=law),
            Option(f"{name}, {shown}", "contact", transfer=aflip, contact=law, beside=shown),
        ]
    linear = "linear walls"
    name = f"contact Fluid, {linear}"
    return [*made, Option(name, "contact", walls=LINEAR, contact="Fluid", beside=linear)]


HALF, DOUBLE, SLICE = "half the cells", "double the cells", "half the cells, slice"


def _changes() -> list[Option]:
    """Return what changes the case: resolution, particles, bulk modulus, step, dimension."""
    aflip, shown = Transfer(scheme="AFLIP", flip=0.95), "AFLIP 0.95"
    fbar = "one-volume-gradient"
    return [
        Option(HALF, "cells", cells=0.5),
        Option(DOUBLE, "cells", cells=2.0),
        Option("4 times the cells", "cells", cells=4.0),
        *(
            Option(f"{n} particle{'s' * (n > 1)} per cell", "particles", per_cell=n)
            for n in (1, 9, 16)
        ),
        Option("half the step", "step", step=0.5),
        Option("double the step", "step", step=2.0),
        Option("water's bulk modulus", "bulk modulus", bulk=1.0),
        *(
            Option(f"1/{n} of water's bulk modulus", "bulk modulus", bulk=1 / n)
            for n in (10, 100, 1000, 10000)
        ),
        Option(SLICE, "dimension", cells=0.5, extent="slice", beside=HALF),
        Option("half the cells, full 3D", "dimension", cells=0.5, extent="full", beside=HALF),
        *(
            Option(
                f"{SLICE}, {n} particle{'s' * (n > 1)} per cell", "particles", cells=0.5,
                extent="slice", per_cell=n, beside=SLICE,
            )
            for n in (1, 27)
        ),
        Option(f"{HALF}, {shown}", "together", cells=0.5, transfer=aflip, beside=HALF),
        Option(f"{DOUBLE}, {shown}", "together", cells=2.0, transfer=aflip, beside=DOUBLE),
        Option(f"{HALF}, F-bar", "together", cells=0.5, fbar=fbar, beside=HALF),
        Option(f"{DOUBLE}, F-bar", "together", cells=2.0, fbar=fbar, beside=DOUBLE),
        Option(f"{DOUBLE}, mirrored walls", "together", cells=2.0, walls=Mirror(), beside=DOUBLE),
        Option(f"{DOUBLE}, mirrored walls, {shown}", "together", cells=2.0, walls=Mirror(),
               transfer=aflip, beside=f"{DOUBLE}, mirrored walls"),
        Option(f"mirrored walls, {shown}", "together", transfer=aflip, walls=Mirror(),
               beside="mirrored walls"),
        Option(f"{DOUBLE}, linear walls", "together", cells=2.0, walls=LINEAR, beside=DOUBLE),
        Option(f"linear walls, {shown}", "together", transfer=aflip, walls=LINEAR,
               beside="linear walls"),
        Option(f"{DOUBLE}, double the step", "together", cells=2.0, step=2.0, beside=DOUBLE),
        Option(f"{DOUBLE}, 1 particle per cell", "together", cells=2.0, per_cell=1, beside=DOUBLE),
    ]  # fmt: skip


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
    Option("F-bar one-volume-gradient, shifting", "F-bar", fbar=FORMS[0], shifting=True),
    Option("F-bar one-volume-gradient, density", "F-bar", fbar=FORMS[0], density=True),
    *(Option(f"solid F-bar {form}", "solid", solid_fbar=form) for form in FORMS),
    *(Option(law, "solid", material=law) for law in LAWS),
    Option("elements", "solid", solids="elements"),
    Option(
        "elements, AFLIP 0.95",
        "solid",
        transfer=Transfer(scheme="AFLIP", flip=0.95),
        solids="elements",
        beside="AFLIP 0.95",
    ),
    Option("rigid", "solid", solids="rigid"),
    Option("mirrored walls", "boundary", walls=Mirror()),
    Option("linear walls", "boundary", walls=LINEAR),
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
    *_over_cells(),
    *_contacts(),
    *_sizes(),
    *_changes(),
)

#: Choices that stand for the others in cases with a short list, beside those that change the case.
SHORT = (
    BASELINE, "PIC", "FLIP", "PIC-FLIP 0.95", "AFLIP 0.95", "ASFLIP 0.95", "XPIC 5 every 5",
    "quadratic, kernel gradient", "cubic", "uGIMP", "linear, PIC-FLIP 0.95", "mirrored walls",
    "F-bar one-volume-gradient", "F-bar one-volume-gradient, 3.5 crossings", "F-bar two-volume",
    "F-bar one-volume-gradient, shifting", "F-bar one-volume-gradient, density",
    "F-bar two-volume, 5 cells", "solid F-bar two-volume",
    "double precision", "smoothing C0", "smoothing F0AL1", "LinearElastic",
    "LinearElastic, smoothing C0", "LinearElastic, smoothing F0AL1",
)  # fmt: skip
