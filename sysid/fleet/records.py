"""What a fleet is: trucks of a type, their campaigns, and errors that campaigns have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class FleetCampaign:
    """One campaign: `name` of its folder of results, `folder` of the campaign file, `date` as YYYY-MM-DD or empty."""

    name: str
    folder: Path
    date: str = ""


@dataclass(frozen=True)
class Truck:
    """One vehicle, its type, and the campaigns that were driven with it."""

    name: str
    type: str
    campaigns: tuple[FleetCampaign, ...]


@dataclass(frozen=True)
class SharedError:
    """An error that campaigns have in common, such as that of one weighbridge.

    It moves the logarithm of a parameter of quantity q by ``moves[q] * e``, with the same e ~ N(0, log_sd) in all of
    `campaigns`.  `in_intervals`: the intervals of each campaign allow for it already.
    """

    name: str
    log_sd: float
    moves: Mapping[str, float]
    campaigns: tuple[str, ...]
    in_intervals: bool = True


@dataclass(frozen=True)
class Fleet:
    """All trucks, in the order of the file; `folder` holds the campaigns; `messages` say what was left out of it."""

    title: str
    folder: Path
    trucks: tuple[Truck, ...]
    shared: tuple[SharedError, ...] = ()
    messages: tuple[str, ...] = ()

    def campaigns(self) -> Iterator[tuple[Truck, FleetCampaign]]:
        """Every campaign with its truck."""
        for truck in self.trucks:
            for campaign in truck.campaigns:
                yield truck, campaign

    @property
    def count(self) -> int:
        """Number of campaigns."""
        return sum(len(truck.campaigns) for truck in self.trucks)
