"""Where helper leaves are tried: between what a spring is compressed by at rest in its lightest and heaviest load case.

Helper leaves beyond both act in neither, so that no derivative shows them and no search moves them. A stiffness that
stands for the spring with its helpers hides them in this way: a load moves it by less than where helpers usually begin.
"""

from __future__ import annotations

import numpy as np

from sysid.estimation.fit.optimum import Optimum

#: Name of the quantity in the laws.
HELPER_TRAVEL = "helper_travel"
#: Share of the compression by the largest load at which helper leaves are tried (an assumption).
_BETWEEN = 0.5


def compressions_by_load(optimum: Optimum) -> dict[int, float]:
    """Compression dL / k [m] of every spring by its heaviest load case beyond the first, where that is more than none.

    dL: load on the spring beyond that in the first load case [N]; k: its largest stiffness at the optimum [N/m].
    """
    model = optimum.problem.model
    stiffness = np.exp(optimum.vector)
    found: dict[int, float] = {}
    for arrays in model.arrays:
        laws = arrays.laws
        further = (laws.carried_load * (1.0 - 1.0 / laws.load_growth))[..., 0]
        compressed = (further / stiffness[laws.stiffness]).max(axis=0)
        for axle in np.flatnonzero(compressed > 0.0).tolist():
            found[axle] = max(found.get(axle, 0.0), float(compressed[axle]))
    return found


def tried_helper_travel(median_m: float, compression_m: float | None) -> float:
    """Travel [m] at which helper leaves are tried: the usual one, or half way to the heaviest load if that is less."""
    return median_m if compression_m is None else min(median_m, _BETWEEN * compression_m)
