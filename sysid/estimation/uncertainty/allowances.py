"""Allowances of a fit in addition to its parameters: declared masses, and departures of the vehicle from the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimation.parameters.parameter_set import ParameterSet
from sysid.estimation.residuals.bump_model import BumpModel
from sysid.estimation.uncertainty.departures import BUSHING, FRICTION, ONE_SIDED, REACH, RIGID, Departures, departures
from sysid.estimation.uncertainty.uncertain_masses import REACH_SD, UncertainMasses, uncertain_masses, with_sides_of
from sysid.vehicle_model.contact import EffectiveRoad
from sysid.vehicle_model.passes import EffectiveRoads, Pass


@dataclass(frozen=True)
class Allowances:
    """Mass properties with tolerances, and departures from the model.

    `departures` are relative to the effective roads of the wheels at amplitude 0, `departures.roads`.
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

    def within_reach(self, amounts: np.ndarray) -> np.ndarray:
        """Amounts (m + n,) within the range that the simulation follows; friction and bushings are not negative.

        Bushings that hardly give way are rigid.  Derivatives step from there: the step is far shorter than what counts.
        An axle's own part goes no further than that range leaves beside the part that all axles have in common.
        """
        masses, amplitudes = self.split(amounts)
        far = REACH_SD * self.masses.sd
        directions = self.departures.directions
        reach = np.array([REACH[d.kind] for d in directions])
        least = np.array([0.0 if d.kind in ONE_SIDED else -REACH[d.kind] for d in directions])
        bounded = np.clip(amplitudes, least, reach)
        bounded[np.array([d.kind == BUSHING for d in directions], bool) & (bounded < RIGID)] = 0.0
        common = self.departures.common(bounded)
        bounded = np.clip(bounded, np.maximum(least, -reach - common), np.minimum(reach, reach - common))
        return np.concatenate([np.clip(masses, -far, far), bounded])

    def moved(self, model: BumpModel, amounts: np.ndarray) -> BumpModel:
        """The model with other masses and departures than those it was made with; (m + n,)."""
        return self.departed(self.with_masses(model, amounts), amounts)

    def with_masses(self, model: BumpModel, amounts: np.ndarray) -> BumpModel:
        """The model with the masses of `amounts` (m + n,) and without departures; its roads stay."""
        masses = self.split(amounts)[0]
        return replace(model.with_vehicle(*self.masses.applied(masses)), sides=self.masses.side_amounts(masses))

    def on_same_roads(self, model: BumpModel, amounts: np.ndarray) -> BumpModel:
        """The model with other masses and departures (m + n,); its roads stay."""
        return self.departures.on_same_roads(self.with_masses(model, amounts), self.split(amounts)[1])

    def departed(self, model: BumpModel, amounts: np.ndarray) -> BumpModel:
        """A model that has the masses of `amounts` (m + n,) already, with their departures, on roads that follow."""
        log_factors, amplitudes = self.split(amounts)
        return self.departures.model(model, amplitudes, partial(self.masses.load_changes, log_factors))

    def road(self, passes: Sequence[Pass], amounts: np.ndarray) -> EffectiveRoad:
        """Effective roads of the wheels in passes; amounts (m + n,)."""
        log_factors, amplitudes = self.split(amounts)
        changed = self.masses.load_changes(log_factors, [p.load_case for p in passes])
        return self.departures.road(passes, amplitudes, changed)


def campaign_allowances(campaign: Campaign, parameters: ParameterSet, felt: EffectiveRoads) -> Allowances:
    """Allowances of a campaign's vehicle in the load cases of its runs and predictions.

    Parameters
    ----------
    felt : effective roads of the wheels over the bumps in the model.
    """
    return _allowances(campaign, felt, modelled(parameters))


def modelled(parameters: ParameterSet) -> set[tuple[str, int]]:
    """Kinds and axles of departures that the laws of the axles have already."""
    kinds = {"friction": FRICTION, "bushing_stiffness": BUSHING}
    return {(kinds[p.quantity], p.axle) for p in parameters.parameters if p.quantity in kinds and p.axle is not None}


def without_friction(campaign: Campaign, parameters: ParameterSet, felt: EffectiveRoads) -> Allowances:
    """Allowances for a comparison in which friction is one of the laws that are compared."""
    rubbing = {(FRICTION, i) for i in range(len(campaign.vehicle.axles))}
    return _allowances(campaign, felt, modelled(parameters) | rubbing)


def _allowances(campaign: Campaign, felt: EffectiveRoads, known: set[tuple[str, int]]) -> Allowances:
    driven = {run.bump for run in campaign.bump_runs}
    masses = with_sides_of(uncertain_masses(campaign), campaign, felt)
    return Allowances(masses, departures(felt, campaign.load_cases_in_use, known, driven))
