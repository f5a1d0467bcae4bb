"""Command line of a study of many simulated campaigns, one file each: fill what is missing, show and write a table."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from studies.coverage.shards import Record, collect, fill


def run_cases(
    description: str | None,
    name: str,
    replicate: Callable[..., Record],
    table: Callable[[Sequence[Record]], str],
    write: Callable[[Sequence[Record], int, Path], None],
    arguments: list[str] | None,
    *,
    folder: str,
    count: int,
    seed: int,
) -> None:
    """Compute the cases that have no file yet, print their table and, if asked, write it into a page.

    Parameters
    ----------
    name : begin of the names of the files. replicate : of a number and a `seed`.
    table : Markdown of records; write : of records, seed and page.
    folder, count, seed : what applies without options.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(folder), help="folder of the cases")
    parser.add_argument("--count", type=int, default=count, help="number of campaigns")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=seed, help="seed of the campaigns")
    parser.add_argument("--document", type=Path, default=None, help="file whose tables are rewritten")
    options = parser.parse_args(arguments)
    study, run = f"{name}{options.seed}", partial(replicate, seed=options.seed)
    for number in fill(options.output, study, range(options.first, options.first + options.count), run):
        sys.stderr.write(f"{number}\n")
    records = collect(options.output, study).records
    sys.stdout.write(table(records) + "\n")
    if options.document is not None:
        write(records, options.seed, options.document)
