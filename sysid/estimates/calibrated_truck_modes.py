"""Natural modes of the calibrated truck."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.campaign.records import Campaign
from sysid.campaign.vehicle_records import LoadCase
from sysid.errors import SysidError
from sysid.estimates.calibrated import calibrated_vehicle
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.fit.law_choice import laws_from_names
from sysid.estimation.parameters.parameter_set import bending_names
from sysid.estimation.parameters.rockers import LoadShare, load_shares, shares_by_axle
from sysid.posterior.sampled_posterior import Posterior
from sysid.vehicle_model.contact import tangents
from sysid.vehicle_model.vibration_modes import NaturalModes, natural_modes


def calibrated_modes(campaign: Campaign, fit: FitResult, posterior: Posterior | None) -> tuple[NaturalModes, ...]:
    """Modes in every load case whose suspension parameters are known; posterior medians, else least squares.

    A suspension counts with its tangent at rest in the load case, which differs from k where a spring table bends, and
    with its c.
    The tire counts with its tangent at the static load F of the load case, k_t (F / F_ref)^(1 - 1/n) of its law
    F_ref (u / u_ref)^n, and with the damping c_t that it has there.  Friction and stops have no part in it.
    """
    medians = {} if posterior is None else {s.name: s.q50 for s in posterior.summaries}
    values = {(p.quantity, p.axle, p.load_case): medians.get(p.name, p.value) for p in fit.parameters}
    sampled = None if posterior is None else {s.name: s for s in posterior.summaries}
    shares = load_shares(campaign.vehicle, fit.parameters, sampled)
    by_name = {p.name: medians.get(p.name, p.value) for p in fit.parameters}
    bending = {
        body.name: (by_name[hz], by_name[ratio])
        for body in campaign.vehicle.bodies
        for hz, ratio in [bending_names(body.name)]
        if body.bending is not None
    }
    modes = []
    for case in campaign.load_cases.values():
        try:
            known = _with_tangents(campaign, fit, posterior, case, values)
            growth = np.array(fit.tire_growth or [1.0] * len(campaign.vehicle.axles))
            modes.append(_modes(campaign, case, known, growth, shares, bending))
        except (KeyError, SysidError):
            # A load case that nobody drove has no stiffness of its own; with values far off the vehicle may be
            # unstable.
            continue
    return tuple(modes)


def _with_tangents(
    campaign: Campaign,
    fit: FitResult,
    posterior: Posterior | None,
    case: LoadCase,
    values: dict[tuple[str, int | None, str | None], float],
) -> dict[tuple[str, int | None, str | None], float]:
    """The values with the tangents of tabulated springs at rest in a load case."""
    suspended = sorted(set(campaign.vehicle.suspension_axle))
    laws = laws_from_names(campaign.vehicle, fit.laws)
    tabulated = [i for i in suspended if "spring_table" in laws[i]]
    if not tabulated:
        return values
    vehicle = calibrated_vehicle(campaign, None, fit, posterior, case.name)
    tangent = {s.axle: s.stiffness_N_per_m for s in vehicle.suspensions}
    return {**values, **{("stiffness", i, case.name): tangent[i] for i in tabulated}}


def _modes(
    campaign: Campaign,
    case: LoadCase,
    values: dict[tuple[str, int | None, str | None], float],
    growth: np.ndarray,
    shares: tuple[LoadShare, ...],
    bending: Mapping[str, tuple[float, float]],
) -> NaturalModes:
    vehicle = campaign.vehicle
    first = next(iter(campaign.load_cases.values()))
    exponent = values.get(("tire_exponent", None, None), 1.0)

    def of_axle(quantity: str, axle: int, default: float | None = None) -> float:
        for key in ((quantity, axle, case.name), (quantity, axle, None)):
            if key in values:
                return values[key]
        if default is None:
            raise KeyError(quantity)
        return default

    load = np.array(case.axle_loads_kg) / np.array(first.axle_loads_kg)
    deflection = load ** (1.0 / exponent)
    tire = [of_axle("tire_stiffness", i, a.tire_stiffness_N_per_m) for i, a in enumerate(vehicle.axles)]
    tire_damping = [of_axle("tire_damping", i, a.tire_damping_N_s_per_m) for i, a in enumerate(vehicle.axles)]
    at_rest, damping_at_rest = tangents(np.array(tire), np.array(tire_damping), exponent, deflection, growth)
    return natural_modes(
        vehicle,
        case,
        np.array([of_axle("stiffness", i) for i in vehicle.suspension_axle]),
        np.array([of_axle("damping", i) for i in vehicle.suspension_axle]),
        at_rest,
        damping_at_rest,
        shares_by_axle(vehicle, shares),
        first,
        bending,
    )
