"""Faults of a test day, each named in its pass; the logs are those of the shipped linear truck."""

from __future__ import annotations

import io
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from sysid.errors import CampaignError
from sysid.watch import DayReport, LogVerdict, TestDay

SOURCE = Path(__file__).parents[2] / "examples" / "linear_truck"
RUNS = [f"bump_runs/case{c}.csv" for c in ("1_unloaded_16kmh_run1", "1_unloaded_16kmh_run2", "2_unloaded_24kmh_run1")]
FOURTH, LOADED = "bump_runs/case2_unloaded_24kmh_run2.csv", "bump_runs/case5_loaded_16kmh_run1.csv"
DROP = "plank_drops/axle1_drop1.csv"


class _Clock:
    """A clock on which every look comes two seconds after the last one."""

    now = 0.0

    def __call__(self) -> float:
        self.now += 2.0
        return self.now


class _Track:
    """The folder of a logger and the watch on it; without the scan logs are not compared with each other."""

    def __init__(self, root: Path, *names: str):
        self.folder, self.output = root / "logger", root / "out"
        self.folder.mkdir(parents=True)
        for name in names:
            self.land(name)
        self.begin()

    def begin(self) -> None:
        self.day = TestDay(self.folder, self.output, estimates=False, clock=_Clock())

    def land(self, name: str, text: str | None = None, to: str | None = None) -> Path:
        path = self.folder / (to or name)
        path.parent.mkdir(exist_ok=True)
        path.write_text((SOURCE / name).read_text() if text is None else text)
        return path

    def report(self) -> DayReport:
        """What is said after as many looks as complete files take."""
        found = [r for r in (self.day.look(), self.day.look()) if r is not None]
        return replace(found[-1], remarks=tuple(remark for r in found for remark in r.remarks))

    def verdict(self, name: str) -> LogVerdict:
        return next(v for v in self.report().logs if v.file == name)


def _changed(name: str, factor: float, *columns: str) -> str:
    """A log whose columns (all of its sensors if none is named) are multiplied."""
    table = pd.read_csv(io.StringIO((SOURCE / name).read_text()), comment="#")
    for column in columns or table.columns[1:]:
        table[column] = factor * table[column]
    return table.to_csv(index=False)


@pytest.fixture
def track(tmp_path: Path) -> _Track:
    return _Track(tmp_path, "campaign.toml")


def test_a_good_log_and_what_is_to_come(track: _Track) -> None:
    track.land(RUNS[0])
    report = track.report()
    (verdict,) = report.new
    assert (verdict.file, verdict.test, verdict.answer) == (RUNS[0], "run, unloaded, 16 km/h, repeat 1", "good")
    assert [t.files for t in report.planned if t.there] == [(RUNS[0],)]
    assert report.next_tests[0] == "Next in the list: drop, front steer, unloaded (27 to come)."
    assert not report.enough
    assert "bump_scan.csv, the bump, is not there yet." in report.missing
    # Nothing new, nothing said.
    assert track.day.look() is None


def test_a_log_that_is_written_while_it_is_read_waits(track: _Track) -> None:
    text = (SOURCE / RUNS[0]).read_text()
    for share in (3, 2):
        track.land(RUNS[0], text[: len(text) // share])
        report = track.day.look()
        assert report is None or report.logs == ()
        assert track.day.growing == (RUNS[0],)
    track.land(RUNS[0])
    assert track.verdict(RUNS[0]).answer == "good"


def test_a_sensor_that_dies_at_run_4(track: _Track) -> None:
    for name in RUNS:
        track.land(name)
    assert {v.answer for v in track.report().logs} == {"good"}
    track.land(FOURTH, _changed(FOURTH, 0.0, "lvdt3_mm"))
    report = track.report()
    (verdict,) = report.new
    assert (verdict.file, verdict.answer) == (FOURTH, "repeat")
    assert verdict.reasons[0].startswith("lvdt3_mm: the reading does not change")
    # The repeat takes its place; of the sensor that fell silent on the way somebody has to look after.
    track.land(FOURTH)
    (verdict,) = track.report().new
    assert verdict.answer == "look"
    assert verdict.reasons == ("lvdt5_mm: the reading is lost from 2.400 s to the end; that span is left out.",)
    assert "it takes the place of another log of this name." in verdict.notes


def test_a_sensor_that_is_not_in_the_log(track: _Track) -> None:
    text = (SOURCE / RUNS[0]).read_text()
    track.land(RUNS[0], text.replace("lvdt3_mm", "lvdt7_mm", 1))
    verdict = track.verdict(RUNS[0])
    assert verdict.answer == "look"
    assert verdict.reasons == (
        "the column 'lvdt3_mm' is missing (the file has 'lvdt7_mm'); the sensor is left out there.",
    )


def test_a_renamed_log(track: _Track) -> None:
    path = track.land(DROP)
    track.report()
    path.rename(path.with_name("again.csv"))
    report = track.report()
    (verdict,) = report.logs
    assert (verdict.file, verdict.answer) == ("plank_drops/again.csv", "unlisted")
    assert f"renamed from {DROP}, its content is the same." in verdict.notes
    assert verdict.reasons[0].startswith("no test of the campaign file names it")


def test_a_clock_that_was_set_back(track: _Track) -> None:
    track.land(RUNS[0])
    track.report()
    os.utime(track.land(RUNS[1]), (1e9, 1e9))
    verdict = track.verdict(RUNS[1])
    assert verdict.answer == "good"
    assert any("(2001-09-09 01:46 UTC) is earlier" in note for note in verdict.notes)


def test_the_wrong_speed_in_the_name(track: _Track) -> None:
    track.land(RUNS[0], to=FOURTH)
    verdict = track.verdict(FOURTH)
    assert verdict.answer == "repeat"
    assert "as at 15.8 km/h, but 24 km/h are listed" in verdict.reasons[0]


def test_a_log_that_cannot_be_read_is_no_part_of_the_campaign(track: _Track) -> None:
    track.land(RUNS[0], "time_s,lvdt1_mm\n0,nothing\n")
    track.land(RUNS[1])
    answers = {v.file: v.answer for v in track.report().logs}
    assert answers == {RUNS[0]: "repeat", RUNS[1]: "good"}


def test_without_a_campaign_file_the_guesses_of_init_count(tmp_path: Path) -> None:
    track = _Track(tmp_path, RUNS[0], DROP)
    report = track.report()
    assert {v.file: v.answer for v in report.logs} == {RUNS[0]: "good", DROP: "good"}
    assert [t.words for t in report.planned if t.kind == "bump_run"] == ["run, unloaded, 16 km/h, repeat 1"]
    assert any("is to be filled in" in sentence for sentence in report.missing)
    assert not (track.folder / "campaign.toml").exists()


def test_a_campaign_file_is_written_only_if_asked_for(tmp_path: Path) -> None:
    track = _Track(tmp_path, RUNS[0])
    track.day = TestDay(track.folder, track.output, estimates=False, begin=True, clock=_Clock())
    report = track.report()
    assert any("campaign.toml was written" in remark for remark in report.remarks)
    assert "TODO" in (track.folder / "campaign.toml").read_text()


def test_a_wrong_campaign_file_is_said_once_and_mended(track: _Track) -> None:
    text = (SOURCE / "campaign.toml").read_text()
    track.land("campaign.toml", text.replace("wheelbase_m", "wheelbas_m"))
    track.land(RUNS[0])
    report = track.report()
    assert any("wheelbas_m" in remark for remark in report.remarks)
    assert report.logs == ()
    os.utime(track.land("campaign.toml"), (1e9, 1e9))
    assert track.verdict(RUNS[0]).answer == "good"


def test_a_watch_that_is_started_again_says_the_same(track: _Track) -> None:
    track.land(RUNS[0])
    before = track.report()
    track.begin()
    after = track.report()
    assert (after.logs, after.planned, after.missing) == (before.logs, before.planned, before.missing)


def test_a_folder_that_is_away_for_a_while_loses_nothing(track: _Track) -> None:
    track.land(RUNS[0])
    track.report()
    away = track.folder.with_name("away")
    track.folder.rename(away)
    report = track.day.look()
    assert report is not None
    assert any("does not exist" in remark for remark in report.remarks)
    assert [v.file for v in report.logs] == [RUNS[0]]
    away.rename(track.folder)
    assert track.day.look() is None


def test_nothing_is_written_into_the_folder_of_the_logger(track: _Track) -> None:
    track.land(RUNS[0])
    track.report()
    assert sorted(p.name for p in track.folder.rglob("*")) == ["bump_runs", "campaign.toml", Path(RUNS[0]).name]
    with pytest.raises(CampaignError, match="lies in the folder of the logger"):
        TestDay(track.folder, track.folder / "out")


def test_a_day_that_grew_says_what_one_look_says(tmp_path: Path) -> None:
    """What was found in logs before counts for the same content alone: the second of two repeats becomes another."""
    names, weaker = ("campaign.toml", "bump_scan.csv", *RUNS[:2]), _changed(RUNS[1], 0.6)
    grown = _Track(tmp_path / "grown", *names)
    assert {v.answer for v in grown.report().logs} == {"good"}
    grown.land(RUNS[1], weaker)
    at_once = _Track(tmp_path / "at_once", *names)
    at_once.land(RUNS[1], weaker)
    said = grown.verdict(RUNS[1]).reasons
    assert said == at_once.verdict(RUNS[1]).reasons
    assert any("another bump, another track over it" in reason for reason in said)


@pytest.mark.long
def test_a_wrong_load_case_and_another_bump_are_named(tmp_path: Path) -> None:
    """All logs compared with each other, which takes the scan."""
    track = _Track(tmp_path, "campaign.toml", "bump_scan.csv", *RUNS)
    assert {v.answer for v in track.report().logs} == {"good"}
    # The log of the loaded truck under a name that says unloaded.
    track.land(LOADED, to=RUNS[1])
    verdict = track.verdict(RUNS[1])
    assert verdict.answer == "look"
    assert "move as with the masses of the load case 'loaded', not of 'unloaded'" in verdict.reasons[0]
    # A bump of which 0.6 of the height is left, or that is met beside its middle.
    track.land(RUNS[1], _changed(RUNS[1], 0.6))
    verdict = track.verdict(RUNS[1])
    (said,) = [r for r in verdict.reasons if "another bump, another track over it" in r]
    # The two were driven at 15.8 and 16.2 km/h.
    assert float(said.split(" moves ")[1].split()[0]) == pytest.approx(0.6, rel=0.1)
    track.land(RUNS[1])
    assert {v.answer for v in track.report().logs} == {"good"}
    shutil.rmtree(track.output)
