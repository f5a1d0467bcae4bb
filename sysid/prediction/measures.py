"""Numbers that sum up the axle loads of a pass."""

from __future__ import annotations

import numpy as np

from sysid.arrays import AxlesBySets, SamplesByAxles, SamplesByAxlesBySets
from sysid.prediction.quantiles import Quantiles
from sysid.threads import side_by_side


def quantiles(values: np.ndarray) -> Quantiles:
    """Quantiles over draws of values (..., axles, S); a single draw is a point estimate without a band."""
    if values.shape[-1] == 1:
        return Quantiles(None, values[..., 0], None)
    # Axle by axle: values are copied to be sorted.
    bands = side_by_side(lambda axle: _quantiles_of(values[..., axle, :]), range(values.shape[-2]))
    low, middle, high = np.stack(bands, axis=-1)
    return Quantiles(low, middle, high)


def _quantiles_of(values: np.ndarray) -> np.ndarray:
    """The three quantiles (3, ...), straight between values in order: sorting takes a quarter of `numpy.quantile`."""
    ordered = np.sort(values, axis=-1)
    place = (values.shape[-1] - 1) * np.array([0.05, 0.5, 0.95])
    before = place.astype(int)
    low, high = (ordered[..., at].astype(float) for at in (before, np.minimum(before + 1, values.shape[-1] - 1)))
    found = low + (place - before) * (high - low)
    found[np.isnan(ordered[..., -1])] = np.nan
    return np.moveaxis(found, -1, 0)


def load_coefficient(force_N: SamplesByAxlesBySets, static_N: AxlesBySets, passing: SamplesByAxles) -> AxlesBySets:
    """Dynamic load coefficient of each axle and draw: RMS of force less static load, over the static load (axles, S).

    Parameters
    ----------
    force_N : (T, axles, S) vertical tire forces [N].
    static_N : (axles, S) of every draw, or (axles, 1) of all [N].
    passing : (T, axles) bool, the samples that count.

    References
    ----------
    D. Cebon, Handbook of Vehicle-Road Interaction (1999), there over a stretch of road.
    """
    square = np.where(passing[..., None], (force_N / static_N - 1.0) ** 2, 0.0)
    return np.asarray(np.sqrt(square.sum(axis=0) / passing.sum(axis=0)[:, None]))


def lift_off_time(force_N: SamplesByAxlesBySets, interval_s: float) -> AxlesBySets:
    """Time off the ground of each axle and draw [s], (axles, S), of forces (T, axles, S)."""
    return np.asarray((force_N <= 0.0).sum(axis=0) * interval_s)


def extremes(
    tire_deflection_m: np.ndarray,
    extension_m: np.ndarray,
    tire_force_N: np.ndarray,
    interval_s: float,
) -> dict[str, np.ndarray]:
    """Largest values over a pass, axle by axle, by the names of :class:`sysid.prediction.trust.DrivenRange`.

    Parameters
    ----------
    tire_deflection_m, extension_m, tire_force_N : histories (T, axles, ...) [m, m, N], `interval_s` apart; of the
        deflection the largest alone will do.
    """
    return {
        "tire_deflection_m": tire_deflection_m.max(axis=0),
        "jounce_m": -extension_m.min(axis=0),
        "rebound_m": extension_m.max(axis=0),
        "damper_speed_m_s": np.abs(np.gradient(extension_m, interval_s, axis=0)).max(axis=0),
        "lift_off_s": lift_off_time(tire_force_N, interval_s),
    }


def impulse_ratio(force_N: SamplesByAxlesBySets, static_N: AxlesBySets) -> AxlesBySets:
    """Mean of the force over the pass over the static load, (axles, S): 1 where a pass leaves no momentum behind.

    `static_N` as for :func:`load_coefficient`.

    A truck that is at rest before and after has received the impulse weight times duration. Single wheels of a
    statically indeterminate truck depart from 1 while one of them stands higher than its neighbours.
    """
    return np.asarray(force_N.mean(axis=0) / static_N)
