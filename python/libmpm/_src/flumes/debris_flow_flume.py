"""`DebrisFlowFlume`: the USGS debris-flow flume: release, gate, channel, run-out pad."""

from __future__ import annotations

import itertools
import math
from typing import Any, ClassVar, Literal

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, value
from libmpm._src.boundaries.responses import Displacement, Rotation, Separable
from libmpm._src.flumes import debris_flow_flume_rows
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import lengthened
from libmpm._src.flumes.debris_flow_flume_shape import (
    ALONG,
    END,
    FOOT,
    PRISM,
    RADIUS,
    SLOPE,
    TURN,
    UP,
    bed_line,
    place,
)
from libmpm._src.flumes.facility import (
    GRAVITY,
    Deviation,
    Facility,
    Instrument,
    Pairs,
    Width,
    wall,
)
from libmpm._src.materials.generated import DruckerPrager, FixedCorotated
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.python_sensors import BodyTracker, ParticleSensor
from libmpm._src.shapes.boxes import DomainWalls
from libmpm._src.shapes.prisms import Extrusion

__all__ = ["DebrisFlowFlume"]

_GATE_HEIGHT = 1.9
_STATIONS = (2.0, 32.0, 66.0, 80.0, 90.0)
#: Bed: solids' share of the volume, basal friction in degrees, bulk density kg/m³.
_BEDS = {"rough": (0.61, 40.7, 2076.0), "smooth": (0.64, 28.0, 2088.0)}
#: Sliding block of row U1: corners, m.
_BLOCK = ((-3.0, 0.0), (-2.0, 0.4))
_GONE = 1.0  # m, how far above its place the lifted gate ends
#: Volume of the prism, m³, and of the tests with a wall.
_VOLUME = 9.9
_WALLS = {"1994-06-21": 9.3, "1994-06-23": 10.1}
#: Wall: way along the bed, height, width, and where the side walls then end, m.
_WALL = (91.0, 2.4, 5.2, 87.4)


@value
class DebrisFlowFlume(Facility):
    """The USGS debris-flow flume at H. J. Andrews: a prism of mixture behind a gate, 31° down.

    {fields}

    x runs from the gate along the bed of 31°, z is normal to it and gravity leans accordingly;
    stations are named by their way s along the bed, which is x until 74 m. Measured times count
    from when the gate begins to open.

    =====================  ==============================================  ====================
    what                   value                                           source
    =====================  ==============================================  ====================
    channel                2 m wide, walls 1.2 m high until s 82.4 m       drawing of hdro-0008
    bed                    31° to s 74 m, an arc of radius 20.0 m to       Iverson et al. (2016);
                           2.4° at s 84 m, then straight on                drawing of hdro-0008
    pad                    8.2 m wide from s 85 m, 6.1 m from s 97 m, to   drawing of hdro-0008
                           s 107.7 m; here 8.2 m throughout, to s 150 m
    release (x, z), m      (-4.7, 0) (0, 0) (-0.979, 1.629)                drawing of hdro-0008:
                           (-4.181, 0.831): 4.95 m² × 2 m = 9.9 m³         bed 4.7, gate 1.9, top
                                                                           3.3 m at 17°
    gate                   vertical, two doors that open in 0.85 s         George, Iverson (2014)
    stations               s 2, 32, 66, 80, 90 m                           George, Iverson (2014)
    rough bed, SGM         solids 0.61, friction 40.7°, 2076 kg/m³         George, Iverson (2014)
    smooth bed, SG         solids 0.64, friction 28°, 2088 kg/m³           Iverson et al. (2016)
    wall                   s 91.0 m, 2.4 m high, 5.2 m wide, side walls    Iverson et al. (2016),
                           prolonged to s 87.4 m; 9.3 and 10.1 m³          table 1
    =====================  ==============================================  ====================

    The public scene files release a block of 28 m³ of 1700 or 2400 kg/m³ and turn the bed by three
    facets; taken here are the prism, the measured density and the arc.

    **The mixture has no pore pressure.** What was measured is a saturated mixture that pore
    pressure liquefies: with the bed's own friction (`mixture` "dry") it comes two to three times
    too late. "equivalent" stands for the pressure by one friction in the channel and one on the
    pad, and a smaller angle within: numbers that were chosen, not measured, the channel's by the
    front at 32 m in a slice. Only the first seconds (row U2) decide; what comes later is reported.

    A slice cannot have doors that swing: there the gate is drawn up in its own plane in the same
    time. In space both doors turn about the edges of the channel by 90°.

    `release` "block" is an elastic block in its place, that slides by v² = 2 g s (sin 31° - μ cos
    31°), row U1: the check of the bed's friction.

    `friction_factor` multiplies both frictions of the bed in steps of time: 1 less the share of
    the normal stress that pore pressure carries. It is one number for all of the bed at a time,
    while pore pressure diffuses where the mixture is and stays high in the front's rear: it can
    stand for a liquefied start, not for a front that is dry and a tail that is not. Between two
    rows of the table it is their mean; the last row holds.

    A depth is the mass on a piece of the bed 0.3 m long, over its area and the density at rest:
    what flies or has opened counts as it weighs. `obstacle` is the wall of two tests on the smooth
    bed, each with its volume, which scales the prism; "run-up" is the highest particle within two
    cells before it. There is no bump, trunk or box on the pad.

    The pad goes on to s 150 m, so that all of the mass stays (row U2): some of the mixture, 0.02 at
    Δx 5 cm, comes to rest beyond s 118 m, single grains at 134 m, while none was found beyond 111 m
    in the experiment. The transfer is APIC by name: with AFLIP 0.95, which a scene of grains takes,
    0.19 comes to lie beyond s 118 m.

    Raises `SceneError`.

    Source: George and Iverson (2014); Iverson, George and Logan (2016); Bonus (2023) 9.4.
    """

    label: ClassVar[str] = "flumes.DebrisFlowFlume"
    short: ClassVar[str] = "usgs"
    title: ClassVar[str] = "USGS debris-flow flume"
    granular: ClassVar[bool] = True
    bed_profile: ClassVar[Pairs] = bed_line(-8.0, END)
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.1, "end": 8.0},
        "quick": {"width": "slice", "cell_size": 0.1},
        "laptop": {"width": "slice", "cell_size": 0.05},
        "full": {"width": "half", "cell_size": 0.025},
    }

    cases: ClassVar[dict[str, tuple[str, dict[str, Any]]]] = {
        "slice": ("laptop", {}),
        "block": ("quick", {"release": "block", "end": 20.0}),
        "rough": ("full", {}),
        "smooth": ("full", {"bed": "smooth"}),
        "wall-1994-06-21": ("full", {"bed": "smooth", "obstacle": "1994-06-21"}),
        "wall-1994-06-23": ("full", {"bed": "smooth", "obstacle": "1994-06-23"}),
    }

    cell_size: float = given("edge Δx of the cells", default=0.05, unit="m", above=0, high=0.2)
    bed: Literal["rough", "smooth"] = given(
        'with bumps, of the tests with mud "SGM", or "smooth", of those without, "SG"',
        default="rough",
    )
    mixture: Literal["equivalent", "dry"] = given(
        '"equivalent": the frictions below; "dry": the bed\'s own, and within the mass the same',
        default="equivalent",
    )
    release: Literal["prism", "block"] = given(
        'the mixture, or the sliding "block" of row U1', default="prism"
    )
    channel_friction: float = given("μ of the channel's bed", default=0.20, unit="1", low=0)
    pad_friction: float = given("μ from the bed's curve on", default=0.50, unit="1", low=0)
    internal_friction: float = given(
        "angle within the mixture", default=25.0, unit="°", low=0, high=60
    )
    gate_time: float = given("in which the gate opens", default=0.85, unit="s", above=0)
    youngs_modulus: float = given("E of mixture or block", default=2e6, unit="Pa", above=0)
    friction_factor: TimeTable | None = given(
        "share of both frictions over time, for pore pressure at the bed; None = 1", default=None,
        unit="1",
    )  # fmt: skip
    volume: float | None = given(
        "of the release, which scales the prism; None = 9.9, or that of the obstacle's test",
        default=None, unit="m³", above=1.0, high=20.0,
    )  # fmt: skip
    obstacle: Literal["1994-06-21", "1994-06-23"] | None = given(
        "the wall on the pad, by the day of its test; None = none", default=None
    )
    end: float | None = given(
        "s at which the flume is cut, and all that comes leaves; None = 150 m",
        default=None, unit="m", above=3.0, high=END,
    )  # fmt: skip
    width: Width = given('"slice" in 2D, "half" from the centreline, or "full"', default="slice")

    def _check(self, check: Checker) -> dict[str, Any]:
        found = self._common(check)
        check.choice("bed", self.bed, tuple(_BEDS))
        check.choice("mixture", self.mixture, ("equivalent", "dry"))
        check.choice("release", self.release, ("prism", "block"))
        for name in ("channel_friction", "pad_friction", "internal_friction", "gate_time",
                     "youngs_modulus"):  # fmt: skip
            found[name] = check.given(name, self)
        if self.end is not None:
            found["end"] = check.given("end", self)
        if self.volume is not None:
            found["volume"] = check.given("volume", self)
        table = self.friction_factor
        if table is not None:
            check.instance("friction_factor", table, (TimeTable,), "a TimeTable of numbers")
        if isinstance(table, TimeTable) and (
            table.components or table.end != "hold" or min(table.value) < 0
        ):
            check.fail("friction_factor has vectors, numbers below 0, or ends other than with "
                       "'hold'; expected plain numbers ≥ 0 that hold their end")  # fmt: skip
        if self.obstacle is not None:
            check.choice("obstacle", self.obstacle, tuple(_WALLS))
            if self.end is not None and self.end < 95.0:
                check.fail(f"obstacle with end {self.end:g} m, but the wall stands at s 91 m; "
                           "expected end ≥ 95 m, or None")  # fmt: skip
        return found

    # The scene -------------------------------------------------------------------------------

    def frictions(self) -> tuple[float, float, float]:
        """Return μ of channel and pad, and the angle within the mixture, degrees."""
        if self.mixture == "equivalent":
            return self.channel_friction, self.pad_friction, self.internal_friction
        angle = _BEDS[self.bed][1]
        return (math.tan(math.radians(angle)),) * 2 + (angle,)

    def material(self) -> DruckerPrager | FixedCorotated:
        """Return the mixture, or the block's."""
        density = _BEDS[self.bed][2]
        if self.release == "block":
            return FixedCorotated(
                density=density, youngs_modulus=self.youngs_modulus, poissons_ratio=0.2
            )
        return DruckerPrager(
            density=density, youngs_modulus=self.youngs_modulus, poissons_ratio=0.2,
            friction_angle=self.frictions()[2],
        )  # fmt: skip

    def scene(self) -> Scene:
        """Return the mixture at rest behind the gate, which is about to open."""
        axes, h = self.axes, self.cell_size
        last = END if self.end is None else self.end
        wide = last > 82.4
        y = self._across(8.2 if wide and self.width != "slice" else 2.0)
        side = (y[0] - 1.0, y[1] + 1.0)
        end = place(last)
        top = max(2.6, end[1] + (1.5 if last > FOOT else 0.0))
        if self.obstacle is not None:
            top = max(top, place(_WALL[0])[1] + 4.0)
        gravity = (GRAVITY * math.sin(SLOPE), 0.0, -GRAVITY * math.cos(SLOPE))
        made = self._new_scene((-6.0, y[0], -4 * h), (end[0], y[1], top), gravity)
        channel, pad, _ = self.frictions()
        foot = min(FOOT, last + 1.0)
        parts: list[tuple[str, Pairs, float]] = [("channel", ((-7.0, 0.0), (foot, 0.0)), channel)]
        if last > FOOT:
            parts.append(("pad", bed_line(FOOT, last + 2.0), pad))
        for name, profile, friction in parts:
            shape = axes.bed(profile, side)
            for which, (window, factor) in enumerate(self._windows(), 1):
                mu = friction * factor
                made.add_boundary(
                    name=name if window is None else f"{name}-{which}", shape=shape, time=window,
                    response=Separable(static_friction=mu, dynamic_friction=mu, cell="linear"),
                )  # fmt: skip
        if self.width != "slice":
            self._add_walls(made, y, min(last + 2.0, 82.4 if self.obstacle is None else _WALL[3]))
        if self.obstacle is not None:
            half = 0.5 * _WALL[2]
            made.add_boundary(
                name="wall", response=Separable(cell="linear"),
                shape=axes.prism(self._standing(-0.6, _WALL[1], 0.0, 0.5),
                                 (-half if y[0] < 0 else y[0] - 1.0, half)),
            )  # fmt: skip
        if self.release == "block":
            (x, z), (u, w) = _BLOCK
            reach = 0.5 * 2.0
            made.add_body(
                name="block", material=self.material(),
                shape=axes.box((x, max(y[0], -0.5 * reach), z), (u, 0.5 * reach, w)),
            )  # fmt: skip
        else:
            half = self._cells(1.0)
            shape = axes.prism(self.prism(), (max(y[0], -half), half))
            made.add_body(name="mixture", shape=shape, material=self.material())
            self._add_gate(made)
        body = self._body()
        every = 0.05 if axes.flat else 0.2
        reach = self._reach()
        if self.end is None:
            made.add_sensor(
                name="mass",
                sensor=ParticleSensor(attribute="mass", operation="sum", body=body,
                                      interval=every),
            )  # fmt: skip
        for one in self.instruments():
            if one.kind == "height":
                shape = axes.prism(self._standing(0.0, 4.0, -2 * h, 0.0), (max(y[0], -1.0), 1.0))
                sensor = ParticleSensor(
                    attribute="position", operation="max", body=body, region=shape,
                    direction="y" if axes.flat else "z", interval=every,
                )  # fmt: skip
                made.add_sensor(name=one.name, sensor=sensor)
                continue
            region = axes.box((one.x - reach, max(y[0], -reach), one.z - 4 * h),
                              (one.x + reach, reach, top))  # fmt: skip
            made.add_sensor(
                name=one.name,
                sensor=ParticleSensor(attribute="mass", operation="sum", body=body,
                                      region=region, interval=every),
            )  # fmt: skip
        quantities = ("centroid", "velocity", "extent")
        made.add_sensor(
            name=body, sensor=BodyTracker(body=body, quantities=quantities, interval=every)
        )
        return made

    def prism(self) -> Pairs:
        """Return the corners of the release (x, z), m, scaled to its volume about the gate's foot.

        Its gate is 1.9 m high with 9.9 m³.
        """
        scale = self._scale()
        return tuple((scale * x, scale * z) for x, z in PRISM)

    def _scale(self) -> float:
        volume = _WALLS.get(self.obstacle or "", _VOLUME) if self.volume is None else self.volume
        return math.sqrt(volume / _VOLUME)

    def _windows(self) -> list[tuple[tuple[float, float] | None, float]]:
        """Return spans of time, s, and the factor of the bed's friction in each."""
        if self.friction_factor is None:
            return [(None, 1.0)]
        time, value = self.friction_factor.arrays()
        spans: list[tuple[tuple[float, float] | None, float]] = []
        if time[0] > 0:
            spans.append(((0.0, float(time[0])), float(value[0])))
        for (a, u), (b, v) in itertools.pairwise(zip(time, value, strict=True)):
            if b > max(a, 0.0):
                spans.append(((max(float(a), 0.0), float(b)), 0.5 * float(u + v)))
        spans.append(((max(float(time[-1]), 0.0), math.inf), float(value[-1])))
        return spans

    @staticmethod
    def _standing(low: float, high: float, before: float, behind: float) -> Pairs:
        """Return a vertical plate at the wall's place, heights and way downstream, (x, z), m."""
        x, z = place(_WALL[0])
        return tuple(
            (x + UP[0] * a + ALONG[0] * b, z + UP[1] * a + ALONG[1] * b)
            for a, b in ((low, before), (low, behind), (high, behind), (high, before))
        )

    def _reach(self) -> float:
        """Return half the edge of what a depth is weighed on, m."""
        return max(0.15, 2 * self.cell_size)

    def _body(self) -> str:
        return "mixture" if self.release == "prism" else "block"

    def _add_walls(self, made: Scene, y: tuple[float, float], last: float) -> None:
        """Add the channel's side walls, 1.2 m high, and the plane of symmetry."""
        half = self._cells(1.0)
        low = [(-7.0, -1.0), *[(a, b - 1.0) for a, b in bed_line(-7.0, last)]]
        high = [(a, b + 1.2) for a, b in reversed(bed_line(-7.0, last))]
        # Behind the gate the bin's walls hold all of the prism.
        profile = [*low, *high[:-1], (2.0, 1.2), (2.0, 2.4), (-7.0, 2.4)]
        profile = [p for k, p in enumerate(profile) if k == 0 or p != profile[k - 1]]
        sides = [(half, y[1] + 1.0)] if self.width == "half" else [
            (half, y[1] + 1.0), (y[0] - 1.0, -half)]  # fmt: skip
        for k, (low_y, high_y) in enumerate(sides, 1):
            shape = Extrusion(profile=profile, axis="y", lower=low_y, upper=high_y)
            made.add_boundary(name=f"side-{k}", shape=shape, response=wall())
        if self.width == "half":
            made.add_boundary(name="centreline", shape=DomainWalls(faces=("y-",)), response=wall())

    def _add_gate(self, made: Scene) -> None:
        """Add the gate: one that is drawn up in a slice, doors that swing in space."""
        thick, below = 4 * self.cell_size, -0.5
        if self.axes.flat:
            plate = Extrusion(profile=self._plate(below, _GATE_HEIGHT + 0.6, thick))
            way = _GATE_HEIGHT + 0.6 - below + _GONE
            far = [UP[0] * way, UP[1] * way]
            made.add_boundary(
                name="gate", shape=plate, response=Separable(cell="linear"),
                motion=Displacement(TimeTable((0.0, self.gate_time), ((0.0, 0.0), tuple(far)))),
            )  # fmt: skip
            return
        half = self._cells(1.0)
        for k, sign in enumerate((1, -1), 1):
            if sign < 0 and self.width == "half":
                continue
            low, high = sorted((0.0, sign * half))
            plate = Extrusion(profile=self._plate(0.0, _GATE_HEIGHT + 0.2, thick), axis="y",
                              lower=low, upper=high)  # fmt: skip
            turn = Rotation(
                about=(0.0, sign * half, 0.0), axis=(UP[0], 0.0, UP[1]),
                degrees=TimeTable((0.0, self.gate_time), (0.0, 90.0 * sign)),
            )  # fmt: skip
            made.add_boundary(
                name=f"door-{k}", shape=plate, response=Separable(cell="linear"), rotation=turn
            )

    @staticmethod
    def _plate(low: float, high: float, thick: float) -> Pairs:
        """Return corners of a plate on the gate's downstream side, heights along it, (x, z), m."""
        return tuple(
            (UP[0] * a + ALONG[0] * b, UP[1] * a + ALONG[1] * b)
            for a, b in ((low, 0.0), (low, thick), (high, thick), (high, 0.0))
        )

    def instruments(self) -> tuple[Instrument, ...]:
        """Return the depth at each station."""
        last = END if self.end is None else self.end
        if self.release == "block":
            return ()
        edge = 2 * self._reach()
        area = {"slice": edge, "half": 0.5 * edge**2, "full": edge**2}[self.width]
        found = []
        for s in _STATIONS:
            if s < last - 0.5:
                turn = min(max((s - FOOT) / RADIUS, 0.0), TURN)
                scale = math.cos(turn) / (_BEDS[self.bed][2] * area)
                x, z = place(s)
                found.append(Instrument(f"depth {s:g} m", "depth", x, 0.0, z, scale=scale))
        if self.obstacle is not None:
            x, z = place(_WALL[0])
            found.append(Instrument("run-up", "height", x, 0.0, z, scale=1.0 / UP[1]))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return release and gate from the side."""
        gate = self._plate(0.0, self._scale() * _GATE_HEIGHT, 0.2)
        if self.release == "block":
            (x, z), (u, w) = _BLOCK
            return (("block", ((x, z), (u, z), (u, w), (x, w))),)
        found: list[tuple[str, Pairs]] = [("release", self.prism()), ("gate", gate)]
        if self.obstacle is not None:
            found.append(("wall", self._standing(0.0, _WALL[1], 0.0, 0.5)))
        return tuple(found)

    # What it is compared with ----------------------------------------------------------------

    def deviations(self) -> tuple[Deviation, ...]:
        """Return where the scene is not the flume."""
        found = [
            Deviation("E", "grains and water", f"{self.youngs_modulus:g} Pa", "longer steps"),
            Deviation("mixture", "saturated, with pore pressure",
                       "one solid, Drucker and Prager", "no material has pore pressure"),
            Deviation("bed", "bumps of 16 mm" if self.bed == "rough" else "concrete",
                       "one friction for the channel, one for the pad", "bumps need 1.25 cm"),
        ]  # fmt: skip
        if self.axes.flat:
            found.append(Deviation("gate", "two doors that swing", "drawn up in its plane",
                                    "a slice has no width"))  # fmt: skip
            found.append(Deviation("pad", "8.2 m wide", "as wide as the channel", "a slice"))
        else:
            found += lengthened("channel's width", 2.0, 2 * self._cells(1.0))
            found.append(
                Deviation("pad", "8.2 m wide, 6.1 m from s 97 m, to s 107.7 m",
                           "8.2 m wide to s 150 m", "so that nothing leaves it")
            )  # fmt: skip
        if self.obstacle is not None and self.axes.flat:
            found.append(Deviation("wall", "5.2 m wide", "across all of the flow", "a slice"))
        if self.end is not None:
            found.append(Deviation("end", "deposit on the pad", f"cut at {self.end:g} m", "cost"))
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return row U1 of the block, or U2 to U8 of the mixture with its mass balance."""
        return debris_flow_flume_rows.criteria(self)
