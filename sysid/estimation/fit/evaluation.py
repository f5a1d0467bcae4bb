"""From the least-squares optimum to its result: covariance, checks, histories and warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares as scipy_least_squares

from sysid.arrays import Parameters, ParametersByParameters, UnknownsOfFit
from sysid.campaign.clocks.moved import on_moved_clocks
from sysid.campaign.records import Campaign
from sysid.campaign.statics import carried_by_suspensions
from sysid.errors import DataRejectedError
from sysid.estimation.fit.causes import Cause
from sysid.estimation.fit.fit_result import FitResult, MassCheck, UndecidedLaw
from sysid.estimation.fit.found_departures import found_departures
from sysid.estimation.fit.implausible_values import implausible_values
from sysid.estimation.fit.minimiser import Minimum
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.state import FitPoint, FitState, fit_point
from sysid.estimation.fit.thresholds import MISFIT, SOLVERS_APART_SD, STEP_HALVING
from sysid.estimation.fit.undecided_laws import spread_rows
from sysid.estimation.parameters.estimate import ParameterEstimate, ParameterEstimates
from sysid.estimation.parameters.rockers import load_shares
from sysid.estimation.residuals.compressed import Compressed
from sysid.estimation.residuals.histories import run_histories
from sysid.estimation.residuals.problem import Problem
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_history import RunHistory
from sysid.estimation.residuals.run_motion import (
    CHANGE,
    RUN_UNKNOWNS,
    SHIFT,
    SHIFT_UNIT_M,
    SPEED,
    SPEED_UNIT,
    RunMotion,
)
from sysid.estimation.residuals.side_unknowns import KINDS
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.allowances import campaign_allowances
from sysid.estimation.uncertainty.identifiability import IDENTIFIED_SHRINKAGE, Identifiability, assess
from sysid.estimation.uncertainty.information import AdjustedInformation, adjusted_information
from sysid.estimation.uncertainty.mass_response import MassResponse
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.shared_errors import further_unknowns
from sysid.estimation.uncertainty.uncertain_masses import UNDECLARED, UncertainMasses
from sysid.estimation.weights.residual_evidence import ResidualEvidence
from sysid.estimation.weights.reweighting import residual_inflation
from sysid.estimation.weights.whiteness import residual_evidence
from sysid.progress import Progress
from sysid.road.contact_laws import CONTACT_LAWS
from sysid.runtime import return_memory

#: If the data require a mass this many tolerances off, the user should check it. A healthy vehicle has some 25 masses,
#: of which one would be beyond two by chance.
DOUBTFUL_MASS_SD = 3.0


def evaluate_optimum(
    campaign: Campaign,
    optimum: Optimum,
    options: FitOptions,
    report: Progress,
    undecided: Sequence[UndecidedLaw] = (),
) -> tuple[FitResult, FitState]:
    """Covariance, checks and histories at an optimum; with ``options.second_solver`` SciPy's solver searches as well.

    Laws that are `undecided` add to the covariance.
    """
    campaign = on_moved_clocks(campaign, optimum.clocks)
    problem, vector, minimum = optimum.problem, optimum.vector, optimum.minimum
    model, weights = problem.model, problem.weights
    report("covariance and checks", 0.9)
    parameters, motion = problem.unpack(vector)
    at_optimum = _AtOptimum.of(problem, vector)
    difference = _scipy_difference(problem, vector, optimum.first, report) if options.second_solver else float("nan")
    compressed = problem.compressed(vector)
    _check_runs_are_seen(campaign, problem, compressed)
    problem.forget()
    return_memory()
    allowances = campaign_allowances(campaign, model.parameters, model.felt)
    spread = spread_rows(undecided, model.parameters.names)
    adjusted = adjusted_information(campaign, problem, vector, allowances, optimum.amounts, spread)
    covariance = _covariance(problem, compressed, adjusted.information)
    condition = np.linalg.cond(compressed.jacobian / np.linalg.norm(compressed.jacobian, axis=0))

    report("step-halving check", 0.96)
    halving = _step_halving_error(problem, vector, at_optimum.simulated)
    estimates, runs = _estimates(campaign, problem, parameters, motion, covariance)
    shared = covariance[: problem.count, : problem.count]
    determined = assess(estimates, shared, adjusted.data)
    checks = _mass_checks(allowances.masses, adjusted.response, shared)
    warnings = fit_warnings(minimum, (optimum.misfit, optimum.over_instruments), halving, difference, determined)
    departed = found_departures(allowances, adjusted.response, shared)
    implausible = implausible_values(estimates, _carried(campaign))
    values = (*implausible.impossible, *implausible.contradict)
    point = replace(_fit_point(problem, vector, adjusted, shared), clocks=optimum.clocks)
    fit = FitResult(
        parameters=ParameterEstimates(estimates),
        run_parameters=ParameterEstimates(runs),
        covariance=shared,
        histories=_with_speed_sd(
            run_histories(campaign, model, weights, motion, parameters, optimum.instrument, optimum.rolling), runs
        ),
        converged=minimum.converged,
        message=minimum.message,
        iterations=minimum.iterations,
        cost=minimum.cost,
        residuals=int(sum(g.measured.sum() for g in model.groups)),
        condition_number=float(condition),
        step_halving_error=halving,
        scipy_max_difference_sd=difference,
        variance_inflation=at_optimum.typical_inflation(weights),
        model_error_inflation=float(np.sqrt(np.mean(adjusted.inflation))),
        contact=CONTACT_LAWS[options.contact].meaning,
        residual_evidence=at_optimum.evidence,
        warnings=(*(c.sentence for c in departed), *warnings, *_mass_warnings(checks), *values),
        doubts=(*numerical_doubts(halving, difference), *implausible.contradict),
        causes=(*departed, *(Cause("mass", s) for s in _mass_warnings(checks))),
        impossible=implausible.impossible,
        masses=checks,
        identifiability=determined,
        misfit=optimum.misfit,
        load_shares=load_shares(campaign.vehicle, estimates),
        parts=adjusted.parts.differences,
        further=further_unknowns(allowances, adjusted),
        tire_growth=tuple(model.arrays[0].laws.tire_growth[0, :, 0].tolist()),
    )
    return fit, FitState(campaign, point, model)


def _carried(campaign: Campaign) -> dict[int, float]:
    """Load [N] that the suspension of every axle carries in the first load case, by axle index."""
    vehicle, first = campaign.vehicle, next(iter(campaign.load_cases.values()))
    sprung = np.array(first.axle_loads_kg) - vehicle.unsprung_mass_kg
    return dict(enumerate(carried_by_suspensions(vehicle) @ sprung * vehicle.gravity_m_s2))


@dataclass(frozen=True)
class _AtOptimum:
    """Properties of the residuals at an optimum, without their derivatives.

    Per group `simulated` sensor signals (T, R, C) [SI] and variance `inflation` (R, C).
    """

    simulated: list[np.ndarray]
    inflation: list[np.ndarray]
    evidence: ResidualEvidence

    @classmethod
    def of(cls, problem: Problem, vector: UnknownsOfFit) -> _AtOptimum:
        simulated, residuals, inflation = [], [], []
        for position, lin in enumerate(problem.linearise(vector)):
            simulated.append(np.asarray(lin.simulated))
            residuals.append(np.asarray(lin.residual))
            inflation.append(residual_inflation(problem, position, lin))
        return cls(simulated, inflation, residual_evidence(problem, residuals))

    def typical_inflation(self, weights: Weights) -> float:
        """Median variance inflation of all channels that are used."""
        used = [np.isfinite(n) for n in weights.noise_sd]
        return float(np.median(np.concatenate([v[u] for v, u in zip(self.inflation, used, strict=True)])))


def _fit_point(
    problem: Problem, vector: np.ndarray, adjusted: AdjustedInformation, covariance: ParametersByParameters
) -> FitPoint:
    """Everything that is stored of the end of the fit, at the unknowns `vector`; `covariance` (p, p) of parameters."""
    parameters, motion = problem.unpack(vector)
    # At the optimum the data pull as hard as the priors, the other way; with model error they pull less.
    pull, _ = problem.model.parameters.prior_pull(parameters)
    point = fit_point(problem.model, parameters, motion, problem.weights, covariance)
    mode = parameters + covariance @ (adjusted.slope - pull)
    point = replace(point, mode=mode, integrated=adjusted.integrated)
    if not adjusted.response.amounts.size:
        return point
    return replace(point, amounts=adjusted.response.amounts, mass_response=adjusted.response)


def _mass_checks(
    masses: UncertainMasses, response: MassResponse, covariance: ParametersByParameters
) -> tuple[MassCheck, ...]:
    sd = response.sd(covariance)
    return tuple(
        MassCheck(f.name, f.quantity, f.words, f.sd, float(np.exp(estimate)), float(after))
        for f, estimate, after in zip(masses.factors, response.amounts, sd, strict=False)
        if f.quantity not in UNDECLARED and f.quantity not in KINDS
    )


def _mass_warnings(checks: tuple[MassCheck, ...]) -> tuple[str, ...]:
    sentences = []
    for check in checks:
        if abs(np.log(check.estimate)) > DOUBTFUL_MASS_SD * check.tolerance:
            percent, side = 100.0 * abs(check.estimate - 1.0), "above" if check.estimate > 1.0 else "below"
            sentences.append(
                f"The data fit better with a value about {percent:.2g} % {side} the declared one: {check.words}, "
                f"declared within {100.0 * check.tolerance:g} %. Check it in campaign.toml, or widen its tolerance."
            )
    return tuple(sentences)


def _check_runs_are_seen(campaign: Campaign, problem: Problem, compressed: Compressed) -> None:
    """Refuse a fit in which a run's simulated passage has left its record: nothing determines its start.

    Raises
    ------
    DataRejectedError
        With the first such run.
    """
    by_shift = np.linalg.norm(compressed.jacobian[:, problem.count :], axis=0).reshape(-1, RUN_UNKNOWNS)[:, SHIFT]
    lost = np.flatnonzero(by_shift <= 1e-9 * np.median(by_shift))
    if lost.size:
        run = campaign.bump_runs[problem.order[int(lost[0])]]
        raise DataRejectedError(
            f"{run.log.file}: the fit has moved its passage over the bump out of the record. This happens when "
            "channels contradict each other. Look at the output of the stage 'check' for its channels (units, "
            "exchanged columns), and compare its speed and load case with the test notes."
        )


def _covariance(problem: Problem, compressed: Compressed, information: ParametersByParameters) -> np.ndarray:
    """Covariance of all unknowns: `information` (p, p) of the globals, conditional information of the runs' own."""
    count = problem.count
    rows, _ = problem.model.parameters.prior_rows()
    normal = compressed.jacobian.T @ compressed.jacobian
    equations, own = NormalEquations.of(normal), slice(count, None)
    change = np.concatenate([np.eye(count), equations.eliminate(own).response])
    covariance = change @ np.linalg.inv(information + rows.T @ rows) @ change.T
    covariance[own, own] += equations.only(own).covariance
    return np.asarray(covariance)


def _with_speed_sd(
    histories: tuple[RunHistory, ...], run_parameters: tuple[ParameterEstimate, ...]
) -> tuple[RunHistory, ...]:
    sd = {p.run: p.sd for p in run_parameters if p.quantity == "speed"}
    return tuple(replace(h, speed_sd=sd[h.file]) for h in histories)


def _scipy_difference(problem: Problem, optimum: np.ndarray, start: np.ndarray, report: Progress) -> float:
    """Largest distance, in standard deviations, between the optimum and the one SciPy's solver finds.

    The search starts a tenth of the way back to the start values, so it has to find the optimum by itself.
    """
    report("second search by SciPy's trust-region solver", 0.92)
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

    minimum = scipy_least_squares(
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
    return float(np.max(np.abs(minimum.x - optimum) / sd))


def _step_halving_error(problem: Problem, vector: UnknownsOfFit, coarse: Sequence[np.ndarray]) -> float:
    """Largest relative RMS change of any simulated channel when the integration step is halved."""
    parameters, motion = problem.unpack(vector)
    fine = simulate_runs(problem.model.with_substeps(2), parameters, motion)
    worst = 0.0
    for rough, smooth in zip(coarse, fine, strict=True):
        size = np.sqrt((smooth**2).mean(axis=0))
        error = np.sqrt(((rough - smooth) ** 2).mean(axis=0))
        worst = max(worst, float(np.max(error / np.maximum(size, 1e-12))))
    return worst


def _estimates(
    campaign: Campaign, problem: Problem, log_parameters: Parameters, motion: RunMotion, covariance: np.ndarray
) -> tuple[tuple[ParameterEstimate, ...], tuple[ParameterEstimate, ...]]:
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
    local: list[ParameterEstimate] = []
    for position, run in enumerate(problem.order):
        of_run = slice(problem.count + RUN_UNKNOWNS * position, problem.count + RUN_UNKNOWNS * (position + 1))
        local += _of_run(campaign, problem, motion, run, covariance[of_run, of_run])
    return globals_, tuple(local)


def _of_run(
    campaign: Campaign, problem: Problem, motion: RunMotion, run: int, covariance: np.ndarray
) -> list[ParameterEstimate]:
    """Speed, start and, where it is unknown, change of speed of a run; `covariance` (3, 3) of its scaled unknowns."""
    record, reference = campaign.bump_runs[run], float(problem.reference_motion.start_s[run])
    speed, nominal, change_sd = float(motion.speed_m_s[run]), record.expected_speed_m_s, record.speed_change_sd
    sd, by_unknowns = np.sqrt(np.diag(covariance)), np.zeros(RUN_UNKNOWNS)
    by_unknowns[[SPEED, CHANGE]] = SPEED_UNIT * speed, motion.speed_by_change[run] * change_sd
    of_speed = ParameterEstimate(
        name=f"speed[{record.log.file}]",
        quantity="speed",
        unit="m/s",
        axle=None,
        load_case=record.load_case,
        run=record.log.file,
        law="constant",
        transform="none",
        value=speed,
        sd=float(np.sqrt(by_unknowns @ covariance @ by_unknowns)),
        start=nominal,
        prior_median=nominal,
        prior_sd=record.speed_sd * nominal,
        identified=True,
    )
    of_start = replace(
        of_speed,
        name=f"start[{record.log.file}]",
        quantity="start",
        unit="s",
        value=float(motion.start_s[run]),
        sd=float(sd[SHIFT] * SHIFT_UNIT_M / speed),
        start=reference,
        prior_median=reference,
        prior_sd=float("inf"),
    )
    if change_sd == 0.0:
        return [of_speed, of_start]
    of_change = replace(
        of_speed,
        name=f"speed_change[{record.log.file}]",
        quantity="speed_change",
        unit="1",
        value=float(motion.speed_change[run]),
        sd=float(sd[CHANGE] * change_sd),
        start=0.0,
        prior_median=0.0,
        prior_sd=change_sd,
        identified=bool(sd[CHANGE] < IDENTIFIED_SHRINKAGE),
    )
    return [of_speed, of_start, of_change]


def fit_warnings(
    minimum: Minimum, misfits: tuple[float, float], halving: float, apart_sd: float, determined: Identifiability
) -> tuple[str, ...]:
    """Warnings about a fit, to be read before it is used.

    Parameters
    ----------
    misfits : median over channels of residual over what the channels show before the bump, and over instrument noise.
    halving : largest relative RMS change of a channel with half the integration step.
    apart_sd : distance of an independent solver's optimum [sd], NaN where none looked for it.
    """
    sentences = []
    if not minimum.converged:
        sentences.append(f"Least squares has not converged ({minimum.message}); the values are not final.")
    misfit, over_instruments = misfits
    size = f"{over_instruments:.1f} times the instrument noise"
    if over_instruments >= 1.1 * misfit:
        size = f"{misfit:.1f} times what the sensors show before the bump, {size}"
    if misfit >= MISFIT:
        sentences.append(
            f"Residuals are {size} (median over channels): the model does not explain everything the sensors saw. "
            "Intervals are widened accordingly, but may still be too narrow."
        )
    sentences += numerical_doubts(halving, apart_sd)
    sentences += determined.warnings
    return tuple(sentences)


def numerical_doubts(halving: float, apart_sd: float) -> list[str]:
    """Warnings about the numerical solution; arguments as for :func:`fit_warnings`."""
    sentences = []
    if halving > STEP_HALVING:
        sentences.append(
            f"Halving the integration step changes a channel by {100.0 * halving:.2g} % of its size, more than "
            f"{100.0 * STEP_HALVING:g} %."
        )
    if np.isfinite(apart_sd) and apart_sd > SOLVERS_APART_SD:
        sentences.append(
            f"An independent solver ends {apart_sd:.1f} standard deviations away; the optimum may not be unique."
        )
    return sentences
