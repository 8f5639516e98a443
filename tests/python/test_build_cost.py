"""tools/build_cost.py: what a build has cost."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

TOOL = Path(__file__).parents[2] / "tools" / "build_cost.py"
LOG = """# ninja log v6
0\t4000\t1\tsrc/CMakeFiles/mpm_cpu.dir/solver/cpu/single.cpp.o\ta
1000\t7000\t1\tsrc/CMakeFiles/mpm_cuda.dir/__/generated/instantiate_cuda_tait_fluid.cu.o\tb
4000\t9000\t1\ttests/cpp/CMakeFiles/test_solver_engine.dir/solver/engine.cpp.o\tc
4000\t6000\t1\tsrc/CMakeFiles/mpm_cpu.dir/Unity/unity_solver_triangular_cxx.cxx.o\te
9000\t9500\t1\tpython/libmpm/_core.so\td
"""


def report(build: Path, *options: str) -> dict:
    """Return the line that the tool appends."""
    line = build / "line.jsonl"
    command = [sys.executable, TOOL, "report", build, "--jsonl", line, *options]
    subprocess.run(command, check=True, capture_output=True)
    return json.loads(line.read_text().splitlines()[-1])


def test_groups_of_units(tmp_path: Path) -> None:
    """Wall times by group; of a unit that was launched, the processor time."""
    (tmp_path / ".ninja_log").write_text(LOG)
    row = report(tmp_path, "--note", "shared")
    assert row["time"] == "wall"
    assert row["groups"] == {
        "tests": 5,
        "materials, cuda": 6,
        "domain, cpu": 4,
        "triangular": 2,
    }
    assert (row["units_s"], row["without_tests_s"], row["wall_s"]) == (17, 12, 10)
    assert row["note"] == "shared"


@pytest.mark.parametrize("status", [0, 3])
def test_launcher(tmp_path: Path, status: int) -> None:
    """The launcher passes on the status and writes down what took processor time."""
    (tmp_path / ".ninja_log").write_text(LOG)
    unit = "src/CMakeFiles/mpm_cpu.dir/kernels/cpu/phases.cpp.o"
    busy = f"import time\nwhile time.process_time() < 0.2: pass\nraise SystemExit({status})"
    command = [sys.executable, TOOL, "launch", sys.executable, "-c", busy, "-o", unit]
    assert subprocess.run(command, cwd=tmp_path, env=os.environ).returncode == status
    if status:
        assert not (tmp_path / "unit_costs.jsonl").exists()
        return
    (costs,) = map(json.loads, (tmp_path / "unit_costs.jsonl").read_text().splitlines())
    assert costs["unit"] == unit
    assert costs["processor_s"] >= 0.2
    row = report(tmp_path)
    assert row["time"] == "processor"
    assert list(row["groups"]) == ["phases, cpu"]
