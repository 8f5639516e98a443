"""By how much samples of several ranks may differ from those of one."""

import numpy as np

#: Sensors of the engine that have the bits of one rank on any number of ranks.
EXACT = ("load-cell", "contact-load", "wave-gauge", "velocity-probe", "tracker")


def between_ranks(series, share=1e-10):
    """Return by how much: none at all, but for sums in the order of ranks.

    Energies and what is worked out from nodes are such sums: then it is a share of the largest.
    """
    if series.attributes["kind"] in EXACT:
        return 0.0
    return share * np.nanmax(np.abs(series.values), initial=0)
