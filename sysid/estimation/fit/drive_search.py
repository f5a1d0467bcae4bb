"""How the speed may have been held otherwise than declared: where the force acts, and how fast it answers."""

from __future__ import annotations

from sysid.campaign.records import HOLD_S, Campaign
from sysid.estimation.fit.part_score import PartCandidate
from sysid.estimation.parameters.undeclared_parts import Drive, UndeclaredParts

#: Time constants [s] that are tried: from an engine that keeps its speed, in a low gear, to a driver's foot.
TIMES_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)


def drive_candidates(campaign: Campaign) -> tuple[PartCandidate, ...]:
    """Wheels that hold the speed, if runs were neither towed nor free; for a truck that is said to, the other way."""
    vehicle, held = campaign.vehicle, {run.speed_held for run in campaign.bump_runs}
    if len(held) != 1 or held & {"towed", "free"}:
        return ()
    if vehicle.driven_at == "road":
        # Its time is an unknown of the fit.
        return (_candidate(Drive("centre", HOLD_S[held.pop()])),)
    return tuple(_candidate(Drive("road", time)) for time in TIMES_S)


def _candidate(drive: Drive) -> PartCandidate:
    parts = UndeclaredParts(drive=drive)
    # Parameters of another drive explain little of the way to this one: any share of it is worth a fit, which decides.
    return PartCandidate("how the speed was held", parts, parts, 1.0, 0.0, lambda trial: True)
