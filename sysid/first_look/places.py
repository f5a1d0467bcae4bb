"""Which axle a column belongs to: the number in its name against the order in which axles meet the bump."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.first_look.words import PLACES, AxleLabel, PlaceWord

#: Axles whose arrivals differ by less than this share of the passage are the two sides of one.
_SAME_AXLE = 0.025
#: Pairs of axles nearer than this [m] tell little of a speed; pairs must agree so well to be believed.
_NEAREST_M, _AGREEMENT = 1.0, 0.12


@dataclass(frozen=True)
class Passage:
    """Times [s] at which the columns of axle accelerations of one run first move."""

    file: str
    arrival_s: Mapping[str, float]


@dataclass(frozen=True)
class Order:
    """Axles in the order of arrival: `rank` of every column from 0, `share` of the passage [0, 1] of every rank."""

    rank: Mapping[str, int]
    share: tuple[float, ...]


def arrival_order(passages: Sequence[Passage]) -> Order:
    """The order in which columns move, from all runs together."""
    shares: dict[str, list[float]] = {}
    for passage in passages:
        times = passage.arrival_s
        first, last = (min(times.values()), max(times.values())) if len(times) > 1 else (0.0, 0.0)
        if last > first:
            for column, time in times.items():
                shares.setdefault(column, []).append((time - first) / (last - first))
    middle = {column: float(np.median(values)) for column, values in shares.items()}
    rank: dict[str, int] = {}
    clusters: list[list[float]] = []
    for column in sorted(middle, key=middle.__getitem__):
        if not clusters or middle[column] - clusters[-1][-1] > _SAME_AXLE:
            clusters.append([])
        clusters[-1].append(middle[column])
        rank[column] = len(clusters) - 1
    return Order(rank, tuple(float(np.mean(c)) for c in clusters))


def numbered_axles(labels: Iterable[AxleLabel], arriving: int = 0) -> dict[AxleLabel, int]:
    """Index of the axle (0 = axle 1) for the labels by which names call axles; labels that leave it open are left out.

    Numbers count from 1, see :func:`counted_from_one`.  Where they begin anew at every place, as in ``drive1``,
    ``trailer1``, or places have none, axles are counted through the places front to rear; this needs a label for the
    first axle, and as many places as axles are seen to arrive: where one has no place, those behind it are uncounted.
    """
    known = {label for label in labels if label != AxleLabel()}
    plain = {label for label in known if label.place is None}
    places: dict[int | None, set[tuple[PlaceWord | None, str | None]]] = {}
    for label in known:
        places.setdefault(label.number, set()).add((label.place, label.within))
    through = None not in places and all(len(at) == 1 for at in places.values())
    if through and not any(label.number == 1 and label.place not in (None, "front") for label in known):
        return {label: label.number - 1 for label in known if label.number is not None}
    by_number = {label: label.number - 1 for label in plain if label.number is not None}
    placed = {label for label in known - plain if not _is_vague(label, known)}
    order = sorted({_in_row(label) for label in placed})
    by_place = {label: order.index(_in_row(label)) for label in placed} if order and order[0][0] == 0 else {}
    if arriving > len(order) or (plain and set(by_number.values()) != set(range(len(order)))):
        # Numbers or arrivals say more axles: of the places only the front says which it is.
        by_place = {label: 0 for label in by_place if label == AxleLabel(place="front")}
    return by_number | by_place


def counted_from_one(labels: Iterable[AxleLabel]) -> dict[AxleLabel, AxleLabel]:
    """Labels of one kind of names with numbers from 1; they count from 0 if one of them is 0."""
    known = set(labels)
    shift = 1 if any(label.number == 0 for label in known) else 0
    return {a: a if a.number is None else a._replace(number=a.number + shift) for a in known}


def _is_vague(label: AxleLabel, known: Iterable[AxleLabel]) -> bool:
    """Whether a label may be any of several axles that other labels tell apart."""
    if label.place == "rear" and any(o.place in ("pusher", "drive", "tag") for o in known):
        return True
    alone = label.number is None and label.within is None
    return alone and any(o.place == label.place and o != label for o in known)


def _in_row(label: AxleLabel) -> tuple[int, int, int]:
    ends = {None: 0, "front": 0, "rear": 1}
    return PLACES.index(label.place) if label.place else 0, ends.get(label.within, 0), label.number or 0


def in_order(named: Mapping[str, int], rank: Mapping[str, int]) -> bool:
    """Whether columns arrive in the order of the axles that their names say."""
    both = [(named[c], rank[c]) for c in named if c in rank]
    return all((a[0] < b[0]) == (a[1] < b[1]) and (a[0] == b[0]) == (a[1] == b[1]) for a in both for b in both)


def axles_of_ranks(share: Sequence[float], positions_m: Sequence[float]) -> tuple[int, ...]:
    """Axles whose positions fit the delays of fewer ranks best, at any speed."""
    count = len(share)
    if count >= len(positions_m) or count < 3:
        return tuple(range(count))
    best: tuple[float, tuple[int, ...]] = (np.inf, tuple(range(count)))
    for chosen in itertools.combinations(range(len(positions_m)), count):
        x = np.array([positions_m[i] for i in chosen])
        x = (x - x[0]) / (x[-1] - x[0])
        best = min(best, (float(np.sum((x - np.array(share)) ** 2)), chosen))
    return best[1]


def misfit(share: Sequence[float], positions_m: Sequence[float]) -> float:
    """Largest difference between the shares of a passage at which axles arrive and those of their positions."""
    x = np.array(positions_m)
    return float(np.max(np.abs((x - x[0]) / (x[-1] - x[0]) - np.array(share))))


def axle_times(passage: Passage, axle_of: Mapping[str, int]) -> dict[int, float]:
    """Arrival [s] of every axle of a run, the mean of its sides."""
    times: dict[int, list[float]] = {}
    for column, time in passage.arrival_s.items():
        if column in axle_of:
            times.setdefault(axle_of[column], []).append(time)
    return {axle: float(np.mean(t)) for axle, t in sorted(times.items())}


def speed_m_s(times: Mapping[int, float], positions_m: Sequence[float]) -> float | None:
    """Speed [m/s] at which axles at known places arrive, None where they do not agree on one."""
    speeds = np.array(
        [
            (positions_m[b] - positions_m[a]) / (times[b] - times[a])
            for a, b in itertools.combinations(sorted(times), 2)
            if positions_m[b] - positions_m[a] >= _NEAREST_M and times[b] != times[a]
        ]
    )
    if speeds.size == 0 or not np.all(speeds > 0.0):
        return None
    speed = float(np.median(speeds))
    return speed if np.median(np.abs(np.log(speeds / speed))) < _AGREEMENT else None


def measured_positions(runs: Sequence[tuple[Mapping[int, float], float]], axles: int) -> tuple[float, ...] | None:
    """Distances behind axle 1 [m] from runs (arrivals of the axles [s], speed [m/s]); None where an axle is missing."""
    distances: list[list[float]] = [[] for _ in range(axles)]
    for times, speed in runs:
        if 0 in times:
            for axle, time in times.items():
                distances[axle].append(speed * (time - times[0]))
    if not all(distances):
        return None
    middle = [float(np.median(x)) for x in distances]
    return tuple(middle) if all(b > a for a, b in itertools.pairwise(middle)) else None
