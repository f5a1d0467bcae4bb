"""`posterior.nc` opened by xarray: layout, units, and the same summary as `result.json`."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
import xarray as xr
from small_results import Words, before_sampling, small_results

from sysid.errors import CampaignError
from sysid.export import result_document, write_posterior
from sysid.results.contents import Judgement


def test_summary_of_the_file_equals_result_json(tmp_path):
    results = small_results()
    write_posterior(results, tmp_path / "posterior.nc")
    with xr.open_dataset(tmp_path / "posterior.nc", group="posterior", engine="h5netcdf") as draws:
        draws = draws.load()
    stated = {p["name"]: p["posterior"] for p in result_document(results)["parameters"] if p["posterior"]}
    assert set(draws.data_vars) == set(stated)
    for name, summary in stated.items():
        assert draws[name].dims == ("chain", "draw")
        assert draws[name].shape == (2, 400)
        assert float(draws[name].mean()) == pytest.approx(summary["mean"], rel=1e-12)
        low, middle, high = draws[name].quantile([0.05, 0.5, 0.95]).values
        assert (low, middle, high) == pytest.approx((summary["q05"], summary["q50"], summary["q95"]), rel=1e-12)
    assert draws["k_1"].attrs["units"] == "N/m"
    assert draws["c_1"].attrs["units"] == "N s/m"
    assert draws["k_1"].attrs["rhat"] == stated["k_1"]["rhat"]
    assert draws["k_1"].attrs["effective_draws"] == stated["k_1"]["ess"]
    assert draws.attrs["status"] == "converged"
    assert draws.attrs["inference_library"] == "emcee"


def test_draws_and_log_probabilities_keep_their_places(tmp_path):
    results = small_results()
    write_posterior(results, tmp_path / "posterior.nc")
    with xr.open_datatree(tmp_path / "posterior.nc", engine="h5netcdf") as tree:
        draws, stats = tree["posterior"].to_dataset().load(), tree["sample_stats"].to_dataset().load()
    # 50 steps of 8 walkers: walker 5 begins its first half at 5 x 25, its second at 8 x 25 + 5 x 25.
    for step, place in ((3, 5 * 25 + 3), (24, 5 * 25 + 24), (25, 8 * 25 + 5 * 25), (49, 8 * 25 + 5 * 25 + 24)):
        assert draws["k_1"].values[1, place] == results.posterior.draws[1, step, 5, 0]
        assert stats["lp"].values[1, place] == results.posterior.log_probability[1, step, 5]
    assert np.array_equal(draws["chain"], [0, 1])
    assert np.array_equal(draws["draw"], np.arange(400))


def test_the_draws_carry_the_verdict(tmp_path):
    write_posterior(replace(small_results(), judgement=Judgement("do_not_bet", ("One.", "Two."))), tmp_path / "p.nc")
    with h5py.File(tmp_path / "p.nc") as file:
        for group in ("posterior", "sample_stats"):
            assert file[group].attrs["verdict"] == "do_not_bet"
            assert list(file[group].attrs["verdict_reasons"]) == ["One.", "Two."]


def test_names_that_hdf5_reserves_are_replaced(tmp_path):
    results = small_results(Words.all("a/b"))
    write_posterior(results, tmp_path / "posterior.nc")
    with xr.open_dataset(tmp_path / "posterior.nc", group="posterior", engine="h5netcdf") as draws:
        assert "k_2[a|b]" in draws.data_vars
        assert draws["k_2[a|b]"].attrs["parameter"] == "k_2[a/b]"


def test_before_sampling_there_is_nothing_to_write(tmp_path):
    with pytest.raises(CampaignError, match="sample"):
        write_posterior(before_sampling(), tmp_path / "posterior.nc")
    assert list(tmp_path.iterdir()) == []
