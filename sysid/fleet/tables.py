"""Tables of a fleet: their columns, and the rows that one campaign gives; nothing of Parquet in here.

A column that a campaign does not know is null.  SI units, speeds in km/h where the name says so, axles from 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sysid.files import json_table, read_bytes
from sysid.fleet.changes import is_content
from sysid.fleet.draws import RECORD_FILE, read_draws, thinned
from sysid.fleet.outcome import FINISHED, RESULT_FILE
from sysid.fleet.running import Row
from sysid.fleet.status import CHANGED, row_fields
from sysid.fleet.summaries import Channel, Summary, channels_of, summary_of

#: Version of the tables; a number up whenever a column changes its meaning or goes.
SCHEMA = 1
#: Draws per parameter that the table of draws holds.
INDEXED_DRAWS = 100

#: Columns by table: their type and what they are.
TABLES: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "campaigns": {
        "campaign": ("string", "name of the campaign, the key of all tables"),
        "truck": ("string", "truck"),
        "type": ("string", "type of the truck"),
        "date": ("string", "date, YYYY-MM-DD, or empty"),
        "state": ("string", "queued, running, interrupted, done, not converged, changed, rejected, failed or crashed"),
        "status": ("string", "status in result.json: converged, not_converged or preview"),
        "sentence": ("string", "why there is no result"),
        "seconds": ("double", "time on the clock [s]"),
        "processor_seconds": ("double", "processor time [s]"),
        "peak_bytes": ("int64", "largest memory of its process"),
        "attempts": ("int64", "how often its process was started"),
        "result_sha256": ("string", "hash of result.json without times"),
        "title": ("string", "title in the campaign file"),
        "seed": ("int64", "seed of everything random"),
        "warnings": ("int64", "number of warnings"),
        "warning": ("string", "the first warning"),
        "folder": ("string", "folder of the results, relative to that of the fleet"),
        "verdict": ("string", "verdict of the campaign in result.json: use, use_within, do_not_bet or not_yet"),
        "verdict_reason": ("string", "the first reason of the verdict"),
    },
    "parameters": {
        "campaign": ("string", "campaign"),
        "truck": ("string", "truck"),
        "type": ("string", "type of the truck"),
        "name": ("string", "parameter, k_1"),
        "quantity": ("string", "stiffness, damping, tire_stiffness, ..."),
        "axle": ("int64", "axle, null for all"),
        "load_case": ("string", "load case, null for all"),
        "run": ("string", "run of a parameter of one run, else null"),
        "law": ("string", "suspension law"),
        "unit": ("string", "unit of the numbers"),
        "identified": ("bool", "whether the data determine it"),
        "value": ("double", "least squares"),
        "sd": ("double", "its standard deviation"),
        "q05": ("double", "posterior, 5 %"),
        "q50": ("double", "posterior median"),
        "q95": ("double", "posterior, 95 %"),
        "ess": ("double", "effective draws"),
        "rhat": ("double", "R-hat"),
        "prior_median": ("double", "median of the prior"),
        "prior_log_sd": ("double", "standard deviation of the logarithm under the prior"),
        "verdict": ("string", "verdict of the campaign in result.json: use, use_within, do_not_bet or not_yet"),
    },
    "draws": {
        "campaign": ("string", "campaign"),
        "truck": ("string", "truck"),
        "name": ("string", "parameter"),
        "values": ("list<double>", "thinned draws, at most 100; those of one place in the list belong together"),
    },
    "predictions": {
        "campaign": ("string", "campaign"),
        "truck": ("string", "truck"),
        "type": ("string", "type of the truck"),
        "load_case": ("string", "load case"),
        "speed_km_h": ("double", "speed [km/h]"),
        "axle": ("int64", "axle"),
        "q05": ("double", "peak dynamic load ratio, 5 %"),
        "q50": ("double", "median"),
        "q95": ("double", "95 %"),
        "lift_off": ("bool", "whether the wheel leaves the road"),
        "beyond_driven": ("int64", "number of quantities beyond what the runs reached"),
        "verdict": ("string", "verdict of the campaign in result.json: use, use_within, do_not_bet or not_yet"),
        "shape": ("string", "bump that is crossed, null in results of earlier versions"),
        "shape_sha256": ("string", "hash of its profile, equal for equal profiles"),
    },
    "quality": {
        "campaign": ("string", "campaign"),
        "truck": ("string", "truck"),
        "run": ("string", "log"),
        "channel": ("string", "channel"),
        "nrmse": ("double", "RMS of the residual over the range of the measured history"),
        "iso18571": ("double", "rating of ISO/TS 18571"),
    },
    "channels": {
        "campaign": ("string", "campaign"),
        "truck": ("string", "truck"),
        "type": ("string", "type of the truck"),
        "file": ("string", "log"),
        "channel": ("string", "channel that is not good"),
        "kind": ("string", "kind of sensor"),
        "verdict": ("string", "usable or rejected"),
        "message": ("string", "what is wrong with it, the first sentence"),
    },
}  # fmt: skip


def campaign_rows(row: Row, output: Path, folder: Path) -> dict[str, list[dict[str, Any]]]:
    """Rows of all tables from the results of one campaign.

    Parameters
    ----------
    output : folder of its results.
    folder : that of the fleet, to which paths are relative.
    """
    content = read_bytes(output / RESULT_FILE) or b""
    if row.outcome is not None and _finished(row) and not is_content(row.outcome, content):
        # Somebody has written another one since the row was made.
        row = replace(row, state=CHANGED)
    document = json_table(content) if _finished(row) else {}
    try:
        rows = _rows_of(document, row, output)
    except (KeyError, TypeError, ValueError, AttributeError):
        # Not what the program writes: the campaign is there, its results are not.
        rows = _rows_of({}, row, output)
    if not all(_fits(name, line) for name, lines in rows.items() for line in lines):
        rows = _rows_of({}, row, output)
    (first,) = rows["campaigns"]
    first["folder"] = output.relative_to(folder).as_posix()
    return rows


def channel_rows(row: Row, output: Path) -> list[dict[str, Any]]:
    """Rows of the table ``channels`` alone, of the campaign whose results are in `output`."""
    return _channel_rows(summary_of(output).channels if _finished(row) else (), row)


def verdict_of(row: Row, output: Path) -> tuple[str, str]:
    """Verdict of the campaign whose results are in `output`, as in result.json, and its first reason; else empty."""
    summary = summary_of(output) if _finished(row) else Summary()
    return summary.verdict, summary.reason


def _rows_of(document: Mapping[str, Any], row: Row, output: Path) -> dict[str, list[dict[str, Any]]]:
    of_row = {"campaign": row.campaign, "truck": row.truck, "type": row.type}
    warnings, judged = document.get("warnings", []), document.get("verdict") or {}
    first = row_fields(row) | {
        "title": document.get("campaign"),
        "seed": document.get("seed"),
        "warnings": len(warnings) if document else None,
        "warning": warnings[0] if warnings else None,
        "verdict": judged.get("trust"),
        "verdict_reason": next(iter(judged.get("reasons", ())), None),
    }
    verdict = {"verdict": judged.get("trust")}
    return {
        "campaigns": [first],
        "parameters": [of_row | _parameter(p) | verdict for p in document.get("parameters", [])],
        "draws": _draws(of_row, output, row.outcome.draws_sha256) if document and row.outcome else [],
        "predictions": [of_row | _prediction(p) | verdict for p in document.get("predictions", [])],
        "quality": [of_row | dict(v) for v in document.get("validation", [])],
        "channels": _channel_rows(channels_of(document), row),
    }


def _fits(table: str, line: Mapping[str, Any]) -> bool:
    """Whether every value of a line is of its column's type."""
    return all(_of_kind(line.get(name), kind) for name, (kind, _) in TABLES[table].items())


def _of_kind(value: Any, kind: str) -> bool:
    if value is None or kind == "list<double>":
        return True
    if kind == "double":
        return type(value) is float or (type(value) is int and abs(value) < 2**53)
    if kind == "int64":
        return type(value) is int and abs(value) < 2**63
    return isinstance(value, {"string": str, "bool": bool}[kind])


def _finished(row: Row) -> bool:
    return row.outcome is not None and row.state in FINISHED


def _parameter(p: Mapping[str, Any]) -> dict[str, Any]:
    posterior, prior = p.get("posterior") or {}, p.get("prior") or {}
    return {
        **{k: p.get(k) for k in ("name", "quantity", "axle", "load_case", "run", "law", "unit", "identified")},
        **p["least_squares"],
        **{k: posterior.get(k) for k in ("q05", "q50", "q95", "ess", "rhat")},
        "prior_median": prior.get("median"),
        "prior_log_sd": prior.get("log_sd"),
    }


def _prediction(p: Mapping[str, Any]) -> dict[str, Any]:
    shape = p.get("shape") or {}
    return {
        **{k: p.get(k) for k in ("load_case", "speed_km_h", "axle", "lift_off")},
        **p["peak_dynamic_load_ratio"],
        "beyond_driven": len(p.get("trust", [])),
        "shape": shape.get("name"),
        "shape_sha256": shape.get("sha256"),
    }


def _channel_rows(channels: Iterable[Channel], row: Row) -> list[dict[str, Any]]:
    of_row = {"campaign": row.campaign, "truck": row.truck, "type": row.type}
    return [of_row | channel._asdict() for channel in channels]


def _draws(of_row: Mapping[str, Any], output: Path, digest: str) -> list[dict[str, Any]]:
    record = read_draws(output / RECORD_FILE, digest)
    if record is None:
        return []
    values = np.exp(thinned(record.draws, INDEXED_DRAWS)).T
    return [{**of_row, "name": n, "values": v} for n, v in zip(record.names, values, strict=True)]
