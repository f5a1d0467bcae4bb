"""Eight hours in which nothing lands: nothing is read, nothing is said, and memory stays."""

from __future__ import annotations

import shutil
import tracemalloc
from pathlib import Path

import pytest

from sysid.watch import TestDay

SOURCE = Path(__file__).parents[2] / "examples" / "linear_truck"
FILES = ("campaign.toml", "bump_runs/case1_unloaded_16kmh_run1.csv", "plank_drops/axle1_drop1.csv")
#: A look every two seconds.
LOOKS = 8 * 3600 // 2


def _blocks() -> int:
    return len(tracemalloc.take_snapshot().traces)


@pytest.mark.long
def test_eight_hours_cost_neither_memory_nor_readings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not one block of memory for ten looks; a table of the interpreter that grows once is one block."""
    folder, now = tmp_path / "logger", 0.0
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(SOURCE / name, folder / name)
    # What is no log at all is looked at too.
    for number in range(8):
        (folder / f"photo {number}.jpg").write_bytes(b"x")
    day = TestDay(folder, tmp_path / "out", estimates=False, clock=lambda: now)
    said = []
    for _ in range(20):
        now += 2.0
        said.append(day.look())
    assert [len(report.logs) for report in said if report is not None][-1:] == [2]

    def read(*rest: object, **others: object) -> None:
        raise AssertionError("a file is read")

    monkeypatch.setattr("sysid.watch.landing.read_file_inside", read)
    monkeypatch.setattr("sysid.watch.day.campaign_file", read)
    monkeypatch.setattr("sysid.watch.day.write_text", read)
    tracemalloc.start()
    try:
        before = 0
        for number in range(LOOKS):
            now += 2.0
            assert day.look() is None
            if number == LOOKS // 100:
                before = _blocks()
        assert _blocks() - before < LOOKS // 10
    finally:
        tracemalloc.stop()
