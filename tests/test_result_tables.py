"""Results as tables: every one shows itself in a notebook, escaped, and gives its numbers to pandas and xarray."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from small_results import Words, small_results

HOSTILE = "<script>alert(1)</script>"


PLAIN = Words()


def every_result(words: Words = PLAIN):
    results = small_results(words)
    found = {
        "results": results,
        "quality": results.quality,
        "drops": results.drops,
        "drop": results.drops.files[0],
        "scan": results.scans[words.bump],
        "profile": results.scans[words.bump].profile,
        "fit": results.fit,
        "history": results.fit.histories[0],
        "posterior": results.posterior,
        "predictions": results.predictions,
        "pass": results.predictions.passes[0],
        "sweep": results.predictions.sweeps[0],
        "validation": results.validation,
    }
    assert None not in found.values()
    return found


NAMES = tuple(every_result())


@pytest.mark.parametrize("name", NAMES)
def test_every_result_is_a_table(name):
    result = every_result()[name]
    summary, table = result.summary(), result.to_pandas()
    assert isinstance(summary, pd.DataFrame)
    assert len(summary) > 0
    assert len(table) >= len(summary)
    assert result._repr_html_().count("<tr") >= len(summary)


@pytest.mark.parametrize("name", NAMES)
def test_a_result_prints_as_its_table(name):
    text = repr(every_result()[name])
    assert text.startswith(f"{type(every_result()[name]).__name__}\n")
    assert "array(" not in text
    assert text.count("\n") < 60


@pytest.mark.parametrize("name", NAMES)
def test_no_name_of_the_user_becomes_markup(name):
    html = every_result(Words.all(HOSTILE))[name]._repr_html_()
    assert "<script" not in html
    assert HOSTILE not in html


def test_hostile_names_are_shown():
    assert "&lt;script&gt;" in every_result(Words.all(HOSTILE))["quality"]._repr_html_()


def test_profile_in_xarray():
    profile = every_result()["profile"]
    data = profile.to_xarray()
    assert float(data["height_m"].max()) == pytest.approx(0.08, abs=1e-6)
    assert float(data["height_m"].sel(station_m=1.5, method="nearest")) == pytest.approx(0.08, abs=1e-6)


def test_histories_keep_channel_and_time():
    history = every_result()["history"]
    data, table = history.to_xarray(), history.to_pandas()
    assert data["measured"].dims == ("channel", "time_s")
    column = history.columns[1]
    np.testing.assert_array_equal(data["simulated"].sel(channel=column), history.simulated[1])
    np.testing.assert_array_equal(table[f"{column}_measured"], history.measured[1])


def test_pass_in_pandas_and_xarray():
    prediction = every_result()["pass"]
    table, data = prediction.to_pandas(), prediction.to_xarray()
    np.testing.assert_array_equal(table["tire_force2_N_q95"], prediction.tire_force_q95_N[1])
    np.testing.assert_array_equal(data["tire_force_N"].sel(quantile=0.05, axle=1), prediction.tire_force_q05_N[0])
    ratio = (data["tire_force_N"].sel(quantile=0.5) / data["static_load_N"]).max("time_s")
    np.testing.assert_allclose(ratio, 1.8, rtol=1e-3)


def test_sweep_has_a_row_per_speed_and_axle():
    sweep = every_result()["sweep"]
    table = sweep.summary()
    row = table[(table["axle"] == 2) & np.isclose(table["speed_m_s"], 60.0 / 3.6)]
    assert row["peak_ratio_q50"].item() == pytest.approx(1.0 + 60.0 / 3.6 * 0.2)
    assert row["extrapolated"].item()


def test_tables_of_drops_and_fit_hold_every_file_and_run():
    found = every_result()
    drops = found["drops"].to_pandas()
    assert drops["file"].isna().sum() == len(found["drops"].pooled)
    assert set(drops["file"].dropna()) == {f.file for f in found["drops"].files}
    fit = found["fit"].to_pandas()
    assert len(fit) == len(found["fit"].parameters) + len(found["fit"].run_parameters)
    assert {"run", "law"} <= set(fit.columns)
