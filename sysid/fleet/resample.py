"""Samples one finished campaign once more, under what the other trucks say of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from sysid.errors import DataRejectedError
from sysid.fleet.draws import POPULATION_RECORD_FILE, RECORD_FILE, read_draws, record_digest, thinned, write_draws
from sysid.fleet.key import file_digests
from sysid.fleet.outcome import read_outcome
from sysid.fleet.population_prior import Fitted, PopulationPrior, exchange
from sysid.progress import Progress


def read_fitted(campaign: Path, output: Path, progress: Progress) -> Fitted:
    """The density that the campaign was sampled from; its fit is read back.

    Raises
    ------
    CampaignError, OutputError
        As those of :class:`sysid.workflow.Calibration`.
    DataRejectedError
        If there is no fit of this campaign by this program.
    """
    from sysid.estimation.fit.state import restored
    from sysid.posterior.log_density import LogDensity
    from sysid.workflow import Calibration, make_settings
    from sysid.workflow.settings import recall
    from sysid.workflow.stages.fit import FIT

    choices: dict[str, Any] = recall(output)
    calibration = Calibration(campaign, output, make_settings(**choices), progress, resume=True)
    if calibration.results().fit is None:
        raise DataRejectedError("The program has changed since the campaign was calibrated; run the fleet first.")
    # Read back, as the fit is known; without it the campaign has its rejected channels still.
    calibration.check()
    fitted = calibration.result(FIT)
    profiles = {name: analysis.profile for name, analysis in calibration.scan().items()}
    state = restored(calibration.campaign, profiles, fitted.point)
    return Fitted(LogDensity(state).with_larger_steps(), state.point.mode, state.point.covariance)


def sample_again(campaign: Path, output: Path, prior: PopulationPrior, progress: Progress) -> bool:
    """Draw from the posterior of a campaign under another prior, keep the draws, and say whether they converged.

    The fit is read back; previews get a full chain.  Draws that have not converged are not kept.

    Raises
    ------
    CampaignError, OutputError
        As those of :class:`sysid.workflow.Calibration`.
    DataRejectedError
        If the campaign has no draws, or it or the program has changed since they were made.
    """
    from sysid.posterior.log_density import LIKELIHOOD
    from sysid.posterior.options import SamplingOptions
    from sysid.posterior.sampling import sample_posterior
    from sysid.workflow.settings import recall
    from sysid.workflow.stages.posterior import log_draws

    record, digest, outcome = read_draws(output / RECORD_FILE), record_digest(output), read_outcome(output)
    if record is None or outcome is None:
        raise DataRejectedError("The campaign has no draws; run the fleet first.")
    if file_digests(campaign, outcome.inputs) != dict(outcome.inputs):
        raise DataRejectedError("The campaign has changed since it was calibrated; run the fleet first.")
    fitted, exchanged = read_fitted(campaign, output, progress), exchange(record, prior)
    density, centre, covariance = exchanged.sampled(fitted)
    posterior = sample_posterior(
        density,
        record.names,
        centre,
        covariance,
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
