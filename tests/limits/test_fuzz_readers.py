"""Fuzzing of every reader: damaged copies of real files end in a result or in one sentence, in little time and memory.

They are the same ones at every run; ``make fuzz`` (`studies/fuzz`) looks for others for an hour a reader.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from hostile_files import Target, Watch, check, damaged, damages, targets
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from measured_read import MOST_BYTES, MOST_SECONDS

TARGETS = targets()
#: Readers that start a process for every file get fewer examples.
SHORT = {"OpenCRG": 12, "quality and drops": 15, "scan": 15, "decay": 60, "campaign": 60}
#: Python, NumPy and pandas before a file is read.
BASE_BYTES = 115e6


def fuzz(target: Target, folder: Path, watch: Watch, examples: int) -> None:
    """Read `examples` damaged files, the same ones always."""

    @settings(
        max_examples=examples,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate, Phase.shrink],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, len(target.seeds) - 1), damages())
    def read(which: int, damage: list) -> None:
        check(target, folder, damaged(target.seeds[which], damage), watch)

    read()


def check_figures(name: str, watch: Watch, sound_s: float = 0.0) -> None:
    """Damaged files take little time, or on a slow machine little more than the sound ones."""
    assert watch.seconds <= max(MOST_SECONDS, 2.0 * sound_s), f"{name}: {watch.seconds:.2f} s"
    assert watch.bytes + BASE_BYTES <= MOST_BYTES, f"{name}: {watch.bytes / 1e6:.0f} MB"


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_end_in_a_result_or_one_sentence(name: str, tmp_path: Path) -> None:
    watch = Watch()
    target = TARGETS[name]
    for content in target.seeds:
        check(target, tmp_path, content, watch)
    sound_s = watch.seconds
    fuzz(target, tmp_path, watch, SHORT.get(name, 150))
    check_figures(name, watch, sound_s)
    # Both ways out are taken, so that neither seeds nor damages are all of one kind.
    assert 0 < watch.refused < watch.examples
