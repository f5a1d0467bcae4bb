"""Command line of the coverage studies.

    python -m studies.coverage [STUDY ...] [--output DIR] [--replicates N] [--document FILE]

computes the replicates that are missing in DIR and, if asked, rewrites the section "Coverage" of FILE.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path

from studies.coverage.shards import collect, fill
from studies.coverage.tables import write
from sysid.runtime import configure

#: Studies and how many replicates each has; the module of the same name has a function `replicate`.
STUDIES = {"drops": 400, "bump": 400, "masses": 400, "rough": 400, "misfit": 26}


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards of the studies asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", nargs="*", metavar="STUDY", help=f"of {', '.join(STUDIES)} (default: all)")
    parser.add_argument("--output", type=Path, default=Path("build/coverage"), help="folder of the replicates")
    parser.add_argument("--replicates", type=int, default=None, help="replicates of each study")
    parser.add_argument("--document", type=Path, default=None, help="file whose section on coverage is rewritten")
    parser.add_argument("--tables-only", action="store_true", help="compute nothing, write the document")
    options = parser.parse_args(arguments)
    unknown = sorted(set(options.studies) - set(STUDIES))
    if unknown:
        parser.error(f"{', '.join(unknown)} is no study; there are {', '.join(STUDIES)}")
    configure()
    for study in () if options.tables_only else options.studies or STUDIES:
        replicate = importlib.import_module(f"studies.coverage.{study}").replicate
        for number in fill(options.output, study, range(options.replicates or STUDIES[study]), replicate):
            sys.stderr.write(f"{study} {number}\n")
    for study in options.studies or STUDIES:
        foreign = collect(options.output, study).foreign
        if foreign:
            sys.stderr.write(f"{study}: {foreign} replicates of other code are left out\n")
    if options.document is not None:
        write(options.output, options.document)


if __name__ == "__main__":
    main()
