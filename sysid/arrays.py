"""Names for arrays that stay on the host; the axes stand in the name, in their order.

They hold 64-bit floats unless a function says that it takes or gives truth values or whole numbers.  They are all NumPy
arrays: the names tell people and editors what a function takes, and where a shape follows a rule.  Arrays inside
those of the engines have names of their own (:mod:`sysid.vehicle_model.device_arrays`).
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

#: (na,) one value for every axle, front to rear.
Axles: TypeAlias = np.ndarray
#: (T,) one value for every sample.
Samples: TypeAlias = np.ndarray
#: (axles, T)
AxlesBySamples: TypeAlias = np.ndarray
#: (C, T) one row for every channel of a run.
ChannelsBySamples: TypeAlias = np.ndarray
#: (C,) one value for every channel.
Channels: TypeAlias = np.ndarray
#: (T, axles, S) histories of a pass with S parameter sets.
SamplesByAxlesBySets: TypeAlias = np.ndarray
#: (R,) one value for every run.
Runs: TypeAlias = np.ndarray
#: (R, na)
RunsByAxles: TypeAlias = np.ndarray
#: (R, C)
RunsByChannels: TypeAlias = np.ndarray
#: (T, R, C) what the sensors of a group of runs show.
SamplesByRunsByChannels: TypeAlias = np.ndarray

#: (p,) one value for every global parameter.
Parameters: TypeAlias = np.ndarray
#: (p, p)
ParametersByParameters: TypeAlias = np.ndarray
#: (n, p) one row for every draw.
DrawsByParameters: TypeAlias = np.ndarray
#: (m,) one value for every uncertain mass.
Masses: TypeAlias = np.ndarray
#: (p + 3 runs,) global parameters, then the motion of every run.
UnknownsOfFit: TypeAlias = np.ndarray
#: (m,) residuals of all runs in one vector.
Residuals: TypeAlias = np.ndarray
#: (m, p + 3 runs) their derivatives.
ResidualsByUnknowns: TypeAlias = np.ndarray

#: (E, steps, W) of every ensemble, step and walker.
EnsemblesByStepsByWalkers: TypeAlias = np.ndarray
#: (E, steps, W, p) draws of every ensemble, step and walker.
WalkerDraws: TypeAlias = np.ndarray
#: (E, W)
EnsemblesByWalkers: TypeAlias = np.ndarray

#: (n,) one value for every point of a scan.
Points: TypeAlias = np.ndarray
#: (n, 3) x, y and z of the points of a scan.
PointsByXyz: TypeAlias = np.ndarray
#: (n,) one value for every station along the road.
Stations: TypeAlias = np.ndarray

#: (T, axles)
SamplesByAxles: TypeAlias = np.ndarray
#: (axles, S) one value for every axle and parameter set of a pass.
AxlesBySets: TypeAlias = np.ndarray
#: (R, 3) one row of unknowns of its own for every run.
RunsByUnknowns: TypeAlias = np.ndarray
#: (R, n, n) one matrix of unknowns for every run.
RunsByUnknownsByUnknowns: TypeAlias = np.ndarray
#: (R, C, n) derivatives of what a group of runs has per channel, by n unknowns.
RunsByChannelsByUnknowns: TypeAlias = np.ndarray
#: (T, R, C, n) derivatives of what the sensors of a group of runs show, by n unknowns.
SamplesByRunsByChannelsByUnknowns: TypeAlias = np.ndarray
#: (n,) one value for every one of several unknowns, parameters or not.
Unknowns: TypeAlias = np.ndarray
#: (n, n)
UnknownsByUnknowns: TypeAlias = np.ndarray
#: (pairs, T) histories that are compared, one pair a row.
PairsBySamples: TypeAlias = np.ndarray
