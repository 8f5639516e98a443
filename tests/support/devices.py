"""The devices on which a test body runs."""

import os

import pytest


def need_device():
    """Skip the test where there is no CUDA device, or fail it where LIBMPM_REQUIRE_GPU=1."""
    from libmpm._src.run.backends import cuda_status

    if reason := cuda_status().reason:
        if os.environ.get("LIBMPM_REQUIRE_GPU") == "1":
            pytest.fail(f"LIBMPM_REQUIRE_GPU=1 and {reason}")
        pytest.skip(reason)


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request):
    """Runs a test on the CPU and, where there is one, on a CUDA device (`need_device`)."""
    if request.param == "cuda":
        need_device()
    return request.param


@pytest.fixture(params=["shared", "events", "flags"])
def pair(request, monkeypatch):
    """Two ranks: on one device, and on two in the ways in which they wait."""
    from libmpm._src.run.backends import cuda_status

    if request.param == "shared":
        return ["cuda:0", "cuda:0"]
    if len(cuda_status().devices) < 2:
        pytest.skip("needs two CUDA devices")
    monkeypatch.setenv("LIBMPM_RANK_WAIT", request.param)
    return ["cuda:0", "cuda:1"]
