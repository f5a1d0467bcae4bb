"""How long the tables of many campaigns take: ``python -m studies.fleets.store --template FOLDER --campaigns 10000``.

FOLDER holds the results of one campaign of a fleet; its copies differ in name and numbers.  Written once, indexed, and
asked the questions of docs/fleet-tables.md.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from studies.process import status
from sysid.fleet.draws import RECORD_FILE, read_draws, write_draws
from sysid.fleet.index import INDEX_FOLDER, write_index
from sysid.fleet.outcome import OUTCOME_FILE, RESULT_FILE, SCHEMA, read_outcome
from sysid.fleet.records import Fleet, FleetCampaign, Truck
from sysid.fleet.running import campaign_output
from sysid.fleet.tables import TABLES

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "fleet-tables.md"


def simulated_results(template: Path, output: Path, count: int) -> Fleet:
    """Folders of `count` campaigns, two per truck, with the numbers of a real one moved about by 10 %."""
    document = json.loads((template / RESULT_FILE).read_bytes())
    record, outcome = read_draws(template / RECORD_FILE), read_outcome(template)
    if record is None or outcome is None:
        raise SystemExit(f"{template} is no folder of results of a fleet's campaign.")
    trucks = []
    for number in range(count):
        name = f"C{number:05d}"
        if number % 2 == 0:
            trucks.append(Truck(f"T{number // 2:05d}", f"type {number % 6 // 2}", ()))
        campaigns = (*trucks[-1].campaigns, FleetCampaign(name, output / "none"))
        trucks[-1] = replace(trucks[-1], campaigns=campaigns)
        folder = campaign_output(output, name)
        if (folder / OUTCOME_FILE).exists():
            continue
        folder.mkdir(parents=True, exist_ok=True)
        random = np.random.default_rng(number)
        for p in document["parameters"]:
            factor = float(np.exp(0.1 * random.standard_normal()))
            for values in (p["least_squares"], p["posterior"] or {}):
                values |= {k: v * factor for k, v in values.items() if k not in ("ess", "rhat") and v is not None}
        text = json.dumps(document | {"campaign": name}, indent=2)
        (folder / RESULT_FILE).write_text(text)
        moved = record.draws + 0.1 * random.standard_normal(record.draws.shape[1])
        write_draws(folder / RECORD_FILE, replace(record, draws=moved))
        own = replace(outcome, result_sha256=hashlib.sha256(text.encode()).hexdigest())
        (folder / OUTCOME_FILE).write_text(json.dumps({"schema": SCHEMA, **asdict(own)}))
    return Fleet("simulated", output, tuple(trucks))


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
    """Simulate, index, ask, and say what it took."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--template", type=Path, required=True, help="results of one campaign")
    parser.add_argument("--campaigns", type=int, default=10_000)
    parser.add_argument("--output", type=Path, default=Path("build/fleet_store"))
    options = parser.parse_args(arguments)
    fleet = simulated_results(options.template, options.output, options.campaigns)
    before = status("VmHWM")
    begin, used = time.perf_counter(), time.process_time()
    folder = write_index(fleet, options.output)
    seconds, processor = time.perf_counter() - begin, time.process_time() - used
    after = status("VmHWM")
    sizes = {t: (folder / f"{t}.parquet").stat().st_size / 1e6 for t in TABLES}
    sys.stdout.write(
        f"{options.campaigns} campaigns: {seconds:.1f} s, processor {processor:.1f} s, peak memory "
        f"{before / 1e6:.0f} MB before, {after / 1e6:.0f} MB after; files [MB]: "
        f"{', '.join(f'{t} {s:.1f}' for t, s in sizes.items())}\n"
    )
    assert (options.output / INDEX_FOLDER).is_dir()
    for number, (took, rows) in enumerate(ask(folder, questions(DOCUMENT.read_text(encoding="utf-8"))), start=1):
        sys.stdout.write(f"question {number}: {took:.3f} s, {rows} rows\n")


if __name__ == "__main__":
    main()
