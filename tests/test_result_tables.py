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


def test_what_is_shown_is_in_the_units_of_the_trade_and_the_summary_in_si():
    found = every_result()
    fit = found["fit"].shown().set_index("name")
    assert dict(fit.loc["k_1", ["unit", "value", "sd", "prior_sd"]]) == {
        "unit": "kN/m", "value": 420.0, "sd": 4.2, "prior_sd": 0.4
    }  # fmt: skip
    assert found["fit"].summary().set_index("name").loc["k_1", "value"] == 420e3
    assert found["posterior"].shown().set_index("name").loc["c_1", "unit"] == "kN s/m"
    draws = found["posterior"].to_pandas()["c_1"]
    assert found["posterior"].shown().set_index("name").loc["c_1", "mean"] == pytest.approx(draws.mean() / 1e3)
    drops = found["drops"].shown()
    assert list(drops.loc[0, ["stiffness [kN/m]", "damping [kN s/m]", "damped_period"]]) == [300.0, 7.0, 0.6]
    passed = found["pass"].shown()
    assert list(passed["speed [km/h]"]) == pytest.approx([48.0, 48.0])
    # 1.8 of 4000 kg and 3.6 of 3000 kg.
    assert list(passed["peak_load_q50 [kN]"]) == pytest.approx([1.8 * 4 * 9.81, 3.6 * 3 * 9.81])
    history = found["history"].shown()
    assert list(history["unit"]) == ["mm", "mm", "m/s\u00b2"]
    assert list(history["noise_sd"]) == pytest.approx([1.0, 1.0, 0.001])
    assert found["scan"].shown()["height [mm]"][0] == pytest.approx(80.0)
    assert found["quality"].shown()["noise_rms"][0] == pytest.approx(0.3)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_but_a_known_unit_changes_a_number(name):
    """Every shown number is that of the summary times the factor of the unit that stands beside it."""
    factors = {"kN/m": 1e-3, "kN s/m": 1e-3, "kN": 1e-3, "mm": 1e3, "km/h": 3.6}
    result = every_result()[name]
    summary, shown = result.summary(), result.shown()
    kept = [c for c in shown if c != "unit"]
    assert len(kept) == len([c for c in summary if c != "unit"])
    for before, after in zip([c for c in summary if c != "unit"], kept, strict=True):
        if not pd.api.types.is_numeric_dtype(shown[after]) or shown[after].dtype == bool:
            continue
        ratio = pd.to_numeric(shown[after]) / pd.to_numeric(summary[before])
        of_column = after.rpartition("[")[2].rstrip("]") if "[" in after else None
        of_rows = shown["unit"] if "unit" in shown and of_column is None else [of_column] * len(shown)
        for r, unit in zip(ratio, of_rows, strict=True):
            allowed = (factors[unit],) if of_column else (1.0, factors.get(unit, 1.0))
            assert np.isnan(r) or any(r == pytest.approx(f) for f in allowed), (before, after, unit)


def test_numbers_have_five_digits_and_no_exponent_where_it_hides_them():
    text = repr(every_result()["results"])
    assert "412.72" in text
    assert "e+0" not in text
