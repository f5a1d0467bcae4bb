"""Fuzzing of every reader: damaged copies of real files end in a result or in one sentence, in little time and memory.

The short version runs with the suite; ``make fuzz`` runs for an hour (SYSID_FUZZ_SECONDS) with other examples each time
and keeps its figures in build/figures/fuzz.json for docs/robustness.md.
"""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest
from figures import record
from hostile_files import Target, Watch, check, damaged, damages, targets
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from measured_read import MOST_BYTES, MOST_SECONDS

TARGETS = targets()
#: Readers that start a process for every file get fewer examples.
SHORT = {"OpenCRG": 12, "quality and drops": 15, "scan": 15, "decay": 60, "campaign": 60}
#: Python, NumPy and pandas before a file is read.
BASE_BYTES = 115e6


def fuzz(target: Target, folder: Path, watch: Watch, examples: int, number: int | None) -> None:
    """Read `examples` damaged files, the same ones always where `number` is None."""

    @settings(
        max_examples=examples,
        derandomize=number is None,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, len(target.seeds) - 1), damages())
    def read(which: int, damage: list) -> None:
        check(target, folder, damaged(target.seeds[which], damage), watch)

    (read if number is None else seed(number)(read))()


def figures(watch: Watch) -> dict[str, float]:
    return {
        "files": watch.examples,
        "refused": watch.refused,
        "seconds": round(watch.seconds, 2),
        "MB": round((watch.bytes + BASE_BYTES) / 1e6),
    }


def check_figures(name: str, watch: Watch) -> None:
    assert watch.seconds <= MOST_SECONDS, f"{name}: {watch.seconds:.2f} s"
    assert watch.bytes + BASE_BYTES <= MOST_BYTES, f"{name}: {watch.bytes / 1e6:.0f} MB"


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_end_in_a_result_or_one_sentence(name: str, tmp_path: Path) -> None:
    watch = Watch()
    target = TARGETS[name]
    for content in target.seeds:
        check(target, tmp_path, content, watch)
    fuzz(target, tmp_path, watch, SHORT.get(name, 150), None)
    check_figures(name, watch)
    # Both ways out are taken, so that neither seeds nor damages are all of one kind.
    assert 0 < watch.refused < watch.examples


@pytest.mark.long
def test_an_hour_of_damaged_files(tmp_path: Path) -> None:
    seconds = float(os.environ.get("SYSID_FUZZ_SECONDS", "3600"))
    begin = time.monotonic()
    # Other files in every run; the number of a failing one is shown by hypothesis.
    number = int(os.environ.get("SYSID_FUZZ_SEED", str(time.time_ns() % 2**32)))
    watches = {name: Watch() for name in TARGETS}
    while time.monotonic() - begin < seconds:
        for name, watch in watches.items():
            fuzz(TARGETS[name], tmp_path, watch, 40, number)
            number += 1
        found = {name: figures(watch) for name, watch in watches.items()}
        record("fuzz", {"minutes": round((time.monotonic() - begin) / 60.0), "tracebacks": 0, "readers": found})
    for name, watch in watches.items():
        check_figures(name, watch)
