"""The profile of a bump that nobody scanned: heights along the road, by level, straightedge or profilometer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sysid.campaign.records import Scan
from sysid.errors import CampaignError, DataRejectedError
from sysid.road.road_profile import ScanAnalysis
from sysid.road.shapes import profile_from_points

#: Distance of the stations [m] above which the curve between them is doubtful: the contact length of a truck's tire is
#: about 0.2 m, and a bump of 0.3 m would have four of them.
COARSE_M = 0.1


def levelled_profile(scan: Scan) -> ScanAnalysis:
    """The profile through the heights of a bump, joined by a curve that keeps their shape (no overshoot).

    `scan.levelled` has the stations along the direction of travel and the heights above the road [m]. There is no
    cloud, and the errors of the heights are not known: `height_sd_m` is zero.

    Raises
    ------
    DataRejectedError
        If the heights make no bump.
    """
    shape = scan.levelled
    assert shape is not None
    station, height = np.array(shape.station_m, float), np.array(shape.heights_m, float)
    try:
        profile = profile_from_points(station, height, kind="pchip", name=scan.file)
    except CampaignError as error:
        raise DataRejectedError(str(error)) from None
    profile = replace(profile, name=scan.name)
    flat = 0.5 * (profile.station_m[-1] - (station[-1] - station[0]))
    none = np.empty(0)
    return ScanAnalysis(
        profile=profile,
        heading_rad=scan.heading_rad,
        grade=0.0,
        camber=0.0,
        points=station.size,
        outliers=0,
        noise_rms_m=0.0,
        strip_half_width_m=0.0,
        strip_station_m=station - station[0] + flat,
        strip_height_m=height,
        cloud_along_m=none,
        cloud_across_m=none,
        cloud_height_m=none,
        messages=tuple(_messages(scan, station)),
    )


def _messages(scan: Scan, station: np.ndarray) -> list[str]:
    sentences = [
        f"{scan.file}: the profile goes through {station.size} heights along the road. Their errors, and what differs "
        "across the lane, are in no interval."
    ]
    coarse = float(np.max(np.diff(station)))
    if coarse > COARSE_M:
        sentences.append(
            f"{scan.file}: stations are up to {coarse:.2f} m apart; measure the bump at least every {COARSE_M:g} m, "
            "better every 0.02 m."
        )
    return sentences
