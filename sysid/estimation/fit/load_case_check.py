"""Runs that another load case explains far better than the listed one: load cases exchanged in the list of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.arrays import Parameters, RunsByChannels
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit.start_search import Record
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs

#: The list is refused if the runs of every load case have less than this share of their misfit under another one
#: (geometric mean), and no run contradicts. With exchanged cases 0.7 to 0.85 was seen; with right lists 1.1 and more
#: for at least one case.
CLEARLY = 0.9
_SLACK_S = 0.3


def check_load_cases(
    campaign: Campaign,
    model: BumpModel,
    motion: RunMotion,
    log_parameters: Parameters,
    noise_sd: tuple[RunsByChannels, ...],
    prepared: Callable[[Campaign], BumpModel],
    fitted: Callable[[Campaign], np.ndarray],
) -> None:
    """Refuse a list of runs if another load case explains all of them better, at the start values and after a fit.

    Start values far from the truck's may suit the wrong list: both are fitted then, and what is left decides.

    Parameters
    ----------
    motion : speed and start of every run, as found under the listed load cases.
    prepared : the model of the campaign with another list of runs.
    fitted : misfits (runs,) after a fit of the campaign with another list of runs.

    Raises
    ------
    DataRejectedError
        If the runs of every load case have a clearly smaller misfit under another one.
    """
    of_run = [r.load_case for r in campaign.bump_runs]
    used = list(dict.fromkeys(of_run))
    if len(used) < 2:
        return
    listed = misfits(model, motion, log_parameters, noise_sd)
    under = {
        case: misfits(prepared(_all_in(campaign, case)), motion, log_parameters, noise_sd) / listed for case in used
    }
    fits_better: dict[str, str] = {}
    for case in used:
        runs = [i for i, name in enumerate(of_run) if name == case]
        for other in used:
            ratio = under[other][runs]
            if other != case and np.all(ratio < 1.0) and float(np.exp(np.mean(np.log(ratio)))) < CLEARLY:
                fits_better[case] = other
    if len(fits_better) < len(used):
        return
    exchanged = tuple(replace(r, load_case=fits_better[r.load_case]) for r in campaign.bump_runs)
    try:
        left = np.log(fitted(replace(campaign, bump_runs=exchanged)) / fitted(campaign))
    except DataRejectedError:
        # Nothing can be said of a list that cannot be fitted.
        return
    if any(np.mean(left[[name == case for name in of_run]]) > np.log(CLEARLY) for case in used):
        return
    pairs = ", ".join(f"those listed as '{case}' as '{other}'" for case, other in fits_better.items())
    raise DataRejectedError(
        f"The bump runs of every load case suit another one better, {pairs}: the load cases "
        "are probably exchanged in [tests], or their axle loads and masses in [load_case]."
    )


def _all_in(campaign: Campaign, load_case: str) -> Campaign:
    return replace(campaign, bump_runs=tuple(replace(r, load_case=load_case) for r in campaign.bump_runs))


def misfits(
    model: BumpModel, motion: RunMotion, log_parameters: Parameters, noise_sd: tuple[RunsByChannels, ...]
) -> np.ndarray:
    """Misfit of every run at its own speed and the best shift in time, as the search for starts counts it."""
    misfit = np.full(motion.speed_m_s.size, np.inf)
    signals = simulate_runs(model, log_parameters, motion)
    for position, group in enumerate(model.groups):
        reach = _SLACK_S / group.interval_s
        for r, run in enumerate(group.runs):
            simulated = np.nan_to_num(signals[position][:, r], nan=1e6, posinf=1e6, neginf=-1e6)
            misfit[run] = Record(group, r, noise_sd[position][r]).best_shift(simulated, (-reach, reach))[0]
    return misfit
