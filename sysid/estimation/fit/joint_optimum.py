"""The joint optimum of parameters, masses and departures from the model, from the optimum of the parameters alone.

Masses and departures y have priors, and the data inform them.  Every round has three parts: a Gauss-Newton step of all
together (:mod:`sysid.estimation.uncertainty.joint_step`); vehicle and footprint maps made anew there; a search for the
parameters with this vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.reweighted_search import optimise_from
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.uncertainty.allowances import Allowances, campaign_allowances
from sysid.estimation.uncertainty.information import footprints_following, model_error, optimum_information
from sysid.estimation.uncertainty.joint_step import JointStep, joint_step
from sysid.progress import Progress
from sysid.road.road_profile import RoadProfile

#: Rounds end where no mass or departure moves further than this many of its standard deviations, or after so many.
NEAR_SD = 0.3
ROUNDS = 8
#: Beyond this many standard deviations the last of them has not settled.
SETTLED_SD = 1.0
#: Rounds in which residuals are weighted anew.  Later the weights stay: they can go back and forth with the optimum.
REWEIGHTED = 2
#: Shares of a step that are tried until one does not make the residuals larger than so many times what they were.
SHARES, WORSE = (1.0, 0.5, 0.25), 1.05
#: Before the last round searches need not be exact.
_ROUGH_TOLERANCE = 1e-5
_UNSETTLED = "masses and tires did not settle: another model may be needed"


def joint_optimum(
    campaign: Campaign,
    optimum: Optimum,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
) -> Optimum:
    """The joint optimum from the optimum of the parameters.

    Parameters
    ----------
    optimum : of the parameters, with masses and contact as declared; its steps may be larger than those of `options`.
    profiles, options, report : as :func:`sysid.estimation.fit.least_squares.optimise`.
    """
    rough = replace(options, weight_rounds=0, tolerance=max(options.tolerance, _ROUGH_TOLERANCE))
    reweighted, final = replace(rough, weight_rounds=min(options.weight_rounds, 1)), replace(options, weight_rounds=0)
    optimum = _with_frame_shapes(campaign, optimum, profiles, reweighted, report)
    before: JointStep | None = None
    for number in range(ROUNDS):
        report("masses and tires", 0.9)
        allowances = _allowances(campaign, optimum.problem.model)
        step = _step(campaign, optimum, allowances)
        if before is not None and step.takes_back(before):
            step = step.times(0.5)
        before = step
        near = number >= REWEIGHTED and step.largest < NEAR_SD
        last = near or number == ROUNDS - 1
        how = final if last else (reweighted if number < REWEIGHTED else rough)
        for share in SHARES:
            moved = _moved(campaign, optimum, step.times(share), profiles, how, report, larger_steps=not last)
            if moved.misfit <= WORSE * optimum.misfit:
                break
        else:
            # No step is an improvement: the search ends where it is, by exact steps.
            moved = _moved(campaign, optimum, step.times(0.0), profiles, final, report, larger_steps=False)
            return _unsettled(moved)
        optimum = moved
        if last:
            break
    return optimum if step.largest < SETTLED_SD else _unsettled(optimum)


def _with_frame_shapes(
    campaign: Campaign,
    optimum: Optimum,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
) -> Optimum:
    """The optimum of the parameters and of the shapes of frames that bend, all other masses as declared.

    Shapes may be far from the assumed ones: before they are known other masses would take up what is due to them.
    """
    for _ in range(ROUNDS):
        allowances = _allowances(campaign, optimum.problem.model)
        shapes = allowances.masses.frame_shapes
        if not shapes.any():
            break
        report("shapes of frames that bend", 0.9)
        step = _step(campaign, optimum, allowances, np.append(shapes, np.zeros(allowances.count - shapes.size, bool)))
        for share in SHARES:
            moved = _moved(campaign, optimum, step.times(share), profiles, options, report, larger_steps=True)
            if moved.misfit <= optimum.misfit:
                break
        else:
            break
        optimum = moved
        if step.largest < NEAR_SD:
            break
    return optimum


def _unsettled(optimum: Optimum) -> Optimum:
    minimum = optimum.minimum
    message = f"{minimum.message.removesuffix('.')}; {_UNSETTLED}."
    return replace(optimum, minimum=replace(minimum, converged=False, message=message))


def _allowances(campaign: Campaign, model: BumpModel) -> Allowances:
    return campaign_allowances(campaign, model.parameters, model.felt)


def _step(campaign: Campaign, optimum: Optimum, allowances: Allowances, alone: np.ndarray | None = None) -> JointStep:
    """The next step; only of the masses and departures that are `alone`, if given."""
    problem = optimum.problem
    amounts = np.zeros(allowances.count) if optimum.amounts is None else optimum.amounts
    data = optimum_information(campaign, problem, optimum.vector, allowances, optimum.amounts)
    rows, targets = problem.model.parameters.prior_rows()
    prior, pull = rows.T @ rows, rows.T @ (rows @ optimum.vector[: problem.count] - targets)
    following = footprints_following(problem, optimum.vector[: problem.count], allowances)
    if alone is not None:
        sd = np.append(allowances.masses.sd, np.zeros(alone.size - allowances.masses.sd.size)) * alone
        return joint_step(data.matrix, data.score, prior, pull, sd, amounts, following)
    return model_error(data, prior, pull, allowances, amounts, following).step


def _moved(
    campaign: Campaign,
    before: Optimum,
    step: JointStep,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    report: Progress,
    *,
    larger_steps: bool,
) -> Optimum:
    """The optimum of the parameters after a step, with masses, departures and footprint maps of there."""
    problem = before.problem
    old, (values, motion) = problem.model, problem.unpack(before.vector)
    values = values + step.parameters
    tires = map_tires(old.parameters, values) if old.felt.contact == "footprint" else old.tires
    model = bump_model(
        campaign, old.parameters, profiles, target_step_s=options.target_step_s, contact=old.felt.contact, tires=tires
    )
    allowances = _allowances(campaign, model)
    here = np.zeros(allowances.count) if before.amounts is None else before.amounts
    amounts = allowances.within_reach(here + step.amounts)
    model = allowances.moved(model, amounts)
    model = with_larger_steps(model, values, motion) if larger_steps else model
    after = optimise_from(campaign, model, motion, before.instrument, values, options, report, weights=problem.weights)
    # The cross-check starts from where the search for all began.
    first = after.problem.vector(before.first[: problem.count])
    iterations = before.minimum.iterations + after.minimum.iterations
    return replace(after, first=first, minimum=replace(after.minimum, iterations=iterations), amounts=amounts)
