"""What another campaign of the same truck may share with a fit, from the information of its data."""

from __future__ import annotations

import numpy as np

from sysid.estimation.uncertainty.allowances import Allowances
from sysid.estimation.uncertainty.departures import ENVELOPE, FOOTPRINT, SPOKES, TIRE_DAMPING, TIRE_LOAD
from sysid.estimation.uncertainty.further_unknowns import FurtherUnknown, FurtherUnknowns
from sysid.estimation.uncertainty.information import AdjustedInformation
from sysid.estimation.uncertainty.mass_factor import MassFactor
from sysid.estimation.uncertainty.normal_equations import NormalEquations
from sysid.estimation.uncertainty.uncertain_masses import (
    AXLE_LOAD,
    CG_HEIGHT,
    HITCH_HEIGHT,
    INERTIA,
    SCALE,
    UNSPRUNG,
    UncertainMasses,
)

#: Kinds of masses and departures that two campaigns can share. Friction and bushings wear: they are compared.
_OF_MASSES = (UNSPRUNG, INERTIA, CG_HEIGHT, HITCH_HEIGHT, AXLE_LOAD, SCALE)
_OF_TIRES = (ENVELOPE, FOOTPRINT, SPOKES, TIRE_LOAD, TIRE_DAMPING)


def further_unknowns(allowances: Allowances, adjusted: AdjustedInformation) -> FurtherUnknowns:
    """What another campaign of the same truck may share with a fit; other unknowns are integrated out.

    Parameters
    ----------
    allowances : masses and departures of the fit.
    adjusted : what its data say of parameters, masses and departures.
    """
    data, count = adjusted.data, len(adjusted.data.prior)
    named = [_named(allowances, j, float(sd)) for j, sd in enumerate(data.sd)]
    chosen = [j for j, unknown in enumerate(named) if unknown is not None and data.sd[j] > 0.0]
    # Parameters as they are reported: their footprint maps follow.
    change = np.eye(len(data.matrix))
    change[:count, :count] = adjusted.integrated.following
    equations = NormalEquations.of(change.T @ data.matrix @ change, prior=data.prior, sd=data.sd)
    rows, sd = count + np.array(chosen, int), data.sd[chosen]
    joint = equations.covariance
    covariance = joint[np.ix_(rows, rows)] / np.outer(sd, sd)
    sensitivity = np.linalg.solve(covariance, (joint[:count, rows] / sd).T).T
    unknowns = tuple(unknown for j in chosen if (unknown := named[j]) is not None)
    # Not where the fit ended: an estimate must belong to its covariance, above all where both are next to nothing.
    return FurtherUnknowns(unknowns, adjusted.mode[chosen] / sd, covariance, sensitivity)


def _named(allowances: Allowances, number: int, sd: float) -> FurtherUnknown | None:
    """What the unknown of some number is; None for one that no other campaign shares."""
    masses = allowances.masses
    if number < len(masses.factors):
        factor = masses.factors[number]
        if factor.quantity not in _OF_MASSES:
            return None
        beam = factor.quantity == UNSPRUNG and factor.axle is None
        place = None if factor.quantity == SCALE else factor.place
        return FurtherUnknown(factor.quantity, place, beam, factor.load_case, _declared(masses, factor), sd)
    direction = allowances.departures.directions[number - len(masses.factors)]
    if direction.kind not in _OF_TIRES:
        return None
    axles = masses.vehicle.axles
    chosen = axles if direction.axle is None else (axles[direction.axle],)
    stiffness = sum(a.tire_stiffness_N_per_m for a in chosen)
    return FurtherUnknown(direction.kind, direction.axle, False, direction.load_case, stiffness, sd)


def _declared(masses: UncertainMasses, factor: MassFactor) -> float:
    vehicle, case = masses.vehicle, masses.load_cases[factor.load_cases[0]]
    if factor.quantity == UNSPRUNG:
        part = vehicle.groups[factor.place] if factor.axle is None else vehicle.axles[factor.place]
        return float(getattr(part, "mass_kg" if factor.axle is None else "unsprung_mass_kg"))
    if factor.quantity == HITCH_HEIGHT:
        return float(vehicle.bodies[factor.place].hitch_height_m or 0.0)
    values = {INERTIA: case.pitch_inertia_kg_m2, CG_HEIGHT: case.cg_height_m, AXLE_LOAD: case.axle_loads_kg}
    return float(values[factor.quantity][factor.place]) if factor.quantity in values else 1.0
