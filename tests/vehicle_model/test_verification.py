"""Histories and matrices of the verification vehicle against an independent multibody engine."""

from __future__ import annotations

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import eig
from verification_case import DATA, VerificationPass, passes, per_axle, profile, vehicle_and_loads

from sysid.vehicle_model.assembly import assemble, coordinate_names
from sysid.vehicle_model.contact import effective_road, road_input, tire_law
from sysid.vehicle_model.simulation import (
    Histories,
    Motion,
    simulate_histories,
    stage_times,
)
from sysid.vehicle_model.stacked_matrices import stack_matrices
from sysid.vehicle_model.suspension import SuspensionLaw

INTERVAL_S = 0.002
SUBSTEPS = 1
START_S = 0.5
#: Worst relative RMS of any channel that a small-angle planar model can reach on finite rotations, by bump height and
#: whether real heights count; 0.5 % would still be agreement.
LIMIT = {("h20", False): 0.001, ("h90", False): 0.004, ("h20", True): 0.0025}
QUANTITIES = ("deflection", "axle_acceleration", "body_acceleration", "tire_force")
CASES = passes()


@pytest.fixture(scope="session")
def simulated() -> tuple[list[VerificationPass], Histories]:
    """All passes in one simulation, point contact and a purely vertical contact force."""
    vehicles = {h: vehicle_and_loads(h) for h in (False, True)}
    axles = vehicles[False][0].axles
    matrices = [assemble(vehicles[c.heights][0], vehicles[c.heights][1][c.load_case]) for c in CASES]
    stacked = stack_matrices(matrices, [(a.body, a.x_m) for a in axles])
    # The profiles themselves are the effective road: the passes have a point contact.
    rises, station = [], None
    for c in CASES:
        s, z = profile(c.profile)
        lead = np.arange(-50, 0) * (s[1] - s[0])
        station = np.concatenate([lead, s])
        rises.append(np.tile(np.concatenate([0.0 * lead, z]), (len(axles), 1)))
    road = effective_road(station, np.stack(rises))
    samples = max(len(c.values) for c in CASES)
    speed = np.array([c.speed_m_s for c in CASES])[:, None]
    start = np.full_like(speed, START_S)

    def law(key: str) -> jax.Array:
        return jnp.asarray(np.tile(per_axle(key)[:, None], (len(CASES), 1, 1)))

    suspension = SuspensionLaw(law("suspension_stiffness_N_per_m"), law("suspension_damping_N_s_per_m"))
    tire = tire_law(
        law("tire_stiffness_N_per_m"),
        law("tire_damping_N_s_per_m"),
        jnp.ones((1, 1, 1)),
        stacked.static_load,
        stacked.static_load,
    )._replace(growth=0.0)
    x = np.array([a.x_m for a in axles])[:, None]

    @jax.jit
    def run() -> Histories:
        times = stage_times(samples, INTERVAL_S, SUBSTEPS)[:, None, None, None]
        inputs = road_input(road, speed[:, None] * (times - start[:, None]) - x)
        motion = Motion(jnp.asarray(speed), jnp.asarray(start))
        return simulate_histories(stacked, suspension, tire, motion, inputs, interval_s=INTERVAL_S, substeps=SUBSTEPS)

    return CASES, Histories(*(np.asarray(v) for v in run()))


def test_no_pass_is_missing():
    assert sorted((c.name, c.heights) for c in CASES) == [
        ("h20_loaded_16kmh", False),
        ("h20_loaded_16kmh", True),
        ("h20_unloaded_8kmh", False),
        ("h20_unloaded_8kmh", True),
        ("h90_loaded_32kmh", False),
        ("h90_unloaded_32kmh", False),
    ]


@pytest.mark.parametrize("number", range(len(CASES)), ids=lambda i: f"{CASES[i].name}{'_heights' * CASES[i].heights}")
def test_histories_agree(simulated, number: int):
    case, histories = simulated[0][number], simulated[1]
    worst = {}
    for quantity in QUANTITIES:
        reference = case.channels(quantity)
        model = getattr(histories, quantity)[: len(reference), number, :, 0]
        static = reference[0]
        error = np.sqrt(np.mean((model - reference) ** 2, axis=0))
        worst |= {
            f"{quantity}{i + 1}": e for i, e in enumerate(error / np.sqrt(np.mean((reference - static) ** 2, axis=0)))
        }
    name = max(worst, key=worst.__getitem__)
    assert worst[name] < LIMIT[case.name[:3], case.heights], f"{name}: {worst[name]:.2%}"


def test_lift_off_happens_in_the_high_passes(simulated):
    forces = {c.name: simulated[1].tire_force[: len(c.values), i].min() for i, c in enumerate(simulated[0])}
    assert forces["h90_unloaded_32kmh"] == 0.0
    assert forces["h20_unloaded_8kmh"] > 0.0


@pytest.mark.parametrize("load_case", ["unloaded", "loaded"])
def test_matrices_and_modes(load_case: str):
    reference = json.loads((DATA / "matrices.json").read_text(encoding="utf-8"))[load_case]
    vehicle, loads = vehicle_and_loads(False)
    m = assemble(vehicle, loads[load_case])
    names = coordinate_names(vehicle)
    assert names[:4] == ("fore-aft tractor", "heave tractor", "pitch tractor", "pitch trailer")
    # Ours has the fore-aft coordinate in front; with all heights equal it is coupled to nothing.
    np.testing.assert_allclose(m.mass[0, 1:], 0.0, atol=1e-9)
    rows = np.concatenate([m.attachment[:, 1:], -np.eye(len(vehicle.axles))], axis=1)
    k, c = per_axle("suspension_stiffness_N_per_m"), per_axle("suspension_damping_N_s_per_m")
    kt, ct = per_axle("tire_stiffness_N_per_m"), per_axle("tire_damping_N_s_per_m")
    on_road = np.concatenate([np.zeros((6, 3)), np.eye(6)], axis=1)
    mass = np.zeros((9, 9))
    mass[:3, :3], mass[3:, 3:] = m.mass[1:, 1:], np.diag(m.unsprung_mass)
    stiffness = rows.T @ (k[:, None] * rows) + on_road.T @ (kt[:, None] * on_road)
    damping = rows.T @ (c[:, None] * rows) + on_road.T @ (ct[:, None] * on_road)
    for ours, key in ((mass, "M"), (damping, "C"), (stiffness, "K")):
        theirs = np.array(reference[key])
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8 * np.abs(theirs).max())
    np.testing.assert_allclose(m.tilt, 0.0, atol=1e-6)
    state = np.block([[np.zeros((9, 9)), np.eye(9)], [-stiffness, -damping]])
    weight = np.block([[np.eye(9), np.zeros((9, 9))], [np.zeros((9, 9)), mass]])
    poles = eig(state, weight, right=False)
    poles = poles[np.imag(poles) > 0]
    order = np.argsort(np.abs(poles))
    frequency, ratio = np.abs(poles) / (2 * np.pi), -np.real(poles) / np.abs(poles)
    expected = np.argsort(reference["natural_frequency_Hz"])
    np.testing.assert_allclose(frequency[order], np.array(reference["natural_frequency_Hz"])[expected], rtol=1e-6)
    np.testing.assert_allclose(ratio[order], np.array(reference["damping_ratio"])[expected], rtol=1e-6)
