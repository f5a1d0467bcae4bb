"""A fresh process that computes one batch of likelihoods and says what that took: run by the benchmark as a child."""

from __future__ import annotations

import time

BEGIN = time.perf_counter()

import argparse  # noqa: E402
import json  # noqa: E402
import resource  # noqa: E402
import sys  # noqa: E402
from pathlib import Path  # noqa: E402


def main() -> None:
    """Print seconds from the start of the process to the first batch, and peak memory before and after it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--engine", choices=("native", "jax"), required=True)
    parser.add_argument("--sets", type=int, default=64)
    parser.add_argument("--runs", type=int, nargs="+", default=[0])
    options = parser.parse_args()

    from sysid.runtime import configure

    configure()

    from benchmarks.work import density, make_work, nominal_point

    work = make_work(nominal_point(), options.runs)
    ours = density(work, options.engine)
    ready, memory = time.perf_counter() - BEGIN, _peak_bytes()
    ours(work.sets(options.sets))
    found = {
        "engine_ready_s": ready,
        "first_likelihood_s": time.perf_counter() - BEGIN,
        "peak_before_bytes": memory,
        "peak_bytes": _peak_bytes(),
    }
    sys.stdout.write(json.dumps(found) + "\n")


def _peak_bytes() -> int:
    # The peak that getrusage tells outlives exec: it would be that of the process that started this one.
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return int(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))) * 1024


if __name__ == "__main__":
    main()
