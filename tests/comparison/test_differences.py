"""Differences of two campaigns against dense least squares over all their unknowns together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from sysid.comparison.differences import ERROR_RATE, _Quantities, holm, log_differences

PARAMETERS, SHARED, OWN, ROWS = 4, 3, 2, 80
PRIOR_SD = np.array([0.02, 0.005, 0.1])
OWN_SD = 0.05


class Problem:
    """Linear data of one campaign: parameters, errors that both share, and errors of its own."""

    def __init__(self, random: np.random.Generator) -> None:
        sizes = np.array([2.0] * PARAMETERS + [40.0] * SHARED + [9.0] * OWN)
        self.jacobian = sizes * random.normal(size=(ROWS, sizes.size))
        # As the scale does, an error that both share looks like a change of a parameter.
        self.jacobian[:, PARAMETERS] = 40.0 * self.jacobian[:, 0]
        self.data = random.normal(size=ROWS)

    def posterior(self) -> _Quantities:
        """Its own posterior with the prior of all errors, as one campaign stores it."""
        prior = np.concatenate([np.zeros(PARAMETERS), PRIOR_SD**-2.0, np.full(OWN, OWN_SD**-2.0)])
        covariance = np.linalg.inv(self.jacobian.T @ self.jacobian + np.diag(prior))
        mean = covariance @ self.jacobian.T @ self.data
        x, y = slice(PARAMETERS), slice(PARAMETERS, PARAMETERS + SHARED)
        sensitivity = covariance[x, y] @ np.linalg.inv(covariance[y, y])
        return _Quantities(mean[x], covariance[x, x], sensitivity, mean[y], covariance[y, y], PRIOR_SD)


@pytest.fixture(scope="module")
def problems() -> tuple[Problem, Problem]:
    random = np.random.default_rng(5)
    return Problem(random), Problem(random)


def together(first: Problem, second: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of x_b - x_a from one least-squares problem in which the shared errors stand once."""
    total = 2 * PARAMETERS + SHARED + 2 * OWN
    rows = np.zeros((2 * ROWS + SHARED + 2 * OWN, total))
    right = np.zeros(len(rows))
    for side, problem in enumerate((first, second)):
        at = slice(side * ROWS, (side + 1) * ROWS)
        rows[at, side * PARAMETERS : (side + 1) * PARAMETERS] = problem.jacobian[:, :PARAMETERS]
        rows[at, 2 * PARAMETERS : 2 * PARAMETERS + SHARED] = problem.jacobian[:, PARAMETERS : PARAMETERS + SHARED]
        own = 2 * PARAMETERS + SHARED + side * OWN
        rows[at, own : own + OWN] = problem.jacobian[:, PARAMETERS + SHARED :]
        right[at] = problem.data
    rows[2 * ROWS : 2 * ROWS + SHARED, 2 * PARAMETERS : 2 * PARAMETERS + SHARED] = np.diag(1.0 / PRIOR_SD)
    rows[2 * ROWS + SHARED :, 2 * PARAMETERS + SHARED :] = np.eye(2 * OWN) / OWN_SD
    solution = np.linalg.lstsq(rows, right, rcond=None)[0]
    covariance = np.linalg.inv(rows.T @ rows)
    minus = np.hstack([-np.eye(PARAMETERS), np.eye(PARAMETERS), np.zeros((PARAMETERS, SHARED + 2 * OWN))])
    return minus @ solution, minus @ covariance @ minus.T


def test_shared_errors_cancel_as_in_one_problem_of_both_campaigns(problems) -> None:
    mean, covariance = together(*problems)
    found = log_differences(*(p.posterior() for p in problems))
    np.testing.assert_allclose(found[0], mean, rtol=1e-7)
    np.testing.assert_allclose(found[1], covariance, rtol=1e-7)


def test_without_sharing_intervals_are_other_ones(problems) -> None:
    """The negative control: variances that add up are not those of the problem of both."""
    _, covariance = together(*problems)
    none = np.zeros(0)
    alone = [
        _Quantities(q.middle, q.covariance, np.zeros((PARAMETERS, 0)), none, np.zeros((0, 0)), none)
        for q in (p.posterior() for p in problems)
    ]
    mean, apart = log_differences(*alone)
    np.testing.assert_allclose(apart, alone[0].covariance + alone[1].covariance, rtol=1e-9)
    assert np.max(np.abs(np.diag(apart) / np.diag(covariance) - 1.0)) > 0.05
    np.testing.assert_array_equal(mean, alone[1].middle - alone[0].middle)


def test_model_error_widens_what_is_left_and_never_makes_it_negative(problems) -> None:
    first, second = (p.posterior() for p in problems)
    _, known = log_differences(first, second)
    wider = 0.01 * np.eye(PARAMETERS)
    grown = _Quantities(
        first.middle, first.covariance + wider, first.sensitivity, first.estimate, first.error_covariance, PRIOR_SD
    )
    np.testing.assert_allclose(log_differences(grown, second)[1], known + wider, rtol=1e-7)
    # A sandwich may make a direction narrower than the errors that both share: that is none of the rest.
    narrow = _Quantities(
        first.middle, 1e-3 * first.covariance, first.sensitivity, first.estimate, first.error_covariance, PRIOR_SD
    )
    assert np.linalg.eigvalsh(narrow.alone).min() > -1e-12


def test_holm_by_his_own_steps() -> None:
    """Reject from the smallest on while p <= rate / (n - k): what is rejected has an adjusted value below the rate."""
    random = np.random.default_rng(2)
    for _ in range(200):
        p_values = random.uniform(size=7) ** 3
        rejected, order = set(), np.argsort(p_values)
        for k, i in enumerate(order):
            if p_values[i] > ERROR_RATE / (7 - k):
                break
            rejected.add(int(i))
        assert set(np.flatnonzero(holm(p_values) <= ERROR_RATE)) == rejected


def test_holm_errs_as_rarely_as_it_says() -> None:
    """Of families in which nothing has changed, at most one in twenty has something that is called so."""
    random = np.random.default_rng(3)
    p_values = 2.0 * norm.sf(np.abs(random.normal(size=(4000, 8))))
    called = np.mean([(holm(p) < ERROR_RATE).any() for p in p_values])
    # Within three standard deviations of the binomial.
    assert called < ERROR_RATE + 3.0 * np.sqrt(ERROR_RATE * (1.0 - ERROR_RATE) / 4000)
    assert np.mean([(p < ERROR_RATE).any() for p in p_values]) > 0.25
