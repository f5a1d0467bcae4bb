"""Bump runs of a two-axle truck made with the model itself: ranks of the truth among draws of the calibrated posterior.

Truth from the priors, masses as declared; two short runs; the product's least squares, log-density and sampler with
its default options.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.coverage.shards import Record
from sysid.campaign.priors import PriorOverride
from sysid.campaign.records import Acquisition, AntiAliasFilter, BumpRun, Campaign, Log, Sensor
from sysid.campaign.vehicle_records import EXACT_MASSES, Axle, Body, LoadCase, MassTolerances, Vehicle
from sysid.errors import SysidError
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.posterior.log_density import LIKELIHOOD, LogDensity
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior
from sysid.road.road_profile import RoadProfile
from sysid.selftest.readings import Instruments, blank_run, ordinary_instruments, simulated_campaign
from sysid.selftest.world import draw_world

#: Draws that the truth is ranked among.
DRAWS = 99
INTERVAL_S = 0.005
SPEEDS_M_S = (6.0, 9.0)
_SEED = 22
_OPTIONS = FitOptions(second_solver=False, laws="declared", weight_rounds=2)


def _priors(stiffness: float, damping: float) -> dict[str, PriorOverride]:
    return {"stiffness": PriorOverride(stiffness, 0.25), "damping": PriorOverride(damping, 0.3)}


AXLES = (
    Axle("front", 0, 0.0, 520.0, 1.7e6, 2500.0, 0.48, "leaf", priors=_priors(4.2e5, 1.0e4)),
    Axle("rear", 0, 3.8, 980.0, 2.9e6, 3400.0, 0.50, "leaf", priors=_priors(7.0e5, 1.4e4)),
)
VEHICLE = Vehicle("two-axle truck", (Body("truck"),), AXLES, tolerances=EXACT_MASSES)
EMPTY = LoadCase("empty", (4100.0, 4600.0), (7200.0,), (21000.0,), (1.15,))
SENSORS = (
    *(Sensor(f"lvdt{i + 1}", "suspension_deflection", "mm", axle=i, full_scale=0.15) for i in range(2)),
    *(Sensor(f"axle{i + 1}", "axle_acceleration", "g", axle=i, full_scale=98.0665) for i in range(2)),
    *(
        Sensor(f"frame{i + 1}", "body_acceleration", "g", body=0, x_m=x, full_scale=49.0)
        for i, x in enumerate((0.0, 4.0))
    ),
)


def bump() -> RoadProfile:
    """A raised cosine, 60 mm high and 0.7 m long."""
    s = np.round(np.arange(0.0, 1.1001, 0.005), 6)
    z = np.where((s > 0.2) & (s < 0.9), 0.03 * (1.0 - np.cos(2.0 * np.pi * (s - 0.2) / 0.7)), 0.0)
    above = np.flatnonzero(z > 1e-3)
    return RoadProfile("bump", s, z, 0.0 * z, float(s[above[0]]), float(s[above[-1]] - s[above[0]]))


def plan(tolerances: MassTolerances = EXACT_MASSES) -> Campaign:
    """Two blank runs of the truck."""
    runs = []
    for i, speed in enumerate(SPEEDS_M_S):
        run = BumpRun(f"run {i + 1}", "empty", speed, 1, Log(f"run{i + 1}.csv", INTERVAL_S, ()))
        runs.append(blank_run(run, SENSORS, 2.8, INTERVAL_S))
    filtered = Acquisition(INTERVAL_S, AntiAliasFilter("butterworth", 4, 60.0))
    cases, file, vehicle = {"empty": EMPTY}, Path("campaign.toml"), replace(VEHICLE, tolerances=tolerances)
    return Campaign("two axles", "", Path(), file, vehicle, cases, filtered, (), tuple(runs), {}, (), {})


def instruments(campaign: Campaign) -> Instruments:
    """Independent noise of ordinary instruments."""
    return ordinary_instruments(campaign)


def replicate(number: int) -> Record:
    """One campaign with independent Gaussian noise."""
    return ranks(number, plan(), instruments(plan()), _SEED)


def ranks(number: int, planned: Campaign, sensors: Instruments, seed: int) -> Record:
    """Ranks of the truth among draws, and distances from the optimum, of one campaign."""
    random = np.random.default_rng([seed, number])
    profiles = {"bump": bump()}
    parameters = campaign_parameters(planned, None)
    world = draw_world(planned, parameters, profiles, random)
    campaign = simulated_campaign(planned, world, profiles, sensors, random)
    try:
        fit, state = fit_bump_runs(campaign, parameters, profiles, _OPTIONS)
    except SysidError as error:
        return {"number": number, "failed": str(error), "entries": []}
    density, options = LogDensity(state).with_larger_steps(), SamplingOptions(seed=number)
    centre, point = state.point.log_parameters, state.point
    posterior = sample_posterior(density, parameters.names, point.mode, point.covariance, LIKELIHOOD, options)
    pooled = np.log(posterior.draws.reshape(-1, centre.size))
    draws = pooled[random.choice(len(pooled), DRAWS, replace=False)]
    sd = np.sqrt(np.diag(fit.covariance))
    z = (world.log_parameters - centre) / sd
    below = (draws < world.log_parameters).sum(axis=0)
    entries = [
        {"name": n, "rank": int(below[i]), "z": float(z[i]), "sd": float(sd[i])} for i, n in enumerate(parameters.names)
    ]
    doubts = [w for w in fit.warnings if "does not explain" in w or "off their" in w]
    return {
        "number": number,
        "failed": None if posterior.converged else posterior.message,
        "effective": min(s.ess for s in posterior.summaries),
        "said": bool(doubts),
        "entries": entries,
    }
