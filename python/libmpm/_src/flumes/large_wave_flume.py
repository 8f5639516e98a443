"""`LargeWaveFlume`: the Large Wave Flume of Oregon State University, its box and bars."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, shown, value
from libmpm._src.boundaries.responses import Displacement
from libmpm._src.boundaries.wave_makers import piston_stroke
from libmpm._src.errors import SceneError
from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import add_field, lengthened
from libmpm._src.flumes.facility import (
    Difference,
    Facility,
    Instrument,
    Pairs,
    Width,
    check_debris,
    free_wall,
    modulus_at_speed,
    wall,
)
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Prototype

__all__ = ["LargeWaveFlume"]

#: Levels at which the two waves were made, m (S 3684, 3708).
_LEVELS = {"unbroken": 2.0, "broken": 1.85}
#: Corners of the box, m (S 3612-3619).
_BOX = ((43.80, -0.508, 2.0), (44.816, 0.508, 2.615))
#: A bar: edges m, density kg/m³: of the text (S 3688), and as drawn (H2).
_BARS = {"stated": ((0.5, 0.1, 0.05), 981.0), "as-drawn": ((0.5, 0.102, 0.051), 969.0)}
_POISSON = 0.4
_MEASURED_MODULUS = 0.8e9
_GAUGES = (
    ("WG1", 14.0), ("WG2", 32.294), ("WG3", 36.139), ("USWG1", 39.625), ("USWG2", 43.255),
    ("USWG4", 46.955),
)  # fmt: skip
#: Gauges beside which no box stands: across, m from the centreline.
_BESIDE = 1.3


@value
class LargeWaveFlume(Facility):
    """The OSU Large Wave Flume: a piston, a long wave, a raised box, and bars of HDPE.

    {fields}

    x is that of the facility, 0 at the wave maker's neutral place; public scene files have x + 2.0.
    Measured time = time of the run + 15.0 s: half of the crest is then due at WG1 at 23.64 s,
    measured 23.62.

    =====================  ==================================================  ====================
    what                   value                                               source
    =====================  ==================================================  ====================
    length, width          87.46 m to the end of the beach, 3.66 m             drawing of hdro-0002
    bed (x, z), m          (0, 0) (14.275, 0) (14.275, 0.226) (17.933, 0.226)  drawing of hdro-0002
                           (28.906, 1.140) (43.536, 1.750) (80.106, 1.750)
                           (87.460, 2.363)
    still water            2.00 m unbroken, 1.85 m broken                      Bonus (2023) 7.3
    unbroken stroke        2 (1 + erf 0.2 (t - 9.9303)) m                      Bonus (2023) 7.3
    broken stroke          3.643 m, fastest 2.30 m/s at 3.4 s                  public file
    box                    1.016 × 1.016 × 0.615 m, front at x 43.80,          Bonus (2023) 7.3
                           underside z 2.00
    WG1, WG2, WG3          x 14.00, 32.294, 36.139 m                           hdro-0021
    USWG1, USWG2, USWG4    x 39.625, 43.255, 46.955 m                          hdro-0021
    ADV                    x 43.255, y 1.3, 0.15 m above the bed               height chosen
    bar                    0.5 × 0.1 × 0.05 m, 981 kg/m³, E 0.8 GPa, ν 0.4     Bonus (2023) 7.3
    field of bars          downstream edge 2.0 m before the box                Bonus (2023) 7.3
    =====================  ==================================================  ====================

    The bed's step at 14.275 m is the drawing's; the published simulation filled it. Drawn slopes
    are taken, not the ramps' ends of the public program (1.15, 1.75, 2.35 m).

    Defaults: in a slice APIC and a bed of held nodes, through whose step and slopes no water is
    lost; in space AFLIP 0.95 and linear cells at all walls; water in columns. With the box at Δx
    0.1 m that gives a peak of 416 N where 214 N was measured; with held walls and APIC it is
    1289 N, FLIP is lower and loses a particle at the bed's step (`docs/boundaries.md`).

    Debris shares the velocity of the water at the nodes of the grid: there is no contact with slip
    or friction between bodies yet. `debris_modulus` = None takes E down until pressure waves run
    through a bar as fast as through the water, which keeps the time step and softens single blows.

    Raises `SceneError`.

    Source: Mascarenas (2022); Shekhar et al. (2020); Bonus (2023) chapter 7.
    """

    label: ClassVar[str] = "flumes.LargeWaveFlume"
    short: ClassVar[str] = "lwf"
    title: ClassVar[str] = "OSU Large Wave Flume"
    clock_offset: ClassVar[float] = 15.0
    bed_profile: ClassVar[Pairs] = (
        (-6.0, 0.0), (14.275, 0.0), (14.28, 0.226), (17.933, 0.226), (28.906, 1.1404),
        (43.536, 1.75), (80.106, 1.75), (87.46, 2.363), (90.0, 2.363),
    )  # fmt: skip
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.2},
        "quick": {"width": "slice", "cell_size": 0.1},
        "laptop": {"width": "slice", "cell_size": 0.05},
        "full": {"width": "half", "cell_size": 0.05, "structure": "box", "end": 70.0},
    }

    cell_size: float = given("edge Δx of the cells", default=0.05, unit="m", above=0, high=0.5)
    still_water_level: float | None = given(
        "level at rest; None = that of the wave: 2.00 m unbroken, 1.85 m broken",
        default=None, unit="m", above=0.3, high=3.0,
    )  # fmt: skip
    wave: Literal["unbroken", "broken"] | TimeTable = given(
        '"unbroken", "broken", or a `TimeTable` of places of the piston, m, from its own start',
        default="unbroken",
    )
    structure: Literal["box"] | None = given(
        'the raised "box", or None; a slice has none, since nothing could pass beside it',
        default=None,
    )
    debris: str | DebrisField | None = given(
        'None, a layout such as "16-L-1.0x0.8" (`records.load("lwf-layouts")`), or a '
        "`debris.DebrisField` in the flume's coordinates",
        default=None,
    )
    bars: Literal["stated", "as-drawn"] = given(
        '"stated" 0.5 × 0.1 × 0.05 m, 981 kg/m³, or "as-drawn" 0.5 × 0.102 × 0.051 m, 969 kg/m³',
        default="stated",
    )
    gap: float | None = given(
        "between the bars of a layout; None = two cells; none in the experiment",
        default=None, unit="m", low=0,
    )  # fmt: skip
    debris_modulus: float | Literal["measured"] | None = given(
        'E of the bars; "measured" = 0.8 GPa; None = with the wave speed of the water',
        default=None, unit="Pa", above=0,
    )  # fmt: skip
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")
    bulk_modulus: float = given(
        "K of the water; 2.2 GPa is water's own", default=2e6, unit="Pa", above=0
    )
    end: float | None = given(
        "x at which the flume is cut by a wall; None = the end of the beach",
        default=None, unit="m", above=47.0, high=87.46,
    )  # fmt: skip

    def _check(self, check: Checker) -> dict[str, Any]:
        found = self._common(check)
        if not isinstance(self.wave, TimeTable):
            check.choice("wave", self.wave, ("unbroken", "broken"))
        elif self.wave.components or self.wave.end == "zero":
            check.fail("wave is a TimeTable of vectors, or one that ends with 'zero'; expected "
                       "places of the piston along x in m that hold their end")  # fmt: skip
        if self.still_water_level is not None:
            found["still_water_level"] = check.given("still_water_level", self)
        if self.structure is not None:
            check.choice("structure", self.structure, ("box",))
            if self.width == "slice":
                check.fail("structure is 'box' with width 'slice', where it would close the flume; "
                           "expected None; use width='half'")  # fmt: skip
        check.choice("bars", self.bars, tuple(_BARS))
        names = [str(n) for n in records.load("lwf-first-peaks")["case"]]
        found["debris"] = check_debris(check, self.debris, names, self.width)
        if self.gap is not None:
            found["gap"] = check.given("gap", self)
        modulus = self.debris_modulus
        if isinstance(modulus, str) and modulus != "measured":
            check.fail(f"debris_modulus is {shown(modulus)}; expected Pa, 'measured' or None")
        elif modulus is not None and not isinstance(modulus, str):
            found["debris_modulus"] = check.given("debris_modulus", self)
        found["bulk_modulus"] = check.given("bulk_modulus", self)
        if self.end is not None:
            found["end"] = check.given("end", self)
        return found

    # The scene -------------------------------------------------------------------------------

    @property
    def still_water(self) -> float:
        """Level of the water at rest, m."""
        if self.still_water_level is not None:
            return self.still_water_level
        return _LEVELS.get(self.wave if isinstance(self.wave, str) else "", 2.0)

    def stroke(self) -> TimeTable:
        """Return the places of the piston, m, from where it starts."""
        if isinstance(self.wave, TimeTable):
            time, place = self.wave.arrays()
        elif self.wave == "unbroken":
            time, place = piston_stroke(4.0, 0.2, 9.9303, until=40.0, dt=1 / 60).arrays()
            place = place[:, 0]
        else:
            curve = records.load("lwf-broken-stroke").curve("piston")
            time, place = curve.time, curve.value
        return TimeTable(time, place - place[0])

    def scene(self) -> Scene:
        """Return the flume at rest, its piston about to move."""
        axes, h = self.axes, self.cell_size
        y = self._across(3.66)
        end = 88.0 if self.end is None else self.end
        behind = max(1.0, 4 * h)
        stroke = self.stroke()
        top = max(3.0, self.still_water + 0.9)
        made = self._new_scene((-behind, y[0], -2 * h), (end, y[1], top))
        low, high = (-2.0 * behind, y[0] - 1.0), (90.0, y[1] + 1.0)
        bed = axes.bed(self.bed_profile, (low[1], high[1]))
        box = axes.box((0.0, y[0], -1.0), (made.upper[0], y[1], made.upper[-1]))
        made.add_body(
            name="water",
            shape=basin(level=self.still_water, bed=bed, within=box),
            material=TaitFluid(bulk_modulus=self.bulk_modulus),
            hydrostatic=self.still_water,
            sampling=Columns(),
        )
        made.add_boundary(name="bed", shape=bed, response=self.bed_response())
        reach = max(stroke.value) + 2 * behind
        piston = axes.box((-float(reach), low[1], -1.0), (0.0, high[1], made.upper[-1] + 1.0))
        made.add_boundary(
            name="piston", shape=piston, response=wall(), motion=Displacement(self._along(stroke))
        )
        made.add_boundary(name="walls", shape=DomainWalls(), response=wall())
        if self.structure is not None:
            made.add_boundary(name="box", shape=self.box(), response=free_wall())
        if self.debris is not None:
            self._add_debris(made)
        for one in self.instruments():
            if one.kind == "level":
                hat = max(0.1, h)
                made.add_sensor(name=one.name, sensor=axes.gauge(one.x, one.y, one.z, 1 / 20, hat))
            elif one.kind == "velocity":
                made.add_sensor(name=one.name, sensor=axes.probe(one.x, one.y, one.z, 1 / 30))
            elif one.kind == "load":
                made.add_sensor(
                    name=one.name, sensor=LoadCell(boundary=one.boundary, interval=1 / 1200)
                )
        return made

    def box(self) -> Box:
        """Return the raised box on faces of cells; with width "half" one half of it."""
        (x, y, z), (u, v, w) = _BOX
        first = 0.0 if self.width == "half" else -self._cells(-y)
        return self.axes.box(
            (self._cells(x), first, self._cells(z)),
            (self._cells(u), self._cells(v), self._cells(w)),
        )

    def instruments(self) -> tuple[Instrument, ...]:
        """Return gauges, the velocimeter, and with the box its load cell."""
        end = math.inf if self.end is None else self.end
        beside = 0.0 if self.width == "slice" else min(_BESIDE, self._across(3.66)[1] - 0.2)
        found = [Instrument(n, "level", x, beside, self._bed_at(x)) for n, x in _GAUGES if x < end]
        adv = 43.255
        found.append(Instrument("ADV", "velocity", adv, beside, self._bed_at(adv) + 0.15))
        if self.structure is not None:
            share = 2.0 if self.width == "half" else 1.0
            found.append(Instrument("box", "load", _BOX[0][0], 0.0, 2.0, "box", share))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return box and debris from the side."""
        found: list[tuple[str, Pairs]] = [("piston", _rectangle(-0.6, 0.0, 0.0, 2.6))]
        if self.structure is not None:
            (x, _, z), (u, _, w) = _BOX
            found.append(("box", _rectangle(x, u, z, w)))
        if self.debris is not None:
            field = self.field()
            low = min(p.x for p in field.pieces) - 0.25
            high = max(p.x for p in field.pieces) + 0.25
            z = self.still_water
            found.append(("debris", _rectangle(low, high, z - 0.05, z + 0.01)))
        return tuple(found)

    # Debris ----------------------------------------------------------------------------------

    def field(self) -> DebrisField:
        """Return the debris as a field of the plan; raises `SceneError` where there is none."""
        if isinstance(self.debris, DebrisField):
            return self.debris
        if self.debris is None:
            raise SceneError(
                f"{self.label}: debris is None; expected a layout, such as '8-L-1.0x0.4'"
            )
        row = records.load("lwf-first-peaks").row("case", self.debris)
        (length, width, height), density = _BARS[self.bars]
        bar = Prototype(
            length=length, width=width, height=height, name="bar",
            material=FixedCorotated(
                density=density, youngs_modulus=self.modulus(), poissons_ratio=_POISSON
            ),
        )  # fmt: skip
        lengthwise = row["orientation_L_longitudinal_T_transverse"] == "L"
        along, across = (length, width) if lengthwise else (width, length)
        rows = max(1, round(float(row["array_streamwise_m"]) / along))
        columns = max(1, round(float(row["array_cross_m"]) / across))
        gap = 2 * self.cell_size if self.gap is None else self.gap
        deep = rows * along + (rows - 1) * gap
        return ordered(
            bar, rows=rows, columns=columns, clearance=gap, orientation=0 if lengthwise else 90,
            centre=(_BOX[0][0] - 2.0 - 0.5 * deep, 0.0),
        )  # fmt: skip

    def modulus(self) -> float:
        """Return E of the bars, Pa."""
        if self.debris_modulus == "measured":
            return _MEASURED_MODULUS
        if self.debris_modulus is not None:
            return float(self.debris_modulus)
        speed = math.sqrt(self.bulk_modulus / 1000.0)
        return min(modulus_at_speed(_BARS[self.bars][1], _POISSON, speed), _MEASURED_MODULUS)

    def _add_debris(self, made: Scene) -> None:
        field = self.field()
        kind = field.prototypes[0]
        floats = min(1.0, float(kind.material.parameters()["density"]) / 1000.0)
        add_field(made, field, elevation=self.still_water - floats * kind.height,
                  half=self.width == "half")  # fmt: skip

    # What it is compared with ----------------------------------------------------------------

    def differences(self) -> tuple[Difference, ...]:
        """Return where the scene is not the flume."""
        found = [
            Difference("bulk modulus of water", "2.2e9 Pa", f"{self.bulk_modulus:g} Pa",
                       "longer steps; waves run at a tenth of its sound or less"),
            Difference("step of the bed", "upright at x 14.275 m", "over 5 mm",
                       "a profile has one height at a place"),
        ]  # fmt: skip
        if self.width != "slice":
            wide = 2 * self._across(3.66)[1]
            found += lengthened("width", 3.66, wide)
        if self.end is not None:
            found.append(Difference("end", "beach at 87.46 m", f"wall at {self.end:g} m", "cost"))
        if self.structure is not None:
            low, high = self.box().bounds()
            share = 2.0 if self.width == "half" else 1.0
            found += lengthened("box along", 1.016, high[0] - low[0])
            found += lengthened("box across", 1.016, share * (high[1] - low[1]))
            found += lengthened("box up", 0.615, high[2] - low[2])
        if self.debris is not None:
            found.append(Difference("E of the bars", "0.8 GPa", f"{self.modulus():.3g} Pa",
                                    "longer steps; single blows are softer"))  # fmt: skip
            gap = 2 * self.cell_size if self.gap is None else self.gap
            found.append(Difference("gap between bars", "none", f"{gap:g} m",
                                    "bodies share velocities at nodes: no contact"))  # fmt: skip
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return rows L1 to L9; those of the box where there is one, of debris with its layout."""
        if self.wave != "unbroken":
            return self._loads()
        coarse = self.cell_size >= 0.075
        record = records.load("lwf-waves")
        window, found = (15.5, 34.0), []
        published = {"WG1": ("0.0088", "-0.18 s", "+7 %"), "WG2": ("0.0044", "-0.25 s", "-1 %"),
                     "WG3": ("0.0052", "-0.25 s", "0 %")}  # fmt: skip
        half = {"WG1": 23.62, "WG2": 28.20, "WG3": 29.42}
        crests = {"WG1": 0.198, "WG2": 0.238, "WG3": 0.242}
        limit = 0.015 if coarse else 0.0125
        for name, (off, late, high) in published.items():
            found.append(Criterion(
                "L1", f"rms of the level, {name}", "m", (name,), window,
                measures.rms(name, record.curve(name), window), 0.0, 0.0, limit, f"≤ {limit:g} m",
                off,
            ))  # fmt: skip
            found.append(Criterion(
                "L2", f"half of the crest, {name}", "s", (name,), window,
                measures.half_crest(name, window), published=late,
                **measures.near(half[name], 0.35 if coarse else 0.2, "s"),
            ))  # fmt: skip
            found.append(Criterion(
                "L3", f"crest, {name}", "m", (name,), window, measures.crest(name, window),
                published=high, **measures.within(crests[name], 0.15 if coarse else 0.10),
            ))  # fmt: skip
        if self.structure is None:
            found.append(Criterion(
                "L4", "rise before the box's place, USWG2", "m", ("USWG2",), (15.5, 40.0),
                measures.crest("USWG2", (15.5, 40.0)), **measures.within(0.278, 0.15),
            ))  # fmt: skip
            found.append(Criterion(
                "L4", "speed before the box's place, ADV", "m/s", ("ADV",), (15.5, 40.0),
                _fastest, 1.2, 1.0, 1.4, "1.0 to 1.4 m/s",
            ))  # fmt: skip
        return (*found, *self._loads())

    def _loads(self) -> tuple[Criterion, ...]:
        """Return the rows of the box."""
        if self.structure is None:
            return ()
        window = (30.0, 45.0)
        if self.debris is not None:
            return self._first_peak(window) if isinstance(self.debris, str) else ()
        if self.wave != "unbroken":
            return ()
        return (
            Criterion("L5", "peak of the load, means of 0.1 s", "N", ("box",), (30.0, 42.0),
                      measures.peak_load("box", (30.0, 42.0)), published="+34 %",
                      **measures.within(214.4, 0.25)),
            Criterion("L6", "impulse of the load, 30 to 45 s", "N s", ("box",), window,
                      measures.impulse("box", window), published="-3 %",
                      **measures.within(1217.0, 0.10)),
            *(Criterion("L7", f"arrival of {100 * share:g} % of the peak load", "s", ("box",),
                        (30.0, 42.0), _load_arrival(share, (30.0, 42.0)), tolerance="± 0.4 s",
                        published="+0.7 to 1.0 s", held_out=True, gates=False)
              for share in (0.05, 0.5)),
        )  # fmt: skip

    def _first_peak(self, window: tuple[float, float]) -> tuple[Criterion, ...]:
        """Return the first peak of a layout with its fences."""
        row = records.load("lwf-first-peaks").row("case", str(self.debris))
        median = float(row["exp_mascarenas2022_median_N"])
        simulated = float(row["mpm_bonus2023_N"])
        said = "" if math.isnan(simulated) else f"{simulated:g} N"
        measure = measures.peak_load("box", window, 0.01)
        what = f"first peak of the load, {self.debris}"
        if math.isnan(median):
            return (Criterion("L9", what, "N", ("box",), window, measure, published=said,
                              gates=False),)  # fmt: skip
        low = float(row["exp_whisker_low_N"])
        high = float(row["exp_whisker_high_N"])
        bounds = measures.within(median, 0.2)
        bounds |= {"low": max(bounds["low"], low), "high": min(bounds["high"], high),
                   "tolerance": f"± 20 %, {low:g} to {high:g} N"}  # fmt: skip
        return (Criterion("L8", what, "N", ("box",), window, measure, published=said, **bounds),)


def _rectangle(x: float, u: float, z: float, w: float) -> Pairs:
    return ((x, z), (u, z), (u, w), (x, w))


def _fastest(signals: measures.Signals) -> float:
    """Return the largest mean of the speed over a second, m/s."""
    time, speed = signals.column("ADV", "velocity_x")
    return float(np.nanmax(measures.smooth(time, np.nan_to_num(speed), 1.0)))


def _load_arrival(share: float, window: tuple[float, float]) -> Any:
    """Return what measures when a share of the peak of the load is first reached, s."""

    def measure(signals: measures.Signals) -> float:
        time, force = signals.load("box")
        mean = measures.smooth(time, force, 0.1)
        keep = (time >= window[0]) & (time <= window[1])
        above = mean[keep] >= share * float(mean[keep].max())
        return float(time[keep][int(np.argmax(above))])

    return measure
