"""Whole campaigns of a tractor-trailer whose physics differ from the model's: do the 90 % intervals hold the truth?"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from studies.coverage.shards import Record
from studies.coverage.vehicle import Physics, Plan, misfit_world, tractor_trailer
from sysid.errors import SysidError
from sysid.estimation.fit.evaluation import evaluate_optimum
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.least_squares import optimise
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.state import FitState
from sysid.estimation.residuals.residual_weights import Weights
from sysid.prediction.passes import predict, predict_pass
from sysid.prediction.predicted_passes import Predictions
from sysid.selftest.readings import ordinary_instruments, simulated_campaign
from sysid.selftest.world import World

#: True physics, in turn.  Masses, tires, noise and speeds differ from the declared ones in every campaign.
PHYSICS = (
    Physics("tandem cams", cams=1.0),
    Physics("30 % cams", cams=0.3),
    Physics("soft spokes", spokes=-0.2),
    Physics("stiff spokes", spokes=0.3),
    Physics("1 % friction", friction_share=0.01),
    Physics("cams, friction", cams=0.2, friction_share=0.005),
    Physics("as modelled"),
)
#: Correlation of successive noise values.
CORRELATION = 0.3
DRAWS = 100
_SEED = 20
_OPTIONS = FitOptions(cross_check=False, laws="declared")


@lru_cache(maxsize=1)
def _plan() -> Plan:
    return tractor_trailer()


def replicate(number: int) -> Record:
    """One campaign: intervals of k, c and predicted peak load ratios, as reported and for independent noise."""
    plan, physics = _plan(), PHYSICS[number % len(PHYSICS)]
    random = np.random.default_rng([_SEED, number])
    world = misfit_world(plan, physics, random)
    instruments = replace(ordinary_instruments(plan.campaign), correlation=CORRELATION)
    campaign = simulated_campaign(plan.campaign, world, plan.profiles, instruments, random)
    record: Record = {"number": number, "physics": physics.name}
    try:
        optimum = optimise(campaign, plan.parameters, plan.profiles, _OPTIONS, lambda message, fraction: None)
    except SysidError as error:
        return {**record, "failed": str(error), "entries": []}
    fit, state = evaluate_optimum(campaign, optimum, _OPTIONS, lambda message, fraction: None)
    centres = (posterior_mode(fit, state), state.point.log_parameters)
    covariances = (fit.covariance, independent_covariance(optimum))
    sets = [_draws(m, c, random) for m, c in zip(centres, covariances, strict=True)]
    entries = []
    for i, p in enumerate(fit.parameters):
        if p.quantity in ("stiffness", "damping"):
            halves = [1.645 * np.sqrt(c[i, i]) for c in covariances]
            pairs = zip(centres, halves, strict=True)
            bands = [[float(np.exp(m[i] + s * h)) for s in (-1.0, 0.0, 1.0)] for m, h in pairs]
            entries.append(_entry(p.name, p.quantity, world.values[p.name], *bands))
    states = [
        replace(state, point=replace(state.point, log_parameters=m, mass_response=masses))
        for m, masses in zip(centres, (state.point.mass_response, None), strict=True)
    ]
    passes = [
        predict(one, draws, campaign.predictions, seed=number, sweep_km_h=())
        for one, draws in zip(states, sets, strict=True)
    ]
    entries += _peaks(plan, world, *passes)
    return {
        **record,
        "failed": None if fit.converged else fit.message,
        "misfit": optimum.misfit,
        "said": any("does not explain" in w for w in fit.warnings),
        "entries": entries,
    }


def posterior_mode(fit: FitResult, state: FitState) -> np.ndarray:
    """Mode (p,) of the density that is sampled, one Newton step from the optimum.

    The likelihood is flattened and the priors are not, so their pull g at the optimum weighs more there: the mode is
    off by -(Q + P)^-1 (I - D'C'C') g, with the covariance (Q + P)^-1, the matrix C of the sandwich and D of footprint
    maps that follow their tires.
    """
    rows, targets = state.model.parameters.prior_rows()
    point = state.point
    pull = rows.T @ (rows @ point.log_parameters - targets)
    follow = np.eye(pull.size) if point.map_following is None else point.map_following
    flat = np.linalg.solve(follow.T, point.adjustment.T)
    return np.asarray(point.log_parameters - fit.covariance @ (pull - follow.T @ flat @ (flat @ pull)))


def independent_covariance(optimum: Optimum) -> np.ndarray:
    """Covariance (p, p) of the log parameters if residuals were independent and the model exact."""
    noise = optimum.problem.weights.noise_sd
    weights = Weights(noise, tuple(np.ones_like(n) for n in noise), optimum.problem.weights.reading)
    plain = optimum.problem.with_weights(weights)
    jacobian = plain.compressed(optimum.vector).jacobian
    return np.asarray(np.linalg.inv(jacobian.T @ jacobian)[: plain.count, : plain.count])


def _draws(centre: np.ndarray, covariance: np.ndarray, random: np.random.Generator) -> np.ndarray:
    return np.asarray(centre + random.standard_normal((DRAWS, centre.size)) @ np.linalg.cholesky(covariance).T)


def _peaks(plan: Plan, world: World, reported: Predictions, independent: Predictions) -> list[Record]:
    entries = []
    for request, one, two in zip(plan.campaign.predictions, reported.passes, independent.passes, strict=True):
        true = predict_pass(
            world.campaign, world.parameters, world.roads, request, world.log_parameters[None]
        ).peak_ratio_q50
        for axle, truth in enumerate(true):
            bands = [
                [float(p.peak_ratio_q05[axle]), float(p.peak_ratio_q50[axle]), float(p.peak_ratio_q95[axle])]
                for p in (one, two)
                if p.peak_ratio_q05 is not None and p.peak_ratio_q95 is not None
            ]
            name = f"peak {request.load_case} {3.6 * request.speed_m_s:.0f} km/h, axle {axle + 1}"
            entries.append(_entry(name, f"peak {3.6 * request.speed_m_s:.0f} km/h", float(truth), *bands))
    return entries


def _entry(name: str, kind: str, truth: float, reported: list[float], independent: list[float]) -> Record:
    return {"name": name, "kind": kind, "truth": truth, "reported": reported, "independent": independent}
