"""The benchmarks of samplers and of whole jobs: what they count, and the arithmetic of their tables."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.job_table import _ending, _stages
from benchmarks.jobs import ROOT, proportional_bytes, resident_bytes, run, with_children
from benchmarks.sampler_table import table
from benchmarks.samplers import Counted, Target, measure
from sysid.posterior.options import SamplingOptions

SD = np.array([1.0, 0.1, 3.0])


class Gaussian:
    """Independent normal log-density with standard deviations SD."""

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return -0.5 * ((points / SD) ** 2).sum(axis=1)


def target() -> Target:
    return Target(Gaussian(), ("a", "b", "c"), np.zeros(3), np.diag(SD**2), SD)


def test_sets_are_counted():
    density = Counted(Gaussian())
    density(np.zeros((7, 3)))
    density(np.zeros((2, 3)))
    assert density.likelihoods == 9


@pytest.mark.parametrize("name", ["ours", "emcee, stretch move (its default)"])
def test_ensembles_on_a_gaussian_converge_and_pay_for_all_walkers(name: str):
    found = measure(target(), name, 3.0, seed=2)
    assert found.rhat < 1.05
    # How many steps there are depends on the machine, what they are worth does not: 4 and 60 likelihoods were seen.
    assert found.effective > found.likelihoods / 90
    assert found.sd_ratio is not None
    assert 0.8 < found.sd_ratio[0] <= found.sd_ratio[1] < 1.2
    walkers = int(found.remark.split(" walkers")[0].split()[-1])
    steps = int(found.remark.split(" steps")[0].split()[-1])
    # Every step proposes for every walker; starts, one likelihood for its time and, in ours, an importance sample
    # come on top.
    ahead = 5 * 64 + (SamplingOptions().importance_draws + 1 if name == "ours" else 0)
    assert 4 * walkers * steps <= found.likelihoods <= 4 * walkers * (steps + 2) + ahead


def test_work_is_counted_in_likelihoods():
    one = {
        "name": "a sampler",
        "effective": 100.0,
        "rhat": 1.0042,
        "likelihoods": 1000,
        "share_kept": 0.5,
        "sd_ratio": [0.96, 1.31],
        "wall_s": 40.0,
        "processor_s": 20.0,
        "remark": "in words",
    }
    found = {
        "machine": {"cores": 2, "instruction_set": "AVX2", "load_before": 0.1},
        "campaign": "data",
        "parameters": 45,
        "likelihood_s": 0.001,
        "samplers": {"a sampler": one},
    }
    row = next(line for line in table(found).splitlines() if line.startswith("| a sampler"))
    # 1000 / 100 = 10 likelihoods per effective draw, half of them kept.
    assert row == "| a sampler | 20 (40) | 1.004 | 0.96 to 1.31 | 100 | 5 | 10 | 10 | 5 |"


def test_a_job_that_reaches_its_limit_is_ended_and_measured(tmp_path: Path):
    found = run(ROOT / "examples" / "linear_truck", tmp_path / "out", tmp_path / "cache", False, limit_s=1.0)
    assert found["exit"] < 0
    assert found["status"] == "not finished"
    assert 0.9 < found["wall_s"] < 30.0
    assert found["peak_bytes"] > 5e6


@pytest.mark.skipif(not Path("/proc/self/smaps_rollup").exists(), reason="the system does not say")
def test_memory_is_that_of_a_process_and_its_children():
    """A Python process with 100 MB in a child of its own."""
    child = "import sys; x = bytearray(b'1') * 10**8; print('ready', flush=True); sys.stdin.read()"
    parent = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {child!r}])"
    with subprocess.Popen(
        [sys.executable, "-c", parent], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        together = with_children(proportional_bytes, process.pid)
        at_most = with_children(resident_bytes, process.pid)
        assert process.stdin is not None
        process.stdin.close()
    assert 1.05e8 < together < 1.25e8
    # A page of the interpreter that both have counts twice.
    assert together < at_most < together + 1.5e7


def test_a_job_says_how_it_ended():
    assert _ending({"exit": 0, "status": "converged", "last_words": []}) == "converged"
    assert _ending({"exit": -9, "last_words": ["1 of 2 a\r2 of 2 fit "]}) == "ended at the limit, at '2 of 2 fit'"
    assert _ending({"exit": 3, "last_words": []}) == "exit code 3"


def test_parts_of_a_stage_are_not_counted_twice():
    found = {"truck": {"wall_s": 12.0, "stages_s": {"fit": 7.0, "fit: search": 5.0, "sample": 3.0}}}
    lines = _stages(found).splitlines()
    assert lines[-1] == "| outside of the stages | 2.0 |"
    assert not any("search" in line for line in lines)
