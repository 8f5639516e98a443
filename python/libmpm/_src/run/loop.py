"""`Loop`: advances a simulation; serves sensors, guard, frames and checkpoints when due."""

from __future__ import annotations

import logging
import math
import time as clock
import warnings
from collections.abc import Callable

from libmpm._src.base.interrupts import asked_to_stop, deferred_interrupt
from libmpm._src.base.log import LOG, TIP
from libmpm._src.base.values import warn
from libmpm._src.boundaries.flow_layers import OUTFLOW
from libmpm._src.errors import Error, ModelWarning, NumericalError
from libmpm._src.run.acting import Actions
from libmpm._src.run.assembly import Assembly
from libmpm._src.run.fault_messages import describe_fault, describe_removed, removed_rows
from libmpm._src.run.files import Files
from libmpm._src.run.progress import Progress, State, reporter
from libmpm._src.run.running import Running
from libmpm._src.run.shared_ranks import SharedRanks
from libmpm._src.run.thread_turns import Turns
from libmpm._src.scene.checks_time_steps import many_steps

__all__ = ["Loop"]

#: Level of what the log says of a run's end.
_LEVELS = {"finished": logging.INFO, "interrupted": logging.WARNING, "failed": logging.ERROR}

#: Seconds of wall time after which the engine returns, so that a key press is answered.
SLICE = 0.2


class Loop:
    """The run loop of one simulation, and what it has cost."""

    def __init__(
        self,
        run: Running,
        turns: Turns,
        shared: SharedRanks,
        assembly: Assembly,
        files: Files,
        actions: Actions,
    ) -> None:
        """Take the parts of `run`."""
        self._run = run
        self._turns = turns
        self._shared = shared
        self._assembly = assembly
        self._files = files
        self._actions = actions
        self._deadline = math.inf
        #: The end of the last `run`, s.
        self.until = math.inf
        #: What ended the last `run` before its time; empty where nothing did.
        self.stopped = ""
        #: Wall and processor time of the engine's steps, s.
        self.wall = 0.0
        self.processor = 0.0
        self._particle_steps = 0

    @property
    def particle_steps_per_s(self) -> float:
        """Particles times steps per second in the engine."""
        return self._particle_steps / self.wall if self.wall > 0 else 0.0

    def step(self, n: int) -> None:
        """Advance `n` steps."""
        self._advance(n, math.inf, reporter(False, 0.0, 0.0, ""))
        with self._turns:
            if self._files.writer is not None:
                self._files.writer.flush()

    def run(
        self, until: float, progress: bool | Callable[[State], object], wall_limit: float | None
    ) -> bool:
        """Advance to `until`, s; return whether it got there. See `Simulation.run`."""
        run, files, shared = self._run, self._files, self._shared
        self._deadline = math.inf if wall_limit is None else clock.monotonic() + wall_limit
        self.stopped = ""
        self.until = until
        with self._turns, shared.together():
            _ = self._assembly.engine
        title = run.scene.name or "libmpm"
        if shared.rank == 0:
            left, plan = until - run.time, self._assembly.plan
            seconds = plan.particles * left / run.dt / plan.rate
            warn(many_steps(left, run.dt, plan.limited_by, seconds))
            for text in plan.warnings:
                LOG.log(TIP, "%s: %s", title, text)
            LOG.info(
                "%s: runs from %.6g to %.6g s, step %d, %s particles, on %s, %s, %s",
                title, run.time, until, run.steps, f"{plan.particles:,}",
                run.device, run.precision, run.pipeline,
            )  # fmt: skip
        status, message = "finished", ""
        report = reporter(progress if shared.rank == 0 else False, run.time, until, title)
        try:
            self._advance(-1, until, report)
            if self.stopped:
                status, message = "interrupted", f"stopped by {self.stopped}; it can be resumed"
                if files.writer is not None:
                    with self._turns, shared.together():
                        files.writer.checkpoint()
        except KeyboardInterrupt:
            status, message = "interrupted", "stopped by an interrupt; it can be resumed"
            if files.writer is not None and files.writer.output.checkpoint_interval:
                with self._turns:
                    # A handler of the caller's own may interrupt between a step and its frame.
                    files.writer.service()
                    files.writer.checkpoint()
            raise
        except Error as error:
            status, message = "failed", str(error)
            raise
        except BaseException as error:
            # A callback's own error, or sys.exit in one: the run has not got to its end.
            status = "interrupted" if isinstance(error, SystemExit) else "failed"
            message = f"{type(error).__name__}: {error}"
            raise
        finally:
            report.close()
            self._deadline = math.inf
            with self._turns:
                files.finish(status, message)
            if shared.rank == 0:
                more = f": {message}" if message else ""
                level, where = _LEVELS[status], (run.time, run.steps)
                LOG.log(level, "%s: %s at %.6g s, step %d%s", title, status, *where, more)
        return not self.stopped

    def _advance(self, steps: int, until: float, report: Progress) -> None:
        """Advance `steps` (-1: no limit) or to `until`, serving whatever falls due."""
        with self._shared.together():
            self._actions.require()
            # Nothing is lost by Ctrl-C while the engine is made; from the folder's first file on it
            # waits for a step's end, or the frame and the samples of the start would be missing.
            with self._turns:
                _ = self._assembly.engine
            with deferred_interrupt() as interrupted:
                with self._turns:
                    self._files.open()
                self._loop(steps, until, report, interrupted)

    def _loop(
        self, steps: int, until: float, report: Progress, interrupted: Callable[[], bool]
    ) -> None:
        engine, shared = self._assembly.made, self._shared
        with self._turns:
            if self._assembly.watch is not None:
                self._assembly.watch.look()
            self._assembly.measurements.service()
            self._actions.service()
            if self._files.writer is not None:
                self._files.writer.service()
        while steps != 0 and engine.time < until:
            left = self._deadline - clock.monotonic()
            self.stopped = shared.agreed("wall limit" if left <= 0 else asked_to_stop())
            if self.stopped:
                break
            # Between slices others read; whoever reads while one is under way waits for it.
            with self._turns:
                done = self._slice(steps, until, left)
            if steps > 0:
                steps -= done
            report.update(State(engine.time, until, int(engine.step), self.particle_steps_per_s))
            if shared.agreed("interrupt" if interrupted() else ""):
                raise KeyboardInterrupt

    def _slice(self, steps: int, until: float, left: float) -> int:
        """Step to what falls due next, `SLICE` or the `left` s at most, and serve it."""
        engine, measured = self._assembly.made, self._assembly.measurements
        watch, writer = self._assembly.watch, self._files.writer
        # The engine stops at the first boundary past the target and never shortens a step, so
        # targets of samples, frames and checkpoints leave the bits alone.
        target = min(until, measured.next_time(), self._actions.next_time())
        if writer is not None:
            target = min(target, writer.next_time())
        most = self._actions.limit(measured.limit(steps))
        if watch is not None:
            most = watch.limit(most)
        began, busy = clock.perf_counter(), clock.process_time()
        result = engine.run(most, target, min(SLICE, left))
        self.wall += clock.perf_counter() - began
        self.processor += clock.process_time() - busy
        done = int(result["steps"])
        self._particle_steps += done * sum(self._run.totals())
        if result["reason"] == "wall" and (steps == done or engine.time >= until):
            # What is due at the last step, a sort say, comes before anyone saves.
            result = engine.run(0, target, math.inf)
        self._collect()
        if result["reason"] == "fault":
            self._files.failure = describe_fault(
                result["fault"], engine.time_step, self._run.scene.cell_size
            )
            raise NumericalError(self._files.failure)
        if watch is not None:
            watch.look()
        measured.service()
        self._actions.service()
        if writer is not None:
            writer.service()
        return done

    def _collect(self) -> None:
        """Take samples and removed particles from the engine."""
        engine, files = self._assembly.made, self._files
        self._assembly.measurements.drain(engine)
        self._assembly.traffic.take(engine)
        gone = list(engine.removed())
        self._shared.count(engine)
        if self._assembly.watch is not None:
            self._assembly.watch.removed(gone)
        # Those that left through an outlet are in its series.
        gone = [g for g in gone if not g[4].startswith(OUTFLOW)]
        if not gone or self._shared.rank > 0:
            return
        names = list(self._run.particles)
        if files.writer is not None:
            files.writer.removed(removed_rows(gone, names, self._run.offset))
        where = files.output.path / "removed.csv" if files.output is not None else None
        warnings.warn(describe_removed(gone, names, where), ModelWarning, stacklevel=4)
