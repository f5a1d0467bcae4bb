"""Files of an earlier export that a later one does not write: removed, and nothing else with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from sysid.workflow.earlier_files import remember_more, remove_earlier


def _written(folder: Path, *names: str) -> list[Path]:
    paths = [folder / name for name in names]
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("1")
    return paths


def _files(folder: Path) -> set[str]:
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} - {"stages/written.json"}


def test_what_is_not_written_again_goes(tmp_path: Path) -> None:
    first = _written(tmp_path, "predictions/empty_48kmh.csv", "predictions/peaks.csv", "models/empty/vehicle.csv")
    assert remove_earlier(tmp_path, "export", first) == []
    _written(tmp_path, "predictions/my_notes.csv", "campaign.toml")
    second = _written(tmp_path, "predictions/peaks.csv", "predictions/loaded_24kmh.csv")
    gone = remove_earlier(tmp_path, "export", second)
    assert [p.relative_to(tmp_path).as_posix() for p in gone] == [
        "models/empty/vehicle.csv",
        "predictions/empty_48kmh.csv",
    ]
    left = {"predictions/peaks.csv", "predictions/loaded_24kmh.csv", "predictions/my_notes.csv", "campaign.toml"}
    assert _files(tmp_path) == left


def test_report_and_export_do_not_remove_each_others_files(tmp_path: Path) -> None:
    remove_earlier(tmp_path, "export", _written(tmp_path, "predictions/peaks.csv"))
    remove_earlier(tmp_path, "report", _written(tmp_path, "report.html", "figures/figure_5_bump.svg"))
    remove_earlier(tmp_path, "report", _written(tmp_path, "report.html"))
    assert _files(tmp_path) == {"predictions/peaks.csv", "report.html"}


@pytest.mark.parametrize(
    "name",
    [
        "../victim.csv",
        "predictions/../../victim.csv",
        "predictions/../campaign.toml",
        "/victim.csv",
        "campaign.toml",
        "stages/settings.json",
        "link/victim.csv",
        "predictions/link.csv",
        "predictions",
        "predictions/\0",
        "predictions/" + "x" * 5000,
        "",
        ".",
    ],
)
def test_a_list_from_a_stranger_removes_nothing_of_ours(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "out"
    (victim,) = _written(tmp_path, "victim.csv")
    _written(folder, "campaign.toml", "stages/settings.json", "predictions/peaks.csv")
    (folder / "link").symlink_to(tmp_path, target_is_directory=True)
    (folder / "predictions" / "link.csv").symlink_to(victim)
    name = str(victim) if name == "/victim.csv" else name
    (folder / "stages" / "written.json").write_text(json.dumps({"export": [name]}))
    before = _files(folder)
    assert remove_earlier(folder, "export", [folder / "predictions" / "peaks.csv"]) == []
    assert victim.exists()
    assert _files(folder) == before


@pytest.mark.parametrize("content", ["", "[", "3", '{"export": 3}', '{"export": [3, null, {}]}', "\0"])
def test_a_damaged_list_is_none(tmp_path: Path, content: str) -> None:
    written = _written(tmp_path, "predictions/peaks.csv", "stages/written.json")
    written[1].write_text(content)
    assert remove_earlier(tmp_path, "export", written[:1]) == []
    assert json.loads(written[1].read_text()) == {"export": ["predictions/peaks.csv"]}


def test_files_written_aside_add_up_and_go_together(tmp_path: Path) -> None:
    remember_more(tmp_path, "predict", _written(tmp_path, "predictions/empty_60kmh.csv"))
    remember_more(tmp_path, "predict", _written(tmp_path, "predictions/empty_70kmh.csv"))
    remove_earlier(tmp_path, "export", _written(tmp_path, "predictions/peaks.csv"))
    assert len(_files(tmp_path)) == 3
    remove_earlier(tmp_path, "predict", ())
    assert _files(tmp_path) == {"predictions/peaks.csv"}
