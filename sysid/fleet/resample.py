"""Samples one finished campaign once more, under what the other trucks say of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.errors import DataRejectedError
from sysid.fleet.draws import POPULATION_RECORD_FILE, RECORD_FILE, read_draws, record_digest, thinned, write_draws
from sysid.fleet.population_prior import PopulationPrior, exchange
from sysid.progress import Progress


@dataclass(frozen=True)
class Fitted:
    """The log-density of a calibrated campaign, (n, p) -> (n,), and its optimum (p,) and covariance (p, p)."""

    density: Callable[[np.ndarray], np.ndarray]
    centre: np.ndarray
    covariance: np.ndarray


def read_fitted(campaign: Path, output: Path, progress: Progress) -> Fitted:
    """The density that the campaign was sampled from; its fit is read back.

    Raises
    ------
    CampaignError, OutputError
        As those of :class:`sysid.workflow.Calibration`.
    """
    from sysid.estimation.fit.state import restored
    from sysid.posterior.log_density import LogDensity
    from sysid.workflow import Calibration, make_settings
    from sysid.workflow.settings import recall
    from sysid.workflow.stages.fit import FIT

    choices: dict[str, Any] = recall(output)
    calibration = Calibration(campaign, output, make_settings(**choices), progress, resume=True)
    calibration.check()
    kept = calibration.result(FIT)
    profiles = {name: analysis.profile for name, analysis in calibration.scan().items()}
    state = restored(calibration.campaign, profiles, kept.point)
    return Fitted(LogDensity(state).with_larger_steps(), state.point.log_parameters, kept.fit.covariance)


def sample_again(campaign: Path, output: Path, prior: PopulationPrior, progress: Progress) -> bool:
    """Draw from the posterior of a campaign under another prior, keep the draws, and say whether they converged.

    The fit is read back; previews get a full chain.  Draws that have not converged are not kept.

    Raises
    ------
    CampaignError, OutputError
        As those of :class:`sysid.workflow.Calibration`.
    DataRejectedError
        If the campaign has no draws.
    """
    from sysid.posterior.log_density import LIKELIHOOD
    from sysid.posterior.sampling import SamplingOptions, sample_posterior
    from sysid.workflow.settings import recall
    from sysid.workflow.stages.posterior import log_draws

    record, digest = read_draws(output / RECORD_FILE), record_digest(output)
    if record is None:
        raise DataRejectedError("The campaign has no draws; run the fleet first.")
    fitted, exchanged = read_fitted(campaign, output, progress), exchange(record, prior)
    posterior = sample_posterior(
        exchanged.density(fitted.density),
        record.names,
        *exchanged.gaussian(fitted.centre, fitted.covariance),
        LIKELIHOOD,
        replace(SamplingOptions(), seed=recall(output).get("seed", 0)),
        progress=progress,
    )
    if not posterior.converged:
        return False
    mean, covariance = exchanged.gaussian(record.prior_mean, record.prior_covariance)
    drawn = replace(record, draws=thinned(log_draws(posterior)), prior_mean=mean, prior_covariance=covariance)
    write_draws(output / POPULATION_RECORD_FILE, drawn, digest)
    return True
