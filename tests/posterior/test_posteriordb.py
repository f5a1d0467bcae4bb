"""The sampling stage against the reference draws of three posteriordb models; a wrong sampler fails the same check."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import emcee
import numpy as np
import pytest
from figures import record
from reference_posteriors import ReferencePosterior, absorption, eight_schools, lynx_and_hare, vectorised
from scipy.integrate import solve_ivp

from sysid.posterior import LaplaceMove, sampling
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior

#: Their standard deviations are not finite (Cauchy tails): the width between the 5 and 95 % quantiles stands in.
HEAVY_TAILS = ("K_m", "V_m")


def sampled(posterior: ReferencePosterior, steps: int) -> np.ndarray:
    """Parameters (n, q) by the sampling stage with all its moves."""
    centre, covariance = posterior.laplace()
    names = tuple(f"x_{i}" for i in range(centre.size))
    options = SamplingOptions(
        segment_steps=500, adapting_steps=0, max_steps=steps, min_steps=steps, seed=3, walkers_per_parameter=4.0
    )
    found = sample_posterior(vectorised(posterior), names, centre, covariance, "reference", options)
    return posterior.parameters(np.log(found.draws.reshape(-1, centre.size)))


def compared(posterior: ReferencePosterior, parameters: np.ndarray) -> dict[str, tuple[float, float]]:
    """Per parameter, difference of the means (medians) in standard deviations and ratio of widths."""
    found = {}
    for values, (name, reference) in zip(parameters.T, posterior.reference.items(), strict=True):
        q05, q50, q95 = np.quantile(values, [0.05, 0.5, 0.95])
        if name in HEAVY_TAILS:
            width = reference["q95"] - reference["q05"]
            found[name] = float(3.29 * (q50 - reference["q50"]) / width), float((q95 - q05) / width)
        else:
            off = (values.mean() - reference["mean"]) / reference["sd"]
            found[name] = float(off), float(values.std() / reference["sd"])
    return found


def agrees(found: dict[str, tuple[float, float]], width: float = 0.05) -> bool:
    """The check of this file: means within 0.1 standard deviations, widths within 5 %."""
    return all(abs(off) < 0.1 and abs(ratio - 1.0) < width for off, ratio in found.values())


def test_eight_schools_with_a_short_chain():
    posterior = eight_schools()
    found = compared(posterior, sampled(posterior, 1000))
    assert agrees(found, width=0.08), found


@pytest.mark.long
@pytest.mark.parametrize(("model", "steps"), [(eight_schools, 5000), (lynx_and_hare, 3000), (absorption, 6000)])
def test_means_and_widths_of_the_reference_draws(model: Callable[[], ReferencePosterior], steps: int):
    posterior = model()
    found = compared(posterior, sampled(posterior, steps))
    record(f"posteriordb_{model.__name__}", found)
    assert agrees(found), found


class WithoutHastings(LaplaceMove):
    """The independence move as it must not be: proposals are weighed as if they were symmetric."""

    def _propose(self, coordinates, random):
        proposal, factor = super()._propose(coordinates, random)
        return proposal, 0.0 * factor


def test_a_move_without_its_hastings_factor_is_caught(monkeypatch):
    monkeypatch.setattr(
        sampling, "posterior_moves", lambda centre, covariance, *step: [(WithoutHastings(centre, covariance), 1.0)]
    )
    posterior = eight_schools()
    assert not agrees(compared(posterior, sampled(posterior, 500)), width=0.08)


@pytest.mark.long
@pytest.mark.skipif(version("emcee") != "3.1.6", reason="the fault is that of this release")
def test_the_snooker_move_is_caught(monkeypatch):
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    monkeypatch.setattr(sampling, "posterior_moves", lambda centre, covariance, *step: moves)
    posterior = lynx_and_hare()
    found = compared(posterior, sampled(posterior, 3000))
    record("posteriordb_snooker", found)
    assert not agrees(found), found


def test_the_integration_of_the_models_is_accurate():
    """The hidden states enter the densities through their logarithms: a change of one parameter, against DOP853."""
    posterior = absorption()
    density = vectorised(posterior)
    data_times = np.arange(0.5, 10.5, 0.5)
    readings = np.array(posterior_readings())
    points = posterior.start + np.array([[0.0, 0.0, 0.0, 0.0], [0.1, -0.3, 0.1, 0.05]])

    def exact(x: np.ndarray) -> float:
        k_a, k_m, v_m, sigma = np.exp(x)

        def rate(t, c):
            return np.exp(-k_a * t) * 30.0 * k_a / 2.0 - v_m / 2.0 * c / (k_m + c)

        c = solve_ivp(rate, (0.0, 10.0), [0.0], "DOP853", data_times, rtol=1e-10, atol=1e-12).y[0]
        terms = -np.log(sigma) - 0.5 * ((np.log(readings) - np.log(c)) / sigma) ** 2
        return terms.sum() - np.log1p(np.exp(x) ** 2).sum() + x.sum()

    ours, reference = np.diff(density(points))[0], exact(points[1]) - exact(points[0])
    assert ours == pytest.approx(reference, abs=1e-3)


def posterior_readings() -> list[float]:
    from reference_posteriors import load

    return load("one_comp_mm_elim_abs-one_comp_mm_elim_abs", "one_comp_mm_elim_abs")[0]["C_hat"]
