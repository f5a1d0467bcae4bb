"""Which suspension laws the data support: linear ones against richer families, by an information criterion.

Two sets of laws are compared under the same weights and footprint maps, those of the richest one:

    gain = 2 (cost_poor - cost_rich) - (p_rich - p_poor) ln n

with cost half the sum of squares with priors, masses and tires allowed to be a little wrong
(:mod:`sysid.estimation.fit.law_evidence`), and n the number of residuals over their variance inflation.  This is the
difference of the Bayesian information criterion (G. Schwarz, Estimating the dimension of a model, Annals of Statistics
6 (1978), doi:10.1214/aos/1176344136) with an effective sample size; a gain above 10 counts as decisive (R. E. Kass and
A. E. Raftery, Bayes factors, JASA 90 (1995), doi:10.1080/01621459.1995.10476572).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.fit.contact_trials import contact_trials
from sysid.estimation.fit.evaluation import evaluate_optimum, parameter_sd
from sysid.estimation.fit.fit_result import FitResult, LawComparison, LawTrial
from sysid.estimation.fit.joint_optimum import joint_optimum
from sysid.estimation.fit.law_evidence import Judged, LawEvidence
from sysid.estimation.fit.law_families import FAMILIES, STOPS, Laws, richest_laws, without_family
from sysid.estimation.fit.law_screen import promising
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.likely_mistake import likely_mistake
from sysid.estimation.fit.optimum import Optimum, effective_residuals
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.rocker_search import undeclared_rockers
from sysid.estimation.fit.state import FitState
from sysid.estimation.fit.thresholds import DECISIVE, MISFIT
from sysid.estimation.parameters.campaign_parameters import campaign_parameters, declared_laws
from sysid.estimation.parameters.named_priors import check_named_priors
from sysid.estimation.parameters.suspension_elements import law_elements, law_name, quantities
from sysid.estimation.weights.reweighting import reweighted
from sysid.progress import Progress, unwatched
from sysid.road.road_profile import RoadProfile
from sysid.runtime import forget_compiled
from sysid.sdof.drop_results import DropSummary

#: How much clearer than decisive a test has to be for a fit without an element to be left out.
SURE = 5.0
#: Standard deviation over that of its prior from which on the stiffness of a stop is not known from the data.
IDLE_SHRINKAGE = 0.9
#: Travels that are estimated with undeclared stops, and by how much in the logarithm a second search begins nearer: two
#: and a half standard deviations of their prior, nearer than nearly all of them.
TRAVELS, NEARER = ("jounce_travel", "rebound_travel"), 0.3
#: Iterations after which the fit that trials are compared with ends: parameters that the data hardly see creep on for
#: long, and move the cost by far less than what decides.
BASE_ITERATIONS = 20
#: A fit of its own, one to judge residuals by, one that trials are compared with, or one under the weights and maps of
#: its neighbour.
How = Literal["final", "rough", "base", "trial", "rough trial"]


def fit_with_laws(
    campaign: Campaign,
    drops: DropSummary | None,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[FitResult, FitState]:
    """Least-squares calibration with declared suspension laws, or with the ones that the data support.

    Linear laws come first.  Where they leave residuals of :data:`MISFIT` times the instrument noise or more (or on
    request), axles without a declared law get the elements that promise a decisive gain by a test on the fit at hand
    (:mod:`sysid.estimation.fit.law_screen`); elements that the criterion does not miss are taken away again, one
    element of one kind of suspension at a time.  Where a test leaves no doubt that an element is needed, no fit without
    it is made.

    Parameters
    ----------
    campaign : screened campaign (quality check applied).
    drops, profiles : what the drops say, and the road profile of each bump.
    options, progress : settings, and a callback (message, fraction done).

    Raises
    ------
    CampaignError, DataRejectedError
        As :func:`sysid.estimation.fit.least_squares.fit_bump_runs`.
    """
    options = options or FitOptions()
    report = progress or unwatched
    declared = declared_laws(campaign)
    rich = richest_laws(campaign.vehicle.axles, declared)
    open_laws = rich != declared and options.laws != "declared"
    parameters = campaign_parameters(campaign, drops, declared)
    chosen = optimise(campaign, parameters, profiles, options, report, rough=open_laws)
    comparison = None
    if open_laws and (options.laws == "compare" or chosen.misfit >= MISFIT):

        def comparing(message: str, fraction: float) -> None:
            report(f"comparing suspension laws, {message}", fraction)

        def fitted(laws: Laws, near: Optimum, *, how: How = "final") -> Optimum:
            named, trial = campaign_parameters(campaign, drops, laws), how.endswith("trial")
            if named.names != near.problem.model.parameters.names:
                forget_compiled()
            # A trial keeps weights and maps of its neighbour, under which it is compared.
            tolerance = max(options.tolerance, 1e-3 if how == "rough trial" else 1e-6)
            under = replace(options, weight_rounds=0, tolerance=tolerance) if trial else options
            if how == "base":
                rounds, most = min(options.weight_rounds, 1), min(options.max_iterations, BASE_ITERATIONS)
                under = replace(options, weight_rounds=rounds, tolerance=tolerance, max_iterations=most)
            return optimise(
                campaign,
                named,
                profiles,
                under,
                comparing,
                near=near,
                keep_maps=trial,
                rough=how == "rough",
                larger_steps=how != "final",
            )

        chosen, comparison = _compare(campaign, declared, rich, chosen, fitted)
    elif open_laws:
        chosen = optimise(campaign, parameters, profiles, options, report, near=chosen)
    joint = joint_optimum(campaign, chosen, profiles, options, report)
    fit, state = evaluate_optimum(campaign, joint, options, report)
    rockers = undeclared_rockers(campaign, chosen, drops, profiles, options, report)
    mistake = None if rockers else likely_mistake(campaign, chosen)
    proposals = (*(r.proposal for r in rockers), *([mistake] if mistake else []))
    fit = replace(fit, undeclared_rockers=rockers, warnings=(*proposals, *fit.warnings))
    trials = contact_trials(campaign, chosen, profiles, options, report) if options.contact_spread else ()
    return replace(fit, law_comparison=comparison, contact_trials=trials), state


def laws_of_axles(vehicle: Vehicle, laws: Sequence[str]) -> Laws:
    """Law of every axle from the laws of a fit's suspensions, front to rear; a group of axles has one suspension."""
    owner = vehicle.suspension_axle
    law_of = dict(zip(sorted(set(owner)), laws, strict=True))
    return tuple(law_elements(law_of[i]) for i in owner)


def check_priors(campaign: Campaign) -> None:
    """Refuse priors of parameters that neither the declared laws nor the richest candidates have.

    Raises
    ------
    CampaignError
        As :func:`sysid.estimation.parameters.named_priors.check_named_priors`.
    """
    if not campaign.priors:
        return
    declared = declared_laws(campaign)
    rich = richest_laws(campaign.vehicle.axles, declared)
    sets = [campaign_parameters(campaign, None, laws) for laws in (declared, rich)]
    check_named_priors(campaign, [p for parameters in sets for p in parameters.parameters])


def _compare(
    campaign: Campaign,
    poor_laws: Laws,
    rich_laws: Laws,
    poor: Optimum,
    fitted: Callable[..., Optimum],
) -> tuple[Optimum, LawComparison]:
    """The preferred laws' optimum and all trials; every gain is over the laws of the campaign file."""
    rich_laws, rich = _enriched(campaign, poor_laws, rich_laws, poor, fitted)
    if rich is None:
        optimum = fitted(poor_laws, poor)
        cost, names = optimum.minimum.cost, _names(poor_laws)
        return optimum, LawComparison((LawTrial(names, optimum.problem.count, cost, optimum.misfit, 0.0),), names)
    data = LawEvidence(campaign, rich)
    # Under the weights and maps of the rich laws, as all trials.
    best_laws, best, size = rich_laws, data.judge(rich), effective_residuals(rich)
    # Where nobody doubts the result, what the poor laws cost need not be known to the last.
    sure = _sure(best, rich_laws, poor_laws, size)
    base = data.judge(fitted(poor_laws, rich, how="rough trial" if sure else "trial"))

    def gain_over(other: Judged, optimum: Judged) -> float:
        extra = optimum.count - other.count
        return float(2.0 * (other.evidence.cost - optimum.evidence.cost) - extra * np.log(size))

    trials = [LawTrial(_names(poor_laws), base.count, base.evidence.cost, poor.misfit, 0.0)]
    trials.append(_trial(rich_laws, best, gain_over(base, best)))
    for family in FAMILIES:
        without = without_family(campaign.vehicle.axles, best_laws, poor_laws, family)
        if without in (best_laws, poor_laws) or _sure(best, best_laws, without, size):
            continue
        candidate = data.judge(fitted(without, best.optimum, how="trial"))
        trials.append(_trial(without, candidate, gain_over(base, candidate)))
        if gain_over(candidate, best) < DECISIVE:
            best_laws, best = without, candidate
    acting = with_stops_that_act(best_laws, best.optimum)
    if acting != best_laws:
        best_laws, best = acting, data.judge(fitted(acting, best.optimum, how="trial"))
        trials.append(_trial(acting, best, gain_over(base, best)))
    chosen = best.optimum
    if gain_over(base, best) < DECISIVE:
        best_laws, chosen = poor_laws, fitted(poor_laws, poor)
    else:
        # Trials ran under the rich laws' weights and with larger steps; the result stands on its own.
        chosen = fitted(best_laws, chosen)
    return chosen, LawComparison(tuple(trials), _names(best_laws))


def with_stops_that_act(laws: Laws, optimum: Optimum) -> Laws:
    """The laws without stops, whose travels nobody declared, of axles that do not show them.

    An axle shows them where the data know their stiffness better than its prior does, and it is no softer than the
    spring: else a parameter is left open that slows every search, or the stop stands for something else.
    """
    if not any(STOPS in law for law in laws):
        return laws
    parameters, sd = optimum.problem.model.parameters, parameter_sd(optimum)
    kept = []
    for axle, law in enumerate(laws):
        owner = parameters.suspension_axle[axle] if parameters.suspension_axle else axle
        springs = [i for i, p in enumerate(parameters.parameters) if (p.quantity, p.axle) == ("stiffness", owner)]
        shown = False
        if STOPS in law:
            stop = parameters.index("stop_stiffness", axle)
            known = sd[stop] < IDLE_SHRINKAGE * parameters.parameters[stop].prior_sd
            shown = bool(known and optimum.vector[stop] > optimum.vector[springs].min())
        kept.append(law if shown else law - {STOPS})
    return tuple(kept)


def _with_nearer_stops(laws: Laws, optimum: Optimum, fitted: Callable[..., Optimum]) -> Optimum:
    """The better of an optimum and of a search that begins with the travels which it did not reach made shorter.

    A stop beyond what the runs reach has no effect, so that no search moves it; one inside is pushed out if it is none.
    """
    parameters, sd = optimum.problem.model.parameters, parameter_sd(optimum)
    unreached = [
        i for i, p in enumerate(parameters.parameters) if p.quantity in TRAVELS and sd[i] >= IDLE_SHRINKAGE * p.prior_sd
    ]
    if not unreached:
        return optimum
    vector = optimum.vector.copy()
    vector[unreached] -= NEARER
    again = fitted(laws, replace(optimum, vector=vector), how="rough")
    return again if again.misfit < optimum.misfit else optimum


def _enriched(
    campaign: Campaign, laws: Laws, rich_laws: Laws, optimum: Optimum, fitted: Callable[..., Optimum]
) -> tuple[Laws, Optimum | None]:
    """Laws with all elements that promise a decisive gain, and their optimum; None where none does.

    What is promised is judged anew at the optimum of the laws that promised most.
    """
    start = laws
    while True:
        added = promising(campaign, laws, rich_laws, optimum)
        if not added:
            break
        if any(STOPS in more for more in added):
            # Other elements imitate a stop that is not there yet, and then hide its travel from the search.
            added = tuple(more & {STOPS} for more in added)
        laws = tuple(law | more for law, more in zip(laws, added, strict=True))
        optimum = fitted(laws, optimum, how="rough")
        if any(STOPS in more for more in added):
            optimum = _with_nearer_stops(laws, optimum, fitted)
    return laws, (None if laws == start else fitted(laws, optimum, how="base"))


def _sure(judged: Judged, laws: Laws, without: Laws, size: float) -> bool:
    """Whether elements are needed beyond doubt, so that no fit without them has to be made.

    By Wald's test (A. Wald, Tests of statistical hypotheses concerning several parameters, Transactions of the American
    Mathematical Society 54 (1943), doi:10.1090/S0002-9947-1943-0012401-3) the sum of squares would rise by
    (v - n)' C^-1 (v - n), with the values v of their parameters, the values n that take them out, and the covariance C
    of v.  Far from the optimum the cost is no parabola: only :data:`SURE` times what decides is beyond doubt.
    """
    gone = [more - less for more, less in zip(laws, without, strict=True)]
    optimum = judged.optimum
    parameters = optimum.problem.model.parameters.parameters
    index, distance = [], []
    for position, p in enumerate(parameters):
        # A shared parameter goes with the last axle that has its element.
        elements = frozenset().union(*gone).difference(*without) if p.axle is None else gone[p.axle]
        for q in quantities(elements):
            if q.quantity == p.quantity and q.decides:
                value = float(np.exp(optimum.vector[position]))
                index.append(position)
                # Relative to the value, as the covariance of its logarithm is.
                distance.append(1.0 - q.neutral / value)
    if not index:
        return False
    covariance = judged.evidence.covariance[np.ix_(index, index)]
    rise = float(np.array(distance) @ np.linalg.solve(covariance, distance))
    return bool(rise > SURE * (DECISIVE + len(index) * np.log(size)))


def _names(laws: Laws) -> tuple[str, ...]:
    return tuple(law_name(law) for law in laws)


def _trial(laws: Laws, judged: Judged, gain: float) -> LawTrial:
    optimum, problem = judged.optimum, judged.optimum.problem
    weights = reweighted(problem, problem.linearise(optimum.vector))
    problem.forget()
    misfit = replace(optimum, problem=problem.with_weights(weights)).misfit
    return LawTrial(_names(laws), problem.count, judged.evidence.cost, misfit, gain)
