"""How well the model predicts runs that it has not been fitted to, one at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.left_out import driven_by, fit_without
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.run_history import RunHistory
from sysid.progress import Progress, unwatched
from sysid.validation.agreement import history_agreement
from sysid.validation.channel_agreement import ChannelAgreement, LeftOutRun


def leave_out(
    fit: FitResult,
    state: FitState,
    runs: Sequence[str],
    options: FitOptions,
    progress: Progress | None = None,
) -> Iterator[LeftOutRun]:
    """Fit the campaign without each of `runs` in turn and compare its prediction with the record.

    The global parameters do not see the run; its speed, its start and its sensors' offsets and gains are its own.

    Parameters
    ----------
    fit, state : results and state of the fit of all runs.
    runs : files of the runs (:func:`sysid.validation.chosen_runs.chosen_runs`).
    """
    report = progress or unwatched
    files = [r.log.file for r in state.campaign.bump_runs]
    sd = np.sqrt(np.diag(fit.covariance))
    for number, name in enumerate(runs):
        share = number / len(runs)

        def within(message: str, fraction: float, name: str = name, share: float = share) -> None:
            report(f"without {name}, {message}", share + fraction / len(runs))

        refit = fit_without(state, files.index(name), options, within)
        history = _in_the_same_noise(refit.history, fit)
        yield LeftOutRun(
            run=name,
            values=np.exp(refit.log_parameters),
            shift_sd=(refit.log_parameters - state.point.log_parameters) / sd,
            converged=refit.converged,
            speed_m_s=history.speed_m_s,
            start_s=history.start_s,
            channels=tuple(history_agreement(history, out_of_sample=True)),
        )


def by_another_truck(truck: FitState, fit: FitResult, recorded: FitState) -> tuple[ChannelAgreement, ...]:
    """Agreement of the runs of a campaign with the truck of another fit, which has not seen them.

    Runs in load cases that the other campaign does not know, or knows with other axle loads, are left out.

    Parameters
    ----------
    truck : the other fit, of the same vehicle.
    fit, recorded : results and state of the campaign that recorded the runs.
    """
    rows: list[ChannelAgreement] = []
    for number, run in enumerate(recorded.campaign.bump_runs):
        known = truck.campaign.load_cases.get(run.load_case)
        if known is not None and known.axle_loads_kg == recorded.campaign.load_cases[run.load_case].axle_loads_kg:
            history = _in_the_same_noise(driven_by(truck, recorded, number), fit)
            rows += history_agreement(history, out_of_sample=True)
    return tuple(rows)


def _in_the_same_noise(history: RunHistory, fit: FitResult) -> RunHistory:
    """The history with the noise that its run has in the fit of all runs, so that the two compare."""
    fitted = next(h for h in fit.histories if h.file == history.file)
    at = [fitted.columns.index(column) for column in history.columns]
    return replace(
        history, instrument_noise_sd=fitted.instrument_noise_sd[at], rolling_noise_sd=fitted.rolling_noise_sd[at]
    )
