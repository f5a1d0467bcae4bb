"""Made trucks: motion against matrices written here, energy, symmetry, rest; what the table counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from studies.made_trucks.case import GROUPS, draw
from studies.made_trucks.contact import Contact, spokes
from studies.made_trucks.draw import draw_bump, ordinary
from studies.made_trucks.motion import Equations, Lane, Rows, simulate
from studies.made_trucks.table import deserves_doubt, holds, tables
from studies.made_trucks.truck import GRAVITY, Array, Truck


def linear_truck(**changes: object) -> Truck:
    """A symmetric three-axle truck without friction, with linear tires and dampers."""
    truck = ordinary(np.random.default_rng(4), lowboy=False).truck
    mean = 0.5 * (truck.damper_rebound_n_s_per_m + truck.damper_jounce_n_s_per_m)
    linear = replace(
        truck,
        damper_rebound_n_s_per_m=mean,
        damper_jounce_n_s_per_m=mean,
        friction_share=np.array(0.0),
        left_spring_share=0.5,
        left_load_share=0.5,
        tire_exponent=1.0,
        speed_hold_s=np.inf,
    )
    return replace(linear, **changes)  # type: ignore[arg-type]


def flat_contact(truck: Truck) -> Contact:
    """Contact on flat road."""
    return spokes([np.zeros_like, np.zeros_like], 0.3, truck.radius_m, truck.tire_exponent)


def bump_contact(truck: Truck) -> tuple[Contact, float]:
    """Contact on a bump, the same on both sides, and its length."""
    bump = draw_bump(np.random.default_rng(2), 0.6, 1.2)

    def along(station_m: Array) -> Array:
        return bump.driven(station_m, np.zeros_like(station_m))

    return spokes([along, along], bump.length_m, truck.radius_m, truck.tire_exponent), bump.length_m


def pitch_plane(truck: Truck, case: int) -> tuple[Array, Array, Array]:
    """Mass, damping and stiffness matrices of fore-aft, heave, pitch and the rise of each axle, written by hand."""
    of, x = truck.load_cases[case], truck.axle_x_m
    carried = of.axle_load_kg - truck.unsprung_kg
    ahead = np.sum(carried * x) / np.sum(carried) - x
    n = truck.axles
    low = of.cg_height_m[0] - truck.radius_m
    mass = np.zeros((3 + n, 3 + n))
    mass[0, 0] = np.sum(of.axle_load_kg)
    mass[0, 2] = mass[2, 0] = low * np.sum(truck.unsprung_kg)
    mass[1, 1] = of.body_mass_kg[0]
    mass[2, 2] = of.pitch_inertia_kg_m2[0] + low**2 * np.sum(truck.unsprung_kg)
    mass[3:, 3:] = np.diag(truck.unsprung_kg)
    matrices = []
    for suspension, tire in (
        (truck.damper_rebound_n_s_per_m, truck.tire_damping_n_s_per_m),
        (of.stiffness_n_per_m, truck.tire_stiffness_n_per_m),
    ):
        matrix = np.zeros_like(mass)
        matrix[1, 1], matrix[2, 2] = np.sum(suspension), np.sum(suspension * ahead**2)
        matrix[1, 2] = matrix[2, 1] = np.sum(suspension * ahead)
        matrix[1, 3:] = matrix[3:, 1] = -suspension
        matrix[2, 3:] = matrix[3:, 2] = -suspension * ahead
        matrix[3:, 3:] = np.diag(suspension + tire)
        matrices.append(matrix)
    # Weight tips the body over: carried at the height of the wheel centres, it stands `low` above them.
    matrices[1][2, 2] -= GRAVITY * np.sum(carried) * low
    return mass, matrices[0], matrices[1]


def _free_decay(truck: Truck, case: int, start: Array, times_s: Array) -> Array:
    """Motion of the matrices from `start` at rest, by their eigenvalues."""
    mass, damping, stiffness = pitch_plane(truck, case)
    n = len(mass)
    whole = np.block(
        [[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)]]
    )
    values, vectors = np.linalg.eig(whole)
    # The free fore-aft motion is a double eigenvalue of zero, with no part in a decay from rest.
    weights = np.linalg.lstsq(vectors, np.r_[start, np.zeros(n)].astype(complex), rcond=1e-10)[0]
    return np.asarray((vectors @ (weights[:, None] * np.exp(np.outer(values, times_s)))).real[:n].T)


@pytest.mark.parametrize("case", [0, 1])
def test_free_decay_is_that_of_the_eigenvalues_of_matrices_by_hand(case: int) -> None:
    truck = linear_truck()
    equations = Equations(truck, [Lane(case, 0.0, -5.0)], flat_contact(truck))
    start = np.array([0.0, 2e-3, 1e-3, 1e-3, -1e-3, 5e-4])
    full = np.zeros(4 + 2 * truck.axles)
    full[[0, 1, 2, 4, 6, 8]] = start
    found = simulate(equations, 0.8, 1e-3, start=full[None] @ equations.cases[case].basis)
    expected = _free_decay(truck, case, start, found.time_s)
    moved = (found.position[:, 0] @ equations.cases[case].basis.T)[:, [1, 2, 4, 6, 8]]
    np.testing.assert_allclose(moved, expected[:, [1, 2, 3, 4, 5]], atol=2e-7)
    # Negative control: one per mille of the unsprung masses shows.
    other = _free_decay(replace(truck, unsprung_kg=1.001 * truck.unsprung_kg), case, start, found.time_s)
    assert np.abs(moved - other[:, [1, 2, 3, 4, 5]]).max() > 5e-7


@pytest.mark.parametrize(("damping", "kept"), [(0.0, True), (1.0, False)])
def test_energy_stays_without_dampers_and_falls_with_them(damping: float, kept: bool) -> None:
    truck = linear_truck()
    truck = replace(
        truck,
        damper_rebound_n_s_per_m=damping * truck.damper_rebound_n_s_per_m,
        damper_jounce_n_s_per_m=damping * truck.damper_jounce_n_s_per_m,
        tire_damping_n_s_per_m=damping * truck.tire_damping_n_s_per_m,
        auxiliary_roll_n_m=0.0 * truck.auxiliary_roll_n_m,
    )
    equations = Equations(truck, [Lane(0, 0.0, -5.0)], flat_contact(truck))
    basis = equations.cases[0].basis
    full = np.zeros(4 + 2 * truck.axles)
    full[[1, 2, 3]] = 3e-3, 1e-3, 2e-3
    found = simulate(equations, 0.6, 5e-4, start=full[None] @ basis)
    p = found.position[:, 0]
    v = np.gradient(p, found.time_s, axis=0)
    rows = equations.cases[0]
    k, kt = np.repeat(truck.load_cases[0].stiffness_n_per_m / 2, 2), np.repeat(truck.tire_stiffness_n_per_m / 2, 2)
    energy = 0.5 * np.einsum("ti,ij,tj->t", v, rows.mass, v)
    energy += 0.5 * (p @ rows.springs.T) ** 2 @ k + 0.5 * (p @ rows.wheels.T) ** 2 @ kt
    # The body stands above the wheel centres in pitch, above its springs in roll.
    above = truck.load_cases[0].cg_height_m[0] - truck.radius_m - np.array([0.0, 0.15])
    turns = (p @ basis.T)[:, [2, 3]]
    energy -= 0.5 * GRAVITY * truck.load_cases[0].body_mass_kg[0] * turns**2 @ above
    change = np.abs(energy[5:-5] / energy[5] - 1.0).max()
    assert (change < 5e-3) == kept


@pytest.mark.parametrize(("share", "rolls"), [(0.5, False), (0.52, True)])
def test_a_symmetric_truck_driven_square_does_not_roll(share: float, rolls: bool) -> None:
    truck = linear_truck(left_spring_share=share)
    contact, length = bump_contact(truck)
    equations = Equations(truck, [Lane(0, 6.0, -0.6, profile=(0, 1))], contact)
    found = simulate(equations, (length + 2.0) / 6.0, 1e-3)
    full = found.position[:, 0] @ equations.cases[0].basis.T
    assert np.abs(full[:, 1]).max() > 1e-3
    assert (np.abs(full[:, 3]).max() > 1e-5) == rolls


@pytest.mark.parametrize("lowboy", [False, True])
def test_axle_loads_at_rest_are_those_of_the_scales(lowboy: bool) -> None:
    truck = ordinary(np.random.default_rng(8), lowboy).truck
    lanes = [Lane(case, 0.0, -5.0) for case in (0, 1)]
    found = simulate(Equations(truck, lanes, flat_contact(truck)), 0.05, 1e-3)
    load = found.wheel_load_n.reshape(*found.wheel_load_n.shape[:2], -1, 2).sum(axis=3)
    for case, of in enumerate(truck.load_cases):
        # Tables of the tire: linear interpolation within steps of 2.5 mm.
        np.testing.assert_allclose(
            load[:, case], np.broadcast_to(GRAVITY * of.axle_load_kg, load[:, case].shape), rtol=2e-3
        )
    # Moments about axle 1 by hand: bodies and axles against the scales.
    of = truck.load_cases[0]
    moment = np.sum(of.body_mass_kg * truck.cg_x_m(0)) + np.sum(truck.unsprung_kg * truck.axle_x_m)
    assert moment == pytest.approx(np.sum(of.axle_load_kg * truck.axle_x_m), rel=1e-12)


def test_halving_the_step_changes_nothing() -> None:
    truck = ordinary(np.random.default_rng(8), False).truck
    contact, length = bump_contact(truck)
    peaks = []
    for step in (5e-4, 2.5e-4):
        found = simulate(Equations(truck, [Lane(0, 6.7, -0.6, profile=(0, 1))], contact), (length + 1.2) / 6.7, step)
        peaks.append(found.wheel_load_n.max(axis=0))
    np.testing.assert_allclose(peaks[0], peaks[1], rtol=5e-3)


@pytest.mark.parametrize("group", list(GROUPS))
def test_every_kind_can_be_assembled_and_declares_positive_masses(group: str) -> None:
    for number in range(len(GROUPS[group]) * 5):
        _, vehicle, campaign, _ = draw(group, number)
        assert campaign.truck.axles == (6 if vehicle == "lowboy" else 3)
        for case in (0, 1):
            assert np.linalg.eigvalsh(Rows(campaign.truck, case).mass).min() > 0.0


def _record(trust: str, ratios: list[float]) -> dict[str, object]:
    made = [
        {"quantity": "k", "axle": 1, "case": None, "true": 1.0, "interval": [r - 0.01, r, r + 0.01]} for r in ratios
    ]
    verdict = {"trust": trust, "kinds": [], "reasons": []}
    return {"number": 0, "kind": "one", "vehicle": "three axles", "linear": True, "code": 0, "verdict": verdict,
            "entries": made, "processor_s": 1.0, "said": ""}  # fmt: skip


def test_what_holds_and_what_deserves_doubt() -> None:
    good, bad = _record("use", [1.0, 1.005]), _record("do_not_bet", [1.03, 1.0])
    assert [holds(e) for e in bad["entries"]] == [False, True]  # type: ignore[attr-defined]
    assert deserves_doubt(bad)
    assert not deserves_doubt(good)
    text = tables([good, bad])
    assert "| k held, where one may bet | 88 to 94 % | 100 % (2 of 2) |" in text
    assert "| *do not bet* that is deserved | 70 % | 100 % (1 of 1) |" in text
