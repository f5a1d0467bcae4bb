"""The table of a fleet: read from the folders, written as JSON and CSV, and how far running campaigns are."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from sysid.csv_cells import csv_text, escape_cell
from sysid.files import is_plain, read_json, write_text
from sysid.fleet.changes import changes
from sysid.fleet.outcome import read_outcome
from sysid.fleet.records import Fleet
from sysid.fleet.running import Row, campaign_output
from sysid.fleet.task import PROGRESS_FILE, is_running
from sysid.folder_lock import writing_to

STATUS_JSON, STATUS_CSV = "fleet_status.json", "fleet_status.csv"
#: State of a campaign whose numbers do not count any more.
CHANGED = "changed"
#: Version of the table; a number up whenever a key changes its meaning or goes.
SCHEMA = 1
COLUMNS = (
    "truck", "type", "campaign", "date", "state", "status", "sentence", "seconds", "processor_seconds", "peak_bytes",
    "attempts", "result_sha256",
)  # fmt: skip


def rows_on_disk(fleet: Fleet, output: Path) -> Iterator[Row]:
    """What is known of every campaign without computing anything; input files and results are hashed.

    A campaign is ``running`` while a process works on it, and ``interrupted`` where one has left off.  It is
    ``changed`` where its files or its results are not those of its outcome: its numbers do not count then.
    """
    for truck, campaign in fleet.campaigns():
        folder = campaign_output(output, campaign.name)
        outcome = read_outcome(folder)
        state: str = "queued"
        missing: tuple[str, ...] = ()
        if is_running(folder):
            state, outcome = "running", None
        elif outcome is not None:
            state = outcome.state
            different = changes(outcome, campaign.folder, folder)
            missing = different.missing
            if different.sentence:
                state, outcome = CHANGED, replace(outcome, sentence=different.sentence)
        elif is_plain(folder / PROGRESS_FILE):
            state = "interrupted"
        yield Row(truck.name, truck.type, campaign.name, campaign.date, state, outcome, missing)


def stage_of(output: Path, name: str) -> str:
    """What a running campaign is doing, as it said last; empty if it has not said anything."""
    try:
        said = read_json(campaign_output(output, name) / PROGRESS_FILE)
        return f"{str(said['stage'])[:60]} ({100.0 * float(said['fraction']):.0f} %)"
    except (ValueError, KeyError, TypeError):
        return ""


def state_counts(rows: Sequence[Row]) -> dict[str, int]:
    """How many campaigns are in which state, in a fixed order."""
    order = ("queued", "running", "interrupted", "done", "not converged", CHANGED, "rejected", "failed", "crashed")
    numbers = Counter(row.state for row in rows)
    return {state: numbers[state] for state in order if numbers[state]}


def row_fields(row: Row) -> dict[str, Any]:
    """One line of the table by column; what is not known is None."""
    outcome = {} if row.outcome is None else asdict(row.outcome)
    of_row = {"truck": row.truck, "type": row.type, "campaign": row.campaign, "date": row.date, "state": row.state}
    return {column: of_row.get(column, outcome.get(column)) for column in COLUMNS}


def write_status(rows: Sequence[Row], output: Path) -> tuple[Path, Path]:
    """Write the table as ``fleet_status.json`` and ``fleet_status.csv``.

    Raises
    ------
    OutputError
        If the folder cannot be written.
    """
    fields = [row_fields(row) for row in rows]
    document = {"schema": SCHEMA, "counts": state_counts(rows), "campaigns": fields}
    cells = [["" if line[c] is None else escape_cell(str(line[c])) for c in COLUMNS] for line in fields]
    with writing_to(output):
        write_text(output / STATUS_JSON, json.dumps(document, indent=1, ensure_ascii=False) + "\n")
        write_text(output / STATUS_CSV, csv_text(COLUMNS, cells))
    return output / STATUS_JSON, output / STATUS_CSV
