"""The campaigns of a type whose results count: those of the files as they are now, and what to know of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.fleet.records import Fleet
from sysid.fleet.running import Row, campaign_output
from sysid.fleet.status import CHANGED, rows_on_disk
from sysid.fleet.summaries import summary_of
from sysid.numbers import count, listing

#: The verdict of a campaign that is no member unless it is asked for.
DOUBTFUL = "do_not_bet"
_DOUBTED = "on whose numbers nobody should bet; they count all the same"
_NOT_HERE = "whose files are missing in part or all, so that it is not known whether they have changed"
#: Words about members that are not final, by their status.
_STATUS = {
    "preview": "with results of a preview (--quick), whose intervals are not reliable",
    "not_converged": "whose sampling has not converged",
}


@dataclass(frozen=True)
class Member:
    """One campaign with results: truck, name, the folder that they are in, and their status as in ``result.json``.

    `draws_sha256` is the hash of its draws, empty where it is not known.  On the numbers of a `doubtful` one nobody
    should bet.
    """

    truck: str
    campaign: str
    output: Path
    status: str = ""
    draws_sha256: str = ""
    doubtful: bool = False


@dataclass(frozen=True)
class Members:
    """All of one type, truck after truck, and sentences about those that are left out or that are not final."""

    type: str
    campaigns: tuple[Member, ...]
    remarks: tuple[str, ...]


def members(
    fleet: Fleet, output: Path, kind: str, with_doubtful: bool = False, rows: Sequence[Row] | None = None
) -> Members:
    """Campaigns of a type whose results count: those of the files as they are now, on which one may bet.

    Results whose files are not here any more are taken: data may be kept elsewhere.  `with_doubtful` takes campaigns
    too whose verdict is that nobody should bet on their numbers; remarks name them.  `rows` are those of
    :func:`sysid.fleet.status.rows_on_disk`, which hashes all files.
    """
    found: list[Member] = []
    left_out: dict[str, list[str]] = {}
    noted: dict[str, list[str]] = {words: [] for words in (_DOUBTED, *_STATUS.values(), _NOT_HERE)}
    for row in rows_on_disk(fleet, output) if rows is None else rows:
        if row.type != kind:
            continue
        if row.state == "running":
            left_out.setdefault("a process works on it", []).append(row.campaign)
        if row.outcome is None or not row.outcome.finished:
            continue
        folder = campaign_output(output, row.campaign)
        doubtful = summary_of(folder).verdict == DOUBTFUL
        if row.state == CHANGED:
            left_out.setdefault(f"{row.outcome.sentence}; run the fleet again", []).append(row.campaign)
            continue
        if doubtful and not with_doubtful:
            left_out.setdefault("nobody should bet on its numbers", []).append(row.campaign)
            continue
        if doubtful:
            noted[_DOUBTED].append(row.campaign)
        if row.outcome.status in _STATUS:
            noted[_STATUS[row.outcome.status]].append(row.campaign)
        if row.missing:
            noted[_NOT_HERE].append(row.campaign)
        found.append(Member(row.truck, row.campaign, folder, row.outcome.status, row.outcome.draws_sha256, doubtful))
    remarks = [_left_out(names, why) for why, names in left_out.items()]
    remarks += [f"{count(len(names), 'campaign')} {what}: {listing(names)}" for what, names in noted.items() if names]
    return Members(kind, tuple(found), tuple(remarks))


def _left_out(names: list[str], why: str) -> str:
    if len(names) == 1:
        return f"campaign {names[0]} is left out: {why}"
    return f"each of {count(len(names), 'campaign')} ({listing(names)}) is left out: {why}"
