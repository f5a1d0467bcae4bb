"""Command line of the study of faults that `check` must name.

    python -m studies.check_faults [--output DIR] [--seed SEED] [--healthy N] [--effects] [--document FILE]

puts every fault into every base campaign, one after the other, runs `calibrate.py check` on it in this process, does
the same with healthy campaigns, prints tables and, if asked, writes them into FILE: with --count 0 those of healthy
campaigns alone.  With --effects the three-axle campaign is fitted with every fault that passed, and without.  A study
that was stopped goes on where it was.
"""

from __future__ import annotations

import argparse
import sys
from functools import cache, partial
from pathlib import Path

from studies.check_faults.case import cases, faulty, unharmed
from studies.check_faults.effects import effect, fitted, passed
from studies.check_faults.table import (
    falsely_accused,
    fault_table,
    healthy_table,
    share_named,
    unnamed,
    write,
)
from studies.coverage.shards import collect, fill

SEED = 7301


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/check_faults"), help="folder of the cases")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of faults and simulated campaigns")
    parser.add_argument("--count", type=int, default=len(cases()), help="number of cases with a fault")
    parser.add_argument("--healthy", type=int, default=40, help="number of healthy campaigns")
    parser.add_argument("--trucks", nargs="+", default=(), help="vehicles of the healthy campaigns, in turn")
    parser.add_argument("--document", type=Path, default=None, help="file whose tables are rewritten")
    parser.add_argument("--effects", action="store_true", help="measure what faults that pass do to k and c")
    options = parser.parse_args(arguments)
    folder = options.output / "bases"
    run = partial(faulty, folder=folder, seed=options.seed, known={})
    for number in fill(options.output, f"fault{options.seed}", range(options.count), run):
        sys.stderr.write(f"fault {number}\n")
    whole = partial(unharmed, folder=folder, seed=options.seed, trucks=options.trucks)
    for number in fill(options.output, f"healthy{options.seed}", range(options.healthy), whole):
        sys.stderr.write(f"healthy {number}\n")
    faults = collect(options.output, f"fault{options.seed}").records
    healthy = collect(options.output, f"healthy{options.seed}").records
    if options.effects:
        measure = partial(effect, folder=folder, seed=options.seed, right=cache(fitted))
        for which in passed(faults):
            for number in fill(options.output, f"effect{options.seed}", range(which, which + 1), measure):
                sys.stderr.write(f"effect {number}\n")
    effects = collect(options.output, f"effect{options.seed}").records
    wrong, channels = falsely_accused(faults)
    sys.stdout.write(
        f"{fault_table(faults)}\n\nnamed: {100 * share_named(faults):.1f} %; healthy records accused: {wrong} of "
        f"{channels}\n\n{healthy_table(healthy)}\n\n{unnamed(faults)}\n"
    )
    if options.document is not None:
        write(faults, healthy, effects, options.seed, options.document)


if __name__ == "__main__":
    main()
