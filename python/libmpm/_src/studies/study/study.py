"""A study: a scene factory, a table of rows, and a folder that remembers what has run."""

from __future__ import annotations

import contextlib
import copy
import multiprocessing
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from libmpm._src.base.arguments import keywords_only, known, nearest, quoted, resolved, shown
from libmpm._src.base.values import Checker
from libmpm._src.errors import OutputError, SceneError
from libmpm._src.output.atomic_files import writing
from libmpm._src.output.locks import locked
from libmpm._src.output.settings import Output
from libmpm._src.run.choices import choose_device
from libmpm._src.scene.scene import Scene
from libmpm._src.studies.study import pool
from libmpm._src.studies.study.case import (
    Found,
    Response,
    StudyCase,
    compute_response,
    recorded_responses,
    store_responses,
)
from libmpm._src.studies.study.case_warnings import tell_frames, tell_warnings
from libmpm._src.studies.study.dispatch import Item, Runner
from libmpm._src.studies.study.ledger import read_ledger, update_ledger
from libmpm._src.studies.study.plan import OPTIONS, Plan, Planner, Seconds, Trunk
from libmpm._src.studies.study.progress import StudyState, reporter
from libmpm._src.studies.study.record import glance_record
from libmpm._src.studies.study.rows import canonical, take_rows
from libmpm._src.studies.study.shared_files import CASES, CHECKPOINT, STUDY, TRUNKS
from libmpm._src.studies.study.status import StudyStatus
from libmpm._src.studies.study.table import COLUMNS, StudyResult, TrunkCost

__all__ = ["Study"]

Options = Mapping[str, Any] | Callable[..., Mapping[str, Any]]


class Study:
    """Runs one scene for every row of a table and keeps what comes out.

    ===================  =====  ==============================================================
    parameter            unit   meaning
    ===================  =====  ==============================================================
    folder               -      where it all lies; a study that was stopped continues from there
    factory              -      ``factory(**row)`` returns the `Scene` of a row
    rows                 -      mappings, a NumPy array with named columns, or a data frame
    until                s      end of every case, > 0, or a callable of those parameters of a
                                row that it names
    response             -      ``response(case)`` returns a mapping of names to numbers, from
                                the `StudyCase` and its sensors, None where there is no number; None
                                for `response` = costs only
    trunk                -      a `Trunk` that cases share; None = none
    options              -      options of `Simulation` (device, precision, pipeline, threads,
                                shared_device, time_step, partition) as a mapping, or a callable as
                                for `until`
    run_axes             -      names of such options that rows carry, besides the parameters of
                                the factory: ("device", "precision")
    frame_interval       s      as in `Output`, like the two below; None = no frames
    attributes           -      what frames store
    checkpoint_interval  s      a case that is cut off continues from its newest checkpoint; None =
                                it starts again
    name                 -      for titles
    ===================  =====  ==============================================================

    The factory, `response` and other callables are called in this process only, so they may be
    lambdas; a factory must return equal scenes for equal rows, and should leave the filling of
    bodies to the simulation. A row whose factory raises is a failed row; the others continue.

    A case lies in ``cases/<hash>``, named by what decides its results: scene, end, precision, time
    step, pipeline and trunk. Device, threads and partition count only where rows vary them. Rows
    that come to the same case share its folder and its run. Raises `SceneError` with all problems.
    """

    @keywords_only("Study", 3)
    def __init__(
        self,
        folder: str | Path,
        factory: Callable[..., Scene],
        rows: Any = (),
        *,
        until: Seconds,
        response: Response | None = None,
        trunk: Trunk | None = None,
        options: Options | None = None,
        run_axes: Sequence[str] = (),
        frame_interval: float | None = None,
        attributes: Mapping[str, Sequence[str]] | Sequence[str] | None = None,
        checkpoint_interval: float | None = None,
        name: str = "",
    ) -> None:
        """Check the request; nothing is written or run yet."""
        check = Checker("Study")
        if not callable(factory):
            check.fail(f"factory is {shown(factory, 60)}; expected a function that returns a Scene")
        if not callable(until):
            until = check.number("until", until, lower=0, lower_open=True, unit="s")
        if response is not None and not callable(response):
            check.fail(f"response is {shown(response, 60)}; expected a function of a case, or None")
        if trunk is not None:
            check.instance("trunk", trunk, (Trunk,), "libmpm.studies.Trunk(...)")
        axes = [run_axes] if isinstance(run_axes, str) else None
        axes = check.items("run_axes", run_axes, "names") if axes is None else axes
        for axis in axes:
            if not known(axis, OPTIONS):
                check.fail(f"run_axes has {quoted(axis)}; {nearest(axis, OPTIONS)}")
        if isinstance(options, Mapping):
            for key in options:
                if not known(key, OPTIONS):
                    check.fail(f"options has {quoted(key)}; {nearest(key, OPTIONS)}")
        elif options is not None and not callable(options):
            check.fail(
                f"options is {shown(options, 60)}; expected a mapping or a function, or None"
            )
        name = check.text("name", name, empty=True)
        check.finish()
        self._folder = resolved(folder, "Study")
        self._name = name
        self._response = response
        self._axes = axes
        output = Output(
            folder,
            frame_interval=frame_interval,
            attributes=attributes,
            checkpoint_interval=checkpoint_interval,
        ).to_dict()
        self._output = {
            k: output[k] for k in ("frame_interval", "attributes", "checkpoint_interval")
        }
        self._planner: Planner | None = Planner(self._folder, factory, until, options, axes, trunk)
        self._rows: list[dict[str, Any]] = []
        self._plans: list[Plan] = []
        self.add(rows)

    @classmethod
    @keywords_only("studies.Study.open", 1)
    def open(cls, folder: str | Path) -> Study:
        """Return a study that has run, for `status` and `collect`: all rows its folder knows.

        Raises `SceneError` if the folder holds none.
        """
        study = cls.__new__(cls)
        study._folder = resolved(folder, "Study.open")
        study._name, study._axes, study._plans = read_ledger(study._folder)
        study._rows = [plan.row for plan in study._plans]
        study._response, study._planner, study._output = None, None, {}
        return study

    # What the study is ------------------------------------------------------------------------

    @property
    def folder(self) -> Path:
        """The folder."""
        return self._folder

    @property
    def name(self) -> str:
        """Name for titles."""
        return self._name

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The rows: name -> value."""
        return copy.deepcopy(self._rows)

    @keywords_only("studies.Study.add", 1)
    def add(self, rows: Any) -> None:
        """Add rows, in any of the forms that the constructor takes; raises `SceneError`."""
        planner = self._changeable("add rows")
        taken = take_rows("Study", rows)
        planner.check_rows(taken, COLUMNS)
        self._rows += taken

    @property
    def cases(self) -> list[StudyCase]:
        """One `StudyCase` a row: its parameters, hash, folder and status, as of now.

        Calls the factory for rows that are new. While the trunk of a row has not run, its scene and
        therefore its hash are not known.
        """
        return [self._case(plan) for plan in self._planned()]

    def _changeable(self, what: str) -> Planner:
        if self._planner is None:
            raise SceneError(
                f"Study.open gives status and tables only; to {what}, make the study from its "
                "factory with the same folder"
            )
        return self._planner

    def _planned(self) -> list[Plan]:
        """Return the plans of all rows, as far as they can be known now."""
        if self._planner is not None:
            for plan in self._plans:
                if plan.case is None and plan.root is not None and not plan.error:
                    self._planner.go_on(plan)
            self._plans += map(self._planner.start, self._rows[len(self._plans) :])
        return self._plans

    def _case(self, plan: Plan) -> StudyCase:
        folder = self._folder / CASES / plan.hash if plan.hash else None
        return StudyCase(copy.deepcopy(plan.row), plan.hash, folder, plan.error)

    def status(self) -> StudyStatus:
        """Return how the rows stand, read from the folder now."""
        cases = tuple(self.cases)
        names = dict.fromkeys(plan.trunk for plan in self._plans if plan.trunk)
        trunks = tuple(StudyCase({}, name, self._folder / TRUNKS / name) for name in names)
        return StudyStatus(self._folder, cases, trunks)

    def __repr__(self) -> str:
        """Return name, folder and number of rows."""
        return f"<Study {self._name!r} in {self._folder}: {len(self._rows)} rows>"

    # Running ----------------------------------------------------------------------------------

    @keywords_only("Study.run", 1)
    def run(
        self,
        executor: Any = None,
        *,
        workers: int | None = None,
        threads: int = 1,
        device: str | Sequence[str] = "auto",
        attempts: int = 2,
        progress: bool | Callable[[StudyState], object] = True,
        retry_failed: bool = False,
        time_limit: float | None = None,
    ) -> StudyResult:
        """Run what has not finished yet, and return the table; it is also saved in the folder.

        ============  ====  ================================================================
        parameter     unit  meaning
        ============  ====  ================================================================
        executor      -     anything with ``submit(function, *arguments)`` that returns a
                            future; None = a pool of spawned processes of this machine
        workers       1     processes of that pool; 0 = none, everything runs in this one; None =
                            one a CUDA device, or the cores divided by `threads`
        threads       1     CPU threads of a case whose options say nothing; 0 = the default
        device        -     device of such a case: a name as for `Simulation`, or several, dealt
                            in turn. With "auto" each worker of the pool has a CUDA device of its
                            own; another executor's cases choose where they run
        attempts      1     workers that a case may cost before it counts as failed, ≥ 1
        progress      -     True a bar, False nothing, or a callable that receives a `StudyState`
        retry_failed  -     run failed cases again
        time_limit    s     wall time of a case, > 0, over all runs that it continues in; None = any
        ============  ====  ================================================================

        Finished cases are not run again; a failed one is recorded and does not stop the rest. A
        case that another study runs at this moment, in this folder, is waited for. Ctrl-C stops
        every case at a step boundary; a later call continues. A script needs
        ``if __name__ == "__main__":`` around this call, as its workers import the script.

        A case over its `time_limit` stops at a step boundary, writes a checkpoint and counts as
        failed; with a larger limit and `retry_failed` it continues from there. A worker of this
        machine that does not answer for a minute more, or a tenth of the limit, is ended; those of
        another executor are not.

        Raises `SceneError`, `DeviceError`, `OutputError`, and `Error` if the executor breaks.
        """
        planner = self._changeable("run it")
        check = Checker("Study.run")
        if workers is not None:
            workers = check.integer("workers", workers)
        threads = check.integer("threads", threads)
        attempts = check.integer("attempts", attempts, lower=1)
        if time_limit is not None:
            time_limit = check.number("time_limit", time_limit, lower=0, lower_open=True, unit="s")
        if executor is not None and not callable(getattr(executor, "submit", None)):
            check.fail(f"executor is {shown(executor, 60)}; expected an object with submit(...)")
        elif executor is not None and workers is not None:
            check.fail("workers is given with an executor, which has its own; leave one out")
        check.finish()
        pool.refuse_forks(executor)
        with writing(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
        own = executor is None
        if own:
            slots = pool.choose_slots(device, workers or (None if workers is None else 1), threads)
            executor = pool.Inline() if workers == 0 else _new_pool(len(slots))
        else:
            slots = [device] if isinstance(device, str) else list(device)
        records: dict[str, dict[str, Any]] = {}
        responses: dict[int, Found] = {}

        def finished(item: Item) -> list[Item]:
            records[item.key] = item.record
            return self._finished(item, planner, index, responses)

        runner = Runner(
            executor,
            self._folder,
            device=_dealer(executor, slots, device),
            threads=threads,
            output=self._output,
            attempts=attempts,
            retry_failed=retry_failed,
            time_limit=time_limit,
            finished=finished,
        )
        for number, plan in enumerate(self._plans):
            if plan.error:
                # What a factory could not do yesterday it may do today.
                self._plans[number] = planner.start(plan.row)
        plans = self._planned()
        index: dict[str, list[int]] = {}
        for number, plan in enumerate(plans):
            index.setdefault(f"{TRUNKS}/{plan.trunk}", []).append(number)
            index.setdefault(f"{CASES}/{plan.hash}", []).append(number)
        self._keep()
        wait = False
        try:
            # Cases in threads of this process change the filters of warnings under each other.
            with warnings.catch_warnings():
                runner.add([self._item(plan) for plan in plans if plan.case or plan.root])
                runner.run(reporter(progress, self._name or self._folder.name, runner.state))
            wait = True
        finally:
            if own:
                executor.close(wait=wait)
            with contextlib.nullcontext() if wait else contextlib.suppress(OutputError):
                self._keep()
        tell_warnings(records)
        tell_frames(records, self._output["frame_interval"])
        result = self._table(records, responses)
        self._save(result)
        return result

    def _item(self, plan: Plan) -> Item:
        """Return what runs next for a row: its case, or first its trunk."""
        what, kind = (plan.case, CASES) if plan.case is not None else (plan.root, TRUNKS)
        assert what is not None
        return Item(what, self._folder / kind / what.hash, kind == TRUNKS, plan.row)

    def _finished(
        self,
        item: Item,
        planner: Planner,
        index: dict[str, list[int]],
        responses: dict[int, Found],
    ) -> list[Item]:
        """Note what has come out of a simulation; return what can run because of it.

        `index` holds the numbers of the rows of each item, and is extended.
        """
        numbers = index[item.key]
        good = item.record["status"] == "finished"
        if not item.trunk:
            if good and self._response is not None:
                responses |= self._respond(numbers)
            return []
        new = []
        for number in numbers:
            plan = self._plans[number]
            if plan.case is not None:
                new.append(plan)
                continue
            if not good:
                plan.error = f"its trunk {plan.trunk} failed: {item.record.get('error')}"
                continue
            planner.go_on(plan)
            if plan.case is not None:
                index.setdefault(f"{CASES}/{plan.hash}", []).append(number)
                new.append(plan)
            elif not plan.error:
                plan.error = (
                    f"its trunk {plan.trunk} has finished, but its {CHECKPOINT} is not seen here; "
                    "all processes must see the folder under the same path"
                )
        # From a shell, the cases are known from now on; what cannot be written is told at the end.
        with contextlib.suppress(OutputError):
            self._keep()
        return [self._item(plan) for plan in new]

    def _respond(self, numbers: Sequence[int]) -> dict[int, Found]:
        """Return the responses of rows that share a finished case, and keep them in its folder."""
        assert self._response is not None
        cases = [self._case(self._plans[number]) for number in numbers]
        found = [compute_response(case, self._response) for case in cases]
        # A table is worth having from a folder that cannot be written, too.
        with contextlib.suppress(OutputError):
            folder = self._folder / CASES / cases[0].hash
            store_responses(folder, list(zip(cases, found, strict=True)))
        return dict(zip(numbers, found, strict=True))

    def _keep(self) -> None:
        update_ledger(self._folder, self._name, self._axes, self._plans)

    def _save(self, result: StudyResult) -> None:
        with locked(self._folder / f"{STUDY}.lock"):
            result.save_csv(self._folder / "table.csv")
            result.save_hdf5(self._folder / "table.h5")

    # The table --------------------------------------------------------------------------------

    def collect(self) -> StudyResult:
        """Return the table of what there is now; nothing is run.

        Responses are computed again from the sensors of the finished cases, so `response` may have
        changed; a study from `Study.open` shows those kept in the folder.
        """
        return self._table({}, {})

    def _table(
        self, records: Mapping[str, Mapping[str, Any]], responses: Mapping[int, Found]
    ) -> StudyResult:
        cases = []
        unanswered: dict[str, list[int]] = {}
        for number, plan in enumerate(self._planned()):
            case = self._case(plan)
            known = records.get(f"{CASES}/{plan.hash}")
            if known is not None:
                # What could not be written to a full disk is known here all the same.
                case.record = dict(known)
            cases.append(case)
            if case.status == "finished" and number not in responses:
                unanswered.setdefault(plan.hash, []).append(number)
        responses = dict(responses)
        for name, numbers in unanswered.items():
            if self._response is not None:
                responses |= self._respond(numbers)
                continue
            kept = recorded_responses(self._folder / CASES / name)
            for number in numbers:
                found = kept.get(canonical(cases[number].parameters))
                responses |= {} if found is None else {number: found}
        rows = []
        parameters: dict[str, None] = {}
        answers: dict[str, None] = {}
        sharing: dict[str, set[str]] = {}
        for number, (plan, case) in enumerate(zip(self._plans, cases, strict=True)):
            answer = responses.get(number, ({}, "")) if case.status == "finished" else ({}, "")
            parameters |= dict.fromkeys(plan.row)
            answers |= dict.fromkeys(answer[0])
            if plan.trunk:
                sharing.setdefault(plan.trunk, set()).add(plan.hash)
            measured = {k: case.record.get(k) for k in COLUMNS if k in case.record}
            rows.append(
                dict.fromkeys(COLUMNS)
                | plan.row
                | answer[0]
                | {k: v for k, v in measured.items() if v is not None}
                | {"status": case.status, "case": plan.hash, "trunk": plan.trunk}
                | {"error": case.error or answer[1]}
            )
        trunks = {}
        for trunk, sharers in sharing.items():
            record = glance_record(self._folder / TRUNKS / trunk)
            if record.get("status") == "finished":
                trunks[trunk] = TrunkCost(record.get("wall_time") or 0.0, len(sharers - {""}))
        return StudyResult(tuple(rows), tuple(parameters), tuple(answers), self._name, trunks)


def _new_pool(workers: int) -> pool.SpawnPool:
    """Return a pool, unless this process is itself being made by one."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SceneError(
            "Study.run: called while a worker imports this script; put the call under "
            "`if __name__ == '__main__':`"
        )
    return pool.SpawnPool(workers)


def _dealer(
    executor: Any, slots: Sequence[str], device: str | Sequence[str]
) -> Callable[[Item], str]:
    """Return what names the device of the next case that names none itself."""
    dealt = 0

    def deal(item: Item) -> str:
        nonlocal dealt
        if device == "auto" and choose_device(item.what.scene, "auto") == "cpu":
            return "auto"
        dealt += 1
        number = executor.idle() if isinstance(executor, pool.SpawnPool) else dealt - 1
        return slots[number % len(slots)]

    return deal
