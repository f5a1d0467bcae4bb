"""Bump stops that nobody declared, in the comparison of laws: where they begin, and which of them act."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sysid.campaign.vehicle_records import Vehicle
from sysid.estimation.fit.law_screen import reached_travels, tried_travel
from sysid.estimation.fit.optimum import Optimum, parameter_sd
from sysid.estimation.fit.search_plan import first_sight, trial
from sysid.estimation.parameters.law_families import STOPS, Laws
from sysid.estimation.parameters.suspension_elements import TRAVELS

#: Standard deviation over that of its prior from which on the stiffness of a stop is not known from the data.
IDLE_SHRINKAGE = 0.9
#: By how much in the logarithm a second search begins with nearer stops: two and a half standard deviations of the
#: prior of their travels, nearer than nearly all of them.
NEARER = 0.3
#: A stop that the runs compress by less than this share of its travel is touched only.
TOUCHED = 0.05
#: Travel of a stop beyond the reach of the runs, over their largest travel.
BEYOND = 1.1


def with_stops_that_act(laws: Laws, optimum: Optimum) -> Laws:
    """The laws without those undeclared stops that the axles do not show.

    An axle shows them if the data determine their stiffness better than its prior, and if it is not softer than the
    spring. Otherwise a parameter is not determined and slows every search, or the stop imitates something else.
    """
    if not any(STOPS in law for law in laws):
        return laws
    parameters, sd = optimum.problem.model.parameters, parameter_sd(optimum)
    kept = []
    for axle, law in enumerate(laws):
        owner = parameters.suspension_axle[axle] if parameters.suspension_axle else axle
        springs = [i for i, p in enumerate(parameters.parameters) if (p.quantity, p.axle) == ("stiffness", owner)]
        shown = False
        if STOPS in law:
            stop = parameters.index("stop_stiffness", axle)
            known = sd[stop] < IDLE_SHRINKAGE * parameters.parameters[stop].prior_sd
            shown = bool(known and optimum.vector[stop] > optimum.vector[springs].min())
        kept.append(law if shown else law - {STOPS})
    return tuple(kept)


def axles_with(element: str, vehicle: Vehicle, laws: Laws, declared: Laws) -> list[int]:
    """First axles of the suspensions with an element that nobody declared."""
    all_of = zip(vehicle.suspension_axle, laws, declared, strict=True)
    return sorted({owner for owner, law, given in all_of if element in law - given})


def without_on_axle(element: str, vehicle: Vehicle, laws: Laws, first: int) -> Laws:
    """The laws without an element on the axles of one suspension."""
    owners = zip(vehicle.suspension_axle, laws, strict=True)
    return tuple(law - {element} if owner == first else law for owner, law in owners)


def with_nearer_stops(laws: Laws, optimum: Optimum, fitted: Callable[..., Optimum]) -> Optimum:
    """The better of an optimum and of a search that begins with shorter values of the travels that were not reached.

    A stop beyond what the runs reach has no effect, so no search moves it. A stop inside is pushed out if there is
    none.
    """
    parameters, sd = optimum.problem.model.parameters.parameters, parameter_sd(optimum)
    unreached = [i for i, p in enumerate(parameters) if p.quantity in TRAVELS and sd[i] >= IDLE_SHRINKAGE * p.prior_sd]
    if not unreached:
        return optimum
    vector, reached = optimum.vector.copy(), reached_travels(optimum)
    for i in unreached:
        inside = reached.get((parameters[i].quantity, parameters[i].axle or 0))
        vector[i] = min(vector[i] - NEARER, np.log(tried_travel(float(np.exp(vector[i])), inside)))
    again = fitted(laws, replace(optimum, vector=vector), first_sight)
    return again if again.misfit < optimum.misfit else optimum


def with_released_stops(laws: Laws, optimum: Optimum, fitted: Callable[..., Optimum]) -> Optimum:
    """The better of an optimum and of a search that begins with those stops out of reach that the runs only touch.

    A search that pushes a stop out ends where the runs still touch it, if other parameters have adapted to its force.
    """
    if not any(STOPS in law for law in laws):
        return optimum
    parameters, reached = optimum.problem.model.parameters.parameters, reached_travels(optimum)
    vector = optimum.vector.copy()
    for i, p in enumerate(parameters):
        if p.quantity in TRAVELS:
            most, travel = reached.get((p.quantity, p.axle or 0), 0.0), float(np.exp(vector[i]))
            if most * (1.0 - TOUCHED) < travel < min(most * BEYOND, p.prior_median):
                vector[i] = max(np.log(p.prior_median), np.log(BEYOND * most))
    if np.array_equal(vector, optimum.vector):
        return optimum
    again = fitted(laws, replace(optimum, vector=vector), trial)
    return again if again.minimum.cost < optimum.minimum.cost else optimum
