"""`tradeoff`: runs the combinations of numerical choices and measures what they cost and gain."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from libmpm._src.advice.tradeoff.axes import Planned, take_axes
from libmpm._src.advice.tradeoff.axes import one_at_a_time as singly
from libmpm._src.advice.tradeoff.metrics import take_metrics
from libmpm._src.advice.tradeoff.reference import take_reference
from libmpm._src.advice.tradeoff.result import TradeOff
from libmpm._src.advice.tradeoff.table import make_table
from libmpm._src.base.values import Checker, keywords_only
from libmpm._src.scene.scene import Scene
from libmpm._src.studies.study.parameter_samples import full_factorial
from libmpm._src.studies.study.study import Study

__all__ = ["tradeoff"]


@keywords_only("tradeoff", 1)
def tradeoff(
    scene: Scene | Callable[..., Scene],
    axes: Mapping[str, Sequence[Any]],
    *,
    until: float | Callable[..., float],
    metrics: Any,
    reference: Any = "finest",
    one_at_a_time: bool = False,
    options: Mapping[str, Any] | None = None,
    folder: str | Path | None = None,
    device: str | Sequence[str] = "auto",
    threads: int = 1,
    workers: int = 0,
    executor: Any = None,
    repeats: int = 1,
    clock: str = "auto",
    frame_interval: float | None = None,
    retry_failed: bool = False,
    progress: Any = True,
    name: str = "",
) -> TradeOff:
    """Run a scene with other numerical choices, and return error, time and memory of each.

    ==============  ====  ====================================================================
    parameter       unit  meaning
    ==============  ====  ====================================================================
    scene           -     a `Scene`, or ``factory(**row)`` that returns one
    axes            -     name -> values. A name is a parameter of the factory, a choice of the
                          table below, or an option of `Simulation` (device, precision,
                          pipeline, threads, time_step, shared_device)
    until           s     end of every run, > 0, or a callable of those parameters of a row
                          that it names
    metrics         -     what is compared: functions of a `studies.StudyCase` that return a number
                          or a mapping of names to numbers; names ``sensor/component/how``
                          (``sensor/how`` of a sensor with one component), how = last, peak
                          (of the largest magnitude), largest, least, mean, rms or settled
                          (mean of the last tenth); or a mapping of names to such
    reference       -     what the results should be: a number, a mapping of metrics to numbers,
                          a function of a row that returns either, "finest", or a mapping of
                          axes to values: the finest of the rows with them
    one_at_a_time   -     False: all combinations; True: the first values, and each other value
                          beside the first ones of all other axes
    options         -     options of `Simulation` of all rows
    folder          -     where it all lies: a sweep that was stopped continues from there, and
                          `TradeOff.load` reads its table; None = a temporary one
    device          -     of rows that name none, as in `studies.Study.run`, like the next three
    threads         1     CPU threads of a run; 0 = the default
    workers         1     0: one run after another, in this process, so that none disturbs the
                          timing of another
    executor        -     what takes the runs instead, for instance of a cluster
    repeats         1     runs of every row, ≥ 1; the least time counts
    clock           -     "wall", "processor", or "auto": processor time where all rows ran on
                          a CPU with one thread, which others on the machine do not lengthen
    frame_interval  s     frames for metrics that read ``libmpm.load(case.folder)``; None = none
    retry_failed    -     run again what failed before, in a folder
    progress        -     as in `studies.Study.run`
    name            -     for titles
    ==============  ====  ====================================================================

    Choices that are put into a scene, also that of a factory which has no such parameter:

    ==================  ====  ====================================================================
    name                unit  meaning
    ==================  ====  ====================================================================
    cell_size           m     edge of a cell; the domain must be a whole number of them
    particles_per_cell  1     of all bodies
    bulk_modulus        1     factor > 0 on that of every body that has one
    cfl                 1     > 0, ≤ 1
    transfer, kernel    -     `Transfer`, `Kernel` or their names
    fbar, solid_fbar    -     `FBar`, the name of a form, "default" or None, of all fluids or solids
    layer               -     `DecayLayer` or None, of all boundaries that are surfaces
    ==================  ====  ====================================================================

    Times are those of the engine's steps alone: construction, sensors evaluated in Python and files
    do not count. The finest row has the smallest cell; then most particles, the finest precision,
    the largest `bulk_modulus`, the smallest time step, the first place. It is compared with nothing
    and has no error itself. A scene without a sensor of its energy gets one, at 100 times, for the
    drift: change of kinetic + elastic + potential energy from the first sample to the mean of the
    last tenth, as a part of the largest, the potential one taken from the lower corner of the
    domain; friction, viscosity and plastic flow count as loss. It is None where energy comes in:
    through flows, moving or prescribed boundaries, tractions, or gravity that changes.

    What breaks is a row with its `failure`. Raises `SceneError` for what can be seen before the
    first run, `DeviceError` and `OutputError`.
    """
    check = Checker("tradeoff")
    axes = take_axes(check, axes)
    plan = Planned(check, scene, axes, until)
    taken = take_metrics(check, metrics, plan.scene)
    against = take_reference(check, reference, axes)
    repeats = check.integer("repeats", repeats, lower=1)
    check.choice("clock", clock, ("auto", "wall", "processor"))
    check.instance("one_at_a_time", one_at_a_time, (bool,), "True or False")
    check.finish()
    assert against is not None
    rows = singly(axes) if one_at_a_time else full_factorial(axes)
    how = {"device": device, "threads": threads, "progress": progress}
    if executor is None:
        how["workers"] = workers
    elif workers:
        check.fail("workers is given with an executor, which has its own; leave one out")
        check.finish()
    with contextlib.ExitStack() as stack:
        if folder is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="libmpm-tradeoff-"))
        runs = [
            Study(
                Path(folder) if k == 0 else Path(folder) / f"repeat-{k + 1}",
                plan.build,
                rows,
                until=plan.until,
                options=options,
                run_axes=plan.run_axes,
                frame_interval=frame_interval,
                name=name or "tradeoff",
            )
            for k in range(repeats)
        ]
        for study in runs:
            study.run(executor, retry_failed=retry_failed, **how)
        cases = [study.cases for study in runs]
        result = make_table(cases, taken, against, clock, tuple(axes), name)
        result.save(folder)
        result.to_csv(Path(folder) / "tradeoff.csv")
    return result
