"""Larger integration steps with moved records: exact at the optimum, and close to it nearer than without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from synthetic_fit import SyntheticFit, synthetic_fit

from sysid.estimation.residuals import larger_steps
from sysid.estimation.residuals.larger_steps import with_larger_steps
from sysid.estimation.residuals.signals import simulate_runs


@pytest.fixture(scope="module")
def fit() -> SyntheticFit:
    return synthetic_fit()


def misses(model, log_parameters: np.ndarray, motion) -> np.ndarray:
    """Simulated signals less the records, all groups and channels in a row, in units of the records' scatter."""
    parts = []
    for signals, arrays, group in zip(
        simulate_runs(model, log_parameters, motion), model.arrays, model.groups, strict=True
    ):
        parts.append(((signals - arrays.value) / np.maximum(group.value.std(axis=0), 1e-12)).ravel())
    return np.concatenate(parts)


def test_at_the_optimum_nothing_changes(fit):
    point, model = fit.state.point, fit.state.model
    larger = with_larger_steps(model, point.log_parameters, point.motion)
    assert [s.substeps for s in larger.shapes] < [s.substeps for s in model.shapes]
    exact = misses(model, point.log_parameters, point.motion)
    np.testing.assert_allclose(misses(larger, point.log_parameters, point.motion), exact, atol=1e-12)
    # Without moved records the larger steps would show.
    unmoved = replace(larger, arrays=model.arrays)
    assert np.abs(misses(unmoved, point.log_parameters, point.motion) - exact).max() > 1e-4


def test_some_standard_deviations_away_little_is_left(fit):
    point, model = fit.state.point, fit.state.model
    larger = with_larger_steps(model, point.log_parameters, point.motion)
    factor = np.linalg.cholesky(fit.result.covariance)
    random = np.random.default_rng(8)
    for _ in range(5):
        x = point.log_parameters + 2.0 * factor @ random.standard_normal(len(factor))
        exact, moved = misses(model, x, point.motion), misses(larger, x, point.motion)
        unmoved = misses(replace(larger, arrays=model.arrays), x, point.motion)
        left, whole = (np.sqrt(((m - exact) ** 2).mean()) for m in (moved, unmoved))
        # 0.04 to 0.11 are left.
        assert left < 0.12 * whole, (left, whole)


def test_steps_that_change_too_much_are_not_taken(fit, monkeypatch):
    point, model = fit.state.point, fit.state.model
    monkeypatch.setattr(larger_steps, "MOST_CHANGE", 1e-9)
    assert with_larger_steps(model, point.log_parameters, point.motion) is model


def test_a_simulation_that_breaks_down_is_no_small_change():
    signals = np.ones((4, 1, 2))
    change = np.full_like(signals, np.nan)
    assert larger_steps.relative_change(change, signals) == np.inf
    assert larger_steps.relative_change(0.01 * signals, signals) == pytest.approx(0.01)
