"""Tests that run side by side (`pytest -n auto`) share the processors."""

import os

# Before the compiled module starts its threads; processes that tests start inherit it.
if workers := os.environ.get("PYTEST_XDIST_WORKER_COUNT"):
    os.environ.setdefault("OMP_NUM_THREADS", str(max(1, (os.cpu_count() or 1) // int(workers))))
