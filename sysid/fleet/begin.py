"""Begins a ``fleet.toml`` from the campaigns below a folder: trucks by their folders, types by their vehicles."""

from __future__ import annotations

import tomllib
from pathlib import Path

from sysid import limits
from sysid.campaign.toml.text import quoted
from sysid.errors import CampaignError
from sysid.fleet.folders import CAMPAIGN_FILE, campaign_folders
from sysid.fleet.read import result_name
from sysid.fleet.schema import NAME_BYTES
from sysid.logs.input_file import read_file
from sysid.wording import shorten

_HEAD = """\
# Trucks, their types and their campaigns. Everything else stands in the campaign files.
# Campaigns of one truck are repeats on the same vehicle: put them into one [[truck]].
# Guessed from the folders; look at names, types and dates.

schema = 1

[fleet]
title = {title}

# An error that campaigns have in common moves all of them the same way, so it does not shrink with more trucks.
# Masses 1 % too large make k and c 1 % too large:
# [[shared]]
# name = "weighbridge"
# log_sd = 0.01
# moves = {{ stiffness = 1.0, damping = 1.0 }}
# campaigns = ["..."]         # all of them by default
# in_intervals = true         # the interval of each campaign allows for it already, by its axle_load tolerance
"""


def fleet_text(folder: Path) -> tuple[str, list[str]]:
    """The text of a ``fleet.toml`` of the campaigns below a folder, and sentences about what was left out.

    Raises
    ------
    CampaignError
        If there is no campaign.
    """
    folders, said = campaign_folders(folder)
    if not folders:
        none = (
            f"{shorten(folder, 100)} has no subfolder with a {CAMPAIGN_FILE}; begin campaigns by 'init FOLDER' first."
        )
        raise CampaignError(" ".join([none, *said[:3]]))
    # Signs that are replaced can make two names one.
    names = dict(zip(folders, distinct_names([result_name(f) for f in folders]), strict=True))
    parts = [_HEAD.format(title=quoted(folder.resolve().name))]
    for truck, campaigns in _trucks(folders).items():
        lines = [
            "",
            "[[truck]]",
            f"name = {quoted(truck)}",
            f"type = {quoted(_type(folder / campaigns[0]))}",
            "campaign = [",
        ]
        lines += [f"  {{ name = {quoted(names[c])}, folder = {quoted(c)} }}," for c in campaigns]
        parts.append("\n".join([*lines, "]", ""]))
    return "".join(parts), said


def distinct_names(names: list[str]) -> list[str]:
    """Names with -2, -3, ... where another differs in case only; as short as a reader takes them."""
    taken: set[str] = set()
    found = []
    for name in names:
        candidate, number = name, 1
        while candidate.casefold() in taken:
            number += 1
            end = f"-{number}"
            candidate = name.encode()[: NAME_BYTES - len(end)].decode(errors="ignore") + end
        taken.add(candidate.casefold())
        found.append(candidate)
    return found


def _trucks(folders: list[str]) -> dict[str, list[str]]:
    """Campaigns by truck: those whose folders stand in one subfolder are of one truck, others are each their own."""
    trucks: dict[str, list[str]] = {}
    for folder in folders:
        above = folder.rsplit("/", 1)[0] if "/" in folder else folder
        trucks.setdefault(above, []).append(folder)
    return trucks


def _type(folder: Path) -> str:
    """The vehicle's name in the campaign file, with its number of axles where it has none."""
    try:
        vehicle = tomllib.loads(read_file(folder / CAMPAIGN_FILE, limits.CAMPAIGN_BYTES).data.decode("utf-8-sig"))[
            "vehicle"
        ]
        return str(vehicle.get("name") or f"{len(vehicle['axle'])} axles")[:200]
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return "truck"
