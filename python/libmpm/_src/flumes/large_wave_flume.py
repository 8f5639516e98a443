"""`LargeWaveFlume`: the Large Wave Flume of Oregon State University, its box and bars."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, shown, value
from libmpm._src.boundaries.responses import Displacement, Slip
from libmpm._src.boundaries.wave_makers import piston_stroke
from libmpm._src.errors import ModelWarning, SceneError
from libmpm._src.flumes import large_wave_flume_rows, records
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import FIELD_TEXT, add_field, check_debris, lengthened, scattered
from libmpm._src.flumes.facility import (
    PACKING_TEXT,
    Deviation,
    Instrument,
    Pairs,
    Width,
    modulus_at_speed,
    rectangle,
    softened,
    wall,
)
from libmpm._src.flumes.near_field import FacilityOfStrips, half_metres
from libmpm._src.flumes.structures import (
    CONTACT_TEXT,
    EDGE_TEXT,
    EDGES,
    Edges,
    add_contacts,
    add_structure,
)
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.default_transfer import PAST_STRUCTURES
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Prototype

if TYPE_CHECKING:
    from libmpm._src.flumes.comparison import Comparison, Row

__all__ = ["LargeWaveFlume"]

#: Levels at which the two waves were made, m (S 3684, 3708).
_LEVELS = {"unbroken": 2.0, "broken": 1.85}
#: Corners of the box, m (S 3612-3619).
_BOX = ((43.80, -0.508, 2.0), (44.816, 0.508, 2.615))
#: A bar: edges m, density kg/m³: of the text (S 3688), and as drawn (H2).
_BARS = {"stated": ((0.5, 0.1, 0.05), 981.0), "as-drawn": ((0.5, 0.102, 0.051), 969.0)}
#: Finer cells, m, in which water that nothing keeps from packing sinks behind the wave: measured in
#: cells of 0.025 m; those of 0.05 m keep levels to 2 cm.
_PACKS = 0.04
_POISSON = 0.4
_MEASURED_MODULUS = 0.8e9
_GAUGES = (
    ("WG1", 14.0), ("WG2", 32.294), ("WG3", 36.139), ("USWG1", 39.625), ("USWG2", 43.255),
    ("USWG3", 44.285), ("USWG4", 46.955),
)  # fmt: skip


def _layouts() -> dict[str, tuple[int, int, bool]]:
    """Return rows along the flow, columns across it, and whether bars lie across, by name."""
    found: dict[str, tuple[int, int, bool]] = {}
    drawn = records.load("lwf-layouts")
    keys = ("case_in_first_peak_figure", "orientation_L_longitudinal_T_transverse",
            "streamwise_rows", "cross_columns")  # fmt: skip
    for case, turn, rows, columns in zip(*(drawn[k] for k in keys), strict=True):
        if case:
            found.setdefault(case, (int(rows), int(columns), turn == "T"))
    peaks = records.load("lwf-first-peaks")
    keys = ("case", keys[1], "array_streamwise_m", "array_cross_m")
    for case, turn, deep, wide in zip(*(peaks[k] for k in keys), strict=True):
        edges = (0.1, 0.5) if turn == "T" else (0.5, 0.1)
        found.setdefault(
            case, (round(float(deep) / edges[0]), round(float(wide) / edges[1]), turn == "T")
        )
    return found


#: Layouts of bars by the name that the figure of first peaks gives them.
_LAYOUTS = _layouts()
#: Gauges beside which no box stands: across, m from the centreline.
_BESIDE = 1.3


@value
class LargeWaveFlume(FacilityOfStrips):
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
    USWG1, USWG2           x 39.625, 43.255 m                                  hdro-0021
    USWG3, USWG4           x 44.285 (the drawing has USWG3 beside USWG2),      hdro-0021
                           46.955 m
    ADV                    x 43.255, y 1.3, 0.15 m above the bed               height chosen
    bar                    0.5 × 0.1 × 0.05 m, 981 kg/m³, E 0.8 GPa, ν 0.4     Bonus (2023) 7.3
    field of bars          downstream edge 2.0 m before the box                Bonus (2023) 7.3
    =====================  ==================================================  ====================

    The bed's step at 14.275 m is the drawing's; the published simulation filled it. Drawn slopes
    are taken, not the ramps' ends of the public program (1.15, 1.75, 2.35 m).

    Transfer and cells at walls are what the scene takes that names none, with the box AFLIP 0.99
    and linear cells: at Δx 0.1 m a peak of 396 N where 214 N was measured (`docs/boundaries.md`).
    By name stand linear cells at the moving piston and at the box, and in a slice a bed of held
    nodes: WG1 is off by 2.3 cm rms with it and by 8.8 with linear cells, the rise before the box
    is 0.282 and 0.228 m (measured 0.278), the speed there 0.74 and 1.10 m/s (1.0 to 1.4). Water
    stands in columns.

    Debris shares the velocity of the water at the nodes of the grid, unless `contact` gives it its
    own: bars touch at the start then, as in the experiment, slide and part. Bars have E 4 MPa, half
    of the time step of water with K 2 MPa: the box on its load cells gives way in a blow as well,
    and first peaks of six measured layouts are then off by 20 % in the mean (0.9 MPa: 25 %; one bar
    with 10 MPa: +29 %). `debris_modulus` = None takes E down until pressure waves run through a bar
    as fast as through the water, which keeps the time step and softens single blows.

    Raises `SceneError`.

    Source: Mascarenas (2022); Shekhar et al. (2020); Bonus (2023) chapter 7.
    """

    label: ClassVar[str] = "flumes.LargeWaveFlume"
    short: ClassVar[str] = "lwf"
    title: ClassVar[str] = "OSU Large Wave Flume"
    stations: ClassVar[tuple[float, ...]] = half_metres(20.0, 36.0)
    near: ClassVar[tuple[float, float]] = (27.5, 26.0)
    intervals: ClassVar[dict[str, float]] = {
        "level": 1 / 20, "velocity": 1 / 30, "load": 1 / 1200,
    }  # fmt: skip
    strip_transfer: ClassVar[Transfer | None] = PAST_STRUCTURES
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

    cases: ClassVar[dict[str, tuple[str, dict[str, Any]]]] = {
        "waves": ("laptop", {}),
        "box": ("full", {}),
        **{name: ("full", {"debris": name}) for name in large_wave_flume_rows.COMPARED},
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
        'None, a layout such as "16-L-1.0x0.8" (`records.load("lwf-layouts")`), or ' + FIELD_TEXT,
        default=None,
    )
    bars: Literal["stated", "as-drawn"] = given(
        '"stated" 0.5 × 0.1 × 0.05 m, 981 kg/m³, or "as-drawn" 0.5 × 0.102 × 0.051 m, 969 kg/m³',
        default="stated",
    )
    gap: float | None = given(
        "between the bars of a layout; None = two cells, with `contact` none, as in the experiment",
        default=None, unit="m", low=0,
    )  # fmt: skip
    contact: float | None = given(CONTACT_TEXT, default=None, unit="1", low=0)
    seed: int = given(
        "of shifts of the bars by up to a quarter of a cell; 0 = none", default=0, unit="1", low=0,
        whole=True,
    )  # fmt: skip
    edges: Edges = given("of the box: " + EDGE_TEXT, default="free")
    debris_modulus: float | Literal["measured"] | None = given(
        'E of the bars; "measured" = 0.8 GPa; None = with the wave speed of the water',
        default=4e6, unit="Pa", above=0,
    )  # fmt: skip
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")
    bulk_modulus: float = given(
        "K of the water; 2.2 GPa is water's own", default=2e6, unit="Pa", above=0
    )
    packing: Literal["density", "shifting"] | None = given(PACKING_TEXT, default=None)
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
            if self.width in ("slice", "strip"):
                check.fail(f"structure is 'box' with width {self.width!r}, where it would close "
                           "the flume; expected None; use width='half'")  # fmt: skip
        check.choice("bars", self.bars, tuple(_BARS))
        check.choice("edges", self.edges, EDGES)
        found["seed"] = check.given("seed", self)
        found["debris"] = check_debris(check, self.debris, tuple(_LAYOUTS), self.width)
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
        """Return the flume at rest, its piston about to move.

        Warns of cells in which water was measured to pack: `ModelWarning`.
        """
        axes, h = self.axes, self.cell_size
        if h < _PACKS and self.packing is None:
            warnings.warn(
                f"{self.label}: cell_size is {h:g} m and packing is None: in cells of 0.025 m the "
                "level sank by 10 to 23 cm behind the wave and the load on the box was 0.43 of "
                f"the measured one; expected {_PACKS:g} m or more; use packing='density'",
                ModelWarning, stacklevel=2,
            )  # fmt: skip
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
            fbar=self.water_fbar(),
        )
        made.add_boundary(name="bed", shape=bed, response=self.bed_response())
        reach = max(stroke.value) + 2 * behind
        piston = axes.box((-float(reach), low[1], -1.0), (0.0, high[1], made.upper[-1] + 1.0))
        made.add_boundary(
            name="piston", shape=piston, response=wall(), motion=Displacement(self._along(stroke))
        )
        made.add_boundary(name="walls", shape=DomainWalls(), response=Slip())
        self.add_parts(made)
        return made

    def half_width(self) -> float:
        """Return half of the flume's width on faces of cells, m."""
        return self._half(3.66)

    def add_structures(self, made: Scene) -> None:
        """Add box and debris to a scene of the flume."""
        if self.structure is not None:
            add_structure(made, "box", self.box(), self.edges, half=self.width == "half",
                          contact=self.contact is not None)  # fmt: skip
        if self.debris is not None:
            self._add_debris(made)

    def box(self) -> Box:
        """Return the raised box on faces of cells; with width "half" one half of it."""
        (x, y, z), (u, v, w) = _BOX
        first = 0.0 if self.width == "half" else -self._cells(-y)
        return self.axes.box(
            (self._cells(x), first, self._cells(z)),
            (self._cells(u), self._cells(v), self._cells(w)),
        )

    def instruments(self) -> tuple[Instrument, ...]:
        """Return gauges, the velocimeter, and with the box its load cell; a strip has none."""
        if self.width == "strip":
            return ()
        end = math.inf if self.end is None else self.end
        beside = 0.0 if self.width == "slice" else min(_BESIDE, self._across(3.66)[1] - 0.2)
        gauges = [(n, x) for n, x in _GAUGES if x < end]
        found = [Instrument(n, "level", x, beside, self._bed_at(x)) for n, x in gauges]
        adv = 43.255
        found.append(Instrument("ADV", "velocity", adv, beside, self._bed_at(adv) + 0.15))
        if self.structure is not None:
            share = 2.0 if self.width == "half" else 1.0
            found.append(Instrument("box", "load", _BOX[0][0], 0.0, 2.0, "box", share))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return box and debris from the side."""
        found: list[tuple[str, Pairs]] = [("piston", rectangle(-0.6, 0.0, 0.0, 2.6))]
        if self.structure is not None:
            (x, _, z), (u, _, w) = _BOX
            found.append(("box", rectangle(x, u, z, w)))
        if self.debris is not None:
            field = self.field()
            low = min(p.x for p in field.pieces) - 0.25
            high = max(p.x for p in field.pieces) + 0.25
            z = self.still_water
            found.append(("debris", rectangle(low, high, z - 0.05, z + 0.01)))
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
        rows, columns, turned = _LAYOUTS[self.debris]
        (length, width, height), density = _BARS[self.bars]
        bar = Prototype(
            length=length, width=width, height=height, name="bar",
            material=FixedCorotated(
                density=density, youngs_modulus=self.modulus(), poissons_ratio=_POISSON
            ),
        )  # fmt: skip
        along = width if turned else length
        gap = self._gap()
        deep = rows * along + (rows - 1) * gap
        made = ordered(
            bar, rows=rows, columns=columns, clearance=gap, orientation=90 if turned else 0,
            centre=(_BOX[0][0] - 2.0 - 0.5 * deep, 0.0),
        )  # fmt: skip
        return scattered(made, self.seed, self.cell_size, across=self.width != "half")

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
        add_contacts(made, self.contact)

    # What it is compared with ----------------------------------------------------------------

    def deviations(self) -> tuple[Deviation, ...]:
        """Return where the scene is not the flume."""
        found = [
            Deviation("bulk modulus of water", "2.2e9 Pa", f"{self.bulk_modulus:g} Pa",
                       "longer steps; waves run at a tenth of its sound or less"),
            Deviation("step of the bed", "upright at x 14.275 m", "over 5 mm",
                       "a profile has one height at a place"),
        ]  # fmt: skip
        if self.width != "slice":
            wide = 2 * self._across(3.66)[1]
            found += lengthened("width", 3.66, wide)
        if self.end is not None:
            found.append(Deviation("end", "beach at 87.46 m", f"wall at {self.end:g} m", "cost"))
        if self.structure is not None:
            low, high = self.box().bounds()
            share = 2.0 if self.width == "half" else 1.0
            found += lengthened("box along", 1.016, high[0] - low[0])
            found += lengthened("box across", 1.016, share * (high[1] - low[1]))
            found += lengthened("box up", 0.615, high[2] - low[2])
        if self.debris is not None:
            found.append(softened("bars", _MEASURED_MODULUS, self.modulus()))
            found += self._gap_deviation("bars")
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return rows L1 to L9; those of the box where there is one, of debris with its layout."""
        return large_wave_flume_rows.criteria(self)

    @classmethod
    def joint_rows(cls, comparisons: Sequence[Comparison]) -> list[Row]:
        """Return row L10, the line through first peaks of all layouts with a box plot."""
        return large_wave_flume_rows.parity(comparisons)
