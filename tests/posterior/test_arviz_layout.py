"""What ArviZ reads off the exported draws: the R-hat of the run, and effective draws known in closed form."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest
import xarray as xr
from arviz_stats.base import array_stats

from sysid.posterior.diagnostics import diagnose, summarise
from sysid.posterior.inference_data import arviz_data, draw_order
from sysid.posterior.sampled_posterior import Posterior

ENSEMBLES, STEPS, WALKERS, PHI = 4, 1501, 20, 0.8


@pytest.fixture(scope="module")
def autoregressive() -> Posterior:
    """Walkers that are independent AR(1) processes, the first parameter's mean drifting in one ensemble."""
    rng = np.random.default_rng(5)
    draws = np.empty((ENSEMBLES, STEPS, WALKERS, 2))
    draws[:, 0] = rng.normal(size=(ENSEMBLES, WALKERS, 2))
    for step in range(1, STEPS):
        draws[:, step] = PHI * draws[:, step - 1] + np.sqrt(1 - PHI**2) * rng.normal(size=(ENSEMBLES, WALKERS, 2))
    draws[0, :, :, 0] += np.linspace(-0.6, 0.6, STEPS)[:, None]
    draws += 10.0
    diagnosis = diagnose(draws)
    names = ("drifting", "steady")
    summaries = summarise(names, draws.reshape(-1, 2), diagnosis)
    return Posterior(
        names, draws, draws[..., 0], 0, 1, diagnosis.autocorrelation_time, np.ones(ENSEMBLES), summaries, True, False,
        "", "", 5,
    )  # fmt: skip


def rhat(chains: np.ndarray) -> float:
    return float(array_stats.rhat(chains, chain_axis=0, draw_axis=1))


def test_order_is_a_permutation_by_half_walker_and_step():
    order = draw_order(5, 4)
    assert sorted(order) == list(range(20))
    # Steps 0 and 1 and the first two walkers of step 2 are the first half.
    assert set(order[:10]) == set(range(10))
    assert list(order[:3] // 4) == [0, 1, 2]
    assert list(order[:3] % 4) == [0, 0, 0]


def test_effective_draws_of_a_known_process(autoregressive):
    chains = autoregressive.to_xarray()["steady"].values
    known = ENSEMBLES * STEPS * WALKERS * (1 - PHI) / (1 + PHI)
    found = float(array_stats.ess(chains, chain_axis=0, draw_axis=1, method="mean"))
    assert found == pytest.approx(known, rel=0.1)
    assert autoregressive.summaries[1].ess == pytest.approx(known, rel=0.2)
    # Step after step over all walkers hides the correlation: every draw would count.
    plain = autoregressive.draws[..., 1].reshape(ENSEMBLES, -1)
    assert float(array_stats.ess(plain, chain_axis=0, draw_axis=1, method="mean")) > 4.0 * known


def test_rhat_compares_ensembles_and_early_with_late_steps(autoregressive):
    data = autoregressive.to_xarray()
    for index, name in enumerate(autoregressive.names):
        plain = autoregressive.draws[..., index].reshape(ENSEMBLES, -1)
        assert rhat(data[name].values) == pytest.approx(rhat(plain), rel=1e-12)
    assert rhat(data["drifting"].values) > 1.005
    assert rhat(data["steady"].values) < 1.002


def test_every_way_out_holds_the_same_draws(autoregressive):
    table, data = autoregressive.to_pandas(), autoregressive.to_xarray()
    assert list(table.columns) == ["ensemble", "step", "walker", "drifting", "steady"]
    row = table[(table.ensemble == 2) & (table.step == 7) & (table.walker == 3)]
    assert row["steady"].item() == autoregressive.draws[2, 7, 3, 1]
    for ensemble in range(ENSEMBLES):
        own = table.loc[table.ensemble == ensemble, "drifting"]
        np.testing.assert_array_equal(np.sort(own), np.sort(data["drifting"].values[ensemble]))


def test_arviz_gets_what_its_version_works_with(autoregressive, monkeypatch):
    class InferenceData:
        def __init__(self, **groups):
            self.groups = groups

    monkeypatch.setitem(sys.modules, "arviz", types.SimpleNamespace(InferenceData=InferenceData))
    older = arviz_data(autoregressive)
    assert isinstance(older, InferenceData)
    assert set(older.groups) == {"posterior", "sample_stats"}
    monkeypatch.setitem(sys.modules, "arviz", types.SimpleNamespace(InferenceData=xr.DataTree))
    newer = autoregressive.to_arviz()
    assert isinstance(newer, xr.DataTree)
    assert newer["posterior"]["steady"].dims == ("chain", "draw")
    monkeypatch.setitem(sys.modules, "arviz", None)
    assert isinstance(autoregressive.to_arviz(), xr.DataTree)
