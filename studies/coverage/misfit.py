"""Whole campaigns, many of other physics than the model's, through the default path of `run`.

Laws are not declared, the posterior is sampled, passes are predicted from its draws: do the 90 % intervals hold?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from studies.coverage.vehicle import Physics, Plan, misfit_world, three_axle_truck, tractor_trailer
from sysid.errors import SysidError
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import fit_with_laws
from sysid.estimation.fit.options import FitOptions
from sysid.posterior.log_density import LIKELIHOOD, LogDensity
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior
from sysid.prediction.predict_passes import predict, predict_pass
from sysid.prediction.predicted_passes import Predictions
from sysid.selftest.readings import ordinary_instruments, simulated_campaign
from sysid.selftest.world import World

#: True physics, in turn.  Masses, tires, noise and speeds differ from the declared ones in every campaign.
PHYSICS = (
    Physics("as modelled"),
    Physics("axle loads 1 % off", scales=0.01),
    Physics("tandem cams", cams=1.0),
    Physics("30 % cams", cams=0.3),
    Physics("soft spokes", spokes=-0.2),
    Physics("stiff spokes", spokes=0.3),
    Physics("2 % friction", friction=0.02),
    Physics("7 % friction", friction=0.07),
    Physics("asymmetric dampers", elements=("asymmetric_damper",)),
    Physics("worn", friction=0.05, elements=("asymmetric_damper", "gas_spring")),
    Physics("rocker 40 %", rocker=0.4),
    Physics("rocker full", rocker=1.0),
    Physics("stops undeclared", stops=True),
    Physics("frame bends at 7 Hz", bending_hz=7.0),
    Physics("frame bends at 12 Hz", bending_hz=12.0),
    Physics("speed falls by 5 %", speed_change=-0.05),
    Physics("rough road", roughness_m3=1e-6),
    Physics("2 % outliers", outliers=0.02),
)
#: Correlation of successive noise values.
CORRELATION = 0.3
#: Draws of the normal approximation.
DRAWS = 400
_SEED = 20261124
_OPTIONS = FitOptions(second_solver=False)
_FOLDER = Path("build/coverage/three_axle_truck")


@lru_cache(maxsize=2)
def _plan(kind: int) -> Plan:
    return tractor_trailer() if kind == 0 else three_axle_truck(_FOLDER)


def replicate(number: int) -> Record:
    """One campaign: intervals of k, c and predicted peak load ratios, sampled and by the normal approximation."""
    # Vehicles alternate, and so do the physics of each.
    plan, physics = _plan(number % 2), PHYSICS[(number // 2) % len(PHYSICS)]
    random = np.random.default_rng([_SEED, number])
    world = misfit_world(plan, physics, random)
    instruments = replace(
        ordinary_instruments(plan.campaign), correlation=CORRELATION, outliers=physics.outliers, outlier_in_noises=6.0
    )
    record: Record = {"number": number, "vehicle": plan.kind, "physics": physics.name, "linear": physics.linear}
    try:
        campaign = simulated_campaign(plan.campaign, world, plan.profiles, instruments, random, physics.speed_change)
        fit, state = fit_with_laws(campaign, plan.drops, plan.profiles, _OPTIONS)
        posterior = sample_posterior(
            LogDensity(state).with_larger_steps(),
            fit.names,
            state.point.mode,
            state.point.covariance,
            LIKELIHOOD,
            SamplingOptions(seed=number),
        )
    except SysidError as error:
        return {**record, "failed": str(error), "entries": []}
    sampled = np.log(posterior.draws.reshape(-1, len(fit.names)))
    mode = state.point.mode
    normal = mode + random.standard_normal((DRAWS, mode.size)) @ np.linalg.cholesky(fit.covariance).T
    requests = campaign.predictions
    passes = [predict(state, draws, requests, seed=number, sweep_km_h=()) for draws in (sampled, normal)]
    entries = [
        _entry(p.name, p.quantity, world.values[p.name], _band(sampled[:, i]), _band(normal[:, i]))
        for i, p in enumerate(fit.parameters)
        if p.quantity in ("stiffness", "damping")
    ]
    elements = {law for name in fit.laws for law in name.split(" + ") if law not in ("linear", "bump_stops")}
    return {
        **record,
        "failed": None if fit.converged and posterior.converged else f"{fit.message}; {posterior.message}",
        "laws": sorted(elements),
        "false_laws": physics.linear and bool(elements),
        "said": bool(fit.proposals) or any("does not explain" in w for w in fit.warnings),
        "misfit": _misfit(fit),
        "effective": min(s.ess for s in posterior.summaries),
        "entries": entries + _peaks(plan, world, *passes),
    }


def _misfit(fit: FitResult) -> float:
    """Median over runs and channels of residual over instrument noise."""
    ratios = [np.asarray(h.noise_sd) / np.asarray(h.instrument_noise_sd) for h in fit.histories]
    return float(np.nanmedian(np.concatenate(ratios)))


def _band(draws: np.ndarray) -> list[float]:
    return [float(v) for v in np.exp(np.quantile(draws, (0.05, 0.5, 0.95)))]


def _peaks(plan: Plan, world: World, reported: Predictions, normal: Predictions) -> list[Record]:
    entries = []
    for request, one, two in zip(plan.campaign.predictions, reported.passes, normal.passes, strict=True):
        true = predict_pass(
            world.campaign, world.parameters, world.roads, request, world.log_parameters[None]
        ).peak_ratio_q50
        # Ratios are to the loads that were weighed.
        weighed = np.array(plan.campaign.load_cases[request.load_case].axle_loads_kg)
        true = true * np.array(world.campaign.load_cases[request.load_case].axle_loads_kg) / weighed
        for axle, truth in enumerate(true):
            bands = [
                [float(p.peak_ratio_q05[axle]), float(p.peak_ratio_q50[axle]), float(p.peak_ratio_q95[axle])]
                for p in (one, two)
                if p.peak_ratio_q05 is not None and p.peak_ratio_q95 is not None
            ]
            name = f"peak {request.load_case} {3.6 * request.speed_m_s:.0f} km/h, axle {axle + 1}"
            entries.append(_entry(name, "peak", float(truth), *bands))
    return entries


def _entry(name: str, kind: str, truth: float, reported: Sequence[float], normal: Sequence[float]) -> Record:
    return {"name": name, "kind": kind, "truth": truth, "reported": list(reported), "normal": list(normal)}
