"""Table of what `init` guesses right, marks and leaves to a person, on campaigns whose truth is their campaign file.

    python -m studies.first_look [CAMPAIGN ...] [--document docs/howto/init.md]

CAMPAIGN are folders with a campaign.toml; by default the shipped truck, the linear truck, a three-axle truck, and a
vehicle of eight axles on beams; the logs of the last two are simulated into the output folder first.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
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


def _row(campaign: str, title: str, score: Score) -> str:
    wrong = len(score.silent)
    cells = (
        campaign,
        title,
        score.vehicle,
        f"{score.right} of {score.columns}",
        str(score.marked),
        str(wrong),
        f"{score.tests_right} of {score.tests}",
        str(len(score.tests_silent)),
        str(score.to_fill),
        str(score.to_confirm),
        str(score.check),
    )
    return "| " + " | ".join(cells) + " |"


HEAD = (
    "| campaign | logs | vehicle | columns right | columns marked | wrong, not marked | drops and runs right | "
    "wrong, not marked | values to fill in | guesses to confirm | exit code of `check` then |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|"
)


def main() -> None:
    """Write the table to the terminal, and into a document that has a place for it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("campaigns", nargs="*", type=Path)
    parser.add_argument("--output", type=Path, default=ROOT / "build" / "first_look")
    parser.add_argument("--document", type=Path)
    arguments = parser.parse_args()
    campaigns = arguments.campaigns or [
        ROOT / "data",
        ROOT / "examples" / "linear_truck",
        *(simulated(arguments.output, v) for v in ("rigid3", "veqmon2d")),
    ]
    rows = [HEAD]
    for campaign in campaigns:
        for variant in VARIANTS:
            written = write_variant(campaign, arguments.output / "logs", variant)
            score = judged(written, None)
            rows.append(_row(campaign.name, variant.title, score))
            sys.stdout.write(f"{rows[-1]} {score.silent} {score.tests_silent}\n")
            sys.stdout.flush()
    if arguments.document is not None:
        before, _, rest = arguments.document.read_text(encoding="utf-8").partition(_MARK)
        after = rest.partition(_MARK)[2]
        text = f"{before}{_MARK}\n\n" + "\n".join(rows) + f"\n\n{_MARK}{after}"
        arguments.document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
