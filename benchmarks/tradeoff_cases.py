"""The cases of the trade-off table: reference cases made small, and those of `tradeoff_scenes`.

`Measured` says of each what the table and the atlas need beside the case itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from tradeoff_options import BASELINE, SHORT, WATER, Option
from tradeoff_scenes import (
    BAR_CASE,
    DENSITY,
    DEPTH,
    FLOATING_CASE,
    GRAVITY,
    IMPACT_CASE,
    PAIR_CASE,
    SLIDE_CASE,
    SLIDING,
    SPIN_CASE,
    lame_case,
)

import libmpm
from libmpm import cases
from libmpm._src.advice.tradeoff.choices import apply_choices
from libmpm._src.boundaries.wall_cells import with_held_cells

Parameters = Mapping[str, Any]

# ---- the table's cases --------------------------------------------------------------------------


#: Groups of options that change the case and not the method.
CHANGING = ("step", "cells", "particles", "bulk modulus", "dimension", "together")


def _cells(p: Parameters) -> float:
    return float(p["cells"])


@dataclass(frozen=True)
class Measured:
    """A case with its sizes and what the table shows of it.

    `expected` are the exact or measured numbers that errors count from, by value. `energy` gives
    what a change of energy counts in, J/m, from the parameters and the energy at the start; None
    where gravity grows or friction takes energy, so that it says nothing.

    What options may change: `cells`, the parameter for the resolution ("cell_size" if it is that in
    m), from `coarsest` to `finest` parts of its own; `steps`, a parameter that counts them, so that
    it grows with what shortens the step; `depth`, the parameter for the thickness of a slab, in
    m or cells, and `breadth`, that of the full scene; `packs`, the number of particles; the bulk
    modulus up to `stiffest` parts of real water's. `only` limits the options by name, beside those
    that change the case if `changes`; `brief`: to the short list on a device. `meeting` names two
    bodies that contact may keep apart, with `friction`. `meshes`: solids may be elements.

    The atlas: `across` cells in the smallest length that matters; `head`, Pa, the pressure and
    `speed`, m/s, the motion that the bulk modulus, Pa, is to be compared with, or the speed itself
    in parts of the waves'; `judged`, the values whose errors count, all if empty; `apart`, values
    that have a unit and are no errors; `length` turns an error in cells into parts.
    """

    case: cases.Case
    kind: str  # "water" or "solid"
    cfl: float
    sizes: Mapping[str, Mapping[str, Any]]  # "small" and "device"
    expected: Mapping[str, float]
    shown: Mapping[str, tuple[str, str]]  # value -> heading, format
    energy: Callable[[Parameters, float], float] | None = None
    interval: float = 0.0  # s, of the energy where the case has no such sensor
    state: str = ""
    materials: bool = field(default=False)
    boundary: str = ""  # that options may change: "walls" or "layer"
    label: str = ""
    mixed: bool = False  # has solids beside water
    cells: str = "cells"
    coarsest: float = 0.5
    finest: float = 2.0
    steps: str = ""
    depth: str = ""
    breadth: float = 0.0
    packs: bool = True
    stiffest: float = 0.0
    bulk_modulus: float = 0.0
    only: tuple[str, ...] = ()
    brief: bool = False
    changes: bool = True
    meshes: bool = False  # its solid bodies may be elements
    meeting: tuple[str, str] | None = None
    friction: float = 0.0
    across: Callable[[Parameters], float] = _cells
    head: float = 0.0
    speed: float = 0.0
    judged: tuple[str, ...] = ()
    apart: tuple[str, ...] = ()
    length: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the row: that of the case, or its own."""
        return self.label or self.case.name

    @property
    def contact_law(self) -> str:
        """Law of the contact between the bodies that meet."""
        return "Fluid" if self.kind == "water" else "Friction"

    def bulk_ratio(self, option: Option) -> float:
        """Return the bulk modulus in parts of the case's own."""
        return 1.0 if option.bulk is None else option.bulk * WATER / self.bulk_modulus

    def applies(self, option: Option, size: str = "small") -> bool:
        """Return whether an option changes anything here, and is worth its time."""
        if size not in self.sizes or (size == "device" and option.of_the_cpu()):
            return False
        finest = self.finest if size == "small" else min(self.finest, 2.0)
        changed = option.group in CHANGING
        if option.solids is not None:
            # Elements and rigid bodies run on the CPU alone; these need water for their time step.
            fits = self.meshes if option.solids == "elements" else self.mixed
            return fits and size == "small"
        if option.contact is not None:
            fits = self.meeting is not None and option.contact == self.contact_law
            return fits and (option.walls is None or self.boundary == "walls")
        if self.boundary == "layer" or option.layer is not None:
            plain = option.group == "baseline" or option.layer is not None
            return self.boundary == "layer" and plain
        only = SHORT if self.brief and size == "device" else self.only
        if only and option.name not in only and not (changed and self.changes):
            return False
        if option.walls is not None and self.boundary != "walls":
            return False
        if option.fbar is not None and self.kind != "water":
            return False
        if option.over_cells():
            # Without packs every particle is a body, and a cell's mean its own value.
            fits = (option.material == "LinearElastic") == (self.kind == "solid")
            if not fits or not self.packs:
                return False
        if option.material != "FixedCorotated" and not self.materials:
            return False
        if option.solid_fbar is not None and self.kind == "water" and not self.mixed:
            return False
        if not self.coarsest <= option.cells <= finest and option.cells != 1:
            return False
        if option.extent and not self.depth:
            return False
        if option.per_cell is not None and not self.packs:
            return False
        if option.bulk is not None:
            # What is the case's own to 5 % is the baseline.
            same = abs(self.bulk_ratio(option) - 1) < 0.05 if self.bulk_modulus else True
            return option.bulk <= self.stiffest and not same
        return True

    def parameters(self, option: Option, size: str) -> dict[str, Any]:
        """Return the parameters of the case with what the option changes."""
        changes = dict(self.sizes[size])
        if self.materials:
            changes["material"] = option.material
        level = "reduced" if "reduced" in self.case.levels else "full"
        p = self.case.parameters(level, changes)
        if self.cells == "cells":
            p["cells"] = round(p["cells"] * option.cells)
        else:
            p[self.cells] /= option.cells
        if self.steps and (option.bulk or option.cells != 1 or option.step != 1):
            more = option.cells * math.sqrt(self.bulk_ratio(option)) / option.step
            p[self.steps] = round(p[self.steps] * more)
        if option.extent:
            dx = p["width"] / p["cells"] if self.depth == "thickness" else 1.0
            full = self.breadth if self.depth == "thickness" else p["cells"]
            p[self.depth] = 2 * dx if option.extent == "slice" else full
        return p

    def build(self, option: Option, size: str) -> tuple[libmpm.Scene, dict[str, Any]]:
        """Return the scene of an option and the parameters that it has."""
        p = self.parameters(option, size)
        size_of_cells = speed = 1.0
        if option.smoothed is not None:
            first = self.case.build(p, Option("", "baseline").choices(self.cfl, 1.0, 1.0))
            law = first.bodies[0].material.to_dict()
            size_of_cells = first.cell_size
            speed = wave_speed(law) * math.sqrt(self.bulk_ratio(option))
        scene = self.case.build(p, option.choices(self.cfl, size_of_cells, speed))
        more = option.over_cells()
        plain = scene.to_dict()
        if option.walls is None:
            # Options are compared with held nodes; "linear walls" is an option of its own.
            plain = with_held_cells(plain, auto=True)
        for body in plain["bodies"]:
            if more and (self.kind == "solid" or "bulk_modulus" in body["material"]):
                body |= {k: v.to_dict() for k, v in more.items()}
            if option.bulk is not None and "bulk_modulus" in body["material"]:
                body["material"]["bulk_modulus"] *= self.bulk_ratio(option)
            if option.per_cell is not None:
                body["particles_per_cell"] = option.per_cell
        made = libmpm.Scene.from_dict(plain)
        if option.solids is not None:
            solid = [b.name for b in made.bodies if not b.material.table.stores_volume]
            made = apply_choices(made, {option.solids: solid})
        if option.contact is not None:
            assert self.meeting is not None
            solids = libmpm.contacts.Friction(static=self.friction)
            chosen = solids if option.contact == "Friction" else libmpm.contacts.Fluid()
            made.add_contact(name="contact", between=self.meeting, law=chosen)
        return made, p


def wave_speed(law: Mapping[str, Any]) -> float:
    """Return the speed of pressure waves of a law's numbers, m/s."""
    if "bulk_modulus" in law:
        return math.sqrt(law["bulk_modulus"] / law["density"])
    modulus, ratio = law["youngs_modulus"], law["poissons_ratio"]
    stiffness = modulus * (1 - ratio) / ((1 + ratio) * (1 - 2 * ratio))
    return math.sqrt(stiffness / law["density"])


def _kinetic(p: Parameters, start: float) -> float:
    """A body that starts undeformed and without weight has kinetic energy only."""
    return start


def _flow(p: Parameters, start: float) -> float:
    """Kinetic energy of the vortex at the start."""
    return DENSITY / 4


def _fall(p: Parameters, start: float) -> float:
    """Energy that the column sets free until it lies on the bed, as the case itself counts."""
    a = p["width"]
    return 0.5 * DENSITY * GRAVITY * (a * (2 * a) ** 2 - 5 * a * (0.4 * a) ** 2)


def _weight(p: Parameters, start: float) -> float:
    depth = p["depth"]
    return 0.5 * DENSITY * p["gravity"] * depth**2 * p["width"] * depth / p["cells"]


#: Options of the cases of loads.
LOADS = (
    BASELINE, "PIC", "FLIP", "AFLIP 0.95", "F-bar one-volume-gradient", "F-bar two-volume",
    "double precision", "linear walls",
)  # fmt: skip

MEASURED: tuple[Measured, ...] = (
    Measured(
        case=cases.case("vortex"), kind="water", cfl=0.4, energy=_flow,
        sizes={"small": {"cells": 24, "turnovers": 1.0}, "device": {"cells": 96, "turnovers": 1.0}},
        expected={"kinetic_left": 1.0},
        shown={"kinetic_left": ("vortex: energy left", ".2f")},
        state="smooth flow, closed box", boundary="walls",
        finest=4.0, stiffest=1.0, bulk_modulus=4e5, head=3000.0, speed=1.0,
    ),
    Measured(
        case=cases.case("dam-break"), kind="water", cfl=0.4, energy=_fall,
        sizes={"small": {"cells": 16, "until": 6.0}, "device": {"cells": 40, "until": 6.0}},
        expected={"front_speed": 1.16, "energy_gain": 0.0},
        shown={"front_speed": ("dam break: front, error", "+.1%")},
        state="free surface, splash against a wall",
        depth="thickness", breadth=1.0, stiffest=1.0, bulk_modulus=3.924e6,
        head=2 * DENSITY * GRAVITY, speed=2 * math.sqrt(GRAVITY), judged=("front_speed",),
    ),
    Measured(
        case=cases.case("tank"), kind="water", cfl=0.3, energy=_weight, interval=0.05,
        sizes={
            "small": {"steps": 6_000, "jitter": 0.1},
            "device": {"steps": 5_000, "jitter": 0.1},
        },
        expected={"noise": 0.0, "checkerboard": 0.0, "speed": 0.0, "profile": 0.0},
        shown={
            "noise": ("tank: pressure, rms error", ".3f"),
            "checkerboard": ("tank: checkerboard", ".4f"),
            "speed": ("tank: speed", ".0e"),
        },
        state="at rest, particles off their lattice by up to 0.1 cells", boundary="walls",
        brief=True, steps="steps", packs=False, stiffest=1.0, bulk_modulus=1.962e6,
        head=DENSITY * GRAVITY, judged=("noise",),
    ),
    Measured(
        case=cases.case("slope-basin"), kind="water", cfl=0.4,
        sizes={"small": {"cells": 16, "until": 6.0}, "device": {"cells": 32, "until": 6.0}},
        expected={"speed": 0.0, "level_low": 0.0},
        shown={
            "level_low": ("slope: lowest level, cells", "+.2f"),
            "speed": ("slope: speed", ".0e"),
        },
        state="at rest above a bed of 10 degrees", boundary="layer",
        bulk_modulus=1.92276e6, head=DENSITY * GRAVITY, judged=("level_low",),
        length=("level_low",),
    ),
    Measured(
        case=lame_case("mode", 0.3, 20, 6.0), kind="solid", cfl=0.4, meshes=True, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 64}},
        expected={"period": 1.0, "energy_left": 1.0},
        shown={
            "period": ("mode, ν 0.3: period, error", "+.2%"),

        },
        state="small vibration, free edges", materials=True,
        finest=4.0, speed=0.005,
    ),
    Measured(
        case=lame_case("mode-incompressible", 0.499, 12, 3.0), kind="solid", cfl=0.4, meshes=True,
        energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 32}},
        expected={"period": 1.0, "energy_left": 1.0},
        shown={"period": ("mode, ν 0.499: period, error", "+.1%")},
        state="small vibration, nearly incompressible", materials=True,
        brief=True, finest=4.0, speed=0.005, judged=("period",),
    ),
    Measured(
        case=SPIN_CASE, kind="solid", cfl=0.4, meshes=True, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 24}},
        expected={"angle": 1.0, "swelling": 0.0},
        shown={
            "angle": ("spin: angle, error", "+.2%"),
            "swelling": ("spin: swelling", "+.1%"),
        },
        state="rotation by one turn", materials=True,
        speed=0.05,
    ),
    Measured(
        case=cases.case("beam"), kind="solid", cfl=0.4,
        sizes={
            "small": {"cells": 4, "youngs_modulus": 2e6, "ramp": 2.0},
            "device": {"cells": 6, "youngs_modulus": 2e6, "ramp": 2.0},
        },
        expected={"deflection_ratio": 1.0},
        shown={"deflection_ratio": ("beam: deflection, error", "+.1%")},
        state="bending under weight",
        depth="slab", brief=True,
    ),
    Measured(
        case=cases.case("incline"), kind="solid", cfl=0.4, meshes=True,
        sizes={"small": {"cells": 4, "angle": 31.0}, "device": {"cells": 8, "angle": 31.0}},
        expected={
            "distance_ratio_0": 1.0, "distance_ratio_0.5": 1.0, "distance_ratio_0.95": 1.0,
            "creep_1.2": 0.0,
        },
        shown={
            "distance_ratio_0.5": ("incline, μ/tan θ = 0.5: distance, error", "+.1%"),
            "distance_ratio_0.95": ("0.95: distance, error", "+.0%"),
        },
        state="blocks that slide with friction",
        depth="slab", brief=True, judged=("distance_ratio_0.5", "distance_ratio_0"),
        apart=("creep_1.2",),
    ),
    Measured(
        case=cases.case("tank"), label="hydrostatic", kind="water", cfl=0.3, energy=_weight,
        interval=0.05,
        sizes={"small": {"cells": 20, "steps": 6_000}, "device": {"cells": 40, "steps": 10_000}},
        expected={"profile": 0.0, "bed": 0.0, "speed": 0.0},
        shown={}, state="at rest on a lattice", boundary="walls", only=SHORT,
        steps="steps", stiffest=1.0, bulk_modulus=1.962e6, head=DENSITY * GRAVITY,
        judged=("profile", "bed"),
    ),
    Measured(
        case=cases.case("sloshing"), kind="water", cfl=0.4,
        sizes={"small": {"cell_size": 0.2}, "device": {"cell_size": 0.1}},
        expected={"period": 2.0031, "amplitude": 1.0},
        shown={}, state="standing wave between mirrored walls", only=SHORT,
        cells="cell_size", coarsest=1.0, stiffest=1.0, bulk_modulus=2.2e7, head=32000.0, speed=0.15,
        across=lambda p: 3.2 / p["cell_size"], judged=("period",),
    ),
    Measured(
        case=cases.case("ritter"), kind="water", cfl=0.4,
        sizes={
            "small": {"cells": 10, "reservoir": 5.6, "flat": 10.6},
            "device": {"cells": 40, "reservoir": 5.6, "flat": 10.6},
        },
        expected={"gate": 4 / 9, "outflow": 8 / 27, "profile": 0.0},
        shown={}, state="dam break on a dry bed", only=SHORT,
        finest=4.0, stiffest=1.0, bulk_modulus=9.81e5, head=DENSITY * GRAVITY,
        speed=2 * math.sqrt(GRAVITY), judged=("gate", "outflow"),
    ),
    Measured(
        case=cases.case("surge-load"), kind="water", cfl=0.3,
        sizes={"small": {"cells": 8, "wall": "held"}, "device": {"cells": 16, "wall": "held"}},
        expected={"load": 1.0, "still": 1.0},
        shown={}, boundary="walls", changes=False,
        state="bore that a wall stops", only=LOADS,
        bulk_modulus=200 * DENSITY * GRAVITY, head=DENSITY * GRAVITY, speed=0.32,
        judged=("load",),
    ),
    Measured(
        case=cases.case("surge-debris-load"), kind="water", cfl=0.3, mixed=True, meshes=True,
        sizes={"small": {"cells": 8, "wall": "held"}, "device": {"cells": 16, "wall": "held"}},
        expected={"load": 1.0, "still": 1.0},
        shown={}, boundary="walls", changes=False,
        state="bore that brings a block to a wall", only=LOADS,
        bulk_modulus=200 * DENSITY * GRAVITY, head=DENSITY * GRAVITY, speed=0.32,
        judged=("load",), meeting=("block", "water"),
    ),
    Measured(
        case=cases.case("gate"), kind="water", cfl=0.3,
        sizes={"small": {"cells": 4, "wall": "held"}, "device": {"cells": 8, "wall": "held"}},
        expected={"discharge": 1.0},
        shown={}, boundary="walls", changes=False,
        state="stream under a gate of few cells", only=LOADS,
        bulk_modulus=160 * DENSITY * GRAVITY, head=0.8 * DENSITY * GRAVITY,
        speed=math.sqrt(1.6 * GRAVITY),
    ),
    Measured(
        case=cases.case("slot"), kind="water", cfl=0.3,
        sizes={"small": {"cells": 4, "wall": "held"}, "device": {"cells": 8, "wall": "held"}},
        expected={"discharge": 1.0},
        shown={}, boundary="walls", changes=False,
        state="stream through a slot of few cells", only=LOADS,
        bulk_modulus=180 * DENSITY * GRAVITY, head=0.9 * DENSITY * GRAVITY,
        speed=math.sqrt(0.8 * GRAVITY),
    ),
    Measured(
        case=FLOATING_CASE, kind="water", cfl=0.4, mixed=True, meshes=True,
        sizes={"small": {}, "device": {"cells": 16}},
        expected={"draft": 1.0, "swing": 0.0},
        shown={}, state="elastic block afloat", only=SHORT,
        stiffest=0.1, bulk_modulus=200 * DENSITY * GRAVITY * DEPTH, head=DENSITY * GRAVITY * DEPTH,
        meeting=("block", "water"),
    ),
    Measured(
        case=BAR_CASE, kind="solid", cfl=0.4, meshes=True, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 128}},
        expected={"period": 1.0, "energy_left": 1.0},
        shown={}, state="small vibration along the bar", only=SHORT, finest=4.0, speed=0.005,
        materials=True,
    ),
    Measured(
        case=IMPACT_CASE, kind="solid", cfl=0.4, meshes=True, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 128}},
        expected={"contact": 1.0, "restitution": 1.0},
        shown={}, state="blow against a rigid wall", only=SHORT, finest=4.0, speed=0.01,
    ),
    Measured(
        case=PAIR_CASE, kind="solid", cfl=0.4, meshes=True, energy=_kinetic,
        sizes={"small": {}, "device": {"cells": 128}},
        expected={"contact": 1.0, "restitution": 1.0},
        shown={}, state="blow of two bars, end on", only=(BASELINE, "AFLIP 0.95"), changes=False,
        speed=0.01, meeting=("left", "solid"),
    ),
    Measured(
        case=SLIDE_CASE, kind="solid", cfl=0.4, meshes=True,
        sizes={"small": {}, "device": {"cells": 16}},
        expected={"distance": 1.0},
        shown={}, state="block that slides on another", only=(BASELINE, "AFLIP 0.95"),
        changes=False, speed=0.03, meeting=("base", "block"), friction=SLIDING,
    ),
    Measured(
        case=cases.case("domino-tip"), kind="solid", cfl=0.4,
        sizes={"device": {}},
        expected={"time_ratio": 1.0, "spin_ratio": 1.0},
        shown={}, state="rigid fall about a rough edge", only=SHORT, depth="slab", speed=0.02,
        judged=("time_ratio",),
    ),
    Measured(
        case=cases.case("dominoes"), kind="solid", cfl=0.4,
        sizes={
            "device": {
                "count": 10, "cells": 6, "youngs_modulus": 2e7, "steady": 4, "duration": 0.8,
            },
        },
        # 0.532 m/s: Sun (2020). The modulus is a hundredth of the source's.
        expected={"fallen": 10.0, "speed": 0.532},
        shown={}, state="row that falls over", packs=False, changes=False, speed=0.01,
        only=(BASELINE, "AFLIP 0.95", "half the cells", "double the step"),
    ),
)  # fmt: skip
