"""The campaigns of a type whose results count: those of the files as they are now, and what to know of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sysid.fleet.key import file_digests
from sysid.fleet.outcome import Outcome, read_outcome
from sysid.fleet.records import Fleet
from sysid.fleet.running import campaign_output
from sysid.numbers import count, listing
from sysid.wording import shorten


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


def members(fleet: Fleet, output: Path, kind: str) -> Members:
    """Campaigns of a type that have results, without those whose files have changed since; their files are hashed.

    Results whose files are not here any more are taken: data may be kept elsewhere.
    """
    found: list[Member] = []
    remarks: list[str] = []
    not_here: list[str] = []
    for truck in fleet.trucks:
        for campaign in truck.campaigns if truck.type == kind else ():
            folder = campaign_output(output, campaign.name)
            outcome = read_outcome(folder)
            if outcome is None or not outcome.finished:
                continue
            changed, missing = _differences(outcome, campaign.folder)
            if changed:
                remarks.append(
                    f"campaign {campaign.name} is left out: it has changed since it was calibrated "
                    f"({listing([shorten(name) for name in changed])}); run the fleet again"
                )
                continue
            if missing:
                not_here.append(campaign.name)
            found.append(Member(truck.name, campaign.name, folder, outcome.status))
    return Members(kind, tuple(found), (*remarks, *_doubts(found, not_here)))


def _differences(outcome: Outcome, folder: Path) -> tuple[list[str], list[str]]:
    """Input files of an outcome that are not as they were, and those that cannot be read."""
    now = file_digests(folder, outcome.inputs)
    changed = [name for name, digest in outcome.inputs.items() if now[name] not in ("", digest)]
    return changed, [name for name in outcome.inputs if not now[name]]


def _doubts(found: Sequence[Member], not_here: list[str]) -> Iterator[str]:
    of_status = {s: [m.campaign for m in found if m.status == s] for s in ("preview", "not_converged")}
    for names, what in (
        (of_status["preview"], "with results of a preview (--quick), whose intervals are not reliable"),
        (of_status["not_converged"], "whose sampling has not converged"),
        (not_here, "whose files are missing in part or all, so that it is not known whether they have changed"),
    ):
        if names:
            yield f"{count(len(names), 'campaign')} {what}: {listing(names)}"
