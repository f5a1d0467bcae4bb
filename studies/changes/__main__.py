"""Command line of the study of changes.

    python -m studies.changes [--independent] [--output DIR] [--count N] [--first N] [--seed SEED] [--document FILE]

simulates the pairs of campaigns that are missing in DIR, fits both, compares them, prints what `compare` found and, if
asked, writes it into FILE.  The trucks are those of the program's own equations, or of independent ones.  A study that
was stopped goes on where it was.
"""

from __future__ import annotations

import sys

from studies.cases import run_cases
from studies.changes import case, own
from studies.changes.table import tables, write, write_independent


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    given = sys.argv[1:] if arguments is None else arguments
    independent = "--independent" in given
    rest = [word for word in given if word != "--independent"]
    of = ("independent", case.replicate, write_independent) if independent else ("own", own.replicate, write)
    name, replicate, writes = of
    run_cases(__doc__, name, replicate, tables, writes, rest, folder="build/changes", count=40, seed=case.SEED)


if __name__ == "__main__":
    main()
