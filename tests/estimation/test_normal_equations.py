"""Normal equations against least squares on stacked rows, projections of columns, and sums in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.estimation.uncertainty.normal_equations import NormalEquations

PARAMETERS = 3
SD = np.array([0.5, 2.0, 1e-3])
PRIOR = np.diag([0.3, 0.0, 2.0])
PULL, AMOUNTS = np.array([0.2, 0.0, -1.0]), np.array([0.1, -1.0, 2e-4])
FURTHER = slice(PARAMETERS, None)


def stacked(sd: np.ndarray = SD) -> tuple[np.ndarray, np.ndarray]:
    """Rows and residuals of data and priors together, of which the solution is that of LAPACK."""
    random = np.random.default_rng(5)
    rows = random.standard_normal((40, PARAMETERS + sd.size)) * np.array([3.0, 1.0, 2.0, 20.0, 9.0, 500.0])
    residual = random.standard_normal(40)
    of_prior = np.zeros((PARAMETERS, PARAMETERS + sd.size))
    of_prior[:, :PARAMETERS] = np.sqrt(PRIOR)
    pulls = np.divide(PULL, np.sqrt(np.diag(PRIOR)), where=np.diag(PRIOR) > 0.0, out=np.zeros(PARAMETERS))
    tolerances = np.eye(sd.size, PARAMETERS + sd.size, PARAMETERS) / sd[:, None]
    return np.concatenate([rows, of_prior, tolerances]), np.concatenate([residual, pulls, AMOUNTS / sd])


@pytest.fixture
def equations() -> NormalEquations:
    whole, residual = stacked()
    rows, of_data = whole[:40], residual[:40]
    return NormalEquations.of(rows.T @ rows, rows.T @ of_data, sd=SD, prior=PRIOR, pull=PULL, amounts=AMOUNTS)


def solution(whole: np.ndarray, residual: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(whole, -residual, rcond=None)[0]


def test_step_gain_and_covariance_are_those_of_stacked_least_squares(equations):
    whole, residual = stacked()
    best = solution(whole, residual)
    np.testing.assert_allclose(equations.step(), best, rtol=1e-10)
    fall = 0.5 * float(residual @ residual - np.sum((residual + whole @ best) ** 2))
    assert equations.gain == pytest.approx(fall, rel=1e-11)
    inverse = np.linalg.pinv(whole) @ np.linalg.pinv(whole).T
    np.testing.assert_allclose(equations.covariance, inverse, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(equations.variances, np.diag(inverse), rtol=1e-10)
    factor = equations.covariance_factor
    np.testing.assert_allclose(factor @ factor.T, inverse, rtol=1e-9, atol=1e-16)
    # The volume of the rows, in the units in which the unknowns are counted: by singular values.
    volume = 2.0 * float(np.log(np.linalg.svd(whole * equations.unit, compute_uv=False)).sum())
    assert equations.log_determinant == pytest.approx(volume, rel=1e-11)


def test_elimination_leaves_what_projected_columns_leave(equations):
    """Columns of what stays, less their projection on the columns of what goes."""
    whole, residual = stacked()
    basis, _ = np.linalg.qr(whole[:, FURTHER])
    kept = whole[:, :PARAMETERS] - basis @ (basis.T @ whole[:, :PARAMETERS])
    left, response = equations.eliminate(FURTHER)
    np.testing.assert_allclose(left.matrix, kept.T @ kept, rtol=1e-10)
    np.testing.assert_allclose(left.gradient, kept.T @ residual, rtol=1e-10)
    np.testing.assert_allclose(left.step(), solution(whole, residual)[:PARAMETERS], rtol=1e-9)
    # The eliminated follow as in a fit of each column of what stays.
    followed = -np.linalg.lstsq(whole[:, FURTHER], whole[:, :PARAMETERS], rcond=None)[0]
    np.testing.assert_allclose(response, followed, rtol=1e-9)
    # Negative control: with the others held, much more seems to be known.
    assert (equations.only(slice(PARAMETERS)).variances < 0.95 * left.variances).all()


def test_a_slope_beside_a_free_level_is_known_from_the_scatter_of_the_places():
    """sum (t - mean t)^2 and sum (t - mean t) y, the closed form of a regression line."""
    t, y = np.array([0.0, 1.0, 3.0, 7.0]), np.array([2.0, -1.0, 4.0, 5.0])
    rows = np.stack([np.ones(4), t], axis=1)
    line = NormalEquations.of(rows.T @ rows, -rows.T @ y, sd=np.full(2, np.inf))
    left, response = line.eliminate([0])
    away = t - t.mean()
    assert left.matrix[0, 0] == pytest.approx(away @ away)
    assert left.gradient[0] == pytest.approx(-away @ y)
    assert response[0, 0] == pytest.approx(-t.mean())


def test_a_score_test_is_the_fall_of_the_squares_by_one_more_column(equations):
    whole, residual = stacked()
    for one in range(PARAMETERS):
        others = [k for k in range(whole.shape[1]) if k != one]
        least, every = (
            float(np.sum((residual + whole[:, of] @ solution(whole[:, of], residual)) ** 2))
            for of in (others, [*others, one])
        )
        gain, step = equations.eliminate(others).left.score_tests()
        assert gain[0] == pytest.approx(least - every, rel=1e-9)
        assert step[0] == pytest.approx(solution(whole, residual)[one], rel=1e-9)


def test_what_moves_nothing_gains_nothing():
    equations = NormalEquations(np.diag([4.0, 0.0, 0.25]), np.array([2.0, 0.0, 0.5]), np.ones(3))
    gain, step = equations.score_tests()
    # What moves little gains by how far it goes.
    assert gain.tolist() == [1.0, 0.0, 1.0]
    assert step.tolist() == [-0.5, 0.0, -2.0]
    none = NormalEquations(np.zeros((2, 2)), np.zeros(2), np.ones(2)).along(np.ones((2, 1))).score_tests()
    assert [value.tolist() for value in none] == [[0.0], [0.0]]


def test_a_prior_of_no_width_holds_an_unknown(equations):
    whole, residual = stacked()
    held = [0, 1, 2, 3, 5]
    data = slice(40)
    rows = whole[data]
    sd = np.where(np.arange(3) == 1, 0.0, SD)
    found = NormalEquations.of(rows.T @ rows, rows.T @ residual[data], sd=sd, prior=PRIOR, pull=PULL, amounts=AMOUNTS)
    used = np.delete(np.arange(len(residual)), 40 + PARAMETERS + 1)
    best = solution(whole[np.ix_(used, held)], residual[used])
    np.testing.assert_allclose(found.step()[held], best, rtol=1e-10)
    assert found.step()[4] == found.variances[4] == 0.0
    np.testing.assert_allclose(found.variances[held], equations.only(held).variances, rtol=1e-10)


def test_gradients_that_hold_what_follows_a_step_lead_to_where_nothing_is_left(equations):
    """After the step z the unknowns have moved by z + F z: there data and priors pull with equal force."""
    random = np.random.default_rng(2)
    whole, residual = stacked()
    following = np.zeros((6, 6))
    following[3:, :PARAMETERS] = 0.1 * random.standard_normal((3, 3)) * SD[:, None]
    rows, data = whole[:40], residual[:40]
    information = rows.T @ rows
    step = equations.step(information @ following)
    left = rows.T @ (data + rows @ (step + following @ step))
    priors = whole[40:].T @ (residual[40:] + whole[40:] @ step)
    np.testing.assert_allclose(left + priors, 0.0, atol=1e-8 * np.abs(rows.T @ data).max())
    # Negative control: the plain step leaves some.
    plain = equations.step()
    off = rows.T @ (data + rows @ (plain + following @ plain)) + whole[40:].T @ (residual[40:] + whole[40:] @ plain)
    assert np.abs(off).max() > 1e-3 * np.abs(rows.T @ data).max()


def test_amplitudes_along_directions_are_unknowns_of_their_own(equations):
    whole, residual = stacked()
    directions = np.random.default_rng(8).standard_normal((6, 2))
    along = whole @ (np.concatenate([np.ones(PARAMETERS), SD])[:, None] * directions)
    found = equations.along(directions)
    np.testing.assert_allclose(found.step(), solution(along, residual), rtol=1e-10)


def test_no_unknowns_at_all_do_no_harm():
    none = NormalEquations.of(np.eye(2), np.ones(2), sd=np.zeros(0), prior=np.eye(2))
    left, response = none.eliminate(slice(2, None))
    assert response.shape == (0, 2)
    np.testing.assert_allclose(left.step(), [-0.5, -0.5])
    assert none.only([]).gain == 0.0
    assert none.only([]).variances.size == 0


def test_a_matrix_that_rounding_has_made_indefinite_is_solved_all_the_same():
    rounded = NormalEquations(np.array([[1.0, 1.0], [1.0, 1.0 - 1e-9]]), np.array([1.0, 1.0]), np.ones(2))
    np.testing.assert_allclose(rounded.step(), [-1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(rounded.covariance @ rounded.matrix, np.eye(2), atol=1e-6)
