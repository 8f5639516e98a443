"""`Simulation`: a scene in motion; its parts are what makes the engine, the loop and the files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal, NoReturn

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.arguments import file_path, keywords_only, shown
from libmpm._src.base.arrays import arrays_shared
from libmpm._src.base.values import warned_already
from libmpm._src.errors import Error, SceneError
from libmpm._src.methods.smoothing import history
from libmpm._src.output.series import Series
from libmpm._src.output.settings import Output
from libmpm._src.run import backends
from libmpm._src.run.acting import Acting, Actions
from libmpm._src.run.assembly import Assembly, select
from libmpm._src.run.choices import check_backend, choose_precision
from libmpm._src.run.engine_spec import lower, world_offset
from libmpm._src.run.files import Files, recorded
from libmpm._src.run.guard import Guard, as_guard
from libmpm._src.run.loop import Loop
from libmpm._src.run.partition import Partition, as_partition
from libmpm._src.run.plan import Plan
from libmpm._src.run.plotting import Shown
from libmpm._src.run.progress import State
from libmpm._src.run.requests import body_number, run_request, step_count
from libmpm._src.run.shared_ranks import SharedRanks
from libmpm._src.run.thread_turns import Turns
from libmpm._src.run.views import GridView, ParticlesView, SensorsView
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.custom_functions import with_functions

__all__ = ["Simulation"]


class Simulation(Shown, Acting):
    """Runs a scene on one device.

    Parameters
    ----------
    scene
        The description; a copy is kept.
    device
        "auto" (CUDA if there is a device that has all of the scene, else the CPU), "cpu", "cuda" or
        "cuda:<index>". Several, such as ["cpu", "cpu"] or ["cuda:0", "cuda:1"], share the scene as
        ranks, each with its own part of it: the results have the bits of one. CUDA devices must be
        alike and reach each other's memory, as NVLink gives it; a device may be named twice. Of
        ranks as processes it is that of this one: "cpu" (or "auto"), or "cuda", which is the device
        with the number of the process on its host.
    precision
        "single", "double", or on CUDA devices "mixed": particles double, grid single. "auto" is
        single, and double on grids of functions, which have no other.
    pipeline
        "auto" ("by-body" is the same): each body by the pipeline with the fewest passes over its
        particles that it has; see `Plan.body`. Or one for all: "fused" or "two-pass", which some
        bodies have not, or "phased".
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
        again, a `Partition`. None has it chosen. The results have the same bits with any.
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

    @keywords_only("Simulation", 1)
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
        if not isinstance(scene, Scene):
            raise SceneError(f"Simulation: scene is {shown(scene, 80)}; expected a Scene")
        with arrays_shared():
            self._scene = Scene.from_dict(with_functions(scene.to_dict(), functions))
        precision = choose_precision(self._scene, precision)
        requested: dict[str, Any] = {
            "precision": precision,
            "pipeline": pipeline,
            "threads": threads,
            "shared_device": shared_device,
            "time_step": time_step,
        }
        lower(self._scene, with_particles=False, **requested)
        backend, requested["threads"] = select(self._scene, device, threads, ranks)
        check_backend(backend.kind, precision)
        self._offset = world_offset(self._scene)
        self._shared = SharedRanks(backend, len(self._scene.bodies))
        self._assembly = Assembly(
            self, requested, backend, partition=as_partition(partition, backend, self._scene),
            guard=as_guard(guard), turns=self._turns, shared=self._shared,
        )  # fmt: skip
        output = Output(output) if isinstance(output, str | Path) else output
        self._actions = Actions(self, self._turns, self._assembly)
        self._files = Files(self, self._turns, self._shared, self._assembly, self._actions, output)
        self._loop = Loop(
            self, self._turns, self._shared, self._assembly, self._files, self._actions
        )
        self.particles = ParticlesView(self)
        self.grid = GridView(self)
        self.sensors = SensorsView(self)

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
        return self._assembly.backend.name

    @property
    def precision(self) -> str:
        """Either "single", "mixed" or "double"."""
        return str(self._assembly.requested["precision"])

    @property
    def threads(self) -> int:
        """CPU threads asked for; 0 is the default."""
        return int(self._assembly.requested["threads"])

    @property
    def pipeline(self) -> str:
        """The pipeline in use: "fused", "two-pass", "phased", or "by-body" (`Plan.body`)."""
        return self.plan.pipeline

    @property
    def version(self) -> str:
        """Version of libmpm."""
        return str(backends.core().build_info()["version"])

    @property
    def output(self) -> Output | None:
        """The output settings, or None."""
        return self._files.output

    @property
    def guard(self) -> Guard | None:
        """What the run watches about itself; None where it does not."""
        return self._assembly.guard

    @property
    def offset(self) -> NDArray[np.float64]:
        """World position of the domain's lower corner, m, (dimension,)."""
        return self._offset

    @property
    def run_settings(self) -> dict[str, Any]:
        """The "run" key of the scene file that this run came from; kept with its results."""
        return self._files.settings

    @run_settings.setter
    def run_settings(self, settings: dict[str, Any]) -> None:
        self._files.settings = settings

    @property
    def plan(self) -> Plan:
        """What the simulation stores, runs and costs."""
        return self._assembly.plan

    @property
    def time(self) -> float:
        """Simulated time, s."""
        made = self._assembly.made
        return float(made.time) if made is not None else self._assembly.begun("time")

    @property
    def steps(self) -> int:
        """Steps done since the scene's start."""
        made = self._assembly.made
        return int(made.step) if made is not None else int(self._assembly.begun("step"))

    @property
    def first_step(self) -> int:
        """Steps at which the scene begins: those of the checkpoint that it continues from, or 0."""
        return 0 if self._scene.start is None else self._scene.start.step

    @property
    def dt(self) -> float:
        """The time step that is being taken, s; it changes from step to step."""
        return float(self.engine.time_step)

    @property
    def particle_steps_per_s(self) -> float:
        """Speed since this object was made: particles times steps per second in the engine."""
        return self._loop.particle_steps_per_s

    @property
    def seconds_stepping(self) -> tuple[float, float]:
        """Wall and processor time, s, of the engine's steps since this object was made.

        Without construction, sensors evaluated in Python and files. Processor time is that of the
        process: of all its threads, also of other simulations that run in it at the same time.
        """
        return self._loop.wall, self._loop.processor

    @property
    def timings(self) -> dict[str, float]:
        """Seconds spent in each phase of the step."""
        return dict(self.engine.timings())

    @property
    def statistics(self) -> dict[str, Any]:
        """Counters of the engine; of several ranks the sums of theirs, unless stated otherwise.

        ===============  ====  ================================================================
        key              unit  meaning
        ===============  ====  ================================================================
        sorts, tables    1     sorts since the start, and those that made a new table of blocks;
                               the same on all ranks
        blocks           1     in the tables: with particles, and their neighbours
        lone             1     particles that are treated one by one (CUDA, sparse bodies)
        fastest_node     m/s   in the last step, of all ranks
        drift            1     cells that a particle may stand beside its home cell
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
        """What `Smoothing` over cells did on all ranks, since this process began.

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
        if self._scene.start is not None and self._assembly.restored is None:
            _ = self.engine
        return dict(self._assembly.displaced)

    @property
    def stopped(self) -> str:
        """What ended the last `run` early: "wall limit" or a signal such as "SIGTERM"; or ""."""
        return self._loop.stopped

    @property
    def inflow(self) -> Mapping[str, Series]:
        """Name of an `Inflow` -> what it has supplied since the start of the run.

        A series as those of sensors, with a row for each moment at which particles came: their
        number, mass (kg) and volume at rest (m³, m² in 2D) in all.
        """
        return self._assembly.traffic.inflow

    @property
    def outflow(self) -> Mapping[str, Series]:
        """Name of an `Outflow` -> what it has taken out, counted when the engine next sorts."""
        return self._assembly.traffic.outflow

    def particle_count(self, body: int) -> int:
        """Return the number of particles of body number `body` now in the run."""
        number = body_number(body, len(self._scene.bodies))
        return int(self.engine.particle_count(number))

    def set_initial(self, body: str, name: str, array: Any) -> None:
        """Give the particles of a body their own velocity or pressure at the start.

        See ``sim.particles[body][name] = array``, which is the same.
        """
        self._assembly.set_initial(body, name, array)

    def __repr__(self) -> str:
        """Return scene, device and time without touching the device."""
        return (
            f"<Simulation {self._scene.name!r} on {self.device}, {self.precision}: "
            f"{self.time:g} s, step {self.steps}>"
        )

    @property
    def rank(self) -> int:
        """Which of the ranks this process is, from 0; 0 where they are not processes."""
        return self._shared.rank

    @property
    def ranks(self) -> int:
        """How many ranks share the scene."""
        return self._shared.ranks

    @property
    def partition(self) -> Partition | None:
        """How the ranks' cuts are made, as asked for; None where the engine chooses."""
        return self._assembly.partition

    def totals(self) -> list[int]:
        """Return the number of particles of each body, on all ranks, at the last halt."""
        return self._shared.totals(self.particle_count)

    @property
    def engine(self) -> Any:
        """The compiled engine; made when first asked for."""
        return self._assembly.engine

    def __reduce__(self) -> NoReturn:
        """Refuse to be copied or pickled: two would share one engine and one output folder."""
        raise Error(
            "a Simulation cannot be copied or pickled, because it owns an engine and its output "
            "folder; continue from a checkpoint, by sim.save_checkpoint(path) and "
            "Simulation.resume(path), or make another one of the same scene"
        )

    def flow_series(self) -> list[Series]:
        """Return the series of all inflows and outflows."""
        return self._assembly.traffic.series

    def series(self) -> list[Series]:
        """Return the series of all sensors in the scene's order."""
        return self._assembly.measurements.series

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Hold the simulation at the boundary of a step, in a ``with`` block.

        For several reads of one moment while another thread runs it; each read alone needs none.
        The run waits, so the block must not wait for the run; no bit is changed.
        """
        with self._turns:
            yield

    @keywords_only("Simulation.step", 1)
    def step(self, n: int = 1) -> None:
        """Advance `n` steps. Raises `Error` while another thread runs or steps it."""
        n = step_count(n)
        try:
            with self._turns.advancing(self._scene.name):
                self._loop.step(n)
        finally:
            self._files.rest()

    @keywords_only("Simulation.run")
    def run(
        self,
        *,
        until: float,
        progress: bool | Callable[[State], object] = True,
        wall_limit: float | None = None,
    ) -> bool:
        """Advance to the first step boundary with time ≥ `until`, s; return whether it got there.

        Where the time is past `until` already nothing is done. `progress` shows a bar, or is a
        callable that receives a `State` several times a second. After `wall_limit` seconds of wall
        time, ≥ 0, the run stops at a step boundary, writes a checkpoint into the output folder if
        it has one, and returns False; `stopped` says why. Ctrl-C stops at a step boundary with
        everything valid and flushed. Either way `run` can be called again, and no bit is changed.
        Raises `Error` while another thread runs or steps it.
        """
        until, progress, wall_limit = run_request(until, progress, wall_limit)
        with self._turns.advancing(self._scene.name):
            return self._loop.run(until, progress, wall_limit)

    def scene_document(self) -> dict[str, Any]:
        """Return the scene file of this run, with its "run" settings if it came with any."""
        return self._files.scene_document()

    def export_csv(self) -> list[Path]:
        """Write the sensor series as CSV into the output folder; return the files."""
        return self._files.export_csv()

    @keywords_only("Simulation.save_checkpoint", 1)
    def save_checkpoint(self, path: str | Path) -> None:
        """Write the whole state to `path` (NumPy archive), atomically.

        A state that the guard finds broken is not written. Raises `NumericalError`. Where ranks are
        processes all call this, rank 0 writes the state of all, and none goes on before the file is
        there. Beside a thread that runs the simulation it waits for the boundary of a step.
        """
        with self._turns, self._shared.together():
            self._files.save(file_path(path, "Simulation.save_checkpoint"), self._loop.until)
            self._shared.meet()

    @classmethod
    @keywords_only("Simulation.resume", 1)
    def resume(
        cls,
        path: str | Path,
        *,
        device: str | Sequence[str] | None = None,
        output: Output | str | Path | None = None,
        functions: Mapping[str, Callable[[Any], Any]] | None = None,
        guard: Guard | bool | Literal["same"] | None = "same",
        ranks: str | None = None,
        partition: Partition | Literal["same"] | None = "same",
    ) -> Simulation:
        """Continue from a checkpoint file, or from the newest whole one in a run's folder.

        `device` None takes the checkpoint's own, and as many ranks. On the same backend, pipeline
        and precision the continued run is bit-equal to one never stopped, on any number of ranks;
        elsewhere it agrees to rounding. An `output` folder that holds the same run is first cut to
        the checkpoint's time: samples, frames and checkpoints after it are removed. One that holds
        another run, of this scene or of another, is refused with `OutputError` at the first step,
        unless it may be overwritten. `functions` are those of `sensors.Custom` sensors, by name.
        `guard` "same" continues the checks of the parent run. `ranks` "processes" continues in the
        processes that a launcher has started. `partition` "same" cuts as the parent run did, where
        several ranks continue; at the start the cuts are made for the state of the checkpoint.
        """
        source, arguments = recorded(
            file_path(path, "Simulation.resume"), device, guard, ranks, partition
        )
        with warned_already():  # the run that wrote it has said them
            simulation = cls(**arguments, output=output, functions=functions)
        simulation._assembly.restored = source
        simulation._assembly.displaced = dict(source.header.get("displaced", {}))
        simulation._files.settings = source.header.get("run") or {}
        simulation._files.recorded = source.header
        simulation._actions.recorded = source.header.get("actions") or {}
        return simulation

    def recorded_output(self) -> Output | None:
        """Return the output settings of the run that wrote the checkpoint resumed from."""
        return self._files.recorded_output()

    def recorded_until(self) -> float | None:
        """Return the end, s, that the run was asked for which wrote the checkpoint."""
        return self._files.recorded_until()

    def set_output(self, output: Output) -> None:
        """Choose the output of a simulation that has none and has not run yet."""
        self._files.choose(output)

    def close(self) -> None:
        """Close the output files; stepping opens them again.

        Raises `Error` while another thread runs or steps the simulation.
        """
        with self._turns.advancing(self._scene.name), self._turns:
            self._files.close()

    def __enter__(self) -> Simulation:
        """Return the simulation."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close the output files."""
        self.close()
