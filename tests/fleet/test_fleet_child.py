"""The process that calibrates: what it says of a campaign that it cannot read, and of one that it can."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from sysid.fleet.draws import RECORD_FILE, campaign_draws, read_draws
from sysid.fleet.outcome import LOG_FILE
from sysid.fleet.population_prior import PopulationPrior
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, campaign_output, recalibrate, run_fleet
from sysid.fleet.simulate import simulate_fleet

RIGID = Path(__file__).resolve().parents[2] / "examples" / "vehicles" / "rigid3"


def test_a_campaign_that_cannot_be_read_is_rejected_with_its_sentence(tmp_path: Path) -> None:
    (tmp_path / "fleet" / "a").mkdir(parents=True)
    (tmp_path / "fleet" / "a" / "campaign.toml").write_text("schema = 7\n")
    options = RunOptions(1, choices={"quick": True})
    (row,) = run_fleet(read_fleet(tmp_path / "fleet"), tmp_path / "out", options, lambda rows: None)
    assert row.state == "rejected"
    assert row.outcome.sentence.startswith("campaign.toml has schema = 7, this program reads 'schema = 1'")
    assert row.outcome.peak_bytes > 10_000_000
    assert row.outcome.processor_seconds > 0.0
    assert (campaign_output(tmp_path / "out", "a") / LOG_FILE).read_text() == ""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="read from /proc")
def test_the_memory_of_a_process_is_not_that_of_the_one_that_started_it() -> None:
    child = "from sysid.fleet.child import peak_bytes; print(peak_bytes())"
    run_child = f"subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    start = f"import subprocess, sys; held = b'x' * 600_000_000; {run_child}"
    run = subprocess.run([sys.executable, "-c", start], capture_output=True, text=True, check=True)
    assert 5_000_000 < int(run.stdout) < 500_000_000


@pytest.mark.long
def test_a_real_campaign_leaves_its_draws_and_is_not_computed_again(tmp_path: Path) -> None:
    simulate_fleet(RIGID, tmp_path / "fleet", trucks=1, campaigns=1, seed=2)
    fleet = read_fleet(tmp_path / "fleet")
    options = RunOptions(1, choices={"quick": True, "laws": "declared"})
    (row,) = run_fleet(fleet, tmp_path / "out", options, lambda rows: None)
    assert (row.state, row.outcome.status) == ("done", "preview")
    folder = campaign_output(tmp_path / "out", row.campaign)
    record = read_draws(folder / RECORD_FILE)
    assert record is not None
    # An air spring has one stiffness per load case, linked by the prior.
    at = [record.names.index(n) for n in ("k_2[empty]", "k_2[laden]")]
    prior = record.prior_covariance[np.ix_(at, at)]
    assert np.exp(record.prior_mean[at[0]]) == pytest.approx(3.5e5)
    assert np.sqrt(prior[0, 0]) == pytest.approx(0.7)
    assert prior[0, 1] == pytest.approx(prior[0, 0])
    assert prior[1, 1] > prior[0, 0]
    written = (folder / "result.json").stat().st_mtime_ns
    (again,) = run_fleet(fleet, tmp_path / "out", options, lambda rows: None)
    assert again.outcome == row.outcome
    assert (folder / "result.json").stat().st_mtime_ns == written


@pytest.mark.long
def test_a_real_campaign_is_sampled_again_under_its_population(tmp_path: Path) -> None:
    simulate_fleet(RIGID, tmp_path / "fleet", trucks=1, campaigns=1, seed=2)
    fleet = read_fleet(tmp_path / "fleet")
    options = RunOptions(1, choices={"laws": "declared"})
    (row,) = run_fleet(fleet, tmp_path / "out", options, lambda rows: None)
    folder = campaign_output(tmp_path / "out", row.campaign)
    own = campaign_draws(folder)
    names, kept = ("k_1", "c_2"), (folder / "result.json").read_bytes()
    at = [own.names.index(n) for n in names]
    centre, sd = own.draws[:, at].mean(axis=0), own.draws[:, at].std(axis=0)
    # Half a standard deviation away and as wide as the campaign's posterior: both up, as one scale moves both.
    prior = PopulationPrior(names, centre + 0.5 * sd, np.diag(sd**2))
    (again,) = recalibrate(fleet, tmp_path / "out", {row.campaign: prior}, RunOptions(1), lambda rows: None)
    assert again.state == "done", again.outcome.sentence
    drawn = campaign_draws(folder)
    assert drawn.prior_mean[at] == pytest.approx(prior.mean)
    assert (folder / "result.json").read_bytes() == kept
    # The former draws, weighted by the ratio of the priors.
    old = multivariate_normal(own.prior_mean[at], own.prior_covariance[np.ix_(at, at)])
    new, shared = multivariate_normal(prior.mean, prior.covariance), own.draws[:, at]
    weights = np.exp(new.logpdf(shared) - old.logpdf(shared))
    weights /= weights.sum()
    assert 1.0 / (weights**2).sum() > 300.0
    expected = weights @ own.draws
    spread = np.sqrt(weights @ (own.draws - expected) ** 2)
    assert np.abs((drawn.draws.mean(axis=0) - expected) / spread).max() < 0.2
    assert np.abs(drawn.draws.std(axis=0) / spread - 1.0).max() < 0.15
    # Without the prior of the population it would not be so.
    assert np.abs((own.draws.mean(axis=0) - expected) / spread).max() > 0.2
