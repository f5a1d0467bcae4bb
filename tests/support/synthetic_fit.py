"""A small campaign made with the model itself, fitted once per test session: the truth behind it is known."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from rigid_truck import SENSORS, bump, campaign, empty_run, true_log_parameters, with_values

from sysid.campaign.records import Campaign, PredictionRequest
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.least_squares import fit_bump_runs
from sysid.estimation.fit.options import FitOptions
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.signals import simulate_runs
from sysid.road.road_profile import RoadProfile

SAMPLES = 360
NOMINAL_M_S = (6.0, 8.5)
SPEED_M_S = np.array([6.07, 8.39])
START_S = np.array([0.44, 0.61])
#: Instrument noise, in SI, of deflections and accelerations; offset and gain error of every channel.
NOISE = {"suspension_deflection": 2e-4, "axle_acceleration": 0.15, "body_acceleration": 0.03}
SEED = 20240501
LOST = ("slow.csv", "axle2_accel")
CLIPPED = ("fast.csv", "axle1_accel", 18.0)


@dataclass(frozen=True)
class SyntheticFit:
    """The campaign, its parameters and profiles, the fit, and the log parameters behind the readings."""

    campaign: Campaign
    parameters: ParameterSet
    profiles: dict[str, RoadProfile]
    result: FitResult
    state: FitState
    truth: np.ndarray


def synthetic_campaign() -> tuple[Campaign, ParameterSet, dict[str, RoadProfile]]:
    """Two runs at two speeds with noise, offsets, gain errors, one lost channel and one clipped one."""
    runs = [empty_run(f, v, samples=SAMPLES) for f, v in zip(("slow.csv", "fast.csv"), NOMINAL_M_S, strict=True)]
    request = PredictionRequest("empty", 10.0)
    blank = campaign(runs, predictions=[request])
    parameters = campaign_parameters(blank, None)
    profiles = {"bump": bump()}
    truth = true_log_parameters(parameters.names)
    model = bump_model(blank, parameters, profiles, tires=map_tires(parameters, truth))
    (signals,) = simulate_runs(model, truth, RunMotion.steady(SPEED_M_S, START_S))
    random = np.random.default_rng(SEED)
    filled = []
    for r, run in enumerate(runs):
        clean = signals[:, model.groups[0].runs.index(r)]
        scale = np.array([NOISE[s.kind] for s in SENSORS])
        values = 3.0 * scale * random.normal(size=8) + clean * (1 + 0.003 * random.normal(size=8))
        values = values + scale * random.normal(size=values.shape)
        measured = with_values(run, values)
        channels = list(measured.log.channels)
        for k, c in enumerate(channels):
            if (run.log.file, c.sensor.column) == LOST:
                channels[k] = replace(c, value=np.full(SAMPLES, np.nan))
            if (run.log.file, c.sensor.column) == CLIPPED[:2]:
                limit = CLIPPED[2]
                side = (c.value >= limit).astype(np.int8) - (c.value <= -limit).astype(np.int8)
                channels[k] = replace(c, value=np.clip(c.value, -limit, limit), censored=side)
        filled.append(replace(measured, log=replace(measured.log, channels=tuple(channels))))
    return replace(blank, bump_runs=tuple(filled)), parameters, profiles


@lru_cache(maxsize=1)
def synthetic_fit() -> SyntheticFit:
    """The campaign's fit, made once."""
    data, parameters, profiles = synthetic_campaign()
    options = FitOptions(weight_rounds=1, second_solver=False)
    result, state = fit_bump_runs(data, parameters, profiles, options)
    return SyntheticFit(data, parameters, profiles, result, state, true_log_parameters(parameters.names))
