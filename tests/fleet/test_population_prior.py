"""A campaign under the prior of its population: closed forms, and draws that did not reach it before."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleet_child import COMMAND, DIGEST
from scipy.stats import multivariate_normal

from sysid.fleet import key
from sysid.fleet.child import recalibrate as recalibrate_one
from sysid.fleet.draws import (
    POPULATION_RECORD_FILE,
    RECORD_FILE,
    CampaignDraws,
    campaign_draws,
    record_digest,
    write_draws,
)
from sysid.fleet.hierarchy import TypeData
from sysid.fleet.key import file_digests
from sysid.fleet.likelihood import likelihood_of
from sysid.fleet.outcome import Outcome, read_outcome, write_outcome
from sysid.fleet.population import TypePopulation, fit_population
from sysid.fleet.population_prior import ExchangedPrior, Fitted, PopulationPrior, exchange, prior_of_others
from sysid.fleet.read import read_fleet
from sysid.fleet.running import RunOptions, recalibrate, run_fleet
from sysid.posterior.options import SamplingOptions

NAMES = ("k_1", "k_2", "c_1", "c_2", "kt_1")
SHORT = SamplingOptions(
    ensembles=4, segment_steps=100, adapting_steps=0, min_steps=200, max_steps=2000, min_effective=400.0
)
#: A campaign's own prior, correlated as that of two load cases of one spring.
PRIOR = np.diag([0.5, 0.5, 0.7, 0.7, 0.1]) ** 2
PRIOR[0, 1] = PRIOR[1, 0] = 0.2


def record(
    random: np.random.Generator, likelihood: np.ndarray, value: np.ndarray, mean: np.ndarray, prior: np.ndarray
) -> CampaignDraws:
    """Draws under the prior N(mean, prior) of a campaign with the Gaussian likelihood N(value, likelihood)."""
    whole = np.linalg.inv(np.linalg.inv(prior) + np.linalg.inv(likelihood))
    centre = whole @ (np.linalg.solve(prior, mean) + np.linalg.solve(likelihood, value))
    draws = random.multivariate_normal(centre, whole, 1000)
    kinds = ("stiffness", "stiffness", "damping", "damping", "tire_stiffness")
    return CampaignDraws(NAMES, kinds, ("1",) * 5, (0, 1, 0, 1, 0), ("",) * 5, ("linear",) * 5, draws, mean, prior)


def full_covariance(seed: int, d: int, scale: float) -> np.ndarray:
    a = np.random.default_rng(seed).standard_normal((d, d + 2)) * scale
    return a @ a.T / d


def test_exchanging_a_prior_is_exact_for_gaussians() -> None:
    mean, new = (
        np.array([0.1, -0.2, 0.3, 0.0, 0.5]),
        PopulationPrior(("c_1", "k_2"), np.array([0.2, 0.4]), full_covariance(1, 2, 0.1)),
    )
    likelihood, value = full_covariance(2, 5, 0.6), np.array([0.5, 0.1, -0.3, 0.2, 0.4])
    one = record(np.random.default_rng(0), likelihood, value, mean, PRIOR)
    exchanged = exchange(one, new)
    assert exchanged.at.tolist() == [2, 1]
    prior_mean, prior = exchanged.gaussian(mean, PRIOR)
    # Of the parameters concerned the prior is that of the population; given them, the others are as before.
    at, rest = [2, 1], [0, 3, 4]
    assert prior_mean[at] == pytest.approx(new.mean)
    assert prior[np.ix_(at, at)] == pytest.approx(new.covariance)
    for covariance in (prior, PRIOR):
        slope = covariance[np.ix_(rest, at)] @ np.linalg.inv(covariance[np.ix_(at, at)])
        given = covariance[np.ix_(rest, rest)] - slope @ covariance[np.ix_(at, rest)]
        if covariance is prior:
            found = slope, given
    assert found[0] == pytest.approx(slope)
    assert found[1] == pytest.approx(given)
    # The posterior: the same likelihood under that prior, written out.
    posterior = np.linalg.inv(np.linalg.inv(PRIOR) + np.linalg.inv(likelihood))
    centre = posterior @ (np.linalg.solve(PRIOR, mean) + np.linalg.solve(likelihood, value))
    expected = np.linalg.inv(np.linalg.inv(prior) + np.linalg.inv(likelihood))
    found_mean, found_covariance = exchanged.gaussian(centre, posterior)
    assert found_covariance == pytest.approx(expected)
    assert found_mean == pytest.approx(
        expected @ (np.linalg.solve(prior, prior_mean) + np.linalg.solve(likelihood, value))
    )
    # What is sampled: the posterior's density, and its Gaussian, under that prior.
    density, x_mean, x_covariance = exchanged.sampled(
        Fitted(multivariate_normal(centre, posterior).logpdf, centre, posterior)
    )
    points = np.random.default_rng(3).standard_normal((20, 5))
    off = density(points) - multivariate_normal(found_mean, expected).logpdf(points)
    assert np.ptp(off) < 1e-6 * np.ptp(density(points))
    assert x_mean == pytest.approx(found_mean)
    assert x_covariance == pytest.approx(expected)


def test_a_posterior_wider_than_its_prior_is_no_negative_information() -> None:
    exchanged = ExchangedPrior(np.array([0]), (np.zeros(1), np.eye(1)), (np.ones(1), 0.01 * np.eye(1)))
    mean, covariance = exchanged.gaussian(np.zeros(1), 1.2 * np.eye(1))
    assert mean == pytest.approx([1.0])
    assert covariance == pytest.approx(0.01 * np.eye(1))
    # Wherever the numbers lie, in N/m or in kN/m.
    far = ExchangedPrior(np.array([0]), (np.full(1, 13.0), np.eye(1)), (np.full(1, 14.0), 0.01 * np.eye(1)))
    assert far.gaussian(np.full(1, 13.0), 1.2 * np.eye(1))[0] == pytest.approx([14.0])


def test_the_prior_of_others_is_their_mixture_twice_as_wide() -> None:
    random = np.random.default_rng(5)
    mean, covariance = random.standard_normal((400, 2)), np.array([full_covariance(s, 2, 0.3) for s in range(400)])
    prior = prior_of_others(("k_1", "c_1"), mean, covariance)
    drawn = np.concatenate([random.multivariate_normal(m, c, 100) for m, c in zip(mean, covariance, strict=True)])
    assert prior.mean == pytest.approx(drawn.mean(axis=0), abs=0.02)
    assert prior.covariance == pytest.approx(4.0 * np.cov(drawn.T), rel=0.05, abs=0.05)
    back = PopulationPrior.from_dict(json.loads(json.dumps(prior.as_dict())))
    assert back.names == prior.names
    assert np.array_equal(back.covariance, prior.covariance)


def narrow_fleet(random: np.random.Generator, records: list[CampaignDraws]) -> TypePopulation:
    """The population of trucks that are alike within 3 %, and of the given campaigns as the last ones."""
    names, d = NAMES[:4], 4
    trucks = 12
    covariance = np.diag([0.02, 0.02, 0.03, 0.03]) ** 2
    value = 0.03 * random.standard_normal((trucks, d))
    parts = [likelihood_of(r.of(names)) for r in records]
    precision = np.array([*[np.linalg.inv(covariance)] * trucks, *[p.precision for p in parts]])
    shift = np.array([*[np.linalg.solve(covariance, v) for v in value], *[p.shift for p in parts]])
    labels = tuple(f"T{t}" for t in range(trucks + len(records)))
    data = TypeData(
        names,
        ("stiffness",) * 2 + ("damping",) * 2,
        labels,
        labels,
        np.arange(len(labels)),
        precision,
        shift,
        np.zeros(d),
    )
    of_names = [None] * trucks + [r.of(names) for r in records]
    return fit_population("t", data, ("1",) * d, of_names, sampling=SHORT)


def test_draws_under_the_population_reach_it() -> None:
    random = np.random.default_rng(8)
    # Two runs that tell little: posteriors ten times as wide as the population.
    likelihood, value = np.diag([0.6, 0.6, 0.6, 0.6, 0.1]) ** 2, np.array([0.4, -0.4, 0.4, -0.4, 0.0])
    before = record(random, likelihood, value, np.zeros(5), PRIOR)
    found = narrow_fleet(random, [before])
    assert found.pareto_k[-1] > 0.7
    assert list(found.of_others) == ["T12"]
    assert "fleet recalibrate" in " ".join(found.remarks)
    prior_mean, prior = exchange(before, found.of_others["T12"]).gaussian(before.prior_mean, before.prior_covariance)
    after = record(random, likelihood, value, prior_mean, prior)
    again = narrow_fleet(np.random.default_rng(8), [after])
    assert again.pareto_k[-1] < 0.5
    assert again.of_others == {}


def test_draws_under_the_population_are_taken_for_their_own_record_only(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    own = record(random, 0.01 * np.eye(5), np.zeros(5), np.zeros(5), PRIOR)
    other = replace(own, draws=own.draws + 1.0)
    assert campaign_draws(tmp_path) is None
    write_draws(tmp_path / RECORD_FILE, own)
    write_draws(tmp_path / POPULATION_RECORD_FILE, other, record_digest(tmp_path))
    assert np.array_equal(campaign_draws(tmp_path).draws, other.draws)
    # Calibrated anew: what was drawn from the former posterior no longer counts.
    write_draws(tmp_path / RECORD_FILE, replace(own, draws=own.draws + 2.0))
    assert np.array_equal(campaign_draws(tmp_path).draws, own.draws + 2.0)
    write_draws(tmp_path / POPULATION_RECORD_FILE, other, record_digest(tmp_path))
    content = bytearray((tmp_path / POPULATION_RECORD_FILE).read_bytes())
    content[len(content) // 2] ^= 1
    (tmp_path / POPULATION_RECORD_FILE).write_bytes(content)
    assert np.array_equal(campaign_draws(tmp_path).draws, own.draws + 2.0)


def test_campaigns_are_sampled_again_and_their_outcomes_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key, "program_digest", lambda: DIGEST)
    for name in "ab":
        (tmp_path / "fleet" / name).mkdir(parents=True)
        (tmp_path / "fleet" / name / "campaign.toml").write_text(f'title = "{name}"\n')
        (tmp_path / "fleet" / name / "behaviour").write_text("done")
    fleet, output, options = read_fleet(tmp_path / "fleet"), tmp_path / "out", RunOptions(2, command=COMMAND)
    run_fleet(fleet, output, options, lambda rows: None)
    before = read_outcome(output / "campaigns" / "b")
    prior = PopulationPrior(("k_1",), np.zeros(1), np.eye(1))
    (row,) = recalibrate(fleet, output, {"b": prior}, options, lambda rows: None)
    assert (row.campaign, row.state) == ("b", "done")
    assert json.loads((output / "campaigns/b/prior.json").read_text()) == prior.as_dict()
    assert not (output / "campaigns/a/prior.json").exists()
    assert read_outcome(output / "campaigns" / "b") == before


def test_a_campaign_without_draws_is_refused_in_a_sentence(tmp_path: Path) -> None:
    prior = PopulationPrior(("k_1",), np.zeros(1), np.eye(1)).as_dict()
    outcome = recalibrate_one(tmp_path, tmp_path / "out", prior, lambda message, fraction: None)
    assert (outcome.state, outcome.sentence) == ("rejected", "The campaign has no draws; run the fleet first.")


def test_a_campaign_that_has_changed_is_not_sampled_again(tmp_path: Path) -> None:
    (tmp_path / "campaign.toml").write_text("schema = 1\n")
    inputs = file_digests(tmp_path, ["campaign.toml"])
    output = tmp_path / "out"
    write_outcome(output, Outcome("done", status="converged", inputs=inputs))
    own = record(np.random.default_rng(1), 0.01 * np.eye(5), np.zeros(5), np.zeros(5), PRIOR)
    write_draws(output / RECORD_FILE, own)
    (tmp_path / "campaign.toml").write_text("schema = 1 # corrected\n")
    prior = PopulationPrior(("k_1",), np.zeros(1), np.eye(1)).as_dict()
    outcome = recalibrate_one(tmp_path, output, prior, lambda message, fraction: None)
    assert outcome.state == "rejected"
    assert "has changed since it was calibrated" in outcome.sentence
