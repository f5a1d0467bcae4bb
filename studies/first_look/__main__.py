"""Table of what `init` guesses right, marks and leaves to a person, on campaigns whose truth is their campaign file.

    python -m studies.first_look [CAMPAIGN ...] [--no-check] [--document docs/howto/init.md]

CAMPAIGN are folders with a campaign.toml; by default the shipped truck, the linear truck, a three-axle truck, and a
vehicle of eight axles on beams; the logs of the last two are simulated into the output folder first.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.first_look.judging import Score, judged
from studies.first_look.variants import VARIANTS, write_variant

ROOT = Path(__file__).resolve().parents[2]
_MARK = "<!-- table of python -m studies.first_look -->"


def simulated(output: Path, vehicle: str) -> Path:
    """Folder of a campaign that is simulated where it is not there."""
    folder = output / vehicle
    if not (folder / "truth.toml").is_file():
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--vehicle", vehicle]
        subprocess.run([*command, "--output", str(folder)], check=True, cwd=ROOT)
    return folder


def _row(title: str, scores: Sequence[Score]) -> str:
    codes = sorted({score.check for score in scores if score.check is not None})
    cells = (
        title,
        f"{sum(s.right for s in scores)} of {sum(s.columns for s in scores)}",
        str(sum(s.marked for s in scores)),
        str(sum(len(s.silent) for s in scores)),
        f"{sum(s.tests_right for s in scores)} of {sum(s.tests for s in scores)}",
        str(sum(len(s.tests_silent) for s in scores)),
        ", ".join(str(s.to_fill) for s in scores),
        ", ".join(map(str, codes)) or "-",
    )
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| logs | columns right | columns marked | wrong, not marked | drops and runs right | wrong, not marked | "
    "values to fill in | exit codes of `check` then |\n|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    """Write the table to the terminal, and into a document that has a place for it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("campaigns", nargs="*", type=Path)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "first_look")
    parser.add_argument("--document", type=Path)
    parser.add_argument("--no-check", action="store_true", help="do not fill in the file, which takes most of the time")
    arguments = parser.parse_args()
    campaigns = arguments.campaigns or [
        ROOT / "data",
        ROOT / "examples" / "linear_truck",
        *(simulated(arguments.output, v) for v in ("rigid3", "veqmon2d")),
    ]
    rows = [HEAD]
    for variant in VARIANTS:
        scores = []
        for campaign in campaigns:
            written = write_variant(campaign, arguments.output / "logs", variant)
            scores.append(judged(written, None, check=not arguments.no_check))
            shown = _row(f"{campaign.name}, {variant.title}", scores[-1:])
            sys.stdout.write(f"{shown} {scores[-1].silent} {scores[-1].tests_silent}\n")
            sys.stdout.flush()
        rows.append(_row(variant.title, scores))
    sys.stdout.write("\n".join(rows) + "\n")
    if arguments.document is not None:
        before, _, rest = arguments.document.read_text(encoding="utf-8").partition(_MARK)
        after = rest.partition(_MARK)[2]
        text = f"{before}{_MARK}\n\n" + "\n".join(rows) + f"\n\n{_MARK}{after}"
        arguments.document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
