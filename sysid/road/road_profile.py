"""The road profile found in a laser scan."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.tabular import Tabular

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


#: Step [m] in which heights and stations are compared.
_STEP_M = 1e-4
#: Heights in round numbers do not lie on the edge of a step, where rounding errors would move them.
_OFF_EDGE = 0.382


@dataclass(frozen=True)
class ProfileIdentity:
    """What tells one bump from another: `name`, `height_m`, `length_m` above 1 mm [m], and `sha256` of its heights.

    The hash is of stations and heights in steps of 0.1 mm: that of one file is the same on every machine.
    """

    name: str
    height_m: float
    length_m: float
    sha256: str


@dataclass(frozen=True)
class SideProfiles:
    """Heights (n,) above the road plane [m] under the left and the right wheels, at the stations of their profile.

    Both are those of wheels `at_m` from the middle of the truck [m]. The bump is turned by `skew_rad` against square to
    the travel, positive where the left wheels meet it first: a wheel dy [m] further to the left meets everything
    dy tan(skew) earlier.
    """

    left_m: np.ndarray
    right_m: np.ndarray
    at_m: float
    skew_rad: float


@dataclass(frozen=True)
class RoadProfile(Tabular):
    """Smooth profile of one bump along the direction of travel, zero road outside.

    `station_m` (n,) uniformly spaced, starting before the bump at 0; `height_m` (n,) above the fitted road plane, zero
    at both ends; `height_sd_m` (n,) its own standard error.  `start_m` is the first station above 1 mm, the origin of
    every start offset; `length_m` the distance to the last one.  `sides` under the wheels of either side, None where
    nobody measured them apart.
    """

    name: str
    station_m: np.ndarray
    height_m: np.ndarray
    height_sd_m: np.ndarray
    start_m: float
    length_m: float
    sides: SideProfiles | None = None

    @property
    def identity(self) -> ProfileIdentity:
        """Name, size and hash of the heights from `start_m` on, in the direction of travel."""
        along = self.station_m - self.start_m
        at = (along >= 0.0) & (along <= self.length_m)
        steps = np.round(np.column_stack([along[at], self.height_m[at]]) / _STEP_M + _OFF_EDGE).astype("<i8")
        digest = hashlib.sha256(steps.tobytes()).hexdigest()
        return ProfileIdentity(self.name, float(self.height_m.max()), float(self.length_m), digest)

    def summary(self) -> pd.DataFrame:
        """One row: name, largest height, length above 1 mm and largest standard error [m]."""
        import pandas as pd

        heights = {"height_m": float(self.height_m.max()), "length_m": self.length_m}
        return pd.DataFrame([{"bump": self.name, **heights, "height_sd_m": float(self.height_sd_m.max())}])

    def to_pandas(self) -> pd.DataFrame:
        """Station, height and its standard error [m], one row per station."""
        import pandas as pd

        return pd.DataFrame({"station_m": self.station_m, "height_m": self.height_m, "height_sd_m": self.height_sd_m})

    def to_xarray(self) -> xr.Dataset:
        """Height and its standard error [m] over ``station_m``."""
        return self.to_pandas().set_index("station_m").to_xarray().assign_attrs(bump=self.name)


@dataclass(frozen=True)
class ScanAnalysis(Tabular):
    """How a point cloud became a profile: plane, outliers, the wheel-track strip and the profile itself.

    - `grade` and `camber` are slopes along and across the direction of travel;
    - `strip_station_m`, `strip_height_m` (m,) are the points of the wheel track used for the profile (thinned for
      figures);
    - `cloud_*`: a thinned picture of the whole scan in road coordinates (along, across, height above the plane); empty
      where heights along the road were measured in place of a cloud.
    """

    profile: RoadProfile
    heading_rad: float
    grade: float
    camber: float
    points: int
    outliers: int
    noise_rms_m: float
    strip_half_width_m: float
    strip_station_m: np.ndarray
    strip_height_m: np.ndarray
    cloud_along_m: np.ndarray
    cloud_across_m: np.ndarray
    cloud_height_m: np.ndarray
    messages: tuple[str, ...] = ()

    @property
    def scanned(self) -> bool:
        """Whether there is a point cloud."""
        return self.cloud_along_m.size > 0

    def summary(self) -> pd.DataFrame:
        """One row: the profile's numbers, slopes of the road, points, outliers and noise of the scan."""
        row = {name: getattr(self, name) for name in ("grade", "camber", "points", "outliers", "noise_rms_m")}
        return self.profile.summary().assign(**row)

    def to_pandas(self) -> pd.DataFrame:
        """The profile, one row per station."""
        return self.profile.to_pandas()

    def to_xarray(self) -> xr.Dataset:
        """The profile over its stations."""
        return self.profile.to_xarray()
