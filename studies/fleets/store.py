"""How long a fleet of many trucks takes: ``python -m studies.fleets.store --template FOLDER --trucks 1000``.

FOLDER holds the results of one campaign of a fleet; those of the trucks are copies that differ in name and numbers.
The commands of a user are then timed one by one, and the tables asked the questions of docs/fleet-tables.md.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from sysid.fleet.draws import RECORD_FILE, read_draws, record_digest, write_draws
from sysid.fleet.key import file_digests, result_digest
from sysid.fleet.outcome import OUTCOME_FILE, RESULT_FILE, read_outcome, write_outcome
from sysid.fleet.read import FLEET_FILE
from sysid.fleet.running import campaign_output
from sysid.fleet.tables import TABLES

ROOT = Path(__file__).resolve().parents[2]
DOCUMENT = ROOT / "docs" / "fleet-tables.md"
COMMANDS = ("status", "index", "report")
#: Standard deviations of the logarithms: between trucks, and between campaigns of one.
SPREAD, SCATTER = 0.08, 0.02


def simulated_results(template: Path, folder: Path, output: Path, trucks: int, each: int, types: int) -> None:
    """A fleet file, and folders of results, with the numbers of a real campaign moved about."""
    document = json.loads((template / RESULT_FILE).read_bytes())
    record, outcome = read_draws(template / RECORD_FILE), read_outcome(template)
    if record is None or outcome is None:
        raise SystemExit(f"{template} is no folder of results of a fleet's campaign.")
    lines = ["schema = 1", "[fleet]", 'title = "simulated"']
    for truck in range(trucks):
        of_truck = np.random.default_rng(truck).normal(0.0, SPREAD, record.draws.shape[1])
        lines += ["[[truck]]", f'name = "T{truck:05d}"', f'type = "type {truck % types}"', "campaign = ["]
        for number in range(each):
            name = f"C{truck:05d}-{number}"
            lines.append(f'  {{ folder = "{name}" }},')
            place = campaign_output(output, name)
            if (place / OUTCOME_FILE).exists():
                continue
            place.mkdir(parents=True, exist_ok=True)
            random = np.random.default_rng([truck, number])
            moved = of_truck + random.normal(0.0, SCATTER, record.draws.shape[1])
            moves = dict(zip(record.names, np.exp(moved), strict=True))
            parameters = [_moved(p, float(moves.get(p["name"], 1.0))) for p in document["parameters"]]
            text = json.dumps(document | {"campaign": name, "parameters": parameters}, indent=2)
            (place / RESULT_FILE).write_text(text)
            write_draws(place / RECORD_FILE, replace(record, draws=record.draws + moved))
            made = replace(
                outcome,
                inputs={},
                result_sha256=result_digest(place / RESULT_FILE),
                file_sha256=file_digests(place, [RESULT_FILE])[RESULT_FILE],
                draws_sha256=record_digest(place),
            )
            write_outcome(place, made)
        lines.append("]")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FLEET_FILE).write_text("\n".join(lines) + "\n")


def _moved(parameter: dict[str, object], factor: float) -> dict[str, object]:
    made = dict(parameter)
    for kind in ("least_squares", "posterior"):
        values = made[kind]
        if isinstance(values, dict):
            made[kind] = {k: v if k in ("ess", "rhat") or v is None else v * factor for k, v in values.items()}
    return made


def timed(command: str, folder: Path, output: Path) -> str:
    """Run a command of the fleet: seconds on the clock and of the processor, and largest memory of a process of it."""
    words = [sys.executable, str(ROOT / "calibrate.py"), "fleet", command, str(folder), "--output", str(output)]
    begin = time.perf_counter()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    _, code, used = os.wait4(process.pid, 0)
    seconds, processor = time.perf_counter() - begin, used.ru_utime + used.ru_stime
    return f"{command}: exit {code >> 8}, {seconds:.1f} s, processor {processor:.1f} s, {used.ru_maxrss / 1e3:.0f} MB"


def questions(text: str) -> list[str]:
    """The SQL of a page."""
    return re.findall(r"```sql\n(.*?)```", text, re.DOTALL)


def ask(folder: Path, queries: list[str]) -> list[tuple[float, int]]:
    """Seconds and rows of every query, by DuckDB."""
    import duckdb

    db = duckdb.connect()
    for table in TABLES:
        db.execute(f"CREATE VIEW {table} AS SELECT * FROM '{folder / f'{table}.parquet'}'")
    result = []
    for query in queries:
        begin = time.perf_counter()
        rows = len(db.execute(query).fetchall())
        result.append((time.perf_counter() - begin, rows))
    return result


def main(arguments: list[str] | None = None) -> None:
    """Simulate, give the commands, ask, and say what it took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--template", type=Path, required=True, help="results of one campaign")
    parser.add_argument("--trucks", type=int, default=1000)
    parser.add_argument("--each", type=int, default=1, help="campaigns of every truck")
    parser.add_argument("--types", type=int, default=1)
    parser.add_argument("--commands", nargs="*", default=COMMANDS, choices=COMMANDS)
    parser.add_argument("--output", type=Path, default=Path("build/fleet_store"))
    options = parser.parse_args(arguments)
    folder, output = options.output / "fleet", options.output / "out"
    simulated_results(options.template, folder, output, options.trucks, options.each, options.types)
    for command in options.commands:
        sys.stdout.write(timed(command, folder, output) + "\n")
        sys.stdout.flush()
    tables = output / "fleet.parquet"
    if not tables.is_dir():
        return
    sizes = {t: (tables / f"{t}.parquet").stat().st_size / 1e6 for t in TABLES}
    sys.stdout.write(f"files [MB]: {', '.join(f'{t} {s:.1f}' for t, s in sizes.items())}\n")
    for number, (took, rows) in enumerate(ask(tables, questions(DOCUMENT.read_text(encoding="utf-8"))), start=1):
        sys.stdout.write(f"question {number}: {took:.3f} s, {rows} rows\n")


if __name__ == "__main__":
    main()
