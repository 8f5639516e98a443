"""`Writer`: what is written to the folder of a run, when, and how a resumed run continues it."""

from __future__ import annotations

import csv
import datetime
import math
import time as clock
import uuid
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from libmpm._src.base.log import LOG
from libmpm._src.base.schedule import due_index, due_time
from libmpm._src.errors import ModelWarning, OutputError, SceneError
from libmpm._src.output import checkpoint as checkpoints
from libmpm._src.output import frames
from libmpm._src.output.atomic_files import file_name, replacing, write_json, writing
from libmpm._src.output.earlier_run import (
    clear,
    cut_folder,
    frame_times,
    has_results,
    other_run,
    read_log,
)
from libmpm._src.output.folder_lock import Hold
from libmpm._src.output.sensor_file import SensorFile, append_csv
from libmpm._src.output.settings import Output
from libmpm._src.shapes.element_mesh import ElementMesh

if TYPE_CHECKING:
    from libmpm._src.run.running import Running

__all__ = ["Writer"]

#: Seconds of wall time between flushes of the sensor file at most; a run returns to Python after
#: 0.2 s, so a second is never exceeded unless one step takes longer.
FLUSH_INTERVAL = 0.5


class Writer:
    """Writes one run into its folder. It reads the simulation and never changes it.

    The folder is this run's from `begin` to `release`; between `rest` and the next `begin` another
    simulation of this process may take it, after which this one writes no more.
    """

    _hold: Hold | None = None

    def __init__(self, output: Output, simulation: Running, *, resumed: bool) -> None:
        """Prepare the folder: empty for a fresh run, cut to the present time for a resumed one."""
        self.output = output
        self._simulation = simulation
        self._folder = output.path.absolute()
        self._frames = self._folder / "frames"
        self._checkpoints = self._folder / "checkpoints"
        self._csv = self._folder / "csv"
        self._csv_rows = [0 for _ in simulation.sensors.all_series()]
        self._last_flush = clock.monotonic()
        self._started = clock.monotonic()
        self._began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        self._name = uuid.uuid4().hex
        self._removed = False
        self._check_attributes()
        with writing(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
        self._hold = Hold(self._folder)
        self._hold.take()
        try:
            self._prepare(resumed)
        except BaseException:
            self._hold.release()
            raise

    def _prepare(self, resumed: bool) -> None:
        simulation, output = self._simulation, self.output
        continued = resumed and self._goes_on()
        if not continued:
            clear(self._folder, simulation.scene_document(), overwrite=output.overwrite)
        interval = output.checkpoint_interval
        # Folders that nothing will be written to are not made.
        self._make(self._frames, wanted=bool(output.frame_interval))
        self._make(self._checkpoints, wanted=bool(interval))
        self._make(self._csv, wanted=bool(simulation.sensors.all_series()))
        self._next_frame = self._cut() if continued else 0
        # A run that was killed between a checkpoint and this has left one more.
        checkpoints.keep_newest(self._checkpoints)
        self._next_checkpoint = due_index(simulation.time, interval) + 1 if interval else 0
        if not continued and resumed and output.frame_interval:
            self._next_frame = due_index(simulation.time, output.frame_interval) + 1
        self._times = {body: frame_times(self._frames, body) for body in simulation.particles}
        write_json(self._folder / "scene.json", simulation.scene_document())
        with replacing(self._folder / "plan.txt") as part:
            part.write_text(f"{simulation.plan}\n", encoding="utf-8", errors="backslashreplace")
        # A log without a sensor file is begun again by who continues; the reverse is refused.
        self.log("running")
        self._sensors = SensorFile(self._folder / "sensors.h5", simulation.sensors.all_series())

    def _make(self, folder: Path, *, wanted: bool = True) -> None:
        if wanted:
            with writing(folder):
                folder.mkdir(exist_ok=True)

    def begin(self) -> None:
        """Take the folder, if it is not held; raises `OutputError` where another run writes it."""
        if self._hold is None or not self._hold.take():
            return
        other = read_log(self._folder).get("writer")
        if isinstance(other, str) and other != self._name:
            self._hold.release()
            raise OutputError(
                f"{self._folder} has been written by another run since this one stopped; this "
                "simulation cannot continue there: resume that run, or choose another folder"
            )

    def rest(self) -> None:
        """Keep the folder between calls, but leave it to who else asks in this process."""
        if self._hold is not None:
            self._hold.rest()

    def release(self) -> None:
        """Release the folder for the run that continues."""
        if self._hold is not None:
            self._hold.release()

    def _require(self) -> None:
        """Raise `OutputError` unless the folder is still this run's."""
        if self._hold is not None:
            self._hold.require()

    def _check_attributes(self) -> None:
        bodies = list(self._simulation.particles)
        problems = [
            f"Output: attributes names the body '{name}'; the scene has {', '.join(bodies)}"
            for name in self.output.bodies
            if name not in bodies
        ]
        if self.output.frame_interval:
            for body in bodies:
                view = self._simulation.particles[body]
                for name in self._chosen(body) or ():
                    problem = view.refusal(name)
                    if problem is not None:
                        problems.append(
                            f"Output: body '{body}' has no attribute '{name}'; {problem}; "
                            f"choose from {', '.join(view.names)}, or the library names"
                        )
        if problems:
            raise SceneError(problems)

    def _goes_on(self) -> bool:
        """Tell whether the folder holds this run; raises `OutputError` if it holds another one."""
        folder, simulation = self._folder, self._simulation
        if not has_results(folder):
            return False
        wanted = simulation.scene_document()
        other = other_run(folder, wanted, simulation.sensors.all_series())
        if other and not self.output.overwrite:
            raise OutputError(
                f"{folder} holds {other}, which this run would cut and mix with its own; "
                "choose another folder, or pass overwrite=True (command line: --overwrite)"
            )
        return not other

    def _cut(self) -> int:
        """Remove what lies after the present time; return the index of the next frame."""
        simulation, interval = self._simulation, self.output.frame_interval
        settings = read_log(self._folder).get("output")
        previous = settings.get("frame_interval") if isinstance(settings, dict) else None
        if interval and isinstance(previous, int | float) and interval != previous:
            raise OutputError(
                f"{self._folder} has frames every {previous} s and the resumed run asks for "
                f"{interval} s; keep the interval or choose another folder"
            )
        reached = due_index(simulation.time, interval) if interval else 0
        cut_folder(self._folder, reached if interval else None, simulation.steps)
        # A run that was stopped before its first step may have no frame of its start.
        return reached + (simulation.steps > simulation.first_step)

    def next_time(self) -> float:
        """Return the time, s, at which something is due next; infinity if nothing is."""
        due = math.inf
        if self.output.frame_interval:
            due = min(due, due_time(self._next_frame, self.output.frame_interval))
        if self.output.checkpoint_interval:
            due = min(due, due_time(self._next_checkpoint, self.output.checkpoint_interval))
        return due

    def service(self) -> None:
        """Write what is due at the present time. A failed write stays due."""
        now = self._simulation.time
        interval = self.output.frame_interval
        if interval and now >= due_time(self._next_frame, interval):
            index = due_index(now, interval)
            self._write_frame(index)
            self._next_frame = index + 1
        interval = self.output.checkpoint_interval
        if interval and now >= due_time(self._next_checkpoint, interval):
            self.checkpoint()
            self._next_checkpoint = due_index(now, interval) + 1
        if clock.monotonic() - self._last_flush > FLUSH_INTERVAL:
            self.flush()

    def _write_frame(self, index: int) -> None:
        self._require()
        simulation = self._simulation
        for body, particles in simulation.particles.items():
            chosen = self._chosen(body)
            if chosen is None:
                continue
            arrays = particles.read(["position", *chosen])
            position = arrays["position"]
            self._put_frame(
                body,
                index,
                position,
                {name: arrays[name] for name in chosen if name != "position"},
                {
                    "time": simulation.time,
                    "step": simulation.steps,
                    "body": body,
                    "index": index,
                    "precision": simulation.precision,
                    "version": simulation.version,
                },
                np.float32 if simulation.precision == "single" else np.float64,
                self._elements(body),
            )
            self._list_frame(body, index)

    def _elements(self, body: str) -> NDArray[Any] | None:
        """Return the elements of a body (m, d + 1); None of a body of particles."""
        shape = next(b.shape for b in self._simulation.scene.bodies if b.name == body)
        return shape.rows() if isinstance(shape, ElementMesh) else None

    def _chosen(self, body: str) -> list[str] | None:
        """Return the names stored in frames of a body; None for no frames of it."""
        return self.output.attributes_of(body, meshed=self._elements(body) is not None)

    def _put_frame(
        self,
        body: str,
        index: int,
        position: NDArray[np.float64],
        attributes: Mapping[str, NDArray[Any]],
        metadata: Mapping[str, Any],
        real: type,
        elements: NDArray[Any] | None,
    ) -> None:
        path = frames.frame_path(self._frames, body, index)
        frames.write_frame(path, position, attributes, metadata, real=real, elements=elements)

    def _list_frame(self, body: str, index: int) -> None:
        self._times[body][index] = self._simulation.time
        frames.write_series(self._frames, body, self._times[body])

    def checkpoint(self) -> Path:
        """Write a checkpoint of this moment and drop all but the newest two."""
        self.flush()
        self._make(self._checkpoints)  # one is written where a run is stopped, asked for or not
        path = checkpoints.checkpoint_path(self._checkpoints, self._simulation.steps)
        self._simulation.save_checkpoint(path)
        LOG.info("checkpoint %s at %.6g s", path, self._simulation.time)
        checkpoints.keep_newest(self._checkpoints)
        self.log("running")
        return path

    def flush(self) -> None:
        """Bring the sensor file up to date."""
        self._require()
        self._sensors.flush()
        self._last_flush = clock.monotonic()

    def removed(self, rows: Sequence[Sequence[Any]]) -> None:
        """Add rows (step, body, id, policy, x, y, z) to ``removed.csv``."""
        self._require()
        path = self._folder / "removed.csv"
        with writing(path):
            fresh = not path.exists()
            with path.open("a", encoding="utf-8", newline="") as file:
                table = csv.writer(file)
                if fresh:
                    axes = [f"{a} [m]" for a in "xyz"[: self._simulation.dimension]]
                    table.writerow(["step", "body", "id", "policy", *axes])
                table.writerows(rows)
        self._removed = True

    def export_csv(self) -> list[Path]:
        """Write the samples that the CSV files lack; return the files."""
        self._require()
        paths = []
        for i, series in enumerate(self._simulation.sensors.all_series()):
            path = self._csv / f"{file_name(series.name)}.csv"
            append_csv(path, series, self._csv_rows[i])
            self._csv_rows[i] = len(series)
            paths.append(path)
        return paths

    def log(self, status: str, message: str = "") -> None:
        """Write ``log.json``: what runs, how far it is, how fast, and how it ended."""
        self._require()
        simulation = self._simulation
        content = {
            "writer": self._name,
            "status": status,
            "message": message,
            "version": simulation.version,
            "device": simulation.device,
            "precision": simulation.precision,
            "pipeline": simulation.pipeline,
            "began": self._began,
            "wall_time": round(clock.monotonic() - self._started, 3),
            "time": simulation.time,
            "steps": simulation.steps,
            "particles": dict(zip(simulation.particles, simulation.totals(), strict=True)),
            "displaced": simulation.displaced,
            "particle_steps_per_s": simulation.particle_steps_per_s,
            "output": self.output.to_dict(),
        }
        write_json(self._folder / "log.json", content)

    def finish(self, status: str, message: str = "") -> None:
        """Bring sensors, CSV and log up to date at the end of a run."""
        self.flush()
        self.export_csv()
        self._restore()
        self.log(status, message)

    def _restore(self) -> None:
        """Write again what was deleted during the run and can be; name what cannot."""
        path = self._folder / "scene.json"
        if not path.is_file():
            write_json(path, self._simulation.scene_document())
        gone = [self._folder / "removed.csv"] if self._removed else []
        gone = [path for path in gone if not path.exists()]
        for body, times in self._times.items():
            frame = {i: frames.frame_path(self._frames, body, i) for i in times}
            lost = [i for i, path in frame.items() if not path.exists()]
            gone += [frame[i] for i in lost]
            if lost:
                kept = {i: time for i, time in times.items() if i not in lost}
                self._times[body] = kept
                frames.write_series(self._frames, body, kept)
        if gone:
            more = f" and {len(gone) - 1} more files" if len(gone) > 1 else ""
            warnings.warn(
                f"{gone[0]}{more} that this run wrote are gone; they were deleted while it ran and "
                "cannot be written again",
                ModelWarning, stacklevel=4,
            )  # fmt: skip
        self._removed = self._removed and not gone

    def close(self) -> None:
        """Bring the sensor file up to date and close it; leave the folder to others."""
        try:
            if self._hold is not None and self._hold.held:
                self.flush()
        finally:
            self._sensors.close()
            self.release()
