"""From sensor series to responses, and statistics of responses."""

from libmpm._src.studies.analysis.peaks import Peak
from libmpm._src.studies.analysis.regression import Prediction, Regression, regression
from libmpm._src.studies.analysis.residuals import (
    HypothesisTest,
    ResidualTests,
    WhiteTest,
    white_test,
)
from libmpm._src.studies.analysis.signal import Signal, responses
from libmpm._src.studies.analysis.statistics import (
    BoxPlot,
    Correlation,
    Parity,
    box_plot,
    correlation,
    parity,
)

__all__ = [
    "BoxPlot",
    "Correlation",
    "HypothesisTest",
    "Parity",
    "Peak",
    "Prediction",
    "Regression",
    "ResidualTests",
    "Signal",
    "WhiteTest",
    "box_plot",
    "correlation",
    "parity",
    "regression",
    "responses",
    "white_test",
]
