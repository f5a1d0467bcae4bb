"""Bump stops in predicted passes where the campaign file declares no travel and the runs have shown no stop.

Every truck has stops.  Where none was declared and the fit needed none, their travels come from what is generally known
of the kind of suspension (:mod:`sysid.estimation.parameters.suspension_elements`), given that they are longer than what
the driven runs reached, which the fit explains without stops.  Every draw has travels and stop stiffnesses of its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from sysid.arrays import Axles, AxlesBySets
from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.parameters.axle_laws import ElementIndex, LawInputs
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.estimation.parameters.parameter_set import Parameter, ParameterSet
from sysid.estimation.parameters.suspension_elements import ELEMENTS, ElementQuantity, law_elements
from sysid.prediction.trust import DrivenRange

_QUANTITIES = {q.quantity: q for q in ELEMENTS["estimated_bump_stops"].quantities}


@dataclass(frozen=True)
class AssumedStops:
    """Stops of n vehicles on the `axles` (indices) that get assumed ones.

    `values` (n, axles) by quantity: travels [m] and stop stiffness [N/m].
    """

    axles: tuple[int, ...]
    values: dict[str, np.ndarray]

    def first(self, count: int) -> AssumedStops:
        """Those of the first vehicles."""
        return AssumedStops(self.axles, {name: v[:count] for name, v in self.values.items()})

    def on(self, inputs: LawInputs, vehicle: int) -> LawInputs:
        """Law inputs with the stops of one vehicle."""
        elements = dict(inputs.elements)
        for name, values in self.values.items():
            given = elements.get(name)
            none = np.full(inputs.damping.size, _QUANTITIES[name].neutral)
            neutral = none if given is None else given.neutral.copy()
            neutral[list(self.axles)] = values[vehicle]
            position = np.full(neutral.size, -1) if given is None else given.position
            elements[name] = ElementIndex(position, neutral)
        return inputs._replace(elements=elements)

    def acting(self, jounce_m: AxlesBySets, rebound_m: AxlesBySets) -> dict[int, tuple[str, float]]:
        """Direction and travel [m] (median) of stops that act in at least half of the draws, by axle (index).

        Parameters
        ----------
        jounce_m, rebound_m : (all axles, S) largest compression and extension of each draw.
        """
        acting: dict[int, tuple[str, float]] = {}
        for k, axle in enumerate(self.axles):
            for direction, reached in (("rebound", rebound_m), ("jounce", jounce_m)):
                travel = self.values[f"{direction}_travel"][:, k]
                if np.mean(reached[axle] > travel) >= 0.5:
                    acting[axle] = direction, float(np.median(travel))
        return acting


def axles_without_stops(vehicle: Vehicle, parameters: Iterable[Parameter | ParameterEstimate]) -> tuple[int, ...]:
    """Axles (indices) with a suspension of which neither the campaign file nor the fit says where it stops.

    A declared `suspension_law` is taken at its word.

    Parameters
    ----------
    parameters : of a fit, before or after it.
    """
    laws = {p.axle: law_elements(p.law) for p in parameters if p.quantity == "stiffness"}
    return tuple(
        i
        for i in sorted(set(vehicle.suspension_axle))
        if vehicle.axles[i].suspension_law is None
        and not vehicle.axles[i].has_stops
        and not laws[i] & {"bump_stops", "estimated_bump_stops"}
    )


def assumed_stops(
    vehicle: Vehicle, parameters: ParameterSet, driven: DrivenRange, random: np.random.Generator | None, count: int = 1
) -> AssumedStops | None:
    """Stops of `count` vehicles, drawn from their priors, or medians without `random`; None where none is missing.

    Parameters
    ----------
    driven : what the driven runs reached: travels are longer.
    """
    axles = axles_without_stops(vehicle, parameters.parameters)
    if not axles:
        return None
    reached: dict[str, Axles] = {"jounce_travel": driven.jounce_m, "rebound_travel": driven.rebound_m}

    def values(q: ElementQuantity) -> np.ndarray:
        # None of their medians depends on the load.
        median = np.array([q.median(vehicle.axles[i], 0.0) for i in axles])
        least = reached[q.quantity][list(axles)] if q.quantity in reached else np.zeros(len(axles))
        shares = np.full((count, len(axles)), 0.5) if random is None else random.uniform(size=(count, len(axles)))
        # Quantiles of the lognormal prior above `least`.
        beyond = ndtr(-np.log(np.maximum(least, 1e-9) / median) / q.sd)
        return np.asarray(median * np.exp(-q.sd * ndtri((1.0 - shares) * beyond)))

    return AssumedStops(axles, {name: values(q) for name, q in _QUANTITIES.items()})
