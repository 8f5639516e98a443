"""Demand of debris fields on structures: from laws of a field to curves of exceedance.

The load of a field is that of an ordered one, C(c), times what disorder leaves of it, R(θ) and R(n)
(Bonus 2023, chapter 11). `expected_load` averages it, `exceedance` gives the probability or rate
of each load with a confidence band, `from_study` does so for results of a study. Needs the optional
packages of ``pip install libmpm[studies]``.
"""

from libmpm._src.studies.demand.curves import Exceedance, LoadAt, combine
from libmpm._src.studies.demand.exceedance import exceedance, from_study
from libmpm._src.studies.demand.expected import expected_load, rate_weighted_load
from libmpm._src.studies.demand.laws import Density, Discrete, Histogram, Law
from libmpm._src.studies.demand.ordered import OrderedLoad, Reduction, ordered_load

__all__ = [
    "Density",
    "Discrete",
    "Exceedance",
    "Histogram",
    "Law",
    "LoadAt",
    "OrderedLoad",
    "Reduction",
    "combine",
    "exceedance",
    "expected_load",
    "from_study",
    "ordered_load",
    "rate_weighted_load",
]
