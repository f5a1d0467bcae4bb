"""Friction in proportion to the load and stops that stiffen, from a campaign's parameters to motion, against DOP853."""

from __future__ import annotations

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import DURATION_S, FINE_S, OUTPUT_S, UNSPRUNG, Truck, X, relative_rms
from rigid_truck import AXLES, DAMPING, EMPTY, LADEN, STIFFNESS, VEHICLE, campaign, empty_run
from simulated_truck import simulated_truck

from sysid.estimation.parameters.axle_laws import axle_laws, law_inputs
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import effective_road
from sysid.vehicle_model.passes import PassBatch
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw

HEIGHTS_M = (0.045, 0.01)
FRICTION, SLIP_M = np.array([1500.0, 900.0, 1200.0]), 1e-3
STOP_N_PER_M, TRAVEL_M = 1.5e6, np.array([0.006, 0.004, 0.004])
#: Compressions at which the straight pieces of F = k d (1 + d / 15 mm) meet the curve; beyond, its tangent.
KNOTS_M = np.array([0.0, 0.006, 0.014])
CHANNELS = ("deflection", "axle_acceleration", "body_acceleration", "tire_force", "suspension_force")


def stop(d: np.ndarray) -> np.ndarray:
    """Force of a stop that is compressed by d, 0 before it is touched."""
    curve = STOP_N_PER_M * KNOTS_M * (1.0 + KNOTS_M / 0.015)
    beyond = curve[-1] + STOP_N_PER_M * (1.0 + 2.0 * KNOTS_M[-1] / 0.015) * (d - KNOTS_M[-1])
    return np.where(d > KNOTS_M[-1], beyond, np.interp(d, KNOTS_M, curve))


def law_of_the_parameters() -> SuspensionLaw:
    """The law of the laden truck, stiffness and friction stated for the empty one."""
    axles = tuple(
        replace(a, suspension_law="friction", load_dependent=False, jounce_travel_m=t, rebound_travel_m=t)
        for a, t in zip(AXLES, TRAVEL_M, strict=True)
    )
    runs = [empty_run("a.csv", 6.0), empty_run("b.csv", 6.0, load_case="laden")]
    data = campaign(runs, load_cases=(EMPTY, LADEN), vehicle=replace(VEHICLE, axles=axles))
    parameters = campaign_parameters(data, None)
    behind = {"slip": SLIP_M}
    for i in range(3):
        own = {"k": STIFFNESS[i], "c": DAMPING[i], "F": FRICTION[i], "stop": STOP_N_PER_M}
        behind |= {f"{symbol}_{i + 1}": value for symbol, value in own.items()}
    assert set(behind) <= set(parameters.names)
    logs = np.log([behind.get(p.name, p.start) for p in parameters.parameters])
    matrices = stack_matrices([assemble(data.vehicle, LADEN)] * 2, [])
    reference = np.tile(np.array(EMPTY.axle_loads_kg)[:, None] * 9.81, (2, 1, 1))
    flat = effective_road(np.arange(-20.0, 20.0) * 0.1, np.zeros((2, 3, 40)))
    batch = PassBatch(matrices, flat, X[:, None], reference)
    return axle_laws(law_inputs(data.vehicle, parameters, batch, ["laden"] * 2), jnp.asarray(logs)[:, None])[0]


@pytest.mark.parametrize("growing", [True, False], ids=["in proportion", "negative control"])
def test_friction_and_stops_of_a_laden_truck(growing):
    empty, laden = (np.array(c.axle_loads_kg) - UNSPRUNG for c in (EMPTY, LADEN))
    friction = FRICTION * laden / empty if growing else FRICTION

    def pull(e, v, phi):
        return STIFFNESS * e + DAMPING * v + friction * phi + stop(e - TRAVEL_M) - stop(-e - TRAVEL_M)

    times, every = np.arange(round(DURATION_S / FINE_S)) * FINE_S, round(OUTPUT_S / FINE_S)
    ours = simulated_truck(0.00125, law=law_of_the_parameters(), load=LADEN, heights_m=HEIGHTS_M)
    worst = []
    for number, height in enumerate(HEIGHTS_M):
        oracle = Truck(height, pull, SLIP_M, load=LADEN).histories(times)
        beyond = np.abs(oracle["deflection"]).max(axis=0) - TRAVEL_M
        assert (beyond > (KNOTS_M[-1] if number == 0 else -1.0)).all()
        worst.append(
            max(relative_rms(np.asarray(getattr(ours, q))[:, number, :, 0], oracle[q][::every]).max() for q in CHANNELS)
        )
    assert (max(worst) < 1e-4) if growing else (max(worst) > 0.05)
