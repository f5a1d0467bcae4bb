"""Logged speeds as evidence on the motion of the runs: what each sensor reads, in units of the true speed, and when.

A wheel or tachograph reads a share too much or too little, the same in all runs, and a GPS shows the speed late. The
factor g of a sensor follows from the runs whose axles show their speed u by the moments at which they meet the bump:

    ln g ~ N(0, FACTOR_SD^2),   ln(w_i / u_i) ~ N(ln g, s_i^2 + ARRIVALS_SD^2),

with w_i the mean of the readings during the passage and s_i its own relative standard deviation: of the unknown delay,
the resolution and the noise. The prior of the speed of run i is w_i / g by the factor of the other runs, so that no
arrival counts twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.findings import SpeedSensorFinding
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.passage.logged_speed import STANDING_M_S, shaken_at, speed_channels
from sysid.campaign.passage.speed import DOUBTFUL, believed_speed, speed_complaint
from sysid.campaign.records import BumpRun, Campaign, Channel
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten

#: Relative standard deviations: of a sensor's factor before any run is driven (tire wear, an unset tachograph: some
#: per cent), and of the speed that the arrivals of the axles show.
FACTOR_SD, ARRIVALS_SD = 0.03, 0.03
#: Delays that are tried [s]: a wheel sensor has none, a GPS up to half a second.
_DELAYS_S = (0.0, 0.25, 0.5)
#: What no sensor is better than: the speed of the body is not that of the wheels on a bump.
_LEAST_SD = 0.003
#: Readings further apart than this say nothing of a passage between them [s].
_FAR_S = 2.0
#: How many standard deviations of a reading make a change of speed certain, and how many of its prior unusual.
_SURE, _CHANGED = 3.0, 2.5
#: Factors that units are apart, and what the declared one should have been, by what the sensor reads.
_UNITS = {"km/h": 3.6, "mph": 3.6 / 1.609344, "m/s": 1.0, "knot": 3.6 / 1.852, "ft/s": 1.0 / 0.3048}
_NEAR_UNIT = 0.05


@dataclass(frozen=True)
class _Reading:
    """Logged speed of one run: mean [m/s], its relative standard deviation, and relative change with its own.

    The change counts from the arrival of axle 1 to that of the last axle.
    """

    mean_m_s: float
    sd: float
    change: float
    change_sd: float


@dataclass(frozen=True)
class LoggedSpeeds:
    """The campaign with the speeds that its sensors show, what they read, and sentences.

    `logged_m_s` are the readings of the runs, by file, as they stand in the logs.
    """

    campaign: Campaign
    sensors: tuple[SpeedSensorFinding, ...] = ()
    messages: tuple[str, ...] = ()
    logged_m_s: Mapping[str, float] | None = None


def with_logged_speeds(campaign: Campaign) -> LoggedSpeeds:
    """Runs that know the speed which their sensors show, where that says more than the listed one.

    Parameters
    ----------
    campaign : after the quality check of its channels.

    Returns
    -------
    LoggedSpeeds
        Runs have `logged_speed_m_s`, the reading over the sensor's factor, and its `speed_sd`; a change of speed that
        the sensor shows widens `speed_change_sd`. Without a speed sensor the campaign as it is.
    """
    if not any(speed_channels(run.log) for run in campaign.bump_runs):
        return LoggedSpeeds(campaign)
    measured: dict[int, float] = {}
    readings: dict[str, dict[int, _Reading]] = {}
    units: dict[str, str] = {}
    for i, run in enumerate(campaign.bump_runs):
        channels = speed_channels(run.log)
        if not channels:
            continue
        window, speed = _window(run, campaign.vehicle)
        if speed is not None:
            measured[i] = speed
        for channel in channels:
            reading = _read(channel, window)
            if reading is not None:
                readings.setdefault(channel.sensor.column, {})[i] = reading
                units[channel.sensor.column] = channel.sensor.unit
    said: list[str] = []
    findings: list[SpeedSensorFinding] = []
    runs = list(campaign.bump_runs)
    logged: dict[str, float] = {}
    for column, of_runs in readings.items():
        for i, reading in of_runs.items():
            logged.setdefault(runs[i].log.file, reading.mean_m_s)
        complaint = _sensor_complaint(column, units[column], of_runs, measured, campaign.bump_runs)
        if complaint:
            said.append(complaint)
            continue
        log_factor, sd = _factor(of_runs, measured)
        shown = sum(i in measured for i in of_runs)
        findings.append(SpeedSensorFinding(column, float(np.exp(log_factor)), sd, shown))
        for i, reading in of_runs.items():
            others = {j: r for j, r in of_runs.items() if j != i}
            by_others, factor_sd = _factor(others, measured)
            run, room = _with_change(runs[i], column, reading)
            # The prior is that of the speed at axle 1.
            changed = reading.change if room else 0.0
            speed = reading.mean_m_s * float(np.exp(-by_others)) / (1.0 + 0.5 * changed)
            complaint = _run_complaint(runs[i], column, speed, measured.get(i), campaign.vehicle)
            if complaint:
                said.append(complaint)
                continue
            if room:
                said.append(room)
            of_change = 0.5 * min(reading.change_sd, run.speed_change_sd)
            sd_of_run = float(np.sqrt(reading.sd**2 + factor_sd**2 + of_change**2))
            if sd_of_run < run.speed_sd or (run.logged_speed_m_s is None and not run.speed_listed):
                run = replace(run, logged_speed_m_s=speed, speed_sd=sd_of_run)
            runs[i] = run
    return LoggedSpeeds(replace(campaign, bump_runs=tuple(runs)), tuple(findings), tuple(said), logged)


def _window(run: BumpRun, vehicle: Vehicle) -> tuple[tuple[float, float], float | None]:
    """Begin and end [s] of the passage of the axles, and their speed [m/s], None where they do not show it."""
    passage = find_passage(run.log.channels, vehicle, run.nominal_speed_m_s)
    speed = believed_speed(passage, vehicle)
    if passage is not None and speed is not None:
        times = [arrival.time_s for arrival in passage.arrivals.values()]
        return (min(times), max(times)), speed
    time = shaken_at(run.log.channels)
    middle = 0.5 * run.log.duration_s if time is None else time
    half = 0.5 * max(a.x_m for a in vehicle.axles) / run.nominal_speed_m_s
    return (middle - half, middle + half), None


def _read(channel: Channel, window: tuple[float, float]) -> _Reading | None:
    """Mean and change of the readings between two times [s] of the passage, for a delay that is not known."""
    good = np.isfinite(channel.value)
    time, value = channel.time_s[good], np.abs(channel.value[good])
    if time.size == 0:
        return None
    begin, end = window
    nearest = np.abs(time - 0.5 * (begin + end) - _DELAYS_S[1]).min()
    if nearest > max(_FAR_S, 0.5 * (end - begin)):
        return None
    grid = np.linspace(begin, end, 51)
    shown = [np.interp(grid + delay, time, value) for delay in _DELAYS_S]
    mean = float(np.mean(shown))
    if mean < STANDING_M_S:
        return None
    inside = (time >= begin) & (time <= end + _DELAYS_S[-1])
    count = int(np.unique(value[inside]).size) if inside.any() else 1
    slope, level = np.polyfit(grid, shown[1], 1)
    noise = float(np.std(value[inside] - (level + slope * (time[inside] - _DELAYS_S[1])))) if inside.any() else 0.0
    steps = np.diff(np.unique(np.round(value, 6)))
    resolution = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    of_delay = float(np.std([s.mean() for s in shown]))
    sd = float(np.sqrt(of_delay**2 + noise**2 / max(count, 1) + min(resolution, 0.05 * mean) ** 2))
    relative = float(np.hypot(sd / mean, _LEAST_SD))
    change_sd = np.sqrt(12.0 * (noise**2 + resolution**2) / max(count, 1)) / mean
    return _Reading(mean, relative, float(slope * (end - begin)) / mean, float(change_sd) + _LEAST_SD)


def _factor(readings: Mapping[int, _Reading], measured: Mapping[int, float]) -> tuple[float, float]:
    """Logarithm of the factor of a sensor from its runs, and its standard deviation."""
    precision, weighted = FACTOR_SD**-2, 0.0
    for i, reading in readings.items():
        if i in measured:
            weight = 1.0 / (reading.sd**2 + ARRIVALS_SD**2)
            precision += weight
            weighted += weight * float(np.log(reading.mean_m_s / measured[i]))
    return weighted / precision, float(precision**-0.5)


def _sensor_complaint(
    column: str, unit: str, readings: Mapping[int, _Reading], measured: Mapping[int, float], runs: Sequence[BumpRun]
) -> str:
    """A sentence where all runs say that the sensor reads another speed; then none of its readings is used."""
    by_axles = [float(np.log(r.mean_m_s / measured[i])) for i, r in readings.items() if i in measured]
    by_list = [
        float(np.log(r.mean_m_s / runs[i].nominal_speed_m_s)) for i, r in readings.items() if runs[i].speed_listed
    ]
    ratios, against = (by_axles, "the axles meet the bump") if by_axles else (by_list, "the runs are listed")
    if not ratios or (not by_axles and len(ratios) < 2):
        return ""
    middle = float(np.median(ratios))
    if abs(middle) < DOUBTFUL or float(np.median(np.abs(np.array(ratios) - middle))) > DOUBTFUL:
        return ""
    factor = float(np.exp(middle))
    true = next((u for u, f in _UNITS.items() if abs(middle - np.log(f / _UNITS[unit])) < _NEAR_UNIT), None)
    what = (
        f"its readings look like {true}, so set unit = '{true}'"
        if true is not None
        else f"give it scale = {1.0 / factor:.3g}, or correct the axle positions x_m if they are wrong"
        if by_axles
        else "correct its unit or scale, or nominal_speed_km_h of these runs"
    )
    return (
        f"The speed sensor '{shorten(column)}' reads {factor:.3g} times the speed at which {against}, in {len(ratios)} "
        f"run{'s' if len(ratios) > 1 else ''}: {what}. Its readings are not used."
    )


def _run_complaint(run: BumpRun, column: str, speed: float, measured: float | None, vehicle: Vehicle) -> str:
    """A sentence where one run is driven at another speed than is listed, by its sensor."""
    ratio = speed / run.nominal_speed_m_s
    if not run.speed_listed or abs(np.log(ratio)) < DOUBTFUL or speed_complaint(run, vehicle) is not None:
        return ""
    looks = {"m/s": 3.6, "mph": 1.609344, "knots": 1.852}
    unit = next((u for u, f in looks.items() if abs(np.log(ratio / f)) < _NEAR_UNIT), None)
    likely = f", which looks like {unit}" if unit else ""
    if measured is not None and abs(np.log(measured / run.nominal_speed_m_s)) < DOUBTFUL:
        remedy = "the axles meet the bump as listed, so the sensor is not used in this run; check it"
    else:
        remedy = "correct nominal_speed_km_h, or check that this is the log of that run; the listed speed is used"
    return (
        f"{run.log.file}: '{shorten(column)}' logs {3.6 * speed:.3g} km/h at the bump, but "
        f"{3.6 * run.nominal_speed_m_s:.3g} km/h are listed{likely}; {remedy}."
    )


def _with_change(run: BumpRun, column: str, reading: _Reading) -> tuple[BumpRun, str]:
    """The run with room for the change of speed that its sensor shows, and a sentence; empty where that is small."""
    change = abs(reading.change)
    if run.speed_change_sd == 0.0 or change < max(_CHANGED * run.speed_change_sd, _SURE * reading.change_sd):
        return run, ""
    sd = min(change, 0.5)
    sentence = (
        f"{run.log.file}: by '{shorten(column)}' the speed changes by {100.0 * reading.change:+.0f} % during the "
        f"passage; speed_change_sd of this run is taken as {sd:.2g} in place of {run.speed_change_sd:g}."
    )
    return replace(run, speed_change_sd=sd), sentence
