"""A calibration is exported again while somebody compares it: the reader sees one whole result, or a sentence."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from compared_folders import results, write_folder

from sysid import files
from sysid.comparison import stored
from sysid.comparison.stored import RESULT_FILE, read_result
from sysid.errors import StoredResultsError
from sysid.export.covariance_json import COVARIANCE_FILE, write_covariance
from sysid.export.result_json import write_result

FACTOR = 0.5
READ = (RESULT_FILE, COVARIANCE_FILE)
Seen = tuple[float, float] | str


def seen(folder: Path) -> Seen:
    """Damping of axle 2 by both files, relative to that of the first result; or what the reader is told instead."""
    try:
        found = read_result(folder)
    except StoredResultsError as error:
        return str(error)
    estimate = next(e for e in found.estimates if e.name == "c_2")
    document = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
    assert found.identity.result_sha256 == document["identity"]["content_sha256"]
    return estimate.log_value, found.covariance[0, 0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_folder(tmp_path / "campaign", results(seed=1))


def another(folder: Path) -> tuple[Callable[[], None], ...]:
    """Steps of an export of another result, as :mod:`sysid.workflow.stages.endings` takes them."""
    other = results(seed=2, change={"c_2": FACTOR})
    return (
        lambda: write_covariance(other, folder / COVARIANCE_FILE) and None,
        lambda: write_result(other, folder / RESULT_FILE),
    )


def whole(folder: Path, tmp_path: Path) -> tuple[Seen, Seen]:
    """What is seen of the first and of the other result while nobody writes."""
    first = seen(folder)
    place = write_folder(tmp_path / "other", results(seed=1))
    for step in another(place):
        step()
    return first, seen(place)


def test_before_and_after_every_file_that_is_put_in_place(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, other = whole(folder, tmp_path)
    assert not isinstance(first, str)
    assert not isinstance(other, str)
    assert first != other
    found: list[Seen] = []
    replace = files._replace

    def watched(place: object, source: str, target: str) -> None:
        found.append(seen(folder))
        replace(place, source, target)  # type: ignore[arg-type]
        found.append(seen(folder))

    monkeypatch.setattr(files, "_replace", watched)
    for step in another(folder):
        step()
    assert found[0] == first
    assert found[-1] == other
    between = found[1:-1]
    assert len(between) == 2
    assert all(isinstance(s, str) and "are of two calibrations" in s for s in between)


@pytest.mark.parametrize("file", READ)
@pytest.mark.parametrize("written", [1, 2])
def test_while_it_reads(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, written: int, file: str) -> None:
    """The writer comes in between, before the reader takes the file that is named."""
    first, other = whole(folder, tmp_path)
    read, steps = stored.read_json, list(another(folder))[:written]

    def interrupted(path: Path) -> dict:
        if path.name == file:
            while steps:
                steps.pop(0)()
        return read(path)

    monkeypatch.setattr(stored, "read_json", interrupted)
    found = seen(folder)
    assert not steps
    if file == RESULT_FILE and written == 2:
        assert found == other
    else:
        assert isinstance(found, str)
        assert "are of two calibrations" in found
    assert first != found
