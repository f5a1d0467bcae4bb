"""Tires, bump and filter against the motion of the axles: stiffness per tire, height and direction of the scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sysid import limits
from sysid.campaign.gaps import is_whole, readings_at, window_over
from sysid.campaign.passage.arrivals import HIGH_PASS_HZ, Passage, integrated
from sysid.campaign.records import AntiAliasFilter, BumpRun, Channel
from sysid.campaign.vehicle_records import LoadCase, Vehicle
from sysid.road.effective import AxleRoad, effective_profiles
from sysid.road.road_profile import RoadProfile
from sysid.wording import shorten

HOP_HZ, _HOP_STEP_HZ = (5.0, 22.0), 0.1
#: ln((k + kt) / kt) of a vehicle's axles by hop frequencies, as their median.
HOPS = (-0.2, 0.6)
#: ln of these of two axles of one vehicle are at most 0.7 apart; of two exchanged masses they are more, and near each
#: other and the other axles once they are exchanged back.
HOPS_APART, HOPS_ALIKE, HOPS_NEAR = 0.95, 0.5, 0.4
#: Power of the hop over that of the same sensor before the first axle arrives, below which noise may be its peak: of
#: noise of this share the highest peak stays below that of the hop.
HOP_OVER_NOISE, _REST_S = 4.0, 0.1
#: Of the runs with this share of the largest power, more than half must show the hop at this share of its frequency.
_SHAKEN, _SAME_HOP = 0.05, 0.08
#: Somewhere below a hop at less than this frequency, an axle moves with less than this share of its power.
_LOW_HOP_HZ, _ALONE = 7.0, 0.3
#: The height of the bump follows from the axles' motion within 8 % (median of axles and runs), 30 % in odd campaigns,
#: as with strong one-sided dampers; another unit or another bump is off by more.
HEIGHT_OFF = 0.5
#: Fits that leave more than this tell nothing.
HOPELESS = 0.12
#: Scans of a bump and of its mirror image differ by more than this [m] where the direction is judged.
ASYMMETRIC_M = 0.0015
MIRRORED = 0.03
_SLOW_M_S = 7.0
#: Motion on the bump is compared below this frequency, and a gap disturbs what is integrated for this time around it.
_RISE_HZ, _INTEGRATED_S = 15.0, 1.0
#: Filters are judged where wheel hop is in their band; power beyond it over that within, of axles without a filter.
_LOW_CUTOFF_HZ, _NATURAL = 25.0, 0.05
_FEWEST_BINS = 4
#: Lengths that are tried where the scan leaves more than this, and how much better another length must be.
_LENGTH_OFF_M = 0.65  # tires make a bump longer by less
_LENGTHS, _LENGTH_LEFT, _LENGTH_BETTER = (0.4, 0.5, 0.6, 1.7, 2.2), 0.04, 0.6


def hop_frequencies(
    runs: Sequence[BumpRun], passages: Mapping[str, Passage | None], vehicle: Vehicle
) -> dict[int, float]:
    """Frequencies [Hz] of wheel hop by axle, of those axles that show one."""
    found = {axle: hop_frequency(runs, passages, axle) for axle in range(len(vehicle.axles))}
    return {axle: hz for axle, hz in found.items() if hz is not None}


def unsprung_exchanged(hop_hz: Mapping[int, float], vehicle: Vehicle) -> str | None:
    """A sentence where two axles hop as if each had the unsprung mass of the other.

    The hop frequency f of each axle after it has left the bump gives (k + kt) / kt = (2 pi f)^2 m_u / kt.
    """
    size = {
        i: float(
            np.log((2.0 * np.pi * hz) ** 2 * vehicle.unsprung_mass_kg[i] / vehicle.axles[i].tire_stiffness_N_per_m)
        )
        for i, hz in hop_hz.items()
    }
    for i, j in combinations(sorted(size), 2):
        masses = float(np.log(vehicle.unsprung_mass_kg[i] / vehicle.unsprung_mass_kg[j]))
        apart = size[i] - size[j]
        right = {**size, i: size[i] - masses, j: size[j] + masses}
        middle = float(np.median(list(right.values())))
        near = HOPS[0] < middle < HOPS[1] and max(abs(right[i] - middle), abs(right[j] - middle)) < HOPS_NEAR
        if near and abs(apart) > HOPS_APART and abs(apart - 2.0 * masses) < HOPS_ALIKE:
            one, two = (shorten(vehicle.axles[k].name) for k in (i, j))
            return (
                f"The wheels of '{one}' and '{two}' hop as if each axle had the unsprung_mass_kg of the other; "
                "check whether the two are exchanged, or tire_stiffness_N_per_m of one of them."
            )
    return None


def hop_frequency(runs: Sequence[BumpRun], passages: Mapping[str, Passage | None], axle: int) -> float | None:
    """Frequency [Hz] at which an axle moves most within a second after the bump."""
    frequency = np.arange(HOP_HZ[0], HOP_HZ[1], _HOP_STEP_HZ)
    powers = []
    for run in runs:
        passage = passages.get(run.log.file)
        channel = _axle_sensor(run, axle)
        if passage is None or channel is None or axle not in passage.arrivals:
            continue
        first = passage.arrivals[axle].time_s + 1.6 / abs(passage.speed_m_s)
        after = _power_of_hop(channel, frequency, first, first + 1.0, run.log.sample_interval_s)
        last = min(a.time_s for a in passage.arrivals.values()) - _REST_S
        before = _power_of_hop(channel, frequency, last - 1.0, last, run.log.sample_interval_s)
        # Behind a bump that was left slowly the wheels are at rest again, and noise has any frequency.
        if after is None or before is None or after.sum() < HOP_OVER_NOISE * before.sum():
            continue
        powers.append(after)
    if not powers:
        return None
    # The runs that shake the wheel most show its hop best; after slow ones it moves with the frame.
    total = np.sum(powers, axis=0)
    k = int(np.argmax(total))
    peaks = np.max(powers, axis=1)
    own = frequency[np.argmax(powers, axis=1)][peaks > _SHAKEN * peaks.max()]
    # Near the lower end, a shoulder of the frame's motion has a highest point too: a hop stands alone.
    if frequency[k] < _LOW_HOP_HZ and total[: k + 1].min() > _ALONE * total[k]:
        return None
    if not 0 < k < frequency.size - 1 or np.mean(np.abs(own / frequency[k] - 1.0) < _SAME_HOP) <= 0.5:
        return None
    return float(frequency[k])


def _power_of_hop(channel: Channel, frequency: np.ndarray, first: float, last: float, step: float) -> np.ndarray | None:
    """Power per second (F,) of an axle between two times, times the frequency; None for half a second or less,
    and beside a gap."""
    first, last = max(first, float(channel.time_s[0])), min(last, float(channel.time_s[-1]))
    time = np.arange(first, last, step)
    value = readings_at(channel, time, HOP_HZ[1], clipped=False)
    if time.size * step < 0.5 or frequency[-1] > 0.5 / step or not np.isfinite(value).all():
        return None
    fading = 0.5 + 0.5 * np.cos(np.pi * np.arange(time.size) / time.size)
    # Zeros behind the second give the spectrum at steps that are the same for all rates.
    count = round(1.0 / (_HOP_STEP_HZ * step))
    waves = np.fft.rfft((value - value.mean()) * fading, count)[np.rint(frequency / _HOP_STEP_HZ).astype(int)]
    return np.asarray(frequency * np.abs(waves) ** 2 / time.size)


def _axle_sensor(run: BumpRun, axle: int, kind: str = "axle_acceleration") -> Channel | None:
    return next((c for c in run.log.channels if c.sensor.kind == kind and c.sensor.axle == axle), None)


@dataclass(frozen=True)
class _Rise:
    """One axle on the bump: height of the bump over that of the scan, and what scan and mirrored scan leave."""

    height: float
    left: float
    left_mirrored: float
    length: float = 1.0
    left_at_length: float = np.inf
    height_at_length: float = np.nan

    def enveloped(self, length_m: float) -> bool:
        """Whether a bump that is longer by no more than tires make it explains the motion better than the scan's."""
        longer = (self.length - 1.0) * length_m
        return 0.0 < longer < _LENGTH_OFF_M and self.left_at_length < _LENGTH_BETTER * self.left


def bump_complaints(
    runs: Sequence[BumpRun],
    passages: Mapping[str, Passage | None],
    profiles: Mapping[str, RoadProfile],
    vehicle: Vehicle,
    load_cases: Mapping[str, LoadCase],
) -> list[str]:
    """Sentences about scans that the axles contradict: height, shape, direction.

    The axle's displacement z, from its acceleration a, is h r - (m_u / kt) a + (k / kt) q + (c / kt) q' with the
    effective profile r of its tires: h is the height of the bump over that of the scan.
    """
    reference = next(iter(load_cases.values()))
    said = []
    for name, profile in profiles.items():
        felt = {
            case: effective_profiles(vehicle, load_cases[case], reference, profile)
            for case in dict.fromkeys(run.load_case for run in runs if run.bump == name)
        }
        rises = [
            rise
            for run in runs
            if run.bump == name and (passage := passages.get(run.log.file)) is not None
            and 0.0 < passage.speed_m_s < _SLOW_M_S
            for axle in passage.arrivals
            if (rise := _rise(run, passage, axle, profile, felt[run.load_case][axle])) is not None
        ]  # fmt: skip
        if len(rises) < 2:
            continue
        said += _judged(name, profile, rises, len(profiles) > 1)
    return said


def _judged(name: str, profile: RoadProfile, rises: Sequence[_Rise], several: bool) -> list[str]:
    what = f"The scan of '{shorten(name)}'" if several else "The scan"
    # A tire rolls over a short bump as over a longer one, which is as high.
    felt = [r.enveloped(profile.length_m) for r in rises]
    height = float(np.median([r.height_at_length if f else r.height for r, f in zip(rises, felt, strict=True)]))
    left = float(np.median([r.left_at_length if f else r.left for r, f in zip(rises, felt, strict=True)]))
    if abs(np.log(max(height, 1e-3))) > HEIGHT_OFF:
        return [
            f"{what} does not fit the motion of the axles: its bump of {1e3 * profile.height_m.max():.0f} mm "
            f"would have to be {height:.2f} times as high; check its unit, and that it is the scan of this bump."
        ]
    lengths = [
        r.length
        for r in rises
        if r.left_at_length < _LENGTH_BETTER * r.left and abs(r.length - 1.0) * profile.length_m > _LENGTH_OFF_M
    ]
    if (
        len(lengths) > 0.5 * len(rises)
        and min(np.mean(np.array(lengths) > 1.0), np.mean(np.array(lengths) < 1.0)) < 0.2
    ):
        return [
            f"{what} does not fit the motion of the axles: its bump of {profile.length_m:.2f} m would have to be about "
            f"{float(np.median(lengths)):.2g} times as long; check its unit, and that it is the scan of this bump."
        ]
    if left > HOPELESS:
        return [
            f"{what} does not fit the motion of the axles: {100 * left:.0f} % of it stays unexplained by a bump "
            f"{1e3 * profile.height_m.max():.0f} mm high and {profile.length_m:.2f} m long; check that it is the "
            "scan of this bump, its heading and the axle accelerations."
        ]
    mirrored = profile.height_m[::-1]
    shift = np.argmax(np.correlate(profile.height_m, mirrored, "full")) - (mirrored.size - 1)
    difference = profile.height_m - np.roll(mirrored, shift)
    if np.sqrt(np.mean(difference[profile.height_m > 1e-3] ** 2)) < ASYMMETRIC_M:
        return []
    clear = [np.log(r.left_mirrored / r.left) for r in rises if r.left < 0.06]
    if len(clear) >= 3 and float(np.median(clear)) < -MIRRORED and np.mean(np.array(clear) < 0.0) > 0.6:
        return [
            f"{what} fits the motion of the axles better when driven over in the other direction: heading_deg is "
            "probably off by 180 degrees (or the scan is mirrored)."
        ]
    return []


def _rise(run: BumpRun, passage: Passage, axle: int, profile: RoadProfile, felt: AxleRoad) -> _Rise | None:
    """Least squares of one axle's displacement on the profile, over shifts of the profile; and on its mirror image."""
    a, q = _axle_sensor(run, axle), _axle_sensor(run, axle, "suspension_deflection")
    if a is None or q is None or a.censored.mean() > 0.01:
        return None
    motion = integrated(a, 2)
    if motion is None:
        return None
    grid, rise = motion
    speed, arrival = passage.speed_m_s, passage.arrivals[axle].time_s
    begin, end = arrival - 0.3, arrival + (profile.length_m + 0.5) / speed + 0.6
    window = (grid > begin) & (grid < end)
    if window.sum() < 30 or grid[-1] < arrival + profile.length_m / speed:
        return None
    if not all(is_whole(c, begin - _INTEGRATED_S, end + _INTEGRATED_S, _RISE_HZ) for c in (a, q)):
        return None
    step = float(grid[1] - grid[0])
    good = [np.isfinite(c.value) for c in (a, q)]
    readings = [np.interp(grid, c.time_s[g], c.value[g]) for c, g in zip((a, q), good, strict=True)]
    known = [_band(readings[0], step), _band(readings[1], step), _band(readings[1], step, 1)]
    target = _band(rise, step, high_pass=False)[window]
    shifts = np.arange(0.1, max(0.5 * profile.length_m, 0.6) + 0.46, 0.03)
    whole = max(float(target @ target), 1e-30)
    # Only the road moves with the shift: what the other columns explain is taken from it and from the target once.
    basis, strength, _ = np.linalg.svd(np.stack([k[window] for k in known], axis=1), full_matrices=False)
    basis = basis[:, strength > 1e-10 * strength[0]]
    rest = target - basis @ (basis.T @ target)
    times = grid[window] - shifts[:, None] / speed

    def fitted(station: np.ndarray, height: np.ndarray) -> tuple[float, float]:
        """Share that the best shift leaves, and the height of the bump there."""
        road = _band(np.interp(speed * (grid - arrival), station, height, left=0.0, right=0.0), step)
        moved = np.interp(times, grid, road)
        moved -= (moved @ basis) @ basis.T
        power = np.maximum(np.einsum("st,st->s", moved, moved), 1e-30)
        size = moved @ rest / power
        left = np.maximum(rest @ rest - size**2 * power, 0.0) / whole
        best = int(np.argmin(left))
        return float(left[best]), float(size[best])

    station, height = _about_middle(felt.rise_m, float(felt.station_m[1] - felt.station_m[0]))
    left, rises = fitted(station, height)
    mirrored, _ = fitted(-station[::-1], height[::-1])
    if left < _LENGTH_LEFT:
        return _Rise(rises, left, mirrored)
    (other, rises_then), length = min((fitted(station * length, height), length) for length in _LENGTHS)
    return _Rise(rises, left, mirrored, length, other, rises_then)


def _band(value: np.ndarray, step: float, derivative: int = 0, high_pass: bool = True) -> np.ndarray:
    """What is between the limit of the integrated acceleration and 15 Hz, derived as often as asked."""
    count = value.size
    frequency = np.fft.rfftfreq(2 * count, step)
    factor = (2j * np.pi * frequency) ** derivative / (1.0 + (frequency / _RISE_HZ) ** 8)
    if high_pass:
        factor = factor * frequency**4 / (frequency**4 + HIGH_PASS_HZ**4)
    # Once more for all: what is slower than 0.8 Hz says more about drift than about the bump.
    factor = factor * frequency**4 / (frequency**4 + 0.8**4)
    return np.asarray(np.fft.irfft(np.fft.rfft(value - np.median(value), 2 * count) * factor, 2 * count)[:count])


def _about_middle(height: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Station from the middle of the bump [m] and height."""
    station = step * np.arange(height.size)
    middle = station[int(np.argmax(np.cumsum(height) > 0.5 * height.sum()))]
    return station - middle, height


def filter_complaint(runs: Sequence[BumpRun], low_pass: AntiAliasFilter | None) -> str | None:
    """A sentence where axles show motion that the declared anti-alias filter would have removed."""
    if low_pass is None or low_pass.order < 2:
        return None
    cutoff = low_pass.cutoff_hz
    ratios = []
    for run in runs:
        for channel in run.log.channels:
            ratio = _beyond(channel, run.log.sample_interval_s, cutoff)
            if channel.sensor.kind == "axle_acceleration" and ratio is not None:
                ratios.append(ratio)
    # At twice the cut-off a fourth-order filter passes 0.4 % of the power, and above wheel hop axles move less anyway.
    allowed = _NATURAL / (1.0 + 2.0 ** (2 * low_pass.order))
    if len(ratios) < 3 or float(np.median(ratios)) < allowed:
        return None
    return (
        f"Above {2 * cutoff:.0f} Hz the axle signals are larger than the declared anti-alias filter allows (order "
        f"{low_pass.order}, cutoff_hz = {cutoff:g}): {100 * float(np.median(ratios)):.2g} % of the power below "
        f"{cutoff:g} Hz; correct acquisition.filter."
    )


def _beyond(channel: Channel, step: float, cutoff: float) -> float | None:
    """Power between two and three times the cut-off over that between half of it and itself, without the noise."""
    duration_s = float(channel.time_s[-1] - channel.time_s[0])
    if (
        cutoff > _LOW_CUTOFF_HZ
        or 3.0 * cutoff > 0.45 / step
        or channel.censored.any()
        or not 100 <= duration_s / step < limits.GRID_STEPS
    ):
        return None
    time = float(channel.time_s[0]) + step * np.arange(int(duration_s / step) + 1)
    value = readings_at(channel, time, 0.5 / step)
    window = window_over(time, [value])
    if window is None or window.known_s < 0.7 * duration_s:
        return None
    frequency = np.fft.rfftfreq(time.size, step)
    if (frequency < 0.5 * cutoff).sum() < _FEWEST_BINS:
        return None
    power = np.abs(window.transform(value, 2.0 * np.pi * frequency)) ** 2
    bands = [(0.5, 1.0), (2.0, 3.0)]
    inside, outside = (power[(frequency > lo * cutoff) & (frequency < hi * cutoff)].mean() for lo, hi in bands)
    highest = power[frequency > 0.85 * frequency[-1]].mean()
    return float(outside / max(inside, 1e-30)) if outside > 3.0 * highest else 0.0
