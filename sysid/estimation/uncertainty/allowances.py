"""What a fit holds fixed and allows for: declared mass properties, and departures of the vehicle from the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.arrays import Masses
from sysid.campaign.records import Campaign
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.uncertainty.departures import Departures, departures
from sysid.estimation.uncertainty.uncertain_masses import UncertainMasses, uncertain_masses
from sysid.vehicle_model.passes import EffectiveRoads


@dataclass(frozen=True)
class Allowances:
    """Mass properties with tolerances, and departures from the model.

    `departures` are about what the wheels feel at amplitude 0, `departures.roads`.
    """

    masses: UncertainMasses
    departures: Departures

    @property
    def count(self) -> int:
        """Number m + n of factors on masses and amplitudes of departures."""
        return len(self.masses.factors) + len(self.departures.directions)

    def split(self, amounts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Log factors on masses (m,) and amplitudes (n,) from both (m + n,)."""
        masses = len(self.masses.factors)
        return amounts[:masses], amounts[masses:]

    def with_masses(self, model: BumpModel, log_factors: Masses) -> BumpModel:
        """The model with mass properties times exp(`log_factors`), (m,)."""
        return model.with_vehicle(*self.masses.applied(log_factors))

    def departed(self, model: BumpModel, amplitudes: np.ndarray) -> BumpModel:
        """The model moved along the departures by `amplitudes`, (n,)."""
        return self.departures.model(model, amplitudes)

    def moved(self, model: BumpModel, amounts: np.ndarray) -> BumpModel:
        """The model with other masses and departed from what it was made as; (m + n,)."""
        log_factors, amplitudes = self.split(amounts)
        return self.departed(self.with_masses(model, log_factors), amplitudes)


def campaign_allowances(campaign: Campaign, parameters: ParameterSet, felt: EffectiveRoads) -> Allowances:
    """Allowances of a campaign's vehicle in the load cases of its runs and predictions.

    Parameters
    ----------
    felt : what the wheels feel of the bumps in the model.
    """
    rubbing = {p.axle for p in parameters.parameters if p.quantity == "friction"}
    axles = range(len(campaign.vehicle.axles))
    directions = departures(felt, campaign.load_cases_in_use, [i in rubbing for i in axles])
    return Allowances(uncertain_masses(campaign), directions)
