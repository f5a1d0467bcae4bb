"""Names for arrays of NumPy or JAX, each with its shape, and the module whose functions take them.

R runs, S parameter sets, na axles, C channels, T samples; every run is simulated with every set. Predicted passes are
along R too: they are the same to the model.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    import jax

#: Arrays of the host, or of JAX inside a function that it traces.
HostOrDevice: TypeAlias = "jax.Array | np.ndarray"

#: The same in the equations of the model: types are checked as if all arrays were JAX's.
Traceable: TypeAlias = "jax.Array | Any"

#: (R, S) one value for every run with every set.
RunsBySets: TypeAlias = Traceable
#: (R, na, S)
RunsByAxlesBySets: TypeAlias = Traceable
#: (R, C, S)
RunsByChannelsBySets: TypeAlias = Traceable
#: (T, R, na, S) unfiltered histories.
AxleHistories: TypeAlias = Traceable
#: (T, R, C, S) what the sensors show.
ChannelHistories: TypeAlias = Traceable
#: (p, S) one column for every parameter set.
ParametersBySets: TypeAlias = Traceable


def numpy_of(*arrays: HostOrDevice | float) -> Any:
    """The module `jax.numpy` where one of the arrays is JAX's, else `numpy`, by which nothing is compiled."""
    # No array is JAX's before JAX is loaded, which takes most of a second.
    loaded = sys.modules.get("jax")
    return loaded.numpy if loaded and any(isinstance(array, loaded.Array) for array in arrays) else np
