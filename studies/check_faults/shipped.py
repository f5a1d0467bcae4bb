"""What `check` says of ordinary mistakes in the shipped truck, one by one.

    python -m studies.check_faults.shipped [--document FILE]

prints a table and, if asked, writes it into FILE.  Logs have numbers for names: their contents alone tell.
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np

from studies.check_faults import lists, sensors
from studies.check_faults.case import check, judged, without_telling_names
from studies.check_faults.made import Copy, Fault, Made, change_columns, change_text
from studies.documents import write_between_marks
from studies.faults.bases import ROOT
from studies.faults.campaign_copy import CampaignCopy

_STEP_S = 0.005
_SEED = 3


def axle_off(place: str, by_m: float) -> Fault:
    """One axle is listed with its sensors `by_m` behind its place."""

    def fault(c: CampaignCopy) -> Made:
        change_text(c, rf"\bx_m = {re.escape(place)}(?=[\s,])", f"x_m = {float(place) + by_m:g}")
        return Made(
            f"axle at {place} m listed at {float(place) + by_m:g} m", (rf"m instead of {float(place) + by_m:.2f} m",)
        )

    return fault


def late(column: str, by_s: float) -> Fault:
    """One channel lags behind by less than two samples."""

    def fault(c: CampaignCopy) -> Made:
        def shifted(y: np.ndarray) -> np.ndarray:
            time = _STEP_S * np.arange(y.size)
            return np.interp(time - by_s, time, np.nan_to_num(y, nan=float(np.nanmedian(y))))

        change_columns(c, [column], shifted)
        return Made(f"{column} {1e3 * by_s:g} ms late", (f"{column}.*late",), frozenset([column]))

    return fault


FAULTS: tuple[Fault, ...] = (
    sensors.axle_upside_down,
    lists.axles_from_the_rear,
    sensors.axles_exchanged,
    lists.speeds(1.0 / 3.6, r"km/h.*m/s"),
    lists.load_cases_exchanged,
    lists.heading(180.0),
    lists.positions(0.93),
    lists.drops_exchanged(False),
    *(axle_off(p, by) for p, by in (("4.07", 0.2), ("4.07", -0.3), ("5.39", 0.25), ("13.33", 0.2), ("15.93", -0.2))),
    *(late(f"{c}", 0.008) for c in ("lvdt1_mm", "lvdt3_mm", "axle2_accel_g", "axle4_accel_g")),
    *(late(f"{c}", 0.008) for c in ("frame1_accel_g", "frame5_accel_g")),
)


def table() -> str:
    """Markdown: every mistake with exit code and the sentence that names it."""
    with tempfile.TemporaryDirectory() as place:
        return _table(without_telling_names(ROOT / "data", Path(place) / "data"))


def _table(source: Path) -> str:
    before = check(source)
    lines = ["| mistake | exit code | said |", "|---|---|---|"]
    for fault in FAULTS:
        with tempfile.TemporaryDirectory() as place:
            copy = Copy(Path(place) / "campaign", np.random.default_rng(_SEED))
            shutil.copytree(source, copy.folder)
            made = fault(copy)
            case = judged(made, check(copy.folder), before)
        said = min(case["right"], key=len) if case["right"] else f"not named ({case['ending']})"
        lines.append(f"| {made.said} | {case['code']} | {said} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Show the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args(arguments)
    made = table()
    sys.stdout.write(f"{made}\n")
    if options.document is not None:
        write_between_marks(options.document, "shipped truck", made)


if __name__ == "__main__":
    main()
