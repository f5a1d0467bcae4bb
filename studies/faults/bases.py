"""The campaigns that faults are made in: the linear truck and simulated vehicles, ordinary and odd ones."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

#: Options of `tests.support.synthetic_campaign` by base, and how often each is drawn; none: the linear truck.
BASES: dict[str, tuple[float, tuple[str, ...] | None]] = {
    "rigid3": (8.0, ("--vehicle", "rigid3")),
    "semitrailer5": (2.0, ("--vehicle", "semitrailer5")),
    "linear truck": (1.0, None),
    "strong_friction": (2.0, ("--vehicle", "rigid3", "--suspension-law", "friction", "--element-spread", "0.3")),
    "saturating_dampers": (1.5, ("--vehicle", "rigid3", "--suspension-law", "asymmetric_damper")),
    "stiff_and_soft": (2.0, ("--vehicle", "rigid3", "--parameter-spread", "0.7")),
    "fast": (1.0, ("--vehicle", "rigid3", "--speeds-km-h", "24", "40", "--bump-height-m", "0.09")),
}


def base(name: str, folder: Path) -> Path:
    """Folder of a base campaign, made if it is not there."""
    options = BASES[name][1]
    if options is None:
        return ROOT / "examples" / "linear_truck"
    made = folder / name
    if not (made / "truth.toml").exists():
        shutil.rmtree(made, ignore_errors=True)
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--output", str(made), "--seed", "3"]
        subprocess.run([*command, *options], cwd=ROOT, check=True, capture_output=True)
        # What the suspension really is stays unsaid, as on a real truck.
        file = made / "campaign.toml"
        file.write_text(re.sub(r"(?m)^suspension_law = .*\n", "", file.read_text(encoding="utf-8")), encoding="utf-8")
    return made
