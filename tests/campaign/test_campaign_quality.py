"""Quality check: silent on healthy records, names every planned defect and every injected fault."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import butter, sosfiltfilt

from sysid.campaign import Campaign, Channel, Log, check_quality, quality_table, read_campaign
from sysid.campaign.clipping import clip_levels
from sysid.campaign.quality.check import noise_peak
from sysid.campaign.quality.defects import dead_spans, quiet_readings, responds, spikes
from sysid.campaign.records import Sensor
from sysid.wording import say_once

RUN = "bump_runs/case1_unloaded_16kmh_run1.csv"
SLOW_LOADED_RUN = "bump_runs/case4_loaded_8kmh_run1.csv"
FAST_RUN = "bump_runs/case3_unloaded_32kmh_run2.csv"
DROP = "plank_drops/axle3_drop2.csv"
NOISE_ONLY = "the reading shows noise only, no response to the test."


@pytest.fixture(scope="module")
def campaign(linear_truck_folder) -> Campaign:
    return read_campaign(linear_truck_folder)


@pytest.fixture(scope="module")
def source(campaign) -> Callable[[], Campaign]:
    """The campaign behind a function: hypothesis prints the arguments of a failing case, and this one is long."""
    return lambda: campaign


@pytest.fixture(scope="module")
def checked(campaign):
    return check_quality(campaign)


def only(campaign: Campaign, file: str, change: Callable[[Channel], Channel] = lambda c: c) -> Campaign:
    """The campaign with one log, its channels changed."""

    def edit(log: Log) -> Log:
        return replace(log, channels=tuple(change(c) for c in log.channels))

    return replace(
        campaign,
        bump_runs=tuple(replace(r, log=edit(r.log)) for r in campaign.bump_runs if r.log.file == file),
        plank_drops=tuple(replace(d, log=edit(d.log)) for d in campaign.plank_drops if d.log.file == file),
    )


def scaled(columns: set[str], factor: float) -> Callable[[Channel], Channel]:
    def change(channel: Channel) -> Channel:
        if channel.sensor.column not in columns:
            return channel
        value = channel.value * factor
        limit = channel.sensor.full_scale
        return replace(channel, value=value, censored=(np.sign(value) * (np.abs(value) >= limit)).astype(np.int8))

    return change


def edited(column: str, edit: Callable[[np.ndarray], None]) -> Callable[[Channel], Channel]:
    def change(channel: Channel) -> Channel:
        if channel.sensor.column != column:
            return channel
        value = channel.value.copy()
        edit(value)
        return replace(channel, value=value)

    return change


def without(channels: tuple[Channel, ...], columns: set[str]) -> tuple[Channel, ...]:
    return tuple(c for c in channels if c.sensor.column not in columns)


def finding(report, column: str):
    return next(f for f in report.channels if f.column == column)


def rejected(report) -> dict[str, str]:
    return {f.column: " ".join(f.messages) for f in report.channels if f.verdict == "rejected"}


def test_linear_truck_shows_its_planned_defects_and_nothing_else(checked):
    cleaned, report = checked
    said = {(f.file, f.column): f for f in report.channels if f.verdict != "good"}
    assert set(said) == {
        ("bump_runs/case2_unloaded_24kmh_run2.csv", "lvdt5_mm"),
        ("bump_runs/case3_unloaded_32kmh_run1.csv", "axle1_accel_g"),
        ("bump_runs/case3_unloaded_32kmh_run2.csv", "axle5_accel_g"),
    }
    assert all(f.verdict == "usable" for f in said.values())
    lost, clipped, full_scale = said.values()
    assert lost.dead_spans[0][0] == pytest.approx(2.4)
    assert "lost from 2.400 s to the end" in lost.messages[0]
    assert clipped.clip_level == pytest.approx(4.5 * 9.80665, rel=1e-9)
    assert "4.5 g" in clipped.messages[0]
    assert full_scale.clip_level == pytest.approx(10 * 9.80665, rel=1e-9)
    assert full_scale.clipped == 1
    assert len(report.messages) == 1
    assert "case1_unloaded_16kmh_run2.csv: 20 rows are missing (13 at 2.115 s, 7 at 5.020 s)" in report.messages[0]
    dropped = next(f for f in report.channels if f.file.endswith("16kmh_run2.csv"))
    assert [(round(s, 3), n) for s, n in dropped.gaps] == [(2.115, 13), (5.02, 7)]
    assert (len(cleaned.bump_runs), len(cleaned.plank_drops)) == (10, 18)
    assert len(report.channels) == 10 * 18 + 18 * 3


def test_undeclared_clipping_becomes_censored(campaign, checked):
    file = "bump_runs/case3_unloaded_32kmh_run1.csv"
    before, after = (
        next(c for r in k.bump_runs if r.log.file == file for c in r.log.channels if c.sensor.column == "axle1_accel_g")
        for k in (campaign, checked[0])
    )
    assert not before.censored.any()
    level = 4.5 * 9.80665
    assert (after.censored == 1).sum() == np.sum(before.value > level - 1e-6) > 3
    assert (after.censored == -1).sum() == np.sum(before.value < 1e-6 - level) > 0


def test_clipping_of_a_sensor_without_a_range_asks_for_it(campaign):
    """Amplifier at 4.5 g, as made; where the full scale of 10 g is declared, there is nothing to add."""
    file = "bump_runs/case3_unloaded_32kmh_run1.csv"
    (run,) = (r for r in campaign.bump_runs if r.log.file == file)
    for full_scale in (None, 10 * 9.80665):
        channels = tuple(
            replace(c, sensor=replace(c.sensor, full_scale=full_scale)) if c.sensor.column == "axle1_accel_g" else c
            for c in run.log.channels
        )
        changed = replace(campaign, bump_runs=(replace(run, log=replace(run.log, channels=channels)),), plank_drops=())
        (said,) = finding(check_quality(changed)[1], "axle1_accel_g").messages
        assert "clipped at 4.5 g" in said
        assert ("add range = 4.5 to its entry in [sensors]" in said) == (full_scale is None)


def test_rest_level_and_noise_of_the_quiet_start(checked):
    """Instrument truth: noise 0.3242 mm and 0.0184 g, offset 3.646 mm and bias -0.0005 g in this run."""
    report = checked[1]
    q = next(f for f in report.channels if (f.file, f.column) == (RUN, "lvdt1_mm"))
    assert q.noise_rms == pytest.approx(0.3242e-3, rel=0.15)
    assert q.rest_level == pytest.approx(3.646e-3, abs=4 * 0.3242e-3 / np.sqrt(200))
    a = next(f for f in report.channels if (f.file, f.column) == (RUN, "axle1_accel_g"))
    assert a.noise_rms == pytest.approx(0.0184 * 9.80665, rel=0.15)
    assert a.rate_hz == pytest.approx(200.0)
    assert a.jitter_s < 1e-9


UNIT_FAULTS = [
    (RUN, "lvdt4_mm", 1e-3, ["file is in m,", 'unit = "m"']),
    (RUN, "axle3_accel_g", 9.80665, ["file is in m/s^2", "not in g"]),
    (RUN, "frame2_accel_g", 9.80665, ["file is in m/s^2", "not in g"]),
    (RUN, "axle6_accel_g", 1e3, ["file is in mg"]),
    (SLOW_LOADED_RUN, "axle5_accel_g", 9.80665, ["file is in m/s^2"]),
    (SLOW_LOADED_RUN, "lvdt6_mm", 1e-3, ["file is in m,"]),
    (FAST_RUN, "frame6_accel_g", 9.80665, ["file is in m/s^2"]),
    (DROP, "frame_axle_mm", 1e-3, ["file is in m,"]),
    (DROP, "axle_accel_g", 9.80665, ["file is in m/s^2"]),
    (DROP, "frame_accel_g", 9.80665, ["file is in m/s^2"]),
    (RUN, "lvdt1_mm", -1.0, ["sign is flipped", "-1"]),
    (RUN, "axle4_accel_g", -1.0, ["sign is flipped"]),
    (RUN, "frame5_accel_g", -1.0, ["sign is flipped"]),
    (SLOW_LOADED_RUN, "frame1_accel_g", -1.0, ["sign is flipped"]),
    (FAST_RUN, "axle2_accel_g", -1.0, ["sign is flipped"]),
    (DROP, "frame_axle_mm", -1.0, ["sign is flipped"]),
    (DROP, "axle_accel_g", -1.0, ["sign is flipped"]),
    (DROP, "frame_accel_g", -1.0, ["sign is flipped"]),
    (RUN, "axle2_accel_g", -9.80665, ["file is in m/s^2 with a flipped sign"]),
]


@pytest.mark.parametrize(("file", "column", "factor", "words"), UNIT_FAULTS)
def test_wrong_unit_or_sign_of_one_channel_is_named(campaign, file, column, factor, words):
    cleaned, report = check_quality(only(campaign, file, scaled({column}, factor)))
    found = rejected(report)
    assert list(found) == [column]
    assert all(word in found[column] for word in words)
    assert any(column in m and file in m for m in report.messages)
    left = [c.sensor.column for t in (*cleaned.bump_runs, *cleaned.plank_drops) for c in t.log.channels]
    assert column not in left
    assert len(left) == len(report.channels) - 1


def _columns(campaign: Campaign, kinds: tuple[str, ...]) -> set[str]:
    return {c.sensor.column for c in campaign.bump_runs[0].log.channels if c.sensor.kind in kinds}


@pytest.mark.parametrize("file", [RUN, SLOW_LOADED_RUN, FAST_RUN])
@pytest.mark.parametrize(
    ("kinds", "factor", "words"),
    [
        (("suspension_deflection",), -1.0, "sign is flipped"),
        (("axle_acceleration", "body_acceleration"), -1.0, "sign is flipped"),
        (("axle_acceleration", "body_acceleration", "suspension_deflection"), -1.0, "all signs are flipped"),
        (("axle_acceleration", "body_acceleration"), 9.80665, "m/s^2"),
        (("suspension_deflection",), 1e-3, "file is in m,"),
    ],
)
def test_wrong_convention_of_all_sensors_of_a_kind(campaign, file, kinds, factor, words):
    columns = _columns(campaign, kinds)
    _, report = check_quality(only(campaign, file, scaled(columns, factor)))
    found = rejected(report)
    assert set(found) == columns
    assert all(words in text for text in found.values())


def exchanged(campaign: Campaign, file: str, *pairs: tuple[str, str]) -> Campaign:
    run = next(r for r in campaign.bump_runs if r.log.file == file)
    by_name = {c.sensor.column: c for c in run.log.channels}
    other = {a: b for x, y in pairs for a, b in ((x, y), (y, x))}
    return only(
        campaign,
        file,
        lambda c: replace(by_name[other[c.sensor.column]], sensor=c.sensor) if c.sensor.column in other else c,
    )


@pytest.mark.parametrize("file", [RUN, SLOW_LOADED_RUN, FAST_RUN])
@pytest.mark.parametrize(
    "pairs",
    [
        [("lvdt4_mm", "lvdt5_mm")],
        [("axle4_accel_g", "axle5_accel_g")],
        [("axle2_accel_g", "axle3_accel_g")],
        [("axle1_accel_g", "frame1_accel_g")],
        [("lvdt4_mm", "lvdt5_mm"), ("axle4_accel_g", "axle5_accel_g")],
    ],
    ids=lambda pairs: "+".join("/".join(p) for p in pairs),
)
def test_exchanged_columns_are_named(campaign, file, pairs):
    _, report = check_quality(exchanged(campaign, file, *pairs))
    found = rejected(report)
    assert set(found) == {c for pair in pairs for c in pair}
    for pair in pairs:
        for column in pair:
            assert f"'{pair[0]}' and '{pair[1]}' are exchanged" in found[column]


@pytest.mark.parametrize("file", [RUN, SLOW_LOADED_RUN, FAST_RUN, DROP])
def test_healthy_log_without_frame_sensors_is_silent(campaign, file):
    def drop_frames(log: Log) -> Log:
        return replace(log, channels=tuple(c for c in log.channels if c.sensor.kind != "body_acceleration"))

    one = only(campaign, file)
    one = replace(
        one,
        bump_runs=tuple(replace(r, log=drop_frames(r.log)) for r in one.bump_runs),
        plank_drops=tuple(replace(d, log=drop_frames(d.log)) for d in one.plank_drops),
    )
    _, report = check_quality(one)
    assert rejected(report) == {}
    flipped = only(one, file, scaled({"lvdt1_mm", "frame_axle_mm"}, -1.0))
    assert len(rejected(check_quality(flipped)[1])) == 1


def test_dead_channel(campaign):
    _, report = check_quality(only(campaign, RUN, edited("lvdt2_mm", lambda v: v.fill(0.012))))
    assert rejected(report) == {"lvdt2_mm": "the reading does not change from 12 mm: the sensor is dead."}


def test_empty_channel(campaign):
    _, report = check_quality(only(campaign, RUN, edited("lvdt2_mm", lambda v: v.fill(np.nan))))
    assert rejected(report) == {"lvdt2_mm": "the column is empty."}


def test_frozen_span_becomes_missing(campaign):
    def freeze(value):
        value[500:700] = value[500]

    cleaned, report = check_quality(only(campaign, RUN, edited("axle4_accel_g", freeze)))
    found = finding(report, "axle4_accel_g")
    assert found.verdict == "usable"
    assert found.dead_spans == ((pytest.approx(2.5), pytest.approx(3.495)),)
    channel = next(c for c in cleaned.bump_runs[0].log.channels if c.sensor.column == "axle4_accel_g")
    assert np.isnan(channel.value[500:700]).all()
    assert np.isfinite(channel.value[:500]).all()


LVDT = "lvdt2_mm"


def coarse(channel: Channel, step: float = 5e-4) -> Channel:
    """Without the noise, and by steps of 0.5 mm: it repeats one reading while the truck stands."""
    if channel.sensor.column != LVDT:
        return channel
    smooth = sosfiltfilt(butter(4, 15.0, fs=200.0, output="sos"), channel.value)
    return replace(channel, value=step * np.round(smooth / step))


def test_a_coarse_sensor_at_rest_is_not_dead(campaign):
    cleaned, report = check_quality(only(campaign, RUN, coarse))
    found = finding(report, LVDT)
    assert found.dead_spans == ()
    assert not [m for m in found.messages if "does not change" in m]
    channel = next(c for c in cleaned.bump_runs[0].log.channels if c.sensor.column == LVDT)
    assert np.isfinite(channel.value).all()
    # It did stand still for more than a quarter of a second, and changed with most samples elsewhere.
    repeats = np.diff(channel.value) == 0.0
    assert repeats[:50].all()
    assert repeats.mean() < 0.5


def test_a_coarse_sensor_that_hangs_while_the_truck_moves_is_dead(campaign):
    """Negative control: the same sensor hangs for 0.5 s where the others move."""

    def hangs(channel: Channel) -> Channel:
        changed = coarse(channel, 3e-4)
        if channel.sensor.column == LVDT:
            changed.value[500:600] = changed.value[500]
        return changed

    _, report = check_quality(only(campaign, RUN, hangs))
    ((first, last),) = finding(report, LVDT).dead_spans
    assert (first, last) == (pytest.approx(2.5, abs=0.02), pytest.approx(2.995, abs=0.02))


def test_alone_in_its_log_a_sensor_is_dead_if_it_stops_amid_motion():
    """Ringing after a start at rest, and the same that hangs at full speed."""
    time = np.arange(700) / 200.0
    motion = np.where(time > 0.5, 0.04 * np.sin(4.0 * np.pi * (time - 0.5)) * np.exp(-0.7 * (time - 0.5)), 0.0)
    value = 1e-4 * np.round(motion / 1e-4)
    dead, at_rest = dead_spans(time, value, np.zeros(700, np.int8))
    assert dead == []
    assert at_rest[0] == (0, pytest.approx(101, abs=1))
    value[300:420] = value[300]
    dead, _ = dead_spans(time, value, np.zeros(700, np.int8))
    assert dead == [(300, 420)]


@pytest.mark.parametrize("readings", [200, 2_000, 20_000])
def test_the_peak_of_noise_is_passed_by_one_record_in_a_hundred(readings: int):
    """Of 4,000 simulated records; the standard error of the share is 0.0016."""
    random = np.random.default_rng(3)
    peaks = [np.abs(random.standard_normal(readings)).max() for _ in range(4000)]
    assert np.mean(np.array(peaks) > noise_peak(readings)) == pytest.approx(0.01, abs=0.005)


def test_noise_is_no_response_however_long_the_record(campaign):
    """Of 120,000 readings of noise some are beyond 4.5 rms in 56 % of records (1 - (2 Phi(4.5) - 1)^n)."""

    def longer(channel: Channel) -> Channel:
        time = np.linspace(channel.time_s[0], channel.time_s[-1], 120_000)
        value = np.interp(time, channel.time_s, channel.value)
        if channel.sensor.column == LVDT:
            value = 2e-4 * np.random.default_rng(2).standard_normal(time.size)
            assert np.abs(value).max() > 4.55 * np.std(value)
        return replace(channel, time_s=time, value=value, censored=np.zeros(time.size, np.int8))

    long = only(campaign, RUN, longer)
    runs = tuple(replace(r, log=replace(r.log, sample_interval_s=6.9 / 120_000)) for r in long.bump_runs)
    _, report = check_quality(replace(long, bump_runs=runs))
    assert rejected(report)[LVDT] == NOISE_ONLY


def test_spikes_become_missing(campaign):
    def spike(value):
        value[[300, 640, 900]] += [0.06, -0.08, 0.07]

    cleaned, report = check_quality(only(campaign, RUN, edited("lvdt3_mm", spike)))
    assert "3 isolated spikes (the first at 1.500 s)" in finding(report, "lvdt3_mm").messages[0]
    channel = next(c for c in cleaned.bump_runs[0].log.channels if c.sensor.column == "lvdt3_mm")
    assert np.flatnonzero(np.isnan(channel.value)).tolist() == [300, 640, 900]


def test_loose_connection_is_rejected(campaign):
    def shake(value):
        value[::40] += 0.08

    _, report = check_quality(only(campaign, RUN, edited("lvdt3_mm", shake)))
    assert "loose" in rejected(report)["lvdt3_mm"]


def test_noise_only_is_rejected(campaign):
    noise = 1e-3 * np.random.default_rng(5).normal(size=10_000)

    def deafen(value):
        value[:] = np.round(noise[: value.size], 5)

    _, report = check_quality(only(campaign, RUN, edited("lvdt3_mm", deafen)))
    assert rejected(report) == {"lvdt3_mm": NOISE_ONLY}


@pytest.mark.parametrize(("height_m_s2", "told"), [(0.7, {}), (0.0, {"frame4_accel_g": NOISE_ONLY})])
def test_slow_motion_below_its_noise_is_a_response(campaign, height_m_s2, told):
    """Half a cosine of 1 s in noise of 0.3 m/s2, which no reading leaves; without it, noise is noise."""

    def slow(channel: Channel) -> Channel:
        time = channel.time_s
        noise = 0.3 * np.sqrt(3.0) * np.random.default_rng(11).uniform(-1.0, 1.0, time.size)
        motion = np.where(np.abs(time - 3.0) < 0.5, np.cos(np.pi * (time - 3.0)), 0.0)
        value = noise + height_m_s2 * motion
        assert np.abs(value).max() < 0.3 * noise_peak(time.size)
        return replace(channel, value=value)

    # The other sensors of its axle would say that it is another motion.
    beside = {"axle4_accel_g", "lvdt4_mm"}
    changed = only(campaign, RUN, lambda c: slow(c) if c.sensor.column == "frame4_accel_g" else c)
    runs = [replace(r, log=replace(r.log, channels=without(r.log.channels, beside))) for r in changed.bump_runs]
    _, report = check_quality(replace(changed, bump_runs=tuple(runs)))
    assert rejected(report) == told


@pytest.mark.parametrize(("height_m_s2", "share"), [(0.0, 0.0), (0.8, 1.0)])
def test_averages_respond_to_slow_motion_and_not_to_noise(height_m_s2, share):
    """Of 200 records of normal noise of 0.3 m/s2, some of which their largest reading tells nothing of."""
    time = np.arange(1600) / 200.0
    motion = np.where(np.abs(time - 3.0) < 0.5, np.cos(np.pi * (time - 3.0)), 0.0)
    responses = []
    for seed in range(200):
        value = 0.3 * np.random.default_rng(seed).standard_normal(time.size) + height_m_s2 * motion
        sensor = Sensor("axle1_accel_g", "axle_acceleration", "g", axle=0)
        channel = Channel(sensor, time, value, np.zeros(time.size, np.int8))
        responses.append(responds(channel, quiet_readings(channel, 1.2), noise_peak(2 * time.size)))
    assert np.mean(responses) == pytest.approx(share, abs=0.02)


def test_short_and_slow_logs_are_left_out(campaign):
    def cut(step: slice) -> Callable[[Channel], Channel]:
        return lambda c: replace(c, time_s=c.time_s[step], value=c.value[step], censored=c.censored[step])

    cleaned, report = check_quality(only(campaign, RUN, cut(slice(0, 3))))
    assert cleaned.bump_runs == ()
    assert "holds 3 samples" in report.channels[0].messages[0]
    assert any("left out" in m for m in report.messages)
    # Thirty readings at 2 kHz: fewer than the search for the passage looks at.
    brief = only(campaign, RUN, lambda c: replace(cut(slice(0, 30))(c), time_s=0.0005 * np.arange(30)))
    run = brief.bump_runs[0]
    cleaned, report = check_quality(
        replace(brief, bump_runs=(replace(run, log=replace(run.log, sample_interval_s=0.0005)),))
    )
    assert cleaned.bump_runs == ()
    assert "the log is 0.015 s long, expected at least 0.1 s" in rejected(report)["lvdt1_mm"]
    slow = only(campaign, RUN, lambda c: replace(c, time_s=80.0 * c.time_s))
    run = slow.bump_runs[0]
    slow = replace(slow, bump_runs=(replace(run, log=replace(run.log, sample_interval_s=0.4)),))
    cleaned, report = check_quality(slow)
    assert cleaned.bump_runs == ()
    assert "sampled at 2.5 Hz, expected at least 20 Hz" in rejected(report)["lvdt1_mm"]


def test_clipping_is_told_from_peaks_that_the_resolution_flattens():
    time = np.arange(0.0, 5.0, 0.005)
    smooth = 3.0 * np.sin(2.0 * np.pi * 0.5 * time) * np.exp(-0.02 * time)
    assert clip_levels(np.round(smooth, 2)) == (None, None)
    steep = 3.0 * np.sin(30.3 * time)
    assert clip_levels(np.round(np.clip(steep, -2.0, 2.0), 3)) == (2.0, -2.0)
    assert clip_levels(np.round(np.clip(steep, -4.0, 1.5), 3))[0] == 1.5


@pytest.mark.parametrize("file", [r"bump_runs/case2_unloaded_24kmh_run1.csv", SLOW_LOADED_RUN])
def test_healthy_log_at_another_rate_is_silent(campaign, file):
    """Every second sample: a campaign at 100 Hz."""
    half = only(
        campaign, file, lambda c: replace(c, time_s=c.time_s[1::2], value=c.value[1::2], censored=c.censored[1::2])
    )
    run = half.bump_runs[0]
    half = replace(half, bump_runs=(replace(run, log=replace(run.log, sample_interval_s=0.01)),))
    assert {f.verdict for f in check_quality(half)[1].channels} == {"good"}


def test_record_without_quiet_start_is_said(campaign):
    late = only(
        campaign,
        RUN,
        lambda c: replace(c, time_s=c.time_s[240:] - c.time_s[240], value=c.value[240:], censored=c.censored[240:]),
    )
    _, report = check_quality(late)
    assert any("moves from the first sample on" in m for m in report.messages)
    assert finding(report, "lvdt1_mm").rest_level is None
    assert rejected(report) == {}


def test_the_campaign_given_is_not_changed(campaign):
    before = [c.value.copy() for r in campaign.bump_runs for c in r.log.channels]
    check_quality(campaign)
    after = [c.value for r in campaign.bump_runs for c in r.log.channels]
    assert all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))


def test_quality_table(checked):
    table = quality_table(checked[1])
    assert len(table) == len(checked[1].channels)
    row = table[(table["file"] == "bump_runs/case1_unloaded_16kmh_run2.csv") & (table["column"] == "lvdt1_mm")].iloc[0]
    assert row["gap_rows"] == 20
    assert row["verdict"] == "good"


@settings(max_examples=60, derandomize=True, deadline=None)
@given(
    st.integers(0, 10_000),
    st.sampled_from([2, 3, 19, 21, 45, 220, 600]),
    st.sampled_from(["noise", "zeros", "empty", "step", "sparse", "huge", "tiny", "clipped"]),
    st.floats(1e-3, 0.04),
)
def test_no_record_ends_in_a_traceback(source, seed, samples, shape, step):
    """Records without any sense give verdicts, without an exception or a warning of the numerics."""
    rng = np.random.default_rng(seed)
    time = step * np.cumsum(rng.choice([1, 1, 1, 2, 30], size=samples))

    def nonsense(channel: Channel) -> Channel:
        value = rng.normal(size=samples)
        if rng.random() < 0.7:
            value = {
                "noise": value,
                "zeros": np.zeros(samples),
                "empty": np.full(samples, np.nan),
                "step": np.where(np.arange(samples) > samples // 2, 1.0, 0.0),
                "sparse": np.where(rng.random(samples) < 0.8, np.nan, value),
                "huge": 1e150 * value,
                "tiny": 1e-200 * value,
                "clipped": np.clip(value, -0.3, 0.3),
            }[shape]
        return replace(channel, time_s=time, value=value, censored=np.zeros(samples, np.int8))

    strange = only(source(), RUN, nonsense)
    run = strange.bump_runs[0]
    strange = replace(strange, bump_runs=(replace(run, log=replace(run.log, sample_interval_s=step)),))
    cleaned, report = check_quality(strange)
    assert len(report.channels) == 18
    assert sum(f.verdict != "rejected" for f in report.channels) == sum(len(r.log.channels) for r in cleaned.bump_runs)


def test_what_many_logs_share_is_said_once():
    same = [(f"r{i}.csv", f"r{i}.csv: the column 'a' is missing; the sensor is left out there.") for i in range(4)]
    own = [("r1.csv", "r1.csv: 3 rows are missing."), ("r2.csv", "r2.csv: 3 rows are missing.")]
    assert say_once([same[0], *own, *same[1:]]) == [
        "4 logs (r0.csv and others): the column 'a' is missing; the sensor is left out there.",
        "r1.csv: 3 rows are missing.",
        "r2.csv: 3 rows are missing.",
    ]
    assert say_once([]) == []


def test_three_equal_readings_at_a_noisy_peak_are_chance_and_four_are_not():
    random = np.random.default_rng(3)
    time = np.arange(0.0, 4.4, 0.005)
    # A noise of 15 steps of the resolution, as of an accelerometer that writes mg.
    peak = np.round(0.45 * np.exp(-((time - 1.02) ** 2) / 0.002) + 0.015 * random.normal(size=time.size), 3)
    peak = np.minimum(peak, 0.44)
    k = int(np.argmax(peak))
    for row, expected in ((3, None), (4, 0.462)):
        value = peak.copy()
        value[k : k + row] = 0.462
        assert clip_levels(value) == (expected, None)


#: Readings [g] of a simulated axle after its wheels fell off the plank, 5 ms apart.
CHATTER = [0.204, 0.189, 0.164, 0.105, 0.152, 0.151, 0.014, 0.143, -0.056, -0.191, -0.034, -0.198, -0.322, -0.162]
CHATTER += [
    -0.171,
    -0.537,
    -0.19,
    -0.17,
    -0.428,
    0.009,
    -0.203,
    -0.206,
    0.045,
    -0.136,
    -0.117,
    -0.044,
    -0.066,
    -0.08,
    -0.136,
]


def test_an_axle_that_chatters_has_no_spikes():
    random = np.random.default_rng(4)
    rest = 0.022 * random.normal(size=880)
    rest[170:190] += np.linspace(-1.2, 1.2, 20)
    chatter = rest.copy()
    chatter[210 : 210 + len(CHATTER)] = CHATTER
    assert spikes(chatter).size == 0
    # The same departure where nothing else departs, once and twice, is one.
    for at in ([225], [225, 231]):
        lost = rest.copy()
        lost[at] -= 0.4
        assert spikes(lost).tolist() == at


@pytest.mark.parametrize("end", ["late", "early"])
@pytest.mark.parametrize("held", ["zero", "last"])
def test_a_module_that_starts_late_or_ends_early_is_no_drift(campaign, end, held):
    """Half a second of one value at an end of the record, beside which the sensor is alive while the truck rests."""

    def edit(value: np.ndarray) -> None:
        n = 100
        if end == "late":
            value[:n] = 0.0 if held == "zero" else value[n]
        else:
            value[-n:] = 0.0 if held == "zero" else value[-n - 1]

    cleaned, report = check_quality(only(campaign, SLOW_LOADED_RUN, edited("lvdt3_mm", edit)))
    found = finding(report, "lvdt3_mm")
    (span,) = found.dead_spans
    assert span[1] - span[0] == pytest.approx(0.5, abs=0.02)
    assert "does not change" in " ".join(found.messages)
    assert not any("drifts" in m or "slipped" in m for m in found.messages)
    assert found.verdict == "usable"
    (run,) = cleaned.bump_runs
    (channel,) = [c for c in run.log.channels if c.sensor.column == "lvdt3_mm"]
    assert np.isnan(channel.value[:90] if end == "late" else channel.value[-90:]).all()
