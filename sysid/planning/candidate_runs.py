"""Information at the optimum about the parameters from runs that nobody has driven yet.

A candidate run is simulated by the calibrated model.  Its channels get the residual scales and variance inflations that
the same channels had on average in the runs that were driven; a sensor that was not there gets those of its kind.
Readings beyond a sensor's range do not count.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import BumpRun, Campaign, Channel, Log, Sensor, SensorKind
from sysid.estimation.fit.state import FitState, model_of
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.residuals.linearisation import linearise_one
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_data import RunGroup
from sysid.estimation.residuals.run_motion import RunMotion, motion_prior
from sysid.estimation.residuals.run_unknowns import with_own_priors
from sysid.estimation.residuals.signals import simulate_runs
from sysid.estimation.uncertainty.allowance_columns import allowance_columns
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.residual_columns import channel_columns
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.engines.protocol import Linearisation

#: Body accelerometers nearer than this to a point on their body [m] are at it.
NEAR_M = 0.5
#: How long before axle 1 meets the bump and after the last axle has left a candidate run is recorded [s].
BEFORE_S, AFTER_S = 1.0, 2.5


@dataclass(frozen=True)
class RunKind:
    """A pass that could be driven: load case, bump and nominal speed [m/s]."""

    load_case: str
    bump: str
    speed_m_s: float


@dataclass(frozen=True)
class RunInformation:
    """What each channel of a candidate run says about p parameters, q masses and departures and the run's own motion.

    `channels` (C, n, n) normal matrices, n = p + q + 3, in the order of `sensors`; `motion_prior_precision`
    (3, 3) prior precision of the run's own unknowns.
    """

    kind: RunKind
    sensors: tuple[Sensor, ...]
    channels: np.ndarray
    motion_prior_precision: np.ndarray

    def of(self, sensors: Sequence[Sensor]) -> np.ndarray:
        """Information (p + q, p + q) of the run recorded by some of its sensors."""
        chosen = [k for k, s in enumerate(self.sensors) if s in sensors]
        whole = with_own_priors(self.channels[chosen].sum(axis=0), self.motion_prior_precision)
        own = slice(-len(self.motion_prior_precision), None)
        return NormalEquations.of(whole).eliminate(own).left.matrix


def recording_sensors(state: FitState) -> tuple[Sensor, ...]:
    """Sensors that have a usable record in at least one of the runs that were driven."""
    used = np.isfinite(np.concatenate(state.point.weights.noise_sd)).any(axis=0)
    return tuple(s for s, recorded in zip(state.model.layout.sensors, used, strict=True) if recorded)


def missing_sensors(campaign: Campaign, sensors: Sequence[Sensor]) -> tuple[Sensor, ...]:
    """Sensors that could be added: deflection and acceleration of every axle, and of the body above it, that lack one.

    Parameters
    ----------
    sensors : those that recorded the bump runs.
    """
    candidates = []
    for i, axle in enumerate(campaign.vehicle.axles):
        on_axle: tuple[tuple[SensorKind, str, str], ...] = (
            ("suspension_deflection", "mm", f"LVDT at axle {i + 1}"),
            ("axle_acceleration", "g", f"accelerometer on axle {i + 1}"),
        )
        for kind, unit, label in on_axle:
            if not any(s.kind == kind and s.axle == i for s in sensors):
                candidates.append(Sensor(label, kind, unit, axle=i))
        near = [s for s in sensors if s.kind == "body_acceleration" and s.body == axle.body and s.x_m is not None]
        if not any(abs(float(s.x_m or 0.0) - axle.x_m) < NEAR_M for s in near):
            label = f"accelerometer on the frame above axle {i + 1}"
            candidates.append(Sensor(label, "body_acceleration", "g", body=axle.body, x_m=axle.x_m))
    return tuple(candidates)


def run_information(state: FitState, kinds: Sequence[RunKind], sensors: Sequence[Sensor]) -> tuple[RunInformation, ...]:
    """Information of candidate runs for each of the `sensors`.

    Parameters
    ----------
    state : the fit of the runs that were driven.
    kinds : the candidates; their load cases are among those driven or predicted.
    """
    sensors = tuple(sensors)
    campaign, point = state.campaign, state.point
    runs = tuple(_empty_run(campaign, state.profiles, kind, sensors) for kind in kinds)
    model = model_of(replace(campaign, bump_runs=runs), state.profiles, point, campaign)
    motion = RunMotion.steady(np.array([k.speed_m_s for k in kinds]), np.full(len(kinds), BEFORE_S))
    signals = simulate_runs(model, point.log_parameters, motion)
    weights = _weights(state, model, signals)
    model = _read_by_sensors(model, signals)
    columns = allowance_columns(model, state.allowances, weights, point.log_parameters, motion, point.amounts)
    order = [sensors.index(s) for s in model.layout.sensors]
    motion_prior_precision = motion_prior(runs).precision(motion, range(len(runs)))
    by_run: dict[int, RunInformation] = {}
    for position, group in enumerate(model.groups):
        on_device = linearise_one(model, weights, point.log_parameters, motion, position)
        of_group = Linearisation(*map(np.asarray, on_device))
        further = [c[position] for c in columns]
        for r, run in enumerate(group.runs):
            squares = {at: _normal(*channel_columns(of_group, r, c, *further)) for c, at in enumerate(order)}
            normal = np.array([squares[at] for at in range(len(sensors))])
            by_run[run] = RunInformation(kinds[run], sensors, normal, motion_prior_precision[run])
    return tuple(by_run[i] for i in range(len(kinds)))


def _normal(rows: np.ndarray, gain: np.ndarray) -> np.ndarray:
    return np.asarray(rows.T @ rows + np.outer(gain, gain))


def _empty_run(
    campaign: Campaign, profiles: Mapping[str, RoadProfile], kind: RunKind, sensors: Sequence[Sensor]
) -> BumpRun:
    """A record long enough for the pass, without readings."""
    alike = [r for r in campaign.bump_runs if r.load_case == kind.load_case] or list(campaign.bump_runs)
    interval = campaign.bump_runs[0].log.sample_interval_s
    reach = campaign.vehicle.axles[-1].x_m + profiles[kind.bump].length_m
    time = np.arange(int(np.ceil((BEFORE_S + AFTER_S + reach / kind.speed_m_s) / interval))) * interval
    channels = tuple(Channel(s, time, np.zeros(time.size), np.zeros(time.size, np.int8)) for s in sensors)
    label = f"{kind.load_case}, {3.6 * kind.speed_m_s:.4g} km/h over {kind.bump}"
    speed_sd, change_sd = (
        float(np.median(v)) for v in zip(*((r.speed_sd, r.speed_change_sd) for r in campaign.bump_runs), strict=True)
    )
    log = Log(label, interval, channels)
    return BumpRun(label, kind.load_case, kind.speed_m_s, 1, log, kind.bump, speed_sd, change_sd, alike[0].speed_held)


def _weights(state: FitState, model: BumpModel, signals: Sequence[np.ndarray]) -> Weights:
    """Residual scale and tempering per group and channel: means of the driven runs, for new sensors those of a kind."""
    driven = state.model.layout.sensors
    noise = np.concatenate(state.point.weights.noise_sd)
    inflation = np.concatenate(state.point.weights.tempering) ** -2.0
    used = np.isfinite(noise)
    count = np.maximum(used.sum(axis=0), 1)
    scale = np.where(used, noise, 0.0).sum(axis=0) / count
    spread = np.where(used, inflation, 0.0).sum(axis=0) / count
    known = {s: (scale[k], spread[k]) for k, s in enumerate(driven) if used[:, k].any()}
    size = {s: _size(signals, k) for k, s in enumerate(model.layout.sensors)}
    pairs = [_channel_weight(s, known, size) for s in model.layout.sensors]
    sd, factor = (np.array(v) for v in zip(*pairs, strict=True))
    shapes = [(len(g.runs), 1) for g in model.groups]
    return Weights(tuple(np.tile(sd, s) for s in shapes), tuple(np.tile(factor**-0.5, s) for s in shapes))


def _channel_weight(
    sensor: Sensor, known: Mapping[Sensor, tuple[float, float]], size: Mapping[Sensor, float]
) -> tuple[float, float]:
    if sensor in known:
        return known[sensor]
    alike = [v for s, v in known.items() if s.kind == sensor.kind]
    if alike:
        return float(np.mean([a for a, _ in alike])), float(np.mean([b for _, b in alike]))
    # Nothing of its kind was mounted: as noisy, in proportion to its signal, as the others are.
    share = float(np.mean([noise / size[s] for s, (noise, _) in known.items()]))
    return share * size[sensor], float(np.mean([b for _, b in known.values()]))


def _size(signals: Sequence[np.ndarray], channel: int) -> float:
    """Root mean square of a channel over all candidate runs [SI]."""
    return float(np.sqrt(np.mean(np.concatenate([s[..., channel].ravel() ** 2 for s in signals])))) + 1e-12


def _read_by_sensors(model: BumpModel, signals: Sequence[np.ndarray]) -> BumpModel:
    """The model with readings that are its own signals, those beyond a sensor's range left out."""
    limit = np.array([np.inf if s.full_scale is None else s.full_scale for s in model.layout.sensors])
    groups, arrays = [], []
    for group, group_arrays, shown in zip(model.groups, model.arrays, signals, strict=True):
        inside = group.measured & (np.abs(shown) <= limit)
        groups.append(RunGroup(group.runs, group.interval_s, shown, inside, group.censored))
        arrays.append(group_arrays._replace(value=shown, measured=inside.astype(float)))
    return replace(model, groups=tuple(groups), arrays=tuple(arrays))
