"""Figures that long tests measure, kept in build/figures/ for the tables of docs/evidence/statistics.md."""

from __future__ import annotations

import json
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "build" / "figures"


def record(name: str, figures: object) -> None:
    """Keep what a test has measured as build/figures/NAME.json."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / f"{name}.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
