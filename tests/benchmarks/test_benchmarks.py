"""The benchmark's smallest configuration, and the arithmetic of its rounds."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from native_engine import needs_compiler

from benchmarks.document import goal_of
from benchmarks.rounds import Contender, Sample, ratio, run_rounds, spread

ROOT = Path(__file__).parents[2]


def test_contenders_take_turns_and_ratios_pair_rounds():
    order: list[str] = []

    def contender(name: str, seconds: list[float], **options) -> Contender:
        times = iter(seconds)

        def measure() -> Sample:
            order.append(name)
            return Sample(next(times), 1.0)

        return Contender(name, measure, **options)

    slow, quick = contender("slow", [8.0, 12.0], share=2.0, every=2), contender("quick", [1.0, 50.0, 3.0])
    assert run_rounds([slow, quick], 3, limit_s=60.0) == 3
    assert order == ["slow", "quick", "quick", "slow", "quick"]
    # Round 0: 4 / 1, round 2: 6 / 3; round 1 has no partner.
    found = ratio(slow, quick, "wall_s")
    assert (found.low, found.middle, found.high, found.rounds) == (2.5, 3.0, 3.5, 2)


def test_no_round_is_begun_after_the_limit():
    contender = Contender("one", lambda: Sample(1.0, 1.0))
    assert run_rounds([contender], 5, limit_s=0.0) == 1
    assert spread(list(contender.per_unit("wall_s").values())).rounds == 1


@pytest.mark.parametrize(
    ("name", "found", "text"),
    [
        ("Jacobian / likelihood", 23.6, "<= 24: met"),
        ("Jacobian / likelihood", 24.1, "<= 24: **missed**"),
        ("CVODE Adams, unfiltered / likelihood", 76.8, ">= 80: **missed**"),
        ("CVODE BDF / likelihood", 138.0, ">= 80: met"),
        ("JAX Jacobian / JAX likelihood", 200.0, ""),
    ],
)
def test_a_goal_says_whether_it_was_kept(name: str, found: float, text: str):
    assert goal_of(name, found) == text


@pytest.mark.long
@needs_compiler
def test_the_smallest_configuration_runs(tmp_path: Path):
    command = [sys.executable, "-m", "benchmarks", "--quick", "--no-peers", "--output", str(tmp_path)]
    environment = {**os.environ, "SYSID_ENGINE": "auto"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads((tmp_path / "benchmarks.json").read_text())
    assert found["accuracy"]["worst_channel"]["native engine"]["worst_channel"] < 1e-4
    assert found["accuracy"]["kernel_misfit_difference"] < 1e-12
    assert found["ratios"]["likelihood / kernel"]["processor_s"][1] < 4.0
    assert (tmp_path / "benchmarks.png").stat().st_size > 10_000
    assert "## Growth" in (tmp_path / "benchmarks.md").read_text()
