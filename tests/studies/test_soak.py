"""The study of many calibrations: what the process takes is read from the system, and growth counts from the 4th."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest

from studies.process import open_files, reset_peak, status
from studies.soak import Watch, growth
from sysid.runtime import return_memory

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")


@pytest.fixture(autouse=True)
def _nothing_to_give_back() -> None:
    """What tests before have left would be given back in between, and make the difference smaller."""
    gc.collect()
    return_memory()


def test_memory_and_handles_are_seen(tmp_path: Path) -> None:
    before, files = status("VmRSS"), open_files()
    block = np.ones(20_000_000)
    assert status("VmRSS") - before == pytest.approx(block.nbytes, rel=0.05)
    with (tmp_path / "a").open("w"):
        assert open_files() == files + 1
    del block
    assert reset_peak() == pytest.approx(before, rel=0.05)


def test_the_peak_belongs_to_the_part_that_had_it() -> None:
    watch = Watch()
    watch("first, so far", 0.0)
    block = np.ones(20_000_000)
    watch("first, further", 0.5)
    held = block.nbytes
    del block
    watch("second", 0.5)
    watch.end()
    assert watch.peaks["first"] - watch.peaks["second"] == pytest.approx(held, rel=0.05)


def test_growth_counts_from_the_fourth() -> None:
    records = [{"resident_MB": float(mb)} for mb in (10, 20, 30, 100, 101, 103)]
    assert growth(records) == pytest.approx(0.03)
