"""Command line of the study of kills.

    python -m studies.kills [--output DIR] [--count N] [--seed SEED] [--document FILE]

kills `run --resume` of one small campaign until there are N kills, and compares every folder that has come to its end
with an undisturbed one.  Prints where the kills were and, if asked, writes that into FILE.  A study that was stopped
goes on with the next folder.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

from studies.coverage.shards import collect, fill
from studies.documents import write_between_marks
from studies.kills.case import SEED, replicate


def main(arguments: list[str] | None = None) -> None:
    """Fill the shards and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/kills"), help="folder of the records")
    parser.add_argument("--count", type=int, default=300, help="number of kills")
    parser.add_argument("--seed", type=int, default=SEED, help="seed of the moments")
    parser.add_argument("--document", type=Path, default=None, help="file whose figures are rewritten")
    options = parser.parse_args(arguments)
    study = f"kill{options.seed}"

    def left() -> int:
        return options.count - sum(len(r["killed"]) for r in collect(options.output, study).records)

    run = partial(replicate, bases=options.output / "base", seed=options.seed)
    if left() > 0:
        for number in fill(options.output, study, range(options.count), run):
            sys.stderr.write(f"{number}: {left()} kills left\n")
            if left() <= 0:
                break
    records = collect(options.output, study).records
    for record in records:
        for wrong in record["wrong"]:
            sys.stdout.write(f"{record['number']}: {wrong}\n")
    sys.stdout.write(f"{figures(records, options.seed)}\n")
    if options.document is not None:
        write_between_marks(options.document, "kills", figures(records, options.seed))


def figures(records: list[dict[str, Any]], seed: int) -> str:
    """A sentence and a line: how many kills, in which stages, and how the folders ended."""
    counts = Counter(place for r in records for place in r["killed"])
    good = sum(not r["wrong"] for r in records)
    places = ", ".join(f"{place} {number}" for place, number in counts.most_common())
    return (
        f"{counts.total()} kills in {len(records)} folders, seed {seed}; {good} of the folders ended as the "
        f"undisturbed one.\n\nKills by stage: {places}."
    )


if __name__ == "__main__":
    main()
