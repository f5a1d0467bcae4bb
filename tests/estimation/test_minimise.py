"""Levenberg-Marquardt against the certified values of the NIST StRD nonlinear regression problems, both starts."""

from __future__ import annotations

import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from sysid.errors import SysidError
from sysid.estimation.levenberg_marquardt import minimise, promised_fall

DATA = Path(__file__).resolve().parents[1] / "data" / "nist_strd"

MODELS = {
    "Misra1a": lambda b, x: b[0] * (1 - jnp.exp(-b[1] * x)),
    "Chwirut2": lambda b, x: jnp.exp(-b[0] * x) / (b[1] + b[2] * x),
    "Lanczos3": lambda b, x: b[0] * jnp.exp(-b[1] * x) + b[2] * jnp.exp(-b[3] * x) + b[4] * jnp.exp(-b[5] * x),
    "MGH09": lambda b, x: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda b, x: b[0] * jnp.exp(b[1] / (x + b[2])),
    "Thurber": lambda b, x: (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3),
    "BoxBOD": lambda b, x: b[0] * (1 - jnp.exp(-b[1] * x)),
    "Rat43": lambda b, x: b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Eckerle4": lambda b, x: b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Bennett5": lambda b, x: b[0] * (b[1] + x) ** (-1 / b[2]),
}


def problem(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Data (n, 2) as y, x; starts (2, p); certified values (p,); certified residual sum of squares."""
    text = (DATA / f"{name}.dat").read_text(encoding="ascii")
    rows = np.array([[float(v) for v in m.split()] for m in re.findall(r"^\s*b\d+ =(.*)$", text, re.M)])
    data = np.loadtxt(text[text.rindex("Data:") :].splitlines()[1:])
    squares = float(re.search(r"Residual Sum of Squares:\s+(\S+)", text)[1])
    return data, rows[:, :2].T, rows[:, 2], squares


@pytest.mark.parametrize("start", [1, 2])
@pytest.mark.parametrize("name", MODELS)
def test_certified_values_to_six_digits(name: str, start: int):
    data, starts, certified, squares = problem(name)
    y, x = data.T

    @jax.jit
    def both(b):
        def residual(c):
            return MODELS[name](c, x) - y

        return residual(b), jax.jacfwd(residual)(b)

    def evaluate(b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, jacobian = both(b)
        return np.asarray(r), np.asarray(jacobian)

    found = minimise(evaluate, starts[start - 1], relative_tolerance=1e-14, step_tolerance=1e-12, max_iterations=8000)
    digits = -np.log10(np.maximum(np.abs(found.point / certified - 1.0), 1e-12))
    assert found.converged, found.message
    assert digits.min() >= 6.0
    assert 2 * found.cost == pytest.approx(squares, rel=1e-7)


def quadratic(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return point - 1.0, np.eye(point.size)


def test_a_linear_problem_ends_at_once():
    found = minimise(quadratic, np.array([3.0, -2.0]))
    np.testing.assert_allclose(found.point, 1.0, rtol=1e-8)
    assert found.converged
    assert found.iterations < 15


def test_the_limit_of_iterations_is_not_convergence():
    data, starts, _, _ = problem("MGH09")
    y, x = data.T
    residual = jax.jit(lambda b: MODELS["MGH09"](b, x) - y)
    jacobian = jax.jit(jax.jacfwd(lambda b: MODELS["MGH09"](b, x) - y))
    found = minimise(lambda b: (np.asarray(residual(b)), np.asarray(jacobian(b))), starts[0], max_iterations=3)
    assert not found.converged
    assert "limit" in found.message


def test_a_trial_outside_the_domain_is_only_a_rejected_step():
    """log x has no value below zero, where the first full Gauss-Newton step from 3 would land."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.log(point) + 2.0, np.array([[1.0 / point[0]]])

    found = minimise(evaluate, np.array([3.0]), relative_tolerance=1e-14, step_tolerance=1e-12)
    assert found.point[0] == pytest.approx(np.exp(-2.0), rel=1e-8)


def test_a_start_without_a_finite_residual_is_said_in_words():
    with pytest.raises(SysidError, match="not finite at the start"):
        minimise(lambda p: (np.full(2, np.nan), np.eye(2)), np.ones(2))


def test_progress_is_reported():
    seen: list[tuple[int, float]] = []
    minimise(quadratic, np.array([3.0, -2.0]), on_iteration=lambda i, cost: seen.append((i, cost)))
    assert [i for i, _ in seen] == list(range(1, len(seen) + 1))
    assert [c for _, c in seen] == sorted((c for _, c in seen), reverse=True)
    assert seen[0][1] == pytest.approx(6.5)


def test_failed_trials_alone_are_no_convergence():
    """Derivatives of the wrong sign: every trial goes uphill and is rejected, but the slope has not vanished."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.append(point - 1.0, 1.0), -np.eye(3, 2)

    found = minimise(evaluate, np.array([3.0, -2.0]))
    assert not found.converged
    np.testing.assert_array_equal(found.point, [3.0, -2.0])
    # Half of 2^2 + 3^2 of a cost of half of 2^2 + 3^2 + 1^2.
    assert "93 %" in found.message


def test_failed_trials_at_a_minimum_are_convergence():
    """A cost with a kink at its minimum: no smaller cost is found, and none is promised."""

    def evaluate(point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.array([np.sqrt(2.0 * (5.0 + np.abs(point[0] - 1.0)))]), np.array([[0.0]])

    found = minimise(evaluate, np.array([1.0]))
    assert found.converged


def test_the_promised_fall_is_that_of_a_straight_line_through_four_points():
    """Least squares through (0, 0), (1, 2), (2, 1), (3, 3): slope 0.8, intercept 0.3, remaining squares 1.8 of 14."""
    x, y = np.arange(4.0), np.array([0.0, 2.0, 1.0, 3.0])
    design = np.stack([np.ones(4), x], axis=1)
    assert promised_fall(-y, 1e6 * design) == pytest.approx(0.5 * (14.0 - 1.8))
    left = 0.3 + 0.8 * x - y
    assert promised_fall(left, design) == pytest.approx(0.0, abs=1e-20)
    # A column of zeros promises nothing.
    assert promised_fall(-y, np.stack([np.ones(4), x, 0.0 * x], axis=1)) == pytest.approx(0.5 * (14.0 - 1.8))
