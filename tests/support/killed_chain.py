"""Sampling in child processes that are killed at random moments; run as a program with FOLDER KILLS SEED.

The children are forked from a process that has loaded everything, so a life lasts milliseconds instead of seconds.
Writes one JSON object: how many children were killed, at how many distinct numbers of committed steps, what reading the
chain from outside raised after each kill (nothing is expected), and how many chains were completed on the way.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
import sys
import time
from pathlib import Path

import numpy as np

from sysid.posterior.checkpoint import read_chain
from sysid.posterior.options import SamplingOptions
from sysid.posterior.sampled_posterior import Posterior
from sysid.posterior.sampling import sample_posterior
from sysid.posterior.segments import segment_file
from sysid.threads import one_blas_thread

NAMES = ("k_1", "k_2", "c_1")
CENTRE = np.array([12.0, 13.0, 9.0])
COVARIANCE = np.array([[0.04, 0.02, 0.0], [0.02, 0.09, 0.01], [0.0, 0.01, 0.01]])
PRECISION = np.linalg.inv(COVARIANCE)
#: Never converged, so that every run goes to its limit.
OPTIONS = SamplingOptions(ensembles=2, segment_steps=4, min_steps=10**6, max_steps=320, seed=5)


def density(points: np.ndarray) -> np.ndarray:
    """A Gaussian with a ripple."""
    centred = points - CENTRE
    return -0.5 * np.einsum("ni,ij,nj->n", centred, PRECISION, centred) + 0.1 * np.sin(centred[:, 0] * 9.0)


def sample(folder: Path | None, *, resume: bool = False) -> Posterior:
    """The chain of this file."""
    return sample_posterior(density, NAMES, CENTRE, COVARIANCE, "test", OPTIONS, folder=folder, resume=resume)


def life(folder: Path) -> int:
    """A child that goes on with the chain to its end; its process id."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            sample(folder, resume=True)
            code = 0
        finally:
            os._exit(code)
    return child


def main(folder: Path, kills: int, seed: int) -> dict[str, object]:
    """Kill `kills` children; a chain that reaches its end meanwhile is started anew in the next folder."""
    moments = random.Random(seed)
    # The libraries of linear algebra are looked for once, here: in a child that would take longer than a short life.
    with one_blas_thread():
        pass
    killed, completed, faults, places = 0, 0, [], set()
    chain = folder / "chain_0"
    while killed < kills:
        child = life(chain)
        # A life is between nothing at all and some twenty checkpoints.
        time.sleep(moments.uniform(0.0, 0.25) ** 2 * 4.0)
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended == 0:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            killed += 1
        elif status != 0:
            faults.append(f"a life ended with status {status}")
            break
        else:
            completed += 1
            chain = folder / f"chain_{completed}"
        try:
            found = read_chain(chain)
            places.add((completed, 0 if found is None else len(found[1])))
            if segment_file(chain, 0).exists() and found is None:
                faults.append("a segment that cannot be read")
        except Exception as error:
            faults.append(repr(error))
    for old in range(completed):
        shutil.rmtree(folder / f"chain_{old}")
    return {"killed": killed, "places": len(places), "faults": faults, "completed": completed, "chain": str(chain)}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))))
