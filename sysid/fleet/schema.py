"""Tables of ``fleet.toml``: trucks, their types and campaigns, and errors that campaigns have in common."""

from __future__ import annotations

import datetime
import unicodedata
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, StrictStr

from sysid.campaign.toml.schema_fields import TEXT_LENGTH, Name, PathText, Table
from sysid.wording import JOINERS

#: Of the name of a folder; file systems take 255 in all, and names of files that are being written are longer.
NAME_BYTES = 120
Quantity = Literal["stiffness", "damping", "tire_stiffness"]


def is_of_names(character: str) -> bool:
    """Whether a character may stand in the name of a campaign: letters, marks, joiners and digits of any script."""
    return character in f"._-{JOINERS}" or unicodedata.category(character)[0] in "LMN"


def _folder_name(name: str) -> str:
    if not all(map(is_of_names, name)) or name.startswith("."):
        raise ValueError(f"is '{name[:60]}'; a folder gets this name: use letters, digits, '.', '-' and '_'")
    if len(name.encode()) > NAME_BYTES:
        raise ValueError(
            f"is '{name[:30]}...' of {len(name.encode())} bytes; a folder gets this name: at most {NAME_BYTES}"
        )
    return name


CampaignName = Annotated[StrictStr, Field(min_length=1, max_length=120), AfterValidator(_folder_name)]
LogSd = Annotated[float, Field(strict=True, allow_inf_nan=False, gt=0.0, le=1.0)]
Factor = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-100.0, le=100.0)]


class About(Table):
    """Table [fleet]."""

    title: Annotated[StrictStr, Field(max_length=TEXT_LENGTH)] = ""


class CampaignEntry(Table):
    """One entry of a truck's list of campaigns."""

    folder: PathText
    name: CampaignName | None = None
    date: datetime.date | None = None


class TruckEntry(Table):
    """One [[truck]]: its campaigns are repeats on the same vehicle."""

    name: Name
    type: Name = "truck"
    campaign: Annotated[list[CampaignEntry], Field(min_length=1)]


class SharedEntry(Table):
    """One [[shared]]: an error that several campaigns have in common, such as that of one weighbridge."""

    name: Name
    log_sd: LogSd
    moves: Annotated[dict[Quantity, Factor], Field(min_length=1)]
    campaigns: list[CampaignName] | None = None
    in_intervals: bool = True


class FleetFile(Table):
    """The whole file."""

    schema_: Annotated[Literal[1], Field(alias="schema")]
    fleet: About = About()
    truck: Annotated[list[TruckEntry], Field(min_length=1)]
    shared: list[SharedEntry] = []  # noqa: RUF012  pydantic copies defaults
