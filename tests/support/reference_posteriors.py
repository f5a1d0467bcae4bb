"""Log-densities of three posteriordb models in unconstrained coordinates, with their reference summaries.

Positive parameters are sampled as logarithms, so every density has the logarithms' Jacobian added.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import minimize

DATA = Path(__file__).resolve().parents[1] / "data" / "posteriordb"


@dataclass(frozen=True)
class ReferencePosterior:
    """`density` (p,) -> scalar; `parameters` (n, p) -> (n, q) in the order of `reference`, name -> its summary."""

    density: Callable[[jax.Array], jax.Array]
    parameters: Callable[[np.ndarray], np.ndarray]
    reference: dict[str, dict[str, float]]
    start: np.ndarray

    def laplace(self) -> tuple[np.ndarray, np.ndarray]:
        """Mode (p,) and inverse of the negative Hessian there (p, p)."""
        value = jax.jit(jax.value_and_grad(lambda x: -self.density(x)))
        found = minimize(lambda x: tuple(np.asarray(v, float) for v in value(x)), self.start, jac=True, method="BFGS")
        return found.x, np.linalg.inv(np.asarray(jax.hessian(lambda x: -self.density(x))(found.x)))


def load(name: str, data: str) -> tuple[dict, dict]:
    """Data and reference summary."""
    texts = ((DATA / f).read_text(encoding="utf-8") for f in (f"{data}.data.json", f"{name}.reference_summary.json"))
    first, second = map(json.loads, texts)
    return first, second


def runge_kutta(rate: Callable, state: jax.Array, times: np.ndarray, substeps: int) -> jax.Array:
    """States at times (n + 1,) -> (n, d) by the classical fourth-order method, equal steps between times."""

    def step(y, place):
        t, h = place
        a = rate(t, y)
        b = rate(t + h / 2, y + h / 2 * a)
        c = rate(t + h / 2, y + h / 2 * b)
        d = rate(t + h, y + h * c)
        return y + h / 6 * (a + 2 * b + 2 * c + d), None

    h = np.repeat(np.diff(times) / substeps, substeps)
    begin = np.concatenate([[times[0]], times[0] + np.cumsum(h)[:-1]])
    places = (begin.reshape(-1, substeps), h.reshape(-1, substeps))

    def interval(y, place):
        y, _ = jax.lax.scan(step, y, place)
        return y, y

    return jax.lax.scan(interval, state, places)[1]


def log_normal(value, median, sd):
    """Log-density of log-normal values, up to constants."""
    return jnp.sum(-jnp.log(sd) - 0.5 * ((jnp.log(value) - jnp.log(median)) / sd) ** 2)


def half_cauchy(value, scale):
    """Log-density of a Cauchy prior cut at zero, up to constants."""
    return jnp.sum(-jnp.log1p((value / scale) ** 2))


def eight_schools() -> ReferencePosterior:
    """mu ~ N(0, 5), tau ~ Cauchy+(0, 5), theta_j ~ N(mu, tau), y_j ~ N(theta_j, sigma_j); mu, log tau, eta."""
    data, reference = load("eight_schools-eight_schools_noncentered", "eight_schools")
    y, sigma = np.array(data["y"], float), np.array(data["sigma"], float)

    def density(x):
        mu, tau, eta = x[0], jnp.exp(x[1]), x[2:]
        likelihood = -0.5 * jnp.sum(((y - mu - tau * eta) / sigma) ** 2)
        return likelihood - 0.5 * jnp.sum(eta**2) - 0.5 * (mu / 5.0) ** 2 + half_cauchy(tau, 5.0) + x[1]

    def parameters(x: np.ndarray) -> np.ndarray:
        mu, tau = x[:, :1], np.exp(x[:, 1:2])
        return np.concatenate([mu + tau * x[:, 2:], mu, tau], axis=1)

    return ReferencePosterior(density, parameters, reference, np.zeros(10))


def lynx_and_hare() -> ReferencePosterior:
    """u' = (a - b v) u, v' = (-g + d u) v with log-normal readings; coordinates are logarithms."""
    data, reference = load("hudson_lynx_hare-lotka_volterra", "hudson_lynx_hare")
    y, first = np.array(data["y"], float), np.array(data["y_init"], float)
    times = np.concatenate([[0.0], data["ts"]])

    def density(x):
        p = jnp.exp(x)
        theta, z0, sigma = p[:4], p[4:6], p[6:]

        def rate(t, z):
            return jnp.stack([(theta[0] - theta[1] * z[1]) * z[0], (-theta[2] + theta[3] * z[0]) * z[1]])

        z = runge_kutta(rate, z0, times, 20)
        centre, width = jnp.array([1.0, 0.05, 1.0, 0.05]), jnp.array([0.5, 0.05, 0.5, 0.05])
        prior = -0.5 * jnp.sum(((theta - centre) / width) ** 2) - 0.5 * jnp.sum((x[6:] + 1.0) ** 2) - jnp.sum(x[6:])
        prior += log_normal(z0, jnp.array([10.0, 10.0]), jnp.ones(2)) - jnp.sum(x[4:6])
        readings = log_normal(first, z0, sigma) + log_normal(y, z, jnp.broadcast_to(sigma, y.shape))
        return prior + readings + jnp.sum(x)

    start = np.log([0.55, 0.028, 0.8, 0.024, 34.0, 5.9, 0.25, 0.25])
    return ReferencePosterior(density, np.exp, reference, start)


def absorption() -> ReferencePosterior:
    """C' = D k_a exp(-k_a t) / V - (V_m / V) C / (K_m + C), log-normal readings; coordinates are logarithms."""
    data, reference = load("one_comp_mm_elim_abs-one_comp_mm_elim_abs", "one_comp_mm_elim_abs")
    readings, dose, volume = np.array(data["C_hat"], float), float(data["D"]), float(data["V"])
    times = np.concatenate([[float(data["t0"])], data["times"]])

    def density(x):
        k_a, k_m, v_m, sigma = jnp.exp(x)

        def rate(t, c):
            return jnp.exp(-k_a * t) * dose * k_a / volume - v_m / volume * c / (k_m + c)

        c = runge_kutta(rate, jnp.zeros(1), times, 20)[:, 0]
        prior = half_cauchy(jnp.exp(x), 1.0)
        return prior + log_normal(readings, c, jnp.broadcast_to(sigma, c.shape)) + jnp.sum(x)

    return ReferencePosterior(density, np.exp, reference, np.log([0.75, 1.0, 0.9, 0.13]))


def vectorised(posterior: ReferencePosterior) -> Callable[[np.ndarray], np.ndarray]:
    """The density of points (n, p), compiled."""
    compiled = jax.jit(jax.vmap(posterior.density))
    return partial(_on_host, compiled)


def _on_host(compiled: Callable, points: np.ndarray) -> np.ndarray:
    return np.asarray(compiled(points))
