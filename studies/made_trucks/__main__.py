"""Command line of the study of made trucks.

    python -m studies.made_trucks --output DIR [--count N] [--first N] [--withheld | --all]
        [--keep DIR] [--document FILE]

makes the campaigns that are missing in DIR, calibrates each by `calibrate.py run`, prints what held and, if asked,
writes it into FILE.  A study that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.made_trucks.case import EACH, GROUPS, replicate
from studies.made_trucks.table import tables, write


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/made_trucks"), help="folder of the cases")
    parser.add_argument("--count", type=int, default=None, help="number of campaigns of a group (default: all)")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--withheld", action="store_true", help="the withheld kinds instead of the open ones")
    which.add_argument("--all", action="store_true", help="both")
    parser.add_argument("--keep", type=Path, default=None, help="folder in which campaigns and results stay")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    groups = list(GROUPS) if options.all else ["withheld" if options.withheld else "open"]
    records = []
    for group in groups:
        last = EACH * len(GROUPS[group])
        count = last - options.first if options.count is None else options.count
        numbers = range(options.first, min(options.first + count, last))
        for number in fill(options.output, group, numbers, partial(replicate, group=group, keep=options.keep)):
            sys.stderr.write(f"{group} {number}\n")
        records += collect(options.output, group).records
    sys.stdout.write(tables(records) + "\n")
    if options.document is not None:
        write(records, options.document)


if __name__ == "__main__":
    main()
