"""The command `compare`: what it prints and writes, for people and for programs."""

from __future__ import annotations

import csv
import json
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from click.testing import CliRunner
from compared_folders import results, write_folder
from hostile_text import HOSTILE
from small_results import Words

from sysid.cli.main import cli


@pytest.fixture
def folders(tmp_path: Path) -> list[str]:
    changed = {"c_2": 0.9}
    written = (("before", results(seed=1)), ("after", results(seed=2, change=changed)), ("later", results(seed=3)))
    return [str(write_folder(tmp_path / name, of)) for name, of in written]


def run(*words: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(cli, ["compare", *words])
    return done.exit_code, done.stdout, done.stderr


def test_the_answer_comes_first_and_the_files_are_there(folders, tmp_path) -> None:
    code, shown, _ = run(*folders[:2], "--output", str(tmp_path / "out"))
    assert code == 0
    assert shown.startswith("after against before: Changed: c_2 \N{MINUS SIGN}10.0 %")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"comparison.html", "comparison.csv", "comparison.svg"}
    with (tmp_path / "out" / "comparison.csv").open(encoding="utf-8", newline="") as stream:
        rows = {row["name"]: row for row in csv.DictReader(stream)}
    assert {name for name, row in rows.items() if row["changed"] == "true"} == {"c_2"}
    assert float(rows["c_2"]["change"]) == pytest.approx(-0.1, abs=1e-8)
    assert float(rows["c_2"]["change_q05"]) < -0.1 < float(rows["c_2"]["change_q95"]) < 0.0
    ids = [json.loads((Path(f) / "result.json").read_text(encoding="utf-8"))["identity"]["run"] for f in folders[:2]]
    assert [rows["c_2"]["first_run"], rows["c_2"]["second_run"]] == ids
    assert ET.parse(tmp_path / "out" / "comparison.svg").getroot().tag.endswith("svg")


def test_several_campaigns_are_compared_with_the_first(folders, tmp_path) -> None:
    code, shown, _ = run(*folders, "--output", str(tmp_path / "out"))
    assert code == 0
    assert "later against before: Nothing of the suspensions has changed" in shown
    assert (tmp_path / "out" / "comparison_2.svg").exists()


def test_json_is_all_that_is_printed(folders, tmp_path) -> None:
    code, shown, _ = run(*folders[:2], "--json", "--output", str(tmp_path / "out"))
    (pair,) = json.loads(shown)["pairs"]
    assert code == 0
    assert [d["name"] for d in pair["differences"] if d["changed"]] == ["c_2"]
    assert pair["shared"] == ["unsprung masses", "the scale"]


def test_without_sharing_a_change_of_a_tenth_is_not_seen(folders, tmp_path) -> None:
    code, shown, _ = run(*folders[:2], "--nothing-shared", "--output", str(tmp_path / "out"))
    assert code == 0
    assert "Nothing of the suspensions has changed" in shown


def test_a_wrong_folder_is_one_sentence(folders, tmp_path) -> None:
    code, shown, said = run(folders[0], str(tmp_path / "none"), "--output", str(tmp_path / "out"))
    assert (code, shown) == (2, "")
    assert "does not exist" in said
    assert "Traceback" not in said
    assert not (tmp_path / "out").exists()
    (Path(folders[1]) / "covariance.json").write_text("[]", encoding="utf-8")
    assert run(*folders[:2])[0] == 2
    assert run(folders[0])[0] == 2


def test_names_of_strangers_stay_words(tmp_path) -> None:
    words = Words(title=HOSTILE, vehicle=HOSTILE, empty=HOSTILE)
    first = write_folder(tmp_path / "a", results(words, seed=1))
    second = write_folder(tmp_path / "b", results(words, seed=2))
    code, shown, _ = run(str(first), str(second), "--output", str(tmp_path / "out"))
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert code == 0
    assert "<pwned>" not in page
    assert "<script>pwned" not in page
    assert not {"\x00", "\u202e"} & {*shown, *page}
    table = (tmp_path / "out" / "comparison.csv").read_text(encoding="utf-8")
    assert not {"\x00", "\u202e"} & {*table}


def test_each_truck_on_the_runs_of_the_other(folders, tmp_path, monkeypatch) -> None:
    """The campaign files go with the folders in their order; the table is on screen, page and in JSON."""
    from sysid.comparison import agreement
    from sysid.comparison.records import Agreement

    asked: list[tuple[str, str]] = []

    def finished(campaign, folder, label):
        asked.append((Path(campaign).name, label))
        return label

    def on_each_other(first, second):
        return (Agreement("runs/a.csv", first, 1.02, 1.31), Agreement("runs/b.csv", second, None, None)), ("Left out.",)

    monkeypatch.setattr(agreement, "finished", finished)
    monkeypatch.setattr(agreement, "on_each_other", on_each_other)
    files = [tmp_path / "one.toml", tmp_path / "two.toml"]
    words = []
    for file in files:
        file.write_text("", encoding="utf-8")
        words += ["--campaign", str(file)]
    code, shown, _ = run(*folders[:2], *words, "--output", str(tmp_path / "out"))
    assert code == 0
    assert asked == [("one.toml", "before"), ("two.toml", "after")]
    assert "runs/a.csv (before)" in shown
    assert "1.31" in shown
    assert "Left out." in shown
    page = (tmp_path / "out" / "comparison.html").read_text(encoding="utf-8")
    assert "1.31" in page
    code, shown, _ = run(*folders[:2], *words, "--json", "--output", str(tmp_path / "out"))
    (pair,) = json.loads(shown)["pairs"]
    assert pair["agreement"][1] == {"run": "runs/b.csv", "recorded_by": "after", "own": None, "other": None}
    code, _, said = run(*folders[:2], *words[:2], "--output", str(tmp_path / "out"))
    assert code == 2
    assert "1 campaign file for 2 folders" in said
