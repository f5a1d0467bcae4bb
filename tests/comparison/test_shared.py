"""When campaigns contradict each other about errors that both share: linear data, priors of unlike width."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sysid.comparison.shared import _not_apart

PRIOR_SD = np.array([0.08, 0.08, 0.005, 0.005, 0.25, 0.1])
#: The second campaign found that its tires hardly depart: a prior of a thousandth.
NARROW = np.array([1.0, 1e-3, 1.0, 1e-3, 1e-3, 1e-3])
KINDS = ("envelope", "spokes")


def campaign(random: np.random.Generator, truth: np.ndarray, own_sd: np.ndarray) -> SimpleNamespace:
    """What linear data say of errors (s,) with a campaign's own prior: of some combinations next to nothing."""
    count = truth.size
    rows = random.normal(size=(40, count)) * 10.0 ** random.uniform(-3.0, 2.0, count) / PRIOR_SD
    data = rows @ truth + random.normal(size=40)
    covariance = np.linalg.inv(rows.T @ rows + np.diag(own_sd**-2.0))
    estimate = covariance @ rows.T @ data / own_sd
    return SimpleNamespace(
        errors=[SimpleNamespace(kind=KINDS[k % 2], sd=own_sd[k], estimate=estimate[k]) for k in range(count)],
        error_covariance=covariance / np.outer(own_sd, own_sd),
    )


@pytest.fixture(scope="module")
def contradictions() -> dict[str, int]:
    """Of 300 pairs, how many contradict each other: one truck; two trucks; estimates that are not at their optimum."""
    random, found = np.random.default_rng(20), {"one": 0, "two": 0, "ended before": 0}
    pairs = [(k, k) for k in range(PRIOR_SD.size)]
    for _ in range(300):
        truth, other = PRIOR_SD * random.normal(size=(2, PRIOR_SD.size))
        first, second = campaign(random, truth, PRIOR_SD), campaign(random, truth, NARROW * PRIOR_SD)
        elsewhere = campaign(random, other, NARROW * PRIOR_SD)
        found["one"] += not _not_apart(first, second, pairs, [])
        found["two"] += not _not_apart(first, elsewhere, pairs, [])
        for error in second.errors:
            error.estimate += 0.1
        found["ended before"] += not _not_apart(first, second, pairs, [])
    return found


def test_one_truck_contradicts_itself_as_rarely_as_is_said(contradictions) -> None:
    """Of 300 at one in a thousand, 0.3; four or more would happen once in 4,000 times."""
    assert contradictions["one"] <= 3


def test_two_trucks_do(contradictions) -> None:
    assert contradictions["two"] > 200


def test_estimates_must_belong_to_their_covariance(contradictions) -> None:
    """A tenth of a narrow prior is nothing in itself; beside what such data could say it is a lot."""
    assert contradictions["ended before"] > 30
