"""Command line of the study of independent trucks.

    python -m studies.independent [--output DIR] [--count N] [--first N] [--seed SEED] [--document FILE]

simulates the campaigns that are missing in DIR, calibrates each by `calibrate.py run`, prints what held and, if asked,
writes it into FILE.  A study that was stopped goes on where it was.
"""

from __future__ import annotations

from studies.cases import run_cases
from studies.independent.case import EACH, KINDS, SEED, replicate
from studies.independent.table import tables, write


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    count = EACH * len(KINDS)
    run_cases(__doc__, "run", replicate, tables, write, arguments, folder="build/independent", count=count, seed=SEED)


if __name__ == "__main__":
    main()
