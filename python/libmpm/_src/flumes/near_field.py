"""The near field of a flume: a strip's run cut, tiled, and led by a piston as its water moved."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, Self

import numpy as np

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Displacement, Slip
from libmpm._src.errors import ModelWarning, SceneError
from libmpm._src.flumes.facility import Facility, Instrument
from libmpm._src.flumes.virtual_paddle import piston_of_flow
from libmpm._src.output.checkpoint import load_header
from libmpm._src.run.checkpoint_state import caught
from libmpm._src.scene.changes import drop_packing_options
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.engine_sensors import LoadCell, Sensor
from libmpm._src.sensors.python_sensors import GridSensor
from libmpm._src.shapes.boxes import Box

__all__ = ["CHECKPOINT", "FacilityOfStrips", "half_metres"]

#: Checkpoint in a folder of near fields at which they begin.
CHECKPOINT = "near.npz"
#: Time between two readings, s.
_EVERY = 0.05
#: By how much a cut may lie beside the time that it was asked for, s: more than a step.
_SAME_TIME = 0.01
#: How far the leading piston and the walls reach beyond the domain, m.
_BEYOND = 6.0


def half_metres(first: float, last: float) -> tuple[float, ...]:
    """Return the places every half metre from `first` to `last`, m."""
    return tuple(float(x) for x in np.arange(first, last + 0.01, 0.5))


class FacilityOfStrips(Facility):
    """Base of the facilities that have a near field, cut out of the run of a strip.

    They are `LargeWaveFlume` and `DirectionalWaveBasin`. The strip (`trunk`) is one cell wide,
    without structure and debris, and serves all set-ups: `near_field` makes of its run the half of
    the facility about structure and debris.
    """

    strips: ClassVar[bool] = True
    #: x at which a strip records the mean velocity of its water, m; a near field begins in between.
    stations: ClassVar[tuple[float, ...]]
    #: What `near_field` takes by default: `begin`, s of the laboratory, and `lower`, m.
    near: ClassVar[tuple[float, float]]
    #: Time between two readings of an instrument, s, by its kind.
    intervals: ClassVar[Mapping[str, float]]

    # What each facility says -----------------------------------------------------------------

    def half_width(self) -> float:
        """Return half of the width of the whole facility, on faces of cells, m."""
        raise NotImplementedError

    def add_structures(self, made: Scene) -> None:
        """Add structure and debris to a scene of the facility."""
        raise NotImplementedError

    # What all of them do ---------------------------------------------------------------------

    def add_parts(self, made: Scene) -> None:
        """Add what a near field has of its own: structure, debris, instruments from its cut on.

        A strip gets its stations.
        """
        self.add_structures(made)
        for one in self.instruments():
            if one.x >= made.lower[0]:
                made.add_sensor(name=one.name, sensor=self._sensor(one))
        if self.width == "strip":
            _add_stations(made, self.stations)

    def _sensor(self, one: Instrument) -> Sensor:
        """Return the sensor that reads what an instrument does."""
        every = self.intervals[one.kind]
        if one.kind == "level":
            return self.axes.gauge(one.x, one.y, one.z, every, max(0.1, self.cell_size))
        if one.kind == "velocity":
            return self.axes.probe(one.x, one.y, one.z, every)
        return LoadCell(boundary=one.boundary, interval=every)

    def trunk(self) -> Self:
        """Return the facility one cell wide, without structure, debris and instruments.

        Its scene has sensors "flow-0", "mass-0", ... at `stations`, momentum and mass of the water
        there, from which `near_field` has the mean velocity.
        """
        bare: dict[str, Any] = {"structure": None, "debris": None, "contact": None, "seed": 0}
        return dataclasses.replace(self, width="strip", **bare)  # type: ignore[type-var]

    def near_field(
        self,
        folder: str | Path,
        *,
        begin: float | None = None,
        lower: float | None = None,
        until: float | None = None,
        **options: Any,
    ) -> Scene:
        """Return the part of the facility about its structure, cut out of a run of `trunk()`.

        ========  ====  ===========  ============================================================
        argument  unit  range        meaning
        ========  ====  ===========  ============================================================
        folder    -     -            where the run of the strip lies, or will
        begin     s     > `clock`    of the laboratory, before water has come to structure and
                                     debris; None = 27.5 in the Large Wave Flume, 28.5 in the
                                     Directional Wave Basin
        lower     m     `stations`   x of the cut, moved to a face of cells; None = 26 and 22
        until     s     > begin      of the laboratory, up to which the piston moves; None = the
                                     end of all rows
        options   -     -            of `Simulation`, for the strip
        ========  ====  ===========  ============================================================

        The strip is run once; what lies in `folder` is used again, so that all layouts have one
        water. Its run is cut, tiled to half of the width, and gets structure and debris of this
        value; at the cut a piston moves as the water of the strip did (`flumes.piston_of_flow`).
        Transfer, bed and walls are those of the strip, whatever is added; `packing` is the strip's
        alone where pieces have `contact`, beside which water is neither shifted nor led. `compare`
        takes a run of it; rows that begin before it are not compared.

        Raises `SceneError`: of another `width` than "half", of times and places out of range, where
        `folder` holds another run or a cut at another time, and where water is where a box is to
        stand.
        """
        first, at = self.near
        return _near_field(self, Path(folder), first if begin is None else begin,
                           at if lower is None else lower, until, options)  # fmt: skip


def _add_stations(scene: Scene, at: tuple[float, ...]) -> None:
    """Add sums of mass and momentum of two cells about each station: "flow-0", "mass-0", ..."""
    h = scene.cell_size
    for k, x in enumerate(at):
        region = Box(lower=(x - h, *scene.lower[1:]), upper=(x + h, *scene.upper[1:]))
        measured: tuple[tuple[str, Literal["momentum", "mass"]], ...] = (
            ("flow", "momentum"), ("mass", "mass"),
        )  # fmt: skip
        for name, attribute in measured:
            scene.add_sensor(
                name=f"{name}-{k}",
                sensor=GridSensor(
                    attribute=attribute, operation="sum", region=region, interval=_EVERY,
                    direction="x" if attribute == "momentum" else None,
                ),
            )  # fmt: skip


def _near_field(
    flume: FacilityOfStrips,
    folder: Path,
    begin: float,
    lower: float,
    until: float | None,
    options: Mapping[str, Any],
) -> Scene:
    """See `FacilityOfStrips.near_field`."""
    label = f"{flume.label}.near_field"
    if flume.width != "half":
        raise SceneError(f"{label}: width is {flume.width!r}; expected 'half', which a strip can "
                         "be tiled to")  # fmt: skip
    at = flume.stations
    if not at[0] < lower < at[-1]:
        raise SceneError(f"{label}: lower is {lower:g} m; expected between the stations, "
                         f"{at[0]:g} to {at[-1]:g} m")  # fmt: skip
    start = begin - flume.clock
    end = flume.until if until is None else until - flume.clock
    if not 0 < start < end:
        raise SceneError(f"{label}: begin is {begin:g} s of the laboratory; expected between "
                         f"{flume.clock:g} and {end + flume.clock:g} s")  # fmt: skip
    file = folder / CHECKPOINT
    if file.is_file():
        cut = float(load_header(file)[0]["time"])
        if abs(cut - start) > _SAME_TIME:
            raise SceneError(
                f"{label}: {file} is a cut at {cut + flume.clock:g} s of the laboratory; expected "
                f"one at begin, {begin:g} s; give another folder, or its begin"
            )
    results = _trunk(flume, folder, start, end, options)
    h, before = flume.cell_size, results.scene
    low = round(lower / h) * h
    with warnings.catch_warnings():
        # What lies before the cut is meant to be left out.
        warnings.filterwarnings("ignore", "Scene.from_checkpoint", ModelWarning)
        made = Scene.from_checkpoint(
            folder / CHECKPOINT, tiles=round(flume.half_width() / h), axis="y",
            within=Box(lower=(low, *before.lower[1:]), upper=before.upper),
        )  # fmt: skip
    assert made.start is not None
    if flume.contact is not None:
        # Beside contact nothing leads volumes: the water goes on from what the strip has made.
        drop_packing_options(made, "water")
    columns = []
    for k in range(len(at)):
        series = [results.sensors[f"{name}-{k}"] for name in ("flow", "mass")]
        p, m = (np.asarray(s[s.components[0]], np.float64) for s in series)
        columns.append(np.divide(p, m, out=np.zeros_like(p), where=m > 0))
    table = piston_of_flow(results.sensors["flow-0"].time, at, np.array(columns).T,
                           begin=made.start.time, at=low)  # fmt: skip
    when, places = table.arrays()
    wide = (made.lower[1] - 1.0, made.upper[1] + 1.0)
    made.add_boundary(
        name="near-piston", response=Slip(cell="linear"),
        shape=Box(lower=(low - _BEYOND, wide[0], -1.0), upper=(low, wide[1], made.upper[2] + 1.0)),
        motion=Displacement(TimeTable(when, [(float(x), 0.0, 0.0) for x in places])),
    )  # fmt: skip
    there = len(made.boundaries)
    flume.add_parts(made)
    for new in made.boundaries[there:]:
        if isinstance(new.shape, Box) and (wet := caught(made, new.shape)):
            raise SceneError(
                f"{label}: begin is {begin:g} s of the laboratory, when {sum(wet.values())} "
                f"particles of water are where {new.name!r} is to stand; expected none; begin "
                "earlier"
            )
    return made


def _trunk(
    flume: FacilityOfStrips, folder: Path, start: float, until: float, options: Mapping[str, Any]
) -> Any:
    """Return the results of the strip's run to `until` s, with a checkpoint at `start` s of it.

    A run that is whole is taken as it is; one that was cut off is continued, or begun again where
    its time is past `start` without the checkpoint.
    """
    from libmpm._src.output.results import load
    from libmpm._src.output.settings import Output
    from libmpm._src.run.simulation import Simulation

    scene, run, file = flume.trunk().scene(), folder / "trunk", folder / CHECKPOINT
    simulation = None
    if (run / "log.json").is_file():
        results = load(run)
        if results.scene != scene:
            raise SceneError(f"{flume.label}.near_field: {run} holds another run; expected that "
                             "of trunk().scene() of this value; give another folder")  # fmt: skip
        reached = float(results.log.get("time", 0.0))
        if file.is_file() and reached >= until - 1e-9:
            return results
        if results.checkpoints:
            simulation = Simulation.resume(run, device=options.get("device"))
            if simulation.time > start and not file.is_file():
                simulation = None
    settings = Output(run, checkpoint_interval=max(until / 10, 0.1), overwrite=simulation is None)
    if simulation is None:
        simulation = Simulation(scene, output=settings, **options)
    else:
        simulation.set_output(settings)
    if simulation.time < start:
        simulation.run(until=start, progress=False)
    if not file.is_file() or settings.overwrite:
        simulation.save_checkpoint(file)
    simulation.run(until=until, progress=False)
    return load(run)
