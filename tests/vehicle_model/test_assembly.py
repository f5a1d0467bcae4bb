"""Matrices of chains of bodies against energies written out from the kinematics, and what the statics imply."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import plain_axles
import pytest
from rigid_truck import AXLES, EMPTY, VEHICLE, empty_run
from scipy.linalg import null_space

from sysid.campaign.read import _held_as
from sysid.campaign.statics import chains, static_equilibrium
from sysid.campaign.vehicle_records import Body, LoadCase, Vehicle
from sysid.errors import CampaignError
from sysid.vehicle_model.assembly import assemble, coordinate_names
from sysid.vehicle_model.passes import Pass, load_case_matrices, pass_matrices

axle = partial(plain_axles.axle, mass=700.0)

#: Two bodies and five axles; three bodies with a dolly; a truck and a second, uncoupled vehicle.
SEMITRAILER = (
    Vehicle(
        "five axles",
        (Body("tractor"), Body("trailer", 3.4, 1.2)),
        (axle("1", 0, 0.0), axle("2", 0, 3.8), axle("3", 1, 10.0), axle("4", 1, 11.3), axle("5", 1, 12.6)),
    ),
    LoadCase("empty", (6000, 7000, 4000, 4000, 4000), (6500, 15000), (14e3, 110e3), (1.0, 1.7)),
)
DOLLY = (
    Vehicle(
        "truck, dolly and trailer",
        (Body("truck"), Body("dolly", 6.5, 0.8), Body("trailer", 9.1, 1.1)),
        (axle("1", 0, 0.0), axle("2", 0, 4.5), axle("3", 1, 9.0), axle("4", 2, 15.0)),
    ),
    LoadCase("empty", (5500, 7500, 5200, 5400), (12000, 900, 7900), (30e3, 700, 40e3), (1.1, 0.7, 1.6)),
)
APART = (
    Vehicle(
        "two vehicles",
        (Body("first"), Body("second")),
        (axle("1", 0, 0.0), axle("2", 0, 4.0), axle("3", 1, 10.0), axle("4", 1, 14.0)),
    ),
    LoadCase("empty", (5000, 6000, 5500, 6500), (9600, 10600), (20e3, 25e3), (1.0, 1.2)),
)
CASES = pytest.mark.parametrize(
    ("vehicle", "load_case"), [(VEHICLE, EMPTY), SEMITRAILER, DOLLY, APART], ids=lambda v: getattr(v, "name", "")
)


def all_motions(vehicle: Vehicle, load_case: LoadCase) -> tuple[np.ndarray, np.ndarray]:
    """Admissible motions as columns: (xi, z, theta) of every body under the hinge constraints; and cg_x."""
    cg_x = np.array(static_equilibrium(vehicle, load_case).cg_x_m)
    cg_h = np.array(load_case.cg_height_m)
    n = len(vehicle.bodies)
    rows = []
    for b, body in enumerate(vehicle.bodies):
        if body.hitch_x_m is None:
            continue
        up, forward = np.zeros(3 * n), np.zeros(3 * n)
        for sign, k in ((1.0, b), (-1.0, b - 1)):
            up[3 * k + 1], up[3 * k + 2] = sign, -sign * (body.hitch_x_m - cg_x[k])
            forward[3 * k], forward[3 * k + 2] = sign, -sign * (body.hitch_height_m - cg_h[k])
        rows += [up, forward]
    return (null_space(np.array(rows)) if rows else np.eye(3 * n)), cg_x


@CASES
def test_mass_matrix_is_the_kinetic_energy(vehicle, load_case):
    motions, cg_x = all_motions(vehicle, load_case)
    m = assemble(vehicle, load_case)
    assert motions.shape[1] == m.mass.shape[0] == len(coordinate_names(vehicle)) - len(vehicle.axles)
    for motion in motions.T:
        xi, z, theta = motion.reshape(-1, 3).T
        energy = np.sum(load_case.sprung_mass_kg * (xi**2 + z**2) + load_case.pitch_inertia_kg_m2 * theta**2)
        for a in vehicle.axles:
            below = a.tire_radius_m - load_case.cg_height_m[a.body]
            energy += a.unsprung_mass_kg * (xi[a.body] - theta[a.body] * below) ** 2
        # The package's coordinates of this motion: travel and heave of each first body, pitch of all.
        q = np.concatenate([[xi[c[0]], z[c[0]], *theta[c]] for c in chains(vehicle)])
        assert q @ m.mass @ q == pytest.approx(energy, rel=1e-10)
        for i, a in enumerate(vehicle.axles):
            rise = z[a.body] - theta[a.body] * (a.x_m - cg_x[a.body])
            assert m.attachment[i] @ q == pytest.approx(rise, abs=1e-12)
            assert m.body_point(a.body, a.x_m) @ q == pytest.approx(rise, abs=1e-12)


@CASES
def test_static_loads_carry_the_weight(vehicle, load_case):
    """Virtual work of suspension forces against the weights vanishes for every motion of the bodies."""
    m = assemble(vehicle, load_case)
    preload = m.static_load - m.unsprung_mass * vehicle.gravity_m_s2
    weight = np.array(load_case.sprung_mass_kg) * vehicle.gravity_m_s2
    balance = m.attachment.T @ preload - m.heave_rows.T @ weight
    np.testing.assert_allclose(balance, 0.0, atol=1e-6 * weight.sum())
    assert m.chain_mass.sum() == pytest.approx(sum(load_case.axle_loads_kg), rel=1e-12)
    assert m.drive.shape[0] == len(chains(vehicle))


def test_a_hinge_without_a_height_lies_at_the_centre_of_gravity():
    vehicle, load = SEMITRAILER
    open_height = replace(vehicle, bodies=(vehicle.bodies[0], Body("trailer", 3.4)))
    at_cg = replace(vehicle, bodies=(vehicle.bodies[0], Body("trailer", 3.4, 1.7)))
    np.testing.assert_array_equal(assemble(open_height, load).mass, assemble(at_cg, load).mass)


def test_masses_that_do_not_add_up_are_refused():
    with pytest.raises(CampaignError, match="kg"):
        assemble(replace(VEHICLE, axles=AXLES), replace(EMPTY, sprung_mass_kg=(9000.0,)))


@CASES
@pytest.mark.parametrize(("at", "height_m"), [(None, None), ("centre", None), ("road", 0.0)])
def test_what_holds_the_speed_takes_the_power_of_the_point_where_it_acts(vehicle, load_case, at, height_m):
    """d q is the forward motion of that point of the first body, by the kinematics: its force F does the work F v."""
    motions, _ = all_motions(vehicle, load_case)
    m = assemble(replace(vehicle, driven_at=at), load_case)
    for motion in motions.T:
        xi, z, theta = motion.reshape(-1, 3).T
        q = np.concatenate([[xi[c[0]], z[c[0]], *theta[c]] for c in chains(vehicle)])
        for row, (first, *_) in zip(m.drive, chains(vehicle), strict=True):
            cg_h = load_case.cg_height_m[first]
            below = cg_h - (cg_h if height_m is None else height_m)
            assert row @ q == pytest.approx(xi[first] + theta[first] * below, abs=1e-12)


@pytest.mark.parametrize(
    ("held", "driven_at", "hold_s"),
    [
        (("cruise", "cruise"), "road", 1.0),
        (("servo", "towed"), "road", 0.05),
        (("cruise", "servo"), "road", None),
        (("cruise", "cruise"), None, None),
    ],
)
def test_a_drive_has_the_time_of_runs_that_were_held_alike(held, driven_at, hold_s):
    runs = [replace(empty_run(f"{k}.csv", 6.0), speed_held=how) for k, how in enumerate(held)]
    assert _held_as(replace(VEHICLE, driven_at=driven_at), runs).hold_s == hold_s


@pytest.mark.parametrize(
    ("one", "time_s"),
    [
        (Pass("empty", "bump", "cruise"), 0.6),
        (Pass("empty", "bump"), 0.6),
        # What tows a truck is not its drive, and a slow pass has a time of its own.
        (Pass("empty", "bump", "towed"), 0.05),
        (Pass("empty", "bump", hold_s=0.01), 0.01),
    ],
)
def test_the_time_of_a_drive_holds_its_passes_of_every_speed(one, time_s):
    """0.4 s times 1.5: with F = (M / tau) v the acceleration by the hold is 0.05 / tau of that of the servo."""
    drive = replace(VEHICLE, driven_at="road", hold_s=0.4, hold_factor=1.5)
    cases = {"empty": EMPTY}
    held = pass_matrices(load_case_matrices(drive, cases, [one]), [one], []).rate
    servo = Pass("empty", "bump", hold_s=0.05)
    by_servo = pass_matrices(load_case_matrices(drive, cases, [servo]), [servo], []).rate
    bodies = len(coordinate_names(VEHICLE)) - len(AXLES)
    np.testing.assert_allclose(held[:, -bodies:], 0.05 / time_s * by_servo[:, -bodies:], rtol=1e-12)
