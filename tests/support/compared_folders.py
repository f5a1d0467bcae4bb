"""Output folders of finished campaigns for comparisons, written without any calibration."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from small_results import Words, small_fit, small_results

from sysid.campaign.records import CampaignDetails
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.uncertainty.further_unknowns import FurtherUnknown, FurtherUnknowns
from sysid.export import write_result
from sysid.export.covariance_json import COVARIANCE_FILE, write_covariance
from sysid.results.contents import Judgement, Results

WORDS, NO_DETAILS = Words(), CampaignDetails()
#: Relative standard deviation that the common scale gives to all k and c, and that a parameter has beside it.
SCALE_SD, OWN_SD = 0.03, 0.005


def further(fit: FitResult, scale_sd: float = SCALE_SD) -> FurtherUnknowns:
    """A scale of which the data say nothing, that moves all parameters alike, and an unsprung mass of 500 kg."""
    unknowns = (
        FurtherUnknown("axle_load_scale_factor", None, False, None, 1.0, scale_sd),
        FurtherUnknown("unsprung_mass_factor", 0, False, None, 500.0, 0.08),
    )
    sensitivity = np.column_stack([np.full(len(fit.parameters), scale_sd), np.zeros(len(fit.parameters))])
    return FurtherUnknowns(unknowns, np.zeros(2), np.eye(2), sensitivity)


def scaled_fit(words: Words = WORDS, change: dict[str, float] | None = None, scale_sd: float = SCALE_SD) -> FitResult:
    """The small fit whose uncertainty is mostly the scale's; values times the factors `change` by name."""
    fit = small_fit(words)
    factors = [(change or {}).get(p.name, 1.0) for p in fit.parameters]
    parameters = tuple(replace(p, value=p.value * f) for p, f in zip(fit.parameters, factors, strict=True))
    covariance = scale_sd**2 + OWN_SD**2 * np.eye(len(parameters))
    fit = replace(fit, parameters=parameters, covariance=covariance)
    return replace(fit, further=further(fit, scale_sd))


def results(
    words: Words = WORDS,
    change: dict[str, float] | None = None,
    details: CampaignDetails = NO_DETAILS,
    scale_sd: float = SCALE_SD,
    seed: int = 0,
) -> Results:
    """Small results with such a fit, not sampled."""
    base = small_results(words)
    return replace(
        base,
        fit=scaled_fit(words, change, scale_sd),
        posterior=None,
        campaign=replace(base.campaign, details=details),
        judgement=Judgement("use", ("Nothing speaks against it.",), ("none",)),
        provenance={**base.provenance, "seed": seed},
    )


def write_folder(folder: Path, of: Results) -> Path:
    """What comparisons read of an output folder."""
    folder.mkdir(parents=True, exist_ok=True)
    write_result(of, folder / "result.json")
    assert write_covariance(of, folder / COVARIANCE_FILE)
    return folder
