"""Names for arrays of NumPy or JAX, each with its shape, and the module whose functions take them.

R runs, S parameter sets, na axles, C channels, T samples; every run is simulated with every set. Predicted passes are
along R too: they are the same to the model.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

#: Arrays of the host, or of JAX inside a function that it traces.
HostOrDevice: TypeAlias = jax.Array | np.ndarray

#: The same in the equations of the model: types are checked as if all arrays were JAX's.
Traceable: TypeAlias = jax.Array | Any

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
    return jnp if any(isinstance(array, jax.Array) for array in arrays) else np
