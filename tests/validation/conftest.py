"""Devices, the full tier and the figures of the validation tests."""

import os
from pathlib import Path

import pytest

from support.devices import device  # noqa: F401


def pytest_addoption(parser):
    parser.addoption("--full", action="store_true", help="run the full validation tier (GPU)")


@pytest.fixture
def full(request):
    """Skips a test of the full tier unless asked for."""
    if not request.config.getoption("--full"):
        pytest.skip("the full tier runs with --full")


@pytest.fixture
def figure(request, tmp_path):
    """Draw with `_, axes = figure.new(...)`; saved under the test's name, even if it fails.

    The folder is LIBMPM_FIGURES, or pytest's temporary one.
    """
    folder = Path(os.environ.get("LIBMPM_FIGURES", tmp_path))
    folder.mkdir(parents=True, exist_ok=True)
    drawn = Figure()
    yield drawn
    if drawn.figure is not None:
        name = "".join(c if c.isalnum() or c in "-._" else "_" for c in request.node.name).strip(
            "_"
        )
        drawn.figure.savefig(folder / f"{name}.png", dpi=110)


class Figure:
    """One figure without a window."""

    def __init__(self):
        self.figure = None

    def new(self, rows=1, columns=1, **options):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure as Canvas

        self.figure = Canvas(figsize=(6 * columns, 4 * rows), layout="constrained")
        FigureCanvasAgg(self.figure)
        return self.figure, self.figure.subplots(rows, columns, **options)
