"""Road side of the toolkit: point cloud, road plane, smooth bump profile, analytic bump shapes, effective profile."""

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
