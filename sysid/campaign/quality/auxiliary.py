"""Quality of channels that show no vibration: speed, air pressure, pitch rate.

They may be slow, and a level that stands still for a whole record may be right.
"""

from __future__ import annotations

import numpy as np

from sysid.campaign.findings import ChannelFinding
from sysid.campaign.passage.logged_speed import STANDING_M_S
from sysid.campaign.records import Channel, Log, SensorKind
from sysid.wording import shorten

#: Readings that trucks at a test do not exceed [SI], with room to spare: 216 km/h, two turns per second, 16 bar; and a
#: gauge that reads below the atmosphere by more than 0.2 bar.
_LIMITS: dict[SensorKind, tuple[float, float]] = {
    "speed": (-60.0, 60.0),
    "pitch_rate": (-12.0, 12.0),
    "air_pressure": (-2e4, 1.6e6),
}
#: Share of readings beyond the limits from which they are no dropouts.
_OFTEN = 0.02


def check_auxiliary(log: Log, channel: Channel, bump_run: bool) -> tuple[Channel | None, ChannelFinding]:
    """The channel without readings that cannot be, None where it is rejected, and what was found.

    Parameters
    ----------
    log : for its name.
    channel : one of its auxiliary channels.
    bump_run : whether the truck is driven over a bump.
    """
    sensor = channel.sensor
    value = channel.value.copy()
    finite = np.isfinite(value)
    missing = int(np.sum(~finite))
    said: list[str] = []
    rejected = False
    low, high = _LIMITS[sensor.kind]
    beyond = finite & ((value < low) | (value > high))
    seen = value[finite]
    what, unit = sensor.kind.replace("_", " "), sensor.unit
    if not finite.any():
        said.append("the column is empty.")
        rejected = True
    elif beyond.sum() > _OFTEN * seen.size:
        furthest = float(seen[np.argmax(np.abs(seen))]) / sensor.unit_in_si
        said.append(
            f"'{shorten(sensor.column)}' reads up to {furthest:.4g} {unit}, which is no {what} of a truck: correct its "
            "unit in campaign.toml, or leave the sensor out."
        )
        rejected = True
    elif beyond.any():
        value[beyond] = np.nan
        said.append(f"{int(beyond.sum())} readings beyond any {what} of a truck were left out.")
    if not rejected and sensor.kind == "speed" and bump_run and np.nanmax(np.abs(value)) < STANDING_M_S:
        said.append(f"'{shorten(sensor.column)}' shows a truck that stands still on a bump run: the sensor is dead.")
        rejected = True
    if not rejected and sensor.kind == "pitch_rate" and np.ptp(seen) == 0.0:
        said.append(f"the reading does not change from {seen[0] / sensor.unit_in_si:.4g} {unit}: the sensor is dead.")
        rejected = True
    steps = np.diff(channel.time_s)
    finding = ChannelFinding(
        file=log.file,
        column=sensor.column,
        kind=sensor.kind,
        si_unit=sensor.si_unit,
        samples=int(np.isfinite(value).sum()),
        rate_hz=float(1.0 / np.median(steps)) if steps.size else np.nan,
        jitter_s=float(np.max(np.abs(steps - np.median(steps)))) if steps.size else 0.0,
        missing=missing,
        gaps=(),
        clipped=int(np.sum(channel.censored != 0)),
        clip_level=sensor.full_scale if channel.censored.any() else None,
        dead_spans=(),
        rest_level=float(np.median(value[np.isfinite(value)])) if np.isfinite(value).any() else None,
        noise_rms=None,
        peak=float(np.max(np.abs(seen))) if seen.size else None,
        verdict="rejected" if rejected else "usable" if said else "good",
        messages=tuple(said),
    )
    return (None if rejected else Channel(sensor, channel.time_s, value, channel.censored)), finding
