"""Runs that another load case explains far better than the listed one: load cases exchanged in the list of runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations

import numpy as np

from sysid.arrays import Parameters, RunsByChannels
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit.start_search import Record
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs

#: The list is refused if, after a fit of both lists, the runs of both load cases have less than this share of their
#: misfit under the exchanged one (geometric mean).
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
    """Refuse a list of runs in which two load cases are exchanged.

    Where the exchanged list suits the start values better, both are fitted: these values may be far from the truck's.
    What is left decides.

    Parameters
    ----------
    motion : speed and start of every run, as found under the listed load cases.
    prepared : the model of the campaign with another list of runs.
    fitted : misfits (runs,) after a fit of the campaign with another list of runs.

    Raises
    ------
    DataRejectedError
        If the runs of both load cases have a clearly smaller misfit under the other one.
    """
    of_run = [r.load_case for r in campaign.bump_runs]
    used = list(dict.fromkeys(of_run))
    if len(used) < 2:
        return
    listed = misfits(model, motion, log_parameters, noise_sd)
    under = {
        case: misfits(prepared(_all_in(campaign, case)), motion, log_parameters, noise_sd) / listed for case in used
    }

    def at_the_start(pair: tuple[str, str]) -> float:
        exchanged = [under[other][i] for i, name in enumerate(of_run) if (other := _other(pair, name)) != name]
        return float(np.mean(np.log(exchanged)))

    pair = min(combinations(used, 2), key=at_the_start)
    if at_the_start(pair) >= 0.0:
        return
    exchanged = tuple(replace(r, load_case=_other(pair, r.load_case)) for r in campaign.bump_runs)
    try:
        left = np.log(fitted(replace(campaign, bump_runs=exchanged)) / fitted(campaign))
    except DataRejectedError:
        # Nothing can be said of a list that cannot be fitted.
        return
    if any(np.mean(left[[name == case for name in of_run]]) > np.log(CLEARLY) for case in pair):
        return
    pairs = ", ".join(f"those listed as '{case}' as '{_other(pair, case)}'" for case in pair)
    raise DataRejectedError(
        f"The bump runs of two load cases suit the other one better, {pairs}: the load cases are probably exchanged in "
        "[tests], or their axle loads and masses in [load_case]."
    )


def _other(pair: tuple[str, str], case: str) -> str:
    """The other one of a pair; a case that is not in it stays."""
    return pair[1 - pair.index(case)] if case in pair else case


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
