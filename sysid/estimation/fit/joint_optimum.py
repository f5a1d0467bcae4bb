"""The joint optimum of parameters, masses, departures and clocks, from the optimum of the parameters alone.

Masses and departures y have priors, and the data inform them. The same is true of the clocks of further loggers. Every
round has three parts:

1. a Gauss-Newton step of all unknowns together (:mod:`sysid.estimation.uncertainty.joint_step`);
2. vehicle and footprint maps made again at the new values, and records put on the moved clocks;
3. a search for the parameters with these.

Before the first round, and before the first one in which the weights stay, travels of stops that no run reaches are
scanned (:mod:`sysid.estimation.fit.travel_scan`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sysid.arrays import Parameters, ParametersByParameters
from sysid.campaign.clocks.moved import on_moved_clocks
from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions, Phase
from sysid.estimation.fit.reweighted_search import continued, optimise_from
from sysid.estimation.fit.travel_scan import with_touched_stops
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.residuals.bump_model import BumpModel, bump_model
from sysid.estimation.residuals.run_clocks import moved_clocks
from sysid.estimation.residuals.run_paths import with_run_paths
from sysid.estimation.uncertainty.allowances import Allowances, campaign_allowances
from sysid.estimation.uncertainty.information import (
    BlockInformation,
    footprints_following,
    model_error,
    optimum_information,
)
from sysid.estimation.uncertainty.joint_step import JointStep, joint_step
from sysid.progress import Progress
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.road.road_profile import RoadProfile

#: Rounds end when no mass, departure or clock moves further than this many of its standard deviations, or after this
#: number of rounds.
NEAR_SD = 0.1
ROUNDS = 12
#: The same for a preview, where only the first round weighs residuals again, and travels of stops are scanned once.
PREVIEW_NEAR_SD, PREVIEW_ROUNDS = 0.3, 3
#: Beyond this many standard deviations, the last round has not settled.
SETTLED_SD = 1.0
#: Rounds in which residuals get new weights. Later the weights stay, because they can go back and forth with the
#: optimum; a stop that the runs turn out to touch only then asks for them once more.
REWEIGHTED = 2
#: Fractions of a step that are tried until one does not make the residuals larger than this many times their size
#: before.
SHARES, WORSE = (1.0, 0.5, 0.25), 1.05
#: A cost that grows by no more than this is not larger: where the model fits perfectly, ratios of costs are rounding.
_SAME_COST = 1.0
#: The last search goes on so many times longer: what still falls by parts in a hundred thousand is not at its end.
_LONGER = 5
#: Before the last round searches need not be exact.
_ROUGH_TOLERANCE = 1e-5
_UNSETTLED = "masses and tires did not settle: another model may be needed"


@dataclass(frozen=True)
class _Step:
    """A step of parameters, masses and departures, and that of the clocks (n, l, 2) [prior sd], None without any.

    `largest` of all but the parameters, in standard deviations.
    """

    joint: JointStep
    clocks: np.ndarray | None
    largest: float

    def times(self, share: float) -> _Step:
        """A share of the step."""
        clocks = None if self.clocks is None else share * self.clocks
        return _Step(self.joint.times(share), clocks, share * self.largest)

    def damped(self, before: _Step) -> _Step:
        """Half of it where it takes back most of the step before; so are the clocks of every run on their own."""
        step = self.times(0.5) if self.joint.takes_back(before.joint) else self
        if step.clocks is None or before.clocks is None:
            return step
        lengths = np.linalg.norm(step.clocks, axis=(1, 2)) * np.linalg.norm(before.clocks, axis=(1, 2))
        back = -np.sum(step.clocks * before.clocks, axis=(1, 2)) > 0.5 * lengths
        return replace(step, clocks=np.where(back, 0.5, 1.0)[:, None, None] * step.clocks)


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
    campaign : screened, its clocks as read.
    optimum : of the parameters, with masses and contact as declared; its steps may be larger than those of `options`.
    profiles, options, report : as :func:`sysid.estimation.fit.least_squares.optimise`.
    """
    scans: tuple[int, ...] = (0, REWEIGHTED)
    near_sd, rounds, weighed = NEAR_SD, ROUNDS, REWEIGHTED
    if options.preview:
        near_sd, rounds, weighed, scans = PREVIEW_NEAR_SD, PREVIEW_ROUNDS, 1, (0,)
    rough = options.phase(weight_rounds=0, tolerance=_ROUGH_TOLERANCE, larger_steps=True)
    reweighted, final = replace(rough, weight_rounds=min(options.weight_rounds, 1)), options.phase(weight_rounds=0)
    if not options.preview:
        final = replace(final, max_iterations=_LONGER * final.max_iterations)
    optimum = _with_undeclared(campaign, optimum, profiles, options, reweighted, report)
    before: _Step | None = None
    for number in range(rounds):
        if number in scans:
            touched = with_touched_stops(campaign, optimum, rough, report)
            weighed = max(weighed, number + 1) if touched is not optimum else weighed
            optimum = touched
        report("masses and tires", 0.9)
        allowances = _allowances(campaign, optimum.problem.model)
        step = _step(campaign, optimum, allowances)
        step = step if before is None else step.damped(before)
        before = step
        near = number >= weighed and step.largest < near_sd
        last = near or number == rounds - 1
        phase = final if last else (reweighted if number < weighed else rough)
        moved = _improved(campaign, optimum, step, profiles, options, phase, report, worse=WORSE)
        if moved is None:
            # No step is an improvement: the search ends where it is, by exact steps.
            moved = _moved(campaign, optimum, step.times(0.0), profiles, options, final, report)
            return _unsettled(moved)
        optimum = moved
        if last:
            break
    return optimum if step.largest < SETTLED_SD else _unsettled(optimum)


def _with_undeclared(
    campaign: Campaign,
    optimum: Optimum,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    phase: Phase,
    report: Progress,
) -> Optimum:
    """The optimum of the parameters and of what nobody declares, all masses as declared.

    Shapes of frames that bend, and the time that holds the speed, may differ much from the assumed ones. Before they
    are known, masses would absorb their effect.
    """
    for _ in range(ROUNDS):
        allowances = _allowances(campaign, optimum.problem.model)
        if not allowances.masses.undeclared.any():
            break
        report("frames that bend, and what holds the speed", 0.9)
        step = _shape_step(campaign, optimum, allowances)
        moved = _improved(campaign, optimum, step, profiles, options, phase, report, worse=1.0)
        if moved is None:
            break
        optimum = moved
        if step.largest < NEAR_SD:
            break
    return optimum


def _improved(
    campaign: Campaign,
    optimum: Optimum,
    step: _Step,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    phase: Phase,
    report: Progress,
    *,
    worse: float,
) -> Optimum | None:
    """The optimum after the largest share of a step that leaves residuals below `worse` times theirs; None for none."""
    for share in SHARES:
        try:
            moved = _moved(campaign, optimum, step.times(share), profiles, options, phase, report)
        except DataRejectedError:
            # The simulation is not finite there: no improvement.
            continue
        if _not_larger(moved, optimum, phase, worse):
            return moved
    return None


def _not_larger(moved: Optimum, before: Optimum, phase: Phase, worse: float) -> bool:
    """Whether the residuals of an optimum are below `worse` times those of the one before.

    Scales of residuals follow them only where weights are made again. Under the same weights costs are compared.
    """
    if phase.weight_rounds > 0:
        return moved.misfit <= worse * before.misfit
    return moved.minimum.cost <= worse**2 * before.minimum.cost + _SAME_COST


def _unsettled(optimum: Optimum) -> Optimum:
    minimum = optimum.minimum
    message = f"{minimum.message.removesuffix('.')}; {_UNSETTLED}."
    return replace(optimum, minimum=replace(minimum, converged=False, message=message))


def _allowances(campaign: Campaign, model: BumpModel) -> Allowances:
    return campaign_allowances(campaign, model.parameters, model.felt)


class _Here(NamedTuple):
    """Information of the data, prior precision and its gradient, amounts, change of the footprints."""

    data: BlockInformation
    prior: ParametersByParameters
    pull: Parameters
    amounts: np.ndarray
    following: np.ndarray | None


def _here(campaign: Campaign, optimum: Optimum, allowances: Allowances) -> _Here:
    problem, campaign = optimum.problem, on_moved_clocks(campaign, optimum.clocks)
    pull, prior = problem.model.parameters.prior_pull(optimum.vector[: problem.count])
    return _Here(
        optimum_information(campaign, problem, optimum.vector, allowances, optimum.amounts),
        prior,
        pull,
        np.zeros(allowances.count) if optimum.amounts is None else optimum.amounts,
        footprints_following(problem, optimum.vector[: problem.count], allowances),
    )


def _step(campaign: Campaign, optimum: Optimum, allowances: Allowances) -> _Step:
    data, prior, pull, amounts, following = _here(campaign, optimum, allowances)
    step = model_error(data, prior, pull, allowances, amounts, following).step
    if data.clocks is None:
        return _Step(step, None, step.largest)
    change = np.concatenate([step.parameters, step.amounts])
    clocks = data.clocks.step(change if following is None else change + following @ change)
    largest = max(step.largest, float(np.max(np.abs(clocks) / data.clocks.sd)))
    return _Step(step, clocks.reshape(len(clocks), -1, 2), largest)


def _shape_step(campaign: Campaign, optimum: Optimum, allowances: Allowances) -> _Step:
    """The next step of parameters and of what nobody declares alone."""
    data, prior, pull, amounts, following = _here(campaign, optimum, allowances)
    sd = np.zeros(allowances.count)
    sd[: allowances.masses.sd.size] = np.where(allowances.masses.undeclared, allowances.masses.sd, 0.0)
    step = joint_step(data.matrix, data.score, prior, pull, sd, amounts, following)
    return _Step(step, None, step.largest)


def _moved(
    campaign: Campaign,
    before: Optimum,
    step: _Step,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions,
    phase: Phase,
    report: Progress,
) -> Optimum:
    """The optimum of the parameters after a step, with the new masses, departures, clocks and footprint maps."""
    problem, clocks = before.problem, before.clocks
    if step.clocks is not None:
        clocks = moved_clocks(on_moved_clocks(campaign, clocks), step.clocks)
        campaign = on_moved_clocks(campaign, clocks)
    old, (values, motion) = problem.model, problem.unpack(before.vector)
    values = values + step.joint.parameters
    tires = old.tires
    if CONTACT_LAWS[old.felt.contact].follows_tires:
        tires = with_run_paths(map_tires(old.parameters, values), old, values, motion)
    model = bump_model(
        campaign, old.parameters, profiles, target_step_s=options.target_step_s, contact=old.felt.contact, tires=tires
    )
    allowances = _allowances(campaign, model)
    here = np.zeros(allowances.count) if before.amounts is None else before.amounts
    amounts = allowances.within_reach(here + step.joint.amounts)
    model = allowances.moved(model, amounts)
    search = partial(optimise_from, campaign, model, motion, before.instrument, values, phase, report)
    after = search(weights=problem.weights, damping=before.minimum.damping)
    return replace(continued(after, before), amounts=amounts, clocks=clocks)
