"""The devices on which a test body runs."""

import os

import pytest


@pytest.fixture(params=["cpu", pytest.param("cuda", marks=pytest.mark.gpu)])
def device(request):
    """Runs a test on the CPU and, where there is one, on a CUDA device.

    Without one the second half is skipped, or fails where LIBMPM_REQUIRE_GPU=1.
    """
    if request.param == "cuda":
        from libmpm._src.backends import cuda_status

        if reason := cuda_status().reason:
            if os.environ.get("LIBMPM_REQUIRE_GPU") == "1":
                pytest.fail(f"LIBMPM_REQUIRE_GPU=1 and {reason}")
            pytest.skip(reason)
    return request.param
