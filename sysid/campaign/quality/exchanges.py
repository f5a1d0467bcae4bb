"""Columns that hold the sensor of another place: they fit each other's axle, or arrive in the wrong order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sysid.campaign.quality.sensor_trios import Fit, Trio, arrival, fit_factors, hop_size
from sysid.campaign.records import Channel, Sensor
from sysid.campaign.vehicle_records import Vehicle
from sysid.wording import shorten


@dataclass(frozen=True)
class Suspicion:
    """A sentence about one channel, and whether the channel must not be used."""

    sentence: str
    rejected: bool


def accuse(suspects: dict[str, list[Suspicion]], sensor: Sensor, sentence: str, rejected: bool = True) -> None:
    """Add a suspicion about the column of a sensor to those of all columns."""
    suspects.setdefault(sensor.column, []).append(Suspicion(sentence, rejected))


def quoted(sensor: Sensor) -> str:
    """Name of a sensor's column in quotes, fit for a sentence."""
    return f"'{shorten(sensor.column)}'"


def find_exchanges(
    suspect: Sequence[Trio],
    groups: Sequence[Trio],
    fits: Mapping[int, Fit | None],
    inverted: tuple[int, int] | None,
    vehicle: Vehicle,
    step: float,
    suspicions: dict[str, list[Suspicion]],
) -> set[int]:
    """Find columns that fit each other's axle.

    Parameters
    ----------
    suspect : axles whose sensors do not agree.
    groups, fits : all axles of the log and how well their sensors agree.
    inverted : two axles that arrive in the wrong order, from `inverted_axles`.
    vehicle, step : for names, and the sample interval [s].
    suspicions : receives the suspicions.

    Returns
    -------
    set
        Axles whose disagreement is explained.
    """
    settled: set[int] = set()
    for trio in suspect:
        b = trio.body_acceleration
        if b is None:
            continue
        a = trio.axle_acceleration
        swapped = fit_factors(trio.deflection, b, a, step)
        if swapped and swapped.right and swapped.clear and hop_size(a, step) < 0.7 * hop_size(b, step):
            _exchange_sentences([(a, b)], suspicions)
            settled.add(trio.axle)
    for one, two in combinations([t for t in suspect if t.axle not in settled], 2):
        if {one.axle, two.axle} & settled or {one.axle, two.axle} == set(inverted or ()):
            continue
        best: tuple[float, Channel, Channel] | None = None
        for kind in ("deflection", "axle_acceleration", "body_acceleration"):
            x, y = getattr(one, kind), getattr(two, kind)
            unexplained = _explained_by_exchange(one, two, kind, fits, step)
            if unexplained is not None and (best is None or unexplained < best[0]):
                best = (unexplained, x, y)
        if best is not None:
            _exchange_sentences([best[1:]], suspicions)
            settled |= {one.axle, two.axle}
    if inverted is not None and not settled & set(inverted):
        one, two = (next(t for t in groups if t.axle == axle) for axle in inverted)
        pairs = [(one.deflection, two.deflection), (one.axle_acceleration, two.axle_acceleration)]
        # Columns of a whole axle moved together fit each other; only the order of arrival gives them away.
        if _explained_by_exchange(one, two, "axle_acceleration", fits, step) is not None:
            pairs = pairs[1:]
        elif one.body_acceleration is not None and two.body_acceleration is not None:
            away = [_fit_with(one, two, "body_acceleration", step), _fit_with(two, one, "body_acceleration", step)]
            home = [fits[one.axle], fits[two.axle]]
            if all(f is not None for f in (*away, *home)) and _total_unexplained(home) < _total_unexplained(away):
                pairs.append((one.body_acceleration, two.body_acceleration))
        where = " and ".join(f"'{shorten(vehicle.axles[t.axle].name)}'" for t in (one, two))
        _exchange_sentences(pairs, suspicions, f"the axles {where} meet the bump in the wrong order")
        settled |= set(inverted)
    return settled


def _total_unexplained(fits: Sequence[Fit | None]) -> float:
    return sum(f.unexplained for f in fits if f is not None)


def _explained_by_exchange(
    one: Trio, two: Trio, kind: str, fits: Mapping[int, Fit | None], step: float
) -> float | None:
    """Unexplained share once two sensors of a kind change places, None where that does not put both axles right."""
    if getattr(one, kind) is None or getattr(two, kind) is None:
        return None
    new = [_fit_with(one, two, kind, step), _fit_with(two, one, kind, step)]
    old = [fits[one.axle], fits[two.axle]]
    for before, after in zip(old, new, strict=True):
        if after is None or not (after.right and after.clear and after.unexplained < 0.4):
            return None
        if before is None or (before.right and before.unexplained < 2.0 * after.unexplained):
            return None
    return _total_unexplained(new)


def _fit_with(trio: Trio, other: Trio, kind: str, step: float) -> Fit | None:
    mixed = replace(trio, **{kind: getattr(other, kind)})
    return fit_factors(mixed.deflection, mixed.axle_acceleration, mixed.body_acceleration, step)


def _exchange_sentences(
    pairs: Sequence[tuple[Channel, Channel]],
    suspicions: dict[str, list[Suspicion]],
    reason: str = "each fits the place of the other",
) -> None:
    for x, y in pairs:
        sentence = (
            f"the columns {quoted(x.sensor)} and {quoted(y.sensor)} are exchanged: {reason}; exchange their names in "
            "the file, or their entries in [sensors] if all logs have them so."
        )
        accuse(suspicions, x.sensor, sentence)
        accuse(suspicions, y.sensor, sentence)


def inverted_axles(
    groups: Sequence[Trio], vehicle: Vehicle, rests: Mapping[str, float], speed_m_s: float
) -> tuple[int, int] | None:
    """Two axles whose accelerations meet the bump in the wrong order.

    The later of the two must lead by the time that their distance takes at the nominal speed, within a third, and
    exchanging them must bring all axles close to constant speed.
    """
    times = {t.axle: arrival(t.axle_acceleration, rests.get(t.axle_acceleration.sensor.column, 0.0)) for t in groups}
    known = sorted((a, t) for a, t in times.items() if t is not None)
    if len(known) < 3:
        return None
    x = np.array([vehicle.axles[a].x_m for a, _ in known])
    t = np.array([time for _, time in known])
    misfit = _line_misfit(x, t)
    candidates = []
    for i, j in combinations(range(len(known)), 2):
        lead, expected = t[i] - t[j], (x[j] - x[i]) / speed_m_s
        if lead > 0.0 and abs(lead / expected - 1.0) < 1.0 / 3.0:
            candidates.append((_line_misfit(x, _swapped(t, i, j)), known[i][0], known[j][0]))
    best = min(candidates, default=None)
    if best is None or best[0] > 0.25 * misfit or misfit < 0.03:
        return None
    return best[1], best[2]


def _swapped(values: np.ndarray, i: int, j: int) -> np.ndarray:
    result = values.copy()
    result[[i, j]] = values[[j, i]]
    return result


def _line_misfit(x: np.ndarray, t: np.ndarray) -> float:
    """Root mean square departure [s] of arrival times from constant speed."""
    design = np.stack([np.ones_like(x), x], axis=1)
    departure = t - design @ np.linalg.lstsq(design, t, rcond=None)[0]
    return float(np.sqrt(np.mean(departure**2)))
