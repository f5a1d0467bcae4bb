"""Names for arrays that the host or a device holds, each with its shape; and the NumPy for either.

R runs, S parameter sets, na axles, C channels, T samples; every run is simulated with every set. Predicted passes are
along R too: they are the same to the model.
"""

from __future__ import annotations

from types import ModuleType
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

#: Arrays of the host, or of JAX inside a function that it traces.
HostOrDevice: TypeAlias = jax.Array | np.ndarray

#: The same for equations of the model: whoever checks types sees the operations of JAX's arrays.
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
    """`jax.numpy` where one of the arrays is JAX's, else `numpy`: the same equations then run without compiling."""
    module: ModuleType = jnp if any(isinstance(array, jax.Array) for array in arrays) else np
    return module
