"""Command line of the study of faults.

    python -m studies.faults [--output DIR] [--count N] [--first N] [--seed SEED] [--check] [--document FILE]

runs `calibrate.py fit --quick` (or `check` alone) on the cases that are missing in DIR, one after the other, prints
what they end in and, if asked, writes it into FILE.  A study that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.faults.case import SEED, replicate
from studies.faults.table import table, write


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/faults"), help="folder of the cases")
    parser.add_argument("--count", type=int, default=300, help="number of cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the cases")
    parser.add_argument("--check", action="store_true", help="only the check of the data, some seconds per case")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    command = ("check",) if options.check else ("fit", "--quick")
    study = f"{command[0]}{options.seed}"
    run = partial(replicate, command=command, bases=options.output / "bases", seed=options.seed)
    for number in fill(options.output, study, range(options.first, options.first + options.count), run):
        sys.stderr.write(f"{number}\n")
    records = collect(options.output, study).records
    sys.stdout.write(table(records) + "\n")
    if options.document is not None:
        write(records, " ".join(command), options.seed, options.document)


if __name__ == "__main__":
    main()
