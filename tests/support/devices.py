"""The devices on which a test body runs."""

import pytest


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request):
    """Runs a test on the CPU and, where there is one, on a CUDA device."""
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
