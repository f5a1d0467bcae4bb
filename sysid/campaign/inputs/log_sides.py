"""Sensors on the left and right of the same place become one channel, their mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.campaign.clipping import mark_clipped
from sysid.campaign.gaps import readings_at
from sysid.campaign.records import AUXILIARY_KINDS, Channel
from sysid.campaign.zero_phase import low_passed
from sysid.wording import shorten

SIDE_DISAGREEMENT = 0.3  # roll makes left and right differ by less than this on a bump taken straight
#: A bump is crossed by both sides within this time [s]: 0.2 m at walking pace.
_LATEST_S = 0.1
#: Below this the whole truck moves, above it the axles tramp [Hz]; how far above the noise the motion is clear there,
#: and how many readings are enough.
_SLOW_HZ, _CLEAR, _LEAST = 3.0, 5.0, 60
#: Correlations of sides that move alike, and the other way round; factor by which equal sides do not differ.
_ALIKE, _SURELY, _FACTOR = 0.8, 0.5, 1.9
#: Roll is not worth a word where it is less than this part of all that the sides show: axles hop more than they heave.
_LITTLE = 0.15


def join_sides(channels: list[Channel], label: str, messages: list[str]) -> list[Channel]:
    """Channels with every pair replaced by its mean; what is to be said about pairs goes to `messages`."""
    result: list[Channel] = []
    used: set[int] = set()
    for i, one in enumerate(channels):
        if i in used:
            continue
        other = next((j for j in range(i + 1, len(channels)) if j not in used and _is_pair(one, channels[j])), None)
        if other is None:
            result.append(one)
            continue
        used.add(other)
        result.append(_mean_of_sides(one, channels[other], label, messages))
    return result


def _is_pair(one: Channel, two: Channel) -> bool:
    a, b = one.sensor, two.sensor
    place = (a.kind, a.axle, a.body, a.x_m) == (b.kind, b.axle, b.body, b.x_m)
    return place and {a.side, b.side} == {"left", "right"}


def _mean_of_sides(one: Channel, two: Channel, label: str, messages: list[str]) -> Channel:
    names = f"'{shorten(one.sensor.column)}' and '{shorten(two.sensor.column)}'"
    for dead, alive in ((one, two), (two, one)):
        seen = dead.value[np.isfinite(dead.value)]
        still = one.sensor.kind not in AUXILIARY_KINDS and seen.size > 0 and np.ptp(seen) == 0.0
        if seen.size < 0.5 * dead.value.size or still:
            messages.append(
                f"{label}: of the pair {names} only '{shorten(alive.sensor.column)}' is used; the other side shows "
                "nothing."
            )
            return alive
    if one.sensor.kind not in AUXILIARY_KINDS:
        # The mean of a clipped and a whole side has no flat top by which it could be seen later.
        one, two = (_with_clipping(side, label, messages) for side in (one, two))
    two = _at_times_of(one, two)
    mean = 0.5 * (one.value + two.value)
    said = _disagreement(one, two)
    if said:
        messages.append(f"{label}: left and right ({names}) {said}")
    # A bound on one side bounds the mean only if the other side does not point the opposite way.
    upper = (one.censored == 1) | (two.censored == 1)
    lower = (one.censored == -1) | (two.censored == -1)
    mean[upper & lower] = np.nan
    censored = np.where(upper, 1, np.where(lower, -1, 0)).astype(np.int8)
    censored[upper & lower] = 0
    scales = [s.full_scale for s in (one.sensor, two.sensor) if s.full_scale is not None]
    sensor = replace(
        one.sensor,
        column=f"{one.sensor.column}+{two.sensor.column}",
        side=None,
        y_m=None,
        full_scale=min(scales) if len(scales) == 2 else None,
    )
    return Channel(sensor, one.time_s, mean, censored)


def _with_clipping(side: Channel, label: str, messages: list[str]) -> Channel:
    """The side with readings marked where it clips without having declared a range."""
    if side.censored.any():
        return side
    censored = side.censored.copy()
    level = mark_clipped(side.value, censored)
    if level is None:
        return side
    shown = f"{level / side.sensor.unit_in_si:.4g} {side.sensor.unit}"
    messages.append(
        f"{label}: '{shorten(side.sensor.column)}' is clipped at {shown}; "
        f"{np.count_nonzero(censored)} readings count as bounds. Give its range."
    )
    return replace(side, censored=censored)


def _disagreement(one: Channel, two: Channel) -> str | None:
    """How two sides differ, as the rest of a sentence; None where they do not differ by more than roll makes them."""
    both = np.isfinite(one.value) & np.isfinite(two.value) & (one.censored == 0) & (two.censored == 0)
    if np.count_nonzero(both) < 2:
        return None
    if one.sensor.kind in AUXILIARY_KINDS:
        # What does not vibrate is compared by its level.
        left, right = one.value[both], two.value[both]
        spread, size = _rms(left - right), _rms(0.5 * (left + right))
        if spread <= SIDE_DISAGREEMENT * 2.0 * size:
            return None
        return f"differ by {spread / max(size, 1e-300):.1f} times the size of their mean; check unit and scale of both."
    return _moved_apart(one, two, both)


def _moved_apart(one: Channel, two: Channel, both: np.ndarray) -> str | None:
    """How the slow motion of two sides differs, as the rest of a sentence; None where it is the same.

    One side meets a bump before the other where it is crossed at an angle, and axles tramp: so the second is put on the
    arrival of the first, and both are compared below :data:`_SLOW_HZ`, if they show more there than noise.
    """
    step_s = float(np.median(np.diff(one.time_s)))
    filled = [np.interp(c.time_s, c.time_s[both], c.value[both]) for c in (one, two)]
    left, right = (x - x.mean() for x in filled)
    most = round(_LATEST_S / step_s)
    # A wrong sign must not look like a late arrival.
    shift, _ = max((_best_shift(left, sign * right, most) for sign in (1.0, -1.0)), key=lambda found: found[1])
    left, right = left[max(-shift, 0) : left.size - max(shift, 0)], right[max(shift, 0) :][: left.size - abs(shift)]
    if left.size < _LEAST or _SLOW_HZ * step_s > 0.2:
        return None
    noise = max(_noise(x) for x in (left, right)) * np.sqrt(2.0 * _SLOW_HZ * step_s)
    whole, in_all = 0.5 * float(np.std(left + right)), float(np.std(right) / max(float(np.std(left)), 1e-300))
    left, right = (low_passed(x, 2, 2.0 * _SLOW_HZ * step_s) for x in (left, right))
    spread, sizes = float(np.std(left - right)), (float(np.std(left)), float(np.std(right)))
    # The mean of sides that move against each other is nothing.
    size = max(float(np.std(0.5 * (left + right))), 0.5 * min(sizes))
    if min(sizes) < _CLEAR * noise or spread <= SIDE_DISAGREEMENT * 2.0 * size:
        return None
    apart = f"differ below {_SLOW_HZ:g} Hz by {spread / size:.1f} times the size of their mean; "
    ratio = sizes[1] / sizes[0]
    # Sides that move against each other, by all that they show, have no mean.
    little = spread < _LITTLE * whole
    if not little and _correlation(left, right) < -_SURELY:
        return f"{apart}they move against each other: check the sign of both sensors."
    alike = _correlation(left, right) >= _ALIKE
    usual = [1.0 / _FACTOR < factor < _FACTOR for factor in (ratio, in_all)]
    if alike and not usual[0] and not (little and usual[1]):
        return f"{apart}the second reads {ratio:.3g} times the first: check unit and scale of both sensors."
    if little:
        return None
    if not alike:
        return f"{apart}they move differently, as where the truck rolls or one of them is loose; their mean is used."
    return f"{apart}their shape is the same: the truck rolls, or one of them is mounted elsewhere; their mean is used."


def _noise(values: np.ndarray) -> float:
    """Standard deviation of readings from one to the next, from the median of their second differences."""
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6.0)))


def _best_shift(left: np.ndarray, right: np.ndarray, most: int) -> tuple[int, float]:
    """Steps by which the second follows the first, and their correlation then."""
    shifts = range(-min(most, left.size // 4), min(most, left.size // 4) + 1)
    found = {s: _correlation(left[max(-s, 0) : left.size - max(s, 0)], right[max(s, 0) :][: left.size - abs(s)])
             for s in shifts}  # fmt: skip
    best = max(found, key=lambda s: (round(found[s], 3), -abs(s)))
    return best, found[best]


def _correlation(one: np.ndarray, two: np.ndarray) -> float:
    a, b = one - one.mean(), two - two.mean()
    return float(a @ b / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300))


def _at_times_of(one: Channel, two: Channel) -> Channel:
    """The second channel at the times of the first, where it has another clock; clipped readings stay clipped."""
    if one.time_s.size == two.time_s.size and np.array_equal(one.time_s, two.time_s):
        return two
    nearest = np.clip(np.searchsorted(two.time_s, one.time_s), 0, two.time_s.size - 1)
    value = readings_at(two, one.time_s)
    return replace(two, time_s=one.time_s, value=value, censored=np.where(np.isfinite(value), two.censored[nearest], 0))


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
