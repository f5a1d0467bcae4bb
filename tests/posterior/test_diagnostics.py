"""Convergence figures against ArviZ and sequences of known autocorrelation; the verdicts of the sampling stage."""

from __future__ import annotations

import dataclasses

import emcee
import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy.signal import lfilter

from sysid.posterior.diagnostics import diagnose, standstills, summarise
from sysid.posterior.ensembles import first
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampled_posterior import optimum_warnings
from sysid.posterior.sampling import sample_posterior

SHAPE = (4, 2000, 10, 2)


def ar1(rho: float, seed: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """Independent AR(1) walkers of unit variance (ensembles, steps, walkers, parameters)."""
    noise = np.random.default_rng(seed).normal(size=shape) * np.sqrt(1 - rho**2)
    noise[:, 0] /= np.sqrt(1 - rho**2)
    return lfilter([1.0], [1.0, -rho], noise, axis=1)


@pytest.mark.parametrize("rho", [0.0, 0.7, 0.9])
def test_autocorrelation_time_of_known_sequences(rho: float):
    found = diagnose(ar1(rho, 1))
    tau = (1 + rho) / (1 - rho)
    np.testing.assert_allclose(found.autocorrelation_time, tau, rtol=0.1, atol=0.05)
    assert found.burn_in == pytest.approx(5 * tau, rel=0.15, abs=2)
    kept = SHAPE[1] - found.burn_in
    np.testing.assert_allclose(found.ess, 4 * 10 * kept / tau, rtol=0.1)


@pytest.mark.parametrize("steps", [47, 64, 300])
def test_autocorrelation_time_is_that_of_emcee(steps: int):
    draws = ar1(0.7, 5, (4, steps, 58, 3))
    found = diagnose(draws)
    kept = draws[:, found.burn_in :]
    theirs = np.mean([emcee.autocorr.integrated_time(chain, tol=0, quiet=True) for chain in kept], axis=0)
    np.testing.assert_allclose(found.autocorrelation_time, theirs, rtol=1e-13)


def test_an_ensemble_with_a_walker_that_never_moved_counts_as_one_long_correlation():
    draws = ar1(0.7, 5, (4, 64, 58, 2))
    draws[1, :, 3, 0] = 0.0
    found = diagnose(draws)
    assert found.autocorrelation_time[0] == 64 - found.burn_in
    assert found.autocorrelation_time[1] < 10.0


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_effective_draws_agree_with_arviz(rho: float):
    """Independent walkers are chains of their own for ArviZ, so both must count the same."""
    draws = ar1(rho, 2)
    found = diagnose(draws)
    kept = draws[:, found.burn_in :]
    for i in range(2):
        chains = np.moveaxis(kept[..., i], 2, 1).reshape(-1, kept.shape[1])
        assert found.ess[i] == pytest.approx(
            float(array_stats.ess(chains, chain_axis=0, draw_axis=1, method="mean")), rel=0.1
        )


def test_effective_draws_of_a_short_run_are_not_overstated():
    draws = ar1(0.7, 4, (4, 90, 58, 2))
    found = diagnose(draws)
    kept = 90 - found.burn_in
    true = 4 * 58 * kept * (1 - 0.7) / (1 + 0.7)
    np.testing.assert_allclose(found.ess, true, rtol=0.2)
    # The autocorrelation time of so few steps would promise more.
    assert (4 * 58 * kept / found.autocorrelation_time).min() > 1.2 * true


def test_rhat_compares_ensembles_and_not_walkers():
    draws = ar1(0.5, 3)
    assert diagnose(draws).rhat.max() < 1.01
    apart = draws.copy()
    apart[0, ..., 1] += 1.0
    found = diagnose(apart)
    assert found.rhat[0] < 1.01
    assert found.rhat[1] > 1.05
    flat = apart[:, found.burn_in :, :, 1].reshape(4, -1)
    assert found.rhat[1] == pytest.approx(float(array_stats.rhat(flat, chain_axis=0, draw_axis=1)), rel=1e-12)
    # Walkers that differ from each other, alike in all ensembles, are no lack of convergence.
    shifted = draws + np.arange(10)[:, None] * 0.0 + np.where(np.arange(10) % 2, 0.3, -0.3)[:, None]
    assert diagnose(shifted).rhat.max() < 1.01


def test_a_chain_still_drifting_is_seen_by_rhat():
    draws = ar1(0.5, 4, (4, 400, 10, 2))
    draws[..., 0] += np.linspace(0.0, 6.0, 400)[:, None]
    found = diagnose(draws)
    assert found.rhat[0] > 1.1
    assert found.burn_in <= 200


def test_summaries_are_moments_and_quantiles():
    draws = np.exp(np.random.default_rng(6).normal(size=(50_000, 2)) * [0.1, 0.2] + [1.0, 2.0])
    diagnosis = diagnose(ar1(0.0, 7))
    first, second = summarise(("a", "b"), draws, diagnosis)
    assert (first.name, second.name) == ("a", "b")
    assert first.mean == pytest.approx(np.exp(1.0 + 0.005), rel=2e-3)
    assert second.q50 == pytest.approx(np.exp(2.0), rel=5e-3)
    assert second.q05 == pytest.approx(np.exp(2.0 - 1.6449 * 0.2), rel=1e-2)
    assert second.q95 == pytest.approx(np.exp(2.0 + 1.6449 * 0.2), rel=1e-2)
    assert second.ess == diagnosis.ess[1]


CENTRE, SD = np.array([12.0, 9.0]), np.array([0.1, 0.3])


def density(points: np.ndarray) -> np.ndarray:
    return -0.5 * (((points - CENTRE) / SD) ** 2).sum(axis=1)


def sampled(options: SamplingOptions):
    return sample_posterior(density, ("k_1", "c_1"), CENTRE, np.diag(SD**2), "test", options)


def test_sampling_goes_on_until_it_has_converged():
    found = sampled(SamplingOptions(seed=1, min_effective=1500.0, segment_steps=100))
    assert found.converged
    assert found.message.startswith("Converged.")
    assert found.draws.shape[0] == 4
    for summary, centre, sd in zip(found.summaries, CENTRE, SD, strict=True):
        assert summary.rhat < 1.01
        assert summary.ess >= 1500.0
        # Lognormal: median and log quantiles of the Gaussian that was sampled.
        assert np.log(summary.q50) == pytest.approx(centre, abs=0.12 * sd)
        assert np.log(summary.q95 / summary.q05) == pytest.approx(2 * 1.6449 * sd, rel=0.08)
    assert ((found.acceptance > 0.2) & (found.acceptance < 0.99)).all()


def test_ensembles_that_all_still_climb_have_not_converged():
    """Draws of every parameter agree, as in a wide space; the log-density of all walkers rises by half its scatter."""
    random = np.random.default_rng(6)
    draws, log_density = random.normal(size=(4, 30, 60, 3)), 5.0 * random.normal(size=(4, 30, 60))
    rising = log_density + 2.5 * np.linspace(0.0, 2.0, 30)[:, None]
    assert diagnose(draws, 10).worst_rhat < 1.01
    assert diagnose(draws, 10, log_density).worst_rhat < 1.01
    climbing = diagnose(draws, 10, rising)
    assert climbing.rhat.max() < 1.01 < 1.015 < climbing.density_rhat == climbing.worst_rhat
    # The same density everywhere is no sign of anything.
    assert diagnose(draws, 10, np.zeros((4, 30, 60))).density_rhat == 1.0


def test_a_limit_that_is_too_short_is_said():
    found = sampled(SamplingOptions(seed=1, max_steps=40, min_effective=1e6))
    assert not found.converged
    assert "Not converged at the limit of 40 steps" in found.message


def test_a_preview_is_never_called_converged():
    found = sampled(SamplingOptions(seed=1, max_steps=200, min_effective=10.0, rhat_limit=2.0, preview=True))
    assert not found.converged
    assert "Preview" in found.message


def test_the_same_seed_gives_the_same_chain_and_another_one_another():
    options = SamplingOptions(seed=3, max_steps=40, min_effective=1e6)
    first, again = sampled(options), sampled(options)
    assert first.draws.tobytes() == again.draws.tobytes()
    other = sampled(dataclasses.replace(options, seed=4))
    assert not np.array_equal(first.draws, other.draws)


def test_progress_runs_towards_one():
    seen: list[float] = []
    sample_posterior(
        density,
        ("k_1", "c_1"),
        CENTRE,
        np.diag(SD**2),
        "test",
        SamplingOptions(seed=1),
        progress=lambda message, fraction: seen.append(fraction),
    )
    assert seen
    assert all(0.0 <= f <= 1.0 for f in seen)


def test_a_standstill_that_chance_does_not_explain_is_found():
    draws = ar1(0.5, 8, (2, 200, 10, 2))
    assert not standstills(draws, 50).any()
    draws[1, 120:170, 3] = draws[1, 120, 3]
    found = standstills(draws, 50)
    assert found[1, 3] == 49
    assert np.count_nonzero(found) == 1
    # One that ended before the kept steps is no matter.
    assert not standstills(draws, 190).any()


def test_walkers_that_seldom_move_are_not_called_stuck():
    """Every walker moves at one step in twenty: standstills of some hundred steps are chance."""
    random = np.random.default_rng(9)
    draws = np.repeat(random.normal(size=(2, 2000, 10, 1)), 1, axis=1)
    for step in range(1, 2000):
        stays = random.random((2, 10)) > 0.05
        draws[:, step] = np.where(stays[..., None], draws[:, step - 1], draws[:, step])
    assert not standstills(draws, 100).any()


def test_a_stuck_walker_is_said():
    """One walker starts on a needle a hundred million times as dense as all around it."""
    options = SamplingOptions(seed=1, max_steps=120, min_effective=1e6)
    seed = np.random.SeedSequence(1).spawn(4)[2]
    needle = first(density, ("k_1", "c_1"), CENTRE, np.diag(2.0 * SD**2), 6, seed).coords[1]

    def with_needle(points: np.ndarray) -> np.ndarray:
        return density(points) + 40.0 * np.exp(-(((points - needle) / 1e-6) ** 2).sum(axis=1))

    found = sample_posterior(with_needle, ("k_1", "c_1"), CENTRE, np.diag(SD**2), "test", options)
    assert len(found.warnings) == 1
    assert "1 of 24 walkers are stuck: walker 2 of ensemble 3" in found.warnings[0]
    assert found.against_intervals == found.warnings
    assert sampled(options).warnings == ()


def test_an_optimum_that_is_not_the_best_is_said():
    """Draws of the Gaussian, whose maximum is 0: seen from there, and from a lower one beside it."""
    found = sampled(SamplingOptions(seed=1))
    assert optimum_warnings(found, np.exp(CENTRE), 0.0) == ()
    assert optimum_warnings(found, np.exp(CENTRE), -4.5) == ()
    (said,) = optimum_warnings(found, np.exp(CENTRE + SD * np.array([1.0, 6.0])), -8.0)
    assert "log-density 8 higher" in said
    assert "they differ most in c_1" in said


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_densities_that_are_not_finite_are_counted_and_said(value: float):
    edge = CENTRE[0] + 0.5 * SD[0]
    seen = []

    def cut(points: np.ndarray) -> np.ndarray:
        outside = points[:, 0] > edge
        seen.append(int(outside.sum()))
        return np.where(outside, value, density(points))

    options = SamplingOptions(seed=1, max_steps=100, min_effective=1e6)
    found = sample_posterior(cut, ("k_1", "c_1"), CENTRE, np.diag(SD**2), "test", options)
    assert np.log(found.draws[..., 0]).max() <= edge
    # Start points are drawn again and do not count.
    assert 0 < found.rejected <= sum(seen)
    assert f"{found.rejected} of {4 * 6 * 100} proposals without a finite simulation" in found.message
    assert "no finite simulation" in found.warnings[0]
    assert sampled(options).rejected == 0


def test_burn_in_is_a_quarter_only_where_walkers_start_near():
    slow = ar1(0.99, 11)
    few = 100
    assert diagnose(slow[:, :few]).burn_in == few // 2
    assert diagnose(slow[:, :few], near=True).burn_in == few // 4
    # Five times tau where that is less, near or not.
    fast = ar1(0.7, 11)
    assert diagnose(fast, near=True).burn_in == diagnose(fast).burn_in < fast.shape[1] // 4
