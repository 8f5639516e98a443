"""The guard that watches a run at fixed step numbers, and stops it for what may not be.

The engine refuses what is not finite, inverted or too fast for the grid. What grows or leaks slowly
passes by it. `design/guards.md` derives the bounds.
"""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from libmpm._src.boundaries.flows import Inflow
from libmpm._src.errors import ModelWarning, NumericalError
from libmpm._src.materials.material import wave_speed
from libmpm._src.methods.method import FBar
from libmpm._src.run.guard import Guard, opened_by
from libmpm._src.run.guard_memory import Memory
from libmpm._src.run.guard_messages import (
    OFF,
    Offender,
    energy_remedy,
    fastest,
    fastest_within,
    in_words,
    missing,
    moment,
    most_strained,
    smoothing_remedy,
)
from libmpm._src.run.guard_overlap import CRUSHED, entered
from libmpm._src.run.guard_water_level import basin_of
from libmpm._src.scene.places import initial_gravity

if TYPE_CHECKING:
    from libmpm._src.run.running import Running
    from libmpm._src.scene.parts import Body

__all__ = ["Watch"]

#: Steps between two checks: a check takes half a step to five steps on every device.
EVERY = 1000

#: Particles whose volume is looked at, of all bodies together.
SAMPLES = 4096

#: Rise of the whole mass, in cells, that rounding may make of rest.
RISE = 0.02
#: Part of the sound speed at which everything may come to move by rounding.
CALM = 1e-5
#: Part of the elastic energy at the start that is not distinguished from rounding.
STORED = 0.01

#: What the middle of water may lie too low by, in cells: the grid hardly sees where in a cell its
#: particles lie.
SLACK = 0.1

#: Particles of a scene, at most, whose energy is not watched: they may share no node, and what
#: passes between their strains and the affine part of their motion shows in neither sum.
HANDFUL = 8

#: Part of the sound speed above which a flow is not that of water.
SLOW = 0.3
#: How much faster a node must be for a body to be looked at again that was found slow.
AGAIN = 1.1

#: Cells that a wave crosses, at least, in the time over which smoothing is judged.
CROSSED = 100


class Watch:
    """A guard at work on one simulation."""

    def __init__(
        self, simulation: Running, guard: Guard, memory: Mapping[str, Any] | None = None
    ) -> None:
        """Take up the watch, with what a saved run remembers."""
        self._simulation = simulation
        self._guard = guard
        scene = simulation.scene
        self._memory = Memory.restored(memory, len(scene.bodies)) if memory else Memory()
        self.every = guard.every or EVERY
        self._closed = not opened_by(scene)
        self._gravity = float(np.linalg.norm(initial_gravity(scene)))
        densities = {body.material.parameters()["density"] for body in scene.bodies}
        fluid = all(body.material.table.stores_volume for body in scene.bodies)
        #: kg/m³, at rest, in scenes of water of one density; 0 in others.
        self._density = float(densities.pop()) if fluid and len(densities) == 1 else 0.0
        judged = self._density > 0 and guard.level is not None
        self._basin = basin_of(scene) if judged else None
        self._sound = [wave_speed(body.material) or math.inf for body in scene.bodies]
        self._exact = not any(_smooths_apart(body) for body in scene.bodies)
        smoothed = [i for i, body in enumerate(scene.bodies) if body.smoothing is not None]
        self._smoothed = smoothed if guard.smoothing is not None else []
        #: What smoothing had taken in processes before this one, kg, by body: the engine's record
        #: begins again in each.
        self._taken = {name: row[0] for name, row in self._memory.smoothing.items()}
        #: Why the run may not continue; empty while it may.
        self.broken = ""

    def memory(self) -> dict[str, Any]:
        """Return what it remembers as plain values."""
        for number in self._smoothed:
            self._record(number)
        return asdict(self._memory)

    def limit(self, steps: int) -> int:
        """Return how many of `steps` (-1: no limit) may be done before the next look."""
        ahead = self.every - self._simulation.steps % self.every
        return ahead if steps < 0 else min(steps, ahead)

    def removed(self, gone: Sequence[tuple[int, Any, Any, int, str]]) -> None:
        """Take note of particles that the engine says have gone."""
        memory = self._memory
        memory.changed = memory.changed or bool(gone)
        for body, ids, _, _, policy in gone:
            if policy != "freeze" and memory.particles:
                memory.particles[body] -= len(ids)

    def acted(self) -> None:
        """Take note that a program has changed particles: energies are counted again."""
        self._memory.changed = True

    def look(self) -> None:
        """Look if it is time to. Raises `NumericalError` for what may not be."""
        self.refuse()
        step, memory = self._simulation.steps, self._memory
        if memory.step < 0:
            self._begin()
        elif step % self.every == 0 and step > memory.step:
            self._judge(warns=True)
        else:
            return
        memory.step = step

    def before_saving(self) -> None:
        """Refuse a state that may not be, between checks too; nothing is remembered."""
        self.refuse()
        if 0 <= self._memory.step < self._simulation.steps:
            kept = copy.deepcopy(self._memory)
            try:
                self._judge()
            finally:
                self._memory = kept

    def refuse(self) -> None:
        """Raise what was found before, if anything was."""
        if self.broken:
            raise NumericalError(self.broken)

    # What is seen -----------------------------------------------------------------------------

    def _condition(self) -> dict[str, Any]:
        return dict(self._simulation.engine.condition(SAMPLES))

    def _counts(self) -> list[int]:
        return self._simulation.totals()

    def _supplied(self) -> list[int]:
        simulation = self._simulation
        names, found = list(simulation.particles), [0] * len(self._sound)
        for placed in simulation.scene.flows:
            series = simulation.inflow.get(placed.name)
            if series is not None and len(series):
                assert isinstance(placed.flow, Inflow)
                found[names.index(placed.flow.body)] += int(series.values[-1][0])
        return found

    def _begin(self) -> None:
        now, memory = self._condition(), self._memory
        memory.volumes = [None if math.isnan(j) else j for j in now["volume_ratio"]]
        memory.particles, memory.supplied = self._counts(), self._supplied()
        memory.packing = self._packing(now)
        memory.sunk = max(0.0, self._lies(now)[0])
        self._count_from(now)
        self._take(now)
        for number in self._smoothed:
            self._record(number)

    def _count_from(self, now: Mapping[str, Any]) -> None:
        memory = self._memory
        memory.first, memory.elastic, memory.potential = (
            _total(now),
            now["elastic"],
            now["potential"],
        )
        memory.least, memory.changed = math.inf, False

    def _take(self, now: Mapping[str, Any]) -> None:
        """Remember extremes."""
        memory = self._memory
        memory.kinetic = max(memory.kinetic, now["kinetic"])
        memory.unloaded = max(memory.unloaded, memory.elastic - now["elastic"])
        memory.fallen = max(memory.fallen, memory.potential - now["potential"])
        memory.speed = max(memory.speed, now["speed"])
        total = _total(now)
        if total < memory.least:
            memory.least, memory.least_step = total, self._simulation.steps

    # What may not be --------------------------------------------------------------------------

    def _judge(self, warns: bool = False) -> None:
        now = self._condition()
        if self._memory.changed:
            self._count_from(now)
        self._take(now)
        guard = self._guard
        # Before what ends the run: it may be why.
        for number in self._smoothed if warns else ():
            self._smooths(number)
        if warns and guard.level is not None and not self._memory.sinks:
            self._sinks(now, guard.level)
        found = self._lost() if guard.particles else ""
        found = found or self._unreal(now)
        if not found and guard.mach is not None:
            found = self._too_fast(now, guard.mach)
        if not found and guard.volume is not None:
            found = self._swollen(now, guard.volume)
        if not found and guard.packing is not None:
            found = self._crowded(now, guard.packing)
        if not found and guard.overlap is not None:
            found = self._entered(now, guard.overlap)
        watched = self._closed and sum(self._counts()) > HANDFUL
        if not found and guard.energy is not None and watched:
            found = self._gained(now, guard.energy)
        # The verdict of all ranks at once, in the words of one.
        found = self._simulation._shared.agreed(found)
        if found:
            self.broken = found
            raise NumericalError(found)

    def _lost(self) -> str:
        memory, names = self._memory, list(self._simulation.particles)
        came = [b - a for a, b in zip(memory.supplied, self._supplied(), strict=True)]
        wanted = [n + more for n, more in zip(memory.particles, came, strict=True)]
        for i, (have, want) in enumerate(zip(self._counts(), wanted, strict=True)):
            if have != want:
                return (
                    f"body '{names[i]}' has {have} particles {moment(self._simulation)}; expected "
                    f"{want}, what it had with those that came and without those that were listed "
                    f"as gone; {missing(self._simulation, i)}. Remedy: this is a defect of the "
                    f"library; please report it with the scene file; {OFF}"
                )
        return ""

    def _unreal(self, now: Mapping[str, Any]) -> str:
        for name in ("kinetic", "elastic", "potential"):
            if not math.isfinite(now[name]):
                return (
                    f"the {name} energy is {now[name]} {moment(self._simulation)}; expected a "
                    "finite number of J. Remedy: lower Method.cfl or the time step, or scale the "
                    "scene so that its energies have a number"
                )
        return ""

    def _too_fast(self, now: Mapping[str, Any], bound: float) -> str:
        simulation, memory = self._simulation, self._memory
        for body, sound in zip(simulation.scene.bodies, self._sound, strict=True):
            fluid = body.material.table.stores_volume
            seen = max(SLOW * sound, AGAIN * memory.seen.get(body.name, 0.0))
            warns = fluid and body.name not in memory.warned and now["speed"] > seen
            if not (warns or now["speed"] > bound * sound):
                continue
            memory.seen[body.name] = now["speed"]
            at = fastest_within(simulation, body.name)
            if at is None:
                continue
            if at.value > bound * sound:
                return (
                    f"{at}: its speed relative to the body's mean is {at.value:.4g} m/s "
                    f"{moment(simulation)}; expected at most {bound * sound:.4g} m/s, {bound:g} of "
                    f"the sound speed {sound:.4g} m/s. Remedy: a higher "
                    f"{'bulk_modulus' if fluid else 'youngs_modulus'}, smaller velocities of "
                    f"bodies and boundaries, a lower Method.cfl; Guard(mach=...) or {OFF}"
                )
            if warns and at.value > SLOW * sound:
                memory.warned.append(body.name)
                warnings.warn(
                    f"{at}: its speed relative to the body's mean is {at.value:.4g} m/s "
                    f"{moment(simulation)}, {at.value / sound:.2f} of the sound speed; above "
                    f"{SLOW:g} its density changes by more than 5 % and waves steepen to shocks; "
                    "raise bulk_modulus",
                    ModelWarning, stacklevel=6,
                )  # fmt: skip
        return ""

    def _swollen(self, now: Mapping[str, Any], bound: float) -> str:
        simulation, memory = self._simulation, self._memory
        scene = simulation.scene
        depth = float(np.linalg.norm(np.subtract(scene.upper, scene.lower)))
        for i, (body, sound) in enumerate(zip(scene.bodies, self._sound, strict=True)):
            before, ratio = memory.volumes[i], now["volume_ratio"][i]
            if before is None or math.isnan(ratio):
                continue
            if not body.material.table.stores_volume and not self._stores_shape(i):
                continue
            # p/K of a column as high as the domain, and of the blow of what moves.
            mach = memory.speed / sound
            allowed = bound + self._gravity * depth / sound**2 + mach
            if abs(ratio - before) > allowed:
                at = most_strained(simulation, body.name)
                return (
                    f"body '{body.name}': its mean volume ratio is {ratio:.4g} "
                    f"{moment(simulation)} and was {before:.4g} at the start; expected a change of "
                    f"at most {allowed:.3g}: {bound:g}, what its weight makes, and speed by sound "
                    f"speed, {mach:.2g}. Furthest from 1: {in_words(at)}. Remedy: lower "
                    "Method.cfl or the time step, precision='double', a form of F-bar with one "
                    f"volume, or a higher bulk modulus; Guard(volume=...) or {OFF}"
                )
        return ""

    def _record(self, number: int) -> list[float]:
        """Return what smoothing has done to a body: see `Memory.smoothing`."""
        simulation = self._simulation
        name = simulation.scene.bodies[number].name
        row = self._memory.smoothing.setdefault(name, [0.0, 0.0, 0.0, simulation.time])
        _, _, before, change, _ = simulation.engine.smoothing(number).T
        row[0] = self._taken.get(name, 0.0) - float(change.sum())
        row[1] = max(row[1], float(before.max(initial=0.0)))
        return row

    def _smooths(self, number: int) -> None:
        """Warn of smoothing that takes what a body must hold, again and again."""
        simulation, memory, bound = self._simulation, self._memory, self._guard.smoothing
        body, sound = simulation.scene.bodies[number], self._sound[number]
        assert bound is not None and body.smoothing is not None
        taken, held, marked, since = row = self._record(number)
        cell = simulation.scene.cell_size
        crossed = sound * (simulation.time - since) / cell
        # Half a step for the rounding of the sum of steps.
        if not crossed + 0.5 * sound * simulation.dt / cell > CROSSED:
            return
        row[2:] = taken, simulation.time
        # Waves of pressure carry ½ c² m q²; what moves and falls can become such a wave.
        share = 0.5 * sound**2
        there = share * held + memory.kinetic + memory.fallen
        took, allowed = share * (taken - marked), bound * crossed / CROSSED * there
        # What a start is not smooth by is taken once, and is no more than was held.
        if body.name in memory.smooths or not (taken > held and took > allowed):
            return
        memory.smooths.append(body.name)
        unit = "J" if simulation.dimension == 3 else "J/m"
        warnings.warn(
            f"body '{body.name}': smoothing '{body.smoothing.method}' has taken "
            f"{taken / held:.3g} times the energy that the body held at most, "
            f"{took:.4g} {unit} of it since {since:.4g} s, while a wave crossed {crossed:.0f} "
            f"cells, {moment(simulation)}; expected at most {allowed:.4g} {unit}: {bound:g} for "
            f"each {CROSSED} cells of the {there:.4g} {unit} that the body held at most and that "
            "have been released. The body does not hold its stress: it gives way to its load. "
            f"Remedy: {smoothing_remedy(body)}; Guard(smoothing=None) leaves it unwatched",
            ModelWarning, stacklevel=6,
        )  # fmt: skip

    def _fluid_volume(self, now: Mapping[str, Any]) -> tuple[float, float]:
        """Return what the particles' volumes add up to, m³ (2D: m²), and the density at rest.

        Both zero in scenes that are not of water of one density alone.
        """
        counts = self._counts()
        if self._density == 0 or not sum(counts):
            return 0.0, 0.0
        ratio = sum(n * j for n, j in zip(counts, now["volume_ratio"], strict=True) if n)
        return float(now["mass"] / self._density * ratio / sum(counts)), self._density

    def _packing(self, now: Mapping[str, Any]) -> float:
        """Return the density at the nodes by that of the particles' volumes; 1 where unknown.

        A full node of water at rest density has 1, a free surface less, piled particles more.
        """
        volume, _ = self._fluid_volume(now)
        if not volume > 0 or math.isnan(now["density"]):
            return 1.0
        return float(now["density"] * volume / now["mass"])

    def _crowded(self, now: Mapping[str, Any], bound: float) -> str:
        simulation, start = self._simulation, max(1.0, self._memory.packing)
        here = self._packing(now)
        if here <= start * (1 + bound):
            return ""
        return (
            f"particles lie {here:.3g} times as densely at the nodes as their volumes say "
            f"{moment(simulation)}; expected at most {start * (1 + bound):.3g} times: water has "
            "lost volume that its pressure does not know of. Remedy: more particles per cell, "
            "transfer 'APIC', precision='double' or a longer time step, in which small strains "
            f"are not lost; Guard(packing=...) or {OFF}"
        )

    def _entered(self, now: Mapping[str, Any], bound: float) -> str:
        simulation = self._simulation
        found = entered(simulation, now["volume_ratio"], simulation.steps // self.every)
        if found is None or found.depth <= bound:
            return ""
        scene = simulation.scene
        body, other, crushed = (
            scene.bodies[i].name for i in (found.body, found.other, found.crushed)
        )
        at = Offender(body, found.id, found.position, found.depth)
        return (
            f"{at}: its middle lies {found.depth:.3g} cells inside body '{other}', from which "
            f"contact '{scene.contacts[found.contact].name}' keeps it apart, "
            f"{moment(simulation)}; expected at most {bound:g} cells. Body '{crushed}' has "
            f"{now['volume_ratio'][found.crushed]:.2g} of its volume left: contact measures gaps "
            f"by the density at rest, and below {CRUSHED:g} of the volume edges turn and enter "
            f"their neighbours. Remedy: a stiffer '{crushed}', a shorter stroke or less load, "
            f"friction between the two (static 0.3 or more); Guard(overlap=...) or {OFF}"
        )

    def _lies(self, now: Mapping[str, Any]) -> tuple[float, float, float, float]:
        """Return how much lower than it can the middle of all water lies, m, and what that is from.

        Height of the middle, the least that it can be and that of the floor below it, m, against
        gravity from the domain's lower corner; all zero where it is not known.
        """
        volume, _ = self._fluid_volume(now)
        least = self._basin.lowest_middle(volume) if self._basin is not None else None
        if least is None or least[0] - least[1] < self._simulation.scene.cell_size:
            return 0.0, 0.0, 0.0, 0.0
        middle = now["potential"] / (now["mass"] * self._gravity)
        return least[0] - middle, middle, *least

    def _sinks(self, now: Mapping[str, Any], bound: float) -> None:
        """Warn of water that has got lower than its volume can lie."""
        simulation, memory = self._simulation, self._memory
        below, middle, least, floor = self._lies(now)
        allowed = memory.sunk + bound * (least - floor) + SLACK * simulation.scene.cell_size
        if below <= allowed:
            return
        memory.sinks = True
        names = ", ".join(f"'{body.name}'" for body in simulation.scene.bodies)
        volume, unit = self._fluid_volume(now)[0], "m³" if simulation.dimension == 3 else "m²"
        warnings.warn(
            f"body {names}: its middle has sunk to {middle - floor:.4g} m above the floor "
            f"{moment(simulation)}; the {volume:.4g} {unit} of its particles can lie no lower than "
            f"{least - floor:.4g} m in this domain; expected at least "
            f"{least - floor - allowed:.4g} m, {bound:g} of that and {SLACK:g} of a cell less. It "
            "has lost volume that its pressure does not know of. Remedy: precision='double' for "
            "water that rests for millions of steps, a longer FBar(time=...) or fbar=None, Slip or "
            "Separable walls instead of Mirror where water strikes them; Guard(level=None) leaves "
            "it unwatched",
            ModelWarning, stacklevel=6,
        )  # fmt: skip

    def _stores_shape(self, index: int) -> bool:
        """Whether the volume of a solid is elastic, and nothing from outside presses on it."""
        names = self._simulation.engine.attribute_names(index)
        return self._closed and "plastic_strain" not in names and "yields" not in names

    def _growth(self, now: Mapping[str, Any], part: float) -> tuple[float, float, float, int]:
        """Return by how much energy has grown, by how much it may, what was released, since when.

        The last is a step, the others are in J (2D: J/m).
        """
        simulation, memory = self._simulation, self._memory
        sound = max((x for x in self._sound if math.isfinite(x)), default=0.0)
        released = memory.kinetic + memory.fallen + memory.unloaded
        weight = now["mass"] * self._gravity
        # Positions and stresses are of this moment, velocities of half a step later.
        rounding = (
            weight * (RISE * simulation.scene.cell_size + memory.speed * simulation.dt)
            + 0.5 * now["mass"] * (CALM * sound) ** 2
            + STORED * abs(memory.elastic)
        )
        allowed = part * released + rounding
        if self._exact:
            return _total(now) - memory.least, allowed, released, memory.least_step
        # The elastic energy of volumes that no stress follows is none: all that there was at the
        # start may have become motion, and nothing more.
        return now["kinetic"] + now["potential"] - memory.first, allowed, released, 0

    def _gained(self, now: Mapping[str, Any], part: float) -> str:
        simulation = self._simulation
        grown, bound, released, since = self._growth(now, part)
        if grown <= bound:
            return ""
        unit = "J" if simulation.dimension == 3 else "J/m"
        return (
            f"the mechanical energy has grown by {grown:.4g} {unit} since step {since}, "
            f"{moment(simulation)}, though nothing does work on the scene; expected at most "
            f"{bound:.4g} {unit}: {part:g} of the {released:.4g} {unit} that have been released, "
            f"and rounding. Kinetic {now['kinetic']:.4g}, elastic {now['elastic']:.4g}, potential "
            f"{now['potential']:.4g} {unit}. Fastest: {in_words(fastest(simulation), 'm/s')}. "
            f"Remedy: {energy_remedy(simulation)}"
        )


def _total(now: Mapping[str, Any]) -> float:
    return float(now["kinetic"] + now["elastic"] + now["potential"])


def _smooths_apart(body: Body) -> bool:
    """Whether its stress follows another volume than the one whose energy is counted."""
    form = body.fbar.form if isinstance(body.fbar, FBar) else ""
    return form in ("two-volume", "split", "literal", "stress-only")
