"""Start values of each run's speed and start: one bounded search that uses all axles at once.

Speed candidates within a few per cent of the nominal speed are simulated in one batch; a start offset only shifts the
simulated histories in time, so the best start of each candidate comes from cross-correlations over all channels.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from sysid.arrays import Channels, Parameters, RunsByChannels
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.run_data import RunGroup
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.threads import side_by_side

#: Half width of the search in speed, and its step.
SPEED_REACH = 0.06
SPEED_STEP = 0.005
#: Share of the simulated response's energy that a record must hold for a start to be considered: a run whose record
#: ends while the first axle is over the bump is found, one whose response is shifted out of the record is not.
SEEN_SHARE = 0.03
#: Values that no sensor of a vehicle shows, in SI units: a simulation beyond them has failed.
LARGEST = 1e5
#: Range of the factor on each channel's simulated response while a shift is judged.
GAIN_RANGE = (0.4, 2.5)

#: A run by the number of its group and its place in it.
InGroup: TypeAlias = tuple[int, int]


def search_motion(
    model: BumpModel, campaign: Campaign, log_parameters: Parameters, noise_sd: tuple[RunsByChannels, ...]
) -> RunMotion:
    """Speed, taken as constant, and start of every run that make simulated histories fit best at given parameters.

    For every run and speed candidate v the start t_0 minimises sum_c sum_n (d_c(n) - g_c y_c(n; v, t_0))^2 / s_c^2,
    where s_c is the noise plus a tenth of the channel's own RMS, and g_c the best factor between 0.4 and 2.5. With this
    s_c no single axle or sensor decides alone.

    Parameters
    ----------
    log_parameters : (p,) start values.
    noise_sd : (R, C) instrument noise per group [SI].

    Raises
    ------
    DataRejectedError
        If a simulated passage ends in impossible numbers.
    """
    count = len(campaign.bump_runs)
    speed, start = np.full(count, np.nan), np.full(count, np.nan)
    factors = 1.0 + np.arange(-SPEED_REACH, SPEED_REACH + 1e-9, SPEED_STEP)
    nominal = np.array([r.expected_speed_m_s for r in campaign.bump_runs])
    trial_start = 1.0 + 0.5 / nominal
    lowest = np.full(count, np.inf)
    records, reach = {}, {}
    for k, group in enumerate(model.groups):
        for r, run in enumerate(group.runs):
            records[k, r] = Record(group, r, noise_sd[k][r])
            # Axle 1 meets the bump inside its own record, whatever fits elsewhere.
            length = np.flatnonzero(group.measured[:, r].any(axis=1))[-1]
            trial = trial_start[run] / group.interval_s
            reach[k, r] = (-trial, length - trial)
    # One speed at a time: signals of all would be the largest memory of a fit.
    for factor in factors:
        signals = simulate_runs(model, log_parameters, RunMotion.steady(nominal * factor, trial_start))
        _check_finite(campaign, model, signals)
        for (k, r), (misfit, shift) in best_shifts(records, signals, reach).items():
            run = model.groups[k].runs[r]
            if misfit < lowest[run] or np.isnan(speed[run]):
                lowest[run], speed[run] = misfit, nominal[run] * factor
                start[run] = trial_start[run] + shift * model.groups[k].interval_s
    return RunMotion.steady(speed, start)


def _check_finite(campaign: Campaign, model: BumpModel, signals: Sequence[np.ndarray]) -> None:
    for position, group in enumerate(model.groups):
        for r, run in enumerate(group.runs):
            if not float(np.max(np.abs(signals[position][:, r]))) < LARGEST:
                listed = campaign.bump_runs[run]
                raise DataRejectedError(
                    f"{listed.log.file}: a vehicle as declared, driven over the scanned bump at "
                    f"{3.6 * listed.nominal_speed_m_s:.3g} km/h in load case '{listed.load_case}', moves beyond all "
                    "bounds. Check height and unit of the scan, tire stiffnesses, masses, speed, speed_held and load "
                    "case of this run, and the priors."
                )


class Record:
    """One run of a group, compared with simulations of it at any shift in time."""

    def __init__(self, group: RunGroup, r: int, noise: Channels):
        """`noise` (C,) of the instruments [SI], not finite for channels that do not count."""
        mask = group.measured[:, r].astype(float)
        counts = mask.sum(axis=0)
        rest = [np.median(group.value[mask[:, c] > 0, r, c]) if counts[c] else 0.0 for c in range(mask.shape[1])]
        data = mask * (group.value[:, r] - np.array(rest))
        self._square = (data**2).sum(axis=0)
        rms = np.sqrt(self._square / np.maximum(counts, 1.0))
        self._weight = np.where(np.isfinite(noise), 1.0 / (noise**2 + (0.1 * rms) ** 2 + 1e-300), 0.0)
        self._length = next_fast_len(2 * mask.shape[0], real=True)
        self._data, self._mask = (rfft(values, self._length, axis=0) for values in (data, mask))
        lags = np.arange(self._length)
        self._lags = np.where(lags > self._length // 2, lags - self._length, lags)

    def best_shift(self, simulated: np.ndarray, reach: tuple[float, float]) -> tuple[float, float]:
        """Smallest misfit over all time shifts within `reach` of a simulation (T, C), and that shift, in samples."""
        length = self._length
        cross = irfft(self._data * rfft(simulated, length, axis=0).conj(), length, axis=0)
        energy = irfft(self._mask * rfft(simulated**2, length, axis=0).conj(), length, axis=0)
        # Parameters may be far off at this stage: a response of the wrong size must not be taken for one at another
        # time.
        gain = np.clip(cross / np.maximum(energy, 1e-12 * energy.max(axis=0) + 1e-300), *GAIN_RANGE)
        cost = (gain**2 * energy - 2.0 * gain * cross + self._square) @ self._weight
        # A response that is shifted out of the record altogether contradicts nothing.
        inside = energy @ self._weight
        cost[inside < SEEN_SHARE * inside.max()] = np.inf
        cost[(self._lags < reach[0]) | (self._lags > reach[1])] = np.inf
        k = int(np.argmin(cost))
        around = cost[[k - 1, k, (k + 1) % length]]
        curvature = around[0] - 2.0 * around[1] + around[2] if np.isfinite(around).all() else 0.0
        fine = 0.5 * (around[0] - around[2]) / curvature if curvature > 0 else 0.0
        fine = float(np.clip(fine, -0.5, 0.5))
        # The parabola's own minimum: between samples, so that a speed is not judged by where its start happens to fall.
        smallest = float(cost[k]) - (0.25 * float(around[0] - around[2]) * fine if fine else 0.0)
        return smallest, float(self._lags[k]) + fine


def best_shifts(
    records: Mapping[InGroup, Record], signals: Sequence[np.ndarray], reach: Mapping[InGroup, tuple[float, float]]
) -> dict[InGroup, tuple[float, float]]:
    """Smallest misfit and its shift in samples of every record, from simulated signals (T, R, C) of the groups.

    Parameters
    ----------
    records, reach : by group and place in it; the shifts that are allowed.
    """

    def one(place: InGroup) -> tuple[float, float]:
        k, r = place
        return records[place].best_shift(signals[k][:, r], reach[place])

    return dict(zip(records, side_by_side(one, records), strict=True))
