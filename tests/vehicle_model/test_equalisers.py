"""Rockers between springs: closed forms at rest, passes over a bump against DOP853, derivatives, natural modes."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hand_written_truck import DURATION_S, FINE_S, SPEED_M_S, Truck, worst_error
from rigid_truck import AXLES, DAMPING, EMPTY, STIFFNESS, VEHICLE
from scipy.linalg import eig
from simulated_truck import per_axle, simulated_truck, truck_model

from sysid.campaign.toml.groups import check_groups
from sysid.campaign.vehicle_records import AxleGroup, Equaliser, Vehicle
from sysid.errors import CampaignError, SysidError
from sysid.vehicle_model.assembly import assemble
from sysid.vehicle_model.contact import effective_road, road_input, tire_law
from sysid.vehicle_model.motion import Motion
from sysid.vehicle_model.simulation import simulate_histories, stage_times
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import Ramps, SuspensionLaw
from sysid.vehicle_model.vibration_modes import natural_modes

SHARE = 0.7
TANDEM = replace(VEHICLE, equalisers=(Equaliser("tandem", (1, 2)),))
TRIDEM = replace(VEHICLE, equalisers=(Equaliser("all three", (0, 1, 2)),))
FRICTION = np.array([1500.0, 900.0, 3000.0])
SLIP_M = 1e-3
ASYMMETRY = np.array([2.5, 1.0, 4.0])
CORNER_M, CORNER = 0.012, np.array([2e5, 4e5, 3e5])
STOP_M, STOP = np.array([0.02, 0.03, 0.025]), np.array([2e6, 3e6, 2.5e6])
#: The tandem leaves the first bump and no axle the second.
HEIGHTS_M = (0.045, 0.006)


def through_tandem(force: np.ndarray) -> np.ndarray:
    """Springs 2 and 3 over a rocker: each end feels its own spring less its share of what it has above the mean."""
    between = 0.5 * SHARE * (force[2] - force[1])
    return np.array([force[0], force[1] + between, force[2] - between])


def through_all(force: np.ndarray) -> np.ndarray:
    return (1.0 - SHARE) * force + SHARE * force.sum() / 3.0


def linear(e, v, phi):
    return through_tandem(STIFFNESS * e) + DAMPING * v


def linear_tridem(e, v, phi):
    return through_all(STIFFNESS * e) + DAMPING * v


def rich(e, v, phi):
    """Spring with a corner and friction over the rocker; asymmetric damper and stops beside it."""
    spring = STIFFNESS * e + CORNER * np.maximum(e - CORNER_M, 0.0) + FRICTION * phi
    damper = DAMPING * v * np.where(v > 0, ASYMMETRY, 1.0) * 2 / (1 + ASYMMETRY)
    stops = STOP * (np.maximum(e - STOP_M, 0.0) - np.maximum(-e - 0.8 * STOP_M, 0.0))
    return through_tandem(spring) + damper + stops


def shares(members: tuple[int, ...]) -> jax.Array:
    return per_axle(np.where(np.isin(np.arange(3), members), SHARE, 0.0))


LINEAR = SuspensionLaw(per_axle(STIFFNESS), per_axle(DAMPING), load_share=shares((1, 2)))
RICH = LINEAR._replace(
    friction=per_axle(FRICTION),
    slip=per_axle(np.full(3, SLIP_M)),
    asymmetry=per_axle(ASYMMETRY),
    ramps=Ramps(*(per_axle(x)[None] for x in (np.full(3, CORNER_M), CORNER, np.ones(3)))),
    stops=Ramps(
        at=jnp.stack([per_axle(STOP_M), per_axle(-0.8 * STOP_M)]),
        slope=jnp.stack([per_axle(STOP), per_axle(STOP)]),
        side=jnp.stack([per_axle(np.ones(3)), per_axle(-np.ones(3))]),
    ),
)
CASES = {
    "linear tandem": (linear, TANDEM, LINEAR),
    "linear tridem": (linear_tridem, TRIDEM, LINEAR._replace(load_share=shares((0, 1, 2)))),
    "all elements": (rich, TANDEM, RICH),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Hand-written histories of both bumps, the vehicle and the package's law."""
    force, vehicle, law = CASES[request.param]
    times = np.arange(round(DURATION_S / FINE_S)) * FINE_S
    return [Truck(h, force, SLIP_M).histories(times) for h in HEIGHTS_M], vehicle, law


def test_every_channel_against_dop853_at_the_default_step(case):
    oracle, vehicle, law = case
    assert (oracle[0]["tire_force"].min(axis=0)[1:] == 0.0).all()
    assert worst_error(simulated_truck(0.00125, law=law, vehicle=vehicle, heights_m=HEIGHTS_M), oracle) < 1e-4


def test_the_oracle_tells_a_rocker_from_independent_axles(case):
    oracle, _, law = case
    assert worst_error(simulated_truck(0.00125, law=law, heights_m=HEIGHTS_M), oracle) > 0.05


# ------------------------------------------------------------------------------------------------------- quasi-static

#: Wheels at the height of the centre of gravity, so that nothing tilts, and linear tires.
LEVEL = replace(VEHICLE, axles=tuple(replace(a, tire_radius_m=0.5) for a in AXLES))
STANDING = replace(EMPTY, cg_height_m=(0.5,))
LIFT_M = 0.015


def lifted(share: float, members: tuple[int, ...]) -> np.ndarray:
    """Suspension forces (3,) on the axles, less those at rest, when the wheels of axle 2 stand on a plank."""
    vehicle = replace(LEVEL, equalisers=(Equaliser("rocker", members),))
    stacked = stack_matrices([assemble(vehicle, STANDING)], [])
    kt = np.array([a.tire_stiffness_N_per_m for a in AXLES])
    x = np.array([a.x_m for a in AXLES])
    station = np.arange(-700, 2500) * 0.01
    rise = np.zeros((1, 3, station.size))
    t = np.clip((station - 1.0) / 4.0, 0.0, 1.0)
    rise[0, 1] = LIFT_M * t**3 * (10.0 - 15.0 * t + 6.0 * t**2)
    speed, start, samples, every, substeps = 2.0, 0.1, 1800, 0.005, 4
    times = stage_times(samples, every, substeps)[:, None, None, None]
    motion = Motion(jnp.full((1, 1), speed), jnp.full((1, 1), start))
    road = road_input(effective_road(station, rise), motion.speed[:, None] * (times - start) - x[:, None])
    one = [jnp.asarray(v)[None, :, None] for v in (STIFFNESS, 4.0 * DAMPING, kt, np.full(3, 2e4))]
    law = SuspensionLaw(
        *one[:2], load_share=jnp.asarray(np.where(np.isin(range(3), members), share, 0.0))[None, :, None]
    )
    tire = tire_law(*one[2:], 1.0, stacked.static_load, stacked.static_load)
    found = simulate_histories(stacked, law, tire, motion, road, interval_s=every, substeps=substeps)
    assert np.abs(np.asarray(found.axle_acceleration)[-1]).max() < 1e-6  # it stands still
    return -np.asarray(found.suspension_force)[-1, 0, :, 0]


@pytest.mark.parametrize("share", [0.0, 0.35, 0.8])
def test_static_share_of_a_lifted_axle_has_a_closed_form(share):
    """Equilibrium of the body leaves P = p n with n = (x3 - x2, x1 - x3, x2 - x1); a straight frame leaves n'u = 0.

    With u_i = e_i + z_i, z_i = w_i + P_i / kt_i (tires), e_i = S_i / k_i and, over the tandem's rocker, both springs'
    half difference 1 / (1 - s) times that of P, one equation is left for p.
    """
    x1, x2, x3 = (a.x_m for a in AXLES)
    kt = np.array([a.tire_stiffness_N_per_m for a in AXLES])
    n = np.array([x3 - x2, x1 - x3, x2 - x1])
    mean, half = 0.5 * (n[1] + n[2]), 0.5 * (n[2] - n[1])
    spring = np.array([n[0], mean - half / (1.0 - share), mean + half / (1.0 - share)])
    p = -n[1] * LIFT_M / (n @ (spring / STIFFNESS) + n @ (n / kt))
    assert lifted(share, (1, 2)) == pytest.approx(p * n, rel=1e-6)


def test_a_full_share_leaves_the_wheel_loads_as_they_were():
    """Springs that carry the same make the truck stand on two points: a lifted axle changes no load."""
    assert np.abs(lifted(1.0, (1, 2))).max() < 1e-3
    assert np.abs(lifted(0.0, (1, 2))).max() > 500.0


def test_static_share_of_a_tridem_against_its_linear_system():
    """Three unknown heights of axles and two of the frame, five equations written out."""
    share, x = 0.6, np.array([a.x_m for a in AXLES])
    kt = np.array([a.tire_stiffness_N_per_m for a in AXLES])
    rows, right = np.zeros((5, 5)), np.zeros(5)
    for i in range(3):  # P_i in the unknowns (z, theta, z_1, z_2, z_3)
        pull = np.zeros(5)
        for j in range(3):
            weight = (1.0 - share) * (i == j) + share / 3.0
            pull += weight * STIFFNESS[j] * np.array([1.0, -x[j], *-np.eye(3)[j]])
        rows[0] += pull
        rows[1] += x[i] * pull
        rows[2 + i] += pull
        rows[2 + i, 2 + i] -= kt[i]
        right[2 + i] = -kt[i] * LIFT_M * (i == 1)
    height = np.linalg.solve(rows, right)
    load = kt * (LIFT_M * np.eye(3)[1] - height[2:])
    assert lifted(share, (0, 1, 2)) == pytest.approx(-load, rel=1e-6)


# -------------------------------------------------------------------------------------------------------- derivatives


def test_forward_derivatives_against_central_differences():
    """By the share, stiffness, friction and corners, in a run with lift-off."""
    run = truck_model(0.0025, duration_s=0.7, vehicle=TANDEM)
    weight = np.random.default_rng(3).normal(size=(2, 3, 1))

    def outcome(x: jax.Array) -> jax.Array:
        law = RICH._replace(
            load_share=RICH.load_share * x[0],
            stiffness=RICH.stiffness * x[1],
            friction=RICH.friction * x[2],
            ramps=RICH.ramps._replace(at=RICH.ramps.at * x[3]),
            stops=RICH.stops._replace(slope=RICH.stops.slope * x[4]),
        )
        found = run(law, SPEED_M_S)
        return (found.tire_force * weight).sum() / 1e6 + (found.deflection * weight).sum() * 10.0

    at, step = jnp.ones(5), 1e-6
    forward = np.asarray(jax.jit(jax.jacfwd(outcome))(at))
    plain = jax.jit(outcome)
    central = [(plain(at + step * e) - plain(at - step * e)) / (2 * step) for e in np.eye(5)]
    np.testing.assert_allclose(forward, central, rtol=1e-6, atol=1e-6 * np.abs(forward).max())
    assert (np.abs(forward) > 1e-3 * np.abs(forward).max()).all()


# ------------------------------------------------------------------------------------------------------ natural modes


def test_natural_modes_against_an_assembly_axle_by_axle():
    """K row by row from the forces on body and axles; unequal springs make it unsymmetric."""
    share, x = 0.6, np.array([a.x_m for a in AXLES])
    kt = np.array([a.tire_stiffness_N_per_m for a in AXLES])
    vehicle = replace(LEVEL, equalisers=(Equaliser("tandem", (1, 2)),))
    unsprung = np.array([a.unsprung_mass_kg for a in AXLES])
    support = np.array(STANDING.axle_loads_kg) - unsprung
    arm = x - support @ x / support.sum()
    rows = np.column_stack([np.ones(3), -arm, -np.eye(3)])
    through = np.eye(3)
    through[1:, 1:] += share * (0.5 - np.eye(2))
    k = rows.T @ through @ np.diag(STIFFNESS) @ rows + np.diag([0.0, 0.0, *kt])
    c = rows.T @ np.diag(DAMPING) @ rows
    m = np.diag([STANDING.sprung_mass_kg[0], STANDING.pitch_inertia_kg_m2[0], *unsprung])
    square = np.sort(eig(k, m)[0].real)
    still, moving = np.zeros((5, 5)), np.eye(5)
    poles = np.linalg.eigvals(np.block([[still, moving], [-np.linalg.solve(m, k), -np.linalg.solve(m, c)]]))
    modes = natural_modes(vehicle, STANDING, STIFFNESS, DAMPING, load_share=np.array([0.0, share, share]))
    np.testing.assert_allclose(modes.frequency_hz, np.sqrt(square) / (2 * np.pi), rtol=1e-9)
    found = modes.pole[modes.pole.imag > 0]
    np.testing.assert_allclose(np.sort(found.imag), np.sort(poles.imag[poles.imag > 1e-9]), rtol=1e-9)
    alone = natural_modes(LEVEL, STANDING, STIFFNESS, DAMPING)
    assert np.abs(modes.frequency_hz / alone.frequency_hz - 1.0).max() > 0.01


def test_modes_want_the_share_of_a_rocker_that_none_declares():
    declared = replace(TANDEM, equalisers=(Equaliser("tandem", (1, 2), 0.4),))
    by_hand = natural_modes(TANDEM, EMPTY, STIFFNESS, load_share=np.array([0.0, 0.4, 0.4]))
    np.testing.assert_allclose(natural_modes(declared, EMPTY, STIFFNESS).frequency_hz, by_hand.frequency_hz, rtol=1e-12)
    with pytest.raises(SysidError, match="tandem"):
        natural_modes(TANDEM, EMPTY, STIFFNESS)


# -------------------------------------------------------------------------------------------------------- declaration


@pytest.mark.parametrize(
    ("groups", "equalisers", "message"),
    [
        ((), (Equaliser("a", (0, 2)),), "leaves out the axle 'drive'"),
        ((), (Equaliser("a", (0, 1)), Equaliser("b", (1, 2))), "stands in two groups"),
        ((AxleGroup("a", (1, 2), 300.0, 90.0),), (Equaliser("b", (1, 2)),), "stands in two groups"),
    ],
)
def test_rockers_that_cannot_be(groups, equalisers, message):
    vehicle: Vehicle = replace(VEHICLE, groups=groups, equalisers=equalisers)
    with pytest.raises(CampaignError, match=message):
        check_groups(vehicle, "campaign.toml")
