"""Whole jobs as a user types them: wall and processor time by stage, and peak memory.

``python -m benchmarks.jobs [--only NAME ...] [--cold] [--limit SECONDS] [--python PATH] [--output build/benchmarks]
[--document PAGE]``

Other packages beside the program make it larger and slower to start: xarray loads dask and pandas loads pyarrow where
they are installed.  So the interpreter that runs the jobs may be that of an environment with the program alone.

A job that is done already is kept in ``jobs.json`` and replaced when it is named again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.job_table import write_table
from benchmarks.machine import describe
from benchmarks.made_campaigns import long_records, three_axles

ROOT = Path(__file__).resolve().parents[1]


class Job(NamedTuple):
    """A campaign: its folder, found or made, and what it is in words."""

    campaign: Callable[[Path], Path]
    about: str


JOBS = {
    "reference": Job(lambda _: ROOT / "examples" / "linear_truck", "six axles, 10 runs at 200 Hz, linear suspensions"),
    "truck": Job(lambda _: ROOT / "data", "six axles, 10 runs at 200 Hz, the shipped campaign"),
    "three axles": Job(three_axles, "three axles, 6 runs at 200 Hz, made"),
    "long": Job(long_records, "eight axles, 20 runs of 60 s at 1 kHz, 24 channels, made"),
}


def main() -> None:
    """Run the jobs in turn, write ``jobs.json`` after each, and on request the table of the documentation."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.jobs", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=tuple(JOBS), default=tuple(JOBS))
    parser.add_argument("--cold", action="store_true", help="begin with an empty cache: compiling is counted")
    parser.add_argument("--limit", type=float, default=7200.0, help="seconds after which a job is ended")
    parser.add_argument("--python", type=Path, default=Path(sys.executable), help="interpreter that runs the jobs")
    parser.add_argument("--output", type=Path, default=Path("build/benchmarks"))
    parser.add_argument("--document", type=Path, help="page to write the table to")
    options = parser.parse_args()
    folder: Path = options.output.resolve() / "jobs"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder.parent / "jobs.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for name in options.only:
        campaign = JOBS[name].campaign(folder)
        output = folder / f"out-{name.replace(' ', '-')}"
        done = run(campaign, output, folder / "cache", options.cold, options.limit, options.python)
        key = f"{name}, cold" if options.cold else name
        found[key] = {"about": JOBS[name].about, "machine": describe(), **done}
        path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        sys.stderr.write(f"{key}: {found[key]}\n")
    if options.document is not None:
        write_table(json.loads(path.read_text(encoding="utf-8")), options.document)


def run(
    campaign: Path, output: Path, cache: Path, cold: bool, limit_s: float, python: Path | str = sys.executable
) -> dict[str, Any]:
    """`calibrate.py run` on a campaign: exit code, seconds, peak memory [bytes] and what it wrote of its stages."""
    shutil.rmtree(output, ignore_errors=True)
    if cold:
        shutil.rmtree(cache, ignore_errors=True)
    command = [str(python), "calibrate.py", "run", str(campaign), "--output", str(output)]
    environment = {**os.environ, "SYSID_CACHE_DIR": str(cache)}
    output.parent.mkdir(parents=True, exist_ok=True)
    said = output.with_suffix(".log")
    with said.open("w", encoding="utf-8") as log:
        begin = time.perf_counter()
        process = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=log, stderr=log)
        guard = threading.Timer(limit_s, process.kill)
        guard.start()
        together = _MemoryTogether(process.pid)
        together.start()
        # The resources of this child alone; those of `getrusage` are of all children.
        _, status, used = os.wait4(process.pid, 0)
        guard.cancel()
        together.ended.set()
        together.join()
        process.returncode = os.waitstatus_to_exitcode(status)
    return {
        "exit": process.returncode,
        "wall_s": time.perf_counter() - begin,
        "processor_s": used.ru_utime + used.ru_stime,
        "peak_bytes": max(used.ru_maxrss * 1024, together.peak_bytes),
        "stages_s": _timings(output / "stages" / "timings.json"),
        "status": _status(output / "result.json"),
        "last_words": said.read_text(encoding="utf-8").strip().splitlines()[-1:],
    }


class _MemoryTogether(threading.Thread):
    """Largest memory of a process and its children together; pages that they share count once."""

    def __init__(self, pid: int):
        super().__init__(daemon=True)
        self._pid, self.ended, self.peak_bytes = pid, threading.Event(), 0

    def run(self) -> None:
        """Look ten times a second."""
        while not self.ended.wait(0.1):
            # To count shared pages takes 15 ms, in which the process itself waits for new ones.
            if with_children(resident_bytes, self._pid) > self.peak_bytes:
                self.peak_bytes = max(self.peak_bytes, with_children(proportional_bytes, self._pid))


def resident_bytes(pid: int) -> int:
    """Memory of a process, with all pages that it shares with others."""
    return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def proportional_bytes(pid: int) -> int:
    """Memory of a process; of a page that n processes share, each has an n-th."""
    return 1024 * int(Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").split("Pss:")[1].split()[0])


def with_children(size: Callable[[int], int], pid: int) -> int:
    """A size of a process and all its children together, 0 where the system does not say."""
    total = 0
    with suppress(OSError, ValueError, IndexError):
        total = size(pid)
        for children in Path(f"/proc/{pid}/task").glob("*/children"):
            total += sum(with_children(size, int(child)) for child in children.read_text(encoding="ascii").split())
    return total


def _timings(path: Path) -> dict[str, float]:
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def _status(path: Path) -> str:
    return str(json.loads(path.read_text(encoding="utf-8"))["status"]) if path.exists() else "not finished"


if __name__ == "__main__":
    main()
