"""Force-displacement loops of suspensions against closed forms of their elements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from rigid_truck import EMPTY, VEHICLE, campaign, empty_run
from small_results import small_fit

from sysid.campaign.vehicle_records import AxleGroup
from sysid.estimates.loops import _forces, suspension_loops
from sysid.estimation.parameters.campaign_parameters import campaign_parameters
from sysid.estimation.parameters.estimate import ParameterEstimate
from sysid.vehicle_model.suspension import SuspensionLaw

AMPLITUDE_M, TURN_PER_S, STEPS = 0.03, 4.0 * np.pi, 400
STIFFNESS, DAMPING = np.array([3e5, 9e5]), np.array([0.0, 8e3])


def motion() -> tuple[np.ndarray, np.ndarray, float]:
    """Two cycles of the rig: extension [m], rate [m/s] and step [s]."""
    step = 2.0 * np.pi / TURN_PER_S / STEPS
    turn = TURN_PER_S * step * np.arange(2 * STEPS + 1)
    return AMPLITUDE_M * np.sin(turn), AMPLITUDE_M * TURN_PER_S * np.cos(turn), step


def as_law(values: np.ndarray) -> np.ndarray:
    return values[None, :, None]


def test_spring_and_damper_give_the_force_of_the_moment() -> None:
    e, v, step = motion()
    found = _forces(SuspensionLaw(as_law(STIFFNESS), as_law(DAMPING)), e, v, step)
    np.testing.assert_allclose(found, (e[:, None] * STIFFNESS + v[:, None] * DAMPING)[1:], atol=1e-8)


def test_dry_friction_that_has_settled_follows_its_closed_loop() -> None:
    """On the way up from -A: phi = 1 - (1 + tanh(A / z)) exp(-(e + A) / z); on the way down the same, mirrored."""
    e, v, step = motion()
    friction, slip = np.array([4e3, 1.5e3]), np.array([0.005, 0.004])
    law = SuspensionLaw(as_law(STIFFNESS), as_law(0.0 * DAMPING), friction=as_law(friction), slip=as_law(slip))
    found = np.asarray(_forces(law, e, v, step))[STEPS - 1 :]
    settled, up = e[STEPS:, None], (v[STEPS:] > 0.0)[:, None]
    way = np.where(up, 1.0, -1.0)
    phi = way * (1.0 - (1.0 + np.tanh(AMPLITUDE_M / slip)) * np.exp(-(way * settled + AMPLITUDE_M) / slip))
    expected = settled * STIFFNESS + friction * phi
    # At the turning points both ways meet.
    np.testing.assert_allclose(found, expected, atol=1e-3)
    # The two branches are as far apart as friction makes them: 2 F in the middle, but for what has not slipped.
    middle = found[0] - found[STEPS // 2]
    np.testing.assert_allclose(middle, 2.0 * friction * phi[0], atol=1e-3)


def test_axles_on_a_beam_have_one_loop_together() -> None:
    """It stands at the first of them, and is that of a linear suspension with friction: a spring and +-F."""
    axles = tuple(replace(a, suspension_law="friction", load_dependent=False) for a in VEHICLE.axles)
    grouped = replace(VEHICLE, axles=axles, groups=(AxleGroup("bogie", (1, 2), 300.0, 90.0),))
    case = replace(EMPTY, sprung_mass_kg=(EMPTY.sprung_mass_kg[0] - 300.0,))
    data = campaign([empty_run("a.csv", 6.0)], load_cases=(case,), vehicle=grouped)
    known = {("stiffness", 0): 3e5, ("stiffness", 1): 7e5, ("damping", 0): 1e-3, ("damping", 1): 1e-3}
    fit = small_fit(
        parameters=tuple(
            ParameterEstimate(
                p.name, p.quantity, p.unit, p.axle, p.load_case, None, p.law, "log",
                known.get((p.quantity, p.axle), p.start), 1.0, p.start, p.prior_median, p.prior_sd, True,
            )
            for p in campaign_parameters(data, None).parameters
        )
    )  # fmt: skip
    loops = suspension_loops(data, None, fit, "empty")
    assert loops.axles == (0, 1)
    assert loops.force_N.shape == (2, loops.extension_m.size)
    friction = {p.axle: p.value for p in fit.parameters if p.quantity == "friction"}
    middle = np.argmin(np.abs(loops.extension_m - 0.01) + (loops.rate_m_s < 0.0))
    for row, axle in enumerate(loops.axles):
        spring = known["stiffness", axle] * loops.extension_m[middle]
        assert 0.0 < loops.force_N[row, middle] - spring <= friction[axle] * (1.0 + 1e-6)
    assert list(loops.summary().columns[2:]) == ["force_1_N", "force_2_N"]
