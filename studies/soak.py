"""Many calibrations in one process: memory, handles and threads after each, and the peak of every part of a run.

    python -m studies.soak [--output DIR] [--count N] [--campaign DIR] [--full]

runs `Calibration(...).run()` N times, previews unless --full, of the small campaign unless another is given, and prints
a line for each and, for the first and the last, the peak of memory of every part.  Each run adds a line of JSON to
soak.jsonl in DIR.
"""

from __future__ import annotations

import argparse
import gc
import json
import shutil
import sys
from pathlib import Path
from typing import Any

from studies.process import open_files, processor_seconds, reset_peak, status
from studies.small_campaign import small_campaign

#: Runs after which everything is loaded and compiled.
WARM = 4


class Watch:
    """Progress of a calibration that keeps the peak of memory of every part [bytes]."""

    def __init__(self) -> None:
        self.peaks: dict[str, float] = {}
        self._part = "reading"
        reset_peak()

    def __call__(self, message: str, fraction: float) -> None:
        self.end()
        self._part = message.split(",")[0]

    def end(self) -> None:
        """The part that runs has ended."""
        self.peaks[self._part] = max(self.peaks.get(self._part, 0.0), status("VmHWM"))
        reset_peak()


def calibration(campaign: Path, output: Path, quick: bool) -> dict[str, Any]:
    """One calibration, and what the process holds after it."""
    from sysid.workflow import Calibration, make_settings

    watch = Watch()
    began = processor_seconds()
    Calibration(campaign, output, make_settings(quick=quick), watch).run()
    watch.end()
    gc.collect()
    return {
        "resident_MB": round(status("VmRSS") / 1e6, 1),
        "peak_MB": round(max(watch.peaks.values()) / 1e6, 1),
        "files": open_files(),
        "threads": int(status("Threads")),
        "seconds": round(processor_seconds() - began, 1),
        "peaks_MB": {part: round(peak / 1e6) for part, peak in watch.peaks.items()},
    }


def growth(records: list[dict[str, Any]]) -> float:
    """Relative growth of the resident memory from the 4th to the last calibration."""
    return float(records[-1]["resident_MB"] / records[min(WARM, len(records)) - 1]["resident_MB"] - 1.0)


def main(arguments: list[str] | None = None) -> None:
    """Run and show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/soak"), help="folder of the results")
    parser.add_argument("--count", type=int, default=24, help="number of calibrations")
    parser.add_argument("--campaign", type=Path, default=None, help="folder of another campaign")
    parser.add_argument("--full", action="store_true", help="no previews")
    options = parser.parse_args(arguments)
    campaign = options.campaign or small_campaign(options.output / "campaign")
    records = []
    for number in range(1, options.count + 1):
        shutil.rmtree(options.output / "result", ignore_errors=True)
        found = calibration(campaign, options.output / "result", not options.full)
        records.append(found)
        with (options.output / "soak.jsonl").open("a", encoding="utf-8") as stream:
            stream.write(json.dumps({"number": number, **found}) + "\n")
        shown = {name: value for name, value in found.items() if name != "peaks_MB"}
        sys.stdout.write(f"{number}: {shown}\n")
        if number in (1, options.count):
            sys.stdout.write("".join(f"    {peak:6.0f} MB {part}\n" for part, peak in found["peaks_MB"].items()))
        sys.stdout.flush()
    sys.stdout.write(f"Memory from the {min(WARM, options.count)}th on: {100.0 * growth(records):+.1f} %\n")


if __name__ == "__main__":
    main()
