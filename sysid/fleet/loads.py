"""Axle loads of a population: what the predictions of its campaigns say of a truck that nobody has measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.fleet.exchangeable import Readings, population
from sysid.fleet.members import Member
from sysid.fleet.summaries import Pass, PeakRatio, summary_of

#: Scale of the half-Cauchy prior of the spread of the logarithm of a peak load ratio between trucks.
_SCALE = 0.1
#: Trucks that a population needs.
_LEAST = 3


@dataclass(frozen=True)
class PopulationLoad:
    """Peak dynamic load ratio of one axle in one kind of pass: quantiles over the trucks of a type, one of them new.

    `trucks` that predicted this pass; `spread` relative standard deviation between them; `shape` names the bump, with a
    number where another of the name is not the same; None where the results do not say it.
    """

    type: str
    load_case: str
    speed_km_h: float
    axle: int
    trucks: int
    q05: float
    q50: float
    q95: float
    spread: float
    shape: str | None = None


def _names(readings: Iterable[PeakRatio]) -> dict[str, str | None]:
    """Names of the bumps in order of appearance, numbered where different ones have one name."""
    names: dict[str, str | None] = {}
    for reading in readings:
        names.setdefault(reading.kind.bump, reading.shape)
    counts: Counter[str] = Counter()
    for bump, name in names.items():
        if name is not None:
            counts[name] += 1
            names[bump] = name if counts[name] == 1 else f"{name} ({counts[name]})"
    return names


def population_loads(kind: str, members: Iterable[Member]) -> tuple[list[PopulationLoad], list[str]]:
    """Loads of every pass that at least three trucks of a type have in common, and sentences about what was left out.

    Passes are the same if load case, speed and profile of the bump are.  The logarithms of the ratios are taken as
    normal.  Of several campaigns of a truck the last one counts: their errors have masses and tires in common, so that
    an average would look more certain than it is.
    """
    of_members = ((member, summary_of(member.output).ratios) for member in members)
    by_member = [(member, ratios) for member, ratios in of_members if ratios is not None]
    names = _names(r for _, readings in by_member for r in readings)
    order = {bump: number for number, bump in enumerate(names)}
    trucks: dict[Pass, dict[str, PeakRatio]] = {}
    for member, readings in by_member:
        for r in readings:
            trucks.setdefault(r.kind, {})[member.truck] = r
    loads = [
        _load(kind, of, list(trucks[of].values()), names[of.bump])
        for of in sorted(trucks, key=lambda k: (*k[:3], order[k.bump]))
        if len(trucks[of]) >= _LEAST
    ]
    unnamed = sum(any(r.shape is None for r in readings) for _, readings in by_member)
    return loads, [f"{kind}: {sentence}" for sentence in _remarks(trucks, unnamed)]


def _load(kind: str, of: Pass, readings: Sequence[PeakRatio], shape: str | None) -> PopulationLoad:
    value, sd = np.array([(r.middle, max(r.sd, 1e-6)) for r in readings]).T
    found = population(Readings.independent(value, sd**2), _SCALE)
    q05, q50, q95 = (float(q) for q in np.exp(found.quantiles((0.05, 0.5, 0.95))))
    spread = float(found.weights @ found.spread)
    return PopulationLoad(kind, *of[:3], len(readings), q05, q50, q95, spread, shape)


def pass_words(loads: Sequence[PopulationLoad]) -> list[str]:
    """Load case, speed and axle of every load, and its bump where they have several."""
    several = len({load.shape for load in loads}) > 1
    return [
        f"{x.load_case}, {x.speed_km_h:g} km/h, axle {x.axle}" + (f", {x.shape or 'bump not known'}" if several else "")
        for x in loads
    ]


def _remarks(trucks: Mapping[Pass, Mapping[str, PeakRatio]], unnamed: int) -> Iterator[str]:
    """Sentences about `unnamed` campaigns whose bumps are not known, and about passes over too many bumps."""
    if unnamed:
        yield (
            f"results of {unnamed} campaigns are of an earlier version and do not say which bump their predicted "
            "passes cross: their axle loads are counted apart, as if all scanned bumps were one; run the fleet again"
        )
    groups: dict[tuple[str, float], list[set[str]]] = {}
    for of, readings in trucks.items():
        groups.setdefault((of.load_case, of.speed_km_h), []).append(set(readings))
    for (case, speed), some in sorted(groups.items()):
        if max(map(len, some)) < _LEAST <= len(set[str]().union(*some)):
            yield (
                f"no three trucks cross the same bump in '{case}' at {speed:g} km/h, so there are no axle loads of "
                "this pass; for trucks of different places predict passes over one bump by its shape"
            )
