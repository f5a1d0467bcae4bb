"""Wheel loads of a population: what the predictions of its campaigns say of a truck that nobody has measured."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sysid.display import Z90
from sysid.files import read_json
from sysid.fleet.assembly import Member
from sysid.fleet.exchangeable import Readings, population
from sysid.fleet.outcome import RESULT_FILE

#: Scale of the half-Cauchy prior of the spread of the logarithm of a peak load ratio between trucks.
_SCALE = 0.1
#: Trucks that a population needs.
_LEAST = 3


@dataclass(frozen=True)
class PopulationLoad:
    """Peak dynamic load ratio of one axle in one kind of pass: quantiles over the trucks of a type, one of them new.

    `trucks` that predicted this pass; `spread` relative standard deviation between them.
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


def population_loads(kind: str, members: Iterable[Member]) -> list[PopulationLoad]:
    """Loads of every pass that at least three trucks of a type have in common, by a normal of their logarithms.

    Of several campaigns of a truck the last one counts: their errors have masses and tires in common, so that an
    average would look more certain than it is.
    """
    readings: dict[tuple[str, float, int], dict[str, tuple[float, float]]] = {}
    for member in members:
        try:
            document = read_json(member.output / RESULT_FILE)
            passes = [(str(p["load_case"]), float(p["speed_km_h"]), int(p["axle"]), dict(p["peak_dynamic_load_ratio"]))
                      for p in document["predictions"]]  # fmt: skip
        except (ValueError, KeyError, TypeError, OverflowError):
            continue
        for case, speed, axle, ratio in passes:
            values = [v for q in ("q05", "q50", "q95") if isinstance(v := ratio.get(q), float) and v > 0.0]
            if len(values) == 3:
                low, middle, high = (math.log(v) for v in values)
                readings.setdefault((case, speed, axle), {})[member.truck] = (middle, (high - low) / (2.0 * Z90))
    loads = []
    for (case, speed, axle), trucks in sorted(readings.items()):
        if len(trucks) < _LEAST:
            continue
        value, sd = np.array(list(trucks.values())).T
        of = population(Readings.independent(value, np.maximum(sd, 1e-6) ** 2), _SCALE)
        q05, q50, q95 = np.exp(of.quantiles((0.05, 0.5, 0.95)))
        spread = float(of.weights @ of.spread)
        loads.append(PopulationLoad(kind, case, speed, axle, len(trucks), float(q05), float(q50), float(q95), spread))
    return loads
