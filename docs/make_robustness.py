"""Write the figures of the last fuzzing into docs/robustness.md: build/figures/fuzz.json, as `make fuzz` leaves it.

python docs/make_robustness.py
"""

from __future__ import annotations

import json
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BEGIN, END = "<!-- figures of the last run -->\n", "<!-- end of figures -->\n"


def main() -> None:
    """Replace what stands between the two marks."""
    found = json.loads((ROOT / "build" / "figures" / "fuzz.json").read_text(encoding="utf-8"))
    readers = found["readers"]
    files = sum(r["files"] for r in readers.values())
    lines = [
        f"Last run: {files:,} files in {found['minutes']} minutes, {found['tracebacks']} tracebacks.",
        "",
        "| reader | files | refused | longest [s] | most memory [MB] |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {r['files']:,} | {r['refused']:,} | {r['seconds']} | {r['MB']} |"
            for name, r in readers.items()
        ),
    ]
    page = ROOT / "docs" / "robustness.md"
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    _, after = rest.split(END)
    page.write_text(f"{before}{BEGIN}\n{chr(10).join(lines)}\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
