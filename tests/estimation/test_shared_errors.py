"""What a fit says of errors that another campaign may share, against dense least squares."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from rigid_truck import VEHICLE, campaign, empty_run

from sysid.campaign.vehicle_records import MassTolerances
from sysid.estimation.uncertainty.departures import ENVELOPE, FRICTION, Departure
from sysid.estimation.uncertainty.shared_errors import further_unknowns
from sysid.estimation.uncertainty.uncertain_masses import AXLE_LOAD, UNSPRUNG, uncertain_masses

COUNT = 3


@pytest.fixture(scope="module")
def fitted() -> tuple[SimpleNamespace, SimpleNamespace]:
    """Allowances of a rigid truck, and information of random data about its parameters, masses and departures."""
    truck = replace(VEHICLE, tolerances=MassTolerances())
    masses = uncertain_masses(campaign([empty_run("a.csv", 4.0)], vehicle=truck))
    directions = (Departure(ENVELOPE, 0, "empty"), Departure(FRICTION, 0), Departure(ENVELOPE, None))
    sd = np.concatenate([masses.sd, [0.5, 0.03, 0.0]])
    random = np.random.default_rng(8)
    rows = random.normal(size=(200, COUNT + sd.size))
    follow = np.eye(COUNT) + 0.1 * random.normal(size=(COUNT, COUNT))
    amounts = 0.3 * sd * random.normal(size=sd.size)
    data = SimpleNamespace(matrix=rows.T @ rows, prior=np.diag([0.5, 1.0, 2.0]), sd=sd)
    adjusted = SimpleNamespace(data=data, integrated=SimpleNamespace(following=follow), mode=amounts)
    return SimpleNamespace(masses=masses, departures=SimpleNamespace(directions=directions)), adjusted


def test_known_errors_move_the_estimates_as_in_dense_least_squares(fitted) -> None:
    """Unknowns that nobody shares, and those without a scale, are integrated out; the others are held at two values."""
    allowances, adjusted = fitted
    found = further_unknowns(allowances, adjusted)
    data, masses = adjusted.data, len(allowances.masses.factors)
    kept = [*range(masses), masses]
    assert [u.kind for u in found.unknowns] == [*(f.quantity for f in allowances.masses.factors), ENVELOPE]
    # Reported parameters: their footprint maps follow.
    change = np.eye(len(data.matrix))
    change[:COUNT, :COUNT] = adjusted.integrated.following
    matrix = change.T @ data.matrix @ change
    # Friction stays unknown; what has a prior of no width is held.
    free = [*range(COUNT), COUNT + masses + 1]
    precision = matrix[np.ix_(free, free)]
    precision[:COUNT, :COUNT] += data.prior
    precision[COUNT, COUNT] += data.sd[masses + 1] ** -2.0
    shared = [COUNT + k for k in kept]
    response = -np.linalg.solve(precision, matrix[np.ix_(free, shared)])[:COUNT] * data.sd[kept]
    np.testing.assert_allclose(found.sensitivity, response, rtol=1e-6, atol=1e-9 * np.abs(response).max())
    np.testing.assert_allclose(found.estimate, adjusted.mode[kept] / data.sd[kept])


def test_their_covariance_is_that_of_all_unknowns_together(fitted) -> None:
    allowances, adjusted = fitted
    found, data = further_unknowns(allowances, adjusted), adjusted.data
    change = np.eye(len(data.matrix))
    change[:COUNT, :COUNT] = adjusted.integrated.following
    held = COUNT + data.sd.size - 1
    precision = (change.T @ data.matrix @ change)[:held, :held]
    precision += np.diag(np.concatenate([np.diag(data.prior), data.sd[:-1] ** -2.0]))
    kept = [*range(COUNT, held - 1)]
    expected = np.linalg.inv(precision)[np.ix_(kept, kept)] / np.outer(data.sd[:-2], data.sd[:-2])
    np.testing.assert_allclose(found.covariance, expected, rtol=1e-7)
    # The negative control: with friction known, errors are known better.
    narrow = np.linalg.inv(precision[:-1, :-1])[COUNT:, COUNT:] / np.outer(data.sd[:-2], data.sd[:-2])
    assert np.max(np.diag(expected) / np.diag(narrow)) > 1.0 + 1e-4


def test_errors_say_which_declared_value_they_belong_to(fitted) -> None:
    allowances, adjusted = fitted
    found = {(u.kind, u.place, u.load_case): u for u in further_unknowns(allowances, adjusted).unknowns}
    vehicle, cases = allowances.masses.vehicle, allowances.masses.load_cases
    assert found[UNSPRUNG, 1, None].declared == vehicle.axles[1].unsprung_mass_kg
    case = next(iter(cases))
    assert found[AXLE_LOAD, 0, case].declared == cases[case].axle_loads_kg[0]
    assert found[ENVELOPE, 0, "empty"].declared == vehicle.axles[0].tire_stiffness_N_per_m
