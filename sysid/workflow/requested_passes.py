"""Passes that the command line asks for instead of those of the campaign file."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sysid import limits
from sysid.errors import CampaignError

if TYPE_CHECKING:
    from sysid.campaign.bridges import BridgeCourse, BridgeDescription
    from sysid.campaign.declared import Declared
    from sysid.campaign.records import BumpShape, Campaign, PredictionRequest
    from sysid.campaign.roads import RoadCourse

#: Options that name passes.
OPTIONS = (
    "speeds", "load_case", "bump", "lateral", "shape", "height", "length", "top", "road", "realisations", "bridge",
    "vehicles", "gap", "at", "hole", "stress_exponent",
)  # fmt: skip
#: Length of a road of a class that has none [m], and the longest bump.
ROAD_LENGTH_M, SHAPE_LENGTH_M = 500.0, 100.0
#: Shapes that a bump may have by name.
BUMP_SHAPES = ("watts", "sinusoidal", "half_sine", "parabolic", "trapezoid")


@dataclass(frozen=True)
class _Names:
    """What options can name in a campaign."""

    load_cases: Collection[str]
    scans: Collection[str]
    bridges: Mapping[str, BridgeDescription]


def refuse_passes(declared: Declared, options: Mapping[str, Any]) -> None:
    """Raise what :func:`requested_passes` raises, from what the campaign file declares: its logs are not read yet."""
    if options.get("bridge") not in declared.tables.bridge:  # one of the campaign's comes with files of its own
        requested_passes(_Names(declared.tables.load_case, declared.tables.scan, {}), options)


def requested_passes(campaign: Campaign | _Names, options: Mapping[str, Any]) -> tuple[PredictionRequest, ...]:
    """One request per speed; none where no speed is given.

    Raises
    ------
    CampaignError
        If options are given that need another one, or name a load case or bump that the campaign does not have.
    DataRejectedError
        If the file of a bump cannot be used.
    """
    given = [name for name in ("bridge", "road", *OPTIONS) if options.get(name) not in (None, (), False)]
    speeds = options.get("speeds") or ()
    if not given:
        return ()
    if not speeds:
        raise CampaignError(f"--{given[0].replace('_', '-')} needs a --speed in km/h; add it.")
    case = options.get("load_case") or next(iter(campaign.load_cases))
    if case not in campaign.load_cases:
        raise CampaignError(f"--load-case '{case}' is not in the campaign; it has {', '.join(campaign.load_cases)}.")
    from sysid.campaign.records import PredictionRequest

    if options.get("bridge") is not None:
        course = _bridge(campaign, options)
        return tuple(PredictionRequest(case, speed / 3.6, course.label, bridge=course) for speed in speeds)
    for name in ("vehicles", "gap"):
        if options.get(name) is not None:
            raise CampaignError(f"--{name} is about vehicles one behind the other on a bridge; add --bridge.")
    if options.get("road") is not None:
        road = _whole_road(campaign, options)
        return tuple(PredictionRequest(case, speed / 3.6, road.label, road=road) for speed in speeds)
    for name, what in (("at", "is where a bump lies on a road"), ("hole", "is cut into a road"),
                       ("stress_exponent", "is about the damage of a road")):  # fmt: skip
        if options.get(name) not in (None, False):
            raise CampaignError(f"--{name.replace('_', '-')} {what}; add --road, for example B.")
    if options.get("realisations") is not None:
        raise CampaignError("--realisations is how many roads of a class are driven; add --road, for example B.")
    shape, bump = _shape(options), options.get("bump")
    if shape is None:
        shape = _file(campaign, bump, options.get("lateral"))
        bump = None if shape is not None else bump
    elif options.get("lateral") is not None:
        raise CampaignError("--lateral chooses a long section of an OpenCRG file; name that file by --bump.")
    bump = _bump(campaign, bump, shape)
    return tuple(PredictionRequest(case, speed / 3.6, bump, shape) for speed in speeds)


def _bridge(campaign: Campaign | _Names, options: Mapping[str, Any]) -> BridgeCourse:
    """The bridge of --bridge with the surface that --road names, or its own as often as --realisations says."""
    from dataclasses import replace

    from sysid.campaign.bridges import BridgeCourse, Surface
    from sysid.campaign.inputs.bridges import bridge_from_file
    from sysid.campaign.roads import ROAD_CLASSES, RoadCourse

    name, road = options["bridge"], options.get("road")
    for other in ("bump", "lateral", "shape", "height", "length", "top", "at", "stress_exponent"):
        if options.get(other) is not None:
            raise CampaignError(f"--bridge and --{other} are both given; a pass goes over one of them.")
    bridge = campaign.bridges.get(name)
    if bridge is None:
        if not os.path.exists(name):
            known = f"; the campaign has {', '.join(campaign.bridges)}" if campaign.bridges else ""
            raise CampaignError(f"--bridge '{name}' is neither a bridge of the campaign nor a file{known}.")
        from sysid.road.profile_files import road_from_file

        bridge = bridge_from_file(Path(name), road_from_file)
    surface, realisations = bridge.surface, options.get("realisations")
    if road is not None:
        roughness = next((c for c in ROAD_CLASSES if c == road.upper()), None)
        if roughness is None:
            raise CampaignError(
                f"--road '{road}' is no class of ISO 8608 (A to H); a measured surface stands in the bridge's table, "
                "with bridge_at_m."
            )
        surface = Surface(RoadCourse(0.0, roughness, options.get("seed") or 0, realisations or 1), 0.0)
    elif realisations is not None:
        if surface is None or surface.course.roughness is None:
            raise CampaignError("--realisations is how many surfaces of a class are driven; add --road, for example B.")
        surface = replace(surface, course=replace(surface.course, realisations=realisations))
    vehicles, gap = options.get("vehicles"), options.get("gap")
    if gap is not None and vehicles is None:
        raise CampaignError("--gap lies between vehicles; add --vehicles, for example 2.")
    return BridgeCourse(bridge, surface, vehicles or 1, 10.0 if gap is None else gap)


def _whole_road(campaign: Campaign | _Names, options: Mapping[str, Any]) -> RoadCourse:
    """The road of --road, roads joined by ``+`` one behind the other, with the bump or the hole that lies on it."""
    from dataclasses import replace

    from sysid.campaign.roads import RoadCourse, with_obstacle

    name, at = options["road"], options.get("at")
    parts = [name] if os.path.exists(name) else [part.strip() for part in name.split("+")]
    realisations = options.get("realisations")
    if len(parts) == 1:
        road = _road(parts[0], options)
    else:
        if options.get("length") is not None and options.get("shape") is None:
            raise CampaignError("--length belongs to one road; give each class its own, as in C:200+A:60.")
        several = tuple(_road(part, {**options, "length": None, "realisations": None}) for part in parts)
        road = RoadCourse(sum(p.length_m for p in several), realisations=realisations or 1, parts=several)
    if (exponent := options.get("stress_exponent")) is not None:
        road = replace(road, stress_exponent=exponent)
    bump = options.get("bump")
    # Without a shape the length is that of the road.
    shape = _shape(options if options.get("shape") is not None else {**options, "length": None})
    if at is None:
        if bump is not None or shape is not None or options.get("hole"):
            raise CampaignError("A bump or hole on a --road needs its station; add --at in metres.")
        return road
    if (bump is None) == (shape is None):
        raise CampaignError("--at is where a bump begins on the road; name it by --bump FILE or --shape.")
    shape = shape or _file(campaign, bump, None)
    if shape is None:
        raise CampaignError(f"--bump '{bump}' on a --road is a file with its profile, not a scan of the campaign.")
    return with_obstacle(road, shape, at, bool(options.get("hole")), "--at")


def _road(name: str, options: Mapping[str, Any]) -> RoadCourse:
    """One road: a class, with its length as in ``B:200``, or a file."""
    # The length of a shape is its own.
    length = None if options.get("shape") is not None else options.get("length")
    realisations = options.get("realisations")
    from sysid.campaign.roads import ROAD_CLASSES, RoadCourse

    known, _, own = name.partition(":")
    roughness = next((c for c in ROAD_CLASSES if c == known.strip().upper()), None)
    if roughness is not None:
        if options.get("lateral") is not None:
            raise CampaignError("--lateral chooses a long section of an OpenCRG file; name that file by --road.")
        length = _own_length(own, name) or length or ROAD_LENGTH_M
        return RoadCourse(length, roughness, options.get("seed") or 0, realisations or 1)
    if realisations is not None:
        raise CampaignError("--realisations is how many roads of a class are driven; a road from a file is one.")
    path = Path(name)
    if not os.path.exists(path):
        raise CampaignError(f"--road '{name}' is neither a class of ISO 8608 (A to H) nor a file.")
    from sysid.road.profile_files import road_from_file

    named = "/".join(part for part in (path.parent.name, path.name) if part)
    return road_from_file(path, options.get("lateral") or 0.0, named, length)


def _own_length(text: str, name: str) -> float | None:
    """The length in ``B:200``, None where there is none."""
    if not text:
        return None
    try:
        length = float(text)
    except ValueError:
        length = 0.0
    if not 0.0 < length <= limits.ROAD_LENGTH_M:
        raise CampaignError(f"--road '{name}': the length of the class is {text!r}; write metres, as in B:200.")
    return length


def _shape(options: Mapping[str, Any]) -> BumpShape | None:
    name, height, length, top = (options.get(key) for key in ("shape", "height", "length", "top"))
    if name is None:
        if any(value is not None for value in (height, length, top)):
            raise CampaignError("--height, --length and --top are the size of a --shape; add it, for example watts.")
        return None
    if length is not None and length > SHAPE_LENGTH_M:
        raise CampaignError(f"--length {length:g} is too long for a bump, at most {SHAPE_LENGTH_M:g} m; for a --road?")
    if height is None or length is None:
        raise CampaignError(f"--shape {name} needs its size: add --height and --length in metres.")
    if top is not None and name != "trapezoid":
        raise CampaignError(f"--top belongs to a trapezoid, not to the shape {name}; leave it out.")
    from sysid.campaign.records import BumpShape

    return BumpShape(name, height, length, top)


def _file(campaign: Campaign | _Names, bump: str | None, lateral: float | None) -> BumpShape | None:
    """The bump in a file that --bump names; None where it names a scan."""
    path = None if bump is None or bump in campaign.scans else Path(bump)
    if path is None or not (os.path.exists(path) or path.suffix):
        if lateral is not None:
            raise CampaignError("--lateral chooses a long section of an OpenCRG file; name that file by --bump.")
        return None
    # Unlike Path.exists this says no of a name that no file can have.
    if not os.path.exists(path):
        known = f"; the campaign has the scans {', '.join(campaign.scans)}" if campaign.scans else ""
        raise CampaignError(f"--bump '{bump}' is neither a scan of the campaign nor a file{known}.")
    from sysid.road.profile_files import bump_from_file

    # With its folder: profiles of several sites often have one name, and results are named after them.
    return bump_from_file(path, lateral or 0.0, "/".join(part for part in (path.parent.name, path.name) if part))


def _bump(campaign: Campaign | _Names, name: str | None, shape: BumpShape | None) -> str:
    if shape is not None:
        if name is not None:
            raise CampaignError("--bump and --shape are both given; a pass crosses one of them.")
        return shape.label
    if not campaign.scans:
        raise CampaignError("The campaign has no scan of a bump; name one by --shape, --height and --length.")
    if name is not None and name not in campaign.scans:
        raise CampaignError(f"--bump '{name}' is not in the campaign; it has {', '.join(campaign.scans)}.")
    return name or next(iter(campaign.scans))
