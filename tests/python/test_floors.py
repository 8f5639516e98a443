"""The include check objects to upward includes, and the tree has none."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TOOL = ROOT / "tools" / "check_floors.py"


def check(tree):
    return subprocess.run([sys.executable, TOOL, tree], capture_output=True, text=True)


def test_the_tree_keeps_to_its_floors():
    done = check(ROOT)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("path", "include", "reason"),
    [
        ("include/mpm/core/a.hpp", "<mpm/physics/b.hpp>", "core may not see physics"),
        ("include/mpm/physics/a.hpp", '"mpm/exec/b.hpp"', "physics may not see exec"),
        ("include/mpm/physics/material/a.hpp", '"../../exec/b.hpp"', "physics may not see exec"),
        ("include/mpm/exec/a.hpp", '"mpm/physics/b.hpp"', "exec may not see physics"),
        ("include/mpm/data/a.hpp", '"mpm/kernels/cpu/b.hpp"', "data may not see kernels"),
        ("include/mpm/io/a.hpp", '"mpm/kernels/b.hpp"', "io may not see kernels"),
        ("src/kernels/instantiate_cpu.cpp.in", '"mpm/solver/b.hpp"', "kernels may not see solver"),
        ("include/mpm/physics/a.hpp", "<cuda_runtime.h>", "physics knows no backend"),
        ("include/mpm/physics/a.hpp", "<cub/cub.cuh>", "physics knows no backend"),
        ("include/mpm/physics/a.hpp", "<thrust/sort.h>", "physics knows no backend"),
        ("include/mpm/physics/a.hpp", "<omp.h>", "physics knows no backend"),
        ("include/mpm/physics/a.hpp", "<pybind11/pybind11.h>", "pybind11 stays"),
        ("src/solver/a.cpp", "<pybind11/pybind11.h>", "pybind11 stays"),
        ("src/solver/a.cpp", '"mpm/elsewhere/b.hpp"', "solver may not see elsewhere"),
        ("include/mpm/elsewhere/a.hpp", "<vector>", "lies in no floor"),
    ],
)
def test_a_violation_is_found(tmp_path, path, include, reason):
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(f"#pragma once\n#include {include}\n")
    done = check(tmp_path)
    assert done.returncode == 1
    assert path in done.stderr and reason in done.stderr


@pytest.mark.parametrize(
    ("path", "include"),
    [
        ("include/mpm/physics/a.hpp", '"mpm/core/b.hpp"'),
        ("include/mpm/physics/material/a.hpp", '"../shape/b.hpp"'),
        ("include/mpm/kernels/cpu/a.hpp", '"mpm/physics/b.hpp"'),
        ("src/exec/cuda/a.cu", "<cuda_runtime.h>"),
        ("python/bindings/a.cpp", "<pybind11/pybind11.h>"),
    ],
)
def test_what_is_allowed_passes(tmp_path, path, include):
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(f"#include {include}\n")
    done = check(tmp_path)
    assert done.returncode == 0, done.stderr
