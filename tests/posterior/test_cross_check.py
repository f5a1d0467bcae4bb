"""The gradient-based sampler on a known normal density, and what the comparison says of right and wrong draws."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.errors import CampaignError
from sysid.estimation.uncertainty.spread import Spread
from sysid.posterior.cross_check import compared, cross_check, gradient_draws
from sysid.posterior.sampled_posterior import Posterior, PosteriorSummary

CENTRE = np.array([13.0, 9.2, 0.2])
COVARIANCE = np.array([[4e-4, 2e-4, 0.0], [2e-4, 9e-4, -1e-4], [0.0, -1e-4, 1e-4]])
PRECISION = np.linalg.inv(COVARIANCE)
NAMES = ("k_1", "c_1", "tire_exponent")


def normal(x: np.ndarray) -> tuple[float, np.ndarray]:
    """Log-density and gradient of the normal distribution of the module's constants."""
    off = x - CENTRE
    return float(-0.5 * off @ PRECISION @ off), -PRECISION @ off


def posterior(mean: np.ndarray = CENTRE, factor: float = 1.0) -> Posterior:
    """Independent draws of a normal distribution in log space, kept in natural units as a posterior keeps them."""
    draws = np.random.default_rng(1).multivariate_normal(mean, factor**2 * COVARIANCE, (2, 500, 4))
    summaries = tuple(PosteriorSummary(n, *[0.0] * 5, 4000.0, 1.0) for n in NAMES)
    return Posterior(
        NAMES, np.exp(draws), np.zeros((2, 500, 4)), 0, 1, np.ones(3), np.ones(2), summaries, True, False, "", "", 0
    )


@pytest.fixture(scope="module")
def draws() -> np.ndarray:
    """Draws by coordinates that are off in place and size, as a Laplace approximation is."""
    found, divergences = gradient_draws(normal, CENTRE + 0.01, 1.5 * COVARIANCE, chains=2, tuning=300, draws=1500)
    assert divergences == 0
    return found


def test_draws_are_those_of_the_density(draws: np.ndarray):
    sd = np.sqrt(np.diag(COVARIANCE))
    flat = draws.reshape(-1, 3)
    assert draws.shape == (2, 1500, 3)
    np.testing.assert_allclose((flat.mean(axis=0) - CENTRE) / sd, 0.0, atol=0.12)
    np.testing.assert_allclose(np.cov(flat.T) / np.outer(sd, sd), COVARIANCE / np.outer(sd, sd), atol=0.12)


def test_the_same_distribution_agrees(draws: np.ndarray):
    found = compared(posterior(), draws)
    assert found.agrees
    assert "agrees within Monte Carlo error" in found.message
    assert list(found.summary()["name"]) == list(NAMES)


def test_what_masses_add_to_draws_is_taken_away_before(draws: np.ndarray):
    spread = Spread(np.array([0.02, 0.0, 0.01]), 4.0 * COVARIANCE)
    plain = posterior()
    added = replace(plain, draws=np.exp(spread.added(np.log(plain.draws), plain.seed, plain.burn_in)))
    assert not compared(added, draws).agrees
    found = compared(added, draws, spread=spread)
    assert found.agrees
    assert [p.shift for p in found.parameters] == pytest.approx([p.shift for p in compared(plain, draws).parameters])


@pytest.mark.parametrize(
    "wrong", [posterior(CENTRE + np.array([0.0, 0.009, 0.0])), posterior(factor=1.25)], ids=["moved", "too wide"]
)
def test_another_distribution_does_not(draws: np.ndarray, wrong: Posterior):
    """A mean 0.3 sd off, or a spread 25 % too wide."""
    found = compared(wrong, draws)
    assert not found.agrees
    assert "disagrees about" in found.message
    assert "c_1" in found.message


def test_a_sampler_that_is_not_installed_is_one_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "nutpie", None)
    with pytest.raises(CampaignError, match="pip install nutpie"):
        cross_check(normal, posterior(), CENTRE, COVARIANCE)


def test_a_first_import_of_the_day_gives_no_warning(tmp_path: Path):
    """ArviZ, which nutpie loads, keeps the day of its last notice in the user's cache: here there is none yet."""
    code = (
        "import numpy as np\n"
        "from sysid.posterior.cross_check import gradient_draws\n"
        "normal = lambda x: (-0.5 * float(x @ x), -x)\n"
        "gradient_draws(normal, np.zeros(1), np.eye(1), chains=1, tuning=20, draws=5)\n"
    )
    fresh = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-W", "error::FutureWarning", "-c", code], env=fresh, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert "FutureWarning" not in done.stderr


def test_draws_that_alternate_raise_no_alarm():
    """Draws that tell the mean far better than the spread, as those of NUTS do: 25 parameters, forty comparisons."""
    random, count = np.random.default_rng(3), 25
    names = tuple(f"p{i}" for i in range(count))
    said = []
    for _ in range(40):
        white = random.standard_normal((2, 251, count))
        # x_t = -0.6 x_{t-1} + ..., unit variance: antithetic for the mean, correlated for the squares.
        draws = lfilter([np.sqrt(1.0 - 0.36)], [1.0, 0.6], white, axis=1)[:, 1:]
        ours = random.standard_normal((4, 30, 10, count))
        summaries = tuple(PosteriorSummary(n, *[0.0] * 5, 1200.0, 1.0) for n in names)
        flat = np.zeros(ours.shape[:3])
        known = Posterior(
            names, np.exp(ours), flat, 0, 1, np.ones(count), np.ones(4), summaries, True, False, "", "", 0
        )
        said.append(compared(known, draws).agrees)
    assert sum(said) >= 38
