"""What runs a case, in whatever process or thread an executor chooses."""

from __future__ import annotations

import contextlib
import datetime
import gc
import os
import socket
import threading
import time as clock
import traceback
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from libmpm._src.errors import Error, OutputError
from libmpm._src.output import locks
from libmpm._src.output.atomic_files import write_json, writing
from libmpm._src.output.checkpoint import find_checkpoints
from libmpm._src.output.folder_lock import lent
from libmpm._src.output.locks import Lock
from libmpm._src.run.progress import State
from libmpm._src.studies.study.record import read_record
from libmpm._src.studies.study.rows import describe
from libmpm._src.studies.study.shared_files import (
    CHECKPOINT,
    LOCK,
    PARAMETERS,
    STATUS,
    TRACEBACK,
)

if TYPE_CHECKING:
    from libmpm._src.output.settings import Output
    from libmpm._src.run.simulation import Simulation
    from libmpm._src.scene.run_file import RunSettings

__all__ = ["LEAVING", "record_death", "run_case"]

#: Set where this process is about to end: its parent is gone, or it was asked to.
LEAVING = threading.Event()

#: Bytes of a simulation above which its memory is freed before the next one starts.
_LARGE = 64 << 20


class _Stopped(KeyboardInterrupt):
    """The study asked this case to stop: an interrupt to the simulation."""


def run_case(task: Mapping[str, Any]) -> dict[str, Any]:
    """Run one case or trunk, unless another process does or did; never raises for its failure.

    `task` is what `Item.task` makes. Returns {"outcome": ...}: "done" with the case's "record",
    which is the content of its ``status.json``; "busy" if another process holds it; "stopped".
    """
    if _asked_to_stop(task):
        return {"outcome": "stopped"}
    folder = Path(task["folder"])
    try:
        lock = _lock(folder, task)
    except OutputError as error:
        return _unusable(error)
    if lock is None:
        return {"outcome": "busy"}
    try:
        try:
            found = read_record(folder)
        except OutputError as error:
            return _unusable(error)
        if is_over(folder, found, trunk=task["trunk"], retry=task["retry"]):
            return {"outcome": "done", "record": found}
        return _Attempt(task, folder, lock, found).run()
    finally:
        lock.release()


def is_over(folder: Path, record: Mapping[str, Any], *, trunk: bool, retry: str) -> bool:
    """Tell whether nothing is left to run; `retry` is the token of a failure to try again.

    A trunk that has finished and whose checkpoint has been deleted since is run again.
    """
    status = record.get("status")
    if status == "finished":
        return not trunk or (folder / CHECKPOINT).is_file()
    return status == "failed" and record.get("token") != retry


def _unusable(error: OutputError) -> dict[str, Any]:
    """Return the failure of a case whose folder cannot be used, and so keeps no record of it."""
    record = {"status": "failed", "error": f"OutputError: {error}", "token": ""}
    return {"outcome": "done", "record": record}


def _lock(folder: Path, task: Mapping[str, Any]) -> Lock | None:
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    return Lock.acquire(folder / LOCK, dead=task["dead"])


def record_death(task: Mapping[str, Any], error: str) -> dict[str, Any] | None:
    """Write that a case's workers died; returns the record, or None while somebody runs it."""
    folder = Path(task["folder"])
    lock = _lock(folder, task)
    if lock is None:
        return None
    try:
        record = read_record(folder)
        if not is_over(folder, record, trunk=task["trunk"], retry=task["retry"]):
            record |= {"status": "failed", "error": error, "token": lock.token, "ended": _now()}
            write_json(folder / STATUS, record)
        return record
    finally:
        lock.release()


def _asked_to_stop(task: Mapping[str, Any]) -> bool:
    return LEAVING.is_set() or os.path.exists(task["stop"])


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")


class _Attempt:
    """One run of a case by this process, which holds its lock."""

    def __init__(
        self, task: Mapping[str, Any], folder: Path, lock: Lock, before: Mapping[str, Any]
    ) -> None:
        """Prepare the record; nothing is written yet."""
        self._task = task
        self._folder = folder
        self._lock = lock
        self._before = before
        self._began = clock.monotonic()
        self._spent = 0.0
        self._state: State | None = None
        self._lost = False
        self._record: dict[str, Any] = {
            "status": "running",
            "error": "",
            "hash": task["hash"],
            "token": lock.token,
            "study_run": task["study_run"],
            "attempt": task["attempt"],
            "began": _now(),
            "ended": None,
            "heartbeat": _now(),
            "host": socket.gethostname(),
            "pid": os.getpid(),
            "resumed_at": 0.0,
            "first_step": 0,
            "until": task["until"],
            "frame_interval": task["output"]["frame_interval"],
        } | {name: task["options"][name] for name in ("device", "precision")}

    def run(self) -> dict[str, Any]:
        """Run to the end and record how it went."""
        outcome = "done"
        messages: list[str] = []
        try:
            with writing(self._folder):
                (self._folder / TRACEBACK).unlink(missing_ok=True)
            write_json(self._folder / "scene.json", self._document())
            write_json(self._folder / PARAMETERS, self._task["parameters"])
            write_json(self._folder / STATUS, self._record)
            with self._heart(), lent(self._lock), _warnings_in(messages):
                self._simulate()
            self._record["status"] = "finished"
        except KeyboardInterrupt as stop:
            self._record |= self._reached() | {"status": "interrupted"}
            if not isinstance(stop, _Stopped):
                self._close(messages)
                raise
            outcome = "stopped"
        except Exception as error:
            self._record |= self._reached()
            self._record |= {"status": "failed", "error": describe(error)}
            # A full disk must not hide what went wrong before it.
            with contextlib.suppress(OSError):
                if not self._is_lost():
                    (self._folder / TRACEBACK).write_text(
                        traceback.format_exc(), encoding="utf-8", errors="backslashreplace"
                    )
        if self._is_lost():
            # What has taken over the case writes its record.
            return {"outcome": "busy"}
        self._close(messages)
        return {"outcome": outcome, "record": self._record}

    def _is_lost(self) -> bool:
        """Tell whether another process has the case now; the run may notice before a beat does."""
        return self._lost or self._lock.lost

    def _close(self, messages: list[str]) -> None:
        self._record |= {
            "ended": _now(),
            "heartbeat": _now(),
            "wall_time": round(self._spent + clock.monotonic() - self._began, 6),
            "warnings": messages,
        }
        try:
            write_json(self._folder / STATUS, self._record)
        except OutputError as error:
            # The study still learns of it from what is returned.
            if self._record["status"] == "finished":
                self._record |= {"status": "failed", "error": f"OutputError: {error}"}

    def _document(self) -> dict[str, Any]:
        """Return the scene file, which `libmpm run` can run alone."""
        found: dict[str, Any] = self._task["scene"] | {"run": self._settings().to_dict()}
        return found

    def _settings(self) -> RunSettings:
        from libmpm._src.scene.run_file import RunSettings

        return RunSettings(until=self._task["until"], **self._task["output"])

    # The simulation ---------------------------------------------------------------------------

    def _simulate(self) -> None:
        simulation = self._resumed() or self._fresh()
        simulation.run_settings = self._settings().to_dict()
        start = simulation.scene.start
        self._record |= {
            # A scene that continues from a trunk begins at the trunk's last step.
            "first_step": 0 if start is None else start.step,
            "device": simulation.device,
            "precision": simulation.precision,
            "version": simulation.version,
        }
        large = simulation.device != "cpu" or simulation.plan.memory_total > _LARGE
        try:
            with simulation:
                self._run_within_limit(simulation)
                if self._task["trunk"]:
                    simulation.save_checkpoint(self._folder / CHECKPOINT)
                wall, processor = simulation.seconds_stepping
                alone = threading.current_thread() is threading.main_thread()
                self._record |= {
                    "engine_time": round(wall, 9),
                    # Of a process whose threads run a case each, nobody can tell whose it was.
                    "processor_time": round(processor, 9) if alone else None,
                    "pipeline": simulation.pipeline,
                    "threads": simulation.threads,
                    "time_step": simulation.dt,
                    "time": simulation.time,
                    "steps": simulation.steps - self._record["first_step"],
                    "particles": sum(len(body) for body in simulation.particles.values()),
                    "particle_steps_per_s": simulation.particle_steps_per_s,
                }
                if self._task["parameters"]["trunk"]:
                    self._record["displaced"] = sum(simulation.displaced.values())
        finally:
            del simulation
            if large:
                # The views of a simulation refer back to it, so its memory waits for the collector.
                gc.collect()

    def _run_within_limit(self, simulation: Any) -> None:
        """Run to the end; raises `Error` where the case's limit of time is over before."""
        limit, until = self._task["time_limit"], self._task["until"]
        left = None
        if limit is not None:
            left = max(limit - self._spent - (clock.monotonic() - self._began), 0.0)
        if not simulation.run(until=until, progress=self._watch, wall_limit=left):
            raise Error(
                f"its time limit, {limit:g} s, was reached at {simulation.time:g} of {until:g} s, "
                f"step {simulation.steps}; raise time_limit and run with retry_failed=True: it "
                "continues from the checkpoint of this step"
            )

    def _output(self) -> Output:
        return self._settings().output(self._folder, overwrite=True)

    def _fresh(self) -> Simulation:
        from libmpm._src.run.simulation import Simulation
        from libmpm._src.scene.scene import Scene

        scene = Scene.from_dict(self._task["scene"])
        return Simulation(scene, output=self._output(), **self._task["options"])

    def _resumed(self) -> Simulation | None:
        """Return the simulation at the newest checkpoint of an attempt that was cut off."""
        from libmpm._src.run.simulation import Simulation

        output = self._output()
        # A case that has reached its limit of time leaves one, with or without an interval.
        if not find_checkpoints(self._folder / "checkpoints"):
            return None
        try:
            made = Simulation.resume(
                self._folder,
                device=self._task["options"]["device"],
                output=output,
                partition=self._task["options"]["partition"] or "same",
            )
        except Error as error:
            warnings.warn(f"{error}; the case starts again", stacklevel=2)
            return None
        recorded = made.recorded_output()
        if recorded is None or recorded.frame_interval != output.frame_interval:
            return None
        self._spent = float(self._before.get("wall_time") or 0.0)
        self._record["resumed_at"] = made.time
        return made

    def _watch(self, state: State) -> None:
        """Take the state of the run, several times a second; raises where it shall stop."""
        self._state = state
        if self._is_lost() or _asked_to_stop(self._task):
            raise _Stopped

    def _reached(self) -> dict[str, Any]:
        state = self._state
        if state is None:
            return {}
        steps = state.steps - self._record["first_step"]
        return {"time": state.time, "steps": steps, "particle_steps_per_s": state.rate}

    @contextlib.contextmanager
    def _heart(self) -> Iterator[None]:
        """Show now and then that the case is alive, however long a step takes."""
        over = threading.Event()

        def beat() -> None:
            while not over.wait(locks.HEARTBEAT):
                if not self._lock.beat():
                    self._lost = True
                    return
                spent = round(self._spent + clock.monotonic() - self._began, 3)
                shown = self._record | self._reached() | {"heartbeat": _now(), "wall_time": spent}
                # The run sweeps temporary files away as it starts; the next beat will do.
                with contextlib.suppress(OutputError):
                    write_json(self._folder / STATUS, shown)

        thread = threading.Thread(target=beat, name="libmpm study heartbeat", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


@contextlib.contextmanager
def _warnings_in(messages: list[str]) -> Iterator[None]:
    """Collect the texts of warnings, where that does not reach into other threads' work."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        finally:
            messages += dict.fromkeys(str(w.message) for w in caught)
