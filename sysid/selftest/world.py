"""The source of simulated readings: a vehicle drawn from the priors, its masses, and its effective roads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.parameters.map_tires import map_tires
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.uncertainty.uncertain_masses import uncertain_masses
from sysid.road.contact_laws import CONTACT_LAWS, ContactLaw
from sysid.road.road_profile import RoadProfile
from sysid.vehicle_model.passes import EffectiveRoads


@dataclass(frozen=True)
class World:
    """The truth behind readings: the campaign with true masses, parameters with their true logarithms (p,), roads."""

    campaign: Campaign
    parameters: ParameterSet
    log_parameters: np.ndarray
    roads: EffectiveRoads

    @property
    def values(self) -> dict[str, float]:
        """True values by parameter name."""
        return {n: float(np.exp(v)) for n, v in zip(self.parameters.names, self.log_parameters, strict=True)}


def draw_parameters(parameters: ParameterSet, random: np.random.Generator) -> np.ndarray:
    """One draw (p,) of the log parameters from their prior, links included.

    With rows A and targets b of the prior, A x - b standard normal, x = (A'A)^-1 A'b + L^-T z with L L' = A'A.
    """
    rows, targets = parameters.prior_rows()
    precision = rows.T @ rows
    factor = np.linalg.cholesky(precision)
    mean = np.linalg.solve(precision, rows.T @ targets)
    return np.asarray(mean + np.linalg.solve(factor.T, random.standard_normal(mean.size)))


def draw_world(
    campaign: Campaign,
    parameters: ParameterSet,
    profiles: Mapping[str, RoadProfile],
    random: np.random.Generator,
    contact: ContactLaw = "footprint",
) -> World:
    """A vehicle from the priors: its parameters, and masses within the tolerances of the declared ones."""
    masses = uncertain_masses(campaign)
    vehicle, load_cases = masses.applied(masses.sd * random.standard_normal(masses.sd.size))
    true = replace(campaign, vehicle=vehicle, load_cases=load_cases)
    values = draw_parameters(parameters, random)
    tires = map_tires(parameters, values) if CONTACT_LAWS[contact].follows_tires else None
    return World(true, parameters, values, EffectiveRoads(vehicle, load_cases, profiles, contact, tires))
