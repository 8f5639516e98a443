"""`Assembly`: the engine of a simulation, made on first use, with what it measures and watches."""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from libmpm._src.base.values import shown, warned_already
from libmpm._src.boundaries.flow_layers import Traffic
from libmpm._src.errors import CapacityError, CheckpointError, Error, ModelWarning, SceneError
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.run import backends
from libmpm._src.run import checkpoint_state as snapshots
from libmpm._src.run.choices import choose_device
from libmpm._src.run.engine_spec import lower
from libmpm._src.run.forked_processes import check_fork, forked
from libmpm._src.run.guard import Guard
from libmpm._src.run.guard_watch import Watch
from libmpm._src.run.initial_values import Initial
from libmpm._src.run.partition import Partition, told_ranks
from libmpm._src.run.plan import Plan, build_plan
from libmpm._src.run.running import Running
from libmpm._src.run.shared_ranks import SharedRanks
from libmpm._src.run.thread_turns import Turns
from libmpm._src.scene.data import SceneData
from libmpm._src.scene.start import Start
from libmpm._src.sensors import tallied
from libmpm._src.sensors.sampling_loop import Measurements

__all__ = ["Assembly", "select"]


def select(
    scene: SceneData, device: str | Sequence[str], threads: int, ranks: str | None
) -> tuple[backends.Backend, int]:
    """Return the backend that a scene runs on, and the threads of this process."""
    if ranks is None:
        return _with_laws(scene, backends.select(choose_device(scene, device))), threads
    if ranks != "processes":
        raise SceneError(f"ranks is {shown(ranks)}; expected 'processes' or None")
    backend = backends.select_process(choose_device(scene, device))
    assert backend.link is not None
    return _with_laws(scene, backend), backend.link.threads(threads)


def _with_laws(scene: SceneData, backend: backends.Backend) -> backends.Backend:
    """Give a backend the laws of a scene that were compiled at run time."""
    added = sorted({body.material.table.name for body in scene.bodies if body.material.added})
    if added and backend.kind == "cuda":
        from libmpm._src.materials import compiled

        capability = str(backend.module.devices()[backend.index]["compute_capability"])
        for name in added:
            compiled.load_on_devices(name, backend.module, capability)
    return backend


class Assembly:
    """Makes the engine of one simulation, and keeps what was asked for and what came of it."""

    def __init__(
        self,
        run: Running,
        requested: dict[str, Any],
        backend: backends.Backend,
        *,
        partition: Partition | None,
        guard: Guard | None,
        turns: Turns,
        shared: SharedRanks,
    ) -> None:
        """Keep the request of `run`; nothing is allocated yet."""
        self._run = run
        self._turns = turns
        self._shared = shared
        #: Precision, pipeline, threads, shared_device and time_step, as asked for.
        self.requested = requested
        self.backend = backend
        self.partition = partition
        self.guard = guard
        #: Arrays given for the particles of bodies.
        self.initial = Initial()
        #: The checkpoint to continue from, until the engine is made.
        self.restored: checkpoints.Checkpoint | None = None
        #: Particles of restored bodies whose place new bodies have taken, by body.
        self.displaced: dict[str, int] = {}
        #: The engine, or None before it is made.
        self.made: Any = None
        self.watch: Watch | None = None
        self._loads_state = True
        self._process = os.getpid()
        self._measured: Measurements | None = None
        self._passed: Traffic | None = None
        self._plan: Plan | None = None

    @property
    def plan(self) -> Plan:
        """What the simulation stores, runs and costs."""
        if self._plan is None:
            with warned_already():
                self._plan = build_plan(
                    self._run.scene, device=self.backend.name, ranks=self.backend.ranks,
                    **self.requested,
                )  # fmt: skip
        return self._plan

    @property
    def engine(self) -> Any:
        """The compiled engine; made when first asked for."""
        if self.made is not None and self._process != os.getpid():
            raise forked(self._run.scene.name)
        if self.made is None:
            with self._turns:
                if self.made is None:
                    self._make()
        return self.made

    @property
    def measurements(self) -> Measurements:
        """The series of all sensors."""
        if self._measured is None:
            _ = self.engine
        assert self._measured is not None
        return self._measured

    @property
    def traffic(self) -> Traffic:
        """What came in and went out."""
        if self._passed is None:
            _ = self.engine
        assert self._passed is not None
        return self._passed

    def begun(self, key: str) -> float:
        """Return "time" (s) or "step" at which a simulation begins that has no engine yet."""
        start = self._run.scene.start
        if self.restored is not None:
            return float(self.restored.header[key])
        return 0.0 if start is None else float(getattr(start, key))

    def set_initial(self, body: str, name: str, array: Any) -> None:
        """Take an array for the particles of a body; see `Simulation.set_initial`."""
        with self._turns:
            if self._measured is not None and self._measured.busy:
                raise SceneError(
                    f"particles of body '{body}': {name} is set by the function of a "
                    "sensors.Custom while it is asked for numbers; expected it to read only; set "
                    "arrays before the first step, outside of sensors"
                )
            self.initial.take(self._run, body, name, array)
            # An engine made for looking at the scene has the state of before.
            self.made = None

    def use(self, engine: Any, specification: dict[str, Any], plan: Plan) -> None:
        """Take an engine that others have made, by the seam of design/engine-contract.md."""
        self._plan = plan
        self._take(engine, specification)

    def _make(self) -> None:
        run, scene = self._run, self._run.scene
        self._process = os.getpid()
        check_fork(scene.name, int(self.requested["threads"]))
        with self._shared.alike():
            self._require_memory()
        start = scene.start
        resumed = self.restored is not None
        if start is not None and not resumed:
            self._go_on(start)
        with warned_already():
            specification = lower(
                scene, device_index=self.backend.index,
                # Of a scene that continues, the state to load has all that its file had.
                shell=start is not None and self._loads_state, **self.requested,
            )  # fmt: skip
        self.initial.into(specification)
        restored = self.restored
        remembered = {} if restored is None else {
            s.name: restored.memory_of(i) for i, s in enumerate(scene.sensors)
        }  # fmt: skip
        tallied.add_first_places(specification, remembered)
        specification |= told_ranks(self.backend, self.partition, scene)
        saved = self.restored if self._loads_state else None
        if saved is not None:
            specification |= saved.stored_as()
        try:
            engine = self.backend.module.Engine(specification)
        except CapacityError as error:
            raise CapacityError(f"{error}. {self._memory_planned()}") from error
        loaded = False
        try:
            if saved is not None:
                engine.load(self._fitted(saved, specification))
            loaded = True
            self._take(engine, specification, None if saved is None else saved.state)
        except (
            Error, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError,
        ) as error:  # fmt: skip
            if saved is None or (loaded and isinstance(error, Error)):
                raise
            raise CheckpointError(
                f"the checkpoint does not fit {run.device} in {run.precision} precision: "
                f"{error}; resume with the device and version that wrote it"
            ) from error

    def _fitted(
        self, saved: checkpoints.Checkpoint, specification: dict[str, Any]
    ) -> dict[str, Any]:
        """Return the state of a checkpoint with the sensors of an engine."""
        scene, header, known = self._run.scene, saved.header, len(saved.sensors)
        if scene.start is not None and not saved.sensors:
            known = scene.start.sensors
        sensors = scene.sensors[:known]
        names = {s.name for s in sensors}
        return tallied.fitted(
            saved.state, tallied.state_names(header, sensors),
            [s for s in specification["sensors"] if s["name"] in names],
            float(header["time"]), int(header["step"]),
        )  # fmt: skip

    def _take(
        self, engine: Any, specification: dict[str, Any], state: dict[str, Any] | None = None
    ) -> None:
        """Take an engine into use, with what it measures; `state` is what it has loaded."""
        self._measured = Measurements(self._run, engine, specification, self.restored)
        self._passed = Traffic(self._run.scene, state)
        self.made = engine
        self._shared.count(engine)
        if self.guard is not None:
            saved = self.restored if self._loads_state else None
            remembered = saved.header.get("watch") if saved is not None else None
            self.watch = Watch(self._run, self.guard, remembered)
        self.restored = None

    def _go_on(self, start: Start) -> None:
        """Take up the state of the scene's checkpoint: whole, or what new bodies leave of it."""
        scene = self._run.scene
        start.check_file()
        if len(scene.boundaries) > start.boundaries:
            snapshots.check_new_boundaries(scene)
        source = checkpoints.load_checkpoint(Path(start.checkpoint))
        self._loads_state = start.as_it_was(scene, self.requested["time_step"])
        if start.tiles > 1 or start.first_cell is not None:
            source.sensors.clear()
        self.restored = source
        if self._loads_state:
            return
        state = snapshots.snapshot(scene)
        for body in scene.bodies[: len(start.bodies)]:
            count = int(np.count_nonzero(snapshots.displaced(scene, body)))
            if count:
                self.displaced[body.name] = count
        left = {name: n for name, n in state.frozen.items() if n}
        if left:
            warnings.warn(
                f"the parent run removed {left} particles that left its domain; they are not "
                "restored",
                ModelWarning, stacklevel=6,
            )  # fmt: skip

    def _require_memory(self) -> None:
        """Refuse what cannot fit before anything is allocated."""
        free = backends.memory_free(self.backend)
        # The plan refuses more than memory: it is made wherever free memory is not known, too.
        if self.plan.memory_total > (math.inf if free is None else free):
            assert free is not None
            raise CapacityError(f"{self._run.device} has {free / 2**20:,.0f} MiB free. "
                                f"{self._memory_planned()}")  # fmt: skip

    def _memory_planned(self) -> str:
        parts = ", ".join(f"{k} {v / 2**20:,.0f}" for k, v in self.plan.memory.items())
        return (
            f"The plan asks for {self.plan.memory_total / 2**20:,.0f} MiB ({parts}); use a larger "
            "cell_size, fewer particles_per_cell, single precision or a device with more memory"
        )
