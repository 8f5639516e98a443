"""All series of a run, the engine's and Python's, when due; a new sensor is added here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.schedule import due_index, due_time
from libmpm._src.errors import NumericalError, SceneError
from libmpm._src.output.series import Series
from libmpm._src.run.views import world_shift
from libmpm._src.run.whole_run import WholeRun
from libmpm._src.sensors.body_sensors import OfBody
from libmpm._src.sensors.column_gauge import ColumnGauge
from libmpm._src.sensors.column_gauge_sampler import OfColumn
from libmpm._src.sensors.contact_force import OfContact
from libmpm._src.sensors.custom_functions import check_functions
from libmpm._src.sensors.grid_sensors import OfGrid
from libmpm._src.sensors.particle_sensors import OfAttributes, OfElevation, OfParticles, OfPressure
from libmpm._src.sensors.python_sensors import (
    AttributeTracker,
    BodyTracker,
    ContactForce,
    Custom,
    ElevationGauge,
    GridSensor,
    ParticleSensor,
    PressureProbe,
    Sampled,
)
from libmpm._src.sensors.reductions import Array
from libmpm._src.sensors.sampler import Sampler, SummedBody
from libmpm._src.sensors.step_readings import Moment
from libmpm._src.sensors.tally_rows import split

if TYPE_CHECKING:
    from libmpm._src.output.checkpoint import Checkpoint
    from libmpm._src.run.running import Running
    from libmpm._src.scene.data import SceneData

__all__ = ["Measurements", "sampler"]


class OfFunction(Sampler):
    """Calls a function of the user's."""

    def __init__(self, _scene: SceneData, sensor: Custom) -> None:
        """Take a sensor that has been checked."""
        self._sensor = sensor
        self.columns = tuple(sensor.columns)
        self.units = tuple(sensor.units or ("1",) * len(self.columns))

    def row(self, moment: Moment) -> Array:
        """Return what the function returns."""
        assert callable(self._sensor.function)
        try:
            given = self._sensor.function(moment.simulation)
        except NumericalError as error:  # that of the run ends all ranks, this one knows of none
            raise SceneError(f"its function has failed: {error}") from error
        row = np.atleast_1d(np.asarray(given, dtype=np.float64))
        if row.shape != (len(self.columns),):
            raise SceneError(
                f"its function returned {given!r:.80}; expected {len(self.columns)} numbers, for "
                f"{', '.join(self.columns)}"
            )
        return row


_SAMPLERS: dict[type[Sampled], Any] = {
    ParticleSensor: OfParticles, GridSensor: OfGrid, BodyTracker: OfBody,
    AttributeTracker: OfAttributes, PressureProbe: OfPressure, ElevationGauge: OfElevation,
    ColumnGauge: OfColumn, ContactForce: OfContact, Custom: OfFunction,
}  # fmt: skip


def sampler(scene: SceneData, sensor: Sampled) -> Sampler:
    """Return what evaluates a sensor of a scene."""
    made: Sampler = _SAMPLERS[type(sensor)](scene, sensor)
    return made


def _summed_body(
    description: Mapping[str, Any], bodies: Sequence[Mapping[str, Any]]
) -> SummedBody | None:
    """Return the body that the tallies of a sensor are of; None of several."""
    numbers = {t["body"] for t in description["tallies"]}
    if len(numbers) > 1:
        return None
    tally = description["tallies"][0]
    places = next((t["places"] for t in description["tallies"] if "places" in t), None)
    body = bodies[tally["body"]]
    return SummedBody(
        float(body["particle_mass"]), tally["reference"], tally["origin"], int(tally["first"]),
        None if places is None else places.reshape(-1, len(tally["origin"])),
    )  # fmt: skip


class _Python:
    """A sensor whose samples are made here: its series, and when it is due next."""

    def __init__(self, name: str, scene: SceneData, sensor: Sampled) -> None:
        self.interval = sensor.interval
        self.sampler = sampler(scene, sensor)
        attributes = {"kind": sensor.kind, "interval": sensor.interval}
        columns, units = self.sampler.columns, self.sampler.units
        self.series = Series(name, columns, units, attributes)

    def due(self) -> float:
        """Return the time, s, from which the next sample may be taken."""
        if self.sampler.again_after is not None:
            return math.nextafter(self.sampler.again_after, math.inf)
        if not len(self.series):
            return -math.inf
        last = float(self.series.since(len(self.series) - 1)[0][0])
        if self.interval == 0:
            return math.nextafter(last, math.inf)
        return due_time(due_index(last, self.interval) + 1, self.interval)


class Measurements:
    """The series of all sensors of a run, in the scene's order."""

    def __init__(
        self,
        simulation: Running,
        engine: Any,
        specification: Mapping[str, Any],
        restored: Checkpoint | None,
    ) -> None:
        """Make the series, with the samples of a restored run."""
        self._simulation = simulation
        link = simulation._shared.link
        #: What samples are worked out from.
        self._read = simulation if link is None else cast("Running", WholeRun(simulation, link))
        scene = simulation.scene
        check_functions(scene)
        self.series: list[Series] = []
        #: And what makes samples of the engine's rows: a shift to the world, or a sampler of sums.
        self._of_engine: list[tuple[Series, NDArray[np.float64] | Sampler]] = []
        self._python: list[_Python] = []
        self._busy = False
        described = list(specification["sensors"])
        tallied = {d["name"]: d for d in described if d["kind"] == "tally"}
        for i, placed in enumerate(scene.sensors):
            if isinstance(placed.sensor, Sampled):
                made = _Python(placed.name, scene, placed.sensor)
                if restored is not None and i < len(restored.sensors):
                    made.sampler.restore(restored.memory_of(i))
                series = made.series
                if placed.name in tallied:
                    sums = tallied[placed.name]
                    made.sampler.summed = _summed_body(sums, specification["bodies"])
                    self._of_engine.append((series, made.sampler))
                else:
                    self._python.append(made)
            else:
                number = len(self._of_engine)
                description = described[number]
                components, units = engine.sensor_columns(number)
                attributes = {"kind": description["kind"], "interval": description["interval"]}
                series = Series(description["name"], tuple(components), tuple(units), attributes)
                shift = world_shift(description, components, simulation.offset)
                self._of_engine.append((series, shift))
            if restored is not None and i < len(restored.sensors):
                time, values, _, _ = restored.sensors[i]
                series.append(time, values)
            self.series.append(series)

    def drain(self, engine: Any) -> None:
        """Take the samples that the engine has gathered."""
        for (series, made), (time, values) in zip(self._of_engine, engine.drain(), strict=True):
            if not len(time):
                continue
            rows = np.asarray(values)
            if isinstance(made, Sampler):
                tallies, dt = split(rows)
                series.append(time, made.rows(np.asarray(time), tallies, dt))
            else:
                series.append(time, rows + made)

    @property
    def engine_names(self) -> list[str]:
        """Names of the sensors that the engine samples, in its order."""
        return [series.name for series, _ in self._of_engine]

    @property
    def busy(self) -> bool:
        """Whether a sensor is being evaluated now."""
        return self._busy

    def limit(self, steps: int) -> int:
        """Return how many of `steps` (-1: no limit) may be done before samples are due."""
        every = any(p.interval == 0 for p in self._python)
        return 1 if every and steps != 0 else steps

    def next_time(self) -> float:
        """Return the time, s, at which a sample is due next; infinity if none is."""
        return min((p.due() for p in self._python if p.interval > 0), default=math.inf)

    def service(self) -> None:
        """Take the samples that are due at the present time."""
        if not self._python:
            return
        if self._busy:
            raise SceneError(
                "the function of a sensors.Custom advances the simulation that calls it; expected "
                "it to read only"
            )
        now = self._simulation.time
        due = [p for p in self._python if p.due() <= now]
        if not due:
            return
        self._busy = True
        try:
            moment = Moment(self._read)
            for one in due:
                one.sampler.announce(moment)
            for one in due:
                row = self._row(one, moment)
                if row is None:
                    continue
                one.series.append(np.array([now]), np.array([row], dtype=np.float64))
        finally:
            self._busy = False

    @staticmethod
    def _row(one: _Python, moment: Moment) -> Sequence[float] | Array | None:
        try:
            return one.sampler.row(moment)
        except SceneError as error:
            name = f"sensor '{one.series.name}': "
            raise SceneError([f"{name}{p}" for p in error.problems]) from error

    def memory(self) -> dict[int, dict[str, NDArray[Any]]]:
        """Return what a resumed run needs besides the series, by number of the sensor."""
        numbers = {id(s): i for i, s in enumerate(self.series)}
        samplers = [(p.series, p.sampler) for p in self._python]
        samplers += [(s, made) for s, made in self._of_engine if isinstance(made, Sampler)]
        return {numbers[id(series)]: made.state() for series, made in samplers}
