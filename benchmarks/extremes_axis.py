"""What the extremes are made of: an axis that is pushed, a trial at one value, and its outcome.

An `Axis` builds a `Trial` for any value in its reach: a scene with all else scaled, how far it
runs, and a judge that says in words what is wrong with the result, or nothing. `probe` runs one
trial in this process; `extremes_workers.py` calls it in processes that may crash or hang.
"""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

import libmpm
from libmpm._src.advice.cases.choices import energies

#: What a trial can end in, from the best to the worst. "refused" comes before the first step, and
#: "named" after it, both as a `libmpm.Error`; of "warned" a `ModelWarning` has said what will be
#: wrong, of "wrong" the program says nothing.
OUTCOMES = ("holds", "refused", "named", "warned", "wrong", "not finite", "crash", "hang")

#: Outcomes that no value may have, wherever it lies.
FORBIDDEN = ("wrong", "not finite", "crash", "hang")

#: What is looked at in every body that has it.
ATTRIBUTES = ("position", "velocity", "pressure", "stress", "volume_ratio", "deformation_gradient")

Judge = Callable[[libmpm.Simulation], str]


@dataclass
class Trial:
    """A scene at one value of an axis.

    Parameters
    ----------
    scene
        What runs.
    until, steps
        How far: simulated time, s, or a number of steps; one of the two.
    judge
        Called at the end: "" or what is wrong, with the number and its bound.
    watch
        Called after each of `pieces` parts of the run like `judge`, which sees the end alone.
    prepare
        Called before the first step, for instance to set initial arrays.
    options
        Arguments of `Simulation`, such as `time_step`.
    pieces
        Parts of the run after which all arrays are looked at.
    """

    scene: libmpm.Scene
    judge: Judge
    until: float | None = None
    steps: int | None = None
    watch: Judge | None = None
    prepare: Callable[[libmpm.Simulation], None] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    pieces: int = 8


@dataclass(frozen=True)
class Axis:
    """One number of a scene that is pushed until the run fails or becomes wrong.

    Parameters
    ----------
    name, unit, meaning
        For the map; the name is unique among all axes.
    base
        Value of the base scene, which holds.
    envelope
        (lower, upper) between which everything must hold; None where none is promised.
    reach
        (lowest, highest) value that is tried.
    scale
        "log": from the base outwards by factors; "linear": by equal parts; "integer": by factors,
        whole numbers.
    build
        Value -> `Trial`.
    group
        "water", "solid", "contact", "geometry", or "pairs of ..." these.
    says
        What physics or arithmetic says about the ends, for the map.
    limit
        Seconds after which a probe hangs.
    on_demand
        Runs only where it is named: long.
    cheap
        Its envelope is part of the tests.
    warns
        Part of the `ModelWarning` that tells of what is wrong outside the envelope.
    also
        Single values that are tried beside, such as 0 of an axis with a logarithmic scale.
    """

    name: str
    unit: str
    meaning: str
    base: float
    envelope: tuple[float, float] | None
    reach: tuple[float, float]
    scale: Literal["log", "linear", "integer"]
    build: Callable[[float], Trial]
    group: str = "water"
    says: str = ""
    limit: float = 60.0
    on_demand: bool = False
    cheap: bool = True
    warns: str = ""
    also: tuple[float, ...] = ()


@dataclass
class Outcome:
    """What a trial ended in, and what the program said."""

    outcome: str
    message: str = ""
    warnings: list[str] = field(default_factory=list)
    steps: int = 0
    wall_s: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether nothing broke."""
        return self.outcome == "holds"

    @property
    def broken(self) -> bool:
        """Whether it ended as no run may end."""
        return self.outcome in FORBIDDEN


# ---- what every trial is looked at for ----------------------------------------------------------


def arrays_of(simulation: libmpm.Simulation) -> dict[str, np.ndarray[Any, Any]]:
    """Return every array of particles that the files of a run could get, by "body: name"."""
    found = {}
    for body, particles in simulation.particles.items():
        names = [n for n in ATTRIBUTES if n in particles]
        found |= {f"{body}: {n}": np.asarray(a) for n, a in particles.read(names).items()}
    return found


def not_finite(simulation: libmpm.Simulation) -> str:
    """Return "" or the first array with a number that is not finite."""
    for name, array in arrays_of(simulation).items():
        bad = ~np.isfinite(array.reshape(len(array), -1)).all(axis=1)
        if bad.any():
            return f"{name} has {int(bad.sum())} rows that are not finite"
    return sampled_not_finite(simulation)


def sampled_not_finite(simulation: libmpm.Simulation) -> str:
    """Return "" or the first sensor with a sample that is not finite."""
    for name, series in simulation.sensors.items():
        if not np.isfinite(np.asarray(series.values)).all():
            return f"sensor {name} has samples that are not finite"
    return ""


def incomplete(simulation: libmpm.Simulation, counts: Mapping[str, int]) -> str:
    """Return "" or the body whose ids are no longer those of the start."""
    for name, count in counts.items():
        ids = np.sort(np.asarray(simulation.particles[name]["id"]))
        if len(ids) != count or (np.diff(ids) != 1).any():
            return f"body '{name}' has {len(np.unique(ids))} of its {count} particles"
    return ""


def first(*judges: Judge) -> Judge:
    """Return a judge that says what the first of these says that finds anything wrong."""

    def judge(simulation: libmpm.Simulation) -> str:
        return next((said for j in judges if (said := j(simulation))), "")

    return judge


def bounded(what: str, value: float, low: float, high: float, unit: str = "") -> str:
    """Return "" or that a value lies outside its bounds; NaN does."""
    if low <= value <= high:
        return ""
    tail = f" {unit}" if unit else ""
    return f"{what} is {value:.6g}{tail}; expected {low:.6g} to {high:.6g}{tail}"


def no_energy_gain(scale: Callable[[Mapping[str, Any]], float], part: float = 0.01) -> Judge:
    """Return a judge: the total energy stays below its start by more than `part` of a scale."""

    def judge(simulation: libmpm.Simulation) -> str:
        columns = energies(simulation)
        total = columns["total"]
        gain = float(np.max(total - total[0])) / scale(columns)
        return bounded("gain of energy", gain, -math.inf, part)

    return judge


# ---- one probe ----------------------------------------------------------------------------------


def probe(axis: Axis, value: float, **options: Any) -> Outcome:
    """Run one trial here, and say what it ended in. `options` go to `Simulation`.

    What crashes or hangs takes this process with it: see `extremes_workers.py`.
    """
    start = time.process_time()
    simulation: libmpm.Simulation | None = None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", libmpm.ModelWarning)
        try:
            trial = axis.build(value)
            simulation = libmpm.Simulation(trial.scene, **{**trial.options, **options})
            outcome = _run(trial, simulation)
        except libmpm.Error as error:
            begun = simulation is not None and simulation._assembly.made is not None
            begun = begun and (simulation.steps > 0 or isinstance(error, libmpm.NumericalError))
            outcome = Outcome("named" if begun else "refused", str(error))
            # The offender can be looked at; what was recorded before it was found must be whole.
            if begun and simulation is not None and (said := sampled_not_finite(simulation)):
                outcome = Outcome("not finite", f"{said}, after: {error}")
    said = [str(w.message) for w in caught if issubclass(w.category, libmpm.ModelWarning)]
    outcome.warnings = sorted(set(said))
    told = [text for text in outcome.warnings if axis.warns and axis.warns in text]
    if outcome.outcome == "wrong" and told:
        outcome.outcome, outcome.message = "warned", f"{told[0]}. Then {outcome.message}"
    if simulation is not None and simulation._assembly.made is not None:
        outcome.steps = int(simulation.steps)
    outcome.wall_s = time.process_time() - start
    return outcome


def _run(trial: Trial, simulation: libmpm.Simulation) -> Outcome:
    if trial.prepare is not None:
        trial.prepare(simulation)
    counts = {b.name: len(simulation.particles[b.name]["id"]) for b in trial.scene.bodies}
    for k in range(1, trial.pieces + 1):
        if trial.until is not None:
            simulation.run(until=trial.until * k / trial.pieces, progress=False)
        else:
            assert trial.steps is not None
            simulation.step(trial.steps * k // trial.pieces - simulation.steps)
        if said := not_finite(simulation):
            return Outcome("not finite", said)
        said = incomplete(simulation, counts)
        if not said and trial.watch is not None:
            said = trial.watch(simulation)
        if said:
            return Outcome("wrong", f"at step {simulation.steps}: {said}")
    said = trial.judge(simulation)
    return Outcome("wrong", said) if said else Outcome("holds")
