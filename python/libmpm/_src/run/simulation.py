"""`Simulation`: a scene in motion; the run loop between engine, sensors and output folder."""

from __future__ import annotations

import math
import os
import time as clock
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.interrupts import asked_to_stop, deferred_interrupt
from libmpm._src.base.values import warn, warned_already
from libmpm._src.boundaries.flow_layers import OUTFLOW, Traffic
from libmpm._src.errors import (
    CapacityError,
    CheckpointError,
    Error,
    ModelWarning,
    NumericalError,
    SceneError,
)
from libmpm._src.methods.smoothing import history
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output.series import Series
from libmpm._src.output.settings import Output
from libmpm._src.output.writer import Writer
from libmpm._src.run import backends
from libmpm._src.run.engine_spec import (
    check_backend,
    choose_precision,
    lower,
    world_offset,
)
from libmpm._src.run.fault_messages import describe_fault, describe_removed, removed_rows
from libmpm._src.run.files import Persistent
from libmpm._src.run.forked_processes import check_fork, forked
from libmpm._src.run.guard import Guard, as_guard
from libmpm._src.run.guard_watch import Watch
from libmpm._src.run.initial_values import Initial
from libmpm._src.run.partition import Partition, as_partition, told_ranks
from libmpm._src.run.plan import Plan, build_plan
from libmpm._src.run.progress import Progress, State, reporter
from libmpm._src.run.shared_ranks import Sharing
from libmpm._src.run.thread_turns import Turns
from libmpm._src.run.views import GridView, ParticlesView, SensorsView
from libmpm._src.scene.checks_time_steps import many_steps
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.custom_functions import with_functions
from libmpm._src.sensors.sampling_loop import Measurements

__all__ = ["Simulation"]

#: Seconds of wall time after which the engine returns, so that a key press is answered.
SLICE = 0.2


class Simulation(Persistent, Sharing):
    """Runs a scene on one device.

    Parameters
    ----------
    scene
        The description; a copy is kept.
    device
        "auto" (CUDA if there is a device, else the CPU), "cpu", "cuda" or "cuda:<index>". Several,
        such as ["cpu", "cpu"] or ["cuda:0", "cuda:1"], share the scene as ranks, each with its own
        part of it: the results have the bits of one. CUDA devices must be alike and reach each
        other's memory, as NVLink gives it; a device may be named twice. Of ranks as processes it is
        that of this one: "cpu" (or "auto"), or "cuda", which is the device with the number of the
        process on its host.
    precision
        "single", "double", or on CUDA devices "mixed": particles double, grid single. "auto" is
        single, and double on grids of functions, which have no other.
    pipeline
        "auto", "fused", "two-pass" or "phased".
    output
        A folder (sensors only) or an `Output` with intervals for frames and checkpoints.
    threads
        CPU threads; 0 takes the default. Of ranks as processes: those of each.
    ranks
        "processes" shares the scene among the processes that `mpirun`, `srun` or `torchrun` has
        started: each makes this simulation and all the same calls, and has a part of the particles.
        None: by `device` alone, whatever has started this process.
    partition
        Where several ranks share the scene: how its blocks are cut, where at the start, and when
        anew, a `Partition`.
        None has it chosen. The results have the same bits with any.
    shared_device
        True where other simulations run on the same CUDA device at the same time: together they
        are faster, one alone is slower. Results differ from those without it by rounding, and are
        the same bits in whatever company.
    time_step
        A fixed step, s, instead of the scene's; refused if above the stable one.
    functions
        Callables of `sensors.Custom` sensors by name, where the scene comes from a file, which
        keeps only their names.
    guard
        What the run watches about itself, a `Guard`; True for the usual one, None for none. What it
        finds is a `NumericalError`.

    Memory is taken on first use: the first step, array or sensor that is asked for. Stepping in
    any portions, reading, frames and checkpoints never change the bits of a run.

    One thread at a time runs it; others may read meanwhile, each read of the boundary of a step
    and at most some tenths of a second late. Several reads of one moment: `paused`.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        device: str | Sequence[str] = "auto",
        precision: str = "auto",
        pipeline: str = "auto",
        output: Output | str | Path | None = None,
        threads: int = 0,
        shared_device: bool = False,
        time_step: float | None = None,
        functions: Mapping[str, Callable[[Any], Any]] | None = None,
        guard: Guard | bool | None = True,
        ranks: str | None = None,
        partition: Partition | None = None,
    ) -> None:
        """Check the request; nothing is allocated yet."""
        self._turns = Turns()
        self._scene = Scene.from_dict(with_functions(scene.to_dict(), functions))
        precision = choose_precision(self._scene, precision)
        self._requested: dict[str, Any] = {
            "precision": precision,
            "pipeline": pipeline,
            "threads": threads,
            "shared_device": shared_device,
            "time_step": time_step,
        }
        lower(self._scene, with_particles=False, **self._requested)
        self._backend, self._requested["threads"] = self._select(
            self._scene, device, threads, ranks
        )
        check_backend(self._backend.kind, precision)
        self._partition = as_partition(partition, self._backend, self._scene)
        self._guard = as_guard(guard)
        self._watch: Watch | None = None
        self._output = Output(output) if isinstance(output, str | Path) else output
        self._offset = world_offset(self._scene)
        self._engine: Any = None
        self._process = os.getpid()
        self._writer: Writer | None = None
        self._plan: Plan | None = None
        self._measured: Measurements | None = None
        self._passed: Traffic | None = None
        self._restored: checkpoints.Checkpoint | None = None
        self._resumed = False
        self._loads_state = True
        self._displaced: dict[str, int] = {}
        self._initial = Initial()
        self._until = math.inf
        self._deadline = math.inf
        self._stopped = ""
        self._wall = 0.0
        self._processor = 0.0
        self._particle_steps = 0
        self._recorded: dict[str, Any] = {}
        #: The "run" key of the scene file that this run came from; kept with its results.
        self.run_settings: dict[str, Any] = {}
        self.particles = ParticlesView(self)
        self.grid = GridView(self)
        self.sensors = SensorsView(self)

    # What the simulation is -------------------------------------------------------------------

    @property
    def scene(self) -> Scene:
        """The scene that runs."""
        return self._scene

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3."""
        return int(self._scene.dimension)

    @property
    def device(self) -> str:
        """The device in use: "cpu" or "cuda:<index>"."""
        return self._backend.name

    @property
    def precision(self) -> str:
        """Either "single", "mixed" or "double"."""
        return str(self._requested["precision"])

    @property
    def threads(self) -> int:
        """CPU threads asked for; 0 is the default."""
        return int(self._requested["threads"])

    @property
    def pipeline(self) -> str:
        """The pipeline in use: "fused", "two-pass" or "phased"."""
        return self.plan.pipeline

    @property
    def version(self) -> str:
        """Version of libmpm."""
        return str(backends.core().build_info()["version"])

    @property
    def output(self) -> Output | None:
        """The output settings, or None."""
        return self._output

    @property
    def guard(self) -> Guard | None:
        """What the run watches about itself; None where it does not."""
        return self._guard

    @property
    def offset(self) -> NDArray[np.float64]:
        """World position of the domain's lower corner, m, (dimension,)."""
        return self._offset

    @property
    def plan(self) -> Plan:
        """What the simulation stores, runs and costs."""
        if self._plan is None:
            with warned_already():
                self._plan = build_plan(
                    self._scene, device=self.device, ranks=self.ranks, **self._requested
                )
        return self._plan

    @property
    def time(self) -> float:
        """Simulated time, s."""
        return float(self._engine.time) if self._engine is not None else self._start("time")

    @property
    def steps(self) -> int:
        """Steps done since the scene's start."""
        return int(self._engine.step) if self._engine is not None else int(self._start("step"))

    @property
    def first_step(self) -> int:
        """Steps at which the scene begins: those of the checkpoint that it goes on from, or 0."""
        return 0 if self._scene.start is None else self._scene.start.step

    def _start(self, key: str) -> float:
        if self._restored is not None:
            return float(self._restored.header[key])
        return 0.0 if self._scene.start is None else float(getattr(self._scene.start, key))

    @property
    def dt(self) -> float:
        """The time step, s."""
        return float(self.engine.time_step)

    @property
    def particle_steps_per_s(self) -> float:
        """Speed since this object was made: particles times steps per second in the engine."""
        return self._particle_steps / self._wall if self._wall > 0 else 0.0

    @property
    def seconds_stepping(self) -> tuple[float, float]:
        """Wall and processor time, s, of the engine's steps since this object was made.

        Without construction, sensors evaluated in Python and files. Processor time is that of the
        process: of all its threads, also of other simulations that run in it at the same time.
        """
        return self._wall, self._processor

    @property
    def timings(self) -> dict[str, float]:
        """Seconds spent in each phase of the step."""
        return dict(self.engine.timings())

    @property
    def statistics(self) -> dict[str, Any]:
        """Counters of the engine; of several ranks the sums of theirs, unless said otherwise.

        ===============  ====  ================================================================
        key              unit  meaning
        ===============  ====  ================================================================
        sorts, tables    1     sorts since the start, and those that made a new table of blocks;
                               the same on all ranks
        blocks           1     in the tables: with particles, and their neighbours
        lone             1     particles that are treated one by one (CUDA, sparse bodies)
        fastest_node     m/s   in the last step, of all ranks
        drift            1     cells that a particle may have moved since the last sort
        bytes            B     held now by particles, blocks and what goes to other ranks
        most_bytes_used  B     CUDA: the most in use at a time
        most_bytes_held  B     CUDA: the most held for use at a time
        ranks            1     these and all below where there are several
        imbalance        1     the largest load of a rank over the mean one, at the last sort
        rebalances       1     sorts that moved cuts
        migrated         1     changes of rank by particles
        shared_blocks    1     blocks that others hold too, added up over ranks
        bytes_of_sums    B     sums sent to other ranks since the start
        ===============  ====  ================================================================

        Grids of functions have their own (`docs/grids.md`).
        """
        return dict(self.engine.statistics())

    @property
    def smoothing(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """What `Smoothing` over cells did to each body that has one, in this process.

        By body: "time" in s, "calls", "energy" Σ m q² in kg, of all components alike, before the
        first of them, "energy_change" by all of them, "index" I_E of the last. One row a call;
        beyond 65,536 rows neighbouring ones are put together.
        """
        return {
            body.name: history(self.engine.smoothing(number))
            for number, body in enumerate(self._scene.bodies)
            if body.smoothing is not None
        }

    @property
    def displaced(self) -> dict[str, int]:
        """Particles of restored bodies whose place new bodies have taken, by body."""
        if self._scene.start is not None and self._restored is None:
            _ = self.engine
        return dict(self._displaced)

    @property
    def stopped(self) -> str:
        """What ended the last `run` before its time: "wall limit", or a signal such as "SIGTERM".

        Empty where it went on to `until`.
        """
        return self._stopped

    @property
    def inflow(self) -> Mapping[str, Series]:
        """Name of an `Inflow` -> what it has supplied since the start of the run.

        A series as those of sensors, with a row for each moment at which particles came: their
        number, mass (kg) and volume at rest (m³, m² in 2D) in all.
        """
        return self._traffic.inflow

    @property
    def outflow(self) -> Mapping[str, Series]:
        """Name of an `Outflow` -> what it has taken out since the start of the run; see `inflow`.

        Particles are counted when the engine next sorts, a fraction of a cell behind the face.
        """
        return self._traffic.outflow

    def particle_count(self, body: int) -> int:
        """Return the number of particles of body number `body` now in the run."""
        return int(self.engine.particle_count(body))

    def set_initial(self, body: str, name: str, array: Any) -> None:
        """Give the particles of a body their own velocity or pressure at the start.

        See ``sim.particles[body][name] = array``, which is the same.
        """
        with self._turns:
            if self._measured is not None and self._measured.busy:
                raise SceneError(
                    f"particles of body '{body}': {name} is set by the function of a "
                    "sensors.Custom while it is asked for numbers; expected it to read only; set "
                    "arrays before the first step, outside of sensors"
                )
            self._initial.take(self, body, name, array)
            # An engine made for looking at the scene has the state of before.
            self._engine = None

    def __repr__(self) -> str:
        """Return scene, device and time without touching the device."""
        return (
            f"<Simulation {self._scene.name!r} on {self.device}, {self.precision}: "
            f"{self.time:g} s, step {self.steps}>"
        )

    @property
    def ranks(self) -> int:
        """How many ranks share the scene."""
        return self._backend.ranks

    @property
    def partition(self) -> Partition | None:
        """How the ranks' cuts are made, as asked for; None where the engine chooses."""
        return self._partition

    # Construction on first use ----------------------------------------------------------------

    @property
    def engine(self) -> Any:
        """The compiled engine; made when first asked for."""
        if self._engine is not None and self._process != os.getpid():
            raise forked(self._scene.name)
        if self._engine is None:
            with self._turns:
                if self._engine is None:
                    self._make_engine()
        return self._engine

    def __copy__(self) -> Simulation:
        """Refuse: two objects would share one engine and one output folder."""
        raise Error(
            "a Simulation cannot be copied or pickled, because it owns an engine and its output "
            "folder; continue from a checkpoint, Simulation.resume(sim.save_checkpoint(path)), or "
            "make another one of the same scene"
        )

    def __deepcopy__(self, memo: Any) -> Simulation:
        """Refuse, as `copy.copy`."""
        return self.__copy__()

    def __reduce__(self) -> Any:
        """Refuse, as `copy.copy`."""
        return self.__copy__()

    def _make_engine(self) -> None:
        self._process = os.getpid()
        check_fork(self._scene.name, self.threads)
        with self._alike():
            self._require_memory()
        start = self._scene.start
        resumed = self._restored is not None
        if start is not None and not resumed:
            self._go_on(start)
        with warned_already():
            specification = lower(
                self._scene, device_index=self._backend.index,
                # Of a scene that goes on, the state to load has all that its file had.
                shell=start is not None and self._loads_state, **self._requested,
            )  # fmt: skip
        self._initial.into(specification)
        specification |= told_ranks(self._backend, self._partition, self._scene)
        saved = self._restored if self._loads_state else None
        if saved is not None:
            specification |= saved.stored_as()
        try:
            engine = self._backend.module.Engine(specification)
        except CapacityError as error:
            raise CapacityError(f"{error}. {self._memory_planned()}") from error
        loaded = False
        try:
            if saved is not None:
                engine.load(saved.state)
            loaded = True
            self._take(engine, specification, None if saved is None else saved.state)
        except (
            Error, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError,
        ) as error:  # fmt: skip
            if saved is None or (loaded and isinstance(error, Error)):
                raise
            raise CheckpointError(
                f"the checkpoint does not fit {self.device} in {self.precision} precision: "
                f"{error}; resume with the device and version that wrote it"
            ) from error

    def _take(
        self, engine: Any, specification: dict[str, Any], state: dict[str, Any] | None = None
    ) -> None:
        """Take an engine into use, with what it measures; `state` is what it has loaded."""
        self._measured = Measurements(self, engine, specification, self._restored)
        self._passed = Traffic(self._scene, state)
        self._engine = engine
        self._count_together(engine)
        if self._guard is not None:
            saved = self._restored if self._loads_state else None
            remembered = saved.header.get("watch") if saved is not None else None
            self._watch = Watch(self, self._guard, remembered)
        self._restored = None

    def _require_memory(self) -> None:
        """Refuse what cannot fit before anything is allocated."""
        free = backends.memory_free(self._backend)
        # The plan refuses more than memory: it is made wherever free memory is not known, too.
        if self.plan.memory_total > (math.inf if free is None else free):
            assert free is not None
            raise CapacityError(f"{self.device} has {free / 2**20:,.0f} MiB free. "
                                f"{self._memory_planned()}")  # fmt: skip

    def _memory_planned(self) -> str:
        parts = ", ".join(f"{k} {v / 2**20:,.0f}" for k, v in self.plan.memory.items())
        return (
            f"The plan asks for {self.plan.memory_total / 2**20:,.0f} MiB ({parts}); use a larger "
            "cell_size, fewer particles_per_cell, single precision or a device with more memory"
        )

    @property
    def _measurements(self) -> Measurements:
        if self._measured is None:
            _ = self.engine
        assert self._measured is not None
        return self._measured

    @property
    def _traffic(self) -> Traffic:
        if self._passed is None:
            _ = self.engine
        assert self._passed is not None
        return self._passed

    def flow_series(self) -> list[Series]:
        """Return the series of all inflows and outflows."""
        return self._traffic.series

    def series(self) -> list[Series]:
        """Return the series of all sensors in the scene's order."""
        return self._measurements.series

    # Stepping ---------------------------------------------------------------------------------

    def step(self, n: int = 1) -> None:
        """Advance `n` steps. Raises `Error` while another thread runs or steps it."""
        if n < 0:
            raise ValueError(f"n is {n}; expected a number of steps, 0 or more")
        try:
            with self._turns.advancing(self._scene.name):
                self._advance(n, math.inf, reporter(False, 0.0, 0.0, ""))
                with self._turns:
                    if self._writer is not None:
                        self._writer.flush()
        finally:
            self._rest()

    def run(
        self,
        *,
        until: float,
        progress: bool | Callable[[State], object] = True,
        wall_limit: float | None = None,
    ) -> bool:
        """Advance to the first step boundary with time >= `until`, s; return whether it got there.

        `progress` shows a bar, or is a callable that receives a `State` several times a second.
        After `wall_limit` seconds of wall time, ≥ 0, the run stops at a step boundary, writes a
        checkpoint into the output folder if it has one, and returns False; `stopped` says why.
        Ctrl-C stops at a step boundary with everything valid and flushed. Either way `run` can be
        called again, and no bit is changed. Raises `Error` while another thread runs or steps it.
        """
        if isinstance(until, bool | str | bytes) or not hasattr(until, "__float__"):
            raise Error(f"Simulation.run: until is {until!r}; expected a time as a number, s")
        until = float(until)
        if math.isnan(until):
            raise ValueError("until is not a number; expected seconds")
        if wall_limit is not None and not wall_limit >= 0:
            raise ValueError(f"wall_limit is {wall_limit!r}; expected seconds, ≥ 0, or None")
        with self._turns.advancing(self._scene.name):
            return self._run(until, progress, wall_limit)

    def _run(
        self, until: float, progress: bool | Callable[[State], object], wall_limit: float | None
    ) -> bool:
        self._deadline = math.inf if wall_limit is None else clock.monotonic() + wall_limit
        self._stopped = ""
        self._until = until
        with self._turns, self._together():
            _ = self.engine
        title = self._scene.name or "libmpm"
        if self.rank == 0:
            left, plan = until - self.time, self.plan
            seconds = plan.particles * left / self.dt / plan.rate
            warn(many_steps(left, self.dt, plan.limited_by, seconds), stacklevel=3)
        status, message = "finished", ""
        report = reporter(progress if self.rank == 0 else False, self.time, until, title)
        try:
            self._advance(-1, until, report)
            if self._stopped:
                status, message = "interrupted", f"stopped by {self._stopped}; it can be resumed"
                if self._writer is not None:
                    with self._turns, self._together():
                        self._writer.checkpoint()
        except KeyboardInterrupt:
            status, message = "interrupted", "stopped by an interrupt; it can be resumed"
            if self._writer is not None and self._writer.output.checkpoint_interval:
                with self._turns:
                    # A handler of the caller's own may interrupt between a step and its frame.
                    self._writer.service()
                    self._writer.checkpoint()
            raise
        except Error as error:
            status, message = "failed", str(error)
            raise
        finally:
            report.close()
            self._deadline = math.inf
            with self._turns:
                self._finish(status, message)
        return not self._stopped

    def _advance(self, steps: int, until: float, report: Progress) -> None:
        """Advance `steps` (-1: no limit) or to `until`, serving whatever falls due."""
        with self._together():
            # Nothing is lost by Ctrl-C while the engine is made; from the folder's first file on it
            # waits for a step's end, or the frame and the samples of the start would be missing.
            with self._turns:
                _ = self.engine
            with deferred_interrupt() as interrupted:
                with self._turns:
                    self._open()
                self._loop(steps, until, report, interrupted)

    def _loop(
        self, steps: int, until: float, report: Progress, interrupted: Callable[[], bool]
    ) -> None:
        engine = self._engine
        with self._turns:
            if self._watch is not None:
                self._watch.look()
            self._measurements.service()
            if self._writer is not None:
                self._writer.service()
        while steps != 0 and engine.time < until:
            left = self._deadline - clock.monotonic()
            self._stopped = self._agreed("wall limit" if left <= 0 else asked_to_stop())
            if self._stopped:
                break
            # Between slices others read; whoever reads while one is under way waits for it.
            with self._turns:
                done = self._slice(steps, until, left)
            if steps > 0:
                steps -= done
            report.update(State(engine.time, until, int(engine.step), self.particle_steps_per_s))
            if self._agreed("interrupt" if interrupted() else ""):
                raise KeyboardInterrupt

    def _slice(self, steps: int, until: float, left: float) -> int:
        """Step to what falls due next, `SLICE` or the `left` s at most, and serve it."""
        engine, measured, watch = self._engine, self._measurements, self._watch
        # The engine stops at the first boundary past the target and never shortens a step, so
        # targets of samples, frames and checkpoints leave the bits alone.
        target = min(until, measured.next_time())
        if self._writer is not None:
            target = min(target, self._writer.next_time())
        most = measured.limit(steps)
        if watch is not None:
            most = watch.limit(most)
        began, busy = clock.perf_counter(), clock.process_time()
        result = engine.run(most, target, min(SLICE, left))
        self._wall += clock.perf_counter() - began
        self._processor += clock.process_time() - busy
        done = int(result["steps"])
        self._particle_steps += done * self._count()
        if result["reason"] == "wall" and (steps == done or engine.time >= until):
            # What is due at the last step, a sort say, comes before anyone saves.
            result = engine.run(0, target, math.inf)
        self._collect()
        if result["reason"] == "fault":
            raise NumericalError(
                describe_fault(result["fault"], engine.time_step, self.scene.cell_size)
            )
        if watch is not None:
            watch.look()
        measured.service()
        if self._writer is not None:
            self._writer.service()
        return done

    def _count(self) -> int:
        return sum(self.totals())

    def _collect(self) -> None:
        """Take samples and removed particles from the engine."""
        engine = self._engine
        self._measurements.drain(engine)
        self._traffic.take(engine)
        gone = list(engine.removed())
        self._count_together(engine)
        if self._watch is not None:
            self._watch.removed(gone)
        # Those that left through an outlet are in its series.
        gone = [g for g in gone if not g[4].startswith(OUTFLOW)]
        if not gone or self.rank > 0:
            return
        names = list(self.particles)
        if self._writer is not None:
            self._writer.removed(removed_rows(gone, names, self._offset))
        where = self._output.path / "removed.csv" if self._output is not None else None
        warnings.warn(describe_removed(gone, names, where), ModelWarning, stacklevel=4)
