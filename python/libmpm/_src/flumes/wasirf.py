"""`WASIRF`: the flume of the University of Washington with a pump, a raised box, and debris."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, value
from libmpm._src.boundaries.flows import Inflow, Outflow
from libmpm._src.boundaries.responses import Prescribed, Slip
from libmpm._src.errors import SceneError
from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.comparison import Comparison, Row
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import (
    FIELD_TEXT,
    add_field,
    check_debris,
    lengthened,
    scattered,
    track,
)
from libmpm._src.flumes.facility import (
    Deviation,
    Facility,
    Instrument,
    Pairs,
    Width,
    modulus_at_speed,
    rectangle,
    softened,
)
from libmpm._src.flumes.structures import (
    EDGE_TEXT,
    EDGES,
    Edges,
    add_contacts,
    add_structure,
    structure_solid,
)
from libmpm._src.materials.generated import FixedCorotated, TaitFluid
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell
from libmpm._src.shapes.boxes import Box, DomainWalls
from libmpm._src.shapes.solid import Solid
from libmpm._src.studies.debris.field import DebrisField
from libmpm._src.studies.debris.ordered import ordered
from libmpm._src.studies.debris.prototype import Prototype

__all__ = ["WASIRF"]

_WIDTH, _LENGTH = 0.9, 12.2
#: Box: front, edges along, across, up, m.
_FRONT, _BOX = 8.0, (0.254, 0.254, 0.152)
#: How far debris is released before the box; the pump's ends before and behind that, m.
_AWAY, _BEFORE, _BEHIND = 0.8, 2.0, 3.0
_DENSITY, _POISSON = 981.0, 0.4
#: HDPE prisms: length, width, height, m.
_PIECES = {
    "A": (0.0508, 0.0254, 0.0127), "B": (0.1016, 0.0254, 0.0254), "C": (0.1016, 0.1016, 0.0254),
    "D": (0.1524, 0.0254, 0.0127), "E": (0.2032, 0.0254, 0.0254), "F": (0.2540, 0.0254, 0.0127),
    "G": (0.3048, 0.0254, 0.0127), "H": (0.3810, 0.1016, 0.0254), "I": (0.3810, 0.1016, 0.0508),
}  # fmt: skip
#: Bars of the Large Wave Flume at 1:4, rows × columns.
_BARS = {"8-L": (2, 4), "24-L": (3, 8)}
_SCALE = 4.0
#: Load of the wave alone on the box of the Large Wave Flume, N, its level above the underside
#: and its speed at 1:4.
_LWF_LOAD, _LWF_DEPTH, _LWF_SPEED = 214.4, 0.07, 0.65
#: Largest difference of two scales that counts as none.
_ALIKE = 0.01
#: Range of the drag coefficient of the box.
_DRAG = (0.8, 1.45)


@value
class WASIRF(Facility):
    """The UW Washington Air-Sea Interaction Research Facility: a current, a raised box, debris.

    {fields}

    x is that of the working part, with the box's front at 8.0 m as in the public scene; y 0 is the
    centreline. There is **no public record**: the scene is held to laws, and to the loads of the
    Large Wave Flume at 1:4 by Froude, of which the box is a model: speed 1.3/2 = 0.65 m/s, depth
    0.278/4 = 0.07 m over the underside, forces × 64. Times are those of the run.

    =====================  ==============================================  ====================
    what                   value                                           source
    =====================  ==============================================  ====================
    flume                  12.2 m of 18 m used, 0.9 m wide, 1.2 m high;    Bonus (2023) 9.3
                           depth ≤ 0.75 m, speed ≤ 0.6 m/s
    box                    0.254 × 0.254 × 0.152 m, underside adjustable   Bonus (2023) 9.3
    debris A to I          HDPE prisms of 0.0508 to 0.381 m                Bonus (2023) table 9.3,
                                                                           its lengths × 10
    release                0.8 m before the box, at rest, half a cell      Bonus (2023) 9.3
                           above the water
    pump                   holds u from the inlet to 2 m before the        Bonus (2023) 9.3
                           debris, and from 3 m behind the box on
    =====================  ==============================================  ====================

    Table 9.3 prints model lengths ten times too small (0.0102 for 0.1016 m). Box level and depths
    of its table 9.2 are the Large Wave Flume's; public scenes run at 1.0 m/s, beyond the flume.
    Depth 0.20 m and underside 0.15 m are chosen here.

    Water comes in at `start` by an inflow at the still level and leaves through the far end with
    the same speed; it moves from the beginning. Transfer and cells at walls are what the scene
    takes that names none, but for linear cells at the box. No drag of bed and walls, no turbulence,
    no wind.

    Debris shares the velocity of the water at the nodes of the grid. `contact` gives pieces their
    own against each other; water moves with both, since a contact with it is refused beside an
    inflow.

    Raises `SceneError`.

    Source: Bonus (2023) 9.3.
    """

    label: ClassVar[str] = "flumes.WASIRF"
    short: ClassVar[str] = "wasirf"
    title: ClassVar[str] = "UW WASIRF"
    bed_profile: ClassVar[Pairs] = ((0.0, 0.0), (_LENGTH, 0.0))
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.05},
        "quick": {"width": "slice", "cell_size": 0.04},
        "laptop": {"width": "slice", "cell_size": 0.025},
        "full": {"width": "half", "cell_size": 0.0125, "structure": "box"},
    }

    cases: ClassVar[dict[str, tuple[str, dict[str, Any]]]] = {
        "current": ("laptop", {}),
        "box": ("full", {}),
        "lwf-box": ("full", {"speed": _LWF_SPEED, "still_water_level": 0.15 + _LWF_DEPTH}),
        "8-L": ("full", {"speed": _LWF_SPEED, "still_water_level": 0.15 + _LWF_DEPTH,
                         "debris": "8-L"}),
        "24-L": ("full", {"speed": _LWF_SPEED, "still_water_level": 0.15 + _LWF_DEPTH,
                          "debris": "24-L"}),
    }  # fmt: skip

    cell_size: float = given("edge Δx of the cells", default=0.025, unit="m", above=0, high=0.05)
    speed: float = given("u of the current", default=0.6, unit="m/s", above=0, high=1.0)
    still_water_level: float = given("depth of the water", default=0.20, unit="m", above=0.05,
                                     high=0.75)  # fmt: skip
    underside: float = given("of the box, above the bed", default=0.15, unit="m", low=0, high=0.7)
    structure: Literal["box"] | None = given(
        'the raised "box", or None; a slice has none', default=None
    )
    debris: str | DebrisField | None = given(
        'None, one prism "A" to "I" lengthwise, "8-L" or "24-L" bars of the Large Wave Flume at '
        "1:4, or " + FIELD_TEXT,
        default=None,
    )
    gap: float | None = given("between bars; None = two cells, with `contact` none", default=None,
                              unit="m", low=0)  # fmt: skip
    contact: float | None = given(
        "μ between pieces of debris, which then have velocities of their own; None = all bodies "
        "share one velocity at a node, as pieces and water do in any case",
        default=None, unit="1", low=0,
    )  # fmt: skip
    seed: int = given(
        "of shifts of the debris by up to a quarter of a cell; 0 = none", default=0, unit="1",
        low=0, whole=True,
    )  # fmt: skip
    edges: Edges = given("of the box: " + EDGE_TEXT, default="free")
    start: float = given("x of the inlet", default=4.0, unit="m", low=0, high=5.0)
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")
    bulk_modulus: float = given(
        "K of the water; 2.2 GPa is water's own", default=2e5, unit="Pa", above=0
    )

    def _check(self, check: Checker) -> dict[str, Any]:
        found = self._common(check)
        for name in ("speed", "still_water_level", "underside", "start", "bulk_modulus"):
            found[name] = check.given(name, self)
        if self.structure is not None:
            check.choice("structure", self.structure, ("box",))
            if self.width == "slice":
                check.fail("structure is 'box' with width 'slice', where it would close the flume; "
                           "expected None; use width='half'")  # fmt: skip
        found["debris"] = check_debris(check, self.debris, (*_PIECES, *_BARS), self.width)
        check.choice("edges", self.edges, EDGES)
        found["seed"] = check.given("seed", self)
        return found

    @property
    def still_water(self) -> float:
        """Level of the water, m."""
        return self.still_water_level

    # The scene -------------------------------------------------------------------------------

    def scene(self) -> Scene:
        """Return the flume with its water moving."""
        axes, u = self.axes, self.speed
        level, first = self.still_water, self._cells(self.start)
        y = self._across(_WIDTH)
        top = max(level + 0.25, self.underside + _BOX[2] + 0.15)
        made = self._new_scene((first, y[0], 0.0), (_LENGTH, y[1], top))
        top = made.upper[-1]
        water: Solid = axes.box((first, y[0], 0.0), (made.upper[0], y[1], level))
        if self.structure is not None:
            water = water - structure_solid(
                self.box(), self.edges, made.cell_size, self.width == "half"
            )
        made.add_body(
            name="water", material=TaitFluid(bulk_modulus=self.bulk_modulus), hydrostatic=level,
            shape=water,
            velocity=axes.point(u, 0.0, 0.0),
        )  # fmt: skip
        faces = ("y-",) if axes.flat else ("y-", "y+", "z-")
        made.add_boundary(name="walls", shape=DomainWalls(faces=faces), response=Slip())
        moves = TimeTable((0.0,), (axes.point(u, 0.0, 0.0),))
        ends = self.pump()
        for name, low, high in (("pump", first, ends[0]), ("drain-pump", ends[1], made.upper[0])):
            if high - low > 2 * self.cell_size:
                made.add_boundary(
                    name=name, shape=axes.box((low, y[0], 0.0), (high, y[1], top)),
                    response=Prescribed(components=("x",)), motion=moves,
                )  # fmt: skip
        made.add_flow(name="feed", flow=Inflow(body="water", face="x-", velocity=u, level=level))
        made.add_flow(name="drain", flow=Outflow(face="x+", velocity=u))
        if self.structure is not None:
            add_structure(made, "box", self.box(), self.edges, half=self.width == "half",
                          contact=self.contact is not None)  # fmt: skip
        if self.debris is not None:
            field = self.field()
            names = add_field(made, field, elevation=level + 0.5 * self.cell_size,
                              half=self.width == "half")  # fmt: skip
            track(made, names)
            add_contacts(made, self.contact, water=False)
        for one in self.instruments():
            if one.kind == "level":
                sensor: Any = axes.gauge(one.x, one.y, one.z, 1 / 20, max(0.1, self.cell_size))
            elif one.kind == "velocity":
                sensor = axes.probe(one.x, one.y, one.z, 1 / 20)
            else:
                sensor = LoadCell(boundary=one.boundary, interval=1 / 1200)
            made.add_sensor(name=one.name, sensor=sensor)
        return made

    def pump(self) -> tuple[float, float]:
        """Return where the held current ends before the debris and begins behind the box, m."""
        before, behind = _FRONT - _AWAY - _BEFORE, _FRONT + _BOX[0] + _BEHIND
        return self._cells(before), min(self._cells(behind), _LENGTH)

    def box(self) -> Box:
        """Return the raised box on faces of cells; with width "half" one half of it."""
        half = self._cells(0.5 * _BOX[1])
        low = (self._cells(_FRONT), 0.0 if self.width == "half" else -half,
               self._cells(self.underside))  # fmt: skip
        high = (self._cells(_FRONT + _BOX[0]), half, self._cells(self.underside + _BOX[2]))
        return self.axes.box(low, high)

    def field(self) -> DebrisField:
        """Return the debris as a field of the plan; raises `SceneError` where there is none."""
        if isinstance(self.debris, DebrisField):
            return self.debris
        if self.debris is None:
            raise SceneError(f"{self.label}: debris is None; expected 'A' to 'I', '8-L' or '24-L'")
        bars = self.debris in _BARS
        sizes = tuple(a / _SCALE for a in (0.5, 0.1, 0.05)) if bars else _PIECES[self.debris]
        rows, columns = _BARS.get(self.debris, (1, 1))
        piece = Prototype(
            length=sizes[0], width=sizes[1], height=sizes[2], name="piece",
            material=FixedCorotated(
                density=_DENSITY, poissons_ratio=_POISSON,
                youngs_modulus=modulus_at_speed(
                    _DENSITY, _POISSON, math.sqrt(self.bulk_modulus / 1000.0)
                ),
            ),
        )  # fmt: skip
        gap = self._gap()
        deep = rows * sizes[0] + (rows - 1) * gap
        made = ordered(piece, rows=rows, columns=columns, clearance=gap,
                       centre=(_FRONT - _AWAY - 0.5 * deep, 0.0))  # fmt: skip
        return scattered(made, self.seed, self.cell_size, across=self.width != "half")

    def instruments(self) -> tuple[Instrument, ...]:
        """Return two gauges and two velocimeters as in the public scene, and the load cell."""
        found = []
        beside = 0.0 if self.axes.flat else min(0.3, self._across(_WIDTH)[1] - 2 * self.cell_size)
        for name, x in (("WG1", _FRONT - 2.0), ("WG2", _FRONT - 0.36), ("WG3", _FRONT + 1.5)):
            found.append(Instrument(name, "level", x, beside, 0.0))
        for name, x in (("ADV1", _FRONT - 2.0), ("ADV2", _FRONT + 1.5)):
            found.append(Instrument(name, "velocity", x, beside, 0.5 * self.still_water))
        if self.structure is not None:
            share = 2.0 if self.width == "half" else 1.0
            found.append(Instrument("box", "load", _FRONT, 0.0, self.underside, "box", share))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return box, debris, and where the current is held, from the side."""
        found: list[tuple[str, Pairs]] = []
        if self.structure is not None:
            z = self.underside
            found.append(("box", rectangle(_FRONT, _FRONT + _BOX[0], z, z + _BOX[2])))
        if self.debris is not None:
            pieces = [p.x for p in self.field().pieces]
            z = self.still_water
            found.append(("debris", rectangle(min(pieces) - 0.1, max(pieces) + 0.1, z, z + 0.03)))
        before, behind = self.pump()
        found.append(("pump", rectangle(self.start, before, 0.0, 0.02)))
        if behind < _LENGTH:
            found.append(("drain", rectangle(behind, _LENGTH, 0.0, 0.02)))
        return tuple(found)

    # What it is compared with ----------------------------------------------------------------

    def deviations(self) -> tuple[Deviation, ...]:
        """Return where the scene is not the flume."""
        found = [
            Deviation("bulk modulus of water", "2.2e9 Pa", f"{self.bulk_modulus:g} Pa",
                       "longer steps"),
            Deviation("current", "boundary layers, turbulence", "the same at all heights",
                       "no drag of bed and walls"),
        ]  # fmt: skip
        found += lengthened("working part", _LENGTH, _LENGTH - self._cells(self.start))
        if self.width != "slice":
            found += lengthened("width", _WIDTH, 2 * self._across(_WIDTH)[1])
        if self.structure is not None:
            low, high = self.box().bounds()
            share = 2.0 if self.width == "half" else 1.0
            for what, edge, k, by in zip(("along", "across", "up"), _BOX, range(3),
                                         (1.0, share, 1.0), strict=True):  # fmt: skip
                found += lengthened(f"box {what}", edge, round(by * (high[k] - low[k]), 9))
        if self.debris is not None:
            modulus = self.field().prototypes[0].material.parameters()["youngs_modulus"]
            found.append(softened("debris", 0.8e9, modulus))
            found += self._gap_deviation("bars")
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return row W1 of the current, W2 and W3 of the box, W4 of bars."""
        u, level, window = self.speed, self.still_water, (10.0, 20.0)
        half = 0.5 * self.cell_size
        found = []
        if self.structure is None:
            found = [
                Criterion("W1", "level of the steady flow, WG1", "m", ("WG1",), window,
                          measures.mean_level("WG1", window),
                          **measures.near(level, half, "m")),
                Criterion("W1", "level of the steady flow, WG3", "m", ("WG3",), window,
                          measures.mean_level("WG3", window),
                          **measures.near(level, half, "m")),
                Criterion("W1", "mean speed, WG1", "m/s", ("WG1",), window,
                          measures.mean_of("WG1", "velocity_x", window),
                          **measures.within(u, 0.02)),
                Criterion("W1", "mean speed, WG3", "m/s", ("WG3",), window,
                          measures.mean_of("WG3", "velocity_x", window),
                          **measures.within(u, 0.02)),
            ]  # fmt: skip
            if not self.axes.flat:
                found = found[:2] + [
                    Criterion("W1", f"mean speed, {name}", "m/s", (name,), window,
                              measures.mean_of(name, "velocity_x", window),
                              **measures.within(u, 0.02)) for name in ("ADV1", "ADV2")
                ]  # fmt: skip
            return tuple(found)
        wet = level - self.underside
        if self.debris is not None:
            return self._first_peak() if isinstance(self.debris, str) else ()
        steady = (5.0, 10.0)
        if wet > 0:
            unit = 0.5 * 1000.0 * _BOX[1] * min(wet, _BOX[2]) * u**2
            found.append(Criterion(
                "W2", "steady drag of the box", "N", ("box",), steady,
                measures.mean_load("box", steady),
                unit * 0.5 * sum(_DRAG), unit * _DRAG[0], unit * _DRAG[1],
                f"C {_DRAG[0]:g} to {_DRAG[1]:g}",
            ))  # fmt: skip
        if abs(wet - _LWF_DEPTH) < 0.006 and abs(u - _LWF_SPEED) < 0.011:
            found.append(Criterion(
                "W3", "load at 1:4 of the Large Wave Flume, × 64", "N", ("box",), steady,
                lambda signals: _SCALE**3 * measures.mean_load("box", steady)(signals),
                **measures.within(_LWF_LOAD, 0.25),
            ))  # fmt: skip
        return tuple(found)

    def similarity(self, *, until: float = 2.0, scale: float = 4.0, threads: int = 0) -> Row:
        """Return row W5: the same scene at λ 1 and `scale`, by Froude and Cauchy, run on the CPU.

        `until` s of the scene at λ 1. The number is the largest difference of a level or speed
        at a gauge, in parts of the largest, lengths over λ and speeds over √λ. Raises `SceneError`.
        """
        from libmpm._src.run.simulation import Simulation

        scene = self.scene()
        runs = []
        for ratio, one in ((1.0, scene), (scale, scene.scaled(scale, cauchy=True))):
            simulation = Simulation(one, device="cpu", threads=threads)
            simulation.run(until=until * math.sqrt(ratio), progress=False)
            runs.append(simulation.sensors)
        worst = 0.0
        for name in [i.name for i in self.instruments() if i.kind in ("level", "velocity")]:
            small, large = (one[name] for one in runs)
            for column in small.components:
                speed = column.startswith("velocity")
                unit = math.sqrt(scale) if speed else scale
                a, b = (np.asarray(one[column], np.float64) for one in (small, large))
                n = min(len(a), len(b))
                off, most = np.abs(b[:n] / unit - a[:n]), self.speed if speed else self.still_water
                worst = max(worst, float(np.nanmax(off)) / most)
        verdict = "passed" if worst <= _ALIKE else "failed"
        return Row("W5", f"λ 1 and {scale:g}, levels and speeds alike", "1", 0.0, worst, "1 %", "",
                   verdict, "similarity()")  # fmt: skip

    @classmethod
    def joint_rows(cls, comparisons: Sequence[Comparison]) -> list[Row]:
        """Return row W5, which `similarity` fills."""
        return [Row("W5", "λ 1 and 4, levels and speeds alike", "1", 0.0, None, "1 %", "",
                    "not run", "similarity()")]  # fmt: skip

    def _first_peak(self) -> tuple[Criterion, ...]:
        """Return the first peak of bars at 1:4 against the fences of the Large Wave Flume."""
        if self.debris not in _BARS:
            return ()
        window = (0.2, 10.0)
        peak = measures.peak_load("box", window, 0.01 / math.sqrt(_SCALE))

        def measure(signals: measures.Signals) -> float:
            return _SCALE**3 * peak(signals)

        what = f"first peak of {self.debris} at 1:4, × 64"
        if self.debris != "8-L":
            return (Criterion("W4", what, "N", ("box",), window, measure, gates=False,
                              held_out=True),)  # fmt: skip
        row = records.load("lwf-first-peaks").row("case", "8-L-1.0x0.4")
        low, high = (float(row[f"exp_whisker_{k}_N"]) for k in ("low", "high"))
        return (Criterion("W4", what, "N", ("box",), window, measure,
                          float(row["exp_mascarenas2022_median_N"]), low, high,
                          f"{low:g} to {high:g} N", gates=False),)  # fmt: skip
