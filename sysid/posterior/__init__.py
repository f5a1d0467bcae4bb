"""Bayesian calibration: log-density, emcee ensembles, diagnostics and checkpoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.posterior.log_density import LIKELIHOOD, LogDensity
    from sysid.posterior.moves import LaplaceMove, posterior_moves
    from sysid.posterior.options import SamplingOptions
    from sysid.posterior.sampled_posterior import Posterior, PosteriorSummary
    from sysid.posterior.sampling import sample_posterior

_HOMES = {
    "LIKELIHOOD": "sysid.posterior.log_density",
    "LaplaceMove": "sysid.posterior.moves",
    "LogDensity": "sysid.posterior.log_density",
    "Posterior": "sysid.posterior.sampled_posterior",
    "PosteriorSummary": "sysid.posterior.sampled_posterior",
    "SamplingOptions": "sysid.posterior.options",
    "posterior_moves": "sysid.posterior.moves",
    "sample_posterior": "sysid.posterior.sampling",
}

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

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
