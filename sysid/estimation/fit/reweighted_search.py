"""Least squares from given start values: rounds of re-weighting on the way to one optimum."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.arrays import Parameters, RunsByChannels
from sysid.campaign.records import Campaign
from sysid.estimation.fit.minimiser import Minimum, minimise
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import Phase
from sysid.estimation.parameters.suspension_elements import TRAVELS
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_data import RunGroup
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.side_signals import with_sides
from sysid.estimation.weights import noise as noise_model
from sysid.estimation.weights.reweighting import reweighted
from sysid.progress import Progress
from sysid.runtime import return_memory


def optimise_from(
    campaign: Campaign,
    model: BumpModel,
    motion: RunMotion,
    instrument: tuple[RunsByChannels, ...],
    start: Parameters,
    phase: Phase,
    report: Progress,
    *,
    weights: Weights | None = None,
    damping: float | None = None,
) -> Optimum:
    """The optimum from given start values, all rounds of re-weighting done.

    Parameters
    ----------
    motion : of every run. instrument : (R, C) instrument noise per group [SI]. start : (p,) log parameters.
    weights : those of the first round; None for weights that suit parameters far from the optimum.
    damping : that of the first step, as in :func:`sysid.estimation.fit.minimiser.minimise`.
    """
    model = with_sides(model, start, motion)
    if phase.larger_steps:
        model = with_larger_steps(model, start, motion)
    first_weights = Weights(_first_scale(model, instrument), tuple(np.ones_like(n) for n in instrument))
    problem = Problem(model, campaign, motion, weights or first_weights)
    vector = problem.vector(start)
    first, iterations, rounds = vector.copy(), 0, phase.weight_rounds + 1
    minimum: Minimum | None = None
    for number in range(rounds):
        last = number == rounds - 1
        minimum = minimise(
            problem.evaluate,
            vector,
            relative_tolerance=phase.tolerance if last else phase.before_weights,
            max_iterations=phase.max_iterations,
            on_iteration=partial(_report_iteration, report, number, rounds),
            corners=[i for i, p in enumerate(model.parameters.parameters) if p.quantity in TRAVELS],
            damping=damping,
        )
        vector, damping = minimum.point, minimum.damping
        iterations += minimum.iterations
        if not last:
            problem.weights = reweighted(problem, problem.linearise(vector))
    assert minimum is not None
    # Optima of many laws are kept side by side, their derivatives need not be.
    problem.forget()
    return_memory()
    _, rolling = noise_before(model, motion)
    return Optimum(problem, vector, first, replace(minimum, iterations=iterations), instrument, rolling)


def continued(optimum: Optimum, before: Optimum) -> Optimum:
    """An optimum whose search continued that of another: it began where that one did, and iterations are summed."""
    # The second solver starts from where the search for all began.
    first = optimum.problem.vector(before.first[: before.problem.count])
    iterations = before.minimum.iterations + optimum.minimum.iterations
    return replace(optimum, first=first, minimum=replace(optimum.minimum, iterations=iterations))


def instrument_noise(model: BumpModel, motion: RunMotion) -> tuple[np.ndarray, ...]:
    """Instrument noise (R, C) per group [SI], from the records before their runs meet the bump."""
    return _before_the_bump(noise_model.instrument_noise, model, motion)


def noise_before(model: BumpModel, motion: RunMotion) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Noise (R, C) per group [SI] before the runs meet the bump: of the instruments, and of the rolling truck."""
    return instrument_noise(model, motion), _before_the_bump(noise_model.rolling_noise, model, motion)


def _before_the_bump(
    noise: Callable[[RunGroup, float], np.ndarray], model: BumpModel, motion: RunMotion
) -> tuple[np.ndarray, ...]:
    return tuple(noise(g, noise_model.quiet_time(g, motion.start_s, motion.speed_m_s)) for g in model.groups)


def _report_iteration(report: Progress, number: int, rounds: int, iteration: int, cost: float) -> None:
    share = (number + iteration / (iteration + 8)) / rounds
    report(f"least squares, round {number + 1} of {rounds}, iteration {iteration}", 0.1 + 0.8 * share)


def _first_scale(model: BumpModel, instrument: tuple[RunsByChannels, ...]) -> tuple[np.ndarray, ...]:
    """First weights: instrument noise plus a tenth of each channel's RMS, for parameters that are still far off."""
    scales = []
    for group, noise in zip(model.groups, instrument, strict=True):
        count = np.maximum(group.measured.sum(axis=0), 1)
        mean = (group.measured * group.value).sum(axis=0) / count
        rms = np.sqrt((group.measured * (group.value - mean) ** 2).sum(axis=0) / count)
        scales.append(np.hypot(noise, 0.1 * rms))
    return tuple(scales)
