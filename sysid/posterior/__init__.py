"""Bayesian calibration: log-density, emcee ensembles, diagnostics and checkpoints."""

from sysid.posterior.log_density import LIKELIHOOD, LogDensity
from sysid.posterior.moves import LaplaceMove, posterior_moves
from sysid.posterior.sampled_posterior import Posterior, PosteriorSummary
from sysid.posterior.sampling import SamplingOptions, sample_posterior

__all__ = [
    "LIKELIHOOD",
    "LaplaceMove",
    "LogDensity",
    "Posterior",
    "PosteriorSummary",
    "SamplingOptions",
    "posterior_moves",
    "sample_posterior",
]
