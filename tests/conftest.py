"""Tests share the processors (`pytest -n auto`), and need a CUDA device where they say so."""

import os

import pytest

# Before the compiled module starts its threads; processes that tests start inherit it.
if workers := os.environ.get("PYTEST_XDIST_WORKER_COUNT"):
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // int(workers))))


def pytest_runtest_setup(item):
    """Skip what is marked `gpu` where there is no device, or fail it if LIBMPM_REQUIRE_GPU=1."""
    if not item.get_closest_marker("gpu"):
        return
    from libmpm._src.run.backends import cuda_status

    if reason := cuda_status().reason:
        if os.environ.get("LIBMPM_REQUIRE_GPU") == "1":
            pytest.fail(f"LIBMPM_REQUIRE_GPU=1 and {reason}")
        pytest.skip(reason)
