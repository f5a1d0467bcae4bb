"""Speeds and places of axles from the moments at which the axles of all runs meet the bump."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.gaps import gaps_of, unseen
from sysid.campaign.passage.arrivals import Passage
from sysid.campaign.passage.speed import DOUBTFUL, believed_speed
from sysid.campaign.records import BumpRun, Channel
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten

#: Arrivals agree with places and speeds to 1 % on average (measured on simulated trucks, also on those of another
#: model); speeds are listed with 3 % at most, each run by itself.
SPEEDS_OFF = 0.045
LISTED_SD = 0.03
SURE = 3.0
#: Axles are found at their place within 0.07 m in 99 of 100 runs, the median of several runs within 0.04 m.
PLACE_OFF_M = 0.12
#: A record holds at least this before the first and after the last axle [s].
_AROUND_S = 0.2
#: An axle at rest again that shakes by this share of its largest acceleration is on a bump again (an assumption:
#: wheel hop has died away within this time, and a road that rough would hide the bump).
_AGAIN, _DIED_AWAY_S = 0.6, 3.0
#: Axles are shaken by at least this share of what other runs and the square of the speed say, or not by the bump; that
#: is far less than the ratio of empty and laden trucks.
_SHAKEN = 0.1
#: A gap hides an axle's motion on the bump if it is longer: wheel hop goes on for half a second [s].
_HIDES_S, _HOP_HZ = 0.3, 15.0
#: Share of the runs in which an axle is out of place.
MOST_RUNS = 0.6
#: Without this axle the others are at their places within this.
PLACE_RIGHT_M = 0.06


@dataclass(frozen=True)
class Places:
    """What arrivals say of places and speeds: sentences, and the vehicle whose places explain them.

    `vehicle` is None where a place is wrong, but it is not clear which or by how much. `axle` is the one that the last
    sentence is about, if it is about one.
    """

    said: tuple[str, ...]
    vehicle: Vehicle | None
    axle: int | None = None


def place_complaints(runs: Sequence[BumpRun], passages: Mapping[str, Passage | None], vehicle: Vehicle) -> Places:
    """What is wrong with the order of the axles, their places and the listed speeds.

    Parameters
    ----------
    runs
        All runs.
    passages
        What the arrivals of a run's axles say, by its file.
    """
    short = _cut_off(runs, vehicle)
    seen = [(run, passage) for run in runs if (passage := passages.get(run.log.file)) is not None]
    if not seen:
        return Places(tuple(short), vehicle)
    backward = [run for run, passage in seen if passage.speed_m_s < 0.0]
    if len(backward) > 0.5 * len(seen):
        sentence = (
            f"In {len(backward)} of {len(runs)} runs the last axle of the list meets the bump first: the axles are "
            "listed from the rear. Give x_m as the distance behind the front axle, with hitch_x_m and the x_m of the "
            "sensors, or drive forward."
        )
        return Places((sentence,), None)
    forward = [p for _, p in seen if p.speed_m_s > 0.0 and p.whole]
    moved = _misplaced_axle(forward, vehicle) or _axle_out_of_time(forward, vehicle)
    if moved is None:
        return Places((*short, *_all_speeds(seen, vehicle)), vehicle)
    return replace(moved, said=(*short, *moved.said))


def _cut_off(runs: Sequence[BumpRun], vehicle: Vehicle) -> list[str]:
    """Records that are shorter than the truck needs to pass."""
    way = max(a.x_m for a in vehicle.axles) - min(a.x_m for a in vehicle.axles)
    return [
        f"{shorten(run.log.file, 100)}: the record is {run.log.duration_s:.2g} s long and cut off, the axles need "
        f"{way / run.nominal_speed_m_s:.2g} s to pass the bump one after the other; export the whole run, "
        "or correct nominal_speed_km_h or the x_m of the axles."
        for run in runs
        if run.log.duration_s < way / run.nominal_speed_m_s + _AROUND_S
    ]


def second_passes(runs: Sequence[BumpRun], passages: Mapping[str, Passage | None]) -> list[str]:
    """Sentences about logs in which most axles shake a second time, long after the last one has left the bump."""
    said = []
    for run in runs:
        passage = passages.get(run.log.file)
        if passage is None:
            continue
        over = max(arrival.time_s for arrival in passage.arrivals.values()) + _DIED_AWAY_S
        again: dict[int, float] = {}
        for channel in run.log.channels:
            if channel.sensor.kind != "axle_acceleration" or channel.sensor.axle is None:
                continue
            time, size = _sizes(channel)
            late = time > over
            if any(begin < over for begin, _ in gaps_of(channel, _HOP_HZ)):
                continue  # the largest acceleration on the bump may be what is missing
            if late.any() and not late.all():
                shaken = late & (size > _AGAIN * size[~late].max())
                if shaken.any():
                    again[channel.sensor.axle] = float(time[shaken][0])
        if len(again) > max(1.0, 0.5 * len(passage.arrivals)):
            said.append(
                f"{shorten(run.log.file, 100)}: {len(again)} axles shake again from {min(again.values()):.1f} s on, as "
                "much as on the bump: the log seems to hold a second pass. Cut it into one log for each pass."
            )
    return said


def _sizes(channel: Channel) -> tuple[np.ndarray, np.ndarray]:
    """Times of the readings that are there, and how far each is from their median."""
    there = np.isfinite(channel.value)
    value = channel.value[there]
    return channel.time_s[there], np.abs(value - np.median(value)) if value.size else value


def _missing_s(channel: Channel) -> float:
    """Longest time without a reading [s]."""
    return max((end - begin for begin, end in unseen(channel, _HOP_HZ)), default=0.0)


def runs_without_bump(runs: Sequence[BumpRun], passages: Mapping[str, Passage | None]) -> list[str]:
    """Sentences about logs in which the axles hardly move, though they do in other runs over the same bump."""
    peaks = {}
    for run in runs:
        sizes = [_sizes(c)[1] for c in run.log.channels if c.sensor.kind == "axle_acceleration"]
        peak = max((float(size.max()) for size in sizes if size.size), default=None)
        if peak is not None:
            peaks[run.log.file] = peak / run.nominal_speed_m_s**2
    said = []
    for run in runs:
        others = [peaks[r.log.file] for r in runs if r.bump == run.bump and r is not run and r.log.file in peaks]
        if run.log.file not in peaks or passages.get(run.log.file) is not None or len(others) < 2:
            continue
        if any(_missing_s(c) > _HIDES_S for c in run.log.channels if c.sensor.kind == "axle_acceleration"):
            continue
        if peaks[run.log.file] < _SHAKEN * min(others):
            said.append(
                f"{shorten(run.log.file, 100)}: the axles hardly move, so the truck does not seem to pass the bump in "
                "this log. Give the log of that run, or delete its line in tests.bump_run."
            )
    return said


def _all_speeds(seen: Sequence[tuple[BumpRun, Passage]], vehicle: Vehicle) -> list[str]:
    ratios = []
    for run, passage in seen:
        speed = believed_speed(passage, vehicle)
        # A speed that nobody listed is that of a sensor, whose factor is another matter.
        if speed is not None and run.speed_listed:
            ratios.append(float(np.log(speed / run.nominal_speed_m_s)))
    # Those far off are named one by one; all of them off by the same share is one mistake.
    near = [r for r in ratios if abs(r) < 2.0 * DOUBTFUL]
    if len(near) < 2 or len(near) < 0.7 * len(ratios):
        return []
    mean = float(np.median(near))
    sd = max(LISTED_SD, float(np.std(near, ddof=1))) / np.sqrt(len(near))
    if abs(mean) < SPEEDS_OFF or abs(mean) < SURE * sd:
        return []
    factor = float(np.exp(mean))
    return [
        f"In {len(near)} runs the axles meet the bump one after the other as at {factor:.3f} times the listed speeds "
        f"(median): either all nominal_speed_km_h are {abs(100 * mean):.0f} % too {'low' if mean > 0 else 'high'}, or "
        f"all axle positions x_m are {abs(100 * mean):.0f} % too {'large' if mean > 0 else 'small'}, or the clock of "
        "the logs is wrong. Wrong positions make stiffnesses wrong by at least as much. Measure the distance between "
        f"the first and the last axle; if it is wrong, multiply all x_m by {1.0 / factor:.3f}."
    ]


def _misplaced_axle(passages: Sequence[Passage], vehicle: Vehicle) -> Places | None:
    """One axle that is not at its place in any run, while the others are at theirs, and the vehicle with it there."""
    axles, x, along = _ways(passages, vehicle)
    if len(axles) < 3:
        return None
    explained: list[tuple[float, float, int]] = []
    for k in range(len(axles)):
        offs, rest = _off_line(along, x, k)
        if np.isfinite(offs).any():
            offs = offs[np.isfinite(offs)]
            explained.append((max(rest, _scatter(offs)), float(np.median(offs)), k))
    if not explained:
        return None
    before = _rest_of_all(along, x)
    rest, off, k = min(explained)
    if abs(off) < PLACE_OFF_M or rest > PLACE_RIGHT_M or before < 3.0 * max(rest, 0.01):
        return None
    # With three axles, any of them may be the one.
    others = [(o, j) for r, o, j in explained if j != k and r < max(1.5 * rest, 0.03) and abs(o) > PLACE_OFF_M]
    choices = [f"'{shorten(vehicle.axles[axles[j]].name)}' at {x[j] + o:.2f} m instead of {x[j]:.2f} m"
               for o, j in [(off, k), *sorted(others, key=lambda c: c[1])]]  # fmt: skip
    sentence = (
        f"In {len(passages)} runs one axle does not meet the bump when its x_m says: the axle positions x_m should be "
        f"{'; or '.join(choices)}. Measure the distances between the axles."
    )
    if others:
        return Places((sentence,), None, axles[k])
    at = {axles[k]: x[k] + off}
    there = tuple(replace(a, x_m=float(at.get(i, a.x_m))) for i, a in enumerate(vehicle.axles))
    return Places((sentence,), replace(vehicle, axles=there), axles[k])


def _ways(passages: Sequence[Passage], vehicle: Vehicle) -> tuple[list[int], np.ndarray, np.ndarray]:
    """Axles that are seen, their places (axles,), and ways (runs, axles) [m] until each meets the bump, or NaN."""
    axles = sorted({axle for p in passages for axle in p.arrivals})
    along = np.full((len(passages), len(axles)), np.nan)
    for r, p in enumerate(passages):
        for k, axle in enumerate(axles):
            if axle in p.arrivals:
                along[r, k] = p.speed_m_s * p.arrivals[axle].time_s
    return axles, np.array([vehicle.axles[a].x_m for a in axles]), along


def _off_line(along: np.ndarray, x: np.ndarray, left_out: int) -> tuple[np.ndarray, float]:
    """How far [m] one axle is off the line through the others in each run that shows it, and how far those are off."""
    keep = np.arange(x.size) != left_out
    offs, rests = np.full(along.shape[0], np.nan), []
    for r, row in enumerate(along):
        known = keep & np.isfinite(row)
        if known.sum() < 2 or not np.isfinite(row[left_out]) or np.ptp(x[known]) < 1.0:
            continue
        # Place against way: its slope is near 1, whatever the speed is.
        slope, start = _line_through(row[known], x[known])
        offs[r] = slope * row[left_out] + start - x[left_out]
        rests.append(float(np.max(np.abs(slope * row[known] + start - x[known]))) if known.sum() > 2 else 0.0)
    return offs, float(np.median(rests)) if rests else np.inf


def _scatter(values: np.ndarray) -> float:
    """Median departure from the median, as a standard deviation."""
    return 1.5 * float(np.median(np.abs(values - np.median(values))))


def _axle_out_of_time(passages: Sequence[Passage], vehicle: Vehicle) -> Places | None:
    """One axle that all runs show too late or too early, by a time or by no one distance, while the others are right.

    What is late by a time goes through a box of its own; a wrong place is off by a distance, at all speeds.
    """
    axles, x, along = _ways(passages, vehicle)
    if len(axles) < 4:
        return None
    speed = np.array([p.speed_m_s for p in passages])
    for k, axle in enumerate(axles):
        offs, rest = _off_line(along, x, k)
        seen = np.isfinite(offs)
        if rest > PLACE_RIGHT_M or seen.sum() < 3 or np.mean(np.abs(offs[seen]) > PLACE_OFF_M) < MOST_RUNS:
            continue
        late = offs[seen] / speed[seen]
        name = shorten(vehicle.axles[axle].name)
        if _scatter(late) * float(np.median(speed)) < PLACE_RIGHT_M:
            sentence = (
                f"All sensors of the axle '{name}' show the bump {1e3 * abs(np.median(late)):.0f} ms too "
                f"{'late' if np.median(late) > 0 else 'early'} (median of {seen.sum()} runs), at all speeds: another "
                "logger or amplifier; correct their time, or declare the loggers by [[logger]]."
            )
            return Places((sentence,), None, axle)
        sentence = (
            f"In {np.sum(np.abs(offs[seen]) > PLACE_OFF_M)} of {seen.sum()} runs the axle '{name}' does not meet the "
            "bump when its place x_m says, and no other place explains it: check the clock of its sensors, and at "
            "which axle they are mounted."
        )
        return Places((sentence,), None, axle)
    return None


def _line_through(along: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """Slope and start of the straight line x(along) by least squares."""
    away = along - along.mean()
    slope = float(away @ (x - x.mean())) / max(float(away @ away), 1e-12)
    return slope, float(x.mean()) - slope * float(along.mean())


def _rest_of_all(along: np.ndarray, x: np.ndarray) -> float:
    rests = []
    for row in along:
        known = np.isfinite(row)
        if known.sum() > 2:
            slope, start = _line_through(row[known], x[known])
            rests.append(float(np.max(np.abs(slope * row[known] + start - x[known]))))
    return float(np.median(rests)) if rests else 0.0
