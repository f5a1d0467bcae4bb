"""Runs of two loggers with clocks of their own: both on one clock to two milliseconds, or a sentence."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from synthetic_campaign import Physics
from two_loggers import SecondClock, duplicate_logs, late_s, loggers_declared, simulate_logs

from sysid.campaign import Campaign, check_quality, read_campaign
from sysid.campaign.clocks.sync import sync_lag
from sysid.cli.main import cli
from sysid.errors import CampaignError, DataRejectedError

DATA = Path(__file__).resolve().parents[2] / "data"
#: What is asked for, and standard deviations that may not be passed.
NEAR_S, SURE = 2e-3, 4.0
#: 200 ms and 100 ppm apart.
CLOCK = SecondClock(0.2, 1e-4)
CONTINUOUS, PER_LOG, SHARED = ('clock = "continuous"', 'clock = "per_log"', 'clock = "shared"')


def axles_from(first: int) -> Callable[[str], bool]:
    """All columns of the axles from one on."""
    return lambda column: bool(re.match(rf"(lvdt|axle|frame)[{first}-6]_", column))


def deflections(column: str) -> bool:
    return column.startswith("lvdt")


@pytest.fixture(scope="module")
def shipped(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("shipped") / "two"
    duplicate_logs(DATA, folder, CLOCK)
    return folder


@pytest.fixture(scope="module")
def three_axles(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("simulated") / "two"
    simulate_logs(folder, Physics(drops_per_axle=0), CLOCK)
    return folder


def declare(folder: Path, to: str, *arguments, **choices) -> Path:
    """Another campaign file in the folder, with two loggers."""
    text = loggers_declared((folder / "campaign.toml").read_text(encoding="utf-8"), *arguments, **choices)
    file = folder / f"{to}.toml"
    file.write_text(text, encoding="utf-8")
    return file


def check(file: Path, output: Path) -> Result:
    return CliRunner().invoke(cli, ["check", str(file), "--output", str(output)], env={"COLUMNS": "200"})


def read(folder: Path, *arguments, **choices) -> Campaign:
    return read_campaign(declare(folder, "two loggers", *arguments, **choices))


@pytest.mark.parametrize("second", [axles_from(4), deflections], ids=["trailer", "deflections"])
def test_shipped_campaign_split_in_two(shipped, second):
    # With the first stamps of both logs subtracted, what is left is 0.1 ms per second of the run.
    campaign = read(shipped, second, CONTINUOUS)
    assert len(campaign.clocks) == 10
    for clock in campaign.clocks:
        assert (clock.complaint, clock.caution) == ("", "")
        assert abs(clock.offset_s - 1e-4 * clock.at_s) < min(NEAR_S, SURE * clock.sd_s)
        assert clock.sd_s < 1e-3
        assert abs(clock.rate - 1e-4) < SURE * clock.rate_sd < 5e-6
    channels = {c.sensor.column: c for c in campaign.bump_runs[0].log.channels}
    rows = np.loadtxt(DATA / campaign.bump_runs[0].log.file, delimiter=",", skiprows=1)
    names = (DATA / campaign.bump_runs[0].log.file).read_text(encoding="utf-8").splitlines()[0].split(",")
    assert sorted(channels) == sorted(names[1:])
    for name, channel in channels.items():
        # Readings as they were, up to one before the first logger began, at the times that they were taken.
        shown = rows[-channel.value.size :, names.index(name)] * (1e-3 if channel.sensor.unit == "mm" else 9.80665)
        assert channel.value == pytest.approx(shown, abs=1e-12)
        assert np.max(np.abs(channel.time_s - rows[-channel.value.size :, 0])) < NEAR_S
        assert channel.value.size >= len(rows) - 1


@pytest.mark.parametrize("kind", [CONTINUOUS, PER_LOG])
@pytest.mark.parametrize("first", [2, 3])
def test_three_axle_truck(three_axles, kind, first):
    campaign = read(three_axles, axles_from(first), kind)
    assert len(campaign.clocks) == 6
    order = sorted(clock.file for clock in campaign.clocks)
    for clock in campaign.clocks:
        off = clock.offset_s - late_s(order.index(clock.file)) - 1e-4 * clock.at_s
        assert abs(off) < min(NEAR_S, SURE * clock.sd_s)
        assert clock.method == ("motion" if kind == PER_LOG else "all runs")


def test_a_clock_that_is_declared_as_shared_and_is_not_fails_the_check(three_axles, tmp_path):
    # The negative control: the same logs, with nothing put right.
    right = declare(three_axles, "right", axles_from(3), PER_LOG)
    done = check(right, tmp_path / "right")
    assert done.exit_code == 0
    assert "Clocks" in done.output
    assert "motion" in done.output
    wrong = declare(three_axles, "wrong", axles_from(3), SHARED)
    assert check(wrong, tmp_path / "wrong").exit_code == 3
    campaign, report = check_quality(read_campaign(wrong))
    assert len(report.left_out) == 6
    assert "is declared as shared, but the motion that both loggers see shows it" in report.left_out[0]
    columns = {c.sensor.column for run in campaign.bump_runs for c in run.log.channels}
    assert not any(map(axles_from(3), columns))


def test_a_common_signal_counts_first(three_axles, tmp_path):
    folder = tmp_path / "two"
    shutil.copytree(three_axles, folder)
    rng = np.random.default_rng(3)
    for k, file in enumerate(sorted(p for p in (folder / "bump_runs").glob("*.csv") if "second" not in p.name)):
        # A switch that is pressed three times; on purpose 30 ms from what the motion says.
        presses = np.sort(rng.uniform(1.0, 3.0, 3))
        _add_pulses(file, presses)
        _add_pulses(file.with_name(f"second_{file.name}"), presses - 0.13, 5.0 if k % 2 else -5.0)
    text = loggers_declared(
        (folder / "campaign.toml").read_text(encoding="utf-8"), axles_from(2), f'{PER_LOG}\nsync = "pulse"'
    )
    text = text.replace('name = "tractor box"', 'name = "tractor box"\nsync = "pulse"')
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    for found in read_campaign(folder).clocks:
        assert found.method == "sync"
        assert abs(found.offset_s - 0.13) < SURE * found.sd_s
        assert found.sd_s < 2.5e-3


def _add_pulses(file: Path, begins_s: np.ndarray, volts: float = 5.0) -> None:
    head, *rows = file.read_text(encoding="utf-8").splitlines()
    time = np.array([float(row.split(",", 1)[0]) for row in rows])
    time = time - time[0]
    level = volts * ((time[:, None] >= begins_s) & (time[:, None] < begins_s + 0.1)).any(axis=1)
    lines = [f"{head},pulse", *(f"{row},{v:.2f}" for row, v in zip(rows, level, strict=True))]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")


def chirp(time: np.ndarray) -> np.ndarray:
    return np.sin(2.0 * np.pi * (0.5 * time + 0.3 * time**2)) * np.exp(-(((time - 5.0) / 2.0) ** 2))


@pytest.mark.parametrize("lag", [-3.217, 0.0, 0.2034, 4.4])
def test_lag_of_a_common_signal_at_unlike_rates(lag):
    rng = np.random.default_rng(11)
    first, second = np.arange(0.0, 10.0, 0.005), np.arange(0.0, 10.0, 0.002) - lag
    a = chirp(first) + 0.02 * rng.normal(size=first.size)
    b = 0.3 - 2.0 * chirp(second + lag) + 0.02 * rng.normal(size=second.size)
    found = sync_lag((first, a), (second, b), (-6.0, 6.0))
    assert found is not None
    assert abs(found.lag_s - lag) < min(1e-3, SURE * found.sd_s)
    assert found.sd_s < 1.5e-3


def test_even_pulses_and_other_signals_show_no_lag():
    time = np.arange(0.0, 10.0, 0.005)
    even = (np.mod(time, 1.0) < 0.2).astype(float)
    noise = np.random.default_rng(5).normal(size=(2, time.size))
    assert sync_lag((time, even), (time, even), (-5.0, 5.0)) is None
    assert sync_lag((time, noise[0]), (time, noise[1]), (-5.0, 5.0)) is None
    assert sync_lag((time, np.zeros(time.size)), (time, even), (-5.0, 5.0)) is None
    # A pulse every second is clear as long as less than half a second is possible.
    assert sync_lag((time, even), (time, even), (-0.4, 0.4)) is not None


def test_offset_and_rate_beyond_their_bounds_are_one_sentence(three_axles, tmp_path):
    with pytest.raises(DataRejectedError, match=r"runs \d+ ppm .* and at most 40 ppm about 0 are declared"):
        read(three_axles, axles_from(2), f"{CONTINUOUS}\nrate_within_ppm = 40")
    bounded = declare(three_axles, "bounded", axles_from(2), f"{PER_LOG}\noffset_within_s = 0.05")
    with pytest.raises(DataRejectedError, match=r"is 0\.1\d\d s .*offset_within_s = 0\.05 is declared"):
        read_campaign(bounded)
    assert check(bounded, tmp_path / "out").exit_code == 3


def test_a_log_of_another_run_is_left_out(three_axles, tmp_path):
    shutil.copytree(three_axles, tmp_path / "two")
    right, wrong = (tmp_path / "two" / "bump_runs" / f"second_{c}_24kmh_run1.csv" for c in ("empty", "laden"))
    stamps = [line.split(",", 1)[0] for line in wrong.read_text(encoding="utf-8").splitlines()]
    readings = [line.split(",", 1)[1] for line in right.read_text(encoding="utf-8").splitlines()]
    pairs = zip(stamps, readings, strict=False)
    wrong.write_text("\n".join(f"{t},{values}" for t, values in pairs) + "\n", encoding="utf-8")
    (found,) = [c for c in read(tmp_path / "two", axles_from(2), CONTINUOUS).clocks if c.complaint]
    assert found.other_file == "bump_runs/second_laden_24kmh_run1.csv"
    assert "away from a clock that runs on from the other runs" in found.complaint


def test_deflections_alone_are_left_out_with_a_sentence(shipped):
    # Nothing else of these axles on either logger.
    kept = {"runs": lambda name: name.startswith("case2"), "sensors": lambda c: not re.match("(axle|frame)[4-6]_", c)}
    campaign, report = check_quality(read(shipped, axles_from(4), PER_LOG, **kept))
    assert len(report.left_out) == 2
    assert all("neither a common signal nor common motion nor arrivals" in text for text in report.left_out)
    assert {c.sensor.column for c in campaign.bump_runs[0].log.channels}.isdisjoint({f"lvdt{i}_mm" for i in (4, 5, 6)})


def test_axle_accelerations_alone_show_the_clock_coarsely(shipped):
    kept = {
        "runs": lambda name: name[:5] in ("case1", "case5"),
        "sensors": lambda c: not re.match("(lvdt|frame)[4-6]_", c),
    }
    for clock in read(shipped, axles_from(4), PER_LOG, **kept).clocks:
        assert clock.method == "arrivals"
        assert 5e-3 < clock.sd_s < 6e-2
        assert abs(clock.offset_s) < SURE * clock.sd_s
        assert "ms only (standard deviation, by the arrival of the axles)" in clock.complaint + clock.caution


REPLACED = [
    ('name = "trailer box"', 'name = "tractor box"', "logger names 'tractor box' twice"),
    ('logger = "trailer box", kind', 'logger = "trailer bx", kind', "'trailer bx', which is no logger"),
    ('"tractor box" = "bump_runs/', '"tracktor box" = "bump_runs/', "'tracktor box', which is no logger"),
    ('{ "tractor box" = "bump_runs/empty_16kmh_run1.csv", ', "{ ", "has no log of 'tractor box'"),
    ("files = {", 'file = "a.csv", files = {', "needs its log; give file, or files with one log per logger"),
    ('logger = "trailer box", kind', "kind", "is a log of 'trailer box', which has no sensor"),
]


@pytest.mark.parametrize(("old", "new", "sentence"), REPLACED, ids=[s for *_, s in REPLACED])
def test_loggers_that_are_not_declared_right(three_axles, old, new, sentence):
    file = declare(three_axles, "declared", axles_from(2), CONTINUOUS)
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CampaignError, match=re.escape(sentence)):
        read_campaign(file, planned=True)


def test_without_loggers_there_are_no_files_of_loggers(three_axles):
    file = declare(three_axles, "none", axles_from(2), CONTINUOUS)
    text = re.sub(r"\[\[logger\]\]\nname.*\n(clock.*\n)?", "", file.read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError, match=r"but there is no \[\[logger\]\]"):
        read_campaign(file)


def test_a_planned_campaign_of_two_loggers_has_all_sensors(three_axles, tmp_path):
    file = declare(three_axles, "planned", axles_from(2), CONTINUOUS)
    shutil.copy(file, tmp_path / "campaign.toml")
    shutil.copy(three_axles / "bump_scan.csv", tmp_path / "bump_scan.csv")
    campaign = read_campaign(tmp_path, planned=True)
    assert [len(run.log.channels) for run in campaign.bump_runs] == [9] * 6
    assert campaign.clocks == ()
