"""A run predicted by a fit that has not seen it: the parameters of the other runs, its own speed and start."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.bump_model import BumpModel, bump_model
from sysid.estimation.fit_options import FitOptions
from sysid.estimation.histories import run_histories
from sysid.estimation.least_squares import instrument_noise, optimise_from
from sysid.estimation.levenberg_marquardt import minimise
from sysid.estimation.objective import RunMotion, Weights
from sysid.estimation.problem import FitState, Problem
from sysid.estimation.results import RunHistory
from sysid.road.results import RoadProfile

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class LeftOutFit:
    """`log_parameters` (p,) of the fit without the run, whether it `converged`, and the run's `history` under them."""

    log_parameters: np.ndarray
    converged: bool
    history: RunHistory


def fit_without(
    campaign: Campaign,
    state: FitState,
    profiles: Mapping[str, RoadProfile],
    run: int,
    options: FitOptions,
    progress: Progress | None = None,
) -> LeftOutFit:
    """Fit all runs but one, beginning at the optimum of all, and simulate that one with what they say.

    The run's own speed and start, and offset and gain of its sensors, are found from its record, because nothing else
    knows them; they are 2 numbers per run and 2 per channel.

    Parameters
    ----------
    campaign : screened campaign with all runs.
    state : the fit of all runs.
    run : index of the run in the campaign.
    """
    report = progress or (lambda message, fraction: None)
    others = tuple(i for i in range(len(campaign.bump_runs)) if i != run)
    part, model, motion, weights = _part(campaign, state, profiles, others, options)
    how = replace(options, weight_rounds=min(options.weight_rounds, 1), cross_check=False)
    noise = instrument_noise(model, motion)
    optimum = optimise_from(part, model, motion, noise, state.log_parameters, how, report, weights=weights)
    values, _ = optimum.problem.unpack(optimum.vector)
    part, model, motion, weights = _part(campaign, state, profiles, (run,), options)
    motion = _own_motion(Problem(model, part, motion, weights), values)
    alone = FitState(model, values, motion, weights, np.eye(len(values)))
    (history,) = run_histories(part, alone, instrument_noise(model, motion))
    return LeftOutFit(values, optimum.minimum.converged, history)


def _own_motion(problem: Problem, log_parameters: np.ndarray) -> RunMotion:
    """Speed and start that suit the records best while the parameters stay as they are."""

    def evaluate(local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = problem.evaluate(np.concatenate([log_parameters, local]))
        return residual, jacobian[:, problem.count :]

    best = minimise(evaluate, np.zeros(2 * len(problem.order)), relative_tolerance=1e-7)
    return problem.unpack(np.concatenate([log_parameters, best.point]))[1]


def _part(
    campaign: Campaign, state: FitState, profiles: Mapping[str, RoadProfile], runs: tuple[int, ...], options: FitOptions
) -> tuple[Campaign, BumpModel, RunMotion, Weights]:
    """Some runs of a campaign as a campaign of their own, with their motions and weights in the fit of all runs."""
    part = replace(campaign, bump_runs=tuple(campaign.bump_runs[i] for i in runs))
    model = bump_model(
        part,
        state.model.parameters,
        profiles,
        target_step_s=options.target_step_s,
        contact=options.contact,
        tires=state.model.tires,
    )
    chosen = list(runs)
    motion = RunMotion(state.motion.speed_m_s[chosen], state.motion.start_s[chosen])
    columns = [s.column for s in state.model.layout.sensors]
    channels = [columns.index(s.column) for s in model.layout.sensors]

    def rows(arrays: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        of_run = {
            i: row for g, a in zip(state.model.groups, arrays, strict=True) for i, row in zip(g.runs, a, strict=True)
        }
        return tuple(np.array([of_run[chosen[r]][channels] for r in g.runs]) for g in model.groups)

    weights = Weights(rows(state.weights.noise_sd), rows(state.weights.tempering))
    if state.weights.reading is not None:
        groups = zip(state.model.groups, state.weights.reading, strict=True)
        of_run = {i: w[:, r] for g, w in groups for r, i in enumerate(g.runs)}
        reading = tuple(np.ones(g.value.shape) for g in model.groups)
        for group, found in zip(model.groups, reading, strict=True):
            for r, i in enumerate(group.runs):
                own = of_run[chosen[i]][: group.samples, channels]
                found[: own.shape[0], r] = own
        weights = replace(weights, reading=reading)
    return part, model, motion, weights
