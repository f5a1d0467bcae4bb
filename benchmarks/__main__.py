"""Measure, write ``benchmarks.json``, the figure and, on request, the page of the documentation.

python -m benchmarks --output build/benchmarks [--quick] [--no-peers] [--document docs/evidence/benchmarks.md]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

from sysid.runtime import configure


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("build/benchmarks"), help="folder for what is written")
    parser.add_argument("--quick", action="store_true", help="smallest configuration: one run, few rounds, no fit")
    parser.add_argument("--no-peers", action="store_true", help="leave other solvers out")
    parser.add_argument("--rounds", type=int, default=12, help="rounds of the comparison")
    parser.add_argument("--document", type=Path, help="page to write, for instance docs/evidence/benchmarks.md")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    # Matrices are small: more threads only wait for each other.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    configure()

    from benchmarks.document import write_document
    from benchmarks.figure import draw
    from benchmarks.stages import Plan, measure

    begin = time.perf_counter()

    def say(message: str) -> None:
        sys.stderr.write(f"{time.perf_counter() - begin:6.0f} s  {message}\n")

    plan = Plan(options.output, quick=options.quick, peers=not options.no_peers, rounds=options.rounds)
    found = measure(plan, say)
    path = options.output / "benchmarks.json"
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    say(f"written: {path}")
    # What is drawn and told is what stands in the file.
    kept = json.loads(path.read_text(encoding="utf-8"))
    picture = None if options.document is None else options.document.with_suffix(".svg")
    draw(kept, [options.output / "benchmarks.png", *([] if picture is None else [picture])])
    for page in (options.output / "benchmarks.md", *([] if options.document is None else [options.document])):
        write_document(kept, page)
    say("done")


if __name__ == "__main__":
    main()
