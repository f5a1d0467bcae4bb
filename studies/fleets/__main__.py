"""Command line of the study of simulated fleets.

    python -m studies.fleets [--output DIR] [--replicates N] [--seed SEED] [--document FILE]

computes the fleets that are missing in DIR, prints the tables and, if asked, writes them into FILE.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from studies.coverage.shards import collect, fill
from studies.fleets.simulated import SEED, outliers, replicate
from studies.fleets.table import tables, write
from sysid.workflow.sources import code_digest


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/fleets"), help="folder of the replicates")
    parser.add_argument("--replicates", type=int, default=100, help="number of fleets of each kind")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the fleets")
    parser.add_argument("--document", type=Path, default=None, help="file whose tables are rewritten")
    options = parser.parse_args(arguments)
    kinds: dict[str, Callable[[int], dict[str, Any]]] = {
        "healthy": partial(replicate, seed=options.seed),
        "broken": partial(outliers, seed=options.seed),
        "broken_wide": partial(outliers, seed=options.seed, wide=True),
    }
    found = {}
    for name, one in kinds.items():
        # Fleets of other code of the population are no part of the study.
        study = f"{name}_seed{options.seed}_{code_digest(('fleet',))[:12]}"
        for number in fill(options.output, study, range(options.replicates), one):
            sys.stderr.write(f"{name} {number}\n")
        records = collect(options.output, study).records
        found[name] = [r for r in records if r["number"] < options.replicates]
    text = f"{options.replicates} fleets of each kind, seed {options.seed}.\n\n{tables(found)}"
    sys.stdout.write(text + "\n")
    if options.document is not None:
        write(text, options.document)


if __name__ == "__main__":
    main()
