"""Calibrated values of every suspension and tire in one load case."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np

from sysid.campaign.records import Campaign
from sysid.estimates.calibrated_elements import CalibratedFrame, CalibratedSuspension, CalibratedVehicle
from sysid.estimates.loops import calibrated_laws
from sysid.estimation.fit.fit_result import FitResult
from sysid.estimation.parameters.parameter_set import bending_names
from sysid.estimation.parameters.rockers import load_shares
from sysid.posterior.sampled_posterior import Posterior
from sysid.sdof.drop_results import DropSummary
from sysid.vehicle_model.bending import frame_modes
from sysid.vehicle_model.contact import TireLaw, tangents
from sysid.vehicle_model.suspension import (
    REFERENCE_RATE_M_S,
    Ramps,
    SuspensionLaw,
    damper_force,
    spring_force,
)

#: Range and steps of the curves: extension [m] and rate [m/s].
_EXTENSION_M = np.linspace(-0.2, 0.2, 81)
_RATE_M_S = np.linspace(-3.0, 3.0, 121)
#: Extension on either side of rest that gives the tangent [m].
_SMALL_M = 1e-6


def calibrated_vehicle(
    campaign: Campaign, drops: DropSummary | None, fit: FitResult, posterior: Posterior | None, load_case: str
) -> CalibratedVehicle:
    """Laws of a load case at the posterior medians, at the least-squares values before sampling.

    Raises
    ------
    KeyError
        If the load case has no stiffness of its own because nobody drove in it.
    """
    sampled = {} if posterior is None else {s.name: s for s in posterior.summaries}
    medians = {name: s.q50 for name, s in sampled.items()}
    law, tire, carried = calibrated_laws(campaign, drops, fit, load_case, medians)
    suspended = sorted(set(campaign.vehicle.suspension_axle))
    suspensions = tuple(
        _suspension(law, i, campaign.vehicle.axles[i].name, name, float(carried[i]))
        for i, name in zip(suspended, fit.laws, strict=True)
    )
    stiffness, damping = tire_tangents(tire)
    source = "least squares" if posterior is None else "posterior median"
    rockers = load_shares(campaign.vehicle, fit.parameters, sampled)
    frames = _frames(campaign, load_case, {p.name: medians.get(p.name, p.value) for p in fit.parameters})
    return CalibratedVehicle(load_case, source, suspensions, stiffness, damping, rockers, frames)


def _frames(campaign: Campaign, load_case: str, values: Mapping[str, float]) -> tuple[CalibratedFrame, ...]:
    """Frames that bend, in a load case: more mass on a frame that is as stiff lowers its frequency and damping."""
    vehicle, first = campaign.vehicle, next(iter(campaign.load_cases.values()))
    frames = []
    for mode in frame_modes(vehicle, campaign.load_cases[load_case], first):
        name = vehicle.bodies[mode.body].name
        frequency, ratio = (values[n] for n in bending_names(name))
        slower = float(np.sqrt(mode.stiffness_mass / mode.modal_mass))
        axles = tuple(i for i, a in enumerate(vehicle.axles) if a.body == mode.body)
        frames.append(CalibratedFrame(mode.body, name, axles, frequency * slower, ratio * slower, mode.modal_mass))
    return tuple(frames)


def calibrated_vehicles(
    campaign: Campaign, drops: DropSummary | None, fit: FitResult, posterior: Posterior | None
) -> tuple[CalibratedVehicle, ...]:
    """:func:`calibrated_vehicle` of every load case for which there are data.

    If a load case has a stiffness of its own and nobody drove it, it has no vehicle.
    """
    vehicles = []
    for name in campaign.load_cases:
        try:
            vehicles.append(calibrated_vehicle(campaign, drops, fit, posterior, name))
        except KeyError:
            continue
    return tuple(vehicles)


def _suspension(law: SuspensionLaw, axle: int, name: str, words: str, static_load: float) -> CalibratedSuspension:
    def on_axle(function: Callable[[SuspensionLaw, jax.Array], jax.Array], values: np.ndarray) -> np.ndarray:
        """Force over a row of extensions or rates of this axle."""
        rows = np.broadcast_to(values, (*law.stiffness.shape[:2], len(values)))
        return np.asarray(np.asarray(function(law, jnp.asarray(rows)))[0, axle])

    extension = _grid(_grid(_EXTENSION_M, law.ramps, axle), law.stops, axle)
    rate = _grid(_RATE_M_S, law.rate_ramps, axle)
    low, high = on_axle(spring_force, np.array([-_SMALL_M, _SMALL_M]))
    back, forth = on_axle(damper_force, np.array([-REFERENCE_RATE_M_S, REFERENCE_RATE_M_S]))
    return CalibratedSuspension(
        axle=axle,
        name=name,
        law=words,
        static_load_N=static_load,
        stiffness_N_per_m=float(high - low) / (2.0 * _SMALL_M),
        damping_N_s_per_m=float(forth - back) / (2.0 * REFERENCE_RATE_M_S),
        extension_m=extension,
        spring_force_N=on_axle(spring_force, extension),
        rate_m_s=rate,
        damper_force_N=on_axle(damper_force, rate),
        friction_N=0.0 if law.friction is None else float(law.friction[0, axle, 0]),
    )


def _grid(base: np.ndarray, ramps: Ramps | None, axle: int) -> np.ndarray:
    """The points of a curve with the corners of its law, which interpolation would round off."""
    if ramps is None:
        return base
    corners = np.broadcast_to(np.asarray(ramps.at), np.shape(ramps.slope))[:, 0, axle, 0]
    inside = corners[(corners > base[0]) & (corners < base[-1])]
    # Points that differ by rounding alone would be one abscissa with two ordinates in a file.
    return np.unique(np.round(np.concatenate([base, inside]), 9))


def tire_tangents(tire: TireLaw) -> tuple[np.ndarray, np.ndarray]:
    """Tangent stiffness [N/m] and damping [N s/m] of the tires in the first pass (axles,) at their static load."""
    shape = np.shape(tire.static_deflection)
    x = np.asarray(tire.static_deflection / tire.reference_deflection)[0, :, 0]
    secant = np.asarray(tire.reference_load / tire.reference_deflection)[0, :, 0]
    exponent = np.broadcast_to(np.asarray(tire.exponent), shape)[0, :, 0]
    damping = np.broadcast_to(np.asarray(tire.damping), shape)[0, :, 0]
    growth = np.broadcast_to(np.asarray(tire.growth), shape)[0, :, 0]
    return tangents(exponent * secant, damping, exponent, x, growth)
