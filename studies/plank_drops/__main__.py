"""Command line of the study of made plank drops.

    python -m studies.plank_drops [--output DIR] [--replicates N] [--seed SEED] [--document FILE]

computes the replicates that are missing in DIR, prints the table and, if asked, writes it into FILE.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.plank_drops.reading import SEED, replicate
from studies.plank_drops.table import table, write


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/plank_drops"), help="folder of the replicates")
    parser.add_argument("--replicates", type=int, default=400, help="number of plank drops")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the plank drops")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    study = f"seed{options.seed}"
    for number in fill(options.output, study, range(options.replicates), partial(replicate, seed=options.seed)):
        sys.stderr.write(f"{number}\n")
    records = [r for r in collect(options.output, study).records if r["number"] < options.replicates]
    sys.stdout.write(table(records) + "\n")
    if options.document is not None:
        write(records, options.seed, options.document)


if __name__ == "__main__":
    main()
