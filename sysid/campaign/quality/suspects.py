"""Which sensor of a log has a wrong unit, a wrong sign or another sensor's column, and the remedy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from sysid.campaign.gaps import parted
from sysid.campaign.passage.arrivals import find_passage
from sysid.campaign.quality import defects
from sysid.campaign.quality.exchanges import Suspicion, accuse, find_exchanges, inverted_axles, quoted
from sysid.campaign.quality.sensor_trios import Fit, Trio, arrival, first_lift, fit_factors, trios
from sysid.campaign.records import Channel, Log, Sensor
from sysid.campaign.units import si_factor
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten

_ACTUAL_UNITS = {"length": ("m", "cm", "mm", "in"), "acceleration": ("m/s^2", "g", "mg", "mm/s^2")}
# Largest departures [SI] that sensors of road vehicles show on a bump or plank, with room to spare on both sides:
# assumptions; axles reach 100 to 200 m/s2 on a bump of 90 mm in simulation.
_PLAUSIBLE = {
    "suspension_deflection": (1e-3, 0.5),
    "axle_acceleration": (0.2, 600.0),
    "body_acceleration": (0.05, 300.0),
    "pitch_rate": (1e-3, 12.0),
    "bellows_extension": (1e-4, 2.0),
}
# Mixing up g and m/s^2 or mm and m is common, the rest is not.
_UNIT_COST: dict[str | None, float] = {
    "m/s^2": 0.9,
    "g": 0.9,
    "m": 1.0,
    "mm": 1.0,
    "cm": 1.3,
    "in": 1.3,
    "mg": 1.2,
    "mm/s^2": 1.5,
}
_ON_TIME_M = 0.3  # an axle that meets the bump further from its place is another one
_SPEED_RIGHT = 0.3  # |ln| of measured over listed speed up to which places and units count as right
_MATCH = 0.5  # |ln| between found and expected factor; units differ by ln 9.8 = 2.3 and more


@dataclass(frozen=True)
class _Cause:
    factor: float
    unit: str | None


def suspicions(
    log: Log,
    channels: Sequence[Channel],
    vehicle: Vehicle,
    rests: Mapping[str, float],
    bump_speed: float | None,
    falling: frozenset[int] = frozenset(),
) -> dict[str, list[Suspicion]]:
    """Examine the channels of one log together.

    Parameters
    ----------
    log : the log, for its sample interval.
    channels : its channels without dead ones.
    vehicle : says which sensors belong together.
    rests : rest level of each column [SI].
    bump_speed : nominal speed over a bump [m/s], which lifts the axles first, one after the other; None for a plank
        drop, where the axle falls first.
    falling : axles that other runs show with the wrong sign, from `axles_shown_falling`.

    Returns
    -------
    dict
        Column to suspicions; empty for a healthy log.
    """
    step = log.sample_interval_s
    suspects: dict[str, list[Suspicion]] = {}
    groups = trios(channels, vehicle)
    fits = {t.axle: fit_factors(t.deflection, t.axle_acceleration, t.body_acceleration, step) for t in groups}
    confirmed: set[str] = set()
    wrong, unclear = [], []
    for trio in groups:
        fit = fits[trio.axle]
        if fit is None:
            continue
        if not fit.right:
            wrong.append(trio)
        elif fit.clear and fit.unexplained < 0.5:
            confirmed |= {c.sensor.column for c in trio.channels}
        elif fit.unexplained > 0.5:
            unclear.append(trio)
    expected_lift = -1.0 if bump_speed is None else 1.0
    lifts = [_lift(t.axle_acceleration, rests) * expected_lift for t in groups]
    inverted = None if bump_speed is None else inverted_axles(groups, vehicle, rests, bump_speed)
    settled = find_exchanges(wrong + unclear, groups, fits, inverted, vehicle, step, suspects)
    for trio in wrong:
        fit = fits[trio.axle]
        if trio.axle not in settled and fit is not None:
            lift, median = lifts[groups.index(trio)], float(np.median(lifts))
            misplaced = partial(_misplaced, trio.axle, channels, vehicle, bump_speed)
            _explain(trio, fit, _Evidence(_shared(fit, fits), lift, median, misplaced), suspects)
    if bump_speed is not None:
        if not _lifted(channels, vehicle, bump_speed):
            _all_flipped(groups, fits, lifts, suspects)
        _axles_flipped(groups, fits, falling, vehicle, suspects)
    for channel in channels:
        column = channel.sensor.column
        if column not in suspects and column not in confirmed:
            _implausible(channel, rests.get(column), suspects)
    return suspects


def _lift(channel: Channel, rests: Mapping[str, float]) -> float:
    rest_level = rests.get(channel.sensor.column, 0.0)
    time = arrival(channel, rest_level)
    return 0.0 if time is None else first_lift(channel, rest_level, time)


@dataclass(frozen=True)
class _Evidence:
    """Evidence from the other axles: whether factors are the same, and how clearly axles rise first (1) or fall.

    `misplaced`: whether the axle meets the bump elsewhere than at its place, where another frame sensor is above it.
    """

    shared: bool
    lift: float
    median_lift: float
    misplaced: Callable[[], bool]


def _shared(fit: Fit, fits: Mapping[int, Fit | None]) -> bool:
    """Whether most axles of the log show these factors: then a convention is wrong, not one sensor."""
    known = [f for f in fits.values() if f is not None]
    alike = [f for f in known if _near(f.alpha, fit.alpha) and _near(f.beta, fit.beta)]
    return len(alike) > 0.65 * len(known)


def _explain(trio: Trio, fit: Fit, evidence: _Evidence, suspects: dict[str, list[Suspicion]]) -> None:
    members = trio.channels
    explanations: list[tuple[float, tuple[_Cause, ...]]] = []
    if fit.clear and fit.unexplained < 0.6:
        for causes in product(*(_causes(c.sensor) for c in members)):
            cost = _cost(trio, fit, causes, evidence)
            if cost is not None:
                explanations.append((cost, causes))
    if not explanations:
        if not evidence.misplaced():
            _disagreement(trio, fit, suspects)
        return
    lowest = min(cost for cost, _ in explanations)
    likely = [causes for cost, causes in explanations if cost < lowest + 0.05]
    for causes in likely:
        for channel, cause in zip(members, causes, strict=True):
            if cause.factor != 1.0:
                accuse(suspects, channel.sensor, _accusation(channel.sensor, cause, len(likely) > 1))


def _causes(sensor: Sensor) -> list[_Cause]:
    causes = [_Cause(1.0, None), _Cause(-1.0, None)]
    for unit in _ACTUAL_UNITS[sensor.dimension]:
        factor = sensor.unit_in_si / si_factor(unit, sensor.dimension)
        if abs(np.log(factor)) > 0.1:
            causes += [_Cause(factor, unit), _Cause(-factor, unit)]
    return causes


def _cost(trio: Trio, fit: Fit, causes: Sequence[_Cause], evidence: _Evidence) -> float | None:
    """How improbable an explanation is: the number of faults, implausible sizes, a wrong first motion."""
    q, a = causes[0].factor, causes[1].factor
    b = causes[2].factor if len(causes) > 2 else None
    if not _near(fit.alpha, q / a) or (b is not None and not _near(fit.beta, q / b)):
        return None
    cost = 0.0
    for index, (channel, cause) in enumerate(zip(trio.channels, causes, strict=True)):
        low, high = _PLAUSIBLE[channel.sensor.kind]
        if cause.factor != 1.0 and not low <= _size(channel) / abs(cause.factor) <= high:
            cost += 3.0
        # Accelerometers that share a wrong convention on every axle are one mistake, not one per sensor.
        if not (index == 2 and evidence.shared and np.isclose(a, cause.factor)):
            cost += _UNIT_COST.get(cause.unit, 0.0) + (0.8 if cause.unit else 1.0) * (cause.factor < 0.0)
    if b is None:
        # Deflection and axle sensor alone cannot tell which of them is flipped; the first motion of the axle can.
        if abs(evidence.lift) > 0.5 and evidence.lift * a < 0.0:
            cost += 0.5
    elif evidence.shared and abs(evidence.median_lift) > 0.5 and evidence.median_lift * a < 0.0:
        cost += 1.5
    return cost


def _near(value: float, expected: float) -> bool:
    return value * expected > 0.0 and abs(np.log(value / expected)) < _MATCH


def _size(channel: Channel) -> float:
    good = channel.value[np.isfinite(channel.value)]
    return float(np.max(np.abs(good - np.median(good)))) if good.size else 0.0


def _accusation(sensor: Sensor, cause: _Cause, alternatives: bool) -> str:
    others = "the other sensors of its axle"
    if cause.unit is None:
        what = f"{quoted(sensor)} moves opposite to {others}: its sign is flipped"
        remedy = "multiply the column by -1 in the file, or turn the sensor"
    else:
        flipped = " with a flipped sign" if cause.factor < 0.0 else ""
        what = (
            f"{quoted(sensor)} reads {abs(cause.factor):.3g} times what {others} imply: the file is in "
            f"{cause.unit}{flipped}, not in {sensor.unit}"
        )
        remedy = f'set unit = "{cause.unit}" for it in campaign.toml' + (
            " and multiply the column by -1" if flipped else ""
        )
    doubt = " (or the same fault of another sensor of this axle)" if alternatives else ""
    return f"{what}{doubt}; {remedy}."


def _disagreement(trio: Trio, fit: Fit, suspects: dict[str, list[Suspicion]]) -> None:
    """A gain that no unit explains, or a deflection that follows neither sensor: reported, but without a verdict."""
    if any(c.censored.any() for c in trio.channels):
        return
    q, a, b = trio.deflection, trio.axle_acceleration, trio.body_acceleration
    if b is None and 0.4 < fit.alpha < 2.5:
        return  # the frame is not still, and nothing says how much it moves
    if fit.unexplained < 0.3 and fit.clear:
        if b is None or abs(fit.alpha / fit.beta - 1.0) < 0.2:
            sensor, factor = q.sensor, fit.alpha
        elif abs(fit.beta - 1.0) < 0.2:
            sensor, factor = a.sensor, 1.0 / fit.alpha
        else:
            sensor, factor = b.sensor, 1.0 / fit.beta
        accuse(
            suspects,
            sensor,
            f"{quoted(sensor)} reads {factor:.2g} times what the other sensors of its axle imply; check its "
            "calibration.",
            rejected=False,
        )
    elif abs(fit.alpha - 1.0) > 6.0 * fit.alpha_se and fit.unexplained > 0.7:
        accuse(
            suspects,
            q.sensor,
            f"{quoted(q.sensor)} does not follow the accelerations of its axle and frame; check which sensor this "
            "column holds.",
            rejected=False,
        )


def _misplaced(axle: int, channels: Sequence[Channel], vehicle: Vehicle, bump_speed: float | None) -> bool:
    """Whether an axle of a run meets the bump elsewhere than at its place."""
    passage = None if bump_speed is None else find_passage(channels, vehicle, bump_speed)
    return passage is not None and abs(passage.misplaced_m(vehicle).get(axle, 0.0)) > _ON_TIME_M


def _lifted(channels: Sequence[Channel], vehicle: Vehicle, bump_speed: float) -> bool:
    """Whether most axles rise where they meet the bump: at walking speed noise hides which way they begin to move."""
    passage = find_passage(channels, vehicle, bump_speed)
    return passage is not None and sum(a.upward for a in passage.arrivals.values()) > 0


def _all_flipped(
    groups: Sequence[Trio],
    fits: Mapping[int, Fit | None],
    lifts: Sequence[float],
    suspicions: dict[str, list[Suspicion]],
) -> None:
    known = [f for f in fits.values() if f is not None]
    good = sum(f.right and f.clear for f in known)
    if len(known) < 2 or good < 0.65 * len(known) or not all(f.right for f in known):
        return
    if lifts[0] > -0.6 or float(np.median(lifts)) > -0.6:
        return
    for channel in {c.sensor.column: c for t in groups for c in t.channels}.values():
        accuse(
            suspicions,
            channel.sensor,
            f"{quoted(channel.sensor)} and the other sensors show axles that move down where the bump lifts them: "
            "all signs are flipped; multiply the columns by -1 (+ is extension, + is up).",
        )


def axles_shown_falling(votes: Sequence[Mapping[int, bool]]) -> frozenset[int]:
    """Axles that fall where the bump lifts the others, in most runs: all their sensors have the wrong sign.

    Parameters
    ----------
    votes : of every run, by :func:`falling_in_run`.
    """
    of_axle: dict[int, list[bool]] = {}
    for vote in votes:
        for axle, down in vote.items():
            of_axle.setdefault(axle, []).append(down)
    falling = [axle for axle, down in of_axle.items() if np.mean(down) > 0.6]
    return frozenset(falling) if 2 * len(falling) <= len(of_axle) else frozenset()


def falling_in_run(channels: Sequence[Channel], vehicle: Vehicle, listed_m_s: float) -> dict[int, bool]:
    """Whether axles fall where the bump lifts them, for those of which a run listed at this speed [m/s] shows it."""
    live = [c for c in channels if not defects.held_spans(parted(c)[0].value, c.sensor.full_scale)]
    passage = find_passage(live, vehicle, listed_m_s)
    # A speed far from the listed one means that places or units are wrong, and so distances on the bump are too.
    if passage is None or abs(np.log(abs(passage.speed_m_s) / listed_m_s)) > _SPEED_RIGHT:
        return {}
    off = passage.misplaced_m(vehicle)
    largest = max(a.rise_m_s for a in passage.arrivals.values())
    # One that most runs show lifted elsewhere is at another place, and not upside down in the others.
    return {
        axle: met.upward < 0 and abs(off[axle]) < _ON_TIME_M
        for axle, met in passage.arrivals.items()
        if met.rise_m_s > 0.3 * largest and (met.certain or met.upward > 0)
    }


def _axles_flipped(
    groups: Sequence[Trio],
    fits: Mapping[int, Fit | None],
    falling: frozenset[int],
    vehicle: Vehicle,
    suspicions: dict[str, list[Suspicion]],
) -> None:
    for trio in groups:
        fit = fits[trio.axle]
        if trio.axle not in falling or fit is None or not fit.right:
            continue
        for channel in trio.channels:
            if channel.sensor.column not in suspicions:
                accuse(
                    suspicions,
                    channel.sensor,
                    f"{quoted(channel.sensor)} has the wrong sign, as have all sensors of the axle "
                    f"'{shorten(vehicle.axles[trio.axle].name)}': it moves down where the bump lifts the other axles; "
                    "set sign = -1 for them in campaign.toml (+ is extension, + is up).",
                )


def _implausible(channel: Channel, rest_level: float | None, suspects: dict[str, list[Suspicion]]) -> None:
    sensor = channel.sensor
    good = channel.value[np.isfinite(channel.value)]
    if good.size < 20:
        return
    scale = sensor.unit_in_si
    size = float(np.max(np.abs(good - (np.median(good) if rest_level is None else rest_level))))
    low, high = _PLAUSIBLE[sensor.kind]
    if sensor.full_scale is not None and np.mean(np.abs(good) > 1.5 * sensor.full_scale) > 0.002:
        largest = float(np.max(np.abs(good)))
        accuse(
            suspects,
            sensor,
            f"{quoted(sensor)} reads up to {largest / scale:.3g} {sensor.unit}, beyond its range of "
            f"{sensor.full_scale / scale:.3g} {sensor.unit}: the file is probably in another unit; correct unit or "
            "range in campaign.toml.",
        )
    elif not low <= size <= high:
        bound = f"more than {high / scale:.3g}" if size > high else f"less than {low / scale:.3g}"
        accuse(
            suspects,
            sensor,
            f"{quoted(sensor)} differs from its value at rest by up to {size / scale:.3g} {sensor.unit}, {bound} "
            f"{sensor.unit}, which a {sensor.kind.replace('_', ' ')} does not show here: wrong unit or dead sensor; "
            "correct unit in campaign.toml or remove the sensor.",
        )
