"""Readings of sensors beside simulated signals: offset and gain eliminated, standardised residuals.

For run r, channel c and sample n the residual is (simulated - measured) / sigma with simulated = offset + gain y(t_n).
Offset (flat prior) and gain (normal about 1) of every channel and run are eliminated analytically.
"""

from __future__ import annotations

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

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


def residuals_of_trials(readings: Readings, simulated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (K, R, C, T) and the gains' prior residuals (K, R, C), as :func:`standardised_residuals`, by NumPy.

    For some models of the same runs it takes half of the time that XLA takes, and nothing is compiled: the samples of a
    channel lie next to each other, and every step overwrites the one before.

    Parameters
    ----------
    readings : data and weights.
    simulated : (T, R, K, C) sensor signals of K models.
    """
    value, measured, censored = (
        np.ascontiguousarray(np.moveaxis(np.asarray(x), 0, -1))
        for x in (readings.value, readings.measured, readings.censored)
    )
    noise_sd, gain_sd = np.asarray(readings.noise_sd), np.asarray(readings.gain_sd)
    scale, share, prior = np.asarray(readings.tempering) / noise_sd, measured**2, 1.0 / gain_sd**2
    count = share.sum(axis=-1)
    count += count == 0.0
    from_mean = value - (np.einsum("rct,rct->rc", share, value) / count)[..., None]
    samples, runs, models, channels = simulated.shape
    residual, gains = np.empty((models, runs, channels, samples)), np.empty((models, runs, channels))
    of_y = np.empty((channels, samples))
    # A run of a model at a time stays in the processor's cache.
    for k, r in np.ndindex(models, runs):
        y = residual[k, r]
        y[:] = simulated[:, r, k].T
        y -= (np.einsum("ct,ct->c", y, share[r]) / count[r])[:, None]
        np.multiply(y, share[r], out=of_y)
        s_yy, s_yd = np.einsum("ct,ct->c", of_y, y), np.einsum("ct,ct->c", of_y, value[r])
        gain = gains[k, r] = (s_yd * scale[r] ** 2 + prior) / (s_yy * scale[r] ** 2 + prior)
        y *= gain[:, None]
        y -= from_mean[r]
        outside = np.where(censored[r] * y < 0.0, y, 0.0) * np.abs(censored[r]) if censored[r].any() else 0.0
        y *= measured[r]
        y += outside
        y *= scale[r][:, None]
    return residual, np.where(np.isfinite(noise_sd), (gains - 1.0) / gain_sd, 0.0)
