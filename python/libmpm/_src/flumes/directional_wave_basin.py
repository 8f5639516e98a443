"""`DirectionalWaveBasin`: a channel of the Directional Wave Basin, blocks on its platform."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, value
from libmpm._src.boundaries.responses import Displacement
from libmpm._src.boundaries.wave_makers import piston_stroke
from libmpm._src.errors import SceneError
from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.comparison import Comparison, Row
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import (
    FIELD_TEXT,
    add_field,
    carried_speed,
    check_debris,
    displacement,
    lengthened,
    scattered,
    track,
    upper_half,
    width_across,
)
from libmpm._src.flumes.facility import (
    PACKING_TEXT,
    Deviation,
    Instrument,
    Pairs,
    Width,
    modulus_at_speed,
    softened,
    wall,
)
from libmpm._src.flumes.near_field import FacilityOfStrips, half_metres
from libmpm._src.flumes.structures import (
    CONTACT_TEXT,
    EDGE_TEXT,
    EDGES,
    UPLIFT_TEXT,
    Edges,
    add_bed_friction,
    add_contacts,
    add_structure,
    friction,
)
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.scene.scene import Scene
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.shapes.prisms import Extrusion
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Prototype

__all__ = ["DirectionalWaveBasin"]

#: Density of the blocks, kg/m³ (Bonus 2023, chapter 8).
_BLOCKS = {"hdpe": 987.0, "wood": 648.0}
#: Two places on the platform between which the speed of the front is measured, x, m.
_FRONT = (("front-1", 32.0), ("front-2", 35.0))
_SIZE = (0.102, 0.102, 0.051)
_EDGE, _PLATFORM = 31.29, 1.0
#: From before water has come to the platform to the end of its rows, s of the laboratory.
_LANDED = (29.0, 38.0)
_GAP = 0.051
_GAUGES = (
    ("WG1", 14.05, -3.6), ("WG2", 14.05, 0.0), ("WG4", 14.3, 0.0), ("WG5", 14.9, 0.0),
    ("WG6", 15.4, 0.0), ("WG7", 16.7, 0.0), ("WG9", 19.25, 2.5), ("USWG5", 28.30, 0.0),
    ("USWG-h5", 35.55, 0.0),
)  # fmt: skip


@value
class DirectionalWaveBasin(FacilityOfStrips):
    """The channel in the OSU Directional Wave Basin: wave, ramp, platform, blocks.

    {fields}

    x is that of the basin, 0 at the wave maker; y 0 is the channel's centreline. Measured time =
    time of the run + 11.3 s (± 0.15): half of WG1's crest at 22.55 s. Waves from the side channels
    arrive 10 s after the crest and are not in the scene: compare before.

    =====================  ==============================================  ====================
    what                   value                                           source
    =====================  ==============================================  ====================
    channel                between walls at y ± 5 m                        drawing of hdro-0006
    bed (x, z), m          (0, 0) (11.29, 0) (31.29, 1.0) (41.29, 1.0),    Bonus (2023) 8
                           then a pit
    still water            0.87 m                                          Bonus (2023) 8
    stroke                 1 + erf 0.2667 (t - 9.907) m                    public file
    WG1, WG2, WG4          x 14.05 (y -3.6), 14.05, 14.3 m                 drawing of hdro-0006;
    WG5, WG6, WG7, WG9     x 14.9, 15.4, 16.7, 19.25 m (y 2.5)             y 0 where none is here
    front-1, front-2       x 32.0, 35.0 m: speed of the front, row B4      chosen
    USWG5, USWG-h5         x 28.30, 35.55 m                                public scenes
    blocks                 10.2 × 10.2 × 5.1 cm, 5 across × 4 along, gaps  Bonus (2023) 8
                           5.1 cm, seaward edge 31.29 m
    HDPE, wood             987, 648 kg/m³                                  Bonus (2023) 8
    friction, wet (dry)    HDPE 0.38 (0.66), wood 0.71 (1.28)              Bonus (2023) 8
    obstacles              two of 0.4 × 0.4 × 0.3 m, x 35.29, y -0.6, 0.2  Bonus (2023) 8
    =====================  ==============================================  ====================

    The published simulation took dry friction, which is too much for what lies in water: wet is the
    default here. The flow on the platform is about 3 cm deep: cells of 2.5 cm hold one of it.

    Transfer and cells at walls are what the scene takes that names none; by name stand linear cells
    at the moving piston and at obstacles, and in a slice a bed of held nodes: at Δx 0.1 m WG1 is
    off by 1.2 cm rms with it and by 2.7 with linear cells, 5 and 3 of 6 rows pass. Volumes are led
    by density (`packing`): without, water packs from the toe of the ramp on, the more the finer the
    cells, and WG1 is off by 3.6 cm in cells of 0.025 m, by 0.4 cm with it. In space crests are then
    13 to 15 % too high; the level "full" shifts particles.

    Blocks share the velocity of the water at the nodes of the grid, unless `contact` gives them
    their own: they slide past each other and part then, and water goes between them. Beside contact
    nothing keeps water from packing, and in a run of the whole channel the wave does not reach the
    platform: take a near field, whose strip has `packing`. Friction with the platform acts on
    blocks alone, each kind with its own (`flumes.FRICTION`): pieces of a custom field are of the
    kind that their prototype is named after, others need a number. Under blocks the bed lets go,
    with held nodes: off `Slip` no water lifts one; water below them takes its part of their weight
    (`uplift`, one rank).

    `near_field` begins at 28.5 s, before water has come to the platform, and at x 22 m, and needs
    `width` "half". Its bed is that under blocks, which a strip has too, and its transfer that of
    the channel without obstacles, also with them: past obstacles the channel has another one. Of
    B1 to B3 it has rows of USWG-h5 alone.

    Raises `SceneError`.

    Source: Park et al. (2021); Bonus (2023) chapter 8.
    """

    label: ClassVar[str] = "flumes.DirectionalWaveBasin"
    short: ClassVar[str] = "dwb"
    title: ClassVar[str] = "OSU Directional Wave Basin"
    stands: ClassVar[bool] = True
    stations: ClassVar[tuple[float, ...]] = half_metres(18.0, 28.0)
    near: ClassVar[tuple[float, float]] = (28.5, 22.0)
    intervals: ClassVar[dict[str, float]] = {
        "level": 1 / 20, "velocity": 1 / 20, "load": 1 / 1000,
    }  # fmt: skip
    clock_offset: ClassVar[float] = 11.3
    bed_profile: ClassVar[Pairs] = (
        (-4.0, 0.0), (11.29, 0.0), (31.29, 1.0), (41.29, 1.0), (41.3, 0.0), (48.0, 0.0),
    )  # fmt: skip
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.15},
        "quick": {"width": "slice", "cell_size": 0.1},
        "laptop": {"width": "slice", "cell_size": 0.05},
        "full": {"width": "half", "cell_size": 0.025, "channel": 2.0, "packing": "shifting"},
    }

    cases: ClassVar[dict[str, tuple[str, dict[str, Any]]]] = {
        "waves": ("laptop", {}),
        "platform": ("full", {}),
        "hdpe": ("full", {"debris": "hdpe", "width": "full"}),
        "wood": ("full", {"debris": "wood", "width": "full"}),
    }

    cell_size: float = given("edge Δx of the cells", default=0.05, unit="m", above=0, high=0.3)
    still_water_level: float = given("level at rest", default=0.87, unit="m", above=0.2, high=1.5)
    wave: Literal["measured"] | TimeTable = given(
        '"measured" is the stroke of the table; or a `TimeTable` of places of the piston, m',
        default="measured",
    )
    debris: str | DebrisField | None = given(
        'None, "hdpe" or "wood": 5 × 4 blocks, "mixed": both in turns, row by row and column by '
        "column, or " + FIELD_TEXT,
        default=None,
    )
    gap: float | None = given(
        "between blocks; None = 5.1 cm, or two cells if that is more and there is no `contact`",
        default=None, unit="m", low=0,
    )  # fmt: skip
    contact: float | None = given(CONTACT_TEXT, default=None, unit="1", low=0)
    friction: Literal["wet", "dry"] | float = given(
        'of blocks on the platform: "wet" or "dry" values of each kind, or one μ for all',
        default="wet", unit="1", low=0,
    )  # fmt: skip
    uplift: bool = given(UPLIFT_TEXT, default=True)
    seed: int = given(
        "of shifts of the blocks by up to a quarter of a cell; 0 = none", default=0, unit="1",
        low=0, whole=True,
    )  # fmt: skip
    structure: Literal["boxes"] | None = given(
        'the two obstacles, "boxes", or None; a slice has none', default=None
    )
    edges: Edges = given("of the obstacles: " + EDGE_TEXT, default="free")
    channel: float = given(
        "width of the strip about the centreline, in space", default=10.0, unit="m",
        above=0.5, high=10.0,
    )  # fmt: skip
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")
    bulk_modulus: float = given(
        "K of the water; 2.2 GPa is water's own", default=1e6, unit="Pa", above=0
    )
    packing: Literal["density", "shifting"] | None = given(PACKING_TEXT, default="density")

    def _check(self, check: Checker) -> dict[str, Any]:
        found = self._common(check)
        for name in ("still_water_level", "channel", "bulk_modulus"):
            found[name] = check.given(name, self)
        if not isinstance(self.wave, TimeTable):
            check.choice("wave", self.wave, ("measured",))
        elif self.wave.components or self.wave.end == "zero":
            check.fail("wave is a TimeTable of vectors, or one that ends with 'zero'; expected "
                       "places of the piston along x in m that hold their end")  # fmt: skip
        if isinstance(self.friction, str):
            check.choice("friction", self.friction, ("wet", "dry"))
        else:
            found["friction"] = check.given("friction", self)
        check.choice("edges", self.edges, EDGES)
        found["seed"] = check.given("seed", self)
        found["debris"] = check_debris(check, self.debris, (*_BLOCKS, "mixed"), self.width)
        if isinstance(found["debris"], DebrisField) and isinstance(self.friction, str):
            odd = {p.name for p in found["debris"].prototypes} - set(_BLOCKS)
            if odd:
                check.fail(f"friction is {self.friction!r} with prototypes named "
                           f"{', '.join(sorted(map(repr, odd)))}; expected names 'hdpe' or 'wood', "
                           "or a number for all")  # fmt: skip
        if self.structure is not None:
            check.choice("structure", self.structure, ("boxes",))
            if self.width in ("slice", "strip"):
                check.fail(f"structure is 'boxes' with width {self.width!r}, where they would "
                           "close the channel; expected None; use width='full'")  # fmt: skip
        return found

    @property
    def still_water(self) -> float:
        """Level of the water at rest, m."""
        return self.still_water_level

    def stroke(self) -> TimeTable:
        """Return the places of the piston, m, from where it starts."""
        if isinstance(self.wave, TimeTable):
            time, place = self.wave.arrays()
        else:
            time, place = piston_stroke(2.0, 0.2667, 9.907, until=40.0, dt=1 / 60).arrays()
            place = place[:, 0]
        return TimeTable(time, place - place[0])

    def scene(self) -> Scene:
        """Return the channel at rest, its piston about to move."""
        axes, h = self.axes, self.cell_size
        y = self._across(self.channel)
        behind = max(0.6, 4 * h)
        stroke = self.stroke()
        made = self._new_scene((-behind, y[0], -2 * h), (47.0, y[1], self.still_water + 0.8))
        wide = (y[0] - 1.0, y[1] + 1.0)
        before = [p for p in self.bed_profile if p[0] <= _EDGE]
        # The pit behind the platform is dry at the start.
        land = axes.bed((*before, (48.0, _PLATFORM)), wide)
        box = axes.box((0.0, y[0], -1.0), (_EDGE, y[1], made.upper[-1]))
        made.add_body(
            name="water",
            shape=basin(level=self.still_water, bed=land, within=box),
            material=TaitFluid(bulk_modulus=self.bulk_modulus),
            hydrostatic=self.still_water,
            sampling=Columns(),
            fbar=self.water_fbar(),
        )
        made.add_boundary(name="bed", shape=self._bed(), response=self.bed_response())
        reach = float(max(stroke.value)) + 2 * behind
        piston = axes.box((-reach, wide[0], -1.0), (0.0, wide[1], made.upper[-1] + 1.0))
        made.add_boundary(
            name="piston", shape=piston, response=wall(), motion=Displacement(self._along(stroke))
        )
        made.add_boundary(name="walls", shape=DomainWalls(), response=self._wall())
        self.add_parts(made)
        return made

    def half_width(self) -> float:
        """Return half of the channel's width on faces of cells, m."""
        return self._half(self.channel)

    def add_structures(self, made: Scene) -> None:
        """Add obstacles and blocks to a scene of the channel."""
        if self.structure is not None:
            for k, side in self._obstacles():
                low = [self._cells(a) for a in (35.29, side, _PLATFORM)]
                high = [self._cells(a) for a in (35.69, side + 0.4, _PLATFORM + 0.3)]
                add_structure(made, f"box-{k}", self.axes.box(low, high), self.edges,
                              contact=self.contact is not None)  # fmt: skip
        if self.debris is not None:
            self._add_debris(made)

    def _bed(self) -> Extrusion:
        """Return what lies below the channel, wider than the scene."""
        y = self._across(self.channel)
        return self.axes.bed(self.bed_profile, (y[0] - 1.0, y[1] + 1.0))

    def _add_debris(self, made: Scene) -> None:
        field = self.field()
        names = add_field(made, field, elevation=_PLATFORM, half=self.width == "half")
        track(made, names)
        pieces = upper_half(field) if self.width == "half" else field.pieces
        kinds = [field.prototypes[p.prototype].name for p in pieces]
        rubs = {
            name: float(self.friction) if not isinstance(self.friction, str)
            else friction(kind, "concrete", self.friction)
            for name, kind in zip(names, kinds, strict=True)
        }  # fmt: skip
        add_bed_friction(made, self._bed(), rubs, "platform-friction", uplift=self.uplift)
        add_contacts(made, self.contact)

    def _obstacles(self) -> tuple[tuple[int, float], ...]:
        """Return numbers of the obstacles and their lower y, m; half of the channel has one."""
        return ((2, 0.2),) if self.width == "half" else ((1, -0.6), (2, 0.2))

    def field(self) -> DebrisField:
        """Return the blocks as a field of the plan; raises `SceneError` where there are none."""
        if isinstance(self.debris, DebrisField):
            return self.debris
        if self.debris is None:
            raise SceneError(f"{self.label}: debris is None; expected 'hdpe' or 'wood'")
        names = tuple(_BLOCKS) if self.debris == "mixed" else (self.debris,)
        blocks = [
            Prototype(
                length=_SIZE[0], width=_SIZE[1], height=_SIZE[2], name=name,
                material=FixedCorotated(
                    density=_BLOCKS[name], poissons_ratio=0.4,
                    youngs_modulus=modulus_at_speed(
                        _BLOCKS[name], 0.4, math.sqrt(self.bulk_modulus / 1000.0)
                    ),
                ),
            )
            for name in names
        ]  # fmt: skip
        gap = self._gap(_GAP)
        deep = 4 * _SIZE[0] + 3 * gap
        made = ordered(blocks, rows=4, columns=5, clearance=gap, centre=(_EDGE + 0.5 * deep, 0.0))
        return scattered(made, self.seed, self.cell_size, across=self.width != "half")

    def instruments(self) -> tuple[Instrument, ...]:
        """Return the gauges and a probe of the flow, with obstacles their load cells.

        A strip has none.
        """
        if self.width == "strip":
            return ()
        half = 0.5 if self.width == "slice" else self._across(self.channel)[1] - 2 * self.cell_size
        found = []
        for name, x, y in _GAUGES:
            across = 0.0 if self.width == "slice" else min(abs(y), half)
            if self.width == "full":
                across = math.copysign(across, y) if y else 0.0
            if self.width == "half":
                across = max(across, self.cell_size)
            found.append(Instrument(name, "level", x, across, self._bed_at(x)))
        middle = 0.0 if self.width != "half" else self.cell_size
        found += [Instrument(name, "level", x, middle, _PLATFORM) for name, x in _FRONT]
        # Half-way up the flow of some 3 cm, or in the lowest cell.
        up = _PLATFORM + max(0.015, 0.5 * self.cell_size)
        found.append(Instrument("platform", "velocity", 33.0, middle, up))
        if self.structure is not None:
            found += [Instrument(f"box-{k}", "load", 35.29, y + 0.2, 1.0, f"box-{k}")
                      for k, y in self._obstacles()]  # fmt: skip
        return tuple(sorted(found, key=lambda i: i.x))

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return piston, obstacles and blocks from the side."""
        found: list[tuple[str, Pairs]] = [
            ("piston", ((-0.4, 0.0), (0.0, 0.0), (0.0, 1.4), (-0.4, 1.4)))
        ]
        if self.structure is not None:
            found.append(("boxes", ((35.29, 1.0), (35.69, 1.0), (35.69, 1.3), (35.29, 1.3))))
        if self.debris is not None:
            pieces = self.field().pieces
            low, high = (f(p.x for p in pieces) for f in (min, max))
            found.append(("blocks", ((low, 1.0), (high, 1.0), (high, 1.05), (low, 1.05))))
        return tuple(found)

    def deviations(self) -> tuple[Deviation, ...]:
        """Return where the scene is not the basin."""
        found = [
            Deviation("bulk modulus of water", "2.2e9 Pa", f"{self.bulk_modulus:g} Pa",
                       "longer steps"),
            Deviation("side channels", "open", "none", "their waves come 10 s after the crest"),
            Deviation("pit behind the platform", "level not stated", "dry at the start",
                       "what falls into it does not come back in time"),
        ]  # fmt: skip
        if self.structure is not None:
            for what, edge in (("front", 35.29), ("rear", 35.69), ("side", 0.2), ("side", 0.6)):
                found += lengthened(f"obstacles' {what}", edge, round(self._cells(edge), 9))
        if self.width == "slice":
            found.append(Deviation("gauges across", "y -3.6 to 2.5 m", "on one line", "a slice"))
        else:
            there = {name: y for name, _, y in _GAUGES}
            moved = [i.name for i in self.instruments() if abs(i.y - there.get(i.name, i.y)) > 1e-9]
            if moved:
                found.append(Deviation("across, " + ", ".join(moved), "of the table",
                                        "within the strip", "the wave is plane"))  # fmt: skip
        if self.width != "slice":
            found += lengthened("width", 10.0, 2 * self._across(self.channel)[1])
        if self.debris is not None:
            kind = self.field()
            modulus = kind.prototypes[0].material.parameters()["youngs_modulus"]
            found.append(softened("blocks", 1e9, modulus))
            found += self._gap_deviation("blocks", _GAP)
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return rows B1 to B4, with blocks B5 to B7."""
        record = records.load("dwb-waves")
        coarse = self.cell_size >= 0.045
        window = (11.3, 30.0)
        share = 0.18 if coarse else 0.12
        found = []
        for name, off, high, half, top in (
            ("WG1", "0.0073", "+18 %", 22.55, 0.086), ("WG9", "0.0054", "+10 %", 24.48, 0.095),
        ):  # fmt: skip
            found += [
                Criterion("B1", f"rms of the level, {name}", "m", (name,), window,
                          measures.rms(name, record.curve(name), window), 0.0, 0.0, 0.010,
                          "≤ 0.01 m", off),
                Criterion("B2", f"crest, {name}", "m", (name,), window,
                          measures.crest(name, window), published=high,
                          **measures.within(top, share)),
                Criterion("B2", f"half of the crest, {name}", "s", (name,), window,
                          measures.half_crest(name, window), published="-0.05 s",
                          **measures.near(half, 0.3, "s")),
            ]  # fmt: skip
        later = (11.3, 38.0)
        held: dict[str, Any] = {"gates": False, "held_out": True}
        for name, high, late, limit, span in (
            ("USWG5", "-4 %", "", 0.015, later),
            ("USWG-h5", "-18 %", "1.5 s late", 0.005, _LANDED),
        ):
            found += [
                Criterion("B3", f"crest, {name}", "m", (name,), span, measures.crest(name, span),
                          tolerance="± 20 %", published=high, **held),
                Criterion("B3", f"arrival of 1 cm, {name}", "s", (name,), span,
                          measures.arrival(name, 0.01, span), tolerance="± 0.5 s",
                          published=late, **held),
                Criterion("B3", f"rms of the level, {name}", "m", (name,), span,
                          measures.rms_of(name, span), 0.0, 0.0, limit, f"≤ {limit:g} m",
                          gates=False, curve=name),
            ]  # fmt: skip
        found.append(Criterion(
            "B4", "front of the flow on the platform", "m/s", tuple(n for n, _ in _FRONT), _LANDED,
            _front, gates=self.cell_size <= 0.0125, **measures.within(1.4, 0.15),
        ))  # fmt: skip
        if isinstance(self.debris, str) and self.debris in _BLOCKS:
            found += self._debris_rows()
        return tuple(found)

    def _debris_rows(self) -> list[Criterion]:
        """Return rows B5 or B6 and B7 of blocks of one kind."""
        needs, window = ("debris-01",), _LANDED
        speed, row = (0.7, "B5") if self.debris == "hdpe" else (1.0, "B6")
        found = [
            Criterion(row, f"mean speed of {self.debris} while carried", "m/s", needs, window,
                      carried_speed, **measures.within(speed, 0.25)),
            Criterion("B6", f"way of {self.debris}, median", "m", needs, window, displacement,
                      tolerance="wood farther than hdpe", gates=False),
        ]  # fmt: skip
        if self.debris == "hdpe" and self.width == "full":
            found += [
                Criterion("B7", f"width of the field {after:g} s on, in blocks", "1", needs, window,
                          width_across(after, _SIZE[1], 5), gates=False,
                          **measures.within(wide, 0.30))
                for after, wide in ((0.5, 6.3), (1.0, 8.6))
            ]  # fmt: skip
        return found

    @classmethod
    def joint_rows(cls, comparisons: Sequence[Comparison]) -> list[Row]:
        """Return row B6, that wood goes farther than HDPE."""
        ways = {
            row.quantity.split()[2].rstrip(","): row.simulated
            for one in comparisons for row in one.rows
            if row.quantity.startswith("way of ") and row.simulated is not None
        }  # fmt: skip
        more, verdict = None, "not run"
        if len(ways) == len(_BLOCKS):
            more = ways["wood"] - ways["hdpe"]
            verdict = "passed" if more > 0 else "failed"
        return [Row("B6", "way of wood less that of HDPE", "m", None, more, "> 0", "order only",
                    verdict, "hdpe, wood")]  # fmt: skip


def _front(signals: measures.Signals) -> float:
    """Return the speed of the front between two places on the platform, m/s.

    It has come where the level is 5 mm over the platform.
    """
    (first, x), (second, u) = _FRONT
    start, time = (measures.arrival(n, 0.005, _LANDED)(signals) for n in (first, second))
    return (u - x) / (time - start) if time > start else math.nan
