"""The least-squares calibration: start values, rounds of re-weighting, optimum, covariance and checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import least_squares as scipy_least_squares

from sysid.campaign.records import Campaign
from sysid.errors import DataRejectedError
from sysid.estimation import noise as noise_model
from sysid.estimation.bump_model import TARGET_STEP_S, BumpModel, bump_model
from sysid.estimation.histories import run_histories
from sysid.estimation.levenberg_marquardt import minimise
from sysid.estimation.motion_search import search_motion
from sysid.estimation.objective import (
    SHIFT_UNIT_M,
    SPEED_SD,
    SPEED_UNIT,
    Compressed,
    Linearisation,
    RunMotion,
    Weights,
    compress,
    linearise,
    run_order,
    simulate_runs,
)
from sysid.estimation.parameters import ParameterSet
from sysid.estimation.results import FitResult, ParameterEstimate
from sysid.estimation.sandwich import Adjustment, adjust, block_scores
from sysid.road.results import RoadProfile

#: The data determine a parameter when they shrink its prior at least this much.
IDENTIFIED_SHRINKAGE = 0.7
_LAGS = 120

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class FitOptions:
    """Settings of the least-squares stage.

    `weight_rounds` re-estimations of the residual scales; `max_iterations` per round; `cross_check` repeats the last
    round with SciPy's trust-region solver from the start values; `tolerance` relative change of the cost that ends it;
    `target_step_s` the largest integration step [s].
    """

    weight_rounds: int = 3
    max_iterations: int = 40
    cross_check: bool = True
    tolerance: float = 1e-7
    target_step_s: float = TARGET_STEP_S


@dataclass(frozen=True)
class FitState:
    """What the posterior needs from a fit.

    The model, the optimum (p,), the run motions, the weights, and the `adjustment` (p, p) by which the likelihood is
    flattened (:mod:`sysid.estimation.sandwich`).
    """

    model: BumpModel
    log_parameters: np.ndarray
    motion: RunMotion
    weights: Weights
    adjustment: np.ndarray


class _Problem:
    """Campaign residuals as a function of one vector: global log parameters, then scaled changes of the run motions."""

    def __init__(self, model: BumpModel, campaign: Campaign, motion: RunMotion, weights: Weights):
        self.model, self.reference, self.weights = model, motion, weights
        self.nominal = np.array([r.nominal_speed_m_s for r in campaign.bump_runs])
        self.order = run_order(model)
        self.count = len(model.parameters.parameters)

    def unpack(self, vector: np.ndarray) -> tuple[np.ndarray, RunMotion]:
        """Log parameters and run motions of a vector."""
        local = vector[self.count :].reshape(-1, 2)
        speed, start = self.reference.speed_m_s.copy(), self.reference.start_s.copy()
        reference = self.reference.speed_m_s[self.order]
        speed[self.order] = reference * (1.0 + SPEED_UNIT * local[:, 0])
        start[self.order] = self.reference.start_s[self.order] + SHIFT_UNIT_M / reference * local[:, 1]
        return vector[: self.count], RunMotion(speed, start)

    def linearise(self, vector: np.ndarray) -> tuple[Linearisation, ...]:
        """Linearisation of every group at a vector."""
        parameters, motion = self.unpack(vector)
        return linearise(self.model, self.weights, parameters, motion)

    def evaluate(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compressed residuals (m,) and Jacobian (m, p + 2 runs)."""
        problem = self.compressed(vector)
        return problem.residual, problem.jacobian

    def compressed(self, vector: np.ndarray) -> Compressed:
        """Compressed residuals and Jacobian with respect to the vector."""
        parameters, motion = self.unpack(vector)
        lin = linearise(self.model, self.weights, parameters, motion)
        problem = compress(self.model, lin, parameters, motion, self.nominal)
        # The tangents are taken in units of the current speed, the vector counts in units of the reference speed.
        jacobian = problem.jacobian.copy()
        ratio = motion.speed_m_s[self.order] / self.reference.speed_m_s[self.order]
        jacobian[:, self.count :: 2] /= ratio
        jacobian[:, self.count + 1 :: 2] *= ratio
        return Compressed(problem.residual, jacobian)


def fit_bump_runs(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    options: FitOptions | None = None,
    progress: Progress | None = None,
) -> tuple[FitResult, FitState]:
    """Calibrate the vehicle against all bump runs by least squares.

    minimise sum ((simulated - measured) / sigma)^2 + priors over the global log parameters and every run's speed and
    start; sigma per run and channel is re-estimated from the residuals after each round, and residuals that are
    correlated in time are down-weighted by their variance inflation.

    Parameters
    ----------
    campaign : screened campaign (quality check applied).
    parameters : global parameters with start values and priors.
    profiles : road profile of each bump.
    options, progress : settings, and a callback (message, fraction done).

    Raises
    ------
    DataRejectedError
        If no run has a usable channel, or no run's start is found inside its record.
    """
    options = options or FitOptions()
    report = progress or (lambda message, fraction: None)
    report("preparing the model", 0.0)
    model = bump_model(campaign, parameters, profiles, target_step_s=options.target_step_s)
    quiet = tuple(noise_model.instrument_noise(g, 0.25) for g in model.groups)
    report("searching speeds and starts", 0.02)
    motion = search_motion(model, campaign, parameters.start, quiet)
    _check_motion(campaign, model, motion)
    instrument = tuple(
        noise_model.instrument_noise(g, noise_model.quiet_time(model, g, motion.start_s, motion.speed_m_s))
        for g in model.groups
    )
    weights = Weights(_first_scale(model, instrument), tuple(np.ones_like(n) for n in instrument))
    problem = _Problem(model, campaign, motion, weights)
    vector = np.concatenate([parameters.start, np.zeros(2 * len(problem.order))])
    start_vector = vector.copy()

    iterations, rounds = 0, options.weight_rounds + 1
    minimum = None
    for number in range(rounds):
        last = number == rounds - 1
        minimum = minimise(
            problem.evaluate,
            vector,
            relative_tolerance=options.tolerance if last else 1e-4,
            max_iterations=options.max_iterations,
            on_iteration=partial(_report_iteration, report, number, rounds),
        )
        vector = minimum.point
        iterations += minimum.iterations
        if not last:
            lin = problem.linearise(vector)
            problem.weights = _new_weights(problem, lin)
    assert minimum is not None
    report("covariance and checks", 0.9)
    return _result(campaign, problem, vector, start_vector, minimum, iterations, instrument, options, report)


def _report_iteration(report: Progress, number: int, rounds: int, iteration: int, cost: float) -> None:
    share = (number + iteration / (iteration + 8)) / rounds
    report(f"least squares, round {number + 1} of {rounds}, iteration {iteration}", 0.1 + 0.8 * share)


def _first_scale(model: BumpModel, instrument: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
    """First weights: instrument noise plus a tenth of each channel's RMS, for parameters that are still far off."""
    scales = []
    for group, noise in zip(model.groups, instrument, strict=True):
        count = np.maximum(group.measured.sum(axis=0), 1)
        mean = (group.measured * group.value).sum(axis=0) / count
        rms = np.sqrt((group.measured * (group.value - mean) ** 2).sum(axis=0) / count)
        scales.append(np.hypot(noise, 0.1 * rms))
    return tuple(scales)


def _correlations(problem: _Problem, linearisations: tuple[Linearisation, ...]) -> list[np.ndarray]:
    """Autocorrelation (lags, R, C) of the residuals of every group."""
    return [
        noise_model.autocorrelation(group, np.asarray(lin.residual), min(_LAGS, group.samples // 4))
        for group, lin in zip(problem.model.groups, linearisations, strict=True)
    ]


def _new_weights(problem: _Problem, linearisations: tuple[Linearisation, ...]) -> Weights:
    """Residual scales, and tempering by the residuals' variance inflation, from the residuals of a round."""
    scales = []
    for group, lin, noise, temper in zip(
        problem.model.groups, linearisations, problem.weights.noise_sd, problem.weights.tempering, strict=True
    ):
        scale = np.where(np.isfinite(noise), noise, 0.0) / temper
        scales.append(noise_model.residual_scale(group, np.asarray(lin.residual) * scale))
    inflation = [noise_model.variance_inflation(c) for c in _correlations(problem, linearisations)]
    return Weights(tuple(scales), tuple(1.0 / np.sqrt(v) for v in inflation))


def _check_motion(campaign: Campaign, model: BumpModel, motion: RunMotion) -> None:
    for group in model.groups:
        for run in group.runs:
            length = group.samples * group.interval_s
            if not 0.0 < motion.start_s[run] < length:
                raise DataRejectedError(
                    f"{campaign.bump_runs[run].log.file}: the passage of axle 1 over the bump is not inside the record "
                    f"(found at {motion.start_s[run]:.2f} s of {length:.2f} s); check that the log starts before it."
                )


def _result(campaign, problem, vector, start_vector, minimum, iterations, instrument, options, report):
    model = problem.model
    parameters, motion = problem.unpack(vector)
    lin = problem.linearise(vector)
    correlations = _correlations(problem, lin)
    inflation = [noise_model.variance_inflation(c) for c in correlations]
    weights = problem.weights

    cross_check = float("nan")
    if options.cross_check:
        report("cross-check by SciPy's trust-region solver", 0.92)
        cross_check = _scipy_difference(problem, vector, start_vector)
    compressed = problem.compressed(vector)
    adjustment = _adjustment(campaign, problem, vector)
    covariance = _covariance(problem, compressed, adjustment)
    scaled = compressed.jacobian / np.linalg.norm(compressed.jacobian, axis=0)
    singular = np.linalg.svd(scaled, compute_uv=False)

    report("step-halving check", 0.96)
    halving = _step_halving_error(problem, vector, lin)
    estimates, runs = _estimates(campaign, problem, parameters, motion, covariance)
    usable = [np.isfinite(n) for n in weights.noise_sd]
    median_inflation = float(np.median(np.concatenate([v[u] for v, u in zip(inflation, usable, strict=True)])))
    lags = min(c.shape[0] for c in correlations)
    misfit = np.concatenate([n[u] / i[u] for n, i, u in zip(weights.noise_sd, instrument, usable, strict=True)])
    warnings = _warnings(estimates, minimum.converged, float(np.median(misfit)), halving, cross_check)
    state = FitState(model, parameters, motion, weights, adjustment.matrix)
    fit = FitResult(
        parameters=estimates,
        run_parameters=runs,
        covariance=covariance[: problem.count, : problem.count],
        histories=_with_speed_sd(run_histories(campaign, state, instrument), runs),
        converged=minimum.converged,
        message=minimum.message,
        iterations=iterations,
        cost=minimum.cost,
        residuals=int(sum(g.measured.sum() for g in model.groups)),
        weight_rounds=options.weight_rounds,
        condition_number=float(singular[0] / singular[-1]),
        step_halving_error=halving,
        scipy_max_difference_sd=cross_check,
        variance_inflation=median_inflation,
        model_error_inflation=float(np.sqrt(np.mean(adjustment.inflation))),
        contact="footprint map of radial springs, power-law stiffening, forward force",
        autocorrelation_lag_s=np.arange(lags) * model.groups[0].interval_s,
        autocorrelation=np.concatenate(
            [c[:lags].reshape(lags, -1)[:, u.ravel()].T for c, u in zip(correlations, usable, strict=True)]
        ),
        warnings=warnings,
    )
    return fit, state


def _adjustment(campaign: Campaign, problem: _Problem, vector: np.ndarray) -> Adjustment:
    """Sandwich over blocks: one channel in all repeats of one case."""
    count = problem.count
    _, motion = problem.unpack(vector)
    scores, keys = [], []
    information = np.zeros((count, count))
    for group, lin in zip(problem.model.groups, problem.linearise(vector), strict=True):
        runs = list(group.runs)
        prior = np.zeros((len(runs), 2, 2))
        prior[:, 0, 0] = (SPEED_UNIT * motion.speed_m_s[runs] / problem.nominal[runs] / SPEED_SD) ** 2
        found, data = block_scores(
            np.asarray(lin.residual),
            np.asarray(lin.residual_jacobian),
            np.asarray(lin.gain_residual),
            np.asarray(lin.gain_jacobian),
            prior,
        )
        information += data.sum(axis=0)
        for r, run in enumerate(runs):
            record = campaign.bump_runs[run]
            case = (record.case, record.load_case, record.bump, record.nominal_speed_m_s)
            used = group.measured[:, r].any(axis=0)
            scores += [found[r, c] for c in np.flatnonzero(used)]
            keys += [(*case, int(c)) for c in np.flatnonzero(used)]
    return adjust(np.array(scores), keys, information)


def _covariance(problem: _Problem, compressed: Compressed, adjustment: Adjustment) -> np.ndarray:
    """Covariance of all unknowns: adjusted information of the globals, conditional information of the runs' own."""
    count = problem.count
    rows, _ = problem.model.parameters.prior_rows()
    normal = compressed.jacobian.T @ compressed.jacobian
    shared = np.linalg.inv(adjustment.information + rows.T @ rows)
    local = np.linalg.inv(normal[count:, count:])
    lever = local @ normal[count:, :count]
    covariance = np.zeros_like(normal)
    covariance[:count, :count] = shared
    covariance[count:, :count] = -lever @ shared
    covariance[:count, count:] = covariance[count:, :count].T
    covariance[count:, count:] = local + lever @ shared @ lever.T
    return covariance


def _with_speed_sd(histories, run_parameters):
    sd = {p.run: p.sd for p in run_parameters if p.quantity == "speed"}
    return tuple(replace(h, speed_sd=sd[h.file]) for h in histories)


def _scipy_difference(problem: _Problem, optimum: np.ndarray, start: np.ndarray) -> float:
    """Largest distance, in standard deviations, between the optimum and the one SciPy's solver finds.

    The search starts a tenth of the way back to the start values, so it has to find the optimum by itself.
    """
    cache: dict[bytes, Compressed] = {}

    def at(vector: np.ndarray) -> Compressed:
        key = vector.tobytes()
        if key not in cache:
            cache.clear()
            cache[key] = problem.compressed(vector)
        return cache[key]

    def residual(vector: np.ndarray) -> np.ndarray:
        return at(vector).residual

    def jacobian_at(vector: np.ndarray) -> np.ndarray:
        return at(vector).jacobian

    found = scipy_least_squares(
        residual,
        optimum + (start - optimum) / 10.0,
        jac=jacobian_at,
        method="trf",
        x_scale="jac",
        ftol=1e-7,
        xtol=1e-7,
        gtol=1e-7,
        max_nfev=15,
    )
    jacobian = at(optimum).jacobian
    sd = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return float(np.max(np.abs(found.x - optimum) / sd))


def _step_halving_error(problem: _Problem, vector: np.ndarray, coarse: tuple[Linearisation, ...]) -> float:
    """Largest relative RMS change of any simulated channel when the integration step is halved."""
    parameters, motion = problem.unpack(vector)
    fine = simulate_runs(problem.model.with_substeps(2), parameters, motion)
    worst = 0.0
    for lin, smooth in zip(coarse, fine, strict=True):
        rough = np.asarray(lin.simulated)
        size = np.sqrt((smooth**2).mean(axis=0))
        error = np.sqrt(((rough - smooth) ** 2).mean(axis=0))
        worst = max(worst, float(np.max(error / np.maximum(size, 1e-12))))
    return worst


def _estimates(campaign, problem: _Problem, log_parameters, motion: RunMotion, covariance):
    sd = np.sqrt(np.diag(covariance))
    globals_ = tuple(
        ParameterEstimate(
            name=p.name,
            quantity=p.quantity,
            unit=p.unit,
            axle=p.axle,
            load_case=p.load_case,
            run=None,
            law=p.law,
            transform="log",
            value=float(np.exp(log_parameters[i])),
            sd=float(np.exp(log_parameters[i]) * sd[i]),
            start=p.start,
            prior_median=p.prior_median,
            prior_sd=p.prior_sd,
            identified=bool(sd[i] < IDENTIFIED_SHRINKAGE * p.prior_sd),
        )
        for i, p in enumerate(problem.model.parameters.parameters)
    )
    local = []
    for position, run in enumerate(problem.order):
        record = campaign.bump_runs[run]
        speed, start = float(motion.speed_m_s[run]), float(motion.start_s[run])
        speed_sd, shift_sd = sd[problem.count + 2 * position : problem.count + 2 * position + 2]
        nominal = record.nominal_speed_m_s
        shared = ParameterEstimate(
            name=f"speed[{record.log.file}]",
            quantity="speed",
            unit="m/s",
            axle=None,
            load_case=record.load_case,
            run=record.log.file,
            law="constant",
            transform="none",
            value=speed,
            sd=float(speed_sd * SPEED_UNIT * speed),
            start=nominal,
            prior_median=nominal,
            prior_sd=SPEED_SD * nominal,
            identified=True,
        )
        local.append(shared)
        local.append(
            replace(
                shared,
                name=f"start[{record.log.file}]",
                quantity="start",
                unit="s",
                value=start,
                sd=float(shift_sd * SHIFT_UNIT_M / speed),
                start=float(problem.reference.start_s[run]),
                prior_median=float(problem.reference.start_s[run]),
                prior_sd=float("inf"),
            )
        )
    return globals_, tuple(local)


def _warnings(estimates, converged: bool, misfit: float, halving: float, cross_check: float) -> tuple[str, ...]:
    found = []
    if not converged:
        found.append("Least squares stopped at its limit of iterations; the values are not final.")
    if misfit >= 1.3:
        found.append(
            f"Residuals are {misfit:.1f} times the instrument noise (median over channels): the model does not explain "
            "everything the sensors saw, and intervals may be too narrow."
        )
    if halving > 1e-2:
        found.append(f"Halving the integration step changes a channel by {halving:.1e} of its size.")
    if np.isfinite(cross_check) and cross_check > 0.5:
        found.append(
            f"An independent solver ends {cross_check:.1f} standard deviations away; the optimum may not be unique."
        )
    weak = [p.name for p in estimates if not p.identified and p.quantity in ("stiffness", "damping")]
    if weak:
        found.append(f"The data say next to nothing about {', '.join(weak)}: these values come from their priors.")
    return tuple(found)
