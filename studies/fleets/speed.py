"""A fleet by one process, by two, and by two workers of a cluster: ``python -m studies.fleets.speed``.

Twenty-four simulated campaigns (twelve three-axle trucks, two campaigns each, two runs each), as previews with declared
laws, after one campaign more that fills the cache of compiled code.  Every process has one thread.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from studies.documents import write_between_marks
from sysid.fleet.read import read_fleet
from sysid.fleet.running import Row, RunOptions, run_fleet
from sysid.fleet.simulate import simulate_fleet

RIGID = Path(__file__).resolve().parents[2] / "examples" / "vehicles" / "rigid3"
CHOICES = {"quick": True, "laws": "declared"}
WAYS = ("one process", "two processes", "two workers of a Dask cluster", "two workers that do not see the folders")


@dataclass(frozen=True)
class Took:
    """One way of running the fleet: seconds on the clock, and what became of the campaigns."""

    seconds: float
    rows: tuple[Row, ...]

    @property
    def results(self) -> dict[str, str]:
        """Hash of every result, without the times in it."""
        return {row.campaign: row.outcome.result_sha256 for row in self.rows if row.outcome is not None}


def run(fleet: Path, output: Path, workers: int, scheduler: str | None = None, send: bool = False) -> Took:
    """Run a fleet into an empty folder, with one thread per process."""
    shutil.rmtree(output, ignore_errors=True)
    os.environ["SYSID_THREADS"] = str(workers)
    begin = time.monotonic()
    options = RunOptions(workers, scheduler, send, choices=CHOICES)
    rows = run_fleet(read_fleet(fleet), output, options, lambda rows: None)
    return Took(time.monotonic() - begin, tuple(rows))


def measure(folder: Path, trucks: int) -> dict[str, Took]:
    """The same fleet in every way."""
    from distributed import LocalCluster

    fleet, warm = folder / "fleet", folder / "warm"
    if not fleet.exists():
        simulate_fleet(RIGID, fleet, trucks=trucks, campaigns=2, seed=24)
        simulate_fleet(RIGID, warm, trucks=1, campaigns=1, seed=25)
    run(warm, folder / "out-warm", 1)
    took = {}
    for number, way in enumerate(WAYS):
        output = folder / f"out-{number}"
        if number < 2:
            took[way] = run(fleet, output, number + 1)
        else:
            os.environ["TMPDIR"] = str(folder)
            with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
                took[way] = run(fleet, output, 2, cluster.scheduler_address, send=number == 3)
        sys.stderr.write(f"{way}: {took[way].seconds:.0f} s\n")
    return took


def table(took: dict[str, Took]) -> str:
    """Markdown: seconds, speedup, processor time, memory, and whether all results are those of two processes."""
    one, two = took[WAYS[0]], took[WAYS[1]]
    states = sorted({row.state for row in one.rows})
    lines = [
        f"{len(one.rows)} campaigns (two runs each, `--quick --laws declared`), all {' and '.join(states)}; two cores.",
        "",
        "| | on the clock [s] | times as fast | processor time of a campaign [s] | largest memory [MB] | results |",
        "|---|---|---|---|---|---|",
    ]
    for way, t in took.items():
        outcomes = [row.outcome for row in t.rows if row.outcome is not None]
        processor = sum(o.processor_seconds for o in outcomes) / len(outcomes)
        memory = max(o.peak_bytes for o in outcomes) / 1e6
        same = sum(t.results[name] == digest for name, digest in two.results.items())
        lines.append(
            f"| {way} | {t.seconds:.0f} | {one.seconds / t.seconds:.2f} | {processor:.1f} | {memory:.0f} | "
            f"{same} of {len(two.results)} as with two processes, bit for bit |"
        )
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Measure, and show the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/fleet_speed"), help="folder of the fleet")
    parser.add_argument("--trucks", type=int, default=12, help="trucks of two campaigns each")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    text = table(measure(options.output.resolve(), options.trucks))
    sys.stdout.write(text + "\n")
    if options.document is not None:
        write_between_marks(options.document, "speed", text)


if __name__ == "__main__":
    main()
