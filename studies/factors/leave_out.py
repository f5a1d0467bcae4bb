"""One campaign by independent equations, fitted by the default path with one allowance of its intervals left out."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from scipy.stats import norm

from studies.coverage.shards import Record
from studies.independent.case import ROOT, draw
from sysid.campaign.quality.check import check_quality
from sysid.campaign.read import read_campaign
from sysid.campaign.records import Campaign
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.uncertainty.data_information import DataInformation
from sysid.road.point_cloud import read_point_cloud
from sysid.road.scan import analyse_scan
from sysid.runtime import forget_compiled

#: Seed of the campaigns.
SEED = 20261127
MASSES = {"unsprung_mass": 0.0, "pitch_inertia": 0.0, "cg_height": 0.0, "hitch_height": 0.0}
READINGS = {"axle_load": 0.0, "axle_load_scale": 0.0}
#: Every truck of the study has stops.
STOPS = "estimated_bump_stops"


def without_departures() -> AbstractContextManager[Any]:
    """Contact, tires and friction just as in the model."""
    from sysid.estimation.uncertainty import allowances, departures

    def none(roads: Any, *unused: Any) -> departures.Departures:
        return departures.Departures(roads, ())

    return _patches((allowances, "departures", none))


def without_correlation() -> AbstractContextManager[Any]:
    """Residuals as if each were independent of those before it."""
    from sysid.estimation.weights import reweighting

    def ones(problem: Any, linearisation: Any, model: Any) -> np.ndarray:
        return np.ones(linearisation.residual.shape[1:])

    return _patches((reweighting, "_inflation", ones))


@contextmanager
def _patches(*replaced: tuple[Any, str, Callable[..., Any]]) -> Iterator[None]:
    with patch.object(*replaced[0]), nullcontext() if len(replaced) == 1 else _patches(*replaced[1:]):
        yield


#: What is left out of the whole fit: tolerances of the campaign, and a change of the program.
REFITTED: dict[str, tuple[dict[str, float], Callable[[], AbstractContextManager[Any]]]] = {
    "nothing": ({}, nullcontext),
    "masses": (MASSES, nullcontext),
    "scale readings": (READINGS, nullcontext),
    "tires and friction": ({}, without_departures),
    "correlation of residuals": ({}, without_correlation),
}


def without_model_form(data: DataInformation) -> DataInformation:
    """No widening for other model error."""
    return replace(data, matrix=data.matrix * data.factor, factor=1.0, flattening=np.eye(data.prior.shape[0]))


#: What is left out of the covariance alone: the estimates stay.
FROM_COVARIANCE: dict[str, Callable[[DataInformation], DataInformation]] = {
    "other model error": without_model_form,
    "undecided laws": lambda data: data.with_laws(None),
}


def replicate(number: int, seed: int = SEED) -> Record:
    """Intervals of k and c (normal approximation) of one campaign for every factor left out, beside the truth."""
    vehicle, kind = draw(number)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        simulate = [sys.executable, "-m", "tests.support.independent_physics", "--vehicle", vehicle, "--physics", kind]
        simulate += ["--seed", str(1000 * seed + number), "--output", place]
        subprocess.run(simulate, cwd=ROOT, check=True, capture_output=True)
        truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
        campaign, _ = check_quality(read_campaign(folder, point_cloud_reader=read_point_cloud))
    record: Record = {"number": number, "vehicle": vehicle, "physics": kind, "linear": truth["linear"], "factors": {}}
    for name, (tolerances, change) in REFITTED.items():
        with change():
            fit = _fitted(campaign, tolerances)
        forget_compiled()
        assert fit.identifiability is not None
        data = fit.identifiability.information
        record["factors"][name] = _judged(fit, data, truth)
        if name == "nothing":
            for other, left in FROM_COVARIANCE.items():
                record["factors"][other] = _judged(fit, left(data), truth)
    return record


def _fitted(campaign: Campaign, tolerances: dict[str, float]) -> FitResult:
    vehicle = replace(campaign.vehicle, tolerances=replace(campaign.vehicle.tolerances, **tolerances))
    profiles = {name: analyse_scan(scan).profile for name, scan in campaign.scans.items()}
    return fit_with_laws(replace(campaign, vehicle=vehicle), None, profiles)[0]


def _judged(fit: FitResult, data: DataInformation, truth: dict[str, Any]) -> Record:
    """Entries of k and c, whether the fit converged, and laws beside stops."""
    sd = np.sqrt(np.diag(data.covariance()))
    entries = []
    for p, log_sd in zip(fit.parameters, sd, strict=True):
        if p.quantity not in ("stiffness", "damping") or p.axle is None:
            continue
        case = p.load_case or next(iter(truth["stiffness"]))
        true = (truth["stiffness"][case] if p.quantity == "stiffness" else truth["damping"])[p.axle]
        interval = [float(p.value * np.exp(z * log_sd)) for z in norm.ppf([0.05, 0.5, 0.95])]
        entries.append({"kind": p.quantity, "truth": true, "reported": interval})
    laws = sorted(set().union(*(law.split(" + ") for law in fit.laws)) - {"linear", STOPS})
    return {"converged": bool(fit.converged), "laws": laws, "entries": entries}
