"""Road side of the toolkit: point cloud, road plane, smooth bump profile, analytic bump shapes, effective profile."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sysid.lazy_names import lazy_names

if TYPE_CHECKING:
    from sysid.road.effective import AxleRoad, effective_profiles
    from sysid.road.enveloping import SPOKE_EXPONENT, SpokeTable, effective_profile, spoke_table, static_deflection
    from sysid.road.named_shapes import named_shape
    from sysid.road.point_cloud import read_point_cloud, read_point_cloud_counted
    from sysid.road.road_profile import RoadProfile, ScanAnalysis
    from sysid.road.scan import ScanOptions, analyse_scan
    from sysid.road.shapes import (
        half_sine,
        make_profile,
        parabolic,
        profile_from_points,
        raised_cosine,
        trapezoid,
        watts,
    )

_HOMES = {
    "AxleRoad": "sysid.road.effective",
    "RoadProfile": "sysid.road.road_profile",
    "SPOKE_EXPONENT": "sysid.road.enveloping",
    "ScanAnalysis": "sysid.road.road_profile",
    "ScanOptions": "sysid.road.scan",
    "SpokeTable": "sysid.road.enveloping",
    "analyse_scan": "sysid.road.scan",
    "effective_profile": "sysid.road.enveloping",
    "effective_profiles": "sysid.road.effective",
    "half_sine": "sysid.road.shapes",
    "make_profile": "sysid.road.shapes",
    "named_shape": "sysid.road.named_shapes",
    "parabolic": "sysid.road.shapes",
    "profile_from_points": "sysid.road.shapes",
    "raised_cosine": "sysid.road.shapes",
    "read_point_cloud": "sysid.road.point_cloud",
    "read_point_cloud_counted": "sysid.road.point_cloud",
    "spoke_table": "sysid.road.enveloping",
    "static_deflection": "sysid.road.enveloping",
    "trapezoid": "sysid.road.shapes",
    "watts": "sysid.road.shapes",
}

__all__ = [
    "SPOKE_EXPONENT",
    "AxleRoad",
    "RoadProfile",
    "ScanAnalysis",
    "ScanOptions",
    "SpokeTable",
    "analyse_scan",
    "effective_profile",
    "effective_profiles",
    "half_sine",
    "make_profile",
    "named_shape",
    "parabolic",
    "profile_from_points",
    "raised_cosine",
    "read_point_cloud",
    "read_point_cloud_counted",
    "spoke_table",
    "static_deflection",
    "trapezoid",
    "watts",
]

__getattr__, __dir__ = lazy_names(__name__, _HOMES)
