"""Many simulations from one table of parameters, and tables to make them from."""

from libmpm._src.moved import renamed
from libmpm._src.studies.study.case import StudyCase
from libmpm._src.studies.study.parameter_samples import full_factorial, latin_hypercube, sobol
from libmpm._src.studies.study.plan import Trunk
from libmpm._src.studies.study.progress import StudyState
from libmpm._src.studies.study.status import StudyStatus
from libmpm._src.studies.study.study import Study
from libmpm._src.studies.study.table import StudyResult, TrunkCost

#: Names of version 0.1.
__getattr__ = renamed(__name__, {"Case": "StudyCase", "grid": "full_factorial"})

__all__ = [
    "Study",
    "StudyCase",
    "StudyResult",
    "StudyState",
    "StudyStatus",
    "Trunk",
    "TrunkCost",
    "full_factorial",
    "latin_hypercube",
    "sobol",
]
