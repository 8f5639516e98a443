"""`Facility`: a value that gives scene, instruments, clock and comparison."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

from libmpm._src.base.arguments import keywords_only
from libmpm._src.base.time_tables import TimeTable
from libmpm._src.base.values import Checker, Value, nearest, shown
from libmpm._src.boundaries.responses import Separable, Slip
from libmpm._src.errors import SceneError
from libmpm._src.flumes.laboratory import Instrument
from libmpm._src.methods.method import PACKING, FBar, Method
from libmpm._src.methods.transfer import Transfer
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.column_gauge import ColumnGauge
from libmpm._src.sensors.engine_sensors import Sensor, VelocityProbe, WaveGauge
from libmpm._src.shapes.boxes import Box
from libmpm._src.shapes.prisms import Extrusion
from libmpm._src.studies.debris.field import DebrisField

if TYPE_CHECKING:
    from libmpm._src.flumes.comparison import Comparison, Row
    from libmpm._src.flumes.criteria import Criterion
    from libmpm._src.flumes.records import Curve
    from libmpm._src.pictures.figures import Picture
    from libmpm._src.scene.run_file import RunFile

__all__ = ["PACKING_TEXT", "WIDTHS", "Axes", "Deviation", "Facility", "Instrument", "Width"]

Width = Literal["slice", "strip", "half", "full"]
WIDTHS = ("slice", "strip", "half", "full")

#: What a field `packing` means, for the facilities that have one.
PACKING_TEXT = (
    "what keeps stirred water from packing and sinking, the more the finer the cells: an option of "
    "`FBar`; None = nothing, as it has to be with `contact` but in a near field, whose strip has it"
)

#: Acceleration of gravity, m/s².
GRAVITY = 9.81

#: How long a set-up runs that is compared with nothing, s.
_UNCOMPARED = 30.0

Pairs = tuple[tuple[float, float], ...]


def rectangle(x: float, u: float, z: float, w: float) -> Pairs:
    """Return the corners of a rectangle from x to u and z to w, for drawings."""
    return ((x, z), (u, z), (u, w), (x, w))


class Deviation(NamedTuple):
    """A number in which a scene is not the facility: what, there, in the scene, and why."""

    what: str
    facility: str
    scene: str
    why: str


@dataclass(frozen=True)
class Axes:
    """Turns (x, y, z), z up, into coordinates of a slice (x, z) or of space (x, y, z)."""

    flat: bool

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return 2 if self.flat else 3

    def point(self, x: float, y: float, z: float) -> tuple[float, ...]:
        """Return a point or vector."""
        return (x, z) if self.flat else (x, y, z)

    def box(self, lower: Sequence[float], upper: Sequence[float]) -> Box:
        """Return a box between two corners (x, y, z)."""
        return Box(lower=self.point(*lower), upper=self.point(*upper))

    def prism(self, profile: Sequence[tuple[float, float]], y: tuple[float, float]) -> Extrusion:
        """Return a profile (x, z), drawn out between two y."""
        if self.flat:
            return Extrusion(profile=profile)
        return Extrusion(profile=profile, axis="y", lower=y[0], upper=y[1])

    def bed(self, profile: Sequence[tuple[float, float]], y: tuple[float, float]) -> Extrusion:
        """Return what lies below a profile of rising x, down to a depth below all of it."""
        base = min(z for _, z in profile) - 2.0
        return self.prism([*profile, (profile[-1][0], base), (profile[0][0], base)], y)

    def gauge(
        self,
        x: float,
        y: float,
        bed: float,
        interval: float,
        hat: float | None = None,
        body: str | None = "water",
    ) -> Sensor:
        """Return a gauge of the water's level.

        In a slice it weighs the column of particles, which reads a fraction of a cell; in space it
        looks at the grid, since the other reads all particles at each sample.
        """
        if self.flat:
            return ColumnGauge(position=(x,), bed=bed, width=hat, body=body, interval=interval)
        return WaveGauge(position=(x, y), body=body, interval=interval)

    def probe(self, x: float, y: float, z: float, interval: float) -> VelocityProbe:
        """Return a probe of the velocity at a point."""
        return VelocityProbe(position=self.point(x, y, z), interval=interval)


class Facility(Value):
    """Base of the five facilities: see each of them.

    Coordinates are the facility's own: x along the flow from its own zero, y across it from the
    centreline, z up; in a slice the second axis is up. A run begins at 0 s; measured times are
    those of the run plus `clock`.
    """

    #: Name on the command line.
    short: ClassVar[str]
    title: ClassVar[str]
    #: Measured time less time of the run, s.
    clock_offset: ClassVar[float] = 0.0
    #: Whether the wave breaks at once: linear cells by name at all walls, slices included.
    violent: ClassVar[bool] = False
    #: Whether debris stands on its bed, off which water is to lift it.
    stands: ClassVar[bool] = False
    #: Whether grains flow and not water: APIC by name.
    granular: ClassVar[bool] = False
    #: Whether it can be one cell wide: see `FacilityOfStrips`.
    strips: ClassVar[bool] = False
    #: Transfer of a strip, which has no structure and goes on as a near field with one; None = what
    #: a scene takes that names none, as the other widths do.
    strip_transfer: ClassVar[Transfer | None] = None
    #: How long a run is still at all gauges, s, by which their zero is set.
    rest: ClassVar[float] = 2.0
    #: Arguments of each level; see `at_level`.
    levels: ClassVar[Mapping[str, Mapping[str, Any]]]
    #: Set-ups that were measured: their level and arguments; see `of_case`.
    cases: ClassVar[Mapping[str, tuple[str, Mapping[str, Any]]]]
    #: Corners of the bed, (x, z), m.
    bed_profile: ClassVar[Pairs] = ()

    cell_size: float
    width: Width
    debris: str | DebrisField | None = None
    gap: float | None = None
    contact: float | None = None
    uplift: bool = False
    packing: Literal["density", "shifting"] | None = None

    # What each facility says -----------------------------------------------------------------

    def scene(self) -> Scene:
        """Return a new scene with bodies, boundaries and named instruments."""
        raise NotImplementedError

    def instruments(self) -> tuple[Instrument, ...]:
        """Return the instruments that the scene has, in the order of x."""
        raise NotImplementedError

    def criteria(self) -> tuple[Criterion, ...]:
        """Return what a run of it is compared in."""
        raise NotImplementedError

    def deviations(self) -> tuple[Deviation, ...]:
        """Return every number in which the scene is not the facility, with the reason."""
        raise NotImplementedError

    @property
    def still_water(self) -> float | None:
        """Level of the water at rest, m; None without any."""
        return None

    @property
    def clock(self) -> float:
        """Measured time less time of the run, s."""
        return self.clock_offset

    @property
    def until(self) -> float:
        """How long a run must be for all rows, those that are held out too, s of the run.

        30 s where a set-up has no rows.
        """
        ends = [c.window[1] for c in self.criteria() if math.isfinite(c.window[1])]
        return max(ends) - self.clock if ends else _UNCOMPARED

    def outlines(self) -> tuple[tuple[str, Pairs], ...]:
        """Return what `preview` draws beside bed and water: names and polygons (x, z), m."""
        return ()

    # What all of them do ---------------------------------------------------------------------

    @classmethod
    def at_level(cls, level: str, **changes: Any) -> Self:
        """Return the facility at a level, "laptop" or "full", with some arguments changed.

        Laptop: a slice, two cores, at most 10 minutes. Full: in space, one H200, at most 8
        minutes. Raises `SceneError`.
        """
        if level not in cls.levels:
            raise SceneError(f"{cls.label}: level is {shown(level)}; {nearest(level, cls.levels)}")
        return cls(**{**cls.levels[level], **changes})

    @classmethod
    def of_case(cls, case: str, level: str | None = None, **changes: Any) -> Self:
        """Return the facility in a set-up that was measured, with some arguments changed.

        `level` None is the set-up's own: "laptop" or "full". Raises `SceneError`.
        """
        if case not in cls.cases:
            raise SceneError(f"{cls.label}: case is {shown(case)}; {nearest(case, cls.cases)}")
        own, arguments = cls.cases[case]
        return cls.at_level(own if level is None else level, **{**arguments, **changes})

    @classmethod
    def joint_rows(cls, comparisons: Sequence[Comparison]) -> list[Row]:
        """Return rows that take several set-ups, from those of their comparisons that are there."""
        return []

    @property
    def axes(self) -> Axes:
        """How (x, y, z) are coordinates of the scene."""
        return Axes(self.width == "slice")

    def run_file(self, until: float | None = None) -> RunFile:
        """Return the scene and how to run it: until the comparison's end, with checkpoints.

        It can be saved, and is what `libmpm flume` runs. `until` in s; None = `until`.
        """
        from libmpm._src.scene.run_file import RunFile, RunSettings

        end = self.until if until is None else until
        debris = [b.name for b in self.scene().bodies if b.name.startswith("debris")]
        settings = RunSettings(until=end, checkpoint_interval=max(end / 10, 0.1), debris=debris)
        return RunFile(self.scene(), settings)

    @keywords_only("flumes.Facility.compare", 2)
    def compare(
        self, run: Any, curves: Mapping[str, Curve] | None = None, *, case: str = ""
    ) -> Comparison:
        """Compare a run with what was measured: a table with verdicts, and a figure.

        `run` is a `Simulation`, `Results`, or the folder of a run of `scene()`; of a list or tuple
        of them the rows are medians with their spread: debris is chaotic, so runs that differ in
        `seed`. `curves` are measured curves by instrument that are not in the package, for rows
        that need them (`records.curve`). `case` names the set-up in the rows. Raises `SceneError`
        where nothing can be compared: a run lacks all instruments, ends too early or begins late.
        """
        from libmpm._src.flumes.comparison import compare, median_of

        if isinstance(run, list | tuple):
            return median_of([self.compare(one, curves, case=case) for one in run])
        if isinstance(run, str | Path):
            from libmpm._src.output.results import load

            run = load(run)
        return compare(self, run, curves, case)

    def preview(self) -> Picture:
        """Return a drawing from the side: bed, water, structure, debris, and all instruments."""
        from libmpm._src.pictures.flume_drawings import preview

        return preview(self)

    def __str__(self) -> str:
        """Return geometry, instruments, clock, and where the scene is not the facility."""
        scene = self._packs_beside_contact() or repr(self.scene())
        rows = [f"{self.title}: {scene}",
                f"measured time = time of the run + {self.clock:g} s; compared until "
                f"{self.until + self.clock:g} s", "instruments:"]  # fmt: skip
        rows += [f"  {i.name}: {i.kind} at x {i.x:g}, y {i.y:g}, z {i.z:g} m"
                 for i in self.instruments()]  # fmt: skip
        rows += ["differences from the facility:"]
        rows += [f"  {d.what}: {d.facility} there, {d.scene} here; {d.why}"
                 for d in self.deviations()]  # fmt: skip
        return "\n".join(rows)

    def water_fbar(self) -> FBar | Literal["default"]:
        """Return the averaging of the water's volumes, with what keeps it from packing."""
        if self.packing is None:
            return "default"
        return FBar(density=self.packing == "density", shifting=self.packing == "shifting")

    def bed_response(self) -> Slip | Separable:
        """Return the response of the bed: held nodes in a calm slice, linear cells else.

        Under debris that stands on it or may come to ground, and so in a strip of such a facility,
        it lets go, since off `Slip` no water lifts a piece, and its nodes are held: linear cells
        that let go are not stable at the foot of a step (water at rest before the quay of the
        Waseda basin, AFLIP 0.99, cells of 0.03 m).

        Before a step or the foot of a slope of linear cells slow water crowds, which gauges there
        read (WG1 of the Directional Wave Basin by 2.7 cm rms in place of 1.2, `docs/flumes`); in
        space they halve the load on a structure above the bed.
        """
        if self.width == "slice" and not self.violent:
            return Slip(cell="held")
        # A strip goes on as a near field, whose debris may stand on its bed.
        if self.stands and (self.debris is not None or self.width == "strip"):
            return Separable(cell="held")
        return self._response(lets_go=False)

    def _packs_beside_contact(self) -> str:
        """Return why no scene has what is given, but a near field; empty where one does."""
        if self.contact is None or self.packing is None:
            return ""
        near = "; or run its near_field(), whose strip has it" if self._cuts() else ""
        return (f"packing is {self.packing!r} with contact {self.contact:g}, beside which water is "
                f"neither shifted nor led by density; expected None{near}")  # fmt: skip

    def _cuts(self) -> bool:
        """Return whether the value has a near field."""
        return self.strips and self.width == "half"

    # For subclasses --------------------------------------------------------------------------

    def _common(self, check: Checker) -> dict[str, Any]:
        """Check cell size and width."""
        widths = [w for w in WIDTHS if w != "strip" or self.strips]
        found = {
            "cell_size": check.given("cell_size", self),
            "width": check.choice("width", self.width, widths),
        }
        for name in ("gap", "contact"):
            if getattr(self, name) is not None:
                found[name] = check.given(name, self)
        if not isinstance(self.uplift, bool):
            check.fail(f"uplift is {shown(self.uplift)}; expected True or False")
        if self.packing is not None:
            found["packing"] = check.choice("packing", self.packing, PACKING)
        if self.contact is not None and self.debris is None:
            check.fail(f"contact is {self.contact:g} without debris; expected None; name debris")
        problem = self._packs_beside_contact()
        if problem and not self._cuts():
            check.fail(problem)
        return found

    def _wall(self) -> Slip | Separable:
        """Return what walls at rest do; of a plane of symmetry, off which nothing comes, too."""
        whole = self.width == "full"
        return self._response(lets_go=whole and self.stands and self.debris is not None)

    def _response(self, *, lets_go: bool) -> Slip | Separable:
        """Return a response with linear cells by name only without contacts."""
        cell: Literal["linear", "auto"] = (
            "linear" if self.violent and self.contact is None else "auto"
        )
        return Separable(cell=cell) if lets_go else Slip(cell=cell)

    def _gap(self, measured: float = 0.0) -> float:
        """Return the gap between pieces, m: `gap`, else the measured one, but two cells apart.

        With contact they may touch.
        """
        if self.gap is not None:
            return self.gap
        return measured if self.contact is not None else max(measured, 2 * self.cell_size)

    def _gap_deviation(self, what: str, measured: float = 0.0) -> list[Deviation]:
        """Return that a gap is not the measured one, if so."""
        gap = self._gap(measured)
        if abs(gap - measured) < 1e-9:
            return []
        why = "bodies share velocities at nodes" if self.contact is None else "chosen"
        return [Deviation(f"gap between {what}", f"{measured:g} m", f"{gap:g} m", why)]

    def _bed_at(self, x: float) -> float:
        """Return the height of the bed at x, m."""
        profile = self.bed_profile
        for (a, u), (b, v) in itertools.pairwise(profile):
            if a <= x <= b and b > a:
                return u + (v - u) * (x - a) / (b - a)
        return profile[0][1] if x < profile[0][0] else profile[-1][1]

    def _cells(self, x: float) -> float:
        """Return the cell face nearest to x."""
        return round(x / self.cell_size) * self.cell_size

    def _across(self, width: float) -> tuple[float, float]:
        """Return the y between which the scene lies: half of it from the centreline."""
        if self.width == "strip":
            return (0.0, self.cell_size)
        half = self._half(width)
        return (0.0, half) if self.width == "half" else (-half, half)

    def _half(self, width: float) -> float:
        """Return half of a width on faces of cells, m."""
        return max(self._cells(0.5 * width), self.cell_size)

    def _new_scene(
        self,
        lower: Sequence[float],
        upper: Sequence[float],
        gravity: Sequence[float] = (0.0, 0.0, -GRAVITY),
    ) -> Scene:
        """Return an empty scene between two corners (x, y, z), moved out to faces of cells."""
        if problem := self._packs_beside_contact():
            raise SceneError(f"{self.label}: {problem}")
        h, axes = self.cell_size, self.axes
        transfer = self.strip_transfer if self.width == "strip" else None
        if self.granular:
            transfer = Transfer()
        low = [math.floor(x / h + 1e-6) * h for x in lower]
        high = [math.ceil(x / h - 1e-6) * h for x in upper]
        return Scene(
            dimension=axes.dimension,
            cell_size=h,
            lower=axes.point(*low),
            upper=axes.point(*high),
            gravity=axes.point(*gravity),
            method=Method(transfer=transfer, leaving="delete"),
            name=f"{self.title}, {self.width}",
        )

    def _along(self, table: TimeTable) -> TimeTable:
        """Return a table of numbers as one of vectors along x."""
        return TimeTable(table.time, [self.axes.point(float(x), 0.0, 0.0) for x in table.value])  # type: ignore[arg-type]


def wall() -> Slip:
    """Return what pistons do, and walls that ask for linear cells by name."""
    return Slip(cell="linear")


def softened(what: str, measured: float, modulus: float) -> Deviation:
    """Return that debris is softer than it is by `modulus` in place of `measured`, Pa."""
    share = math.sqrt(modulus / measured)
    return Deviation(f"E of the {what}", f"{measured:.2g} Pa", f"{modulus:.3g} Pa",
                     f"longer steps; a dry blow, v A √(E ρ), is √(E/E₀) = {share:.2g} of its "
                     "own")  # fmt: skip


def modulus_at_speed(density: float, poisson: float, speed: float) -> float:
    """Return the E at which pressure waves run through a solid at a speed, Pa.

    ρ c² = E (1 - ν) / ((1 + ν) (1 - 2 ν)).
    """
    return density * speed**2 * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson)
