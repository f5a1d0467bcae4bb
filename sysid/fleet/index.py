"""Writes the tables of a fleet as Parquet files, a few hundred campaigns in memory at a time."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from sysid.errors import CampaignError
from sysid.files import UNFINISHED, make_folder, write_text
from sysid.fleet.records import Fleet
from sysid.fleet.running import Row, campaign_output
from sysid.fleet.status import rows_on_disk
from sysid.fleet.tables import SCHEMA, TABLES, campaign_rows
from sysid.folder_lock import writing_to

INDEX_FOLDER = "fleet.parquet"
SCHEMA_FILE = "schema.json"
#: In the metadata of every file: the same in all that were written together.  They are replaced one after the other.
WRITTEN = "sysid_fleet_written"
#: Campaigns in one part of a file: what is in memory at a time.
_PART = 250


def write_index(fleet: Fleet, output: Path) -> Path:
    """Write the tables below ``fleet.parquet/`` of the folder of a fleet; earlier ones are replaced at the end.

    Raises
    ------
    CampaignError
        If pyarrow is not installed.
    OutputError
        If the folder cannot be written.
    """
    target = output / INDEX_FOLDER
    with writing_to(output):
        make_folder(target)
        temporary = Path(tempfile.mkdtemp(dir=output, prefix=UNFINISHED))
        try:
            _write(rows_on_disk(fleet, output), temporary, output)
            for name in TABLES:
                os.replace(temporary / f"{name}.parquet", target / f"{name}.parquet")
            write_text(target / SCHEMA_FILE, schema_text())
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return target


def schema_text() -> str:
    """The columns of all tables, their types and meanings, as JSON."""
    tables = {
        table: {name: {"type": kind, "meaning": meaning} for name, (kind, meaning) in columns.items()}
        for table, columns in TABLES.items()
    }
    return json.dumps({"schema": SCHEMA, "tables": tables}, indent=1) + "\n"


def _write(rows: Iterable[Row], folder: Path, output: Path) -> None:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        remedy = "install it by pip install 'truck-sysid[parquet]'"
        raise CampaignError(f"The tables of a fleet need pyarrow; {remedy}.") from error
    kinds = {"string": pa.string(), "double": pa.float64(), "int64": pa.int64(), "bool": pa.bool_()}
    kinds["list<double>"] = pa.list_(pa.float64())
    about = {"sysid_fleet_schema": str(SCHEMA), WRITTEN: secrets.token_hex(8)}
    schemas = {
        table: pa.schema([(name, kinds[kind]) for name, (kind, _) in columns.items()], about)
        for table, columns in TABLES.items()
    }
    writers = {t: pq.ParquetWriter(folder / f"{t}.parquet", s, compression="zstd") for t, s in schemas.items()}
    try:
        for part in _parts(rows, output):
            for table, schema in schemas.items():
                columns = {name: [row.get(name) for row in part[table]] for name in schema.names}
                writers[table].write_table(pa.table(columns, schema))
    finally:
        for writer in writers.values():
            writer.close()


def _parts(rows: Iterable[Row], output: Path) -> Iterator[dict[str, list[dict[str, Any]]]]:
    part: dict[str, list[dict[str, Any]]] = {table: [] for table in TABLES}
    for number, row in enumerate(rows, start=1):
        for table, more in campaign_rows(row, campaign_output(output, row.campaign), output).items():
            part[table] += more
        if number % _PART == 0:
            yield part
            part = {table: [] for table in TABLES}
    yield part
