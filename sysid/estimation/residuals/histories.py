"""Measured against simulated histories of every run at given parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, RunsByChannels, SamplesByRunsByChannels
from sysid.campaign.records import Campaign
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import RunHistory
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.vehicle_model.readings import Readings, eliminate_sensors


class ShownSignals(NamedTuple):
    """Simulated signals (T, R, C) of a group with the sensors' `offset` and `gain` (R, C) applied, SI."""

    signals: SamplesByRunsByChannels
    offset: RunsByChannels
    gain: RunsByChannels


def shown_signals(
    model: BumpModel, weights: Weights, motion: RunMotion, log_parameters: Parameters
) -> tuple[ShownSignals, ...]:
    """Sensor signals of every group for a simulation at log parameters (p,) and the runs' own motions.

    Offset and gain of every channel are those that suit its record best under the weights of the fit.

    Parameters
    ----------
    model : that of a fit, or the same runs with other masses or moved along departures.
    weights, motion : of the fit.
    """
    signals = simulate_runs(model, log_parameters, motion)
    scales = zip(weights.noise_sd, weights.tempering, signals, strict=True)
    shown = []
    for position, (noise, temper, simulated) in enumerate(scales):
        of_means = _shown(weights.on(model.arrays, position).readings(noise, temper), simulated)
        # Sensors on one side show the roll too, which is taken from their readings.
        roll = model.groups[position].value - model.arrays[position].value
        shown.append(of_means._replace(signals=of_means.signals + roll))
    return tuple(shown)


def _shown(readings: Readings, simulated: np.ndarray) -> ShownSignals:
    fit = eliminate_sensors(readings, simulated[..., None])
    offset, gain = np.asarray(fit.offset)[..., 0], np.asarray(fit.gain)[..., 0]
    return ShownSignals(offset + gain * simulated, offset, gain)


def run_histories(
    campaign: Campaign,
    model: BumpModel,
    weights: Weights,
    motion: RunMotion,
    log_parameters: Parameters,
    instrument: tuple[RunsByChannels, ...],
    rolling: tuple[RunsByChannels, ...],
) -> tuple[RunHistory, ...]:
    """Histories of all runs in the order of the campaign, with eliminated sensor offset and gain applied.

    Parameters
    ----------
    model, weights, motion, log_parameters : of the fit.
    instrument, rolling : (R, C) noise per group [SI], of the instruments and of the truck that rolls towards the bump.
    """
    by_run = {}
    signals = shown_signals(model, weights, motion, log_parameters)
    for position, group in enumerate(model.groups):
        noise = weights.noise_sd[position]
        shown, offset, gain = signals[position]
        for r, run in enumerate(group.runs):
            record = campaign.bump_runs[run]
            length = min(group.samples, round(record.log.duration_s / group.interval_s) + 1)
            present = group.measured[:length, r] | (group.censored[:length, r] != 0)
            by_run[run] = RunHistory(
                file=record.log.file,
                case=record.case,
                load_case=record.load_case,
                speed_m_s=float(motion.speed_m_s[run]),
                speed_sd=float("nan"),
                speed_change=float(motion.speed_change[run]),
                start_s=float(motion.start_s[run]),
                columns=tuple(s.column for s in model.layout.sensors),
                kinds=tuple(s.kind for s in model.layout.sensors),
                si_units=tuple(s.si_unit for s in model.layout.sensors),
                axles=tuple(s.axle for s in model.layout.sensors),
                time_s=np.arange(length) * group.interval_s,
                measured=np.where(present, group.value[:length, r], np.nan).T,
                simulated=shown[:length, r].T,
                censored=group.censored[:length, r].T,
                noise_sd=noise[r],
                instrument_noise_sd=instrument[position][r],
                rolling_noise_sd=rolling[position][r],
                offset=offset[r],
                gain=gain[r],
            )
    return tuple(by_run[i] for i in sorted(by_run))
