"""Rockers that nobody declared: do neighbouring axles behave as if something shared load between their springs?

A score test, as in :mod:`sysid.estimation.fit.law_screen`, needs no fit with a rocker.  With the share s of a rocker
between some axles, 0 at the optimum at hand, and everything that would move with it, z (parameters, declared masses and
tires within their tolerances, speeds and starts of the runs), one linear step from there gains

    2 (cost(0) - cost(s)) = u^2 / v,    u = g_s - H_sz (H_zz + P)^-1 g_z,    v = H_ss - H_sz (H_zz + P)^-1 H_zs,

at s = -u / v; g is the gradient, H the information of the data and P that of the priors.  The best candidate is then
fitted once, with the share free: what that gains, not the linear step, decides.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Equaliser, Vehicle
from sysid.estimation.fit.law_evidence import LawEvidence
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.optimum import Optimum, effective_residuals
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.thresholds import DECISIVE, MISFIT
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.parameters.rockers import LoadShare, share_from_fit, share_name
from sysid.estimation.parameters.suspension_elements import law_elements
from sysid.estimation.uncertainty.residual_columns import difference_columns
from sysid.progress import Progress
from sysid.road.road_profile import RoadProfile
from sysid.sdof.drop_results import DropSummary
from sysid.wording import joined_words

#: Axles further apart than this are not joined by a rocker: tandems and tridems stand 1.2 to 1.8 m apart (general
#: knowledge of trucks).
REACH_M = 2.0
#: Axles that one rocker may join.
SIZES = (2, 3)
#: Share at which the derivative is taken: large against rounding, small against what bends the simulation.
_STEP = 0.01
#: A rocker that shares less than this is not worth a sentence: rubber and brake reactions do as much (an assumption).
LEAST_SHARE = 0.15
#: At most so many rockers are looked for.
_MOST = 3


@dataclass(frozen=True)
class RockerScore:
    """What a rocker between `axles` (indices) would gain by one linear step, and the `share` of that step."""

    axles: tuple[int, ...]
    gain: float
    share: float


def candidates(vehicle: Vehicle) -> tuple[tuple[int, ...], ...]:
    """Pairs and triples of neighbouring axles of one body, at most 2 m apart, that no group and no rocker joins yet."""
    taken = {i for group in vehicle.groups for i in group.axles} | {i for r in vehicle.equalisers for i in r.axles}
    runs = [tuple(range(first, first + n)) for n in SIZES for first in range(len(vehicle.axles) - n + 1)]

    def possible(axles: tuple[int, ...]) -> bool:
        near = all(
            vehicle.axles[a].body == vehicle.axles[b].body and vehicle.axles[b].x_m - vehicle.axles[a].x_m <= REACH_M
            for a, b in pairwise(axles)
        )
        return near and taken.isdisjoint(axles)

    return tuple(axles for axles in runs if possible(axles))


def rocker_scores(campaign: Campaign, optimum: Optimum) -> tuple[RockerScore, ...]:
    """Score test of every candidate at the optimum of a fit without it, the largest gain first."""
    vehicle, problem = campaign.vehicle, optimum.problem
    chosen = candidates(vehicle)
    if not chosen:
        return ()
    trials = []
    for axles in chosen:
        joined_by = replace(vehicle, equalisers=(*vehicle.equalisers, Equaliser("", axles, _STEP)))
        trials.append((problem.model.with_vehicle(joined_by, campaign.load_cases), _STEP))
    columns = difference_columns(problem.model, problem.model, problem.weights, *problem.unpack(optimum.vector), trials)
    pull, information = LawEvidence(campaign, optimum).without_known(optimum, columns)
    v = np.diag(information)
    scores = [RockerScore(a, float(pull[k] ** 2 / v[k]), float(-pull[k] / v[k])) for k, a in enumerate(chosen)]
    return tuple(sorted(scores, key=lambda s: -s.gain))


def undeclared_rockers(
    campaign: Campaign,
    optimum: Optimum,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
) -> tuple[LoadShare, ...]:
    """Rockers that the residuals of a fit ask for and the campaign file does not declare, front to rear.

    Nothing is looked for where the residuals are hardly larger than the noise of the instruments.

    Parameters
    ----------
    optimum : of the laws that were chosen.
    drops, profiles, options, report : as :func:`sysid.estimation.fit.law_choice.fit_with_laws`.
    """
    shares: list[LoadShare] = []
    while optimum.misfit >= MISFIT and len(shares) < _MOST:
        decides = DECISIVE + float(np.log(effective_residuals(optimum)))
        promising = [s for s in rocker_scores(campaign, optimum) if s.share > 0.0 and s.gain > decides]
        if not promising:
            break
        report(f"a rocker between axles {joined_words([str(i + 1) for i in promising[0].axles])}", 0.98)
        name = f"rocker {len(shares) + 1}"
        joined_by = Equaliser(name, promising[0].axles)
        vehicle = replace(campaign.vehicle, equalisers=(*campaign.vehicle.equalisers, joined_by))
        with_rocker = replace(campaign, vehicle=vehicle)
        laws = _laws(optimum.problem.model.parameters, vehicle)
        parameters = campaign_parameters(with_rocker, drops, laws)
        # Under the same weights and maps, so that the costs can be compared.
        how = replace(options, weight_rounds=0, tolerance=max(options.tolerance, 1e-6))
        trial = optimise(with_rocker, parameters, profiles, how, report, near=optimum, keep_maps=True)
        at = parameters.names.index(share_name(name))
        jacobian = trial.problem.compressed(trial.vector).jacobian
        trial.problem.forget()
        sd = float(np.sqrt(np.linalg.inv(jacobian.T @ jacobian)[at, at]))
        share = share_from_fit(name, joined_by.axles, float(np.exp(trial.vector[at])), sd)
        if 2.0 * (optimum.minimum.cost - trial.minimum.cost) < decides or share.share < LEAST_SHARE:
            break
        shares.append(share)
        campaign, optimum = with_rocker, trial
    return tuple(sorted(shares, key=lambda s: s.axles))


def _laws(parameters: ParameterSet, vehicle: Vehicle) -> tuple[frozenset[str], ...]:
    """Elements of every axle's suspension law in a parameter set."""
    return tuple(
        law_elements(parameters.parameters[parameters.index("damping", i)].law) for i in range(len(vehicle.axles))
    )
