"""Measured against simulated histories of every run at given parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.bump_model import eliminate_sensors
from sysid.estimation.objective import simulate_runs
from sysid.estimation.results import RunHistory

if TYPE_CHECKING:
    from sysid.estimation.problem import FitState


def run_histories(campaign: Campaign, state: FitState, instrument: tuple[np.ndarray, ...]) -> tuple[RunHistory, ...]:
    """Histories of all runs in the order of the campaign, with eliminated sensor offset and gain applied.

    Parameters
    ----------
    state : model, parameters, motions and weights of the fit.
    instrument : (R, C) instrument noise per group [SI].
    """
    model, found = state.model, {}
    signals = simulate_runs(model, state.log_parameters, state.motion)
    for position, group in enumerate(model.groups):
        arrays, runs = model.arrays[position], list(group.runs)
        noise = state.weights.noise_sd[position]
        simulated = jnp.asarray(signals[position])[..., None]
        fit = eliminate_sensors(arrays, noise / state.weights.tempering[position], simulated)
        offset, gain = np.asarray(fit.offset)[..., 0], np.asarray(fit.gain)[..., 0]
        shown = offset + gain * np.asarray(simulated)[..., 0]
        for r, run in enumerate(runs):
            record = campaign.bump_runs[run]
            length = min(group.samples, round(record.log.duration_s / group.interval_s) + 1)
            present = group.measured[:length, r] | (group.censored[:length, r] != 0)
            found[run] = RunHistory(
                file=record.log.file,
                case=record.case,
                load_case=record.load_case,
                speed_m_s=float(state.motion.speed_m_s[run]),
                speed_sd=float("nan"),
                start_s=float(state.motion.start_s[run]),
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
                offset=offset[r],
                gain=gain[r],
            )
    return tuple(found[i] for i in sorted(found))
