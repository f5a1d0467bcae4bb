"""Possible places of undeclared rockers: between neighbouring axles that share load between their springs."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sysid.campaign.vehicle_records import Equaliser, Vehicle
from sysid.estimation.fit.optimum import Optimum
from sysid.estimation.fit.part_score import PartCandidate
from sysid.estimation.parameters.rockers import share_name, share_of
from sysid.estimation.parameters.undeclared_parts import UndeclaredParts

#: Axles further apart than this are not joined by a rocker: tandems and tridems stand 1.2 to 1.8 m apart (general
#: knowledge of trucks).
REACH_M = 2.0
#: Axles that one rocker may join.
SIZES = (2, 3)
#: Share at which the derivative is taken: large compared with rounding, small enough for a linear effect.
_STEP = 0.01
#: A rocker that shares less than this is not reported: rubber and brake reactions have the same effect (an assumption).
LEAST_SHARE = 0.15


def joined_axles(vehicle: Vehicle) -> tuple[tuple[int, ...], ...]:
    """Pairs and triples of neighbouring axles of one body, at most 2 m apart, that no group and no rocker joins yet."""
    taken = {i for group in vehicle.groups for i in group.axles} | {i for r in vehicle.equalisers for i in r.axles}
    runs = [tuple(range(first, first + n)) for n in SIZES for first in range(len(vehicle.axles) - n + 1)]

    def possible(axles: tuple[int, ...]) -> bool:
        near = all(
            vehicle.axles[a].body == vehicle.axles[b].body and vehicle.axles[b].x_m - vehicle.axles[a].x_m <= REACH_M
            for a, b in pairwise(axles)
        )
        return near and taken.isdisjoint(axles)

    return tuple(axles for axles in runs if possible(axles))


def rocker_candidates(vehicle: Vehicle) -> tuple[PartCandidate, ...]:
    """Rockers that a vehicle may have besides the declared ones."""
    return tuple(_candidate(axles) for axles in joined_axles(vehicle))


def _candidate(axles: tuple[int, ...]) -> PartCandidate:
    name = f"axles {axles[0] + 1}-{axles[-1] + 1}"

    def plausible(trial: Optimum) -> bool:
        at = trial.problem.model.parameters.names.index(share_name(name))
        return share_of(float(np.exp(trial.vector[at]))) >= LEAST_SHARE

    return PartCandidate(
        f"a rocker between {name}",
        UndeclaredParts(rockers=(Equaliser(name, axles, _STEP),)),
        UndeclaredParts(rockers=(Equaliser(name, axles),)),
        _STEP,
        0.0,
        plausible,
    )
