"""Plank drops end to end: simulated single axles, log defects, and the linear truck."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from decay_oracles import damped_cosine, quarter_car_drop, quarter_car_with_quadratic_damping
from split_cases import first_then_long

from studies.plank_drops.motion import Fall, QuarterCar, deflection
from sysid.campaign import (
    Axle,
    Body,
    Channel,
    LoadCase,
    Log,
    PlankDrop,
    Sensor,
    Vehicle,
    read_campaign,
)
from sysid.errors import DataRejectedError
from sysid.sdof import DropSettings, analyse_drop, analyse_drops, summary_table
from sysid.sdof.analysis import axle_on_tire

DATA = Path(__file__).parents[2] / "examples" / "linear_truck"
MASS, TIRE, TIRE_DAMPING = 3415.0, 1.65e6, 3000.0
PRECISE = DropSettings(
    tire_stiffness_tolerance=0.0,
    tire_damping_tolerance=0.0,
    unsprung_mass_tolerance=0.0,
    tributary_mass_tolerance=0.0,
)


def single_axle(time, value, unsprung=540.0, speed=None, column="frame_axle_mm", sides=(None,)):
    """Drop, vehicle and load case of one axle under one body; `value` (n,) or one per side."""
    axle = Axle("only", 0, 0.0, unsprung, TIRE, TIRE_DAMPING, 0.5, "leaf")
    vehicle = Vehicle("single axle", (Body("body"),), (axle,))
    case = LoadCase("unloaded", (MASS + unsprung,), (MASS,), (1000.0,), (1.0,))
    values = [value] if len(sides) == 1 else value
    channels = tuple(
        Channel(
            Sensor(column + (side or ""), "suspension_deflection", "mm", axle=0, side=side),
            time,
            v,
            np.zeros(time.size, np.int8),
        )
        for side, v in zip(sides, values, strict=True)
    )
    drop = PlankDrop(0, "unloaded", 0.075, Log("drops/one.csv", float(time[1] - time[0]), channels), speed)
    return drop, vehicle, case


def by_method(analysis):
    return {e.method: e for e in analysis.estimates}


@pytest.mark.parametrize("roll_s", [0.0, 0.15])
@pytest.mark.parametrize("share", first_then_long(0.2, 0.05, 0.4))
@pytest.mark.parametrize("ratio", [0.06, 0.3])
def test_correction_recovers_a_single_axle(share, ratio, roll_s):
    k = share * TIRE
    c = 2 * ratio * np.sqrt(k * MASS)
    time, value = quarter_car_drop(k, c, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=roll_s)
    analysis = analyse_drop(*single_axle(time, value), PRECISE)
    found = by_method(analysis)
    assert found["corrected"].stiffness == pytest.approx(k, rel=0.02)
    assert found["corrected"].damping == pytest.approx(c, rel=0.05)
    assert found["free_decay"].stiffness == pytest.approx(k, rel=1e-4)
    assert found["free_decay"].damping == pytest.approx(c, rel=1e-4)
    # The paper's equations see suspension and tire in series.
    assert found["paper"].stiffness == pytest.approx(k / (1 + share), rel=0.12)
    assert found["paper"].damping < 0.95 * c


@pytest.mark.parametrize("seed", first_then_long(0, 1, 2))
@pytest.mark.parametrize(("share", "ratio"), [(0.25, 0.12), (0.4, 0.25)])
def test_noise_engine_and_offset_stay_within_the_errors(seed, share, ratio):
    k = share * TIRE
    c = 2 * ratio * np.sqrt(k * MASS)
    time, value = quarter_car_drop(k, c, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=0.15)
    rng = np.random.default_rng(seed)
    value = value + 0.004 + 3e-4 * rng.standard_normal(time.size) + 2e-4 * np.sin(2 * np.pi * 23.0 * time + seed)
    found = by_method(analyse_drop(*single_axle(time, value), PRECISE))
    for method in ("corrected", "free_decay"):
        e = found[method]
        assert abs(e.stiffness - k) < 4 * e.stiffness_sd + 0.01 * k
        assert abs(e.damping - c) < 4 * e.damping_sd + 0.02 * c
        assert e.stiffness_sd < 0.05 * k
        assert e.damping_sd < 0.12 * c


def test_slow_roll_off_with_and_without_declared_speed():
    k, c = 4.0e5, 9000.0
    time, value = quarter_car_drop(k, c, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=0.5)
    for speed in (None, 0.6):
        analysis = analyse_drop(*single_axle(time, value, speed=speed))
        assert by_method(analysis)["corrected"].stiffness == pytest.approx(k, rel=0.02)
        assert by_method(analysis)["corrected"].damping == pytest.approx(c, rel=0.05)
    first = analysis.reading.extremum_time_s[analysis.reading.used][0]
    assert first > analysis.release_time_s + 0.26 / 0.6


def test_analysis_carries_what_the_plots_need():
    time, value = quarter_car_drop(4.0e5, 9000.0, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=0.1)
    analysis = analyse_drop(*single_axle(time, value + 0.002))
    assert analysis.release_time_s == pytest.approx(0.8, abs=0.02)
    assert analysis.tributary_mass_kg == pytest.approx(MASS)
    assert analysis.reading.settled_level == pytest.approx(0.002, abs=2e-5)
    fitted = np.isfinite(analysis.free_decay_m)
    np.testing.assert_allclose(analysis.free_decay_m[fitted], analysis.deflection_m[fitted], atol=1e-6)
    late = (time > 1.6) & (time < 4.0)
    np.testing.assert_allclose(analysis.filtered_m[late], analysis.deflection_m[late], atol=1e-3)
    assert analysis.frequency_hz == pytest.approx(1.0 / analysis.reading.damped_period)
    assert analysis.damping_ratio_directive == pytest.approx(analysis.reading.log_decrement / (2 * np.pi))


def test_stiffness_near_the_tire_is_marked():
    k = 0.55 * TIRE
    time, value = quarter_car_drop(k, 2 * 0.1 * np.sqrt(k * MASS), MASS, 540.0, TIRE, TIRE_DAMPING)
    assert "above 0.4" in by_method(analyse_drop(*single_axle(time, value)))["corrected"].note


def test_heavily_damped_axle_yields_no_peak_estimate():
    k = 2.0e5
    time, value = quarter_car_drop(k, 2 * 0.85 * np.sqrt(k * MASS), MASS, 540.0, TIRE, TIRE_DAMPING)
    value = value + 3e-4 * np.random.default_rng(0).standard_normal(time.size)
    drop, vehicle, case = single_axle(time, value)
    found = by_method(analyse_drop(drop, vehicle, case))
    for method in ("paper", "corrected"):
        assert not found[method].usable
        assert np.isnan([found[method].stiffness, found[method].damping]).all()
        assert "peaks" in found[method].note


def test_both_sides_are_averaged_and_a_difference_is_said():
    time, value = quarter_car_drop(4.0e5, 9000.0, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=0.1)
    broken = np.where((time > 2.0) & (time < 2.3), np.nan, 0.7 * value + 0.01)
    analysis = analyse_drop(*single_axle(time, [1.3 * value, broken], sides=("left", "right")))
    e = by_method(analysis)["paper"]
    assert "move by" in e.note
    whole = by_method(analyse_drop(*single_axle(time, value)))["paper"]
    assert e.stiffness == pytest.approx(whole.stiffness, rel=0.01)


def test_clipped_readings_are_left_out():
    time, value = quarter_car_drop(4.0e5, 9000.0, MASS, 540.0, TIRE, TIRE_DAMPING, roll_s=0.1)
    drop, vehicle, case = single_axle(time, np.maximum(value, -0.015))
    channel = dataclasses.replace(drop.log.channels[0], censored=-(value <= -0.015).astype(np.int8))
    drop = dataclasses.replace(drop, log=dataclasses.replace(drop.log, channels=(channel,)))
    analysis = analyse_drop(drop, vehicle, case, PRECISE)
    np.testing.assert_array_equal(np.isnan(analysis.deflection_m), value <= -0.015)
    found = by_method(analysis)
    assert "clipped" in found["corrected"].note
    assert found["corrected"].damping == pytest.approx(9000.0, rel=0.05)
    assert found["free_decay"].stiffness == pytest.approx(4.0e5, rel=1e-4)
    assert found["free_decay"].damping == pytest.approx(9000.0, rel=1e-4)


def test_a_log_without_deflection_is_refused():
    time, value = quarter_car_drop(4.0e5, 9000.0, MASS, 540.0, TIRE, TIRE_DAMPING)
    drop, vehicle, case = single_axle(time, value)
    drop = dataclasses.replace(drop, log=dataclasses.replace(drop.log, channels=()))
    with pytest.raises(DataRejectedError, match="no suspension deflection of axle 'only'"):
        analyse_drop(drop, vehicle, case)


def dropped_again(time, gap_s, decrement=0.6, noise=3e-4):
    """Two drops in one file: the axle is put back at its first height 0.3 s before the second release."""
    first = damped_cosine(time, 0.6, decrement)
    second = damped_cosine(time, 0.6, decrement, release_s=0.5 + gap_s)
    value = np.where(time < 0.2 + gap_s, first, second)
    return value + noise * np.random.default_rng(0).standard_normal(time.size)


@pytest.mark.parametrize(("gap_s", "decrement"), [(5.0, 0.3), (3.0, 0.6), (5.0, 0.6), (3.0, 1.2)])
def test_a_second_drop_is_said_and_the_first_one_read(gap_s, decrement):
    time = np.arange(0.0, 9.0, 0.005)
    drop, vehicle, case = single_axle(time, dropped_again(time, gap_s, decrement))
    analysis = analyse_drop(drop, vehicle, case)
    assert analysis.second_drop_s == pytest.approx(gap_s + 0.2, abs=0.02)
    fitted = by_method(analysis)["free_decay"]
    assert f"a second drop begins at {analysis.second_drop_s:.2f} s" in fitted.note
    assert fitted.damped_period == pytest.approx(0.6, rel=0.003 if decrement < 1.0 else 0.006)
    assert fitted.log_decrement == pytest.approx(decrement, rel=0.02 if decrement < 1.0 else 0.04)


def test_a_second_drop_becomes_a_message():
    summary = analyse_drops(altered_campaign(lambda t, r: dropped_again(t, 2.5, 1.2)))
    said = [m for m in summary.messages if re.search(r"axle1_drop[12].csv: a second drop begins at 2\.(69|70) s", m)]
    assert len(said) == 2


@pytest.mark.parametrize("missing", [(1.0, 1.9), (1.4, 2.45)])
def test_one_drop_with_a_gap_is_one_drop(missing):
    """A part without readings does not pass for a rest between two drops."""
    time = np.arange(0.0, 9.0, 0.005)
    value = damped_cosine(time, 0.6, 0.1)
    value[(time > missing[0]) & (time < missing[1])] = np.nan
    assert np.isnan(analyse_drop(*single_axle(time, value)).second_drop_s)


def test_a_decay_that_explains_little_of_the_motion_is_no_estimate():
    """Put back before the first drop has decayed: not seen as a second drop, but no ring-down of one mass either."""
    time = np.arange(0.0, 9.0, 0.005)
    analysis = analyse_drop(*single_axle(time, dropped_again(time, 3.0, 0.3)))
    fitted = by_method(analysis)["free_decay"]
    assert not fitted.usable
    assert np.isnan(analysis.second_drop_s)
    assert "of the motion unexplained" in fitted.note
    assert np.isnan(analysis.free_decay_m).all()


@pytest.fixture(scope="module")
def summary():
    return analyse_drops(read_campaign(DATA / "campaign.toml"))


def test_drops_of_the_linear_truck_lie_where_a_careful_reader_lands(summary):
    # Documented with the campaign: equations (1)-(3) on noise-free drops give k at 0.62-1.23, c at 0.23-1.28 of truth.
    truth = tomllib.loads((DATA / "truth.toml").read_text(encoding="utf-8"))["axle"]
    paper = [e for e in summary.pooled if e.method == "paper"]
    assert [e.axle for e in paper] == list(range(6))
    for e in paper:
        assert e.usable
        assert 0.55 < e.stiffness / truth[e.axle]["suspension_stiffness_N_per_m"] < 1.35
        assert 0.2 < e.damping / truth[e.axle]["suspension_damping_N_s_per_m"] < 1.4


def test_drops_of_the_linear_truck_are_complete_and_frank(summary):
    assert len(summary.files) == 18
    assert len(summary.pooled) == 18
    assert all(e.file is None for e in summary.pooled)
    assert "neighbouring axles" in summary.messages[0]
    # The suspensions of this campaign are linear: no drop may pass for friction or quadratic damping.
    assert {a.reading.damping_kind for a in summary.files} <= {"viscous", "unknown"}
    assert {a.damping_kind for a in summary.files} == {"viscous", "unknown"}
    estimates = [*summary.pooled, *(e for a in summary.files for e in a.estimates)]
    assert {e.damping_kind for e in estimates if e.usable} == {"viscous", "unknown"}
    assert np.isnan([(e.friction_force, e.quadratic_damping) for e in estimates]).all()
    assert not any("dry friction" in m for m in summary.messages)
    assert any("forward tandem drive" in m and "scatter" in m for m in summary.messages)


def test_pooled_errors_carry_scatter_and_tolerance(summary):
    pooled = [e for e in summary.pooled if e.usable]
    assert len(pooled) >= 15
    for e in pooled:
        single = [x for a in summary.files for x in a.estimates if (x.axle, x.method) == (e.axle, e.method)]
        values = [x.stiffness for x in single if x.usable]
        assert min(values) * (1 - 1e-9) <= e.stiffness <= max(values) * (1 + 1e-9)
        if len(values) > 1:
            assert e.stiffness_sd > 0.9 * np.std(values, ddof=1) / np.sqrt(len(values))
        assert e.stiffness_sd > 0.019 * e.stiffness


def test_summary_table_has_a_row_per_estimate(summary):
    table = summary_table(summary)
    assert len(table) == 18 * 3 + 18
    assert table["axle"].min() == 1
    assert table.loc[table["file"].isna(), "method"].value_counts().to_dict() == {
        "paper": 6,
        "corrected": 6,
        "free_decay": 6,
    }


def altered_campaign(value_of, dampers=(True, True)):
    """The linear truck with only the first two drops, their deflection replaced by `value_of(time, repeat)`."""
    campaign = read_campaign(DATA / "campaign.toml")
    drops = []
    for repeat, drop in enumerate(campaign.plank_drops[:2]):
        channels = tuple(
            dataclasses.replace(c, value=value_of(c.time_s, repeat), censored=np.zeros(c.time_s.size, np.int8))
            if c.sensor.kind == "suspension_deflection"
            else c
            for c in drop.log.channels
        )
        log = dataclasses.replace(drop.log, channels=channels)
        drops.append(dataclasses.replace(drop, log=log, dampers=dampers[repeat]))
    return dataclasses.replace(campaign, plank_drops=tuple(drops))


def with_noise(value, repeat):
    return value + 2e-4 * np.random.default_rng(repeat).standard_normal(value.size)


def front_axle():
    campaign = altered_campaign(lambda time, repeat: time)
    return axle_on_tire(0, campaign.vehicle, campaign.load_cases[campaign.plank_drops[0].load_case])


def rubbing(time, repeat):
    """A drop of the front axle with friction of 4 % of the load, integrated by SciPy."""
    a = front_axle()
    car = QuarterCar(
        a.mass, a.unsprung_mass, a.tire_stiffness, a.tire_damping, 4e5, 4e3, friction=0.4 * a.mass, slip_m=1.5e-3
    )
    return with_noise(deflection(car, Fall(0.8, 0.08, rolls=True), time), repeat)


def with_quadratic_damper(time, repeat):
    a = front_axle()
    return with_noise(quarter_car_with_quadratic_damping(time, 0.15 * a.tire_stiffness, 4.0 * a.mass, a), repeat)


def test_friction_in_most_repeats_becomes_a_message():
    summary = analyse_drops(altered_campaign(rubbing))
    assert any("front steer" in m and "dry friction" in m for m in summary.messages)


@pytest.mark.parametrize("ratio", first_then_long(0.25, 0.1))
def test_quadratic_damping_of_an_axle_on_its_tire(ratio):
    """Against a quarter car that SciPy integrates: the tire lets the body move further than the suspension."""
    on_tire = front_axle()
    stiffness, quadratic = ratio * on_tire.tire_stiffness, 4.0 * on_tire.mass

    def falling(time, repeat):
        return with_noise(quarter_car_with_quadratic_damping(time, stiffness, quadratic, on_tire), repeat)

    found = next(e for e in analyse_drops(altered_campaign(falling), PRECISE).pooled if e.method == "free_decay")
    assert found.damping_kind == "quadratic"
    assert found.stiffness == pytest.approx(stiffness, rel=0.02)
    assert found.quadratic_damping == pytest.approx(quadratic, rel=0.03)


@pytest.mark.parametrize(("name", "drop"), [("friction_force", rubbing), ("quadratic_damping", with_quadratic_damper)])
def test_a_declared_error_common_to_all_repeats_does_not_average_out(name, drop):
    """Masses and tires are off by as much in every repeat: the pool knows k, F and Q no better than one record."""
    rough = DropSettings(
        tire_stiffness_tolerance=0.1,
        tire_damping_tolerance=0.3,
        unsprung_mass_tolerance=0.1,
        tributary_mass_tolerance=0.1,
    )
    summary = analyse_drops(altered_campaign(drop), rough)
    pooled = next(e for e in summary.pooled if e.method == "free_decay")
    single = [by_method(a)["free_decay"] for a in summary.files]
    for quantity in ("stiffness", name):
        least = min(getattr(e, f"{quantity}_sd") for e in single)
        assert 0.95 * least < getattr(pooled, f"{quantity}_sd") < 1.3 * least
        assert least > 0.03 * getattr(pooled, quantity)


def test_overdamped_repeats_become_a_message_and_no_number():
    summary = analyse_drops(altered_campaign(lambda t, r: with_noise(damped_cosine(t, 0.6, 8.0), r)))
    assert any("front steer" in m and "2 of 2 records give no two-peak decrement" in m for m in summary.messages)
    paper = next(e for e in summary.pooled if e.method == "paper")
    assert not paper.usable
    assert np.isnan(paper.stiffness)


def test_drops_without_dampers_are_not_pooled():
    def decay(time, repeat):
        return with_noise(damped_cosine(time, 0.6, 0.6 if repeat == 0 else 0.1), repeat)

    summary = analyse_drops(altered_campaign(decay, dampers=(True, False)))
    assert len(summary.files) == 2
    pooled = next(e for e in summary.pooled if e.method == "paper")
    assert pooled.log_decrement == pytest.approx(0.6, rel=0.03)
    assert "one record only" in pooled.note
    assert any("dampers removed" in m for m in summary.messages)


def test_a_drop_that_is_listed_twice_counts_twice():
    """Reading says so; the analysis goes on."""
    once = altered_campaign(lambda time, repeat: with_noise(damped_cosine(time, 0.6, 0.5), 0))
    first = once.plank_drops[0]
    summary = analyse_drops(dataclasses.replace(once, plank_drops=(first, dataclasses.replace(first))))
    assert [a.file for a in summary.files] == [first.log.file] * 2
    assert all(e.usable for e in summary.pooled)
