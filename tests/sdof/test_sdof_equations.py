"""Equations (1)-(3), their exact form and the quarter-car inversion against hand calculation and eigenvalues."""

from __future__ import annotations

import numpy as np
import pytest

from sysid.sdof import (
    corrected_damping,
    corrected_stiffness,
    damping_ratio_from_decrement,
    decrement_from_damping_ratio,
    directive_damping,
    exact_damping,
    exact_stiffness,
    invert_quarter_car,
    log_decrement,
    paper_damping,
    paper_stiffness,
    series_damping,
    series_stiffness,
)
from sysid.sdof.equations import eigenvalue_from_decay, propagate


def body_mode(k, c, m, m_u, kt, ct):
    """Body-mode eigenvalue of the quarter car (lowest frequency, positive imaginary part) by numpy."""
    matrix = np.array(
        [
            [0, 1, 0, 0],
            [-k / m, -c / m, k / m, c / m],
            [0, 0, 0, 1],
            [k / m_u, c / m_u, -(k + kt) / m_u, -(c + ct) / m_u],
        ]
    )
    values = np.linalg.eigvals(matrix)
    values = values[values.imag > 0]
    return values[np.argmin(values.imag)]


def test_paper_equations_give_the_numbers_of_a_hand_calculation():
    assert paper_stiffness(0.588, 3415.0) == pytest.approx(389938.2, rel=1e-6)
    assert paper_damping(0.588, 0.703, 3415.0) == pytest.approx(8115.17, rel=2e-6)
    assert log_decrement(28.0, 14.0) == pytest.approx(0.693147180559945, rel=1e-14)


def test_decrement_and_damping_ratio_are_those_of_the_textbook_decay():
    ratio, omega_0 = 0.21, 9.3
    period = 2 * np.pi / (omega_0 * np.sqrt(1 - ratio**2))
    decrement = ratio * omega_0 * period
    assert decrement_from_damping_ratio(ratio) == pytest.approx(decrement, rel=1e-13)
    assert damping_ratio_from_decrement(decrement) == pytest.approx(ratio, rel=1e-13)
    assert directive_damping(decrement) == pytest.approx(decrement / 6.283185307179586, rel=1e-13)


@pytest.mark.parametrize("ratio", [0.05, 0.2, 0.4])
def test_exact_form_inverts_the_single_mass(ratio):
    m, k = 2000.0, 3.2e5
    c = 2 * ratio * np.sqrt(k * m)
    root = np.roots([m, c, k])[0]
    period, decrement = 2 * np.pi / abs(root.imag), -root.real * 2 * np.pi / abs(root.imag)
    assert exact_stiffness(period, decrement, m) == pytest.approx(k, rel=1e-12)
    assert exact_damping(period, decrement, m) == pytest.approx(c, rel=1e-12)
    # Equation (1) leaves out 1 - zeta^2, equation (2) follows it: the known bias of the paper's form.
    assert paper_stiffness(period, m) == pytest.approx(k * (1 - ratio**2), rel=1e-12)
    assert paper_damping(period, decrement, m) == pytest.approx(c * np.sqrt(1 - ratio**2), rel=1e-12)


@pytest.mark.parametrize("share", [0.05, 0.2, 0.4, 0.6])
@pytest.mark.parametrize("ratio", [0.02, 0.15, 0.35])
def test_inversion_returns_the_quarter_car_behind_an_eigenvalue(share, ratio):
    m, m_u, kt, ct = 3415.0, 1050.0, 1.65e6, 3000.0
    k = share * kt
    c = 2 * ratio * np.sqrt(k * m)
    s = body_mode(k, c, m, m_u, kt, ct)
    stiffness, damping = invert_quarter_car(s, m, m_u, kt, ct)
    assert stiffness == pytest.approx(k, rel=1e-9)
    assert damping == pytest.approx(c, rel=1e-9)
    period, decrement = 2 * np.pi / s.imag, -2 * np.pi * s.real / s.imag
    assert eigenvalue_from_decay(period, decrement) == pytest.approx(s, rel=1e-12)
    assert corrected_stiffness(period, decrement, m, m_u, kt, ct) == pytest.approx(k, rel=1e-9)
    assert corrected_damping(period, decrement, m, m_u, kt, ct) == pytest.approx(c, rel=1e-9)


def test_series_form_is_the_light_damping_limit_without_unsprung_mass():
    m, kt, ct, k, c = 3000.0, 1.65e6, 900.0, 4.0e5, 300.0
    s = body_mode(k, c, m, 1e-3, kt, ct)
    period, decrement = 2 * np.pi / s.imag, -2 * np.pi * s.real / s.imag
    k_eq, c_eq = exact_stiffness(period, decrement, m), exact_damping(period, decrement, m)
    k_series = series_stiffness(k_eq, kt)
    assert k_series == pytest.approx(k, rel=1e-4)
    assert series_damping(c_eq, k_series, kt, ct) == pytest.approx(c, rel=1e-3)


def test_inversion_says_by_its_sign_that_a_stiffness_above_the_tire_cannot_be():
    too_fast = eigenvalue_from_decay(0.2, 0.3)
    assert invert_quarter_car(too_fast, 3415.0, 540.0, 1.65e6, 3000.0)[0] < 0


def test_propagation_is_the_delta_method():
    covariance = np.array([[1e-6, 2e-6], [2e-6, 4e-4]])
    value, spread = propagate(lambda x: np.array([1 / x[0] ** 2, x[0] * x[1]]), np.array([0.5, 0.8]), covariance)
    jacobian = np.array([[-2 / 0.5**3, 0.0], [0.8, 0.5]])
    np.testing.assert_allclose(value, [4.0, 0.4], rtol=1e-14)
    np.testing.assert_allclose(spread, jacobian @ covariance @ jacobian.T, rtol=1e-8)
