"""Gaussian integrals over many members at once: against scipy, member by member, and against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from sysid.fleet.exchangeable import Readings, chances, pooled_populations
from sysid.fleet.quadratic_forms import forms_of, integrated, inverted, solved_back, squared, sum_of_squares
from sysid.fleet.weights import log_corrections


def spd(random: np.random.Generator, *shape: int) -> np.ndarray:
    """Symmetric positive definite matrices (..., d, d)."""
    a = random.standard_normal((*shape, shape[-1]))
    return a @ a.swapaxes(-1, -2) + 0.1 * np.eye(shape[-1])


def test_integrals_are_those_of_scipy() -> None:
    """Of a campaign that measured y: N(y; x + B e, L^-1) and x ~ N(m, T) give N(y; m + B e, L^-1 + T)."""
    random = np.random.default_rng(1)
    n, members, d, errors = 2, 5, 3, 2
    precision, moved = spd(random, members, d), random.standard_normal((members, d, errors))
    y, root = random.standard_normal((members, d)), np.tril(random.standard_normal((n, d, d)))
    forms = forms_of(precision, np.einsum("mij,mj->mi", precision, y), moved)
    _, rows, log_det = integrated(forms, root)
    after = forms - squared(rows)
    assert sum_of_squares(rows) == pytest.approx(squared(rows).sum(axis=-1))
    for k in range(n):
        for m in range(members):
            found, expected = [], []
            for z in random.standard_normal((4, d + errors)):
                whole = np.r_[z, 1.0]
                found.append(-0.5 * whole @ after[k, :, :, m] @ whole - 0.5 * log_det[k, m])
                covariance = root[k] @ root[k].T + np.linalg.inv(precision[m])
                expected.append(multivariate_normal(z[:d] + moved[m] @ z[d:], covariance).logpdf(y[m]))
            # Up to the constant of the likelihood, N(y; y, L^-1) and exp(y'L y / 2).
            constant = multivariate_normal(y[m], np.linalg.inv(precision[m])).logpdf(y[m])
            constant -= 0.5 * y[m] @ precision[m] @ y[m]
            assert np.array(found) + constant == pytest.approx(np.array(expected), abs=1e-10)


def test_members_are_inverted_and_solved_as_by_lapack() -> None:
    random = np.random.default_rng(2)
    matrices = spd(random, 3, 4, 5)
    found, log_det = inverted(matrices.transpose(0, 2, 3, 1))
    assert found.transpose(0, 3, 1, 2) == pytest.approx(np.linalg.inv(matrices), rel=1e-9)
    assert log_det == pytest.approx(np.linalg.slogdet(matrices)[1])
    upper, right = np.linalg.cholesky(matrices).swapaxes(-1, -2), random.standard_normal((3, 4, 5))
    solved = solved_back(upper.transpose(0, 2, 3, 1).copy(), right.transpose(0, 2, 1).copy())
    assert solved.transpose(0, 2, 1) == pytest.approx(np.linalg.solve(upper, right[..., None])[..., 0], rel=1e-9)


def test_the_evidence_under_draws_over_that_of_the_gaussian_form_is_that_of_quadrature() -> None:
    random, draws = np.random.default_rng(3), np.array([13.01, 12.98, 13.05, 12.9])
    likelihood, middle = 400.0, 13.02
    mean, sd = np.array([13.0, 12.95, 13.1]), np.array([0.1, 0.05, 0.2])
    ratios = norm(mean[:, None], sd[:, None]).logpdf(draws) + random.standard_normal()
    found = log_corrections(
        [ratios], mean[:, None, None], sd[:, None, None, None] ** -2.0, 2.0 * np.log(sd)[:, None],
        np.full((1, 1, 1), likelihood), np.full((1, 1), likelihood * middle),
    )[:, 0]  # fmt: skip
    expected = []
    for m, s, row in zip(mean, sd, ratios, strict=True):
        under_form, _ = quad(
            lambda x, m=m, s=s: np.exp(-0.5 * likelihood * (x - middle) ** 2) * norm(m, s).pdf(x), 12.0, 14.0,
            points=[middle, m], epsabs=1e-13,
        )  # fmt: skip
        expected.append(np.log(np.exp(row).mean()) - np.log(under_form))
    # Both are up to a constant.
    assert np.diff(found) == pytest.approx(np.diff(expected), abs=1e-9)
    assert np.ptp(expected) > 0.2


@pytest.mark.parametrize("errors", [0, 2])
@pytest.mark.parametrize("parameters", [1, 3])
def test_chances_of_all_trucks_are_those_of_one_after_the_other(errors: int, parameters: int) -> None:
    random, trucks = np.random.default_rng(4), 9
    value = 13.0 + 0.1 * random.standard_normal((trucks, parameters))
    value[2, 0] += 0.7
    variance = random.uniform(0.01, 0.05, value.shape) ** 2
    common = 0.03 * random.standard_normal((trucks, parameters, errors))
    if parameters > 1:
        # One that so few know that there is nothing to compare with, and one truck that does not know another.
        value[2:, 1] = value[5, 2] = np.nan
    found = chances(value, variance, common, 0.2)
    for t in range(trucks):
        others = [np.isfinite(value[:, i]) & (np.arange(trucks) != t) for i in range(parameters)]
        at = [i for i in range(parameters) if others[i].sum() >= 2]
        readings = [Readings(value[o, i], variance[o, i], common[o, i], common[t, i]) for i in at for o in [others[i]]]
        expected = np.full(parameters, np.inf)
        for i, population in zip(at, pooled_populations(readings, 0.2), strict=True):
            if np.isfinite(value[t, i]):
                expected[i] = population.tail(value[t, i], variance[t, i])
        assert found[t] == pytest.approx(expected, rel=1e-9)
    assert found[2, 0] < 0.01 < np.delete(found[:, 0], 2).min()
