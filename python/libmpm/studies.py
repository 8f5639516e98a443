"""Many simulations from one table of parameters, and tables to make them from."""

from libmpm._src.studies.study.case import Case
from libmpm._src.studies.study.parameter_samples import grid, latin_hypercube, sobol
from libmpm._src.studies.study.plan import Trunk
from libmpm._src.studies.study.progress import StudyState
from libmpm._src.studies.study.status import StudyStatus
from libmpm._src.studies.study.study import Study
from libmpm._src.studies.study.table import StudyResult, TrunkCost

__all__ = [
    "Case",
    "Study",
    "StudyResult",
    "StudyState",
    "StudyStatus",
    "Trunk",
    "TrunkCost",
    "grid",
    "latin_hypercube",
    "sobol",
]
