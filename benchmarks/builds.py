"""Likelihoods by several builds of the native engine in turn, and how far their results are apart.

``python -m benchmarks.builds NAME=LIBRARY.so ... [--rounds 30]``; times are those of one set in a batch.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from benchmarks.rounds import Contender, Sample, ratio, run_rounds, spread

BATCHES = (1, 64)


class _Child:
    """A process that computes with one build."""

    def __init__(self, library: str):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.builds", "--child", library],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.values = {int(sets): np.array(values) for sets, values in self._read().items()}

    def measure(self, sets: int) -> Sample:
        """Time of one call with so many sets."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{sets}\n")
        self._process.stdin.flush()
        return Sample(*self._read())

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _read(self):
        assert self._process.stdout is not None
        return json.loads(self._process.stdout.readline())


def main() -> None:
    """Print medians with quartiles, and ratios to the first build."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("builds", nargs="*", metavar="NAME=LIBRARY")
    parser.add_argument("--rounds", type=int, default=30)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child is not None:
        _serve(Path(options.child))
        return
    children = {name: _Child(library) for name, _, library in (text.partition("=") for text in options.builds)}
    contenders = {
        (name, sets): Contender(name, lambda child=child, sets=sets: child.measure(sets), sets)
        for sets in BATCHES
        for name, child in children.items()
    }
    run_rounds(list(contenders.values()), options.rounds, limit_s=600.0)
    first = next(iter(children))
    say = sys.stdout.write
    say(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; processor time per set, {options.rounds} rounds\n")
    for (name, sets), contender in contenders.items():
        low, middle, high, _ = spread(list(contender.per_unit("processor_s").values()))
        times = ratio(contender, contenders[first, sets], "processor_s")
        apart = np.abs(children[name].values[sets] / children[first].values[sets] - 1.0).max()
        say(
            f"{name:20} {sets:3} sets: {1e3 * middle:.3f} ms [{1e3 * low:.3f}, {1e3 * high:.3f}], "
            f"{times.middle:.2f} [{times.low:.2f}, {times.high:.2f}] of {first}, log-density apart {apart:.1e}\n"
        )
    for child in children.values():
        child.close()


def _serve(library: Path) -> None:
    """Load a build in place of the one that the product would choose, then answer with times."""
    from benchmarks.likelihood import repeats
    from benchmarks.rounds import timed
    from benchmarks.work import density, make_work, nominal_point
    from sysid.runtime import configure
    from sysid.vehicle_model.native import build

    configure()
    build.library = lambda coordinates=None: library
    work = make_work(nominal_point(), [0])
    ours = density(work, "native")
    points = {sets: work.sets(sets) for sets in BATCHES}
    _answer({sets: ours(sets_of).tolist() for sets, sets_of in points.items()})
    for line in sys.stdin:
        sets = int(line)
        _answer(timed(lambda: ours(points[sets]), repeats(sets, "native"))())  # noqa: B023


def _answer(found: object) -> None:
    sys.stdout.write(json.dumps(found) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
