"""Command line of the study of failing calls.

    python -m studies.failing_calls [--commands NAME ...] [--kinds NAME ...] [--step N] [--document FILE]

gives every command again and again, and each time the next call to the system fails, until none does.  Prints what went
wrong and a table and, if asked, writes the table into FILE.  Linux with a C compiler.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from studies.documents import write_between_marks
from studies.failing_calls.case import KINDS, commands, compiled, every


def main() -> None:
    """Try all calls, a record each in a file of the output folder, and show what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("build/failing_calls"), help="folder of the records")
    parser.add_argument("--commands", nargs="*", default=("export",), help="export, report or 'run --resume'")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--step", type=int, default=1, help="every so many-th call")
    parser.add_argument("--document", type=Path, default=None, help="file whose table is rewritten")
    options = parser.parse_args()
    if "failing_calls" not in os.environ.get("LD_PRELOAD", ""):
        shim = str(compiled(options.output).resolve())
        os.execve(
            sys.executable,
            [sys.executable, "-m", "studies.failing_calls", *sys.argv[1:]],
            os.environ | {"LD_PRELOAD": shim},
        )
    file = options.output / "records.jsonl"
    for name in options.commands:
        command = commands(options.output / "base")[name]
        for kind in options.kinds:
            for record in every(command, kind, options.step):
                for wrong in record["wrong"]:
                    sys.stdout.write(f"{name}, {kind} {record['nth']}: {wrong}\n")
                with file.open("a", encoding="utf-8") as lines:
                    lines.write(json.dumps({"command": name, "step": options.step, **record}) + "\n")
            sys.stderr.write(f"{name}, {kind}: done\n")
    records = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    sys.stdout.write(table(records) + "\n")
    if options.document is not None:
        write_between_marks(options.document, "failing calls", table(records))


def table(records: list[dict[str, Any]]) -> str:
    """Calls that failed, by command and kind, and how the commands ended."""
    lines = [
        "| command | failing call | tried | exit 0 | a sentence | exit 1, a traceback or no end | lost or not whole |",
        "|---|---|---:|---:|---:|---:|---:|",
    ]
    for name, kind in dict.fromkeys((r["command"], r["kind"]) for r in records):
        some = [r for r in records if (r["command"], r["kind"]) == (name, kind)]
        ends = Counter("0" if r["code"] == 0 else "said" if r["code"] in (2, 3, 4) else "bad" for r in some)
        lost = sum(any(not w.startswith("exit code") for w in r["wrong"]) for r in some)
        what = kind if some[0]["step"] == 1 else f"{kind}, every {some[0]['step']}th"
        lines.append(f"| `{name}` | {what} | {len(some)} | {ends['0']} | {ends['said']} | {ends['bad']} | {lost} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
