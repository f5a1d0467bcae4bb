"""Tables of the report: the numbers in them, recomputed by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from small_results import DECREMENT, PERIOD, decaying_drop, small_campaign, small_results

from sysid.estimates.calibrated_truck_modes import calibrated_modes
from sysid.estimates.suspension_values import distinct
from sysid.report import agreement, answer, drop_tables, knowledge, load_tables, tables
from sysid.report.figures import Gallery, drop_pictures
from sysid.validation import ChannelAgreement, Validation


def cells(table):
    return [[c.text for c in row] for row in table.rows]


def test_estimates_stand_side_by_side_in_the_order_of_the_work():
    made = tables.estimates_table(small_results(), "stiffness")
    names = [h.split(" [")[0] for h in made.head]
    assert names == ["axle", "paper, eq. (1)–(3)", "corrected", "fitted to the runs", "posterior"]
    assert cells(made)[0][:4] == ["axle 1", "300", "380", "420"]
    # 1.645 x 4 kN/m about 300, and 420 exp(+-1.645 x 0.01).
    assert [c.interval for c in made.rows[0][1:4]] == ["[293, 307]", "[373, 387]", "[413, 427]"]
    assert [c.note for c in made.rows[1][1:3]] == ["not readable", "not readable"]
    assert [c.note for c in made.rows[2][1:3]] == ["no drop in this load case"] * 2
    assert tables.estimates_table(small_results(drops=None, fit=None, posterior=None), "damping") is None
    assert tables.estimates_table(replace(small_results(), estimates=None), "damping") is None


def test_columns_of_stages_that_have_not_run_are_left_out():
    made = tables.estimates_table(small_results(fit=None, posterior=None), "damping")
    assert len(made.head) == 3


def test_indicator_uses_the_usable_drops_and_keeps_bare_axles_apart():
    results = small_results()
    (first, second) = cells(drop_tables.indicator_table(results, results.drops))
    assert first == ["axle 1", "1.67", "yes", "11.1\xa0%", "no"]
    assert (1.0 / PERIOD, DECREMENT / (2.0 * math.pi)) == pytest.approx((1.6667, 0.1114), rel=1e-3)
    assert second[1:] == ["—", "—", "—", "—"]
    drops = tuple(replace(d, dampers=i != 0) for i, d in enumerate(small_campaign().plank_drops))
    bare = replace(results, campaign=replace(results.campaign, plank_drops=drops))
    notes = [row[0].note for row in drop_tables.indicator_table(bare, bare.drops).rows]
    assert notes == ["front axle, empty", "front axle, empty, dampers removed", "rear axle, empty"]


def test_the_drop_shown_first_has_its_dampers_and_is_usable():
    results = small_results()
    files = (decaying_drop(file="a"), decaying_drop(file="b", usable=False), decaying_drop(file="c"))
    drops = tuple(
        replace(d, axle=0, dampers=f.file != "a", log=replace(d.log, file=f.file))
        for d, f in zip(results.campaign.plank_drops, files, strict=True)
    )
    changed = replace(
        results,
        campaign=replace(results.campaign, plank_drops=drops),
        drops=replace(results.drops, files=files),
    )
    gallery = Gallery()
    (shown,), _ = drop_pictures(changed, gallery)
    gallery.draw()
    assert "c: period 0.600 s, decrement 0.700, 4 of 5 peaks used" in shown.svg
    assert "b: not usable" not in shown.svg


def test_notes_on_drops_name_the_axle_once():
    results = small_results()
    assert drop_tables.pooled_notes(results.drops) == ["axle 2, empty: one remark"]


def test_peak_wheel_load_is_ratio_times_static_load():
    (made,) = load_tables.prediction_tables(small_results())
    rear = made.rows[1]
    # 3.6 x 29.43 kN.
    assert [c.text for c in rear] == [
        "axle 2", "29.4", "3.60", "106", "0.40", "yes", "12", "60", "40", "0.999",
    ]  # fmt: skip
    assert [c.note for c in rear[7:9]] == ["none declared"] * 2
    assert rear[6].interval == "[11, 13]"
    assert [c.interval for c in rear[2:4]] == ["[3.40, 3.80]", "[100, 112]"]
    assert "predictions/empty_48kmh.csv" in made.caption


def test_a_peak_load_names_its_pass_because_its_row_may_be_of_another_load_case():
    results = small_results()
    made = answer.answer_table(replace(results, predictions=replace(results.predictions, sweeps=())))
    front, rear = (next(row for row in made.rows if row[0].text == f"axle {i}") for i in (1, 2))
    # 3.6 x 29.43 kN, and a wheel that lifts off as none did.
    assert (rear[3].text, rear[3].note) == ("106*", "empty, 48\u00a0km/h, 29.4 static")
    assert "*" not in front[3].text
    assert made.caption.endswith("* an extrapolation beyond the driven runs")
    # Where speeds are known that the runs back, the largest of these stands there.
    (sweep,) = results.predictions.sweeps
    made = answer.answer_table(results)
    rear = next(row for row in made.rows if row[0].text == "axle 2")
    backed = sweep.speed_m_s <= 1.06 * sweep.driven_m_s[1]
    ratio = np.where(backed, sweep.peak_ratio.q50[:, 1], 0.0)
    assert float(rear[3].text) == pytest.approx(29.43 * ratio.max(), rel=0.006)
    assert rear[3].note == f"empty, {3.6 * sweep.speed_m_s[ratio.argmax()]:g}\u00a0km/h, 29.4 static"
    assert "Peak as driven" in made.caption


@pytest.mark.parametrize("case", ["empty", "laden"])
def test_a_load_stands_once_in_the_row_of_its_load_case(case):
    results = small_results()
    passes = tuple(replace(p, load_case=case) for p in results.predictions.passes)
    sweeps = tuple(replace(s, load_case=case) for s in results.predictions.sweeps)
    made = answer.answer_table(replace(results, predictions=replace(results.predictions, passes=passes, sweeps=sweeps)))
    for axle in (1, 2):
        rows = [row for row in made.rows if row[0].text == f"axle {axle}"]
        (loaded,) = (row for row in rows if row[3].text)
        # The second axle has a row for each load case, the first one for both.
        assert (case in loaded[0].note) == (len(rows) > 1)


def test_what_goes_beyond_the_driven_runs_stands_beside_what_was_driven():
    (made,) = load_tables.trust_tables(small_results())
    assert [c.text for c in made.rows[0][1:]] == ["within"] * 5
    assert [(c.text, c.interval) for c in made.rows[1][2:]] == [
        ("45.0", "[30.0]"), ("within", ""), ("within", ""), ("12.0", "[0]"),
    ]  # fmt: skip
    p = small_results().predictions
    calm = replace(p, passes=tuple(replace(one, trust=()) for one in p.passes))
    assert load_tables.trust_tables(small_results(predictions=calm)) == [None]


def test_ratio_against_speed_is_a_table_with_bands():
    (made,) = load_tables.sweep_tables(small_results())
    assert cells(made)[0] == ["10", "1.28", "1.56"]
    assert made.rows[2][1].interval == "[2.40, 2.93]"
    results = small_results()
    two = replace(results.campaign, scans={"first bump": None, "kerb": None})
    (named,) = load_tables.sweep_tables(replace(results, campaign=two))
    (sweep,) = results.predictions.sweeps
    assert named.caption == made.caption.replace(sweep.load_case, f"{sweep.load_case}, {sweep.bump}")


def test_ratings_are_summed_up_per_kind():
    rows = [[c.text for c in row] for row in agreement.ratings_table(small_results().validation).rows]
    # Ratings 0.95 and 0.85 of the two deflections in either run, 0.75 of the acceleration, which is below the limit.
    assert rows[0][:2] == ["deflection", "0.90 (0.85)"]
    assert rows[1][1:3] == ["0.75 (0.75)", "6.0\u00a0% (6.0\u00a0%)"]
    assert rows[0][5:] == ["5 (5)", "89.5 (89.0)", "0.10 (0.10)", "0 of 4"]
    assert rows[1][-1] == "2 of 2"
    blank = Validation((ChannelAgreement("r", "c", "other", None, math.nan, math.nan, 0),))
    assert [c.text for c in agreement.ratings_table(blank).rows[0]] == ["other", *["\u2014"] * 7, "0 of 1"]


def test_agreement_is_summed_up_per_run_and_kind():
    results = small_results()
    made = agreement.summary_table(results.validation, {"runs/r1.csv": "first"})
    # NRMSE 2 and 4 % of the two deflections, 6 % of the acceleration; residuals 1.0 and 1.2, then 1.4.
    assert cells(made)[0] == ["first", "3.0\xa0% (4.0\xa0%)", "1.10", "6.0\xa0% (6.0\xa0%)", "▲\xa01.40"]
    matrix = agreement.matrix_table(results.validation, {}, "x", agreement.noise_cell)
    assert cells(matrix)[2] == ["sensor2_mm", "▲\xa01.40", "▲\xa01.40"]


def test_settings_are_flattened():
    assert tables.flat_settings({"a": {"b": 1, "c": {"d": True}}, "e": "f"}) == [
        ("a.b", "1"), ("a.c.d", "True"), ("e", "f"),
    ]  # fmt: skip


def test_modes_stand_by_load_case_with_ratios_in_percent():
    results = small_results()
    modes = calibrated_modes(results.campaign, results.fit, None)
    made = tables.modes_table(modes)
    rows = cells(made)
    assert [r[:2] for r in rows] == [[case, str(k)] for case in ("empty", "laden") for k in (1, 2, 3, 4)]
    for row, frequency, ratio in zip(rows[:4], modes[0].frequency_hz, modes[0].damping_ratio, strict=True):
        assert float(row[3]) == pytest.approx(frequency, rel=0.01)
        assert float(row[4].rstrip("\u00a0%")) == pytest.approx(100 * ratio, rel=0.01)
    assert tables.modes_table(()) is None


def test_answer_has_one_row_per_axle_and_load_case_with_the_best_value():
    results = small_results()
    made = answer.answer_table(results)
    names = [(row[0].text, row[0].note) for row in made.rows]
    assert names == [("axle 1", "front axle"), ("axle 2", "rear axle, empty"), ("axle 2", "rear axle, laden")]
    found = {s.name: s for s in results.posterior.summaries}
    k, c, peak = made.rows[2][1:]
    # The load of an axle stands in its first row.
    assert peak.text == ""
    assert all(made.rows[i][3].text for i in (0, 1))
    assert k.text == f"{found['k_2[laden]'].q50 / 1e3:.0f}"
    low, high = (getattr(found["k_2[laden]"], q) / 1e3 for q in ("q05", "q95"))
    assert k.interval == f"[{low:.0f}, {high:.0f}]"
    # Damping is shared by the load cases and stands in both rows.
    assert c == made.rows[1][2]
    assert "90 % credible interval" in made.caption
    first = answer.answer_table(small_results(fit=None, posterior=None))
    assert [row[1].text for row in first.rows] == ["380"]
    assert "repeats and tolerances" in first.caption
    assert answer.answer_table(small_results(drops=None, fit=None, posterior=None)) is None
    # Without drops no row of its own is left for what the load cases share.
    alone = answer.answer_table(small_results(drops=None))
    assert [(row[0].text, row[0].note) for row in alone.rows] == names


def test_drops_of_a_second_load_case_do_not_replace_what_all_load_cases_share():
    results = small_results()
    pooled = results.drops.pooled
    more = tuple(replace(e, load_case="laden", damping=15e3) for e in pooled if e.axle == pooled[0].axle)
    results = small_results(drops=replace(results.drops, pooled=(*pooled, *more)))
    rows = [r for r in results.suspension("damping") if r.axle == more[0].axle]
    assert {r.drop_load_case for r in rows} == {pooled[0].load_case, "laden"}
    assert len({r.best.value for r in rows}) == 1
    assert {r.best.source for r in rows} == {"posterior"}
    assert rows[-1].estimates[more[0].method].value == 15e3
    # It is one value, and counts once where values are counted.
    assert [r for r in distinct(rows) if r.axle == more[0].axle] == rows[:1]


def test_axle_loads_of_the_model_at_rest_stand_beside_the_scales():
    made = answer.axle_load_table(small_results())
    # 39,240 N and 29,430 N over 9.81 m/s2.
    assert cells(made) == [["axle 1", "4,000", "4,000"], ["axle 2", "3,000", "3,000"], ["total", "7,000", "7,000"]]
    assert made.head[1:] == ("empty: scales [kg]", "empty: model at rest [kg]")
    assert answer.axle_load_table(small_results(predictions=None)) is None


def test_priors_stand_beside_results_with_what_is_left_of_their_spread():
    results = small_results(posterior=None)
    made = knowledge.shrinkage_table(results)
    rows = {row[0].text: row for row in made.rows}
    # Median 1.2 x 11 kN s/m, log sd 0.4: 13.2 exp(+-1.645 x 0.4); sd 0.04 of 0.4; ln(1 / 1.2) / 0.4.
    assert [c.text for c in rows["c_1"]] == ["c_1", "kN s/m", "13.2", "11.0", "0.10", "\N{MINUS SIGN}0.5"]
    assert rows["c_1"][2].interval == "[6.8, 25.5]"
    assert rows["kt_1"][3].text == "not determined"
    posterior = knowledge.shrinkage_table(small_results())
    assert posterior.head[3].startswith("posterior")
    # The draws' spread is that of the covariance.
    assert float(posterior.rows[3][4].text) == pytest.approx(0.04 / 0.4, abs=0.015)
    assert knowledge.shrinkage_table(small_results(fit=None)) is None


def test_advice_is_a_row_per_run_and_per_sensor():
    made = knowledge.advice_table(small_results())
    assert [row[0].text for row in made.rows] == ["none", "20 km/h, laden", "20 km/h, laden, with LVDT at axle 2"]
    assert cells(made)[1][1:] == ["2.5\xa0% (c_2)", "1.0\xa0%", "0.10"]
    assert knowledge.advice_table(small_results(advice=None)) is None


def test_what_the_data_do_not_determine_is_no_number():
    fit = small_results().fit
    parameters = tuple(replace(p, identified=False) if p.name == "k_1" else p for p in fit.parameters)
    results = small_results(fit=replace(fit, parameters=parameters))
    row = tables.estimates_table(results, "stiffness").rows[0]
    assert [c.text for c in row[3:]] == ["not determined", "not determined"]
    assert {c.note for c in row[3:]} == {"prior only"}
    shown = {r[0].text: r for r in tables.parameters_table(results, parameters, "").rows}
    assert shown["k_1"][5].text == shown["k_1"][6].text == "not determined"
    assert "not determined" not in [c.text for c in shown["c_1"]]
