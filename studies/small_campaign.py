"""The smallest campaign that passes every stage: a three-axle truck, one run in each of two load cases."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_OPTIONS = ("--vehicle", "rigid3", "--speeds-km-h", "16", "--drops-per-axle", "1", "--scan-points", "6000")


def small_campaign(folder: Path) -> Path:
    """The campaign in `folder`, made if it is not there."""
    if not (folder / "truth.toml").exists():
        shutil.rmtree(folder, ignore_errors=True)
        command = [sys.executable, "-m", "tests.support.synthetic_campaign", "--output", str(folder), *_OPTIONS]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return folder
