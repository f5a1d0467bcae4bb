"""Heavy tails: readings that differ much from their neighbours get less weight, if residuals have such readings.

Residuals are compared with their surroundings: u_t = d_t / s_t, where d_t is the distance of r_t from the cubic through
its four neighbours, and s_t the usual size of such distances around t. So readings are not treated as bad where the
model is wrong for some time. If a Student t distribution of nu degrees of freedom explains u clearly better than a
normal one, by the criterion of Schwarz, readings get the weights of its maximum likelihood (K. L. Lange, R. J. A.
Little and J. M. G. Taylor, Robust statistical modeling using the t distribution, Journal of the American Statistical
Association 84 (1989), doi:10.2307/2290063),

    w_t = (nu + 1) / (nu + u_t^2),    information (nu + 1) / (nu + 3) of that of the weighted squares.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import correlate1d, label, maximum_filter1d, median_filter, uniform_filter1d
from scipy.special import gammaln, stdtrit

from sysid.arrays import Channels, Samples, SamplesByRunsByChannels
from sysid.threads import side_by_side

#: Degrees of freedom that are tried; above the last one tails cannot be told from normal ones.
DEGREES_OF_FREEDOM = (2.0, 3.0, 4.0, 6.0, 9.0)
#: Cubic interpolation between the two readings before and the two after.
_NEIGHBOURS = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
#: Gain in the criterion from which on tails count as heavy. Tails are always a little heavier, because surroundings are
#: estimates.
DECISIVE = 20.0
#: Readings that are the surroundings of one, and distances over their median from which on they do not raise its mean
#: further (assumptions).
_SURROUNDINGS, _CUT = 81, 4.0
#: Surroundings below this share of the record's root mean square are at rest.
_SHARE = 0.3
#: A weight is low below this; a bad reading spoils the comparison of two neighbours on either side,
#: and two that are near each other are still bad readings.
_LOW, _LONGEST = 0.5, 8
#: Readings from which tails can be told: ten in the outer 5 %.
_FEWEST = 200


class Tails(NamedTuple):
    """`degrees_of_freedom` (C,) of every channel, infinite for normal ones; `weight` (T, R, C) of every reading."""

    degrees_of_freedom: Channels
    weight: SamplesByRunsByChannels

    @property
    def information(self) -> Channels:
        """Share (C,) of the information of the weighted squares that the readings have."""
        nu = self.degrees_of_freedom
        return np.where(np.isfinite(nu), (np.where(np.isfinite(nu), nu, 1.0) + 1.0) / (nu + 3.0), 1.0)


def heavy_tails(
    measured: SamplesByRunsByChannels, residual: SamplesByRunsByChannels, reading: SamplesByRunsByChannels
) -> Tails:
    """Tails of every channel from its residuals in all runs.

    Parameters
    ----------
    measured : (T, R, C) bool; residual : (T, R, C) and the readings themselves, in one unit per channel.
    """
    nu, weight = np.full(measured.shape[2], np.inf), np.ones(measured.shape)
    runs = range(measured.shape[1])

    def of_channel(c: int) -> None:
        standing = [standing_out(measured[:, r, c], residual[:, r, c], reading[:, r, c]) for r in runs]
        u = np.concatenate([residuals[np.isfinite(residuals)] for residuals in standing])
        if u.size < _FEWEST or not np.any(u):
            return
        nu[c], scale = best_distribution(u)
        if np.isfinite(nu[c]):
            for r, residuals in enumerate(standing):
                t_weight = (nu[c] + 1.0) / (nu[c] + (np.nan_to_num(residuals) / scale) ** 2)
                weight[:, r, c] = np.where(np.isfinite(residuals) & ~_lasting(t_weight < _LOW), t_weight, 1.0)

    side_by_side(of_channel, range(measured.shape[2]))
    return Tails(nu, weight)


def _lasting(low: np.ndarray) -> np.ndarray:
    """Where (n,) low weights come in a longer row than by a bad reading and its neighbours."""
    row, _ = label(low)
    return np.asarray(low & (np.bincount(row)[row] > _LONGEST))


def standing_out(measured: Samples, residual: Samples, reading: Samples) -> Samples:
    """Difference of residuals (n,) from their neighbours, in standard deviations of their surroundings.

    NaN where this is not known: a neighbour is missing, or the surroundings move less than the channel's resolution or
    than a fraction of the whole record's motion.
    """
    known = np.convolve(measured, np.ones(5), mode="same") == 5.0
    if known.sum() < _SURROUNDINGS:
        return np.full(residual.shape, np.nan)
    departure = np.where(known, residual - correlate1d(residual, _NEIGHBOURS, mode="nearest"), 0.0)
    size = np.abs(departure)
    step = np.abs(np.diff(reading[measured]))
    resolution = float(step[step > 0.0].min(initial=np.inf)) if np.any(step > 0.0) else 0.0
    # Departure by rounding to the resolution alone: one reading and its four neighbours.
    rounding = resolution * np.sqrt((1.0 + np.sum(_NEIGHBOURS**2)) / 12.0)
    floor = max(_SHARE * np.sqrt(np.mean(departure[known] ** 2)), 0.9 * rounding)
    middle = np.maximum(median_filter(size, _SURROUNDINGS, mode="nearest"), 0.2 * np.median(size[known]))
    # The mean scatters less than the median, and without outliers it is as safe.
    inside = uniform_filter1d(known.astype(float), _SURROUNDINGS, mode="nearest")
    total = uniform_filter1d(np.where(known, np.minimum(size, _CUT * middle), 0.0), _SURROUNDINGS, mode="nearest")
    typical = total / np.maximum(inside, 1.0 / _SURROUNDINGS) * np.sqrt(np.pi / 2.0)
    # Where motion begins or ends, the surroundings are those on the side with more motion; the part at rest gives no
    # information.
    lively = maximum_filter1d(typical, _SURROUNDINGS, mode="nearest")
    judged = known & (lively > floor) & (typical > 0.5 * lively)
    typical = lively
    return np.where(judged, departure / np.where(judged, typical, 1.0), np.nan)


def best_distribution(standing: np.ndarray) -> tuple[float, float]:
    """Degrees of freedom and scale of the t distribution that explains values (n,) best; infinite for a normal one."""
    middle, sd = float(np.median(np.abs(standing))), float(standing.std())
    best = np.inf, sd
    if middle <= 0.0:
        return best
    count, square = standing.size, standing**2
    # Minus twice the log-likelihoods; SciPy's distributions take ten times as long for the same sums.
    least = float(square.sum()) / sd**2 + count * np.log(2.0 * np.pi * sd**2) - DECISIVE
    for nu in DEGREES_OF_FREEDOM:
        scale = middle / float(stdtrit(nu, 0.75))
        constant = gammaln(0.5 * (nu + 1.0)) - gammaln(0.5 * nu) - 0.5 * np.log(np.pi * nu * scale**2)
        criterion = (nu + 1.0) * float(np.log1p(square / (nu * scale**2)).sum()) - 2.0 * count * constant
        criterion += np.log(count)
        if criterion < least:
            best, least = (nu, scale), criterion
    return best
