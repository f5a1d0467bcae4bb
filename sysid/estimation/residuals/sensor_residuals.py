"""Standardised residuals of simulated signals, offset and gain of every sensor eliminated.

For run r, channel c and sample n the residual is (simulated - measured) / sigma with

    simulated = offset + gain * y(t_n),

y the model's signal through the acquisition's filter.  Offset (flat prior) and gain (normal about 1) of every channel
and run are eliminated analytically, so they never appear as parameters.  Clipped samples count only where the
simulation stays inside the range, missing ones not at all.
"""

from __future__ import annotations

import numpy as np

from sysid.estimation.residuals.bump_model import GroupArrays
from sysid.vehicle_model import readings
from sysid.vehicle_model.device_arrays import ChannelHistories, HostOrDevice, RunsByChannelsBySets
from sysid.vehicle_model.readings import SensorFit


def eliminate_sensors(arrays: GroupArrays, noise_sd: HostOrDevice, simulated: HostOrDevice) -> SensorFit:
    """Offset and gain of every channel and run, see :func:`sysid.vehicle_model.readings.eliminate_sensors`.

    Parameters
    ----------
    noise_sd : (R, C) residual scale sigma over tempering, infinite where a channel has no reading.
    simulated : (T, R, C, S).
    """
    return readings.eliminate_sensors(arrays.readings(noise_sd, np.ones(noise_sd.shape)), simulated)


def group_residuals(
    arrays: GroupArrays, noise_sd: HostOrDevice, tempering: HostOrDevice, simulated: ChannelHistories
) -> tuple[ChannelHistories, RunsByChannelsBySets]:
    """Standardised residuals (T, R, C, S) and the gains' prior residuals (R, C, S).

    Parameters
    ----------
    noise_sd : (R, C) residual scale in SI.
    tempering : (R, C) factor on the residuals, 1 / sqrt(variance inflation) where they are correlated.
    simulated : (T, R, C, S) sensor signals.
    """
    return readings.standardised_residuals(arrays.readings(noise_sd, tempering), simulated)
