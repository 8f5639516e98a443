"""Studies on real pools of processes, Dask, MPI and submitit, with workers killed in the middle."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from python.study_scenes import (
    LONG,
    UNTIL,
    block,
    fallen,
    finish,
    kinetic,
    long_block,
    running,
    start,
    status,
    wait_for,
)

import libmpm
from libmpm import studies
from libmpm._src.run import backends
from libmpm._src.studies.study import pool

ROWS = [{"gravity": 1.0 + i} for i in range(6)]


def make(folder, rows=ROWS, **arguments):
    return libmpm.Study(folder, block, rows, until=UNTIL, response=kinetic, **arguments)


def make_long(folder, number, **arguments):
    rows = [{"number": i} for i in range(number)]
    arguments = {"until": LONG, "response": kinetic} | arguments
    return libmpm.Study(folder, long_block, rows, **arguments)


def correct(result):
    assert not result.failed, result
    for row in result.rows:
        assert row["kinetic"] == pytest.approx(fallen(row), rel=1e-5)
    return True


def alive(pid):
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


# The pool of this machine -----------------------------------------------------------------------


def test_a_pool_of_processes_runs_two_hundred_cases(tmp_path):
    rows = [{"gravity": 1.0 + 0.1 * i} for i in range(200)]
    result = make(tmp_path, rows).run(workers=2, device="cpu", progress=False)
    assert correct(result)
    assert len(set(result["case"])) == 200
    pids = {status(tmp_path / "cases" / name)["pid"] for name in result["case"]}
    assert len(pids) == 2
    assert os.getpid() not in pids


def test_a_killed_worker_takes_no_other_case_with_it(tmp_path):
    """One of two workers is killed once, and again at the case that kills whoever runs it."""
    study = make_long(tmp_path, 4)
    doomed = study.cases[0].folder
    victims = []

    def on_its(folder, attempt):
        found = status(folder)
        return found.get("attempt") == attempt and found["status"] == "running" and found

    def kill():
        # The first case loses both its workers, the second one of them.
        for folder, times in ((study.cases[1].folder, 1), (doomed, 2)):
            for attempt in range(1, times + 1):
                found = wait_for(lambda f=folder, a=attempt: on_its(f, a))
                victims.append(found["pid"])
                os.kill(found["pid"], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    result = study.run(workers=2, device="cpu", progress=False)
    killer.join()
    assert len(set(victims)) == 3
    assert result["status"].tolist() == ["failed"] + ["finished"] * 3
    (failed,) = result.failed
    assert "its worker died 2 time(s)" in failed["error"]
    records = [case.record for case in study.cases]
    assert [r["attempt"] for r in records] == [2, 2, 1, 1]
    # Asked for, it is tried again; nobody kills it now.
    assert (
        not make_long(tmp_path, 1)
        .run(workers=1, device="cpu", progress=False, retry_failed=True)
        .failed
    )


def test_a_worker_killed_after_a_checkpoint_loses_little(tmp_path):
    study = make_long(tmp_path / "killed", 1, checkpoint_interval=5.0)
    (case,) = study.cases

    def kill():
        wait_for(lambda: list(case.folder.glob("checkpoints/step_*.npz")))
        os.kill(status(case.folder)["pid"], signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    result = study.run(workers=1, device="cpu", progress=False)
    killer.join()
    record = study.cases[0].record
    assert record["attempt"] == 2
    assert record["resumed_at"] >= 5.0
    whole = make_long(tmp_path / "whole", 1).run(workers=0, device="cpu", progress=False)
    assert result["kinetic"].tolist() == whole["kinetic"].tolist()
    assert result["case"].tolist() == whole["case"].tolist()


def test_a_worker_that_is_asked_to_end_first_writes_where_it_stands(tmp_path):
    # No checkpoint falls due: the only one is that of the end.
    study = make_long(tmp_path, 2, checkpoint_interval=10 * LONG)
    (first, second) = [case.folder for case in study.cases]

    def terminate():
        found = wait_for(lambda: status(first).get("status") == "running" and status(first))
        os.kill(found["pid"], signal.SIGTERM)

    terminator = threading.Thread(target=terminate)
    terminator.start()
    assert not study.run(workers=1, device="cpu", progress=False).failed
    terminator.join()
    assert status(first)["resumed_at"] > 0
    assert status(second)["resumed_at"] == 0


SCRIPT = """
import libmpm
from python.study_scenes import LONG, long_block

def study(folder):
    rows = [{"number": i} for i in range(3)]
    return libmpm.Study(folder, long_block, rows, until=20 * LONG, checkpoint_interval=LONG / 20)
"""

COMMAND = """
import sys
from libmpm._src.cli.commands import main
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def start_command(tmp_path):
    (tmp_path / "study.py").write_text(SCRIPT)
    (tmp_path / "command.py").write_text(COMMAND)
    command = ["study", "run", tmp_path / "study.py", "-o", tmp_path / "out"]
    child = start(tmp_path / "command.py", *command, "--workers", 2, "--device", "cpu", "--quiet")
    found = wait_for(lambda: running(tmp_path / "out", 2))
    wait_for(lambda: len(list(tmp_path.glob("out/cases/*/checkpoints/step_*.npz"))) >= 2)
    return child, [record["pid"] for record in found]


def goes_on(folder):
    """The study that was stopped goes on from its checkpoints, to an earlier end."""
    stopped = [p for p in (folder / "cases").iterdir() if list(p.glob("checkpoints/step_*.npz"))]
    assert len(stopped) == 2
    study = make_long(folder, 3, until=20 * LONG, checkpoint_interval=LONG / 20, response=None)
    assert sorted(c.status for c in study.cases) == ["interrupted", "interrupted", "planned"]
    assert {c.folder for c in study.cases if c.status == "interrupted"} == set(stopped)
    return study


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_stops_every_case_where_it_can_go_on(tmp_path, number):
    child, pids = start_command(tmp_path)
    child.send_signal(number)
    code, _, said = finish(child)
    assert code == 130
    assert "interrupted" in said
    wait_for(lambda: not any(map(alive, pids)))
    study = goes_on(tmp_path / "out")
    for case in study.cases:
        if case.status == "interrupted":
            # The checkpoint is of the very step at which it stopped.
            steps = case.record["steps"]
            assert (case.folder / "checkpoints" / f"step_{steps:010d}.npz").is_file()
            assert not (case.folder / "lock").exists()
    assert not list((tmp_path / "out").glob(".stop*"))


def test_the_workers_of_a_killed_study_end_and_it_goes_on(tmp_path):
    child, pids = start_command(tmp_path)
    child.kill()
    wait_for(lambda: not any(map(alive, pids)))
    finish(child)
    study = goes_on(tmp_path / "out")
    # One of the cases, to an end that is soon reached, from where it was.
    (case,) = [c for c in study.cases if c.status == "interrupted"][:1]
    sim = libmpm.Simulation.resume(case.folder, device="cpu")
    assert sim.time == pytest.approx(case.record["time"], abs=LONG)
    assert sim.time > 0


def test_two_processes_on_one_folder_run_no_case_twice(tmp_path):
    script = tmp_path / "both.py"
    script.write_text("""
import sys
import libmpm
from libmpm._src.studies.study import worker
from python.study_scenes import LONG, long_block, kinetic

real = worker._Attempt.run
def noting(attempt):
    with open(attempt._folder / "runs.txt", "a") as file:
        file.write("run\\n")
    return real(attempt)
worker._Attempt.run = noting

if __name__ == "__main__":
    rows = [{"number": i} for i in range(8)]
    study = libmpm.Study(sys.argv[1], long_block, rows, until=LONG / 10, response=kinetic)
    result = study.run(workers=0, device="cpu", progress=False)
    print(result["kinetic"].tolist(), result["status"].tolist())
""")
    children = [start(script, tmp_path / "out") for _ in range(2)]
    (one, said, _), (two, also, _) = map(finish, children)
    assert one == two == 0
    assert said == also
    assert "'finished'" in said
    runs = [path.read_text() for path in (tmp_path / "out").glob("cases/*/runs.txt")]
    assert runs == ["run\n"] * 8
    owners = {status(path)["study_run"] for path in (tmp_path / "out" / "cases").iterdir()}
    assert len(owners) == 2


def test_a_script_without_a_guard_is_told_so(tmp_path):
    script = tmp_path / "bare.py"
    script.write_text(f"""
import libmpm
from python.study_scenes import UNTIL, block
libmpm.Study({str(tmp_path / "out")!r}, block, [{{}}], until=UNTIL).run(device="cpu")
""")
    code, _, said = finish(start(script))
    assert code == 1
    assert "must do so under `if __name__ == '__main__':`" in said
    assert "SceneError: Study.run: called while a worker imports this script" in said


def test_each_worker_of_the_pool_has_a_device_of_its_own(monkeypatch):
    found = ({"name": "a"}, {"name": "b"})
    status = backends.CudaStatus(object(), found, "")
    monkeypatch.setattr(backends, "cuda_status", lambda: status)
    assert pool.choose_slots("auto", None, 1) == ["cuda:0", "cuda:1"]
    assert pool.choose_slots("auto", 3, 1) == ["cuda:0", "cuda:1", "cuda:0"]
    assert pool.choose_slots("cuda:1", None, 1) == ["cuda:1"]
    assert pool.choose_slots(["cuda:1", "cpu"], None, 1) == ["cuda:1", "cpu"]
    with pytest.raises(libmpm.DeviceError, match="cuda:2"):
        pool.choose_slots(["cuda:2"], None, 1)
    with pytest.raises(libmpm.SceneError, match="device is an empty list"):
        pool.choose_slots([], None, 1)
    monkeypatch.setattr(backends, "cuda_status", lambda: backends.CudaStatus(None, (), "none"))
    monkeypatch.setattr(pool, "cores", lambda: 8)
    assert pool.choose_slots("auto", None, 1) == ["cpu"] * 8
    assert pool.choose_slots("auto", None, 3) == ["cpu"] * 2
    assert pool.choose_slots("cpu", None, 16) == ["cpu"]
    assert pool.choose_slots("auto", None, 0) == ["cpu"]


# Executors of others ----------------------------------------------------------------------------


class Odd:
    """The least that an executor may be: threads, and futures that do not call back."""

    class Job:
        def __init__(self, function, arguments):
            self._future = Future()
            self._thread = threading.Thread(target=self._run, args=(function, *arguments))
            self._thread.start()

        def _run(self, function, *arguments):
            try:
                self._future.set_result(function(*arguments))
            except BaseException as error:
                self._future.set_exception(error)

        def done(self):
            return self._future.done()

        def result(self):
            return self._future.result()

        def exception(self):
            return self._future.exception()

    def __init__(self, losses=0):
        self.losses = losses

    def submit(self, function, *arguments):
        if self.losses:
            self.losses -= 1
            return self.Job(lambda *_: 1 / 0, arguments)
        return self.Job(function, arguments)


def test_an_executor_needs_submit_only(tmp_path):
    assert correct(make(tmp_path).run(Odd(), device="cpu", progress=False))


def test_a_lost_job_is_handed_out_again_and_then_given_up(tmp_path):
    assert correct(make(tmp_path / "a", ROWS[:1]).run(Odd(1), device="cpu", progress=False))
    result = make(tmp_path / "b", ROWS[:1]).run(Odd(2), device="cpu", progress=False)
    assert "died 2 time(s) (ZeroDivisionError" in result.failed[0]["error"]
    patient = make(tmp_path / "c", ROWS[:1])
    assert correct(patient.run(Odd(2), attempts=3, device="cpu", progress=False))


def test_a_broken_executor_keeps_what_has_finished(tmp_path):
    class Broken(Odd):
        left = 2

        def submit(self, function, *arguments):
            self.left -= 1
            if self.left < 0:
                raise RuntimeError("cannot schedule new futures")
            return super().submit(function, *arguments)

    first = make(tmp_path, ROWS[:2])
    first.run(Odd(), device="cpu", progress=False)
    tokens = [case.record["token"] for case in first.cases]
    study = make(tmp_path)
    with pytest.raises(libmpm.Error, match=r"takes no more cases.*cannot schedule.*run the study"):
        study.run(Broken(), device="cpu", progress=False)
    assert correct(study.run(Odd(), device="cpu", progress=False))
    assert [case.record["token"] for case in study.cases[:2]] == tokens


def test_an_interrupt_stops_cases_in_threads(tmp_path):
    study = make_long(tmp_path, 3, until=100 * LONG)

    def interrupt():
        wait_for(lambda: running(tmp_path, 2))
        os.kill(os.getpid(), signal.SIGINT)

    with ThreadPoolExecutor(2) as executor:
        threading.Thread(target=interrupt).start()
        with pytest.raises(KeyboardInterrupt):
            study.run(executor, device="cpu", progress=False)
    states = [case.status for case in study.cases]
    assert sorted(states) == ["interrupted", "interrupted", "planned"]
    assert not list(tmp_path.glob("**/lock"))
    assert not list(tmp_path.glob(".stop*"))


def test_a_process_pool_of_ones_own(tmp_path):
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        assert correct(make(tmp_path, ROWS[:3]).run(executor, device="cpu", progress=False))
    with (
        ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("fork")) as executor,
        pytest.raises(libmpm.SceneError, match=r"forks its workers.*get_context\('spawn'\)"),
    ):
        make(tmp_path).run(executor)


def test_dask_with_worker_processes(tmp_path):
    """By the client's executor and by the client itself, with one worker killed in the middle."""
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None,
        local_directory=str(tmp_path / "dask"), silence_logs=50,
    )  # fmt: skip
    with cluster, distributed.Client(cluster) as client:
        one = make(tmp_path / "one").run(client.get_executor(), device="cpu", progress=False)
        assert correct(one)
        study = make_long(tmp_path / "two", 3)

        def kill():
            os.kill(wait_for(lambda: running(tmp_path / "two"))[0]["pid"], signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        two = study.run(client, device="cpu", progress=False)
        killer.join()
    assert not two.failed
    assert np.isfinite(two["kinetic"]).all()
    pids = [case.record["pid"] for case in study.cases]
    assert os.getpid() not in pids


def test_mpi_with_two_ranks(tmp_path):
    pytest.importorskip("mpi4py")
    places = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    launcher = shutil.which("mpiexec", path=places)
    if launcher is None:
        pytest.skip("no mpiexec, which `pip install mpich` brings")
    script = tmp_path / "ranks.py"
    script.write_text("""
import os, sys
import libmpm
from mpi4py.futures import MPIPoolExecutor
from python.study_scenes import UNTIL, block, kinetic

if __name__ == "__main__":
    rows = [{"gravity": 1.0 + i} for i in range(6)]
    study = libmpm.Study(sys.argv[1], block, rows, until=UNTIL, response=kinetic)
    with MPIPoolExecutor() as executor:
        result = study.run(executor, device="cpu", progress=False)
    print("pid", os.getpid(), result["status"].tolist())
""")
    # Open MPI refuses root, and knows this option; MPICH neither.
    about = subprocess.run([launcher, "--version"], capture_output=True, text=True, check=False)
    allowed = ("--allow-run-as-root",) if "Open MPI" in about.stdout + about.stderr else ()
    before = (launcher, *allowed, "-n", "2", sys.executable, "-m", "mpi4py.futures")
    code, out, said = finish(start(script, tmp_path / "out", before=before))
    assert code == 0, said
    result = studies.Study.open(tmp_path / "out").collect()
    assert correct(result)
    pids = {status(tmp_path / "out" / "cases" / name)["pid"] for name in result["case"]}
    assert len(pids) == 1  # rank 0 is the study, rank 1 the worker
    assert f"pid {pids.pop()}" not in out


def test_submitit_on_this_machine(tmp_path):
    submitit = pytest.importorskip("submitit")
    executor = submitit.LocalExecutor(folder=tmp_path / "jobs")
    executor.update_parameters(timeout_min=1)
    began = time.monotonic()
    result = make(tmp_path / "out", ROWS[:2]).run(executor, device="cpu", progress=False)
    assert correct(result)
    assert time.monotonic() > began
    assert len(list((tmp_path / "jobs").glob("*_result.pkl"))) == 2
