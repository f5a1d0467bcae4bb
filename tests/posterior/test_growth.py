"""Long chains: memory stays what it was, the kept draws apart, and nothing is compiled again after the first steps."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from figures import record

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")

#: Samples a compiled density and writes steps, resident bytes without the kept draws, and compilations so far.
PROGRAM = """
import gc, json, os, sys
from pathlib import Path
import jax, jax.numpy as jnp, numpy as np
from jax import monitoring
from sysid.posterior import sampling
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampling import sample_posterior

compilations = []
monitoring.register_event_duration_secs_listener(
    lambda name, seconds, **more: compilations.append(name) if name.endswith("backend_compile_duration") else None
)
CENTRE, SD = np.array([12.0, 9.0]), np.array([0.1, 0.3])
density = jax.jit(lambda x: -0.5 * jnp.sum(((x - CENTRE) / SD) ** 2, axis=1) + 0.1 * jnp.sin(9.0 * x[:, 0]))
seen = []
class Watched(sampling.History):
    def append(self, segment):
        super().append(segment)
        if self.steps in MARKS:
            gc.collect()
            resident = int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
            seen.append([self.steps, resident - self.nbytes, len(compilations)])
MARKS = json.loads(sys.argv[2])
sampling.History = Watched
options = SamplingOptions(ensembles=2, max_steps=max(MARKS), min_effective=1e12, segment_steps=100)
sample_posterior(density, ("k", "c"), CENTRE, np.diag(SD**2), "", options, folder=Path(sys.argv[1]))
sys.stdout.write(json.dumps(seen))
"""


def growth(folder: Path, marks: list[int]) -> list[list[int]]:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder), json.dumps(marks)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.getcwd(), "OMP_NUM_THREADS": "1"},
    )
    return json.loads(done.stdout)


@pytest.mark.long
def test_memory_and_compilations_from_step_1000_to_20000(tmp_path):
    seen = growth(tmp_path / "chain", [1000, 5000, 10_000, 20_000])
    (_, first, compiled), (steps, last, compiled_last) = seen[0], seen[-1]
    record("growth", {"steps, bytes without draws, compilations": seen, "growth": last / first - 1.0})
    assert steps == 20_000
    assert last / first < 1.05
    assert compiled == compiled_last > 0


def test_nothing_is_compiled_after_the_first_steps(tmp_path):
    seen = growth(tmp_path / "chain", [200, 1000])
    assert seen[0][2] == seen[1][2] > 0
    assert seen[1][1] / seen[0][1] < 1.05
