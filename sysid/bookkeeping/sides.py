"""What sensors on one side show beside the mean of both: roll, where a bump is crossed at an angle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sysid.campaign.records import Campaign
from sysid.road.road_profile import ScanAnalysis
from sysid.wording import joined_words


def one_sided_sentence(campaign: Campaign, scans: Mapping[str, ScanAnalysis]) -> str | None:
    """What one-sided sensors and a bump off square cost together; None where there is only one of them, or neither.

    Pairs of sensors are means already: `campaign` has them without a side.
    """
    turned = {name: s.profile.sides.skew_rad for name, s in scans.items() if s.profile.sides is not None}
    driven = [abs(turned.get(run.bump, 0.0)) for run in campaign.bump_runs]
    if not driven or max(driven) == 0.0:
        return None
    sensors = {c.sensor.column: c.sensor for run in campaign.bump_runs for c in run.log.channels}
    alone = [s for s in sensors.values() if s.side is not None and s.axle is not None]
    if not alone:
        return None
    axles = sorted({s.axle + 1 for s in alone if s.axle is not None})
    sides = joined_words(sorted({str(s.side) for s in alone}))
    of = "axle" if len(axles) == 1 else "axles"
    return (
        f"The bump was crossed {np.degrees(max(driven)):.1f} degrees off square, and {of} "
        f"{joined_words([str(a) for a in axles])} {'has' if len(axles) == 1 else 'have'} sensors on one side only "
        f"({sides}). The roll in their readings is simulated, less exactly than a mean of both sides is free of it: on "
        "a simulated truck 2.6 degrees off square c stayed 3 % off, beyond its interval, and k 0.8 %. Put sensors on "
        "the other side too, or cross the bump along a line that is square to it."
    )
