"""Readings of sensors beside simulated signals: offset and gain eliminated, standardised residuals.

For run r, channel c and sample n the residual is (simulated - measured) / sigma with simulated = offset + gain y(t_n).
Offset (flat prior) and gain (normal about 1) of every channel and run are eliminated analytically.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp

from sysid.vehicle_model.device_arrays import ChannelHistories, HostOrDevice, RunsByChannelsBySets


class Readings(NamedTuple):
    """Data and weights of R runs with C channels and T samples.

    - `value` (T, R, C): readings [SI];
    - `measured` (T, R, C): square root of the weight of every plain reading (0 where there is none);
    - `censored` (T, R, C): side of the range (+1, -1) where a reading is clipped;
    - `noise_sd` (R, C): residual scale [SI], infinite where a channel has no reading;
    - `tempering` (R, C): factor on the residuals;
    - `gain_sd` (C,): standard deviation of the sensors' gains.
    """

    value: HostOrDevice
    measured: HostOrDevice
    censored: HostOrDevice
    noise_sd: HostOrDevice
    tempering: HostOrDevice
    gain_sd: HostOrDevice


class SensorFit(NamedTuple):
    """Eliminated sensor constants (R, C, S): `offset` in SI and `gain`."""

    offset: HostOrDevice
    gain: HostOrDevice


def eliminate_sensors(readings: Readings, simulated: HostOrDevice) -> SensorFit:
    """Offset and gain of every channel and run that minimise its weighted squares plus the gain's prior.

    gain = (S_yd / sigma^2 + 1 / s_g^2) / (S_yy / sigma^2 + 1 / s_g^2), offset = mean(d) - gain mean(y), with S the
    centred sums over measured samples, each times its weight, and sigma the residual scale over the tempering.

    Parameters
    ----------
    readings : data and weights.
    simulated : (T, R, C, S) sensor signals.
    """
    # Operators only: on the host this runs in NumPy.
    share = (readings.measured**2)[..., None]
    count = share.sum(axis=0)
    count = count + (count == 0.0)
    mean_y = (share * simulated).sum(axis=0) / count
    mean_d = (share * readings.value[..., None]).sum(axis=0) / count
    centred_y = simulated - mean_y
    s_yy = (share * centred_y * centred_y).sum(axis=0)
    s_yd = (share * centred_y * readings.value[..., None]).sum(axis=0)
    weight = 1.0 / (readings.noise_sd / readings.tempering)[..., None] ** 2
    prior = 1.0 / readings.gain_sd[:, None] ** 2
    gain = (s_yd * weight + prior) / (s_yy * weight + prior)
    return SensorFit(mean_d - gain * mean_y, gain)


def standardised_residuals(
    readings: Readings, simulated: ChannelHistories
) -> tuple[ChannelHistories, RunsByChannelsBySets]:
    """Residuals (T, R, C, S) in units of their scale, and the gains' prior residuals (R, C, S).

    A clipped sample counts only where the simulation stays inside the range.

    Parameters
    ----------
    readings : data and weights.
    simulated : (T, R, C, S) sensor signals.
    """
    fit = eliminate_sensors(readings, simulated)
    difference = fit.offset + fit.gain * simulated - readings.value[..., None]
    side = readings.censored[..., None]
    outside = jnp.where(side * difference < 0.0, difference, 0.0) * jnp.abs(side)
    scale = (readings.tempering / readings.noise_sd)[..., None]
    residual = (readings.measured[..., None] * difference + outside) * scale
    spread = readings.gain_sd[:, None]
    prior = jnp.where(jnp.isfinite(readings.noise_sd)[..., None], (fit.gain - 1.0) / spread, 0.0)
    return jnp.asarray(residual), jnp.asarray(prior)
