"""Names for arrays inside compiled functions; each with its shape.

R runs, S parameter sets, na axles, C channels, T samples; every run is simulated with every set. Predicted passes are
along R too: they are the same to the model.
"""

from __future__ import annotations

from typing import TypeAlias

import jax
import numpy as np

#: Constants of the host that a compiled function takes: inside it they are JAX arrays.
HostOrDevice: TypeAlias = jax.Array | np.ndarray

#: (R, S) one value for every run with every set.
RunsBySets: TypeAlias = jax.Array
#: (R, na, S)
RunsByAxlesBySets: TypeAlias = jax.Array
#: (R, C, S)
RunsByChannelsBySets: TypeAlias = jax.Array
#: (T, R, na, S) unfiltered histories.
AxleHistories: TypeAlias = jax.Array
#: (T, R, C, S) what the sensors show.
ChannelHistories: TypeAlias = jax.Array
#: (p, S) one column for every parameter set.
ParametersBySets: TypeAlias = jax.Array
