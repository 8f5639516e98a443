"""Saving and resuming a simulation: checkpoints, tables, the output folder."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np

from libmpm._src.errors import Error, ModelWarning
from libmpm._src.materials.friction import with_cones
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output.rank_files import open_together
from libmpm._src.output.settings import Output
from libmpm._src.output.writer import Writer
from libmpm._src.run import backends
from libmpm._src.run import checkpoint_state as snapshots
from libmpm._src.run.guard import Guard
from libmpm._src.run.partition import Partition, recorded_partition
from libmpm._src.run.plotting import Looking
from libmpm._src.scene.scene import Scene
from libmpm._src.sensors.custom_functions import storable

if TYPE_CHECKING:
    from libmpm._src.run.simulation import Simulation
    from libmpm._src.scene.start import Start

__all__ = ["Persistent"]


class Persistent(Looking):
    """The part of a `Simulation` that has to do with files."""

    def scene_document(self) -> dict[str, Any]:
        """Return the scene file of this run, with its "run" settings if it came with any."""
        run = self._simulation()
        return storable(run._scene) | ({"run": run.run_settings} if run.run_settings else {})

    def _open(self) -> None:
        """Make the engine and, where output is wanted, its folder."""
        run = self._simulation()
        _ = run.engine
        if run._writer is not None:
            run._writer.begin()
        elif run._output is not None:
            going_on = run._resumed or run.steps > run.first_step
            if run._link is None:
                run._writer = Writer(run._output, run, resumed=going_on)
            else:
                run._writer = open_together(run._link, run._output, run, resumed=going_on)
            if run._initial and run.rank == 0:
                run._initial.save(run._output.path / "initial.npz")

    def _finish(self, status: str, message: str) -> None:
        run = self._simulation()
        if run._writer is None:
            return
        try:
            run._writer.finish(status, message)
        except Error:
            # The first failure is the one to report; a full disk fails every write after it.
            if status != "failed":
                raise
        finally:
            run._writer.release()

    def _rest(self) -> None:
        """Leave the output folder to who else asks in this process, unless a run writes it now."""
        run = self._simulation()
        with run._turns:
            if run._writer is not None and not run._turns.advanced:
                run._writer.rest()

    def _go_on(self, start: Start) -> None:
        """Take up the state of the scene's checkpoint: whole, or what new bodies leave of it."""
        run = self._simulation()
        start.check_file()
        if len(run._scene.boundaries) > start.boundaries:
            snapshots.check_new_boundaries(run._scene)
        source = checkpoints.load_checkpoint(Path(start.checkpoint))
        run._loads_state = start.as_it_was(
            len(run._scene.bodies), run._scene.sensors, run._requested["time_step"]
        )
        if start.tiles > 1:
            source.sensors.clear()
        run._restored = source
        if run._loads_state:
            return
        state = snapshots.snapshot(run._scene)
        for body in run._scene.bodies[: len(start.bodies)]:
            count = int(np.count_nonzero(snapshots.displaced(run._scene, body)))
            if count:
                run._displaced[body.name] = count
        left = {name: n for name, n in state.frozen.items() if n}
        if left:
            warnings.warn(
                f"the run before had set aside {left} particles that left its domain; they are "
                "not part of this one",
                ModelWarning, stacklevel=5,
            )  # fmt: skip

    def export_csv(self) -> list[Path]:
        """Write the sensor series as CSV into the output folder; return the files."""
        run = self._simulation()
        try:
            with run._turns:
                run._open()
                return [] if run._writer is None else run._writer.export_csv()
        finally:
            run._rest()

    def save_checkpoint(self, path: str | Path) -> None:
        """Write the whole state to `path` (NumPy archive), atomically.

        A state that the guard finds broken is not written. Raises `NumericalError`. Where ranks are
        processes all call this, and rank 0 writes the state of all. Beside a thread that runs the
        simulation it waits for the boundary of a step.
        """
        run = self._simulation()
        with run._turns, run._together():
            self._save_checkpoint(Path(path))

    def _save_checkpoint(self, path: Path) -> None:
        run = self._simulation()
        engine, watch = run.engine, run._watch
        if watch is not None:
            watch.before_saving()
        header = {
            "version": run.version,
            "scene": storable(run._scene),
            "run": run.run_settings,
            "device": run.device,
            "ranks": run.ranks,
            "devices": run._backend.devices,
            "partition": None if run.partition is None else run.partition.to_dict(),
            "precision": run.precision,
            "pipeline": run.pipeline,
            "threads": run._requested["threads"],
            "shared_device": run._requested["shared_device"],
            "time_step": run._requested["time_step"],
            "time": run.time,
            "step": run.steps,
            "displaced": run.displaced,
            "until": run._until if math.isfinite(run._until) else None,
            "output": None if run._output is None else run._output.to_dict(),
            "guard": None if run.guard is None else run.guard.to_dict(),
            "watch": None if watch is None else watch.memory(),
        }
        sensors = [(s.time, s.values, list(s.components), list(s.units)) for s in run.series()]
        state = dict(engine.save()) | run._traffic.state()
        memory = run._measurements.memory()
        if run.rank > 0:  # the state of all is on rank 0
            return
        checkpoint = checkpoints.Checkpoint(header, state, sensors, memory)
        checkpoints.save_checkpoint(path, checkpoint)

    @classmethod
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
        unless it may be overwritten. `functions`
        are those of `sensors.Custom` sensors, by name. `guard` "same" goes on watching as the run
        before did. `ranks` "processes" goes on in the processes that a launcher has started.
        `partition` "same" cuts as the run before did, where several ranks go on; at the start the
        cuts are made for the state of the checkpoint.
        """
        _, source = checkpoints.find_newest(Path(path), checkpoints.load_checkpoint)
        header = source.header
        scene = Scene.from_dict(with_cones(header["scene"]))
        recorded = header["device"].partition(":")[0]
        chosen = header["device"] if device is None else device
        if ranks is not None:
            chosen = recorded if device is None else device
        elif device is None and header.get("ranks", 1) > 1:
            chosen = header.get("devices") or [chosen] * header["ranks"]
        backend = backends.select(chosen) if ranks is None else backends.select_process(chosen)
        same = backend.kind == recorded
        if partition == "same":
            partition = recorded_partition(header, backend)
        if guard == "same":
            recorded_guard = header.get("guard", Guard().to_dict())
            guard = None if recorded_guard is None else Guard.from_dict(recorded_guard)
        simulation = cast("type[Simulation]", cls)(
            scene,
            device=chosen,
            precision=header["precision"],
            # Grids of functions have one pipeline, which is not asked for by name.
            pipeline=header["pipeline"] if same and scene.grid is None else "auto",
            output=output,
            threads=header["threads"],
            shared_device=header.get("shared_device", False),
            time_step=header["time_step"],
            functions=functions,
            guard=guard,
            ranks=ranks,
            partition=partition,
        )
        simulation._restored = source
        simulation._resumed = True
        simulation.run_settings = header.get("run") or {}
        simulation._recorded = header
        simulation._displaced = dict(header.get("displaced", {}))
        return simulation

    def recorded_output(self) -> Output | None:
        """Return the output settings of the run that wrote the checkpoint resumed from.

        Leave to overwrite what a folder holds was given to that run, not to this one.
        """
        settings = self._simulation()._recorded.get("output")
        return None if settings is None else Output(**(settings | {"overwrite": False}))

    def recorded_until(self) -> float | None:
        """Return the end, s, that the run was asked for which wrote the checkpoint."""
        until = self._simulation()._recorded.get("until")
        return None if until is None else float(until)

    def set_output(self, output: Output) -> None:
        """Choose the output of a simulation that has none and has not run yet."""
        run = self._simulation()
        if run._writer is not None or run._output is not None:
            raise ValueError("the simulation writes already; give output= when making it")
        run._output = output

    def close(self) -> None:
        """Close the output files; stepping opens them again.

        Raises `Error` while another thread runs or steps the simulation.
        """
        run = self._simulation()
        with run._turns.advancing(run._scene.name), run._turns:
            if run._writer is not None:
                run._writer.close()

    def __enter__(self) -> Simulation:
        """Return the simulation."""
        return self._simulation()

    def __exit__(self, *exception: object) -> None:
        """Close the output files."""
        self.close()
