"""The count of fused instances bites."""

import importlib.util
import json
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
SPEC = importlib.util.spec_from_file_location("count_kernels", TOOLS / "count_kernels.py")
count_kernels = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(count_kernels)

SYMBOLS = """
0000000000000000 W void mpm::fused_step<mpm::Water, 3, float>(mpm::View<float>)
0000000000000000 W void mpm::fused_step<mpm::Water, 3, float>(mpm::View<float>) [clone .avx2]
0000000000000000 t mpm::fused_step<mpm::Water, 3, float>(mpm::View<float>) [clone ._omp_fn.0]
0000000000000000 W void mpm::fused_step<mpm::Pack<float, 8>, 2, double>(mpm::View<double>)
0000000000000000 b guard variable for mpm::fused_step<mpm::Sand, 3, float>(int)::tmp
                 U void mpm::fused_step<mpm::Steel, 3, float>(mpm::View<float>)
0000000000000000 T mpm::gather<mpm::Water, 3>(int)
"""
FIGURE = {"limit": 128, "function": {"cpu": {"name": "fused_step"}}, "instances": {"cpu": 2}}


def test_instances_are_narrowed_by_their_arguments():
    found = count_kernels.instances(SYMBOLS, "fused_step", r"double>$")
    assert found == {"fused_step<mpm::Pack<float, 8>, 2, double>"}


def test_clones_and_data_are_not_instances():
    found = count_kernels.instances(SYMBOLS, r"fused_\w+")
    assert found == {
        "fused_step<mpm::Water, 3, float>",
        "fused_step<mpm::Pack<float, 8>, 2, double>",
    }


@pytest.mark.parametrize(
    ("number", "word"), [(0, "no instance"), (1, "figure says 2"), (3, "figure"), (129, "limit")]
)
def test_a_wrong_count_is_objected_to(number, word):
    assert word in count_kernels.objections({"cpu": number}, FIGURE)[0]


def test_the_right_count_passes():
    assert count_kernels.objections({"cpu": 2}, FIGURE) == []


def test_the_committed_figure_is_within_the_limit():
    figure = json.loads((TOOLS / "kernel_counts.json").read_text())
    assert figure["limit"] <= 128
    assert all(0 < number <= figure["limit"] for number in figure["instances"].values())
