"""Air pressure of a bellows as a measure of its extension, by the gas law.

Constant area A and enclosed air: p V^n = const with V = V_0 + A e, so (p_0 / p)^(1/n) - 1 = e A / V_0, absolute
pressures, exact at any size of the motion. Times the usual height V_0 / A it is an extension whose factor is not known:
the fit eliminates it like the gain of a sensor. Hoses, heat and an area that changes with height are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.campaign.clipping import quantum
from sysid.campaign.records import BumpRun, Campaign, Channel, Log, Sensor
from sysid.wording import shorten

#: Absolute pressure where a gauge reads zero [Pa].
ATMOSPHERE_PA = 101_325.0
#: Polytropic exponent of air that is nearly adiabatic at 1 to 4 Hz (VDI 2062-2 gives 1.38 for air springs).
POLYTROPIC = 1.38
#: Usual height V_0 / A of truck bellows with their additional volume [m].
USUAL_HEIGHT_M = 0.25
#: Steps of a pressure that count as no longer than those of the other sensors.
_AS_FAST = 1.05
#: Least swing of a pressure that shows the motion, in steps of its resolution.
_LEVELS = 20
#: Correlation with the deflection at the same axle from which the two move against each other.
_AGAINST = -0.7


def with_bellows(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """Runs with a channel of extension for every pressure that shows it, and sentences about those that do not.

    Parameters
    ----------
    campaign : after the quality check of its channels.
    """
    refused: dict[str, dict[str, list[str]]] = {}
    runs: list[BumpRun] = []
    for run in campaign.bump_runs:
        made = []
        for channel in run.log.auxiliary:
            there = any(_same(channel.sensor, c.sensor) for c in run.log.channels)
            if channel.sensor.kind != "air_pressure" or there:
                continue
            why = _refusal(channel, run.log)
            if why:
                refused.setdefault(channel.sensor.column, {}).setdefault(why, []).append(run.log.file)
            else:
                made.append(extension(channel))
        log = replace(run.log, channels=(*run.log.channels, *made)) if made else run.log
        runs.append(replace(run, log=log) if made else run)
    said = tuple(
        f"{files[0]}{f' and {len(files) - 1} more logs' if len(files) > 1 else ''}: the air pressure "
        f"'{shorten(column)}' is used at rest only: {why}."
        for column, of_column in refused.items()
        for why, files in of_column.items()
    )
    return replace(campaign, bump_runs=tuple(runs)), said


def _same(pressure: Sensor, other: Sensor) -> bool:
    return other.kind == "bellows_extension" and other.column == pressure.column


def extension(channel: Channel) -> Channel:
    """Extension [m] of a bellows of usual height from its gauge pressure [Pa]; its level at rest is zero.

    e = H ((p_0 / p)^(1/n) - 1), with H the usual height, n the polytropic exponent and p_0 the median of p, absolute.
    """
    absolute = channel.value + ATMOSPHERE_PA
    at_rest = float(np.nanmedian(absolute))
    value = USUAL_HEIGHT_M * ((at_rest / absolute) ** (1.0 / POLYTROPIC) - 1.0)
    sensor = replace(channel.sensor, kind="bellows_extension", unit="m", sign=1, scale=1.0, full_scale=None)
    # A pressure at its upper limit is an extension at its lower one.
    return Channel(sensor, channel.time_s, value, (-channel.censored).astype(np.int8))


def _refusal(channel: Channel, log: Log) -> str:
    """Why a pressure does not show the motion of its axle; empty where it does."""
    good = np.isfinite(channel.value)
    if good.sum() < 50 or not log.channels:
        return "it has too few readings"
    value, time = channel.value[good], channel.time_s
    if float(np.median(np.diff(time))) > _AS_FAST * log.sample_interval_s:
        return "it is sampled more slowly than the other sensors"
    low, high = np.percentile(value, [0.5, 99.5])
    if high - low <= _LEVELS * quantum(value):
        return "its resolution is too coarse for the motion on the bump"
    if float(np.median(value)) < 0.2 * ATMOSPHERE_PA:
        return "the bellows hold no pressure"
    deflection = _deflection(log.channels, channel.sensor.axle)
    if deflection is not None and _correlation(extension(channel), deflection, log.sample_interval_s) < _AGAINST:
        return (
            f"it rises where '{shorten(deflection.sensor.column)}' shows that the suspension extends; check at which "
            "axle it is, and the signs"
        )
    return ""


def _deflection(channels: Sequence[Channel], axle: int | None) -> Channel | None:
    return next((c for c in channels if c.sensor.kind == "suspension_deflection" and c.sensor.axle == axle), None)


def _correlation(one: Channel, two: Channel, step: float) -> float:
    """Correlation of the changes over a tenth of a second; 0 where they share too little."""
    lag = max(1, round(0.1 / step))
    good = np.isfinite(two.value)
    if good.sum() < 50:
        return 0.0
    a = one.value
    b = np.interp(one.time_s, two.time_s[good], two.value[good])
    change = np.stack([a[lag:] - a[:-lag], b[lag:] - b[:-lag]])
    change = change[:, np.isfinite(change).all(axis=0)]
    if change.shape[1] < 50 or (change.std(axis=1) == 0.0).any():
        return 0.0
    return float(np.corrcoef(change)[0, 1])
