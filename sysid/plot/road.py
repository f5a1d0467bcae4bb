"""Figures of the laser scan: the cloud from above, the profile with its band, and what the tires feel of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from matplotlib.axes import Axes

from sysid.plot.style import FAINT, INK, MUTED, axes_or_new, axle_color, styled, thin

if TYPE_CHECKING:
    from sysid.road.effective import AxleRoad
    from sysid.road.road_profile import RoadProfile, ScanAnalysis


@styled
def scan(analysis: ScanAnalysis, ax: Axes | None = None) -> Axes:
    """The scan from above in road coordinates, coloured by height above the road plane, with the wheel-track strip."""
    ax = axes_or_new(ax)
    step = max(1, len(analysis.cloud_along_m) // 20000)
    low, high = _height_range_mm(analysis)
    picture = ax.scatter(
        analysis.cloud_along_m[::step],
        analysis.cloud_across_m[::step],
        c=analysis.cloud_height_m[::step] * 1e3,
        s=1.5,
        cmap="cividis",
        vmin=low,
        vmax=high,
        linewidths=0,
        rasterized=True,
    )
    for side in (-1.0, 1.0):
        ax.axhline(side * analysis.strip_half_width_m, color=INK, lw=0.8, ls="--")
    ax.set_xlabel("along the direction of travel [m]")
    ax.set_ylabel("across [m]")
    ax.grid(False)
    bar = ax.figure.colorbar(picture, ax=ax, label="height [mm]")
    if bar.solids is not None:
        bar.solids.set_rasterized(True)
    return ax


@styled
def profile(analysis: ScanAnalysis, ax: Axes | None = None) -> Axes:
    """Points of the wheel track, the smooth profile, and a band of two standard errors about it if there is a scan."""
    ax = axes_or_new(ax)
    step = max(1, len(analysis.strip_station_m) // 6000)
    ax.plot(
        analysis.strip_station_m[::step],
        analysis.strip_height_m[::step] * 1e3,
        ls="",
        marker=".",
        ms=2.0 if analysis.scanned else 5.0,
        color=FAINT,
        label="scan, wheel track" if analysis.scanned else "measured",
        rasterized=True,
    )
    p = analysis.profile
    station, height, sd = thin(p.station_m, p.height_m, p.height_sd_m, most=800)
    color = axle_color(0)
    if analysis.scanned:
        band = (height - 2 * sd) * 1e3, (height + 2 * sd) * 1e3
        ax.fill_between(station, *band, color=color, alpha=0.25, lw=0, label="± 2 sd")
    ax.plot(station, height * 1e3, color=color, label="profile")
    ax.axvline(p.start_m, color=MUTED, lw=0.8, ls=":")
    ax.axvline(p.start_m + p.length_m, color=MUTED, lw=0.8, ls=":")
    ax.set_ylim(_height_range_mm(analysis))
    if len(p.station_m):
        ax.set_xlim(float(p.station_m[0]) - 0.3, float(p.station_m[-1]) + 0.3)
    ax.set_xlabel("station [m]")
    ax.set_ylabel("height above the road [mm]")
    ax.legend(loc="upper right")
    return ax


@styled
def effective_profile(profile: RoadProfile, roads: Sequence[AxleRoad], ax: Axes | None = None) -> Axes:
    """The bump as it lies on the road, and as the wheel centre of every axle in `roads` feels it."""
    ax = axes_or_new(ax)
    station, height = thin(profile.station_m - profile.start_m, profile.height_m, most=800)
    ax.fill_between(station, 0.0, height * 1e3, color=FAINT, lw=0, label="profile")
    for road in roads:
        ax.plot(road.station_m, road.rise_m * 1e3, color=axle_color(road.axle), label=f"axle {road.axle + 1}")
    for road in roads[:1]:
        ax.set_xlim(float(road.station_m[0]), float(road.station_m[-1]))
    ax.set_xlabel("station from the start of the bump [m]")
    ax.set_ylabel("rise of the wheel centre [mm]")
    ax.legend(loc="upper right")
    return ax


def _height_range_mm(analysis: ScanAnalysis) -> tuple[float, float]:
    # Outliers of the scanner lie far above and below the road; the bump and its noise set the range instead.
    height = analysis.profile.height_m * 1e3
    noise = 4.0 * analysis.noise_rms_m * 1e3
    low, high = min(float(height.min(initial=0.0)), 0.0), max(float(height.max(initial=0.0)), 1.0)
    margin = max(0.1 * (high - low), noise)
    return low - margin, high + margin
