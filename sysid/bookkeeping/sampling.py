"""Aliasing: motion above half the rate is folded into the readings, where nothing tells it from slower motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sysid import limits
from sysid.campaign.gaps import readings_at
from sysid.campaign.records import AntiAliasFilter, BumpRun, Channel

#: A cut-off above this share of the rate leaves too little between itself and half the rate for a filter to act.
CUTOFF = 1.0 / 3.0
#: Part of half the rate above which power is looked for, and its density over the mean one: 0.0003 at most, the median
#: of all axles and runs of a campaign, on simulated trucks behind a filter at 0.3 of the rate.
NEAR_HALF, SHARE = 0.8, 0.03
_FEWEST = 3
#: Part of the record before the bump, for the noise.
_REST = 0.1


def sampling_complaints(runs: Sequence[BumpRun], low_pass: AntiAliasFilter | None) -> list[str]:
    """Sentences about a filter that cannot keep motion above half the rate away, and about motion near half the rate.

    Parameters
    ----------
    low_pass
        The declared anti-alias filter, None where there is none.
    """
    said = []
    rate_hz = min((1.0 / _step_s(channel) for run in runs for channel in run.log.channels), default=np.inf)
    if low_pass is not None and low_pass.cutoff_hz > CUTOFF * rate_hz:
        left = (1.0 + (0.5 * rate_hz / low_pass.cutoff_hz) ** (2 * low_pass.order)) ** -0.5
        said.append(
            f"acquisition.filter has cutoff_hz = {low_pass.cutoff_hz:g}, more than a third of the rate of the logs "
            f"({rate_hz:.4g} Hz): at half the rate it passes {left:.0%} of the motion, which is folded into the "
            "readings. Check cutoff_hz and the rate; sample faster, or filter lower."
        )
    shares = [share for run in runs for share in _near_half(run)]
    if len(shares) >= _FEWEST and float(np.median(shares)) > SHARE:
        said.append(
            f"Near half the rate of the logs ({rate_hz:.4g} Hz) the axles show {float(np.median(shares)):.0%} of their "
            "mean power density: there is motion above it, which is folded into the readings. Sample faster, or put an "
            "anti-alias filter in front of the logger."
        )
    return said


def _near_half(run: BumpRun) -> Iterator[float]:
    for channel in run.log.channels:
        if channel.sensor.kind == "axle_acceleration" and not channel.censored.any():
            share = _density_near_half(channel)
            if share is not None:
                yield share


def _density_near_half(channel: Channel) -> float | None:
    """Power density near half the channel's rate over the mean one, both without the noise; None beside gaps."""
    # Of its own clock: that of a log is its slowest.
    step_s = _step_s(channel)
    duration_s = float(channel.time_s[-1] - channel.time_s[0])
    if step_s <= 0.0 or not 200 <= duration_s / step_s < limits.GRID_STEPS:
        return None
    time = float(channel.time_s[0]) + step_s * np.arange(int(duration_s / step_s) + 1)
    value = readings_at(channel, time)
    density = _density(value)
    noise = _density(value[: int(_REST * value.size)])
    if density is None or noise is None:
        return None
    floor = noise[int(NEAR_HALF * noise.size) :].mean()
    whole = density.mean() - floor
    return float((density[int(NEAR_HALF * density.size) :].mean() - floor) / whole) if whole > floor else None


def _step_s(channel: Channel) -> float:
    return float(np.median(np.diff(channel.time_s))) if channel.time_s.size > 1 else np.inf


def _density(value: np.ndarray) -> np.ndarray | None:
    """Power density (F,) of readings, None beside gaps or where they are too few."""
    if value.size < 20 or not np.isfinite(value).all():
        return None
    taper = np.hanning(value.size)
    return np.asarray(np.abs(np.fft.rfft((value - value.mean()) * taper)) ** 2 / np.sum(taper**2))
