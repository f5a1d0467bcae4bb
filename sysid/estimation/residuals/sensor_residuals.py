"""Standardised residuals of simulated signals, offset and gain of every sensor eliminated.

For run r, channel c and sample n the residual is (simulated - measured) / sigma with

    simulated = offset + gain * y(t_n),

y the model's signal through the acquisition's filter.  Offset (flat prior) and gain (normal about 1) of every channel
and run are eliminated analytically, so they never appear as parameters.  Clipped samples count only where the
simulation stays inside the range, missing ones not at all.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp

from sysid.estimation.residuals.bump_model import GroupArrays


class SensorFit(NamedTuple):
    """Eliminated sensor constants (R, C, S): `offset` in SI and `gain`."""

    offset: jax.Array
    gain: jax.Array


def eliminate_sensors(arrays: GroupArrays, noise_sd: jax.Array, simulated: jax.Array) -> SensorFit:
    """Offset and gain of every channel and run that minimise its weighted squares plus the gain's prior.

    gain = (S_yd / sigma^2 + 1 / s_g^2) / (S_yy / sigma^2 + 1 / s_g^2), offset = mean(d) - gain mean(y), with S the
    centred sums over measured samples, each times its weight.

    Parameters
    ----------
    noise_sd : (R, C) residual scale sigma over tempering, infinite where a channel has no reading.
    simulated : (T, R, C, S).
    """
    share = (arrays.measured**2)[..., None]
    count = share.sum(axis=0)
    count = jnp.where(count > 0.0, count, 1.0)
    mean_y = (share * simulated).sum(axis=0) / count
    mean_d = (share * arrays.value[..., None]).sum(axis=0) / count
    centred_y = simulated - mean_y
    s_yy = (share * centred_y * centred_y).sum(axis=0)
    s_yd = (share * centred_y * arrays.value[..., None]).sum(axis=0)
    weight = 1.0 / noise_sd[..., None] ** 2
    prior = 1.0 / arrays.gain_sd[:, None] ** 2
    gain = (s_yd * weight + prior) / (s_yy * weight + prior)
    return SensorFit(mean_d - gain * mean_y, gain)


def group_residuals(
    arrays: GroupArrays, noise_sd: jax.Array, tempering: jax.Array, simulated: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Standardised residuals (T, R, C, S) and the gains' prior residuals (R, C, S).

    Parameters
    ----------
    noise_sd : (R, C) residual scale in SI.
    tempering : (R, C) factor on the residuals, 1 / sqrt(variance inflation) where they are correlated.
    simulated : (T, R, C, S) sensor signals.
    """
    fit = eliminate_sensors(arrays, noise_sd / tempering, simulated)
    difference = fit.offset + fit.gain * simulated - arrays.value[..., None]
    side = arrays.censored[..., None]
    outside = jnp.where(side * difference < 0.0, difference, 0.0) * jnp.abs(side)
    residual = (arrays.measured[..., None] * difference + outside) * (tempering / noise_sd)[..., None]
    prior = jnp.where(jnp.isfinite(noise_sd)[..., None], (fit.gain - 1.0) / arrays.gain_sd[:, None], 0.0)
    return jnp.asarray(residual), jnp.asarray(prior)
