"""Self-test of a campaign: estimates without noise, statistics with noise, counts of intervals whose law is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2

from studies.coverage.bump import bump, plan
from sysid.errors import CampaignError, DataRejectedError
from sysid.selftest import Check, Replicate, SelfTest, self_test
from sysid.selftest import replicates as module
from sysid.selftest.readings import Instruments, as_logged, blank_run, draw_motion, with_usable_channels

PROFILES = {"bump": bump()}
COUNT = 6


@pytest.fixture(scope="module")
def found() -> SelfTest:
    """Six simulated campaigns of a two-axle truck."""
    return self_test(plan(), PROFILES, COUNT, seed=3)


def test_data_narrow_every_parameter_and_intervals_hold_as_often_as_they_promise(found: SelfTest) -> None:
    assert found.converged
    assert found.intervals == 4 * COUNT
    assert [c.name for c in found.replicates[0].checks] == ["k_1", "k_2", "c_1", "c_2"]
    for replicate in found.replicates:
        assert all(c.sd < 0.5 * c.prior_sd for c in replicate.checks)
    tail = 0.0005
    assert binom.ppf(tail, 4 * COUNT, 0.9) <= found.held <= binom.isf(tail, 4 * COUNT, 0.9)


def test_errors_have_the_size_that_their_covariance_says(found: SelfTest) -> None:
    total = 0.0
    for replicate in found.replicates:
        error = np.log([c.value / c.truth for c in replicate.checks])
        assert np.abs(error).max() > 1e-5
        total += error @ np.linalg.solve(replicate.covariance, error)
    # Intervals that allow for model error are a little wide: only the upper end is sharp.
    assert 0.2 * chi2.ppf(0.001, 4 * COUNT) < total < chi2.isf(0.001, 4 * COUNT)


def test_truths_differ_between_replicates_and_repeat_with_the_seed(found: SelfTest) -> None:
    truths = [r.checks[0].truth for r in found.replicates]
    assert len(set(truths)) == COUNT
    (again,) = self_test(plan(), PROFILES, 1, seed=3).replicates
    assert again.checks == found.replicates[0].checks


def test_without_noise_the_estimates_are_the_truth() -> None:
    silent = {c.sensor.column: 0.0 for c in plan().bump_runs[0].log.channels}
    perfect = Instruments(silent, gain_spread=0.0)
    (replicate,) = self_test(plan(), PROFILES, 1, seed=1, instruments=perfect).replicates
    for c in replicate.checks:
        assert c.value == pytest.approx(c.truth, rel=5e-3)
        assert c.truth != pytest.approx({"k_1": 4.2e5, "k_2": 7.0e5, "c_1": 1e4, "c_2": 1.4e4}[c.name], rel=2e-2)


def test_an_interval_ends_at_the_five_percent_points_of_the_normal() -> None:
    check = Check("k_1", "N/m", 1.0, 1.0, 0.8, 0.1)
    assert replace(check, value=np.exp(0.1644)).held
    assert not replace(check, value=np.exp(0.1646)).held
    assert not replace(check, value=np.exp(-0.1646)).held


def test_the_expected_count_is_binomial_where_errors_are_independent() -> None:
    random = np.random.default_rng(0)
    checks = (Check("k_1", "N/m", 1.0, 1.0, 0.8, 0.1),) * 14
    mean, low, high = Replicate(checks, np.diag(np.linspace(0.1, 2.0, 14)), True).expected(random)
    assert mean == pytest.approx(12.6)
    assert (low, high) == (binom.ppf(0.025, 14, 0.9), binom.ppf(0.975, 14, 0.9))
    # Errors that are all the same hold together or not at all.
    common = np.ones((14, 14)) + 1e-6 * np.eye(14)
    assert Replicate(checks, common, True).expected(random)[1:] == (0, 14)


def test_pooled_counts_are_those_of_all_campaigns() -> None:
    good, bad = (Check("k_1", "N/m", 1.0, value, 0.8, 0.1) for value in (1.0, 2.0))
    one = Replicate((good, bad), np.eye(2), True)
    test = SelfTest((one,) * 50, (), 0)
    assert (test.held, test.intervals) == (50, 100)
    assert test.binomial_range() == (84, 95)
    assert test.converged
    assert not replace(test, failures=("no start",)).converged


def test_records_are_as_long_as_the_logs() -> None:
    for before, after in zip(plan().bump_runs, as_logged(plan(), PROFILES).bump_runs, strict=True):
        assert [c.sensor for c in after.log.channels] == [c.sensor for c in before.log.channels]
        np.testing.assert_allclose(after.log.channels[0].time_s, before.log.channels[0].time_s)


def test_channels_that_the_check_rejects_are_not_simulated() -> None:
    """A log with one dead sensor; one of zeros, which says nothing; one that is still to come."""
    data, random = plan(), np.random.default_rng(1)
    first = data.bump_runs[0]

    def shown(k, channel):
        time = channel.time_s
        moving = np.exp(-(((time - 1.2 - 0.3 * k) / 0.2) ** 2)) * np.sin(2.0 * np.pi * 10.0 * time)
        size = 0.02 if channel.sensor.kind == "suspension_deflection" else 20.0
        return replace(channel, value=size * (moving + 1e-3 * random.normal(size=time.size)))

    channels = tuple(shown(k, c) for k, c in enumerate(first.log.channels))
    dead = replace(channels[2], value=np.full(channels[2].time_s.size, 0.5))
    broken = replace(first, log=replace(first.log, channels=(*channels[:2], dead, *channels[3:])))
    point = np.zeros(1)
    to_come = tuple(replace(c, time_s=point, value=point, censored=np.zeros(1, np.int8)) for c in channels)
    planned = replace(first, log=replace(first.log, file="to come.csv", channels=to_come))
    found, silent = with_usable_channels(replace(data, bump_runs=(broken, data.bump_runs[1], planned)))
    columns = [[c.sensor.column for c in run.log.channels] for run in found.bump_runs]
    every = [c.sensor.column for c in channels]
    assert columns == [[c for c in every if c != dead.sensor.column], every, every]
    assert silent == (data.bump_runs[1].log.file,)


def test_passages_lie_inside_short_records() -> None:
    data, random = plan(), np.random.default_rng(1)
    for seconds in (2.8, 1.4, 0.8):
        runs = [blank_run(r, tuple(c.sensor for c in r.log.channels), seconds, 0.005) for r in data.bump_runs]
        motion = draw_motion(replace(data, bump_runs=tuple(runs)), PROFILES, random)
        assert (motion.start_s > 0.0).all()
        # 3.8 m between the axles, a bump of about 0.6 m.
        through = motion.start_s + 4.4 / motion.speed_m_s
        assert (through[1:] < seconds).all()
        assert seconds < 1.0 or (through < seconds).all()


def test_speeds_change_as_their_priors_say() -> None:
    data, random = plan(), np.random.default_rng(2)
    spread = (0.03, 0.0, 0.1)
    runs = tuple(replace(data.bump_runs[0], speed_change_sd=spread[k % 3]) for k in range(3000))
    motion = draw_motion(replace(data, bump_runs=runs), PROFILES, random)
    assert (motion.speed_change[1::3] == 0.0).all()
    for k in (0, 2):
        drawn = motion.speed_change[k::3] / spread[k]
        # A normal one that stops at two standard deviations has a standard deviation of 0.96.
        assert drawn.std() == pytest.approx(0.96, abs=0.07)
        assert drawn.mean() == pytest.approx(0.0, abs=0.12)
        assert np.abs(drawn).max() == 2.0


def test_the_truth_rolls_by_the_contact_law_of_the_fit(monkeypatch) -> None:
    laws = []

    def world(*given):
        laws.extend(given[4:])
        raise DataRejectedError("seen.")

    monkeypatch.setattr(module, "draw_world", world)
    with pytest.raises(DataRejectedError, match="seen"):
        self_test(plan(), PROFILES, 1, options=replace(module.OPTIONS, contact="cams"))
    assert laws == ["cams"]


def test_a_campaign_without_runs_is_refused_in_one_sentence() -> None:
    with pytest.raises(CampaignError, match="no bump run to simulate"):
        self_test(replace(plan(), bump_runs=()), PROFILES)


def test_a_campaign_that_cannot_be_calibrated_is_said_and_all_such_are_an_error(monkeypatch) -> None:
    real, calls = module.fit_bump_runs, []

    def fit(*given):
        calls.append(given)
        if len(calls) != 2:
            raise DataRejectedError("no start found.")
        return real(*given)

    monkeypatch.setattr(module, "fit_bump_runs", fit)
    some = self_test(plan(), PROFILES, 2, seed=3)
    assert (len(some.replicates), some.failures, some.converged) == (1, ("no start found.",), False)
    with pytest.raises(DataRejectedError, match="No simulated campaign could be calibrated: no start found"):
        self_test(plan(), PROFILES, 1)


def test_stopped_least_squares_is_not_called_converged() -> None:
    assert not self_test(plan(), PROFILES, 1, options=replace(module.OPTIONS, max_iterations=1)).converged
