"""A fit that has found the values of the hand-written truck of six axles, without a fit."""

from __future__ import annotations

import numpy as np
from coupled_truck import EXPONENT
from fit_states import state_at
from independent_truck import IndependentTruck
from rigid_truck import SENSORS, bump, campaign, empty_run

from sysid.campaign.vehicle_records import EXACT_MASSES, Axle, Body, LoadCase, Vehicle
from sysid.estimation.fit.state import FitState
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.residuals.bump_model import bump_model
from sysid.estimation.residuals.residual_weights import Weights
from sysid.estimation.residuals.run_motion import RunMotion


def truck_of(truck: IndependentTruck) -> tuple[Vehicle, LoadCase]:
    """The truck of the hand-written equations as the package has it."""
    axles = tuple(
        Axle(f"axle {i + 1}", truck.body[i], truck.x_m[i], truck.unsprung_kg[i], truck.tire_N_per_m[i],
             truck.tire_N_s_per_m[i], truck.radius_m[i], "other")
        for i in range(6)
    )  # fmt: skip
    ((at, height),) = truck.hitch
    bodies = Body("tractor"), Body("trailer", at, height)
    return Vehicle("lowboy", bodies, axles, tolerances=EXACT_MASSES), LoadCase("laden", *truck.load_cases["laden"])


def state_of(truck: IndependentTruck) -> FitState:
    """A fit that has found the truck's own values."""
    vehicle, load = truck_of(truck)
    run = empty_run("a.csv", 9.0, load_case="laden", sensors=SENSORS[:6])
    data = campaign([run], vehicle=vehicle, load_cases=[load])
    parameters = campaign_parameters(data, None)
    model = bump_model(data, parameters, {"bump": bump()}, contact="point")
    truth = {"tire_exponent": EXPONENT}
    for i in range(6):
        truth |= {f"k_{i + 1}": truck.stiffness[i], f"c_{i + 1}": truck.damping[i]}
        truth |= {f"kt_{i + 1}": truck.tire_N_per_m[i], f"ct_{i + 1}": truck.tire_N_s_per_m[i]}
    sets = np.log([truth[name] for name in parameters.names])
    scale = np.ones((1, len(model.layout.sensors)))
    return state_at(data, model, sets, RunMotion.steady(np.array([9.0]), np.array([0.5])), Weights((scale,), (scale,)))
