"""Readings that the sensors of a campaign would show of a known vehicle: noise, offset, gain, clipping, spikes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from sysid.campaign.quality.check import check_quality
from sysid.campaign.records import BumpRun, Campaign, Channel, Log, Sensor
from sysid.estimation.residuals.bump_model import GAIN_SD, bump_model
from sysid.estimation.residuals.run_motion import RunMotion
from sysid.estimation.residuals.run_paths import about_own_paths
from sysid.estimation.residuals.signals import simulate_runs
from sysid.road.road_profile import RoadProfile
from sysid.selftest.world import World

#: Integration step behind simulated readings [s], finer than that of a fit.
STEP_S = 0.000625
#: Length of a record before axle 1 meets the bump, and after the last axle has left it [s].
BEFORE_S, AFTER_S = 1.2, 2.5
#: Smallest length of a short record after that, if it is long enough for the passage [s].
LEAST_AFTER_S = 0.3
#: Noise of ordinary instruments [SI] where nothing better is known.
NOISE = {
    "suspension_deflection": 2.5e-4,
    "bellows_extension": 1e-3,
    "axle_acceleration": 0.25,
    "body_acceleration": 0.15,
    "pitch_rate": 2e-3,
}


@dataclass(frozen=True)
class Instruments:
    """How sensors err.

    `noise` standard deviation [SI] by column of the log; offsets are uniform within `offset_in_noises` of it, gains
    normal about one, `gain_spread` times as far off as a fit expects.  Successive noise values correlate by
    `correlation`; a share `outliers` of the readings is off by normal errors of `outlier_in_noises` times the noise.
    """

    noise: Mapping[str, float]
    offset_in_noises: float = 6.0
    correlation: float = 0.0
    outliers: float = 0.0
    outlier_in_noises: float = 10.0
    gain_spread: float = 1.0


def ordinary_instruments(campaign: Campaign) -> Instruments:
    """Ordinary noise for every sensor of the bump runs."""
    sensors = {c.sensor.column: c.sensor for run in campaign.bump_runs for c in run.log.channels}
    return Instruments({column: NOISE[sensor.kind] for column, sensor in sensors.items()})


def blank_run(run: BumpRun, sensors: tuple[Sensor, ...], seconds: float, interval_s: float) -> BumpRun:
    """The run with channels of zeros, `seconds` long."""
    time = np.arange(int(np.ceil(seconds / interval_s))) * interval_s
    empty, free = np.zeros(time.size), np.zeros(time.size, np.int8)
    channels = tuple(Channel(s, time, empty, free) for s in sensors)
    return replace(run, log=Log(run.log.file, interval_s, channels))


def with_usable_channels(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign without channels that the quality check rejects in logs that exist.

    Logs of which it leaves nothing, as those of zeros, say nothing of the sensors: they keep all channels, and their
    files are named.
    """
    runs, silent = [], []
    for run in campaign.bump_runs:
        kept = run.log.channels
        if run.log.duration_s > 0.0:
            checked, _ = check_quality(replace(campaign, bump_runs=(run,), plank_drops=()))
            if checked.bump_runs:
                kept = checked.bump_runs[0].log.channels
            else:
                silent.append(run.log.file)
        runs.append(replace(run, log=replace(run.log, channels=kept)))
    return replace(campaign, bump_runs=tuple(runs)), tuple(silent)


def as_logged(campaign: Campaign, profiles: Mapping[str, RoadProfile]) -> Campaign:
    """The campaign with blank records as long as its logs, and their sensors; runs without a log as planned."""
    runs = []
    for run in campaign.bump_runs:
        log = run.log
        if log.duration_s == 0.0:
            runs.append(_planned_run(campaign, run, profiles))
            continue
        seconds = (round(log.duration_s / log.sample_interval_s) + 0.5) * log.sample_interval_s
        runs.append(blank_run(run, tuple(c.sensor for c in log.channels), seconds, log.sample_interval_s))
    return replace(campaign, bump_runs=tuple(runs))


def planned_campaign(campaign: Campaign, profiles: Mapping[str, RoadProfile]) -> Campaign:
    """The campaign with blank records that are long enough for every run at its nominal speed."""
    return replace(campaign, bump_runs=tuple(_planned_run(campaign, run, profiles) for run in campaign.bump_runs))


def _planned_run(campaign: Campaign, run: BumpRun, profiles: Mapping[str, RoadProfile]) -> BumpRun:
    seconds = BEFORE_S + _way(campaign, run, profiles) / run.nominal_speed_m_s + AFTER_S
    return blank_run(run, tuple(c.sensor for c in run.log.channels), seconds, campaign.acquisition.sample_interval_s)


def _way(campaign: Campaign, run: BumpRun, profiles: Mapping[str, RoadProfile]) -> float:
    """How far the truck rolls from axle 1's touching the bump until the last axle has left it [m]."""
    return max(a.x_m for a in campaign.vehicle.axles) + profiles[run.bump].length_m + 1.0


def draw_motion(campaign: Campaign, profiles: Mapping[str, RoadProfile], random: np.random.Generator) -> RunMotion:
    """Speeds and their changes from their priors, at most two standard deviations off, and starts about a second in.

    In a record too short for that a run starts as early as its passage needs, but not in the first tenth.
    """
    nominal = np.array([r.expected_speed_m_s for r in campaign.bump_runs])
    spread = np.array([r.speed_sd for r in campaign.bump_runs])

    def off() -> np.ndarray:
        return np.clip(random.standard_normal(nominal.size), -2.0, 2.0)

    speed = nominal * (1.0 + spread * off())
    length = np.array([r.log.duration_s for r in campaign.bump_runs])
    way = np.array([_way(campaign, r, profiles) for r in campaign.bump_runs])
    start = BEFORE_S + random.uniform(-0.3, 0.3, nominal.size)
    change = np.array([r.speed_change_sd for r in campaign.bump_runs]) * off()
    slowest = speed * np.minimum(1.0, 1.0 + change)
    latest = np.maximum(length - way / slowest - LEAST_AFTER_S, 0.1 * length)
    return RunMotion(speed, np.minimum(start, latest), change)


def simulated_campaign(
    planned: Campaign,
    world: World,
    profiles: Mapping[str, RoadProfile],
    instruments: Instruments,
    random: np.random.Generator,
    speed_change: float | None = None,
) -> Campaign:
    """The planned campaign with the readings that its sensors would show of the world's vehicle.

    Parameters
    ----------
    planned : declared masses and blank records.
    world : the vehicle behind the readings.
    profiles : road profile of every bump.
    speed_change : relative change of speed in every run, None for changes drawn from their prior.
    """
    motion = draw_motion(planned, profiles, random)
    if speed_change is not None:
        motion = replace(motion, speed_change=np.full(motion.speed_m_s.size, speed_change))
    true = replace(world.campaign, bump_runs=planned.bump_runs)
    model = bump_model(true, world.parameters, profiles, target_step_s=STEP_S, roads=world.roads)
    model = about_own_paths(
        model,
        world.log_parameters,
        motion,
        lambda tires: bump_model(
            true, world.parameters, profiles, target_step_s=STEP_S, roads=world.roads.with_paths(tires.paths)
        ),
    )
    signals = simulate_runs(model, world.log_parameters, motion)
    position = {s.column: c for c, s in enumerate(model.layout.sensors)}
    runs = list(planned.bump_runs)
    for group, shown in zip(model.groups, signals, strict=True):
        for r, run in enumerate(group.runs):
            log = runs[run].log
            channels = tuple(
                measured(c, shown[: c.time_s.size, r, position[c.sensor.column]], instruments, random)
                for c in log.channels
            )
            runs[run] = replace(runs[run], log=replace(log, channels=channels))
    return replace(planned, bump_runs=tuple(runs))


def measured(channel: Channel, clean: np.ndarray, instruments: Instruments, random: np.random.Generator) -> Channel:
    """The channel with readings of a clean signal (T,) [SI]."""
    sensor = channel.sensor
    sd, rho = instruments.noise[sensor.column], instruments.correlation
    white = random.standard_normal(clean.size)
    white[1:] *= np.sqrt(1.0 - rho**2)
    noise = sd * lfilter([1.0], [1.0, -rho], white)
    spikes = random.uniform(size=clean.size) < instruments.outliers
    noise += spikes * instruments.outlier_in_noises * sd * random.standard_normal(clean.size)
    gain = 1.0 + instruments.gain_spread * GAIN_SD[sensor.kind] * random.standard_normal()
    value = gain * clean + instruments.offset_in_noises * sd * random.uniform(-1.0, 1.0) + noise
    limit = np.inf if sensor.full_scale is None else sensor.full_scale
    side = (value >= limit).astype(np.int8) - (value <= -limit).astype(np.int8)
    return replace(channel, value=np.clip(value, -limit, limit), censored=side)
