"""`WasedaBasin`: a column of water held by air, a basin, an apron with pieces and columns on it."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, value
from libmpm._src.boundaries.responses import Displacement
from libmpm._src.errors import SceneError
from libmpm._src.flumes import records, waseda_basin_rows
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import add_field, check_debris, lengthened, scattered, track
from libmpm._src.flumes.facility import (
    Deviation,
    Facility,
    Instrument,
    Pairs,
    Width,
    modulus_at_speed,
    rectangle,
    softened,
    wall,
)
from libmpm._src.flumes.structures import (
    BETWEEN_PIECES,
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
from libmpm._src.flumes.virtual_paddle import stroke_of_gauge
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.basin import basin
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.particle_placement import Columns
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Prototype

__all__ = ["WasedaBasin"]

_QUAY, _APRON = 4.45, 0.255
_COLUMN = (0.5, 0.90)  # width and height of the water held by air, m
_SLOT = (0.55, 0.10)  # where its wall ends, and height of the slot under it, m
_GAUGES = (("WG1", -2.60, 0.0), ("WG2", -0.81, -1.75), ("WG3", 0.24, -1.75), ("WG4", 1.70, -1.75))
#: Measured time by which WG1 holds no wave that the quay has sent back, s.
_CLEAN = 3.6
#: Time at which the column is let go in a run, s of the laboratory: valves open by and by.
_VALVES = 0.1
_LAYOUTS = ("3x1-upstream", "3x2-upstream", "3x1-downstream", "3x2-downstream")
#: Debris: edges along, across, up, m; kg/m³.
_PIECE, _DENSITY = (0.06, 0.15, 0.06), 419.0
_STARTS = {"upstream": 0.235, "downstream": 1.94}


@value
class WasedaBasin(Facility):
    """The tsunami basin of Waseda University: column, basin, quay, apron, columns, debris.

    {fields}

    x is 0 at the rear wall of the water column; the quay, zero of the laboratory's Y, is at x 4.45.
    Measured times count from the opening of the valves.

    The column did not fall freely: valves let the air in, and by 3.5 s 0.39 ± 0.04 m² of water have
    passed WG1 where 0.335 stand above the basin's level. `drive` "paddle" replaces it by a virtual
    piston at x 0 that sends what WG1 measured, by the simple wave's characteristics
    (`flumes.stroke_of_gauge`), until 3.6 s; then waves from the quay come back. "column" is the
    free fall of the published simulation.

    =====================  ==============================================  =====================
    what                   value                                           source
    =====================  ==============================================  =====================
    basin                  9.0 m: column 0.5, basin 3.95, apron 4.55;      drawing of hdro-0004
                           4.0 m wide
    apron                  0.255 m above the floor, dry, level             Bonus (2023) S 4076
    still water            0.23 m                                          Bonus (2023) S 4084
    column                 0.90 m, slot 0.10 m under a wall of 0.05 m      Bonus (2023) S 4074
    WG1, WG2, WG3, WG4     Y -2.60, -0.81, 0.24, 1.70 m; across 0, -1.75   Bonus (2023) S 4055
    current meter          Y -0.81, across -1.65, 0.10 m below the apron   Bonus (2023) S 4055
    columns                0.10 × 0.10 × 0.30 m, rows of five, 0.45 m      drawing, public scenes
                           apart, first face Y 0.70
    debris                 0.06 × 0.06 × 0.15 m, long side across, three   Bonus (2023) S 4086
                           across, one or two layers, 419 kg/m³, centre
                           Y 0.235 (downstream 1.94)
    =====================  ==============================================  =====================

    Across, columns are 0.325 m centre to centre in scenes and drawing; the text's clear gap would
    be 0.425: `column_spacing`. The field stands 5 mm off the centreline, or the middle piece hangs
    on the middle column for ever.

    All walls have linear cells by name, in slices too: with those of a scene that names none, which
    holds the face of the quay, the crest at WG3 is 0.096 m at Δx 3 cm (measured 0.14; 0.122 with
    linear ones) and none of 4 rows passes. The transfer is what the scene takes that names none.

    Debris shares the velocity of the water at the nodes of the grid, unless `contact` gives it its
    own: pieces touch at the start then, slide and part. Measured set-ups have it. Friction with the
    apron acts on debris alone. With debris bed and walls let go, the bed with held nodes: off
    `Slip` no water lifts a piece.

    Raises `SceneError`.

    Source: Goseberg et al. (2016); Bonus (2023).
    """

    label: ClassVar[str] = "flumes.WasedaBasin"
    short: ClassVar[str] = "waseda"
    title: ClassVar[str] = "Waseda tsunami basin"
    violent: ClassVar[bool] = True
    stands: ClassVar[bool] = True
    rest: ClassVar[float] = 0.3
    bed_profile: ClassVar[Pairs] = (
        (-2.0, 0.0), (_QUAY, 0.0), (_QUAY + 0.002, _APRON), (9.0, _APRON),
    )  # fmt: skip
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.03},
        "quick": {"width": "slice", "cell_size": 0.02},
        "laptop": {"width": "slice", "cell_size": 0.015},
        "full": {"width": "full", "cell_size": 0.02, "rows": 1, "debris": "3x2-upstream"},
    }

    cases: ClassVar[dict[str, tuple[str, dict[str, Any]]]] = {
        "waves": ("laptop", {}),
        "0x0-up": ("full", {"rows": 0, "debris": "3x2-upstream", "contact": BETWEEN_PIECES}),
        "5x1-up": ("full", {"rows": 1, "debris": "3x2-upstream", "contact": BETWEEN_PIECES}),
        "5x2-up": ("full", {"rows": 2, "debris": "3x2-upstream", "contact": BETWEEN_PIECES}),
        "5x1-down": ("full", {"rows": 1, "debris": "3x2-downstream", "contact": BETWEEN_PIECES}),
        "5x2-down": ("full", {"rows": 2, "debris": "3x2-downstream", "contact": BETWEEN_PIECES}),
    }

    cell_size: float = given("edge Δx of the cells", default=0.015, unit="m", above=0, high=0.05)
    drive: Literal["paddle", "column"] = given(
        '"paddle" is a piston that sends the measured WG1; "column" falls freely', default="paddle"
    )
    still_water_level: float = given("of the basin at rest", default=0.23, unit="m", above=0.1,
                                     high=0.25)  # fmt: skip
    rows: int = given("of five columns on the apron, 0 to 2; a slice has none", default=0,
                      unit="1", low=0, high=2, whole=True)  # fmt: skip
    column_spacing: float = given(
        "of columns across, centre to centre", default=0.325, unit="m", above=0.1, high=0.9
    )
    debris: str | DebrisField | None = given(
        'None, "3x1-upstream", "3x2-upstream", "3x1-downstream", "3x2-downstream" (across × '
        "layers), or a `debris.DebrisField`",
        default=None,
    )
    gap: float | None = given("between pieces; None = two cells, with `contact` none", default=None,
                              unit="m", low=0)  # fmt: skip
    contact: float | None = given(CONTACT_TEXT, default=None, unit="1", low=0)
    uplift: bool = given(UPLIFT_TEXT, default=False)
    seed: int = given(
        "of shifts of the pieces by up to a quarter of a cell; 0 = none", default=0, unit="1",
        low=0, whole=True,
    )  # fmt: skip
    friction: float = given(
        "μ of debris on the apron; `flumes.FRICTION` has 0.4 and 0.25",
        default=friction("hdpe", "plywood", "dry"), unit="1", low=0,
    )  # fmt: skip
    edges: Edges = given("of the columns: " + EDGE_TEXT, default="free")
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")
    bulk_modulus: float = given(
        "K of the water; 2.2 GPa is water's own", default=2e5, unit="Pa", above=0
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        found = self._common(check)
        check.choice("drive", self.drive, ("paddle", "column"))
        for name in ("still_water_level", "column_spacing", "friction", "bulk_modulus", "rows",
                     "seed"):  # fmt: skip
            found[name] = check.given(name, self)
        check.choice("edges", self.edges, EDGES)
        if found["rows"] > 2:
            check.fail(f"rows is {found['rows']}; expected 0, 1 or 2 rows of columns")
        if self.rows and self.width == "slice":
            check.fail(f"rows is {self.rows} with width 'slice', where they would close the apron; "
                       "expected 0; use width='full'")  # fmt: skip
        if self.debris is not None and self.width == "half":
            check.fail("debris with width 'half', but it stands 5 mm off the centreline; expected "
                       "width='full'")  # fmt: skip
        else:
            found["debris"] = check_debris(check, self.debris, _LAYOUTS, self.width)
        return found

    @property
    def still_water(self) -> float:
        """Level of the basin at rest, m."""
        return self.still_water_level

    @property
    def clock(self) -> float:
        """Measured time less time of the run, s; with the paddle its start, before the valves'."""
        if self.drive == "column":
            return _VALVES
        return stroke_of_gauge(*self._gauge(), depth=self.still_water, distance=_QUAY - 2.60,
                               until=_CLEAN)[1]  # fmt: skip

    def _gauge(self) -> tuple[Any, Any]:
        curve = records.load("waseda-waves").curve("WG1")
        return curve.time, curve.change()

    def stroke(self) -> TimeTable:
        """Return the places of the virtual piston, m, from x 0."""
        return stroke_of_gauge(*self._gauge(), depth=self.still_water, distance=_QUAY - 2.60,
                               until=_CLEAN)[0]  # fmt: skip

    def scene(self) -> Scene:
        """Return the basin at rest, the column held or the piston about to move."""
        axes, h = self.axes, self.cell_size
        y = self._across(4.0)
        top = 1.1 if self.drive == "column" else 0.8
        behind = 4 * h if self.drive == "paddle" else 0.0
        made = self._new_scene((-behind, y[0], -2 * h), (9.0, y[1], top))
        wide = (y[0] - 0.5, y[1] + 0.5)
        bed = axes.bed((*self.bed_profile[:-1], (9.5, _APRON)), wide)
        front = 0.0 if self.drive == "paddle" else self._cells(_COLUMN[0])
        box = axes.box((front, y[0], -0.1), (_QUAY, y[1], top))
        fluid = TaitFluid(bulk_modulus=self.bulk_modulus)
        water = basin(level=self.still_water, bed=bed, within=box)
        slot = [self._cells(x) for x in _SLOT]
        above = axes.box((front, y[0], slot[1]), (slot[0], y[1], made.upper[-1]))
        made.add_body(
            name="water", shape=water - above if self.drive == "column" else water, material=fluid,
            hydrostatic=self.still_water, sampling=Columns(),
        )  # fmt: skip
        made.add_boundary(name="bed", shape=bed, response=self.bed_response())
        made.add_boundary(name="walls", shape=DomainWalls(), response=self._wall())
        if self.drive == "paddle":
            stroke = self.stroke()
            reach = float(max(stroke.value)) + 4 * behind
            piston = axes.box((-reach, wide[0], -0.5), (0.0, wide[1], top + 0.5))
            made.add_boundary(name="piston", shape=piston, response=wall(),
                              motion=Displacement(self._along(stroke)))  # fmt: skip
        else:
            made.add_body(
                name="column", material=fluid, hydrostatic=_COLUMN[1],
                shape=axes.box((0.0, y[0], 0.0), (front, y[1], _COLUMN[1])),
            )  # fmt: skip
            made.add_boundary(name="slot", response=self._wall(), shape=above)
        for name, low, high in self._columns():
            add_structure(made, name, axes.box(low, high), self.edges, half=self.width == "half",
                          contact=self.contact is not None)  # fmt: skip
        if self.debris is not None:
            names = add_field(made, self.field(), elevation=_APRON)
            track(made, names, 1 / 30)
            add_bed_friction(made, bed, dict.fromkeys(names, self.friction), "apron-friction",
                             uplift=self.uplift)  # fmt: skip
            add_contacts(made, self.contact)
        for one in self.instruments():
            if one.kind == "level":
                sensor: Any = axes.gauge(one.x, one.y, one.z, 1 / 50, max(0.03, h),
                                         None if self.drive == "column" else "water")  # fmt: skip
            elif one.kind == "velocity":
                sensor = axes.probe(one.x, one.y, one.z, 1 / 50)
            else:
                sensor = LoadCell(boundary=one.boundary, interval=1 / 500)
            made.add_sensor(name=one.name, sensor=sensor)
        return made

    def _columns(self) -> list[tuple[str, tuple[float, ...], tuple[float, ...]]]:
        """Return names and corners of the columns, on faces of cells."""
        found = []
        for row in range(self.rows):
            x = _QUAY + 0.70 + 0.45 * row
            for k in range(5):
                middle = (k - 2) * self.column_spacing
                low = (x, middle - 0.05, self._cells(_APRON) - 2 * self.cell_size)
                high = (x + 0.10, middle + 0.05, _APRON + 0.30)
                first = tuple(self._cells(a) for a in low)
                if self.width == "half":
                    first = (first[0], max(first[1], 0.0), first[2])
                last = tuple(self._cells(a) for a in high)
                if last[1] > first[1]:
                    found.append((f"column-{row + 1}-{k + 1}", first, last))
        return found

    def field(self) -> DebrisField:
        """Return the pieces as a field of the plan; raises `SceneError` where there are none."""
        if isinstance(self.debris, DebrisField):
            return self.debris
        if self.debris is None:
            raise SceneError(f"{self.label}: debris is None; expected one of {', '.join(_LAYOUTS)}")
        number, place = self.debris.split("-")
        along, across, up = _PIECE
        piece = Prototype(
            length=across, width=along, height=up, name="piece",
            material=FixedCorotated(
                density=_DENSITY, poissons_ratio=0.4,
                youngs_modulus=modulus_at_speed(
                    _DENSITY, 0.4, math.sqrt(self.bulk_modulus / 1000.0)
                ),
            ),
        )  # fmt: skip
        gap = self._gap()
        made = ordered(
            piece, rows=1, columns=3, layers=int(number[2]), clearance=(gap, gap, 0.0),
            orientation=90, centre=(_QUAY + _STARTS[place], 0.005),
        )  # fmt: skip
        return scattered(made, self.seed, self.cell_size)

    def instruments(self) -> tuple[Instrument, ...]:
        """Return gauges, current meter, and with columns their load cells."""
        found = []
        limit = self._across(4.0)[1] - 2 * self.cell_size

        def across(y: float) -> float:
            if self.width == "slice":
                return 0.0
            return min(abs(y), limit) if self.width == "half" else max(y, -limit)

        for name, along, y in _GAUGES:
            found.append(
                Instrument(name, "level", _QUAY + along, across(y), self._bed_at(_QUAY + along))
            )
        found.append(Instrument("current", "velocity", _QUAY - 0.81, across(-1.65), _APRON - 0.10))
        for name, low, high in self._columns():
            middle = 0.5 * (low[1] + high[1])
            share = 2.0 if self.width == "half" and low[1] <= 0 else 1.0
            found.append(Instrument(name, "load", low[0], middle, _APRON, name, share))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return column or piston, obstacles and debris from the side."""
        found: list[tuple[str, Pairs]] = []
        if self.drive == "column":
            found.append(("column", ((0.0, 0.0), (0.5, 0.0), (0.5, 0.9), (0.0, 0.9))))
            found.append(("slot", ((0.5, 0.1), (0.55, 0.1), (0.55, 1.0), (0.5, 1.0))))
        else:
            found.append(("piston", ((-0.2, 0.0), (0.0, 0.0), (0.0, 0.6), (-0.2, 0.6))))
        for row in range(self.rows):
            x, z = _QUAY + 0.70 + 0.45 * row, _APRON
            found.append(
                (f"row {row + 1}", ((x, z), (x + 0.1, z), (x + 0.1, z + 0.3), (x, z + 0.3)))
            )
        if self.debris is not None:
            x, z = self.field().pieces[0].x, _APRON
            found.append(("debris", rectangle(x - 0.03, x + 0.03, z, z + 0.06)))
        return tuple(found)

    def deviations(self) -> tuple[Deviation, ...]:
        """Return where the scene is not the basin."""
        found = [
            Deviation("bulk modulus of water", "2.2e9 Pa", f"{self.bulk_modulus:g} Pa",
                       "longer steps"),
            Deviation("drive", "air let in by valves",
                       "piston that sends WG1" if self.drive == "paddle" else "free column",
                       "no pressure of air on a surface"),
            Deviation("friction of water on the apron", "rough plywood", "none",
                       "no bed drag: the film at WG4 runs too deep and too far"),
        ]  # fmt: skip
        if self.width != "slice":
            found += lengthened("width", 4.0, 2 * self._across(4.0)[1])
        for row in range(self.rows):
            face = 0.70 + 0.45 * row
            moved = round(self._cells(_QUAY + face) - _QUAY, 9)
            found += lengthened(f"face of row {row + 1}", face, moved)
        if self.rows:
            low, high = self._columns()[-1][1:]
            found += lengthened("columns across", 0.10, round(high[1] - low[1], 9))
        if self.debris is not None:
            modulus = self.field().prototypes[0].material.parameters()["youngs_modulus"]
            found.append(softened("debris", 1e9, modulus))
            found += self._gap_deviation("pieces")
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return rows T1 to T3, with debris T4 to T7, with columns T8."""
        return waseda_basin_rows.criteria(self)
