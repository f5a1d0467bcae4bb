"""What the names of files say against what the list of tests says: axle, load case, speed."""

from __future__ import annotations

import re

from sysid.campaign.records import Campaign, PlankDrop
from sysid.wording import shorten

_AXLE = re.compile(r"(?:^|[^a-z0-9])axle[ _-]?0*(\d{1,2})(?![0-9])")
_SPEED = re.compile(r"(?<![0-9.])(\d{1,3}(?:\.\d+)?)[ _-]?(?:kmh|km_h|km-h|kph|kmph)(?![a-z])")


def name_complaints(campaign: Campaign) -> list[str]:
    """Sentences about logs whose names contradict their entries; names that say nothing are not judged."""
    said = []
    for drop in campaign.plank_drops:
        complaint = _of_drop(drop, campaign)
        if complaint is not None:
            said.append(complaint)
    for run in campaign.bump_runs:
        name = _base(run.log.file)
        other = _other_case(name, run.load_case, list(campaign.load_cases))
        if other is not None:
            said.append(_sentence(run.log.file, f"the load case '{shorten(run.load_case)}'", f"'{shorten(other)}'"))
        speeds = [float(s) for s in _SPEED.findall(name)]
        listed = 3.6 * run.nominal_speed_m_s
        if run.speed_listed and len(speeds) == 1 and abs(speeds[0] - listed) > 0.05 * listed:
            said.append(_sentence(run.log.file, f"{listed:.3g} km/h", f"{speeds[0]:g} km/h"))
    # One file may stand for several drops.
    return list(dict.fromkeys(said))


def _of_drop(drop: PlankDrop, campaign: Campaign) -> str | None:
    numbers = {int(n) for n in _AXLE.findall(_base(drop.log.file))}
    count = len(campaign.vehicle.axles)
    if drop.release == "body" or len(numbers) != 1 or not numbers <= set(range(1, count + 1)):
        return None
    (number,) = numbers
    if number == drop.axle + 1:
        return None
    listed = f"axle {drop.axle + 1} ('{shorten(campaign.vehicle.axles[drop.axle].name)}')"
    return _sentence(drop.log.file, f"a drop of {listed}", f"axle {number}")


def _sentence(file: str, listed: str, named: str) -> str:
    return (
        f"{shorten(file, 100)} is listed under {listed}, but its name says {named}: are entries exchanged? Correct the "
        "list of tests, or rename the file if its name is wrong."
    )


def _base(file: str) -> str:
    return file.rsplit("/", 1)[-1].lower()


def _other_case(name: str, listed: str, cases: list[str]) -> str | None:
    """A load case that the name holds as a word while it does not hold the listed one."""

    def holds(case: str) -> bool:
        return re.search(rf"(?<![a-z0-9]){re.escape(case.lower())}(?![a-z0-9])", name) is not None

    matching = [case for case in cases if holds(case)]
    return matching[0] if len(matching) == 1 and matching[0] != listed else None
