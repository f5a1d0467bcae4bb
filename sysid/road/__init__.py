"""Road side of the toolkit: point cloud, road plane, smooth bump profile, analytic bump shapes."""

from sysid.road.point_cloud import read_point_cloud, read_point_cloud_counted
from sysid.road.results import RoadProfile, ScanAnalysis
from sysid.road.scan import ScanOptions, analyse_scan
from sysid.road.shapes import (
    half_sine,
    make_profile,
    parabolic,
    plank,
    profile_from_points,
    raised_cosine,
    trapezoid,
    watts,
)

__all__ = [
    "RoadProfile",
    "ScanAnalysis",
    "ScanOptions",
    "analyse_scan",
    "half_sine",
    "make_profile",
    "parabolic",
    "plank",
    "profile_from_points",
    "raised_cosine",
    "read_point_cloud",
    "read_point_cloud_counted",
    "trapezoid",
    "watts",
]
