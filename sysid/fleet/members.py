"""The campaigns of a type whose results count: those of the files as they are now, and what to know of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sysid.files import read_json
from sysid.fleet.changes import changes
from sysid.fleet.outcome import RESULT_FILE, read_outcome
from sysid.fleet.records import Fleet
from sysid.fleet.running import campaign_output
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
    """One campaign with results: truck, name, the folder that they are in, and their status as in ``result.json``."""

    truck: str
    campaign: str
    output: Path
    status: str = ""


@dataclass(frozen=True)
class Members:
    """All of one type, truck after truck, and sentences about those that are left out or that are not final."""

    type: str
    campaigns: tuple[Member, ...]
    remarks: tuple[str, ...]


def members(fleet: Fleet, output: Path, kind: str, with_doubtful: bool = False) -> Members:
    """Campaigns of a type whose results count: those of the files as they are now, on which one may bet.

    Their files are hashed.  Results whose files are not here any more are taken: data may be kept elsewhere.
    `with_doubtful` takes campaigns too whose verdict is that nobody should bet on their numbers; remarks name them.
    """
    found: list[Member] = []
    left_out: dict[str, list[str]] = {}
    noted: dict[str, list[str]] = {words: [] for words in (_DOUBTED, *_STATUS.values(), _NOT_HERE)}
    for truck in fleet.trucks:
        for campaign in truck.campaigns if truck.type == kind else ():
            folder = campaign_output(output, campaign.name)
            outcome = read_outcome(folder)
            if outcome is None or not outcome.finished:
                continue
            different = changes(outcome, campaign.folder, folder)
            doubtful = trust_in(folder) == DOUBTFUL
            if different.sentence:
                left_out.setdefault(f"{different.sentence}; run the fleet again", []).append(campaign.name)
                continue
            if doubtful and not with_doubtful:
                left_out.setdefault("nobody should bet on its numbers", []).append(campaign.name)
                continue
            if doubtful:
                noted[_DOUBTED].append(campaign.name)
            if outcome.status in _STATUS:
                noted[_STATUS[outcome.status]].append(campaign.name)
            if different.missing:
                noted[_NOT_HERE].append(campaign.name)
            found.append(Member(truck.name, campaign.name, folder, outcome.status))
    remarks = [_left_out(names, why) for why, names in left_out.items()]
    remarks += [f"{count(len(names), 'campaign')} {what}: {listing(names)}" for what, names in noted.items() if names]
    return Members(kind, tuple(found), tuple(remarks))


def trust_in(folder: Path) -> str:
    """The verdict in the ``result.json`` of a folder; empty where there is none."""
    judged = read_json(folder / RESULT_FILE).get("verdict")
    return str(judged.get("trust")) if isinstance(judged, dict) else ""


def _left_out(names: list[str], why: str) -> str:
    if len(names) == 1:
        return f"campaign {names[0]} is left out: {why}"
    return f"each of {count(len(names), 'campaign')} ({listing(names)}) is left out: {why}"
