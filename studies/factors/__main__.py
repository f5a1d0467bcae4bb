"""Command line of the study of factors.

    python -m studies.factors [--output DIR] [--count N] [--first N] [--seed SEED] [--document FILE]

simulates the campaigns that are missing in DIR, fits each with one allowance left out at a time, prints what held and,
if asked, writes it into FILE.  A study that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.factors.leave_out import SEED, replicate
from studies.factors.table import table, write
from sysid.runtime import configure


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/factors"), help="folder of the cases")
    parser.add_argument("--count", type=int, default=20, help="number of campaigns")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the campaigns")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    configure()
    study, run = f"factors{options.seed}", partial(replicate, seed=options.seed)
    for number in fill(options.output, study, range(options.first, options.first + options.count), run):
        sys.stderr.write(f"{number}\n")
    records = collect(options.output, study).records
    sys.stdout.write(table(records) + "\n")
    if options.document is not None:
        write(records, options.seed, options.document)


if __name__ == "__main__":
    main()
