"""Least squares on the linear truck against the truth that was used to make it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from sysid.estimation.fit.fit_result import FitResult
from sysid.workflow import Calibration

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> FitResult:
    """The default least-squares stage on all ten runs."""
    return Calibration(DATA, tmp_path_factory.mktemp("fit")).fit()


@pytest.fixture(scope="module")
def truth() -> list[dict[str, float]]:
    """True values per axle."""
    with (DATA / "truth.toml").open("rb") as handle:
        return tomllib.load(handle)["axle"]


def errors(fit: FitResult, truth: list[dict[str, float]], quantity: str) -> dict[str, float]:
    """Relative error of every entry of a quantity."""
    key = {"stiffness": "suspension_stiffness_N_per_m", "damping": "suspension_damping_N_s_per_m"}[quantity]
    return {
        p.name: p.value / truth[p.axle][key] - 1.0
        for p in fit.parameters
        if p.quantity == quantity and p.axle is not None
    }


def test_least_squares_converges_and_an_independent_solver_agrees(fit: FitResult) -> None:
    assert fit.converged
    assert fit.scipy_max_difference_sd < 0.1


def test_stiffness_is_within_2_percent_on_every_axle(fit: FitResult, truth) -> None:
    found = errors(fit, truth, "stiffness")
    assert len(found) == 8
    # 0.6 % was found.
    assert np.abs(list(found.values())).max() < 0.02


def test_damping_is_within_3_percent_on_every_axle(fit: FitResult, truth) -> None:
    found = errors(fit, truth, "damping")
    assert len(found) == 6
    # 0.5 % was found.
    assert np.abs(list(found.values())).max() < 0.03


def test_intervals_hold_the_truth(fit: FitResult, truth) -> None:
    """Of 14 independent 90 % intervals 12 or more hold in 84 % of campaigns; here one error moves many."""
    off = errors(fit, truth, "stiffness") | errors(fit, truth, "damping")
    sd = {p.name: p.sd / p.value for p in fit.parameters}
    assert sum(abs(np.log1p(error)) < 1.645 * sd[name] for name, error in off.items()) >= 12
    # Nor are they so wide that they would hold anything: half-widths of 2.4 to 10 % were found.
    assert max(sd[name] for name in off) < 0.1


def test_speeds_are_found_to_a_thousandth(fit: FitResult) -> None:
    with (DATA / "truth.toml").open("rb") as handle:
        runs = tomllib.load(handle)["bump_run"]
    true = {run["file"]: run["true_speed_m_s"] for run in runs}
    first, change = (
        {p.run: p.value for p in fit.run_parameters if p.quantity == quantity} for quantity in ("speed", "speed_change")
    )
    # The truth is the mean over the record, the parameters speak of the passage of the first and the last axle.
    mean = {file: first[file] * (1.0 + 0.5 * change[file]) for file in true}
    assert max(abs(mean[file] / speed - 1.0) for file, speed in true.items()) < 0.001


def test_speeds_that_drift_are_seen_to(fit: FitResult) -> None:
    """The servo lets the speed drift by up to half a per cent over the record, about half of it over the bump."""
    with (DATA / "truth.toml").open("rb") as handle:
        drift = {run["file"]: run["relative_speed_change_over_run"] for run in tomllib.load(handle)["bump_run"]}
    found = {p.run: p.value for p in fit.run_parameters if p.quantity == "speed_change"}
    assert np.corrcoef([found[f] for f in drift], list(drift.values()))[0, 1] > 0.96  # 0.969 was found


def test_start_values_alone_would_fail(fit: FitResult, truth) -> None:
    start = {p.name: p.start / truth[p.axle]["suspension_stiffness_N_per_m"] - 1.0
             for p in fit.parameters if p.quantity == "stiffness" and p.axle is not None}  # fmt: skip
    assert np.abs(list(start.values())).max() > 0.05
