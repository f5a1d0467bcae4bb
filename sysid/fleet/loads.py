"""Axle loads of a population: what the predictions of its campaigns say of a truck that nobody has measured."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.display import Z90
from sysid.files import read_json
from sysid.fleet.exchangeable import Readings, population
from sysid.fleet.members import Member
from sysid.fleet.outcome import RESULT_FILE

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


class _Kind(NamedTuple):
    """What passes have to have in common; `bump` is what tells bumps apart."""

    load_case: str
    speed_km_h: float
    axle: int
    bump: str


@dataclass(frozen=True)
class _Reading:
    """Median and standard deviation of the logarithm of a ratio, and the name of the bump, None if it is not known."""

    kind: _Kind
    shape: str | None
    middle: float
    sd: float


def _readings(predictions: Iterable[Mapping[str, Any]]) -> Iterator[_Reading]:
    """Those of the predictions of a ``result.json`` that have quantiles."""
    for p in predictions:
        ratio, shape = p["peak_dynamic_load_ratio"], p.get("shape")
        values = [v for q in ("q05", "q50", "q95") if isinstance(v := ratio.get(q), float) and v > 0.0]
        # In results of an earlier version the file's name has that of a shape in it, but none of a scanned bump.
        bump, name = (str(p["file"]), None) if shape is None else (str(shape["sha256"]), str(shape["name"]))
        kind = _Kind(str(p["load_case"]), float(p["speed_km_h"]), int(p["axle"]), bump)
        if len(values) == 3:
            low, middle, high = (math.log(v) for v in values)
            yield _Reading(kind, name, middle, (high - low) / (2.0 * Z90))


def _names(readings: Iterable[_Reading]) -> dict[str, str | None]:
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
    by_member: list[tuple[Member, list[_Reading]]] = []
    for member in members:
        try:
            by_member.append((member, list(_readings(read_json(member.output / RESULT_FILE)["predictions"]))))
        except (ValueError, KeyError, TypeError, OverflowError, AttributeError):
            continue
    names = _names(r for _, readings in by_member for r in readings)
    order = {bump: number for number, bump in enumerate(names)}
    trucks: dict[_Kind, dict[str, _Reading]] = {}
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


def _load(kind: str, of: _Kind, readings: Sequence[_Reading], shape: str | None) -> PopulationLoad:
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


def _remarks(trucks: Mapping[_Kind, Mapping[str, _Reading]], unnamed: int) -> Iterator[str]:
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
