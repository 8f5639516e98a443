"""The near field of a flume: a strip's run cut, tiled, and led by a piston as its water moved."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from libmpm._src.base.time_tables import TimeTable
from libmpm._src.boundaries.responses import Displacement, Slip
from libmpm._src.errors import ModelWarning, SceneError
from libmpm._src.flumes.virtual_paddle import piston_of_flow
from libmpm._src.output.checkpoint import load_header
from libmpm._src.run.checkpoint_state import caught
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.python_sensors import GridSensor
from libmpm._src.shapes.boxes import Box

if TYPE_CHECKING:
    from libmpm._src.flumes.large_wave_flume import LargeWaveFlume

__all__ = ["CHECKPOINT", "STATIONS", "add_stations", "near_field"]

#: x at which the mean velocity of the water is recorded, m; a near field begins in between.
STATIONS = tuple(float(x) for x in np.arange(20.0, 36.01, 0.5))
#: Checkpoint in a folder of near fields at which they begin.
CHECKPOINT = "near.npz"
#: Time between two readings, s.
_EVERY = 0.05
#: By how much a cut may lie beside the time that it was asked for, s: more than a step.
_SAME_TIME = 0.01
#: How far the leading piston and the walls reach beyond the domain, m.
_BEYOND = 6.0


def add_stations(scene: Scene) -> None:
    """Add sums of mass and momentum of two cells about each station: "flow-0", "mass-0", ..."""
    h = scene.cell_size
    for k, x in enumerate(STATIONS):
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


def near_field(
    flume: LargeWaveFlume,
    folder: Path,
    begin: float,
    lower: float,
    until: float | None,
    options: Mapping[str, Any],
) -> Scene:
    """See `LargeWaveFlume.near_field`."""
    label = f"{flume.label}.near_field"
    if flume.width != "half":
        raise SceneError(f"{label}: width is {flume.width!r}; expected 'half', which a strip can "
                         "be tiled to")  # fmt: skip
    if not STATIONS[0] < lower < STATIONS[-1]:
        raise SceneError(f"{label}: lower is {lower:g} m; expected between the stations, "
                         f"{STATIONS[0]:g} to {STATIONS[-1]:g} m")  # fmt: skip
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
    columns = []
    for k in range(len(STATIONS)):
        series = [results.sensors[f"{name}-{k}"] for name in ("flow", "mass")]
        p, m = (np.asarray(s[s.components[0]], np.float64) for s in series)
        columns.append(np.divide(p, m, out=np.zeros_like(p), where=m > 0))
    table = piston_of_flow(results.sensors["flow-0"].time, STATIONS, np.array(columns).T,
                           begin=made.start.time, at=low)  # fmt: skip
    at, places = table.arrays()
    wide = (made.lower[1] - 1.0, made.upper[1] + 1.0)
    made.add_boundary(
        name="near-piston", response=Slip(cell="linear"),
        shape=Box(lower=(low - _BEYOND, wide[0], -1.0), upper=(low, wide[1], made.upper[2] + 1.0)),
        motion=Displacement(TimeTable(at, [(float(x), 0.0, 0.0) for x in places])),
    )  # fmt: skip
    flume.add_parts(made)
    box = next((b.shape for b in made.boundaries if b.name == "box"), None)
    if isinstance(box, Box) and (wet := caught(made, box)):
        raise SceneError(
            f"{label}: begin is {begin:g} s of the laboratory, when {sum(wet.values())} particles "
            "of water are where the box is to stand; expected none; begin earlier"
        )
    return made


def _trunk(
    flume: LargeWaveFlume, folder: Path, start: float, until: float, options: Mapping[str, Any]
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
