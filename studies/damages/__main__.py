"""Command line of the study of damages.

    python -m studies.damages [--output DIR] [--count N] [--first N] [--seed SEED] [--document FILE]

damages copies of one small result folder, a file each, and runs `export`, sometimes `report` and `run --resume`, on
them in this process.  Prints every failure and a table and, if asked, writes the table into FILE.  A study that was
stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.damages.case import SEED, replicate
from studies.damages.table import failures, figures, table, write


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/damages"), help="folder of the cases")
    parser.add_argument("--count", type=int, default=2000, help="number of cases")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the cases")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    study = f"damage{options.seed}"
    run = partial(replicate, bases=options.output / "base", seed=options.seed)
    for number in fill(options.output, study, range(options.first, options.first + options.count), run):
        sys.stderr.write(f"{number}\n")
    records = collect(options.output, study).records
    for record in records:
        for failure in failures(record):
            sys.stdout.write(f"{record['number']} {record['file']}, {record['damage']}, {record['done']}: {failure}\n")
    sys.stdout.write(f"{figures(records, options.seed)}\n\n{table(records)}\n")
    if options.document is not None:
        write(records, options.seed, options.document)


if __name__ == "__main__":
    main()
