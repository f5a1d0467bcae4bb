"""What can be predicted: bumps that have a shape, and passes that come to an end; known before anything is fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING

from sysid import limits
from sysid.errors import CampaignError

if TYPE_CHECKING:
    from sysid.arrays import Stations
    from sysid.campaign.records import BumpShape, Campaign, PredictionRequest
    from sysid.campaign.vehicle_records import Vehicle

#: Distance of the stations of a shape [m].
STATION_STEP_M = 0.002
# The bump starts at the first station above this height: the origin of every start offset and of every time axis.
START_HEIGHT_M = 0.001
#: Beyond what was driven by more than this factor is an extrapolation.
MARGIN = 1.05


def shape_fault(shape: BumpShape) -> str:
    """Why a bump by name and size, or by points, is none: half a sentence that follows its name; empty for a bump."""
    if shape.name == "points":
        import numpy as np

        return points_fault(np.array(shape.station_m), np.array(shape.heights_m))
    height, length, top = shape.height_m, shape.length_m, shape.top_m
    if height is None or length is None:
        return "needs a height and a length"
    if fault := size_fault(height, length):
        return fault
    if shape.name == "trapezoid" and top is not None and not 0 <= top < length:
        return f"has top_m = {top:g} on a length_m of {length:g}; its flat top must be shorter than the bump"
    if shape.name == "watts" and height > length / 2:
        return f"has height_m = {height:g} on a length_m of {length:g}; a circular arc is at most half as high as long"
    return ""


def size_fault(height_m: float, length_m: float) -> str:
    """The same of height and length alone, each [m]."""
    for what, value in (("height", height_m), ("length", length_m)):
        if not isfinite(value) or value <= 0:
            return f"has a {what} of {value:g} m; a positive length in metres is expected"
    if length_m < 3 * STATION_STEP_M:
        step = f"stations every {STATION_STEP_M:g} m"
        return f"is {length_m:g} m long, too short for {step}; give lengths in metres"
    if length_m / STATION_STEP_M > 1e6:
        step = f"stations of {STATION_STEP_M:g} m"
        return f"is {length_m:g} m long, which takes more than a million {step}; give lengths in metres"
    return ""


def points_fault(station_m: Stations, height_m: Stations) -> str:
    """The same of points along the road, `station_m` and `height_m` (n,) [m]."""
    import numpy as np

    if station_m.ndim != 1 or station_m.shape != height_m.shape or station_m.size < 3:
        return f"has {station_m.size} stations and {height_m.size} heights; at least three of each are expected"
    if not (np.all(np.isfinite(station_m)) and np.all(np.isfinite(height_m))):
        return "holds values that are not numbers; remove or replace those points"
    backward = np.flatnonzero(np.diff(station_m) <= 0)
    if backward.size:
        before, at = station_m[backward[0] : backward[0] + 2]
        return (
            f"has values of station_m that do not increase at point {backward[0] + 2} ({at:g} m after {before:g} m); "
            "sort the points along the road"
        )
    if max(abs(height_m[0]), abs(height_m[-1])) > START_HEIGHT_M:
        return (
            f"ends {1e3 * height_m[0]:.1f} mm and {1e3 * height_m[-1]:.1f} mm above the road; its first and last point "
            "must lie on the road (within 1 mm)"
        )
    length, height = float(np.ptp(station_m)), float(height_m.max())
    if length > limits.PROFILE_LENGTH_M or height > limits.PROFILE_HEIGHT_M:
        return (
            f"is {length:g} m long and {height:g} m high, more than the {limits.PROFILE_LENGTH_M:g} m and "
            f"{limits.PROFILE_HEIGHT_M:g} m of a bump; give stations and heights in metres"
        )
    if height <= START_HEIGHT_M:
        return f"nowhere rises above 1 mm (maximum {1e3 * height:.2f} mm); give heights in metres"
    return size_fault(height, length)


def pass_fault(speed_m_s: float, duration_s: float) -> str:
    """Why a pass of at least this duration is not predicted: half a sentence that follows its name; empty if it is."""
    if duration_s <= limits.PASS_SECONDS:
        return ""
    return (
        f"takes {duration_s:.3g} s or more at {3.6 * speed_m_s:.3g} km/h, at most {limits.PASS_SECONDS:g} s are "
        "predicted; choose a higher speed"
    )


def check_passes(
    requests: Sequence[PredictionRequest], vehicle: Vehicle, length_m: Mapping[str, float], label: str
) -> None:
    """Refuse passes of a campaign file that take too long from the bump's start at axle 1 to its end at the last axle.

    Parameters
    ----------
    requests : all predictions of the file, in its order.
    length_m : length of bumps [m] by name, as far as known.
    label : name of the file for messages.

    Raises
    ------
    CampaignError
        Names the entry of the first one.
    """
    base = max(axle.x_m for axle in vehicle.axles)
    for i, request in enumerate(requests):
        if request.road is not None:
            seconds = (base + request.road.length_m) / request.speed_m_s
            if seconds > limits.ROAD_SECONDS:
                raise CampaignError(
                    f"{label}: the pass of tests.prediction[{i + 1}] over its road takes {seconds:.3g} s, at most "
                    f"{limits.ROAD_SECONDS:g} s are predicted; choose a higher speed or a shorter road."
                )
            continue
        if request.bridge is not None:
            continue
        way = base + (length_m.get(request.bump, 0.0) if request.shape is None else _length(request.shape))
        if fault := pass_fault(request.speed_m_s, way / request.speed_m_s):
            raise CampaignError(f"{label}: the pass of tests.prediction[{i + 1}].speed_km_h {fault}.")


def _length(shape: BumpShape) -> float:
    if shape.station_m:
        return shape.station_m[-1] - shape.station_m[0]
    return shape.length_m or 0.0


def driven_speeds(campaign: Campaign, load_case: str) -> list[float]:
    """Nominal speeds [m/s] of the runs of a load case."""
    return [r.nominal_speed_m_s for r in campaign.bump_runs if r.load_case == load_case]


def pass_label(campaign: Campaign, request: PredictionRequest) -> str:
    """Load case, speed and, where there are several, bump of a pass."""
    name = f"{request.load_case}, {3.6 * request.speed_m_s:g} km/h"
    if request.shape is not None or not request.over_bump:
        return f"{name}, {request.bump if request.shape is None else request.shape.label}"
    return f"{name}, {request.bump}" if len(campaign.scans) > 1 else name


def beyond_runs(campaign: Campaign, request: PredictionRequest) -> list[str]:
    """How far a pass is from what was driven, in sentences: load case, speed and bump; empty where it is near."""
    name, sentences = pass_label(campaign, request), []
    driven = driven_speeds(campaign, request.load_case)
    if not driven:
        sentences.append(f"{name}: no run was driven in this load case; the prediction is an extrapolation.")
    elif request.speed_m_s > MARGIN * max(driven):
        sentences.append(
            f"{name}: faster than any run of this load case, speed_km_h is {request.speed_m_s / max(driven):.2g} times "
            f"{3.6 * max(driven):g} km/h; the prediction is an extrapolation."
        )
    if request.over_bump and (request.shape is not None or request.bump not in {r.bump for r in campaign.bump_runs}):
        sentences.append(f"{name}: no run crossed this bump; the prediction is an extrapolation.")
    return sentences
