"""Reads a fleet: from ``fleet.toml``, or from a folder whose subfolders hold campaign files."""

from __future__ import annotations

import os
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from sysid import limits
from sysid.campaign.inputs.paths import check_name
from sysid.campaign.toml.errors import validated
from sysid.campaign.toml.reading import parse_toml
from sysid.campaign.toml.todo import refuse_todos
from sysid.errors import CampaignError
from sysid.fleet.folders import CAMPAIGN_FILE, campaign_folders
from sysid.fleet.records import Fleet, FleetCampaign, SharedError, Truck
from sysid.fleet.schema import NAME_BYTES, FleetFile, SharedEntry, TruckEntry, is_of_names
from sysid.logs.input_file import FileRefusedError, read_file
from sysid.wording import JOINERS, finish, nearest, plain_line, shorten

FLEET_FILE = "fleet.toml"


def read_fleet(path: str | Path) -> Fleet:
    """The fleet of a ``fleet.toml``, of a folder with one, or of a folder of campaigns, each a truck of its own.

    Raises
    ------
    CampaignError
        If there is no campaign, the file is wrong, or two campaigns have one name or one folder.
    """
    given = Path(path)
    if given.is_dir():
        file = given / FLEET_FILE
        return _from_file(file) if file.is_file() else fleet_of_folder(given)
    return _from_file(given)


def fleet_of_folder(folder: Path) -> Fleet:
    """The campaigns below a folder, each a truck of its own.

    Raises
    ------
    CampaignError
        If there is none, or two would have one name.
    """
    folders, said = campaign_folders(folder)
    if not folders:
        none = (
            f"{shorten(folder, 100)} has neither a {FLEET_FILE} nor subfolders with a {CAMPAIGN_FILE}; give the folder "
            "above the campaigns."
        )
        raise CampaignError(" ".join([none, *said[:3]]))
    trucks = [Truck(name := result_name(f), "truck", (FleetCampaign(name, folder / f),)) for f in folders]
    return _checked(Fleet(folder.resolve().name, folder, tuple(trucks), messages=tuple(said)), str(folder))


def result_name(folder: str) -> str:
    """Name of the folder of results of a campaign in `folder`: its path, other signs than those of names replaced."""
    text = unicodedata.normalize("NFC", folder).replace("/", "-")
    kept = "".join(c if is_of_names(c) else "-" for c in text).strip("-").lstrip(".")
    return kept.encode()[:NAME_BYTES].decode(errors="ignore") or "campaign"


def _from_file(file: Path) -> Fleet:
    try:
        content = read_file(file, limits.CAMPAIGN_BYTES)
    except FileNotFoundError:
        raise CampaignError(
            f"There is no fleet file '{shorten(file, 120)}'; write one by 'fleet init FOLDER'."
        ) from None
    except (FileRefusedError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "no plain file, or larger than 2 MB"
        raise CampaignError(f"The fleet file '{shorten(file, 120)}' cannot be read ({reason}).") from None
    tables = parse_toml(content.data, content.name)
    refuse_todos(tables, content.name)
    read = validated(FleetFile, tables, content.name)
    trucks = tuple(_truck(entry, file.parent, content.name) for entry in read.truck)
    fleet = _checked(Fleet(read.fleet.title or file.parent.resolve().name, file.parent, trucks), content.name)
    _check_names(content.name, "shared errors have the name", (entry.name for entry in read.shared))
    names = [campaign.name for _, campaign in fleet.campaigns()]
    shared = tuple(_shared(entry, names, content.name) for entry in read.shared)
    return Fleet(fleet.title, fleet.folder, fleet.trucks, shared)


def _truck(entry: TruckEntry, folder: Path, label: str) -> Truck:
    campaigns = []
    for c in entry.campaign:
        check_name(c.folder, f"{label}: truck '{shorten(entry.name)}'")
        date = "" if c.date is None else c.date.isoformat()
        campaigns.append(FleetCampaign(c.name or result_name(c.folder), folder / c.folder, date))
    return Truck(entry.name, entry.type, tuple(campaigns))


def _shared(entry: SharedEntry, names: list[str], label: str) -> SharedError:
    chosen = names if entry.campaigns is None else entry.campaigns
    for name in chosen:
        if name not in names:
            raise CampaignError(
                finish(
                    f"{label}: shared error '{shorten(entry.name)}' names the campaign '{name}'; {nearest(name, names)}"
                )
            )
    moves = {str(quantity): factor for quantity, factor in entry.moves.items()}
    return SharedError(entry.name, entry.log_sd, moves, tuple(chosen), entry.in_intervals)


#: Joiners beside a Latin letter, a digit or an end change nothing that a reader sees.
_IDLE_JOINER = re.compile(rf"(?<![^\x00-\x7f])[{JOINERS}]|[{JOINERS}](?![^\x00-\x7f])")


def _seen(name: str) -> str:
    """What a reader sees of a name: two that look alike in all tables are one."""
    return unicodedata.normalize("NFC", _IDLE_JOINER.sub("", plain_line(name)))


def _checked(fleet: Fleet, label: str) -> Fleet:
    _check_names(label, "trucks have the name", (_seen(t.name) for t in fleet.trucks))
    # Names that differ in case only are one folder on some systems.
    _check_names(label, "campaigns have the name", (_seen(c.name).casefold() for _, c in fleet.campaigns()))
    _check_files(fleet, label)
    return fleet


def _check_names(label: str, what: str, names: Iterable[str]) -> None:
    double = next((name for name, count in Counter(names).items() if count > 1), None)
    if double is not None:
        raise CampaignError(f"{shorten(label, 80)}: two {what} '{shorten(double)}'; give each its own.")


def _check_files(fleet: Fleet, label: str) -> None:
    """The same data twice would count as two measurements."""
    names: dict[str, str] = {}
    for _, campaign in fleet.campaigns():
        file = campaign.folder / CAMPAIGN_FILE if os.path.isdir(campaign.folder) else campaign.folder
        # A campaign file may be a link: the logs are those of the folder that the link is in.
        other = names.setdefault(os.path.join(os.path.realpath(file.parent), file.name), campaign.name)
        if other != campaign.name:
            raise CampaignError(
                f"{shorten(label, 80)}: the campaigns '{shorten(other)}' and '{shorten(campaign.name)}' have one "
                f"folder, {shorten(campaign.folder, 100)}; correct the folder of one, or leave it out."
            )
