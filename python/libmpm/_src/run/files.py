"""`Files`: the output folder and checkpoints of a simulation; restart from a checkpoint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from libmpm._src.base.arguments import shown
from libmpm._src.errors import Error, NumericalError, SceneError
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output.rank_files import open_together
from libmpm._src.output.settings import Output
from libmpm._src.output.writer import Writer
from libmpm._src.run import backends
from libmpm._src.run.acting import Actions
from libmpm._src.run.assembly import Assembly
from libmpm._src.run.guard import Guard
from libmpm._src.run.partition import Partition, recorded_partition
from libmpm._src.run.running import Running
from libmpm._src.run.shared_ranks import SharedRanks
from libmpm._src.run.thread_turns import Turns
from libmpm._src.scene.old_defaults import with_old_defaults
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.custom_functions import storable

__all__ = ["Files", "recorded"]


class Files:
    """What one simulation leaves behind."""

    def __init__(
        self,
        run: Running,
        turns: Turns,
        shared: SharedRanks,
        assembly: Assembly,
        actions: Actions,
        output: Output | None,
    ) -> None:
        """Take the parts of `run`; nothing is written yet."""
        self._run = run
        self._turns = turns
        self._shared = shared
        self._assembly = assembly
        self._actions = actions
        self.output = output
        #: What writes into the folder; None before the first step and where there is no folder.
        self.writer: Writer | None = None
        #: The "run" key of the scene file that this run came from.
        self.settings: dict[str, Any] = {}
        #: Header of the checkpoint that was resumed from; empty of a new run.
        self.recorded: dict[str, Any] = {}
        #: Why the run has failed; empty while it has not. No state is saved after that.
        self.failure = ""

    def scene_document(self) -> dict[str, Any]:
        """Return the scene file of this run, with its "run" settings if it came with any."""
        return storable(self._run.scene) | ({"run": self.settings} if self.settings else {})

    def open(self) -> None:
        """Make the engine and, where output is wanted, its folder."""
        run, assembly = self._run, self._assembly
        _ = assembly.engine
        if self.writer is not None:
            self.writer.begin()
        elif self.output is not None:
            going_on = bool(self.recorded) or run.steps > run.first_step
            if self._shared.link is None:
                self.writer = Writer(self.output, run, resumed=going_on)
            else:
                self.writer = open_together(self._shared.link, self.output, run, resumed=going_on)
            if assembly.initial and self._shared.rank == 0:
                assembly.initial.save(self.output.path / "initial.npz")

    def finish(self, status: str, message: str) -> None:
        """Bring the files up to date at the end of a run."""
        if self.writer is None:
            return
        try:
            self.writer.finish(status, message)
        except Error:
            # The first failure is the one to report; a full disk fails every write after it.
            if status != "failed":
                raise
        finally:
            self.writer.release()

    def rest(self) -> None:
        """Leave the output folder to who else asks in this process, unless a run writes it now."""
        with self._turns:
            if self.writer is not None and not self._turns.advanced:
                self.writer.rest()

    def export_csv(self) -> list[Path]:
        """Write the sensor series as CSV; return the files."""
        try:
            with self._turns:
                self.open()
                return [] if self.writer is None else self.writer.export_csv()
        finally:
            self.rest()

    def choose(self, output: Output) -> None:
        """Take the output of a simulation that has none and has not run yet."""
        if self.writer is not None or self.output is not None:
            raise SceneError("the simulation writes already; give output= when making it")
        if not isinstance(output, Output):
            raise SceneError(f"output is {shown(output, 80)}; expected an Output")
        self.output = output

    def close(self) -> None:
        """Close the files."""
        if self.writer is not None:
            self.writer.close()

    def save(self, path: Path, until: float) -> None:
        """Write a checkpoint of a run that was asked to continue until this time, s."""
        run, assembly = self._run, self._assembly
        engine, watch = assembly.engine, assembly.watch
        if self.failure:
            raise NumericalError(
                f"simulation {run.scene.name!r}: its run has failed, and the state of a run that "
                "failed is not saved: nothing could continue from it; resume an earlier "
                f"checkpoint. The failure: {self.failure}"
            )
        requested, backend, guard = assembly.requested, assembly.backend, assembly.guard
        if watch is not None:
            watch.before_saving()
        header = {
            "version": run.version,
            "scene": storable(run.scene),
            "run": self.settings,
            "device": run.device,
            "ranks": backend.ranks,
            "devices": backend.devices,
            "partition": None if assembly.partition is None else assembly.partition.to_dict(),
            "precision": run.precision,
            "pipeline": run.pipeline,
            "threads": requested["threads"],
            "shared_device": requested["shared_device"],
            "time_step": requested["time_step"],
            "time": run.time,
            "step": run.steps,
            "displaced": run.displaced,
            "until": until if math.isfinite(until) else None,
            "output": None if self.output is None else self.output.to_dict(),
            "guard": None if guard is None else guard.to_dict(),
            "watch": None if watch is None else watch.memory(),
            "actions": self._actions.memory(),
            "engine_sensors": assembly.measurements.engine_names,
        }
        sensors = [(s.time, s.values, list(s.components), list(s.units)) for s in run.series()]
        state = dict(engine.save()) | assembly.traffic.state()
        memory = assembly.measurements.memory()
        if self._shared.rank > 0:  # the state of all is on rank 0
            return
        checkpoint = checkpoints.Checkpoint(header, state, sensors, memory)
        checkpoints.save_checkpoint(path, checkpoint)

    def recorded_output(self) -> Output | None:
        """Return the output settings of the run that wrote the checkpoint resumed from.

        Leave to overwrite what a folder holds was given to that run, not to this one.
        """
        settings = self.recorded.get("output")
        return None if settings is None else Output(**(settings | {"overwrite": False}))

    def recorded_until(self) -> float | None:
        """Return the end, s, that the run was asked for which wrote the checkpoint."""
        until = self.recorded.get("until")
        return None if until is None else float(until)


def recorded(
    path: Path,
    device: str | Sequence[str] | None,
    guard: Guard | bool | Literal["same"] | None,
    ranks: str | None,
    partition: Partition | Literal["same"] | None,
) -> tuple[checkpoints.Checkpoint, dict[str, Any]]:
    """Return a checkpoint and the arguments of the simulation that continues from it.

    The others are as those of `Simulation.resume`.
    """
    _, source = checkpoints.find_newest(path, checkpoints.load_checkpoint)
    header = source.header
    scene = Scene.from_dict(with_old_defaults(header["scene"]))
    kind = header["device"].partition(":")[0]
    chosen = header["device"] if device is None else device
    if ranks is not None:
        chosen = kind if device is None else device
    elif device is None and header.get("ranks", 1) > 1:
        chosen = header.get("devices") or [chosen] * header["ranks"]
    backend = backends.select(chosen) if ranks is None else backends.select_process(chosen)
    if partition == "same":
        partition = recorded_partition(header, backend)
    if guard == "same":
        was = header.get("guard", Guard().to_dict())
        guard = None if was is None else Guard.from_dict(was)
    same = backend.kind == kind
    return source, {
        "scene": scene,
        "device": chosen,
        "precision": header["precision"],
        # Grids of functions have one pipeline, which is not asked for by name.
        "pipeline": header["pipeline"] if same and scene.grid is None else "auto",
        "threads": header["threads"],
        "shared_device": header.get("shared_device", False),
        "time_step": header["time_step"],
        "guard": guard,
        "ranks": ranks,
        "partition": partition,
    }
