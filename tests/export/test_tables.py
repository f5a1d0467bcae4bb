"""CSV files read back by pandas; file names and atomic writing."""

import errno
import io
import os
import stat
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from small_results import Words, before_sampling, campaign_only, small_profile, small_results

from sysid.csv_cells import escape_cell
from sysid.export import (
    parameters_csv,
    prediction_csv,
    prediction_files,
    validation_csv,
    write_parameters,
    write_predictions,
    write_validation,
)
from sysid.export.models import moving_force_texts
from sysid.export.tables import write_profiles
from sysid.files import write_text
from sysid.results.contents import Judgement
from sysid.workflow.stages import PREDICT


def test_parameters_come_back_with_pandas(tmp_path):
    results = small_results()
    write_parameters(results, tmp_path / "parameters.csv")
    # Older versions of pandas round the last digit of numbers that they find themselves.
    numbers = ("least_squares_value", "least_squares_sd", "posterior_mean", "posterior_q05", "posterior_q95")
    exact = dict.fromkeys(numbers, lambda text: float(text or "nan"))
    table = pd.read_csv(tmp_path / "parameters.csv", converters=exact).set_index("name")
    fit, summaries = results.fit, {s.name: s for s in results.posterior.summaries}
    assert list(table.index) == [*fit.names, "speed[runs/r1.csv]"]
    for p in fit.parameters:
        row = table.loc[p.name]
        assert row["least_squares_value"] == p.value
        assert row["least_squares_sd"] == p.sd
        assert row["axle"] == p.axle + 1
        assert [row["posterior_q05"], row["posterior_q95"]] == [summaries[p.name].q05, summaries[p.name].q95]
    assert not table.loc["kt_1", "identified"]
    assert np.isnan(table.loc["speed[runs/r1.csv]", "posterior_mean"])
    assert table.loc["c_2", "axle_name"] == "rear axle"


def test_parameters_without_stages_are_empty_not_absent():
    assert pd.read_csv(io.StringIO(parameters_csv(campaign_only()))).empty
    early = pd.read_csv(io.StringIO(parameters_csv(before_sampling())))
    assert early["posterior_mean"].isna().all()
    assert early["least_squares_value"].notna().all()


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("=1+1", "'=1+1"),
        ("+1", "'+1"),
        ("-1", "'-1"),
        ("@a", "'@a"),
        (" =1", "' =1"),
        ("\t=1", "' =1"),
        ("a\r=1", "a =1"),
        ("a\n=1", "a =1"),
        ('a";=1', "a\";'=1"),
    ],
)
def test_no_text_cell_starts_a_formula(text, cell):
    table = pd.read_csv(io.StringIO(parameters_csv(small_results(Words.all(text)))), dtype=str, keep_default_na=False)
    assert len(table) == 7
    for column in ("name", "axle_name", "load_case", "run"):
        assert not table[column].str.lstrip().str.startswith(("=", "+", "-", "@")).any()
    assert table["axle_name"][0] == cell


def test_ordinary_text_is_left_alone():
    assert escape_cell("front axle - left") == "front axle - left"


def test_predictions_come_back_with_pandas(tmp_path):
    results = small_results()
    paths = write_predictions(results, tmp_path)
    names = ["empty_48kmh.csv", "peaks.csv", "against_speed.csv"]
    assert list(paths) == [tmp_path / "predictions" / name for name in names]
    path = paths[0]
    table = pd.read_csv(path)
    p = results.predictions.passes[0]
    assert list(table.columns) == [
        "time_s",
        *(
            f"{force}{i}_N_{q}"
            for force in ("tire_force", "suspension_force")
            for i in (1, 2)
            for q in ("q05", "q50", "q95")
        ),
        "beyond_driven1",
        "beyond_driven2",
    ]
    assert table["beyond_driven1"].sum() == 0
    # 50 ms on either side of the peak at 0.2 s.
    beyond = table.loc[table["beyond_driven2"] == 1, "time_s"]
    assert (beyond.min(), beyond.max(), len(beyond)) == (0.151, 0.249, 99)
    np.testing.assert_allclose(table["suspension_force2_N_q05"], p.suspension_force_N.q05[1], atol=0.0051)
    np.testing.assert_allclose(table["time_s"], p.time_s, atol=1e-9)
    np.testing.assert_allclose(table["tire_force2_N_q95"], p.tire_force_q95_N[1], atol=0.0051)
    np.testing.assert_allclose(table["tire_force1_N_q05"], p.tire_force_q05_N[0], atol=0.0051)


def test_peaks_and_ratio_against_speed_come_back_with_pandas(tmp_path):
    results = small_results()
    _, peaks, against = write_predictions(results, tmp_path)
    table = pd.read_csv(peaks).set_index(["axle", "measure"])
    assert table.loc[(2, "peak_dynamic_load_ratio"), ["q05", "q50", "q95"]].tolist() == [3.4, 3.6, 3.8]
    assert table.loc[(2, "lift_off_s"), "q50"] == 0.012
    assert table.loc[(1, "jounce_m"), "q50"] == 0.05
    assert set(table["file"]) == {"predictions/empty_48kmh.csv"}
    assert set(table.loc[2, "beyond_driven"]) == {"tire_deflection lift_off"}
    assert table.loc[1, "beyond_driven"].isna().all()
    sweep = results.predictions.sweeps[0]
    table = pd.read_csv(against)
    assert table["speed_km_h"].tolist() == [10, 10, 25, 25, 60, 60]
    # Driven up to 30 km/h.
    assert table["extrapolated"].tolist() == [False] * 4 + [True] * 2
    np.testing.assert_allclose(table["peak_dynamic_load_ratio_q95"], sweep.peak_ratio.q95.ravel(), rtol=1e-12)
    np.testing.assert_allclose(table["load_coefficient_q50"], sweep.load_coefficient.q50.ravel(), rtol=1e-12)


@pytest.mark.parametrize(("trust", "forbidden"), [("use", 0), ("use_within", 0), ("do_not_bet", 1), ("not_yet", 1)])
def test_tables_and_histories_carry_the_verdict(tmp_path, trust, forbidden):
    results = replace(small_results(), judgement=Judgement(trust, ("because",)))
    history, peaks, against = write_predictions(results, tmp_path)
    for text in (peaks, against, io.StringIO(parameters_csv(results))):
        assert set(pd.read_csv(text)["verdict"]) == {trust}
    assert set(pd.read_csv(history)["do_not_bet"]) == {forbidden}
    asked, measures, moved = PREDICT.command.aside.write(results.predictions, results, tmp_path / "asked")
    assert set(pd.read_csv(asked)["do_not_bet"]) == {forbidden}
    # The same table, whichever way a pass was asked for.
    assert measures.read_text("utf-8") == peaks.read_text("utf-8")
    assert measures.name == f"{asked.stem}_peaks.csv"
    (moving,) = moving_force_texts(results.campaign, results.predictions, results.judgement).values()
    assert moved.read_text("utf-8") == moving
    assert set(pd.read_csv(io.StringIO(moving))["do_not_bet"]) == {forbidden}


def test_peaks_in_kN_are_ratios_times_loads_at_rest(tmp_path):
    results = small_results()
    table = pd.read_csv(write_predictions(results, tmp_path)[1]).set_index(["axle", "measure"])
    for i, static in enumerate(results.predictions.passes[0].static_load_N):
        assert table.loc[(i + 1, "static_axle_load_kN"), "q50"] == pytest.approx(1e-3 * static)
        ratio, load = (table.loc[(i + 1, n), "q95"] for n in ("peak_dynamic_load_ratio", "peak_axle_load_kN"))
        assert load == pytest.approx(1e-3 * static * ratio)


def test_a_pass_over_another_bump_has_it_in_its_file_name():
    one = small_results().predictions.passes[0]
    names = prediction_files([one, replace(one, shape="watts 100 mm x 3.7 m")])
    assert names == ("predictions/empty_48kmh.csv", "predictions/empty_48kmh_watts_100_mm_x_3_7_m.csv")


def test_bands_are_empty_before_sampling(tmp_path):
    table = pd.read_csv(io.StringIO(prediction_csv(before_sampling().predictions.passes[0])))
    assert table["tire_force1_N_q05"].isna().all()
    assert table["tire_force1_N_q95"].isna().all()
    assert table["tire_force1_N_q50"].notna().all()
    assert write_predictions(campaign_only(), tmp_path) == ()


def test_names_of_passes_stay_apart_and_inside_the_folder():
    one = small_results().predictions.passes[0]
    cases = ("Empty", "empty", "../../etc", "", "\U0001f69a" * 100, "leer/h\u00e4lftig")
    files = prediction_files([replace(one, load_case=c) for c in cases] + [replace(one, speed_m_s=12.5 / 3.6)])
    assert files == (
        "predictions/empty_48kmh.csv",
        "predictions/empty_48kmh_2.csv",
        "predictions/etc_48kmh.csv",
        "predictions/pass_48kmh.csv",
        "predictions/pass_48kmh_2.csv",
        "predictions/leer_halftig_48kmh.csv",
        "predictions/empty_12.5kmh.csv",
    )


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_file(tmp_path, monkeypatch, call):
    target = tmp_path / "out" / "x.csv"
    write_text(target, "old\n")

    def fails(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr(os, call, fails)
    with pytest.raises(OSError, match="disk full"):
        write_text(target, "new\n")
    assert target.read_text() == "old\n"
    assert os.listdir(target.parent) == ["x.csv"]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no flush of folders")
@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EIO, errno.ENOSPC])
@pytest.mark.parametrize("of_folder", [True, False])
def test_only_a_folder_that_cannot_be_flushed_is_no_error(tmp_path, monkeypatch, number, of_folder):
    flush = os.fsync

    def refuses(handle):
        if stat.S_ISDIR(os.fstat(handle).st_mode) == of_folder:
            raise OSError(number, os.strerror(number))
        flush(handle)

    monkeypatch.setattr(os, "fsync", refuses)
    target = tmp_path / "x.csv"
    if of_folder and number not in (errno.EIO, errno.ENOSPC):
        write_text(target, "new\n")
        assert target.read_text() == "new\n"
    else:
        with pytest.raises(OSError, match=os.strerror(number)):
            write_text(target, "new\n")


def test_agreement_comes_back_with_pandas(tmp_path):
    results = small_results()
    write_validation(results, tmp_path / "validation.csv")
    table = pd.read_csv(tmp_path / "validation.csv", keep_default_na=False, na_values=[""])
    rows = results.validation.channels
    assert table["axle"].tolist() == [row.axle + 1 for row in rows]
    for name in ("nrmse", "fit_percent", "peak_error", "iso18571", "sprague_geers_phase"):
        assert table[name].tolist() == [getattr(row, name) for row in rows]
    # The acceleration's rating of 0.75 is below the limit of 0.80, of both deflections above it.
    assert table["outside_limits"].fillna("").tolist() == ["", "", "iso18571"] * 2
    write_validation(campaign_only(), tmp_path / "none.csv")
    assert not (tmp_path / "none.csv").exists()


def test_text_of_the_agreement_is_no_formula():
    words = Words.all("=1+1")
    table = pd.read_csv(io.StringIO(validation_csv(small_results(words).validation)), dtype=str)
    assert all(text.startswith("'=") for name in ("run", "column") for text in table[name])


def test_profiles_are_a_file_each(tmp_path):
    written = write_profiles((small_profile("k_2[laden]"), small_profile("k_1")), tmp_path)
    assert [p.name for p in written] == ["k_2_laden.csv", "k_1.csv"]
    table = pd.read_csv(written[1])
    assert list(table.columns) == ["value", "deviance", "adjusted", "converged"]
    assert table["value"][4] == pytest.approx(4e5)
    assert table["adjusted"].to_list() == pytest.approx([9, 5.0625, 2.25, 0.5625, 0, 0.5625, 2.25, 5.0625, 9])
