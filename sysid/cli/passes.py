"""Passes that the command line asks for instead of those of the campaign file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from sysid.campaign.records import BumpShape, Campaign, PredictionRequest
from sysid.errors import CampaignError

#: Options of `predict` that are no settings of a calibration.
OPTIONS = ("speeds", "load_case", "bump", "shape", "height", "length", "top")


def requested_passes(campaign: Campaign, options: Mapping[str, Any]) -> tuple[PredictionRequest, ...]:
    """One request per speed; none where no speed is given.

    Raises
    ------
    CampaignError
        If options are given that need another one, or name a load case or bump that the campaign does not have.
    """
    given = [name for name in OPTIONS if options.get(name) not in (None, ())]
    speeds = options.get("speeds") or ()
    if not given:
        return ()
    if not speeds:
        raise CampaignError(f"--{given[0].replace('_', '-')} needs a --speed in km/h; add it.")
    case = options.get("load_case") or next(iter(campaign.load_cases))
    if case not in campaign.load_cases:
        raise CampaignError(f"--load-case '{case}' is not in the campaign; it has {', '.join(campaign.load_cases)}.")
    shape = _shape(options)
    bump = _bump(campaign, options.get("bump"), shape)
    return tuple(PredictionRequest(case, speed / 3.6, bump, shape) for speed in speeds)


def _shape(options: Mapping[str, Any]) -> BumpShape | None:
    name, height, length, top = (options.get(key) for key in ("shape", "height", "length", "top"))
    if name is None:
        if any(value is not None for value in (height, length, top)):
            raise CampaignError("--height, --length and --top are the size of a --shape; add it, for example watts.")
        return None
    if height is None or length is None:
        raise CampaignError(f"--shape {name} needs its size: add --height and --length in metres.")
    if top is not None and name != "trapezoid":
        raise CampaignError(f"--top belongs to a trapezoid, not to the shape {name}; leave it out.")
    return BumpShape(name, height, length, top)


def _bump(campaign: Campaign, name: str | None, shape: BumpShape | None) -> str:
    if shape is not None:
        if name is not None:
            raise CampaignError("--bump and --shape are both given; a pass crosses one of them.")
        return shape.label
    if not campaign.scans:
        raise CampaignError("The campaign has no scan of a bump; name one by --shape, --height and --length.")
    if name is not None and name not in campaign.scans:
        raise CampaignError(f"--bump '{name}' is not in the campaign; it has {', '.join(campaign.scans)}.")
    return name or next(iter(campaign.scans))
