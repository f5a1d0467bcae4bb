"""How the speed may have been held otherwise than declared: where the force acts, and how fast it answers."""

from __future__ import annotations

from sysid.campaign.records import Campaign
from sysid.estimation.fit.part_score import PartCandidate
from sysid.estimation.parameters.undeclared_parts import Drive, UndeclaredParts
from sysid.vehicle_model.passes import HOLD_S

#: Time constants [s] that are tried: from an engine that keeps its speed, in a low gear, to a driver's foot.
TIMES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)


def drive_candidates(campaign: Campaign) -> tuple[PartCandidate, ...]:
    """Other drives of a campaign whose runs were neither towed nor free: their effect is that of the whole change."""
    vehicle, held = campaign.vehicle, {run.speed_held for run in campaign.bump_runs}
    if len(held) != 1 or held & {"towed", "free"}:
        return ()
    now = Drive(vehicle.driven_at or "centre", vehicle.hold_s or HOLD_S[held.pop()])
    others = [Drive(at, time) for at in ("road", "centre") for time in TIMES_S]
    return tuple(_candidate(other) for other in others if other != now)


def _candidate(drive: Drive) -> PartCandidate:
    parts = UndeclaredParts(drive=drive)
    # Parameters of another drive explain little of the way to this one: any share of it is worth a fit, which decides.
    return PartCandidate("how the speed was held", parts, parts, 1.0, 0.0, lambda trial: True)
