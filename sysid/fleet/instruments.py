"""Instruments whose channels were not good in campaigns of a fleet: one that fails everywhere is worth a repair."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from sysid.fleet.running import Row, campaign_output
from sysid.fleet.tables import channel_rows


@dataclass(frozen=True)
class InstrumentProblem:
    """One instrument, known by the column of its channel: campaigns and records in which it was not good.

    `kind` of its sensor, `rejected` records among them, and `message`, the first sentence about it.
    """

    channel: str
    kind: str
    campaigns: tuple[str, ...]
    records: int
    rejected: int
    message: str


def instrument_problems(rows: Iterable[Row], output: Path) -> list[InstrumentProblem]:
    """Problems of all finished campaigns, the instrument with most campaigns first, read one by one."""
    found: dict[tuple[str, str], InstrumentProblem] = {}
    for row in rows:
        for c in channel_rows(row, campaign_output(output, row.campaign)):
            key = (c["channel"] or "", c["kind"] or "")
            before = found.get(key, InstrumentProblem(*key, (), 0, 0, c["message"] or ""))
            found[key] = InstrumentProblem(
                *key,
                tuple(dict.fromkeys((*before.campaigns, row.campaign))),
                before.records + 1,
                before.rejected + (c["verdict"] == "rejected"),
                before.message,
            )
    return sorted(found.values(), key=lambda p: (-len(p.campaigns), -p.records, p.channel))
