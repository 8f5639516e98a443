"""`DebrisFlowFlume`: the USGS debris-flow flume: release, gate, channel, run-out pad."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Literal

import numpy as np

from libmpm._src.base.declarations import given
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, value
from libmpm._src.boundaries.responses import Displacement, Rotation, Separable
from libmpm._src.flumes import criteria as measures
from libmpm._src.flumes import records
from libmpm._src.flumes.criteria import Criterion
from libmpm._src.flumes.debris import lengthened
from libmpm._src.flumes.facility import (
    GRAVITY,
    Difference,
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

_SLOPE, _PAD = math.radians(31.0), math.radians(2.4)
#: Where the bed begins to curve, m, and the radius of the arc, m (drawing of hdro-0008).
_FOOT, _RADIUS = 74.0, 20.0
_TURN = _SLOPE - _PAD
#: Release: corners of the prism (x, z), m: bed, gate, top (drawing of hdro-0008).
_PRISM: Pairs = ((-4.7, 0.0), (0.0, 0.0), (-0.979, 1.629), (-4.181, 0.831))
_GATE_HEIGHT = 1.9
#: Vertical and downstream directions (x, z) in the flume's coordinates.
_UP = (-math.sin(_SLOPE), math.cos(_SLOPE))
_ALONG = (math.cos(_SLOPE), math.sin(_SLOPE))
_STATIONS = (2.0, 32.0, 66.0, 80.0, 90.0)
#: Bed: solids' share of the volume, basal friction in degrees, bulk density kg/m³.
_BEDS = {"rough": (0.61, 40.7, 2076.0), "smooth": (0.64, 28.0, 2088.0)}
#: Sliding block of row U1: corners, m.
_BLOCK = ((-3.0, 0.0), (-2.0, 0.4))
_GONE = 1.0  # m, how far above its place the lifted gate ends


def _place(s: float) -> tuple[float, float]:
    """Return (x, z) of a place s m along the bed, m."""
    angle = min(max((s - _FOOT) / _RADIUS, 0.0), _TURN)
    x, z = _RADIUS * math.sin(angle), _RADIUS * (1.0 - math.cos(angle))
    rest = max(s - _FOOT - _RADIUS * _TURN, 0.0)
    return (
        min(s, _FOOT) + x + rest * math.cos(_TURN),
        z + rest * math.sin(_TURN),
    )


def _along_bed(x: float) -> float:
    """Return how far along the bed a place x is, m: the inverse of `_place`."""
    end = _FOOT + _RADIUS * math.sin(_TURN)
    if x <= _FOOT:
        return x
    if x <= end:
        return _FOOT + _RADIUS * math.asin((x - _FOOT) / _RADIUS)
    return _FOOT + _RADIUS * _TURN + (x - end) / math.cos(_TURN)


def _profile(first: float, last: float) -> Pairs:
    """Return the bed between two places along it, its arc in pieces of a degree, (x, z), m."""
    arc = [_FOOT + _RADIUS * _TURN * k / 28 for k in range(29)]
    return tuple(_place(s) for s in (first, *[s for s in arc if first < s < last], last))


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
                           2.4° at s 84 m, then level so                   drawing of hdro-0008
    pad                    8.2 m wide from s 85 m                          drawing of hdro-0008
    release (x, z), m      (-4.7, 0) (0, 0) (-0.979, 1.629)                drawing of hdro-0008:
                           (-4.181, 0.831): 4.95 m² × 2 m = 9.9 m³         bed 4.7, gate 1.9, top
                                                                           3.3 m at 17°
    gate                   vertical, two doors that open in 0.85 s         George, Iverson (2014)
    stations               s 2, 32, 66, 80, 90 m                           George, Iverson (2014)
    rough bed, SGM         solids 0.61, friction 40.7°, 2076 kg/m³         George, Iverson (2014)
    smooth bed, SG         solids 0.64, friction 28°, 2088 kg/m³           Iverson et al. (2016)
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

    A depth is the mass on a piece of the bed 0.3 m long, over its area and the density at rest:
    what flies or has opened counts as it weighs. There is no wall, bump or trunk on the pad yet.

    Raises `SceneError`.

    Source: George and Iverson (2014); Iverson, George and Logan (2016); Bonus (2023) 9.4.
    """

    label: ClassVar[str] = "flumes.DebrisFlowFlume"
    short: ClassVar[str] = "usgs"
    title: ClassVar[str] = "USGS debris-flow flume"
    granular: ClassVar[bool] = True
    bed_profile: ClassVar[Pairs] = _profile(-8.0, 118.0)
    levels: ClassVar[dict[str, dict[str, Any]]] = {
        "reduced": {"width": "slice", "cell_size": 0.1, "end": 8.0},
        "quick": {"width": "slice", "cell_size": 0.1},
        "laptop": {"width": "slice", "cell_size": 0.05},
        "full": {"width": "half", "cell_size": 0.025},
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
    end: float | None = given(
        "s at which the flume is cut, and all that comes leaves; None = 118 m",
        default=None, unit="m", above=3.0, high=118.0,
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
        last = 118.0 if self.end is None else self.end
        wide = last > 82.4
        y = self._across(8.2 if wide and self.width != "slice" else 2.0)
        side = (y[0] - 1.0, y[1] + 1.0)
        end = _place(last)
        top = max(2.6, end[1] + (1.5 if last > _FOOT else 0.0))
        gravity = (GRAVITY * math.sin(_SLOPE), 0.0, -GRAVITY * math.cos(_SLOPE))
        made = self._new_scene((-6.0, y[0], -4 * h), (end[0], y[1], top), gravity)
        channel, pad, _ = self.frictions()
        foot = min(_FOOT, last + 1.0)
        parts: list[tuple[str, Pairs, float]] = [("channel", ((-7.0, 0.0), (foot, 0.0)), channel)]
        if last > _FOOT:
            parts.append(("pad", _profile(_FOOT, last + 2.0), pad))
        for name, profile, friction in parts:
            response = Separable(static_friction=friction, dynamic_friction=friction, cell="linear")
            made.add_boundary(name=name, shape=axes.bed(profile, side), response=response)
        if self.width != "slice":
            self._add_walls(made, y, min(last + 2.0, 82.4))
        if self.release == "block":
            (x, z), (u, w) = _BLOCK
            reach = 0.5 * 2.0
            made.add_body(
                name="block", material=self.material(),
                shape=axes.box((x, max(y[0], -0.5 * reach), z), (u, 0.5 * reach, w)),
            )  # fmt: skip
        else:
            half = self._cells(1.0)
            shape = axes.prism(_PRISM, (max(y[0], -half), half))
            made.add_body(name="mixture", shape=shape, material=self.material())
            self._add_gate(made)
        body = self._body()
        every = 0.05 if axes.flat else 0.2
        reach = self._reach()
        for one in self.instruments():
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

    def _reach(self) -> float:
        """Return half the edge of what a depth is weighed on, m."""
        return max(0.15, 2 * self.cell_size)

    def _body(self) -> str:
        return "mixture" if self.release == "prism" else "block"

    def _add_walls(self, made: Scene, y: tuple[float, float], last: float) -> None:
        """Add the channel's side walls, 1.2 m high, and the plane of symmetry."""
        half = self._cells(1.0)
        low = [(-7.0, -1.0), *[(a, b - 1.0) for a, b in _profile(-7.0, last)]]
        high = [(a, b + 1.2) for a, b in reversed(_profile(-7.0, last))]
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
            far = [_UP[0] * way, _UP[1] * way]
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
                about=(0.0, sign * half, 0.0), axis=(_UP[0], 0.0, _UP[1]),
                degrees=TimeTable((0.0, self.gate_time), (0.0, 90.0 * sign)),
            )  # fmt: skip
            made.add_boundary(
                name=f"door-{k}", shape=plate, response=Separable(cell="linear"), rotation=turn
            )

    @staticmethod
    def _plate(low: float, high: float, thick: float) -> Pairs:
        """Return corners of a plate on the gate's downstream side, heights along it, (x, z), m."""
        return tuple(
            (_UP[0] * a + _ALONG[0] * b, _UP[1] * a + _ALONG[1] * b)
            for a, b in ((low, 0.0), (low, thick), (high, thick), (high, 0.0))
        )

    def instruments(self) -> tuple[Instrument, ...]:
        """Return the depth at each station."""
        last = 118.0 if self.end is None else self.end
        if self.release == "block":
            return ()
        edge = 2 * self._reach()
        area = {"slice": edge, "half": 0.5 * edge**2, "full": edge**2}[self.width]
        found = []
        for s in _STATIONS:
            if s < last - 0.5:
                turn = min(max((s - _FOOT) / _RADIUS, 0.0), _TURN)
                scale = math.cos(turn) / (_BEDS[self.bed][2] * area)
                x, z = _place(s)
                found.append(Instrument(f"depth {s:g} m", "depth", x, 0.0, z, scale=scale))
        return tuple(found)

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return release and gate from the side."""
        gate = self._plate(0.0, _GATE_HEIGHT, 0.2)
        if self.release == "block":
            (x, z), (u, w) = _BLOCK
            return (("block", ((x, z), (u, z), (u, w), (x, w))),)
        return (("release", _PRISM), ("gate", gate))

    # What it is compared with ----------------------------------------------------------------

    def differences(self) -> tuple[Difference, ...]:
        """Return where the scene is not the flume."""
        found = [
            Difference("E", "grains and water", f"{self.youngs_modulus:g} Pa", "longer steps"),
            Difference("mixture", "saturated, with pore pressure",
                       "one solid, Drucker and Prager", "no material has pore pressure"),
            Difference("bed", "bumps of 16 mm" if self.bed == "rough" else "concrete",
                       "one friction for the channel, one for the pad", "bumps need 1.25 cm"),
        ]  # fmt: skip
        if self.axes.flat:
            found.append(Difference("gate", "two doors that swing", "drawn up in its plane",
                                    "a slice has no width"))  # fmt: skip
            found.append(Difference("pad", "8.2 m wide", "as wide as the channel", "a slice"))
        else:
            found += lengthened("channel's width", 2.0, 2 * self._cells(1.0))
        if self.end is not None:
            found.append(Difference("end", "deposit on the pad", f"cut at {self.end:g} m", "cost"))
        return tuple(found)

    def criteria(self) -> tuple[Criterion, ...]:
        """Return row U1 of the block, or U2 to U5 and U8 of the mixture."""
        if self.release == "block":
            return (Criterion(
                "U1", "v² over 2 g s (sin 31° - μ cos 31°)", "1", ("block",), (0.0, 3.0),
                self._slides, **measures.within(1.0, 0.03),
            ),)  # fmt: skip
        first, rough = (0.0, 4.0), self.bed == "rough"
        last = 118.0 if self.end is None else self.end
        gates = rough and self.mixture == "equivalent"
        held: dict[str, Any] = {"gates": False, "held_out": True}
        found = []
        if rough:
            found += [
                Criterion("U2", "largest depth, 2 m", "m", ("depth 2 m",), first,
                          measures.crest("depth 2 m", first, True), published="0.48 m (D-Claw)",
                          gates=gates, **measures.within(0.60, 0.30)),
                Criterion("U2", "time of the largest depth, 2 m", "s", ("depth 2 m",), first,
                          measures.peak_time("depth 2 m", first), published="1.6 s (D-Claw)",
                          gates=gates, **measures.near(1.65, 0.3, "s")),
            ]  # fmt: skip
        for s, until, front, by, rival, depth, other in (
            (32, 10.0, 3.95, 0.6, "3.75 s (D-Claw)", 0.17, "0.19 m (D-Claw)"),
            (66, 15.0, 7.0, 1.0, "6.2 s (D-Claw)", 0.15, "0.12 m (D-Claw)"),
        ):  # fmt: skip
            if s > last - 0.5:
                continue
            name, window = f"depth {s} m", (0.0, until)
            arrives: dict[str, Any] = {"gates": False, "published": rival,
                                       **measures.near(front, by, "s")}  # fmt: skip
            largest: dict[str, Any] = {"gates": False, "published": other,
                                       **measures.within(depth, 0.40)}  # fmt: skip
            if not rough:
                arrives = {"tolerance": "± 1 s", **held}
                largest = {"tolerance": "± 50 %", **held}
            found += [
                Criterion("U3" if rough else "U5", f"front, {s} m", "s", (name,), window,
                          _front(name, window), **arrives),
                Criterion("U4" if rough else "U5", f"largest depth, means of 0.2 s, {s} m", "m",
                          (name,), window, _largest(name, window), **largest),
            ]  # fmt: skip
        if last >= 118.0:
            window = (0.0, 20.0)
            deposits = records.load("usgs-deposits")
            rows = [float(x) for x, kind in zip(deposits["front_x_m"], deposits["set"], strict=True)
                    if kind == ("SGM" if rough else "SG")]  # fmt: skip
            found.append(Criterion(
                "U8", "farthest of the deposit, along the bed", "m", ("mixture",), window,
                _farthest, gates=False, **measures.near(round(float(np.mean(rows)), 1), 6.0, "m"),
            ))  # fmt: skip
        return tuple(found)

    def _slides(self, signals: measures.Signals) -> float:
        """Return v² of the block over that of the law, a mean over its third second."""
        time, x = signals.column("block", "centroid_x")
        _, speed = signals.column("block", "velocity_x")
        law = GRAVITY * (math.sin(_SLOPE) - self.frictions()[0] * math.cos(_SLOPE))
        keep = (time >= 2.0) & (time <= 3.0)
        if law <= 0:
            # It does not slide; the law's speed is 0.
            return 1.0 if float(np.abs(speed[keep]).max()) < 1e-2 else math.nan
        start = 0.5 * (_BLOCK[0][0] + _BLOCK[1][0])
        return float(np.mean(speed[keep] ** 2 / (2 * law * (x[keep] - start))))


def _front(name: str, window: tuple[float, float]) -> Any:
    """Return what measures when half of the largest depth has come, s."""

    def measure(signals: measures.Signals) -> float:
        time, depth = signals.depth(name)
        keep = (time >= window[0]) & (time <= window[1])
        mean = measures.smooth(time, depth, 0.2)
        above = mean[keep] >= 0.5 * float(mean[keep].max())
        reached = float(mean[keep].max()) > 0
        return float(time[keep][int(np.argmax(above))]) if reached else math.nan

    return measure


def _largest(name: str, window: tuple[float, float]) -> Any:
    """Return what measures the largest mean of a depth over 0.2 s, m."""

    def measure(signals: measures.Signals) -> float:
        time, depth = signals.depth(name)
        keep = (time >= window[0]) & (time <= window[1])
        return float(measures.smooth(time, depth, 0.2)[keep].max())

    return measure


def _farthest(signals: measures.Signals) -> float:
    """Return the way along the bed of the farthest particle at the end of the run, m."""
    return _along_bed(float(signals.column("mixture", "upper_x")[1][-1]))
