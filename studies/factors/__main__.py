"""Command line of the study of factors.

    python -m studies.factors [--output DIR] [--count N] [--first N] [--seed SEED] [--document FILE]

simulates the campaigns that are missing in DIR, fits each with one allowance left out at a time, prints what held and,
if asked, writes it into FILE.  A study that was stopped goes on where it was.
"""

from __future__ import annotations

from studies.cases import run_cases
from studies.factors.leave_out import SEED, replicate
from studies.factors.table import table, write
from sysid.runtime import configure


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    configure()
    run_cases(__doc__, "factors", replicate, table, write, arguments, folder="build/factors", count=20, seed=SEED)


if __name__ == "__main__":
    main()
