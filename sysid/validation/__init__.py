"""Agreement between simulated and measured histories."""

from sysid.validation.agreement import validate
from sysid.validation.channel_agreement import ChannelAgreement, Validation, ValidationLimits
from sysid.validation.metrics import (
    PeakError,
    SpragueGeers,
    dominant_frequency,
    fit_percent,
    nrmse,
    peak_error,
    sprague_geers,
)
from sysid.validation.objective_rating import ObjectiveRating, objective_ratings

__all__ = [
    "ChannelAgreement",
    "ObjectiveRating",
    "PeakError",
    "SpragueGeers",
    "Validation",
    "ValidationLimits",
    "dominant_frequency",
    "fit_percent",
    "nrmse",
    "objective_ratings",
    "peak_error",
    "sprague_geers",
    "validate",
]
