"""Agreement between simulated and measured histories."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
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

_HOMES = {
    "ChannelAgreement": "sysid.validation.channel_agreement",
    "ObjectiveRating": "sysid.validation.objective_rating",
    "PeakError": "sysid.validation.metrics",
    "SpragueGeers": "sysid.validation.metrics",
    "Validation": "sysid.validation.channel_agreement",
    "ValidationLimits": "sysid.validation.channel_agreement",
    "dominant_frequency": "sysid.validation.metrics",
    "fit_percent": "sysid.validation.metrics",
    "nrmse": "sysid.validation.metrics",
    "objective_ratings": "sysid.validation.objective_rating",
    "peak_error": "sysid.validation.metrics",
    "sprague_geers": "sysid.validation.metrics",
    "validate": "sysid.validation.agreement",
}

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

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
